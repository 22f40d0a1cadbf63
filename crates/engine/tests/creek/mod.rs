//! The project's sample scan in small nodes, and a camera that moves over it.

use esker_engine::calls::info;
use esker_engine::draw::session::Session;
use esker_lod::View;
use esker_points::task::Silent;
use glam::DVec3;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

pub const SIZE: [u32; 2] = [160, 120];

/// The project's sample scan in many small nodes; built once for all tests.
pub fn sample() -> &'static Path {
    static SAMPLE: OnceLock<PathBuf> = OnceLock::new();
    SAMPLE.get_or_init(|| {
        let scan = std::path::absolute("../../tests/sample/creek.laz").unwrap();
        let name = format!("{}-sample.esker", env!("CARGO_CRATE_NAME"));
        let out = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
        let options = esker_builder::Options { node_capacity: 2048, ..Default::default() };
        esker_builder::build(&[scan], &out, &options, &Silent).unwrap();
        out
    })
}

/// View of the whole scan, obliquely.
pub fn overview(session: &Session) -> View {
    let [low, high] = info::bounds(session.file()).map(DVec3::from_array);
    View::fit(low, high, DVec3::new(0.6, 0.5, -0.6), 1.0, SIZE[0], SIZE[1])
}

/// Views of a camera that moves at random, by a generator of its own.
pub struct Wanderer {
    state: u64,
    view: View,
    target: DVec3,
    low: DVec3,
    high: DVec3,
}

impl Wanderer {
    pub fn new(session: &Session, seed: u64) -> Self {
        let [low, high] = info::bounds(session.file()).map(DVec3::from_array);
        Self { state: seed, view: overview(session), target: low.midpoint(high), low, high }
    }

    fn dice(&mut self) -> f64 {
        self.state = self
            .state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.state >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Mostly a small step; sometimes a jump.
    pub fn next(&mut self) -> View {
        let mut place = [0.0; 6];
        place.iter_mut().for_each(|p| *p = self.dice());
        let extent = self.high - self.low;
        let somewhere = self.low + extent * DVec3::new(place[0], place[1], place[2]);
        let jump = self.dice() < 0.1;
        let share = if jump { 1.0 } else { 0.05 };
        self.target = self.target.lerp(somewhere, share);
        let height = extent.x * (0.02 + 0.5 * place[3] * place[3]);
        let aside = DVec3::new(place[4] - 0.5, place[5] - 0.5, 0.7) * height;
        let eye = self.view.eye.lerp(self.target + aside, share);
        self.view = View::look_at(eye, self.target, DVec3::Z, 1.0, SIZE[0], SIZE[1]);
        self.view
    }
}
