//! Runs the passes of a frame on the CPU, as its plan lists them. The passes keep their memory from
//! frame to frame, since the first touch of fresh pages costs more than the passes that fill them.

use crate::error::RenderError;
use crate::ewa::Ewa;
use crate::frame::{Frame, Picture, Stats, ms};
use crate::inputs::camera::Camera;
use crate::inputs::lookup::{DrawList, Lookup};
use crate::pass::Pass;
use crate::passes::antialias::antialias;
use crate::passes::average::Averages;
use crate::passes::dots::Dots;
use crate::passes::exposure::ExposureGrid;
use crate::passes::fill_holes::fill_holes;
use crate::passes::fit_planes::FittedPlanes;
use crate::passes::gather::gather;
use crate::passes::project::{EMPTY, project};
use crate::passes::pull::pull;
use crate::passes::push::push_with;
use crate::passes::shade::shade;
use crate::passes::silhouette::trim_with;
use crate::passes::smooth_depth::{SmoothDepthScratch, smooth_depth};
use crate::passes::tangent::Lens;
use crate::picture::edges::edges as find_edges;
use crate::picture::margin::crop;
use crate::picture::marks::Marks;
use crate::picture::pyramid::{Planes, Pyramid};
use crate::plan::FramePlan;
use std::sync::atomic::AtomicU64;
use std::time::Instant;

/// Difference of depth over width above which neighbouring pixels show different surfaces.
pub(crate) const STEP_PX: f32 = 2.0;

/// Draws frames on the CPU and keeps its buffers between them.
#[derive(Default)]
pub struct Renderer {
    target: Vec<AtomicU64>,
    dots: Dots,
    fitted: FittedPlanes,
    averages: Averages,
    exposure: ExposureGrid,
    pyramid: Pyramid,
    smooth: SmoothDepthScratch,
    /// The renderer of splats and its options.
    pub ewa: Ewa,
    /// Scratch of [`trim_with`]: the source of each pixel.
    sources: Vec<u32>,
    /// The last picture with its margin.
    wide: Picture,
    /// Whether the last picture had a margin.
    has_margin: bool,
}

/// Draws one frame. To draw several, keep a [`Renderer`].
///
/// # Errors
/// If the size of the view is not supported or its camera is not usable.
pub fn render(frame: &Frame<'_>) -> Result<Picture, RenderError> {
    Renderer::default().render(frame)
}

impl Renderer {
    /// Draws a frame in the current rayon pool.
    ///
    /// # Errors
    /// If the size of the view is not supported or its camera is not usable.
    pub fn render(&mut self, frame: &Frame<'_>) -> Result<Picture, RenderError> {
        let mut picture = Picture::default();
        self.render_into(frame, &mut picture)?;
        Ok(picture)
    }

    /// Runs the passes before pull only, which fill level 0 of `pyramid`. For tests and figures
    /// that run the other passes themselves. Returns the number of valid pixels.
    ///
    /// # Errors
    /// If the size of the view is not supported or its camera is not usable.
    pub fn base_level(
        &mut self,
        frame: &Frame<'_>,
        pyramid: &mut Pyramid,
    ) -> Result<u64, RenderError> {
        let plan = FramePlan::new(frame);
        let camera = Camera::of(frame)?;
        let camera = camera.with_margin(plan.margin_px);
        let [width, height] = camera.size.map(|s| s as usize);
        self.target.resize_with(width * height, || AtomicU64::new(EMPTY));
        let list = DrawList::new(frame.draws);
        project(frame, &camera, &list, &self.target);
        let lookup = Lookup::new(frame, &camera, &list);
        if plan.mixes_dots() {
            self.dots.split(&lookup, &plan, &self.target);
        }
        pyramid.fit(width, height, plan.planes());
        pyramid.lens = Lens::new(&camera);
        let fitted = (plan.planes() == Planes::Fitted).then(|| {
            let levels = plan.plane_levels();
            self.fitted.fill(&self.target, width, camera.focal_px, plan.shares(), levels);
            &self.fitted
        });
        let valid = gather(&lookup, &self.target, fitted, &mut pyramid.levels[0]);
        if plan.averages() {
            let crowding = plan.crowding();
            self.averages.run(&lookup, &pyramid.lens, crowding, &mut pyramid.levels[0]);
        }
        if plan.evens_exposure() {
            self.exposure.run(&lookup, &self.target, &mut pyramid.levels[0]);
        }
        Ok(valid)
    }

