//! The settings of the best picture within a time. Small pictures of the view are drawn and
//! measured, and correct the model of the machine ([`crate::draw::pace`]) for it: the model says
//! how time grows with pixels and points, the probe what this scan takes.

use crate::draw::method::Method;
use crate::draw::pace::{Cost, Load, Pace};
use crate::draw::probe::measured;
use crate::draw::scene::{PictureRequest, PictureScene, completed};
use anyhow::{Context, Result};
use esker_format::Forest;
use esker_points::Task;
use esker_render::PointSize;

/// Least scale of the picture's sides.
const SCALE_MIN: f64 = 0.28;
/// Scales that are tried, from the least to 1 in even steps.
const SCALES: u32 = 37;
/// Scale of the first probe.
const FIRST_PROBE: f64 = 0.25;
/// Scale of the last probe over that of the picture, at least, and of a next one: half of the
/// picture's pixels. From a quarter, times of EWA and of dots are off by up to half: splats become
/// wider, and surfaces dots.
const PROBE_SHARE: f64 = 0.65;
const PROBE_AGAIN: f64 = 0.71;
/// Most probes of a method.
const PROBES_MAX: usize = 4;
/// Frames of a probe that are measured.
const FRAMES: usize = 3;
/// Targets of EWA splatting, as shares of the wanted one, where there is time left. By pull-push
/// finer targets change pictures by less than their error, for up to three times the time.
const FINER: [f64; 2] = [0.7, 0.5];
/// Fewest points that a budget leaves.
const POINTS_MIN: u64 = 10_000;

/// What a budget of time decides.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Settings {
    method: Method,
    /// Side of the drawn picture over that of the wanted one.
    scale: f64,
    /// Target distance of points, pixels.
    spacing_px: f64,
    /// Most points.
    points_max: u64,
}

/// What a frame has, as far as that is known before it is drawn.
#[derive(Clone, Copy, Debug)]
struct Demand {
    points: f64,
    pixels: f64,
}

/// A picture that was drawn to be measured.
#[derive(Clone, Copy, Debug)]
struct Probe {
    load: Load,
    /// Median CPU time of a frame, milliseconds.
    cpu_ms: f64,
    /// CPU time of frames over their wall time.
    parallel: f64,
    /// Whether points are dots of a given size in pixels, so that a finer picture has more gaps.
    has_gaps: bool,
}

/// A view whose frames are predicted.
trait Subject {
    /// What a frame has.
    fn demand(&mut self, settings: &Settings) -> Result<Demand>;
    /// Draws and measures a picture.
    fn probe(&mut self, settings: &Settings) -> Result<Probe>;
}

/// Cost of the frames of a view by one method: that of the model, corrected by a probe.
#[derive(Clone, Copy, Debug)]
struct Corrected {
    cost: Cost,
    /// CPU time of the probe over that of the model.
    factor: f64,
    /// CPU time of frames over their wall time: at most that of the model, the
    /// median of all methods. Splats leave threads idle where few tiles have most of them.
    parallel: f64,
    probe: Probe,
}

impl Corrected {
    fn new(cost: Cost, pace: &Pace, probe: Probe) -> Self {
        let factor = probe.cpu_ms / cost.cpu_ms(probe.load).max(1e-6);
        let parallel = probe.parallel.min(pace.parallel).max(1e-3);
        Self { cost, factor, parallel, probe }
    }

    /// What a frame has. The share of covered pixels is that of the probe; dots of a given size in
    /// pixels overlap as those of random places do.
    fn load(&self, Demand { points, pixels }: Demand) -> Load {
        let Load { points: drawn, pixels: all, covered } = self.probe.load;
        let mut share = (covered / all.max(1.0)).min(1.0);
        if self.probe.has_gaps && share < 1.0 {
            // Dots at random leave exp(-area of all dots / area of the picture) empty.
            let dot_px = -(1.0 - share).ln() * all / drawn.max(1.0);
            share = 1.0 - (-dot_px * points / pixels.max(1.0)).exp();
        }
        Load { points, pixels, covered: share * pixels }
    }

    /// Times of a frame.
    fn frame(&self, demand: Demand) -> FrameTime {
        let cpu_ms = self.factor * self.cost.cpu_ms(self.load(demand));
        FrameTime { cpu_ms, wall_ms: cpu_ms / self.parallel }
    }
}

