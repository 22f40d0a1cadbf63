//! What the benchmark varies: a setting is how a frame is drawn, a build how the file was made.

use crate::render::scene::Changes;
use esker_builder::{NormalsMode, Options};
use esker_engine::Method;
use esker_engine::draw::choice::Paced;
use esker_engine::draw::method::METHODS;
use esker_engine::draw::scene::PictureRequest;
use esker_render::{Dots, PointSize};
use serde::Serialize;

/// Targets that are tried, pixels.
const SPACINGS_PX: [f64; 5] = [0.5, 1.5, 2.0, 3.0, 4.0];
/// Targets of EWA splatting that are tried even if settings are not crossed: it gains by them.
const FINER_PX: [f64; 2] = [0.5, 0.7];
/// Pass that is added to dense views, and a target at which views are dense, pixels.
const DENSE: &str = "with push in dense views";
const DENSE_PX: f64 = 0.25;
/// Pass that users can leave out.
const MATT: &str = "without highlights";
/// Budgets that are tried, points.
const BUDGETS: [u64; 4] = [100_000, 300_000, 1_000_000, 3_000_000];
/// Resolutions that are tried, as shares of the picture's sides.
const SCALES: [f64; 4] = [0.85, 0.7, 0.5, 0.35];
/// Methods for which `--budget-ms` chooses settings, as on the command line.
pub(super) const PACED: [&str; 3] = ["auto", "pull-push", "ewa"];

/// How a frame is drawn.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(super) struct Setting {
    /// Method, as on the command line.
    pub method: &'static str,
    /// Diameter of dots in pixels, or `adaptive`; of points alone.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub point_size: Option<&'static str>,
    /// Target distance of points, pixels.
    pub spacing_px: f64,
    /// Most points that are drawn.
    pub budget_points: u64,
    /// Side of the drawn picture over that of the shown one.
    pub scale: f64,
    /// Optional pass that is left out, or added.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pass: Option<&'static str>,
    /// Whether full planes are drawn although the file has compact ones.
    pub full: bool,
    /// Time that `--budget-ms` names and the settings were chosen for, and the CPU time that was
    /// predicted, milliseconds; the method that was asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub budget_ms: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub wanted_method: Option<&'static str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub predicted_cpu_ms: Option<f64>,
    /// Whether a GPU draws.
    #[serde(skip)]
    pub on_gpu: bool,
    /// Build options, as on the command line; of the default build if empty.
    #[serde(skip_serializing_if = "str::is_empty")]
    pub build: &'static str,
}

impl Setting {
    /// A method with default settings.
    fn of(method: &'static str) -> Self {
        let request = PictureRequest::default();
        Self {
            method,
            point_size: None,
            spacing_px: request.target_spacing_px,
            budget_points: request.budget_points,
            scale: 1.0,
            pass: None,
            full: false,
            budget_ms: None,
            wanted_method: None,
            predicted_cpu_ms: None,
            on_gpu: false,
            build: "",
        }
    }

    /// The settings that the model of the machine chose for a time.
    pub fn paced(chosen: &Paced, wanted_method: &'static str, budget_ms: f64) -> Self {
        let method = METHODS.iter().find(|(method, ..)| *method == chosen.request.method);
        Self {
            spacing_px: chosen.request.target_spacing_px,
            budget_points: chosen.request.budget_points,
            scale: chosen.scale,
            budget_ms: Some(budget_ms),
            wanted_method: Some(wanted_method),
            predicted_cpu_ms: Some(chosen.cpu_ms),
            ..Self::of(method.map_or("auto", |(_, name, _)| *name))
        }
    }

    /// The request for its picture of `size` pixels.
    pub fn request(&self, size: [u32; 2], base: &PictureRequest) -> PictureRequest {
        let method = METHODS.iter().find(|(_, name, _)| *name == self.method);
        PictureRequest {
            size: size.map(|side| self.side(side)),
            method: method.map_or(Method::default(), |(method, ..)| *method),
            target_spacing_px: self.spacing_px,
            budget_points: self.budget_points,
            full: self.full,
            shines: base.shines && self.pass != Some(MATT),
            dots: self.dots(),
            ..base.clone()
        }
    }

