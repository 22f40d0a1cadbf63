//! The report of the benchmark of light, and its tables for people.

use super::error::Error;
use esker_engine::io::quantity::grouped;
use serde::Serialize;
use std::path::PathBuf;

/// What was measured.
#[derive(Clone, Debug, Serialize)]
pub struct TraceBenchReport {
    /// Threads of the tracer.
    pub(super) threads: usize,
    /// Width and height of the pictures, pixels.
    pub(super) size: [u32; 2],
    /// Samples of each of the two references.
    pub(super) reference_samples: u32,
    /// Bounces of the pictures whose error is measured.
    pub(super) reference_bounces: u32,
    /// The scenes.
    pub(super) scenes: Vec<SceneRow>,
    /// A row for each picture.
    pub(super) rows: Vec<TraceRow>,
    /// Pictures of a moving lamp, a moving object and a mesh that deforms.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(super) moving: Vec<MovingRow>,
    /// Figures that were written.
    pub(super) figures: Vec<PathBuf>,
}

/// A scene.
#[derive(Clone, Debug, Serialize)]
pub(super) struct SceneRow {
    pub scene: String,
    pub is_scan: bool,
    /// Triangles or splats.
    pub surfaces: usize,
    /// Building of the tree, milliseconds.
    pub build_ms: f64,
    /// Share of the bounce rays that hit the surface that they left, at the references' bounces.
    pub self_hits: f64,
    /// Share of the bounce rays that hit nothing: the sky, or a leak of a closed scene.
    pub escaped: f64,
    /// What the surroundings of the picture add, of scans.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub surroundings: Option<Surroundings>,
}

/// Indirect light with a part of a scan, over that with all of its points.
#[derive(Clone, Copy, Debug, Serialize)]
pub(super) struct Surroundings {
    /// Points in the picture, with those around it, and of the whole scan.
    pub points: [usize; 3],
    /// Mean indirect light with the points in the picture alone.
    pub alone: f64,
    /// With those around it too.
    pub around: f64,
}

/// A picture of the moving scene.
#[derive(Clone, Copy, Debug, Serialize)]
pub(super) struct MovingRow {
    /// Moving an object of its own tree, milliseconds.
    pub move_ms: f64,
    /// Fitting the tree of the mesh that deforms, milliseconds.
    pub refit_ms: f64,
    /// Building the tree of that mesh anew, milliseconds.
    pub rebuild_ms: f64,
    /// Tracing, milliseconds.
    pub trace_ms: f64,
    /// Tracing with the tree built anew, milliseconds.
    pub rebuilt_trace_ms: f64,
    /// Share of the pixels that are the same as with the tree built anew.
    pub equal: f64,
}

/// Weights of a baseline: standard deviations.
#[derive(Clone, Copy, Debug, Serialize)]
pub(super) struct Weights {
    /// Of normals, in half their unit.
    pub normal: f32,
    /// Of depth, in diagonals of the scene.
    pub depth: f32,
    /// Of colours, in means of the picture; none without weights by colour.
    pub colour: Option<f32>,
}

/// What a row is part of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Part {
    /// Whole frames by bounces and samples (table 1 of `bauszat2011`).
    Frames,
    /// Times of filters (table 2).
    Filters,
    /// Errors of filters (figure 8).
    Errors,
    /// Least errors of the baselines with other weights than their own.
    Sweep,
    /// Errors against the number of samples.
    Convergence,
    /// A scene that shows what the filter blurs.
    Limits,
    /// A lamp, an object and a mesh that move.
    Moving,
}

impl Part {
    /// All parts, with the names of `--parts`.
    const NAMES: [(Self, &str); 7] = [
        (Self::Frames, "frames"),
        (Self::Filters, "filters"),
        (Self::Errors, "errors"),
        (Self::Sweep, "sweep"),
        (Self::Convergence, "convergence"),
        (Self::Limits, "limits"),
        (Self::Moving, "moving"),
    ];

    /// The part of this name.
    ///
    /// # Errors
    /// If there is none; the message has the names.
    pub fn parse(name: &str) -> Result<Self, String> {
        let found = Self::NAMES.iter().find(|(_, known)| *known == name);
        let names = Self::NAMES.map(|(_, known)| known).join(", ");
        found.map(|(part, _)| *part).ok_or_else(|| format!("parts are {names}"))
    }
}

/// One picture.
#[derive(Clone, Debug, Serialize)]
pub(super) struct TraceRow {
    pub part: Part,
    pub scene: String,
    /// `cpu` or `gpu`.
    pub backend: &'static str,
    pub bounces: u32,
    pub samples: u32,
    /// `z-order` or `independent`.
    pub sequence: &'static str,
    pub filter: &'static str,
    /// Radius of the windows, pixels; none for filters that have their own.
    pub radius: Option<usize>,
    /// Passes of a-trous.
    pub iterations: Option<usize>,
    /// Weights of swept baselines.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub weights: Option<Weights>,
    /// Planes of the guides.
    pub channels: usize,
    /// Mean square error on a scale of 255 where light has a mean of 0.3; none without a reference.
    pub mse: Option<f64>,
    /// Error that 99.9 % of the pixels do not exceed.
    pub p999: Option<f64>,
    /// Error of the worst pixel.
    pub worst: Option<f64>,
    /// Mean of the picture over that of the reference.
    pub mean_ratio: Option<f64>,
    pub trace_ms: f64,
    pub filter_ms: f64,
    pub total_ms: f64,
    /// Rays of all kinds over the time of tracing.
    pub mrays_per_s: f64,
}