    /// Draws a frame to `picture`, whose memory is reused.
    ///
    /// # Errors
    /// If the size of the view is not supported or its camera is not usable; `picture` is then
    /// unchanged.
    pub fn render_into(
        &mut self,
        frame: &Frame<'_>,
        picture: &mut Picture,
    ) -> Result<(), RenderError> {
        let camera = Camera::of(frame)?;
        let start = Instant::now();
        let plan = FramePlan::new(frame);
        let camera = camera.with_margin(plan.margin_px);
        self.has_margin = camera.margin_px > 0;
        if !self.has_margin {
            picture.stats = self.draw(frame, &plan, &camera, picture);
        } else {
            let mut wide = std::mem::take(&mut self.wide);
            let mut stats = self.draw(frame, &plan, &camera, &mut wide);
            let mut clock = Clock(Instant::now());
            stats.pixels_covered = crop(&wide, camera.margin_px, picture);
            stats.stages.add(Pass::Antialias, clock.lap());
            picture.stats = stats;
            self.wide = wide;
        }
        picture.stats.stages.total_ms = ms(start.elapsed());
        Ok(())
    }

    /// The last picture with its margin, if it had one.
    pub fn with_margin(&self) -> Option<&Picture> {
        self.has_margin.then_some(&self.wide)
    }