/// Predicted times of a frame, milliseconds.
#[derive(Clone, Copy, Debug)]
struct FrameTime {
    cpu_ms: f64,
    wall_ms: f64,
}

/// Settings and the times that are predicted for them.
type Predicted = (Settings, FrameTime);

/// Chooses settings whose frames take at most `budget_ms` of wall time, or the fastest. The second
/// value tells how far the probes were off the model: the last one's CPU time over the model's.
fn choose(
    subject: &mut dyn Subject,
    wanted: Settings,
    pace: &Pace,
    budget_ms: f64,
) -> Result<(Predicted, f64)> {
    let alone = Settings { method: Method::Points, ..wanted };
    let tried = if wanted.method == alone.method { vec![alone] } else { vec![wanted, alone] };
    let mut last = None;
    for settings in tried {
        let (corrected, finest) = finest(subject, settings, pace, budget_ms)?;
        if let Some(predicted) = finest {
            let known = (predicted, corrected.factor);
            return finer(subject, known, &corrected, (pace, budget_ms));
        }
        last = Some(corrected);
    }
    let corrected = last.context("no method to draw with")?;
    let mut fewer = Settings { scale: SCALE_MIN, ..alone };
    loop {
        let predicted = corrected.frame(subject.demand(&fewer)?);
        if predicted.wall_ms <= budget_ms || fewer.points_max <= POINTS_MIN {
            return Ok(((fewer, predicted), corrected.factor));
        }
        fewer.points_max = (fewer.points_max / 2).max(POINTS_MIN);
    }
}

/// The finest picture by a method whose frames take at most `budget_ms`, if one does. The view is
/// probed until the last probe has nearly half the pixels of that picture.
fn finest(
    subject: &mut dyn Subject,
    settings: Settings,
    pace: &Pace,
    budget_ms: f64,
) -> Result<(Corrected, Option<Predicted>)> {
    let cost = *pace
        .cost(settings.method)
        .context("a budget of time is for pictures by auto, pull-push, ewa or points")?;
    let mut scale = FIRST_PROBE;
    let mut probes = 0;
    loop {
        let probe = subject.probe(&Settings { scale, ..settings })?;
        let corrected = Corrected::new(cost, pace, probe);
        probes += 1;
        let finest = finest_of(subject, settings, &corrected, budget_ms)?;
        match finest {
            Some((Settings { scale: wanted, .. }, _))
                if scale < wanted * PROBE_SHARE && probes < PROBES_MAX =>
            {
                scale = wanted * PROBE_AGAIN;
            }
            _ => return Ok((corrected, finest)),
        }
    }
}

/// The same settings with a finer target, if they are of whole pictures by EWA splatting with the
/// default target and there is time for it.
fn finer(
    subject: &mut dyn Subject,
    known: (Predicted, f64),
    coarser: &Corrected,
    (pace, budget_ms): (&Pace, f64),
) -> Result<(Predicted, f64)> {
    let ((settings, _), _) = known;
    let is_open = settings.method == Method::Ewa
        && settings.scale == 1.0
        && settings.spacing_px == PictureRequest::default().target_spacing_px;
    let mut best = known;
    for share in FINER.into_iter().filter(|_| is_open) {
        let finer = Settings { spacing_px: settings.spacing_px * share, ..settings };
        // The whole picture is probed: where a finer target finds no more points, splats grow with
        // the picture, so a smaller one takes less time for each of them.
        let probe = subject.probe(&finer)?;
        let corrected = Corrected::new(coarser.cost, pace, probe);
        let predicted = corrected.frame(subject.demand(&finer)?);
        if predicted.wall_ms > budget_ms {
            break;
        }
        best = ((finer, predicted), corrected.factor);
    }
    Ok(best)
}