impl TraceRow {
    /// The same row with an error.
    pub fn with_error(mut self, error: Error) -> Self {
        self.mse = Some(error.mse);
        self.p999 = Some(error.p999);
        self.worst = Some(error.worst);
        self.mean_ratio = Some(error.mean_ratio);
        self
    }

    /// The filter with its radius, passes and guides.
    fn setting(&self) -> String {
        let mut name = self.filter.to_owned();
        name.extend(self.radius.map(|radius| format!(" r{radius}")));
        name.extend(self.iterations.map(|passes| format!(" x{passes}")));
        if let Some(Weights { normal, depth, colour }) = self.weights {
            name += &format!(" n{normal} d{depth}");
            name.extend(colour.map(|colour| format!(" c{colour}")));
        }
        if self.channels != 4 {
            name += &format!(", {} channel", self.channels);
        }
        name
    }
}

/// Writes the report for people: scenes, frames, filters, errors.
pub fn text(report: &TraceBenchReport) -> String {
    let mut lines = vec![format!(
        "{}x{} pixels, {} threads; errors at {} bounces against two references of {} samples",
        report.size[0],
        report.size[1],
        report.threads,
        report.reference_bounces,
        report.reference_samples,
    )];
    lines.push(format!(
        "\n{:<10} {:>11} {:>10} {:>10} {:>10}",
        "scene", "surfaces", "build ms", "self-hits", "escaped"
    ));
    for row in &report.scenes {
        lines.push(format!(
            "{:<10} {:>11} {:>10.0} {:>8.3} % {:>8.3} %",
            row.scene,
            grouped(row.surfaces as u64),
            row.build_ms,
            row.self_hits * 100.0,
            row.escaped * 100.0,
        ));
    }
    for SceneRow { scene, surroundings, .. } in &report.scenes {
        lines.extend(surroundings.map(|s| {
            format!(
                "{scene}: with {} points in the picture {:.2} % of the indirect light with all {}, \
                 with {} in it and around it {:.2} %",
                grouped(s.points[0] as u64),
                s.alone * 100.0,
                grouped(s.points[2] as u64),
                grouped(s.points[1] as u64),
                s.around * 100.0,
            )
        }));
    }
    for (part, title) in [
        (Part::Frames, "whole frames (table 1 of bauszat2011)"),
        (Part::Filters, "times of filters (table 2)"),
        (Part::Errors, "errors of filters (figure 8)"),
        (Part::Sweep, "baselines with the best of other weights"),
        (Part::Convergence, "errors against samples"),
        (Part::Limits, "light that the filter blurs"),
    ] {
        let rows: Vec<_> = report.rows.iter().filter(|row| row.part == part).collect();
        if !rows.is_empty() {
            lines.push(format!("\n{title}\n{}", head()));
            lines.extend(rows.into_iter().map(line));
        }
    }
    lines.extend(moving(&report.moving));
    lines.extend(report.figures.iter().map(|path| format!("wrote {}", path.display())));
    lines.join("\n")
}

/// Lines of the moving scene.
fn moving(rows: &[MovingRow]) -> Vec<String> {
    let mut lines = Vec::new();
    if !rows.is_empty() {
        lines.push(format!(
            "\na moving scene\n{:>8} {:>9} {:>10} {:>9} {:>17} {:>8}",
            "move ms", "refit ms", "rebuild ms", "trace ms", "trace rebuilt ms", "equal"
        ));
    }
    lines.extend(rows.iter().map(|row| {
        format!(
            "{:>8.3} {:>9.1} {:>10.1} {:>9.1} {:>17.1} {:>6.2} %",
            row.move_ms,
            row.refit_ms,
            row.rebuild_ms,
            row.trace_ms,
            row.rebuilt_trace_ms,
            row.equal * 100.0
        )
    }));
    lines
}

fn head() -> String {
    format!(
        "{:<10} {:>7} {:>7} {:<11} {:<32} {:>10} {:>8} {:>8} {:>7} {:>9} {:>9} {:>9} {:>8}",
        "scene",
        "bounces",
        "samples",
        "sequence",
        "filter",
        "mse",
        "99.9 %",
        "worst",
        "mean",
        "trace ms",
        "filter ms",
        "total ms",
        "Mrays/s"
    )
}

fn line(row: &TraceRow) -> String {
    let number = |value: Option<f64>, digits: usize| {
        value.map_or("-".to_owned(), |value| format!("{value:.digits$}"))
    };
    format!(
        "{:<10} {:>7} {:>7} {:<11} {:<32} {:>10} {:>8} {:>8} {:>7} {:>9.1} {:>9.1} {:>9.1} {:>8.2}",
        row.scene,
        row.bounces,
        row.samples,
        row.sequence,
        row.setting(),
        number(row.mse, 2),
        number(row.p999, 1),
        number(row.worst, 1),
        number(row.mean_ratio, 4),
        row.trace_ms,
        row.filter_ms,
        row.total_ms,
        row.mrays_per_s,
    )
}