    /// The setting whose reference is that of this one's own family: the same method and dots.
    pub fn family(&self) -> Self {
        Self { point_size: self.point_size, ..Self::of(self.method) }
    }

    fn dots(&self) -> Dots {
        match self.point_size {
            Some(_) => Dots { size: PointSize::Adaptive, eye_dome: 1.0 },
            None => Dots::default(),
        }
    }

    /// Changes of its frames.
    pub fn changes(&self) -> Changes {
        Changes {
            always_pushes: self.pass == Some(DENSE),
            one_wins: self.pass == Some("without averages"),
            is_rough: self.pass == Some("without smoothing"),
            is_flat: self.pass == Some("without fitted planes"),
            is_matt: self.pass == Some(MATT),
            ..Changes::NONE
        }
    }

    /// Options of `esker render` that draw so; none if only the benchmark can. Lower resolutions
    /// are those of a picture of `size` pixels, which is enlarged afterwards.
    pub fn options(&self, size: [u32; 2]) -> Option<String> {
        let base = Self::of(self.method);
        if let Some(ms) = self.budget_ms {
            return Some(format!("--budget-ms {ms}"));
        }
        let mut words = vec![format!("--method {}", self.method)];
        words.extend(self.point_size.map(|size| format!("--point-size {size} --eye-dome")));
        if self.spacing_px != base.spacing_px {
            words.push(format!("--target-spacing {}", self.spacing_px));
        }
        if self.budget_points != base.budget_points {
            words.push(format!("--budget-points {}", short(self.budget_points)));
        }
        if self.scale != base.scale {
            let [width, height] = size.map(|side| self.side(side));
            words.push(format!("--size {width}x{height}, enlarged"));
        }
        match self.pass {
            Some(MATT) => words.push("--no-highlights".into()),
            Some(_) => return None,
            None => {}
        }
        words.extend(self.full.then(|| "--full".into()));
        words.extend(self.on_gpu.then(|| "--backend gpu".into()));
        words.extend((!self.build.is_empty()).then(|| format!("(built with {})", self.build)));
        Some(words.join(" "))
    }

    /// Side of the drawn picture, for a side of the shown one, pixels.
    fn side(&self, side: u32) -> u32 {
        ((f64::from(side) * self.scale).round() as u32).max(1)
    }

    /// What differs from the method's defaults, for people.
    pub fn text(&self) -> String {
        let base = Self::of(self.method);
        let mut parts = Vec::new();
        if let (Some(ms), Some(predicted)) = (self.budget_ms, self.predicted_cpu_ms) {
            parts.push(format!("--budget-ms {ms}, {predicted:.1} CPU ms predicted"));
        }
        parts.extend(self.point_size.map(|size| format!("{size} dots, eye-dome lighting")));
        if self.spacing_px != base.spacing_px {
            parts.push(format!("spacing {} px", self.spacing_px));
        }
        if self.budget_points != base.budget_points {
            parts.push(format!("{} points", short(self.budget_points)));
        }
        if self.scale != base.scale {
            parts.push(format!("{:.2} of the resolution", self.scale));
        }
        parts.extend(self.pass.map(String::from));
        if self.full {
            parts.push("full planes".into());
        }
        if !self.build.is_empty() {
            parts.push(format!("build {}", self.build));
        }
        if parts.is_empty() { "default".into() } else { parts.join(", ") }
    }
}

/// The setting of the common reference: EWA splatting.
pub(super) fn common() -> Setting {
    Setting::of("ewa")
}

/// A number of points in thousands or millions.
fn short(points: u64) -> String {
    if points >= 1_000_000 {
        format!("{}M", points as f64 / 1e6)
    } else {
        format!("{}k", points as f64 / 1e3)
    }
}

