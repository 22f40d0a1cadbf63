//! Counts of rays and of what went wrong, and times of passes. Each band of the picture counts for
//! itself; the sums do not depend on the number of threads.

use std::ops::AddAssign;

/// Counts and times of a [`crate::Tracer`] since its picture was begun.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Stats {
    /// Rays from the eye, guide rays among them.
    pub eye_rays: u64,
    /// Rays from surfaces that look for other surfaces.
    pub bounce_rays: u64,
    /// Rays from surfaces to lights.
    pub shadow_rays: u64,
    /// Bounce rays that hit the surface that they left: a hit within four lifts of their start
    /// ([`crate::Hit::lift`]) whose normal, as it is stored, is within 60 degrees of that of the
    /// start. Splats without a normal are not counted.
    pub self_hits: u64,
    /// Bounce rays that hit nothing. In a closed scene these leaked through its surface.
    pub escaped: u64,
    /// Samples for which no guide of the neighbouring pixels fits (`bauszat2011`, figure 3b): their
    /// indirect light was traced afresh.
    pub without_guide: u64,
    /// Milliseconds of guide rays.
    pub guide_ms: f64,
    /// Milliseconds of indirect light.
    pub indirect_ms: f64,
    /// Milliseconds of the filter and of its mix, last picture.
    pub filter_ms: f64,
    /// Milliseconds of the other eye rays and of direct light.
    pub direct_ms: f64,
    /// Milliseconds of the combination of the picture, last picture.
    pub resolve_ms: f64,
}

impl Stats {
    /// All rays.
    pub fn rays(&self) -> u64 {
        self.eye_rays + self.bounce_rays + self.shadow_rays
    }
}

impl AddAssign for Stats {
    fn add_assign(&mut self, other: Self) {
        self.eye_rays += other.eye_rays;
        self.bounce_rays += other.bounce_rays;
        self.shadow_rays += other.shadow_rays;
        self.self_hits += other.self_hits;
        self.escaped += other.escaped;
        self.without_guide += other.without_guide;
        self.guide_ms += other.guide_ms;
        self.indirect_ms += other.indirect_ms;
        self.filter_ms += other.filter_ms;
        self.direct_ms += other.direct_ms;
        self.resolve_ms += other.resolve_ms;
    }
}
