//! Runs the `esker` binary as its users do. Every real scan is a trial of its own, named after its
//! file; without a folder with `manifest.csv` in `ESKER_DATA`, these trials count as ignored.

#![allow(clippy::unwrap_used, reason = "a trial fails by panicking")]
#![allow(
    clippy::disallowed_methods,
    reason = "files that the trials made themselves are read whole"
)]

mod arguments;
mod bad;
mod bench_build;
mod bench_trace;
mod commands;
mod contract;
mod data;
mod degrees;
mod devices;
mod draw;
mod export;
mod folder;
mod forest;
mod frames;
mod hostile;
mod inputs;
mod interrupt;
mod jobs;
mod las;
mod light;
mod pick;
mod pictures;
mod program;
mod proof;
mod python;
mod resume;
mod scene;
mod stream;
mod synthetic;
mod text;

use libtest_mimic::{Arguments, Trial};

/// Trials that run at the same time: each runs a program that uses all cores.
const TRIALS_AT_ONCE: usize = 2;

fn main() {
    let mut arguments = Arguments::from_args();
    arguments.test_threads.get_or_insert(TRIALS_AT_ONCE);
    let mut trials = Vec::new();
    // The longest trials first.
    data::trials(&mut trials);
    degrees::trials(&mut trials);
    hostile::trials(&mut trials);
    resume::trials(&mut trials);
    synthetic::trials(&mut trials);
    bad::trials(&mut trials);
    bench_build::trials(&mut trials);
    bench_trace::trials(&mut trials);
    contract::trials(&mut trials);
    arguments::trials(&mut trials);
    commands::trials(&mut trials);
    inputs::trials(&mut trials);
    text::trials(&mut trials);
    proof::trials(&mut trials);
    pick::trials(&mut trials);
    pictures::trials(&mut trials);
    light::trials(&mut trials);
    scene::trials(&mut trials);
    devices::trials(&mut trials);
    interrupt::trials(&mut trials);
    jobs::trials(&mut trials);
    python::trials(&mut trials);
    export::trials(&mut trials);
    stream::trials(&mut trials);
    forest::trials(&mut trials);
    draw::trials(&mut trials);
    frames::trials(&mut trials);
    libtest_mimic::run(&arguments, trials).exit();
}

/// Makes a trial of a function that panics on failure.
fn trial(name: &str, holds: impl FnOnce() + Send + 'static) -> Trial {
    Trial::test(name, move || {
        holds();
        Ok(())
    })
}

/// Placeholder of trials whose input is missing; counts as ignored.
fn missing(name: &str) -> Trial {
    Trial::test(name, || Ok(())).with_ignored_flag(true)
}
