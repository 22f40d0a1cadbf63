//! Random camera flights under tight budgets, with faulty disks and slow landings. In each frame
//! the stand-in for the GPU checks the invariants, and the streamer must stop in any state. Each of
//! the eight flights takes `ESKER_FLIGHT_SECONDS` (2 by default). Ten minutes in all, and a run
//! under the thread sanitizer (nightly, with rust-src):
//!
//! ```sh
//! ESKER_FLIGHT_SECONDS=75 \
//!     cargo test --release -p esker-stream --test flight -- --test-threads 1
//! RUSTFLAGS="-Zsanitizer=thread" cargo +nightly test --release -Zbuild-std \
//!     --target x86_64-unknown-linux-gnu -p esker-stream --tests -- --test-threads 1
//! ```

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod harness;

use esker_format::PlaneKind;
use esker_lod::View;
use esker_stream::{Needs, Options, Priority};
use harness::{GpuOptions, Harness, Random, view};
use std::sync::atomic::Ordering::SeqCst;
use std::time::{Duration, Instant};

fn seconds() -> f64 {
    let given = std::env::var("ESKER_FLIGHT_SECONDS").ok();
    given.map_or(2.0, |s| s.parse().expect("ESKER_FLIGHT_SECONDS is a number"))
}

fn needs() -> Needs {
    Needs { colour: Some(PlaneKind::Colour), normals: true, ..Needs::default() }
}

/// About a tenth of the file.
fn tight() -> Options {
    Options { drawing_bytes: 700 << 10, page_bytes: 128 << 10, ..Options::default() }
}

/// A camera that glides from one random position to another, and sometimes jumps.
struct Camera {
    random: Random,
    at: [f64; 3],
    goal: [f64; 3],
    left: u32,
}

impl Camera {
    fn new(seed: u64) -> Self {
        Self { random: Random(seed), at: [0.5, 0.5, 1.0], goal: [0.5; 3], left: 0 }
    }

    fn next(&mut self, harness: &Harness) -> View {
        if self.left == 0 {
            self.left = 20 + self.random.below(200);
            let height = 0.06 + self.random.unit().powi(3);
            self.goal = [self.random.unit(), self.random.unit(), height];
            if self.random.below(4) == 0 {
                self.at = self.goal;
            }
        }
        self.left -= 1;
        for i in 0..3 {
            self.at[i] += (self.goal[i] - self.at[i]) * 0.02;
        }
        let [x, y, _] = self.at;
        let turn = f64::from(self.left) * 0.02;
        view(&harness.forest, self.at, [x + turn.sin() * 0.2, y + turn.cos() * 0.2, 0.0])
    }
}

