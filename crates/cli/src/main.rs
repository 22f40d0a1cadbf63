//! The `esker` program: parses the command line, calls `esker_engine` or `esker_bench`, and prints
//! the report. The exit code is 0 only if all of the work succeeded. With `--json` the last line of
//! standard output is one JSON object.

mod args;
mod bench;
mod commands;
mod export;
mod job;
mod job_options;
mod job_run;
mod light;
mod memory;
mod output;
mod pick;
mod render;
mod shared;
mod view;

use clap::Parser;
use esker_engine::io::address::shown_argument;
use esker_engine::io::visible::visible;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

fn main() -> ExitCode {
    esker_engine::hide_caught_panics();
    let args = args::Args::parse_from(std::env::args_os().map(shown_argument));
    let stop = Arc::new(AtomicBool::new(false));
    #[cfg(feature = "remote")]
    esker_remote::install(
        // Reads that are measured from cold come from the server.
        esker_remote::Disk::of_user().filter(|_| !args.is_cold()),
        esker_remote::Pool::new(esker_remote::Limits::default(), stop.clone()),
    );
    let flag = stop.clone();
    // A second Ctrl-C ends the program at once, which leaves no file under its final name.
    let handler = ctrlc::set_handler(move || {
        if flag.swap(true, Ordering::Relaxed) {
            esker_engine::remove_unfinished();
            std::process::abort();
        }
    });
    if let Err(error) = handler {
        eprintln!("note: Ctrl-C cannot be handled: {error}");
    }
    match commands::run(args.command.unwrap_or(args::Command::Demo { out: "out".into() }), stop) {
        Ok(code) => code,
        Err(error) => {
            eprintln!("error: {}", visible(&esker_engine::one_line(&error)));
            ExitCode::FAILURE
        }
    }
}
