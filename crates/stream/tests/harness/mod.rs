//! Test harness: a small file on a faulty disk, streamed into a stand-in for a GPU that checks the
//! invariants in every frame.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a test fails by panicking")]
#![allow(dead_code, reason = "each test file uses its own part")]

pub mod disk;
pub mod gpu;
pub mod hills;
pub mod random;

pub use disk::{Disk, Faults};
pub use gpu::{Gpu, GpuOptions};
pub use random::Random;

use esker_format::{EskerFile, Forest};
use esker_lod::View;
use esker_stream::{Needs, Options, Streamer};
use glam::DVec3;
use std::path::Path;
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

/// The bytes of the file that all tests read: hills of 150,000 points in nodes of 1,000.
pub fn hills_bytes() -> &'static Arc<Vec<u8>> {
    static BYTES: OnceLock<Arc<Vec<u8>>> = OnceLock::new();
    BYTES.get_or_init(|| Arc::new(hills::file(150_000, 1000)))
}

/// The bytes of the files of a forest: those hills, and two sparser scans of the same place without
/// colours.
pub fn forest_bytes() -> &'static [Arc<Vec<u8>>] {
    static BYTES: OnceLock<Vec<Arc<Vec<u8>>>> = OnceLock::new();
    BYTES.get_or_init(|| {
        let bare = |seed, points| Arc::new(hills::bare_file(seed, points, 1000));
        vec![Arc::clone(hills_bytes()), bare(8, 60_000), bare(9, 700)]
    })
}

/// A streamer, the stand-in that it lands in, and the disk that it reads from.
pub struct Harness {
    pub forest: Arc<Forest>,
    pub faults: Arc<Faults>,
    pub gpu: Gpu,
    pub streamer: Streamer,
}

impl Harness {
    pub fn new(gpu_options: GpuOptions, options: Options, needs: Needs) -> Self {
        Self::of(std::slice::from_ref(hills_bytes()), gpu_options, options, needs)
    }

    /// Opens files whose trees belong together; all are on one disk.
    pub fn of(
        files: &[Arc<Vec<u8>>],
        gpu_options: GpuOptions,
        options: Options,
        needs: Needs,
    ) -> Self {
        let faults = Arc::new(Faults::default());
        let open = |(i, bytes): (usize, &Arc<Vec<u8>>)| {
            let disk = Disk { bytes: Arc::clone(bytes), faults: Arc::clone(&faults) };
            EskerFile::from_source(Path::new(&format!("hills-{i}")), Box::new(disk)).unwrap()
        };
        let mut files = files.iter().enumerate().map(open);
        let forest = Arc::new(Forest::of(files.next().unwrap(), files.collect()).unwrap());
        let gpu = Gpu::new(gpu_options, options.drawing_bytes, Arc::clone(&forest));
        let streamer =
            Streamer::start(Arc::clone(&forest), Arc::clone(&gpu.landing), options, needs).unwrap();
        Self { forest, faults, gpu, streamer }
    }

    /// Draws one frame.
    pub fn frame(&mut self) -> Arc<esker_stream::Cut> {
        self.gpu.frame(&self.streamer)
    }

    /// Draws frames until `done`; fails after a minute.
    pub fn until(&mut self, what: &str, done: impl Fn(&esker_stream::Cut, &Self) -> bool) {
        let began = Instant::now();
        loop {
            let cut = self.frame();
            if done(&cut, self) {
                return;
            }
            let status = self.streamer.status();
            assert!(began.elapsed() < Duration::from_secs(60), "{what}: {status:?}");
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    /// Sets the view and draws frames until its cut is settled.
    pub fn settle(&mut self, view: View) -> Arc<esker_stream::Cut> {
        self.streamer.look(view);
        self.until("settles", |cut, _| cut.view == view && cut.settled);
        self.streamer.cut()
    }

    /// A view from above, from a height, towards a place, all in shares of the hills' edge.
    pub fn view(&self, x: f64, y: f64, height: f64) -> View {
        view(&self.forest, [x, y, height], [x + 0.05, y + 0.3, 0.0])
    }
}

/// A view from one place to another, in shares of the edge of the root's cell.
pub fn view(forest: &Forest, from: [f64; 3], to: [f64; 3]) -> View {
    let lattice = forest.lattice();
    let cell = forest.table().nodes[0].cell();
    let corner = DVec3::from_array(lattice.world(cell.corner));
    let edge = DVec3::from_array(lattice.world(cell.last())) - corner;
    let at = |share: [f64; 3]| corner + edge * DVec3::from_array(share);
    View::look_at(at(from), at(to), DVec3::Z, 1.0, 400, 300)
}
