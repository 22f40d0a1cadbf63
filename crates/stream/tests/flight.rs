//! Random camera flight under tight budgets, on disks and landings of every kind: in each frame the
//! stand-in for the GPU checks what must hold, and the streamer stops from wherever it is. Each of the
//! eight flights takes ESKER_FLIGHT_SECONDS (2); ten minutes in all are
//! `ESKER_FLIGHT_SECONDS=75 cargo test --release -p esker-stream --test flight -- --test-threads 1`.
//! Under the thread sanitizer (nightly, with rust-src):
//! `RUSTFLAGS="-Zsanitizer=thread" cargo +nightly test --release -Zbuild-std --target x86_64-unknown-linux-gnu
//! -p esker-stream --tests -- --test-threads 1`.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod rig;

use esker_format::PlaneKind;
use esker_lod::View;
use esker_stream::{Needs, Options, Priority};
use rig::{Habits, Random, Rig, view};
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

/// A camera that glides to one random place after another, and sometimes jumps.
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

    fn next(&mut self, rig: &Rig) -> View {
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
        view(&rig.forest, self.at, [x + turn.sin() * 0.2, y + turn.cos() * 0.2, 0.0])
    }
}

/// Flies; what happens on the way is up to `event`, which is told how much of the flight is over.
fn fly(rig: &mut Rig, seed: u64, mut event: impl FnMut(&mut Rig, f64)) {
    let (began, length) = (Instant::now(), seconds());
    let mut camera = Camera::new(seed);
    loop {
        let share = began.elapsed().as_secs_f64() / length;
        if share >= 1.0 {
            return;
        }
        event(rig, share);
        rig.streamer.look(camera.next(rig));
        rig.frame();
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// Stops the streamer; fails where that takes long.
fn stop(rig: Rig) {
    let began = Instant::now();
    rig.streamer.stop();
    assert!(began.elapsed() < Duration::from_secs(5), "{:?}", began.elapsed());
}

fn settles_in_the_end(rig: &mut Rig) {
    let cut = rig.settle(rig.view(0.3, 0.2, 0.12));
    assert!(!cut.nodes.is_empty());
    assert!(cut.complete, "{:?} {:?}", cut.counters, rig.streamer.status());
}

#[test]
fn a_healthy_flight() {
    for priority in [Priority::Distance, Priority::ErrorPerByte] {
        let mut rig = Rig::new(Habits::default(), Options { priority, ..tight() }, needs());
        rig.faults.delay_us.store(200, SeqCst);
        fly(&mut rig, 1, |_, _| {});
        let status = rig.streamer.status();
        assert_eq!((&status.fault, status.reads_failed), (&None, 0));
        assert!(status.nodes_evicted > 20 && status.nodes_loaded > 50, "{status:?}");
        settles_in_the_end(&mut rig);
        stop(rig);
    }
}

#[test]
fn a_flight_on_which_reads_fail() {
    let mut rig = Rig::new(Habits::default(), tight(), needs());
    fly(&mut rig, 2, |rig, share| {
        rig.faults.fails_one_of.store(if share > 0.2 { 3 } else { 0 }, SeqCst);
    });
    let status = rig.streamer.status();
    let fault = status.fault.unwrap();
    assert!(fault.contains("hills") && fault.contains("tired"), "{fault}");
    assert!(status.reads_failed > 0);
    stop(rig);
}

#[test]
fn a_flight_on_which_nothing_can_be_read_for_a_while() {
    let mut rig = Rig::new(Habits::default(), tight(), needs());
    rig.settle(rig.view(0.5, 0.5, 2.0));
    let began = Instant::now();
    fly(&mut rig, 3, |rig, _| {
        // Shorter than it takes until nodes are given up.
        let fails = began.elapsed() < Duration::from_secs(1);
        rig.faults.fails_one_of.store(u64::from(fails), SeqCst);
    });
    assert!(rig.streamer.status().reads_failed > 0);
    settles_in_the_end(&mut rig);
    stop(rig);
}

#[test]
fn a_flight_on_which_the_file_is_cut_short() {
    let mut rig = Rig::new(Habits::default(), tight(), needs());
    fly(&mut rig, 4, |rig, share| {
        let whole = rig::pristine().len() as u64;
        rig.faults.left.store(if share > 0.3 { whole / 2 } else { whole }, SeqCst);
    });
    rig.until("says so", |_, rig| rig.streamer.status().fault.is_some());
    let fault = rig.streamer.status().fault.unwrap();
    assert!(fault.contains("hills") && fault.contains("cut short"), "{fault}");
    // The rest goes on: what is left of the file is still loaded.
    let before = rig.streamer.status().nodes_loaded;
    let mut camera = Camera::new(5);
    for _ in 0..5000 {
        rig.streamer.look(camera.next(&rig));
        rig.frame();
        if rig.streamer.status().nodes_loaded > before + 10 {
            break;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    assert!(rig.streamer.status().nodes_loaded > before + 10);
    stop(rig);
}

#[test]
fn a_flight_on_which_the_file_is_replaced() {
    let habits = Habits { checks_bytes: false, ..Habits::default() };
    let mut rig = Rig::new(habits, tight(), needs());
    fly(&mut rig, 6, |rig, share| rig.faults.replaced.store(share > 0.3, SeqCst));
    let mut camera = Camera::new(7);
    while rig.streamer.status().fault.is_none() {
        rig.streamer.look(camera.next(&rig));
        rig.frame();
        std::thread::sleep(Duration::from_millis(1));
    }
    let fault = rig.streamer.status().fault.unwrap();
    assert!(fault.contains("hills") && fault.contains("replaced"), "{fault}");
    stop(rig);
}

#[test]
fn a_flight_over_a_slow_landing() {
    // A plane does not fit a run, and a frame uploads hardly one.
    let habits = Habits { runs: 3, run_bytes: 4096, upload_bytes: 9000, ..Habits::default() };
    let mut rig = Rig::new(habits, tight(), needs());
    fly(&mut rig, 8, |rig, share| {
        rig.gpu.landing.stuck.store((share * 10.0) as u32 % 3 == 1, SeqCst);
    });
    rig.gpu.landing.stuck.store(false, SeqCst);
    settles_in_the_end(&mut rig);
    stop(rig);
}

#[test]
fn a_flight_with_changing_needs_and_few_nodes() {
    let options = Options { nodes_max: 30, occlusion: false, ..tight() };
    let mut rig = Rig::new(Habits::default(), options, needs());
    fly(&mut rig, 9, |rig, share| {
        let needs = match (share * 20.0) as u32 % 4 {
            0 => needs(),
            1 => Needs { colour: Some(PlaneKind::Intensity), normals: false, ..Needs::default() },
            2 => Needs { colour: Some(PlaneKind::Attribute(7)), normals: true, ..Needs::default() },
            _ => Needs::default(),
        };
        rig.streamer.need(needs);
        assert!(rig.streamer.status().nodes_resident <= 30);
    });
    settles_in_the_end(&mut rig);
    stop(rig);
}

#[test]
fn it_stops_from_any_state() {
    // Just started; loading from a slow disk; with a landing that lends nothing; with runs that nobody
    // takes; with reads that all fail.
    stop(Rig::new(Habits::default(), tight(), needs()));
    let mut slow = Rig::new(Habits::default(), tight(), needs());
    slow.faults.delay_us.store(50_000, SeqCst);
    slow.streamer.look(slow.view(0.3, 0.2, 0.12));
    (0..20).for_each(|_| drop(slow.frame()));
    stop(slow);
    let mut stuck = Rig::new(Habits::default(), tight(), needs());
    stuck.settle(stuck.view(0.5, 0.5, 20.0));
    stuck.gpu.landing.stuck.store(true, SeqCst);
    let view = stuck.view(0.3, 0.2, 0.12);
    stuck.streamer.look(view);
    stuck.until("asks", |_, rig| rig.streamer.status().requests_in_flight > 0);
    stop(stuck);
    let mut ignored = Rig::new(Habits { runs: 2, ..Habits::default() }, tight(), needs());
    ignored.settle(ignored.view(0.5, 0.5, 20.0));
    ignored.streamer.look(ignored.view(0.3, 0.2, 0.12));
    std::thread::sleep(Duration::from_millis(100));
    stop(ignored);
    let failing = Rig::new(Habits::default(), tight(), needs());
    failing.faults.fails_one_of.store(1, SeqCst);
    failing.streamer.look(failing.view(0.3, 0.2, 0.12));
    std::thread::sleep(Duration::from_millis(100));
    stop(failing);
}