/// The finest picture whose predicted time is at most `budget_ms`, by bisection of the scales.
fn finest_of(
    subject: &mut dyn Subject,
    settings: Settings,
    corrected: &Corrected,
    budget_ms: f64,
) -> Result<Option<Predicted>> {
    let mut predicted = |step: u32| -> Result<Predicted> {
        let share = f64::from(step) / f64::from(SCALES - 1);
        let scale = SCALE_MIN + (1.0 - SCALE_MIN) * share;
        let settings = Settings { scale, ..settings };
        Ok((settings, corrected.frame(subject.demand(&settings)?)))
    };
    let whole = predicted(SCALES - 1)?;
    if whole.1.wall_ms <= budget_ms {
        return Ok(Some(whole));
    }
    let (mut low, mut high) = (0, SCALES - 1);
    let mut best = Some(predicted(low)?).filter(|(_, least)| least.wall_ms <= budget_ms);
    while best.is_some() && high - low > 1 {
        let middle = low.midpoint(high);
        let between = predicted(middle)?;
        if between.1.wall_ms <= budget_ms {
            (low, best) = (middle, Some(between));
        } else {
            high = middle;
        }
    }
    Ok(best)
}

/// The settings of the best picture within a time.
#[derive(Clone, Debug)]
pub struct Paced {
    /// The request with these settings, of a picture of `scale` times the size.
    pub request: PictureRequest,
    /// Side of the drawn picture over that of the wanted one.
    pub scale: f64,
    /// Predicted CPU time of a frame after the first one, milliseconds.
    pub cpu_ms: f64,
    /// Wall time that follows, milliseconds.
    pub wall_ms: f64,
    /// CPU time of the last probe over that of the model without a correction.
    pub correction: f64,
}

/// Chooses settings for a picture of `file` whose frames, after the first one, take at most
/// `budget_ms` of wall time: those of the request if there is time, by EWA splatting with a finer
/// target if the request has the default one, else a coarser resolution, then points alone, then
/// fewer points. If nothing is fast enough, the fastest.
///
/// # Errors
/// If the method was not measured, a picture cannot be drawn, or `task` is cancelled.
pub fn paced(
    file: &Forest,
    request: &PictureRequest,
    pace: &Pace,
    budget_ms: f64,
    task: &dyn Task,
) -> Result<Paced> {
    anyhow::ensure!(request.window.is_none(), "a budget of time is for whole pictures");
    let wanted = Settings {
        method: request.method,
        scale: 1.0,
        spacing_px: request.target_spacing_px,
        points_max: request.budget_points.min(file.points()),
    };
    let mut view = ViewOfFile { file, request, task };
    let ((settings, predicted), correction) = choose(&mut view, wanted, pace, budget_ms)?;
    let FrameTime { cpu_ms, wall_ms } = predicted;
    let mut request = view.request(&settings);
    if settings.points_max == wanted.points_max {
        request.budget_points = view.request.budget_points;
    }
    Ok(Paced { request, scale: settings.scale, cpu_ms, wall_ms, correction })
}

/// The view of a request on a file.
struct ViewOfFile<'a> {
    file: &'a Forest,
    request: &'a PictureRequest,
    task: &'a dyn Task,
}

impl ViewOfFile<'_> {
    /// The request with other settings.
    fn request(&self, settings: &Settings) -> PictureRequest {
        let side = |side: u32| ((f64::from(side) * settings.scale).round() as u32).max(1);
        PictureRequest {
            size: self.request.size.map(side),
            method: settings.method,
            target_spacing_px: settings.spacing_px,
            budget_points: settings.points_max,
            ..self.request.clone()
        }
    }
}