    /// Runs the passes of a plan. `camera` is that of the picture with its margin. Returns counts
    /// and times.
    fn draw(
        &mut self,
        frame: &Frame<'_>,
        plan: &FramePlan,
        camera: &Camera,
        picture: &mut Picture,
    ) -> Stats {
        let mut clock = Clock(Instant::now());
        let [width, height] = camera.size.map(|s| s as usize);
        [picture.width, picture.height] = camera.size;
        picture.rgba.resize(width * height * 4, 0);
        picture.depth.resize(width * height, 0.0);
        let list = DrawList::new(frame.draws);
        let mut stats = stats_of(&list, frame.draws.len());
        let pixels = if plan.passes.contains(&Pass::Project) { width * height } else { 0 };
        self.target.resize_with(pixels, || AtomicU64::new(EMPTY));
        let lookup = Lookup::new(frame, camera, &list);
        let Self {
            target, dots, fitted, averages, exposure, pyramid, smooth, sources, ewa, ..
        } = self;
        let planes = plan.planes();
        let is_splats = plan.passes.contains(&Pass::Blend);
        if plan.passes.contains(&Pass::Shade) && !is_splats {
            let levels = if plan.has_pyramid { usize::MAX } else { 1 };
            pyramid.fit_levels(width, height, planes, levels);
            pyramid.lens = Lens::new(camera);
        }
        let (mut edges, mut creases) = (Marks::default(), Marks::default());
        let mut has_edges = is_splats;
        for &pass in plan.passes.iter() {
            if pass.follows_push() && !std::mem::replace(&mut has_edges, true) {
                edges = edges_of_surface(plan, pyramid, &mut picture.depth);
            }
            match pass {
                Pass::Project => project(frame, camera, &list, target),
                Pass::Split | Pass::Grow | Pass::Overlay | Pass::Resolve | Pass::EyeDome => {
                    dots.run(pass, frame, plan, &lookup, target, (&mut *picture, &mut stats));
                }
                Pass::FitPlanes => {
                    let (shares, levels) = (plan.shares(), plan.plane_levels());
                    fitted.fill(target, width, camera.focal_px, shares, levels);
                }
                Pass::Gather => {
                    let fitted = (planes == Planes::Fitted).then_some(&*fitted);
                    let base = &mut pyramid.levels[0];
                    stats.pixels_projected += gather(&lookup, target, fitted, base);
                }
                Pass::Average => {
                    let base = &mut pyramid.levels[0];
                    averages.run(&lookup, &pyramid.lens, plan.crowding(), base);
                }
                Pass::Exposure => exposure.run(&lookup, target, &mut pyramid.levels[0]),
                Pass::Place => {
                    let fitted = plan.fits_planes().then_some(&*fitted);
                    let counts = ewa.place(frame, camera, &list, &lookup, plan, fitted);
                    (stats.splats_drawn, stats.splats_dropped) = (counts.drawn, counts.dropped);
                }
                Pass::Blend => {
                    let normals = plan.carries_normals;
                    stats.pixels_projected = ewa.draw(camera, normals, &mut picture.depth);
                    edges = find_edges(&picture.depth, width, STEP_PX / camera.focal_px);
                }
                Pass::Pull => pull(pyramid),
                Pass::Push => push_with(pyramid, plan.smoothing(), &mut picture.depth),
                Pass::FillHoles => {
                    let (base, focal_px) = (&mut pyramid.levels[0], pyramid.lens.focal_px);
                    fill_holes(base, &mut picture.depth, focal_px);
                }
                Pass::Silhouette => {
                    let (base, focal_px) = (&mut pyramid.levels[0], pyramid.lens.focal_px);
                    let depth = &mut picture.depth;
                    let trimmed = trim_with(sources, base, depth, &edges, focal_px);
                    edges = std::mem::take(&mut edges).or(&trimmed);
                }
                Pass::SmoothDepth if is_splats => {
                    smooth_depth(camera, &ewa.planes, &picture.depth, smooth);
                }
                Pass::SmoothDepth => smooth_depth(camera, pyramid, &picture.depth, smooth),
                Pass::Shade => {
                    if !plan.carries_normals && !plan.passes.contains(&Pass::SmoothDepth) {
                        smooth.keep(&picture.depth);
                    }
                    let (background, shines) = (frame.background, plan.shines);
                    let shaded = if is_splats {
                        shade(camera, &ewa.planes, background, shines, smooth, picture)
                    } else {
                        shade(camera, pyramid, background, shines, smooth, picture)
                    };
                    (stats.pixels_covered, creases) = (shaded.covered, shaded.creases);
                }
                Pass::Antialias => {
                    let (depth, focal_px) = (&picture.depth, camera.focal_px);
                    antialias(depth, width, focal_px, &edges, &creases, &mut picture.rgba);
                }
            }
            stats.stages.add(pass, clock.lap());
        }
        stats
    }
}

/// Counts of the points of a frame with `nodes` nodes.
fn stats_of(list: &DrawList, nodes: usize) -> Stats {
    Stats {
        points_drawn: u64::from(list.points()),
        nodes_drawn: (0..nodes).filter(|&node| list.len(node) > 0).count() as u32,
        ..Stats::default()
    }
}

/// Edges of the depth image after push. Writes the image if push has not.
fn edges_of_surface(plan: &FramePlan, pyramid: &Pyramid, depth: &mut [f32]) -> Marks {
    let (base, lens) = (&pyramid.levels[0], &pyramid.lens);
    if !plan.has_pyramid {
        base.depth_image(lens, depth);
    }
    find_edges(depth, base.width, STEP_PX / lens.focal_px)
}

/// Stopwatch that starts anew at each lap.
struct Clock(Instant);

impl Clock {
    /// Milliseconds since the last lap.
    fn lap(&mut self) -> f64 {
        let now = Instant::now();
        let lap = ms(now - self.0);
        self.0 = now;
        lap
    }
}