/// The settings of a file: one thing varied at a time, or, if `full`, methods, spacings and
/// resolutions crossed. `points` is the number of points of the file; `has_compact` tells whether
/// it has compact planes, `has_normals` whether normals.
pub(super) fn of_file(
    points: u64,
    (has_normals, has_compact, has_gpu): (bool, bool, bool),
    full: bool,
) -> Vec<Setting> {
    let points_lit = Setting { point_size: Some("adaptive"), ..Setting::of("points") };
    let methods = [
        Setting::of("points"),
        points_lit,
        Setting::of("pull-push"),
        Setting::of("auto"),
        Setting::of("ewa"),
    ];
    let mut all = methods.to_vec();
    let base = Setting::of("pull-push");
    let is_paced = |base: &&Setting| full || PACED.contains(&base.method);
    for base in methods.iter().filter(is_paced) {
        all.extend(SCALES.map(|scale| Setting { scale, ..base.clone() }));
    }
    if !full {
        let finer = |spacing_px| Setting { spacing_px, ..methods[4].clone() };
        all.extend(FINER_PX.map(finer));
    }
    let varied: &[Setting] = if full { &methods } else { std::slice::from_ref(&base) };
    for base in varied {
        all.extend(SPACINGS_PX.map(|spacing_px| Setting { spacing_px, ..base.clone() }));
        let budgets = BUDGETS.into_iter().filter(|&budget| budget < points);
        all.extend(budgets.map(|budget_points| Setting { budget_points, ..base.clone() }));
    }
    if full {
        for base in [&methods[2], &methods[4]] {
            let crossed = SPACINGS_PX.into_iter().flat_map(|spacing_px| {
                SCALES.map(|scale| Setting { spacing_px, scale, ..base.clone() })
            });
            all.extend(crossed);
        }
    }
    let mut passes = vec!["without averages", "without smoothing", DENSE, MATT];
    if !has_normals {
        passes.push("without fitted planes");
    }
    let spacing_px = |pass| if pass == DENSE { DENSE_PX } else { base.spacing_px };
    all.extend(passes.into_iter().map(|pass| Setting {
        pass: Some(pass),
        spacing_px: spacing_px(pass),
        ..base.clone()
    }));
    all.push(Setting { spacing_px: DENSE_PX, ..base.clone() });
    if has_compact {
        all.push(Setting { full: true, ..base.clone() });
    }
    if has_gpu {
        let on_gpu = all.iter().map(|setting| Setting { on_gpu: true, ..setting.clone() });
        all.extend(on_gpu.collect::<Vec<_>>());
    }
    all
}

/// Builds of a scan that are compared: their options on the command line, and the options
/// themselves.
pub(super) fn builds(options: &Options) -> Vec<(&'static str, Options)> {
    let with = |change: &dyn Fn(&mut Options)| {
        let mut options = options.clone();
        change(&mut options);
        options
    };
    vec![
        ("--normals none", with(&|o| o.normals = NormalsMode::None)),
        ("--normals estimate", with(&|o| o.normals = NormalsMode::Estimate)),
        ("--tangents", with(&|o| o.tangents = true)),
        ("--sharp-features", with(&|o| o.sharp_features = true)),
        ("--compact", with(&|o| o.compact = true)),
        ("--node-capacity 16384", with(&|o| o.node_capacity = 16_384)),
    ]
}

/// A build's settings of frames: pull-push and EWA with defaults.
pub(super) fn of_build(build: &'static str) -> Vec<Setting> {
    ["pull-push", "ewa"].map(|method| Setting { build, ..Setting::of(method) }).to_vec()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_that_users_have_are_options() {
        let size = [640, 400];
        let base = Setting::of("pull-push");
        let options = |setting: Setting| setting.options(size);
        assert_eq!(options(base.clone()).as_deref(), Some("--method pull-push"));
        let half = Setting { scale: 0.5, spacing_px: 2.0, ..base.clone() };
        let words = "--method pull-push --target-spacing 2 --size 320x200, enlarged";
        assert_eq!(options(half).as_deref(), Some(words));
        let few = Setting { budget_points: 300_000, build: "--tangents", ..Setting::of("ewa") };
        let words = "--method ewa --budget-points 300k (built with --tangents)";
        assert_eq!(options(few).as_deref(), Some(words));
        let paced = Setting { budget_ms: Some(16.0), ..base.clone() };
        assert_eq!(options(paced).as_deref(), Some("--budget-ms 16"));
        let matt = Setting { pass: Some(MATT), ..base.clone() };
        assert_eq!(options(matt).as_deref(), Some("--method pull-push --no-highlights"));
        assert_eq!(options(Setting { pass: Some(DENSE), ..base }), None);
    }
}