impl Subject for ViewOfFile<'_> {
    fn demand(&mut self, settings: &Settings) -> Result<Demand> {
        let request = self.request(settings);
        let grown = completed(self.file, &request, self.task)?;
        let scene = PictureScene::choose(grown.as_ref().unwrap_or(self.file), &request)?;
        let pixels = f64::from(scene.view.width) * f64::from(scene.view.height);
        Ok(Demand { points: scene.selection.counters.points as f64, pixels })
    }

    fn probe(&mut self, settings: &Settings) -> Result<Probe> {
        let request = self.request(settings);
        let measured = measured(self.file, &request, FRAMES, self.task)?;
        let cpu_ms = measured.cpu_ms.get(FRAMES / 2).copied().unwrap_or_default();
        let has_gaps =
            settings.method == Method::Points && matches!(request.dots.size, PointSize::Pixels(_));
        Ok(Probe { load: measured.load, cpu_ms, parallel: measured.parallel, has_gaps })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::draw::method::METHODS;

    /// A view of 640 x 400 pixels and 2 points a pixel, at most 500,000, whose frames take `factor`
    /// times what the model says, on one thread.
    struct Invented {
        truth: Cost,
        factor: f64,
        share: f64,
        parallel: f64,
        probes: Vec<f64>,
    }

    impl Invented {
        fn new(factor: f64, share: f64) -> Self {
            Self { truth: COST, factor, share, parallel: 1.0, probes: Vec::new() }
        }

        fn cpu_ms(&mut self, settings: &Settings) -> f64 {
            let Demand { points, pixels } = self.demand(settings).unwrap();
            let truth = if settings.method == Method::Points { CHEAP } else { self.truth };
            self.factor * truth.cpu_ms(Load { points, pixels, covered: self.share * pixels })
        }
    }

    impl Subject for Invented {
        fn demand(&mut self, settings: &Settings) -> Result<Demand> {
            let pixels = 640.0 * 400.0 * settings.scale * settings.scale;
            let points = 2.0 * pixels / settings.spacing_px.powi(2);
            Ok(Demand { points: points.min(settings.points_max as f64), pixels })
        }

        fn probe(&mut self, settings: &Settings) -> Result<Probe> {
            self.probes.push(settings.scale);
            let Demand { points, pixels } = self.demand(settings)?;
            let load = Load { points, pixels, covered: self.share * pixels };
            let cpu_ms = self.cpu_ms(settings);
            Ok(Probe { load, cpu_ms, parallel: self.parallel, has_gaps: false })
        }
    }

    const COST: Cost = Cost { frame_ms: 0.2, points_ms: 10.0, pixels_ms: 20.0, covered_ms: 160.0 };
    const CHEAP: Cost = Cost { frame_ms: 0.1, points_ms: 2.0, pixels_ms: 1.0, covered_ms: 20.0 };
    const WANTED: Settings =
        Settings { method: Method::Auto, scale: 1.0, spacing_px: 1.0, points_max: 500_000 };

    fn pace() -> Pace {
        let costs = METHODS.map(|(method, name, _)| {
            (name.to_owned(), if method == Method::Points { CHEAP } else { COST })
        });
        Pace { threads: 2, parallel: 2.0, waited: 0.0, costs: costs.to_vec() }
    }

    #[test]
    fn the_chosen_picture_takes_nearly_the_time_whatever_the_scan_costs() {
        for factor in [0.5, 1.0, 2.0] {
            for share in [0.05, 0.4, 1.0] {
                for budget_ms in [16.0, 32.0, 64.0] {
                    let mut view = Invented::new(factor, share);
                    let ((settings, predicted), correction) =
                        choose(&mut view, WANTED, &pace(), budget_ms).unwrap();
                    let real_ms = view.cpu_ms(&settings);
                    assert!((predicted.wall_ms / real_ms - 1.0).abs() < 1e-6, "{settings:?}");
                    assert!((correction / factor - 1.0).abs() < 1e-6);
                    let finer = Settings { scale: settings.scale + 0.021, ..settings };
                    assert!(real_ms <= budget_ms, "{settings:?}");
                    assert!(settings.scale == 1.0 || view.cpu_ms(&finer) > budget_ms);
                    assert_eq!(settings.method, Method::Auto);
                }
            }
        }
    }

    #[test]
    fn wall_time_follows_the_threads_that_the_view_uses_and_at_most_those_of_the_model() {
        for (own, used) in [(1.4, 1.4), (1.9, 1.9), (7.0, 2.0), (0.0, 1e-3)] {
            let mut view = Invented { parallel: own, ..Invented::new(1.0, 1.0) };
            let ((settings, predicted), _) = choose(&mut view, WANTED, &pace(), 20.0).unwrap();
            assert!((predicted.cpu_ms / view.cpu_ms(&settings) - 1.0).abs() < 1e-6);
            assert!((predicted.cpu_ms / predicted.wall_ms / used - 1.0).abs() < 1e-6);
            assert!(predicted.wall_ms <= 20.0 || used < 0.1, "{predicted:?}");
        }
    }

    /// The scan costs otherwise than the model: a probe of half the pixels bounds the error.
    #[test]
    fn a_view_whose_time_grows_otherwise_than_the_model_is_probed_again() {
        let mut view = Invented::new(1.0, 0.3);
        view.truth = Cost { frame_ms: 1.0, pixels_ms: 60.0, ..COST };
        let ((settings, predicted), _) = choose(&mut view, WANTED, &pace(), 16.0).unwrap();
        assert!(view.probes.len() > 1, "{:?}", view.probes);
        assert!(*view.probes.last().unwrap() >= PROBE_SHARE * settings.scale);
        assert!(view.probes.iter().all(|scale| *scale <= settings.scale), "probes are small");
        let off = predicted.wall_ms / view.cpu_ms(&settings);
        assert!((off - 1.0).abs() < 0.2, "{off}");
        let first = view.probe(&Settings { scale: FIRST_PROBE, ..WANTED }).unwrap();
        let demand = view.demand(&settings).unwrap();
        let by_first =
            Corrected::new(COST, &pace(), first).frame(demand).cpu_ms / view.cpu_ms(&settings);
        assert!(by_first > off, "the first probe alone is farther off: {by_first}");
    }

    #[test]
    fn points_alone_and_then_fewer_are_drawn_where_nothing_else_is_fast_enough() {
        let mut view = Invented::new(1.0, 1.0);
        let ((slow, _), _) = choose(&mut view, WANTED, &pace(), 1.0).unwrap();
        assert_eq!((slow.method, slow.points_max), (Method::Points, WANTED.points_max));
        let ((least, predicted), _) = choose(&mut view, WANTED, &pace(), 1e-3).unwrap();
        assert_eq!((least.scale, least.points_max), (SCALE_MIN, POINTS_MIN));
        assert!(predicted.wall_ms > 1e-3, "the fastest is still too slow");
    }

    #[test]
    fn ewa_takes_a_finer_target_where_there_is_time_and_the_request_names_none() {
        let ewa = Settings { method: Method::Ewa, points_max: u64::MAX, ..WANTED };
        let mut view = Invented::new(1.0, 1.0);
        let chosen = |view: &mut Invented, settings: Settings, budget_ms: f64| {
            let ((settings, predicted), _) = choose(view, settings, &pace(), budget_ms).unwrap();
            assert!((predicted.wall_ms / view.cpu_ms(&settings) - 1.0).abs() < 1e-6);
            settings
        };
        let whole_ms = view.cpu_ms(&ewa);
        let half_ms = view.cpu_ms(&Settings { spacing_px: 0.5, ..ewa });
        let finer = |view: &mut Invented, budget_ms| chosen(view, ewa, budget_ms).spacing_px;
        assert_eq!(finer(&mut view, whole_ms * 1.01), 1.0);
        assert_eq!(finer(&mut view, whole_ms.midpoint(half_ms)), FINER[0]);
        assert_eq!(finer(&mut view, half_ms * 1.01), 0.5);
        let own = Settings { spacing_px: 2.0, ..ewa };
        assert_eq!(chosen(&mut view, own, half_ms).spacing_px, 2.0);
        let pull_push = Settings { method: Method::PullPush, ..ewa };
        assert_eq!(chosen(&mut view, pull_push, half_ms).spacing_px, 1.0);
    }

    #[test]
    fn dots_of_a_given_size_leave_more_gaps_in_a_finer_picture() {
        let load = Load { points: 1e4, pixels: 1e4, covered: 1e4 * (1.0 - (-1.0f64).exp()) };
        let probe = Probe { load, cpu_ms: 1.0, parallel: 1.0, has_gaps: true };
        let corrected = Corrected::new(COST, &pace(), probe);
        let finer = corrected.load(Demand { points: 1e4, pixels: 4e4 });
        assert!((finer.covered / 4e4 - (1.0 - (-0.25f64).exp())).abs() < 1e-9, "{finer:?}");
        let surfaces = Corrected::new(COST, &pace(), Probe { has_gaps: false, ..probe });
        let finer = surfaces.load(Demand { points: 1e4, pixels: 4e4 });
        assert!((finer.covered / 4e4 - load.covered / load.pixels).abs() < 1e-9);
    }
}
