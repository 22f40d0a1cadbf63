//! The `esker-view` binary: parses its command line and shows the window. Exit code 0 means that
//! all of it worked.

use clap::Parser;
use esker_view::args::Args;
use esker_view::source::sweep;
use esker_view::window;
use std::process::ExitCode;
use std::time::Instant;

/// Exit code after Ctrl-C, as shells have it.
const INTERRUPTED: i32 = 130;

fn main() -> ExitCode {
    let start = Instant::now();
    esker_engine::hide_caught_panics();
    // What was built for this window goes with it, also by Ctrl-C. Where nobody can be told, it
    // stays.
    let _ = ctrlc::set_handler(|| {
        sweep();
        std::process::exit(INTERRUPTED);
    });
    match window::run(Args::parse(), start) {
        Ok(code) => code,
        Err(error) => {
            let message = format!("{error:#}");
            eprintln!("error: {}", message.split_whitespace().collect::<Vec<_>>().join(" "));
            ExitCode::FAILURE
        }
    }
}