/// Flies; calls `event` in each frame with the share of the flight that is over.
fn fly(harness: &mut Harness, seed: u64, mut event: impl FnMut(&mut Harness, f64)) {
    let (began, length) = (Instant::now(), seconds());
    let mut camera = Camera::new(seed);
    loop {
        let share = began.elapsed().as_secs_f64() / length;
        if share >= 1.0 {
            return;
        }
        event(harness, share);
        harness.streamer.look(camera.next(harness));
        harness.frame();
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// Stops the streamer; fails if that takes long.
fn stop(harness: Harness) {
    let began = Instant::now();
    harness.streamer.stop();
    assert!(began.elapsed() < Duration::from_secs(5), "{:?}", began.elapsed());
}

fn settles_in_the_end(harness: &mut Harness) {
    let cut = harness.settle(harness.view(0.3, 0.2, 0.12));
    assert!(!cut.nodes.is_empty());
    assert!(cut.complete, "{:?} {:?}", cut.counters, harness.streamer.status());
}

#[test]
fn a_healthy_flight() {
    for priority in [Priority::Distance, Priority::ErrorPerByte] {
        let mut harness =
            Harness::new(GpuOptions::default(), Options { priority, ..tight() }, needs());
        harness.faults.delay_us.store(200, SeqCst);
        fly(&mut harness, 1, |_, _| {});
        let status = harness.streamer.status();
        assert_eq!((&status.fault, status.reads_failed), (&None, 0));
        assert!(status.nodes_evicted > 20 && status.nodes_loaded > 50, "{status:?}");
        settles_in_the_end(&mut harness);
        stop(harness);
    }
}

#[test]
fn a_flight_on_which_reads_fail() {
    let mut harness = Harness::new(GpuOptions::default(), tight(), needs());
    fly(&mut harness, 2, |harness, share| {
        harness.faults.fails_one_of.store(if share > 0.2 { 3 } else { 0 }, SeqCst);
    });
    let status = harness.streamer.status();
    let fault = status.fault.unwrap();
    assert!(fault.contains("hills") && fault.contains("tired"), "{fault}");
    assert!(status.reads_failed > 0);
    stop(harness);
}

#[test]
fn a_flight_on_which_nothing_can_be_read_for_a_while() {
    let mut harness = Harness::new(GpuOptions::default(), tight(), needs());
    harness.settle(harness.view(0.5, 0.5, 2.0));
    let began = Instant::now();
    fly(&mut harness, 3, |harness, _| {
        // For less time than it takes until nodes are given up.
        let fails = began.elapsed() < Duration::from_secs(1);
        harness.faults.fails_one_of.store(u64::from(fails), SeqCst);
    });
    assert!(harness.streamer.status().reads_failed > 0);
    settles_in_the_end(&mut harness);
    stop(harness);
}

#[test]
fn a_flight_on_which_the_file_is_cut_short() {
    let mut harness = Harness::new(GpuOptions::default(), tight(), needs());
    fly(&mut harness, 4, |harness, share| {
        let whole = harness::hills_bytes().len() as u64;
        harness.faults.left.store(if share > 0.3 { whole / 2 } else { whole }, SeqCst);
    });
    harness.until("reports the fault", |_, harness| harness.streamer.status().fault.is_some());
    let fault = harness.streamer.status().fault.unwrap();
    assert!(fault.contains("hills") && fault.contains("cut short"), "{fault}");
    // The rest of the file is still loaded.
    let before = harness.streamer.status().nodes_loaded;
    let mut camera = Camera::new(5);
    for _ in 0..5000 {
        harness.streamer.look(camera.next(&harness));
        harness.frame();
        if harness.streamer.status().nodes_loaded > before + 10 {
            break;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    assert!(harness.streamer.status().nodes_loaded > before + 10);
    stop(harness);
}

#[test]
fn a_flight_on_which_the_file_is_replaced() {
    let gpu_options = GpuOptions { checks_bytes: false, ..GpuOptions::default() };
    let mut harness = Harness::new(gpu_options, tight(), needs());
    fly(&mut harness, 6, |harness, share| harness.faults.replaced.store(share > 0.3, SeqCst));
    let mut camera = Camera::new(7);
    while harness.streamer.status().fault.is_none() {
        harness.streamer.look(camera.next(&harness));
        harness.frame();
        std::thread::sleep(Duration::from_millis(1));
    }
    let fault = harness.streamer.status().fault.unwrap();
    assert!(fault.contains("hills") && fault.contains("replaced"), "{fault}");
    stop(harness);
}

#[test]
fn a_flight_over_a_slow_landing() {
    // A plane does not fit into a run, and a frame uploads hardly one plane.
    let gpu_options =
        GpuOptions { runs: 3, run_bytes: 4096, upload_bytes: 9000, ..GpuOptions::default() };
    let mut harness = Harness::new(gpu_options, tight(), needs());
    fly(&mut harness, 8, |harness, share| {
        harness.gpu.landing.blocked.store((share * 10.0) as u32 % 3 == 1, SeqCst);
    });
    harness.gpu.landing.blocked.store(false, SeqCst);
    settles_in_the_end(&mut harness);
    stop(harness);
}

#[test]
fn a_flight_with_changing_needs_and_few_nodes() {
    let options = Options { nodes_max: 30, occlusion: false, ..tight() };
    let mut harness = Harness::new(GpuOptions::default(), options, needs());
    fly(&mut harness, 9, |harness, share| {
        let needs = match (share * 20.0) as u32 % 4 {
            0 => needs(),
            1 => Needs { colour: Some(PlaneKind::Intensity), normals: false, ..Needs::default() },
            2 => Needs { colour: Some(PlaneKind::Attribute(7)), normals: true, ..Needs::default() },
            _ => Needs::default(),
        };
        harness.streamer.show(needs);
        assert!(harness.streamer.status().nodes_resident <= 30);
    });
    settles_in_the_end(&mut harness);
    stop(harness);
}

#[test]
fn it_stops_from_any_state() {
    // States: just started; loading from a slow disk; a landing that lends nothing; runs that are
    // never taken; reads that all fail.
    stop(Harness::new(GpuOptions::default(), tight(), needs()));
    let mut slow = Harness::new(GpuOptions::default(), tight(), needs());
    slow.faults.delay_us.store(50_000, SeqCst);
    slow.streamer.look(slow.view(0.3, 0.2, 0.12));
    (0..20).for_each(|_| drop(slow.frame()));
    stop(slow);
    let mut stuck = Harness::new(GpuOptions::default(), tight(), needs());
    stuck.settle(stuck.view(0.5, 0.5, 20.0));
    stuck.gpu.landing.blocked.store(true, SeqCst);
    let view = stuck.view(0.3, 0.2, 0.12);
    stuck.streamer.look(view);
    stuck.until("makes requests", |_, harness| harness.streamer.status().requests_in_flight > 0);
    stop(stuck);
    let mut ignored =
        Harness::new(GpuOptions { runs: 2, ..GpuOptions::default() }, tight(), needs());
    ignored.settle(ignored.view(0.5, 0.5, 20.0));
    ignored.streamer.look(ignored.view(0.3, 0.2, 0.12));
    std::thread::sleep(Duration::from_millis(100));
    stop(ignored);
    let failing = Harness::new(GpuOptions::default(), tight(), needs());
    failing.faults.fails_one_of.store(1, SeqCst);
    failing.streamer.look(failing.view(0.3, 0.2, 0.12));
    std::thread::sleep(Duration::from_millis(100));
    stop(failing);
}
