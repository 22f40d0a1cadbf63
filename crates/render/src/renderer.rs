//! The frame from first pass to last, and the memory that the passes keep from frame to frame (fresh
//! pages cost more than the passes that fill them). Projection first; then either the surface (gather,
//! pull, push, mend, trim, shade, soften) or the points as they are (resolve).

use crate::camera::Camera;
use crate::edges::edges;
use crate::error::RenderError;
use crate::frame::{Frame, Method, Picture, Stats, ms};
use crate::gather::{Lookup, gather};
use crate::mend::mend;
use crate::project::{DrawList, EMPTY, project};
use crate::pull::pull;
use crate::push::push;
use crate::pyramid::{Level, Pyramid};
use crate::relief::ReliefScratch;
use crate::resolve::resolve;
use crate::shade::shade;
use crate::soften::soften;
use crate::trim::trim;
use std::sync::atomic::AtomicU64;
use std::time::Instant;

/// Draws frames; keeps its buffers between them.
#[derive(Default)]
pub struct Renderer {
    target: Vec<AtomicU64>,
    pyramid: Pyramid,
    scratch: ReliefScratch,
}

/// Draws one frame. Who draws many keeps a [`Renderer`].
///
/// # Errors
/// Where the view is no usable camera.
pub fn render(frame: &Frame<'_>) -> Result<Picture, RenderError> {
    Renderer::default().render(frame)
}

impl Renderer {
    /// Draws a frame, in the current rayon pool.
    ///
    /// # Errors
    /// Where the view is no usable camera.
    pub fn render(&mut self, frame: &Frame<'_>) -> Result<Picture, RenderError> {
        let mut picture = Picture::default();
        self.render_into(frame, &mut picture)?;
        Ok(picture)
    }

    /// The passes before pull alone: fills the pyramid's level 0. Who looks into the passes (tests,
    /// figures) goes on from here. Returns the number of valid pixels.
    ///
    /// # Errors
    /// Where the view is no usable camera.
    pub fn base_level(
        &mut self,
        frame: &Frame<'_>,
        pyramid: &mut Pyramid,
    ) -> Result<u64, RenderError> {
        let camera = Camera::new(frame.view, frame.lattice)?;
        let [width, height] = camera.size.map(|s| s as usize);
        self.target.resize_with(width * height, || AtomicU64::new(EMPTY));
        let list = DrawList::new(frame.draws);
        project(frame, &camera, &list, &self.target);
        let lookup = Lookup::new(frame, &camera, &list);
        pyramid.fit(width, height, lookup.has_normals());
        Ok(gather(&lookup, &self.target, &mut pyramid.levels[0]))
    }

    /// Draws a frame over an earlier picture, whose memory is used again.
    ///
    /// # Errors
    /// Where the view is no usable camera; the picture is then as it was.
    pub fn render_into(
        &mut self,
        frame: &Frame<'_>,
        picture: &mut Picture,
    ) -> Result<(), RenderError> {
        let camera = Camera::new(frame.view, frame.lattice)?;
        let start = Instant::now();
        let [width, height] = camera.size.map(|s| s as usize);
        (picture.width, picture.height) = (frame.view.width, frame.view.height);
        picture.rgba.resize(width * height * 4, 0);
        picture.depth.resize(width * height, 0.0);
        self.target.resize_with(width * height, || AtomicU64::new(EMPTY));

        let list = DrawList::new(frame.draws);
        let mut stats = Stats {
            points_drawn: u64::from(list.points()),
            nodes_drawn: (0..frame.draws.len()).filter(|&d| list.len(d) > 0).count() as u32,
            ..Stats::default()
        };
        let mut clock = Clock(start);
        project(frame, &camera, &list, &self.target);
        stats.stages.project_ms = clock.lap();
        let lookup = Lookup::new(frame, &camera, &list);
        if frame.method == Method::Points {
            stats.pixels_covered = resolve(&lookup, &self.target, frame.background, picture);
            stats.pixels_projected = stats.pixels_covered;
            stats.stages.shade_ms = clock.lap();
        } else {
            self.pyramid.fit(width, height, lookup.has_normals());
            let base = &mut self.pyramid.levels[0];
            stats.pixels_projected = gather(&lookup, &self.target, base);
            stats.stages.gather_ms = clock.lap();
            pull(&mut self.pyramid);
            stats.stages.pull_ms = clock.lap();
            push(&mut self.pyramid);
            stats.stages.push_ms = clock.lap();
            let base = &mut self.pyramid.levels[0];
            let edges = mend_outlines(base, &mut picture.depth, camera.focal_px);
            stats.stages.mend_ms = clock.lap();
            let (pyramid, scratch) = (&self.pyramid, &mut self.scratch);
            let shaded = shade(&camera, pyramid, frame.background, scratch, picture);
            stats.pixels_covered = shaded.covered;
            stats.stages.shade_ms = clock.lap();
            soften(
                &picture.depth,
                width,
                camera.focal_px,
                &edges,
                &shaded.creases,
                &mut picture.rgba,
            );
            stats.stages.soften_ms = clock.lap();
        }
        stats.stages.total_ms = ms(start.elapsed());
        picture.stats = stats;
        Ok(())
    }
}

/// Closes gaps of the filled level and takes back what sticks out of its surfaces; fills `depth`. Returns the
/// pixels that may lie at an edge.
fn mend_outlines(base: &mut Level, depth: &mut [f32], focal_px: f32) -> Vec<usize> {
    /// A slope of two: less is a surface's own.
    const STEP_PX: f32 = 2.0;
    base.depth_image(depth);
    let mut edges = edges(depth, base.width, STEP_PX / focal_px);
    mend(base, depth, &edges, focal_px);
    edges.extend(trim(base, depth, &edges, focal_px));
    edges
}

/// Time since the last lap.
struct Clock(Instant);

impl Clock {
    fn lap(&mut self) -> f64 {
        let now = Instant::now();
        let lap = ms(now - self.0);
        self.0 = now;
        lap
    }
}
