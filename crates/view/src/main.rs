//! The `esker-view` binary: parses its command line and shows the window. Exit code 0 means that all of it worked.

use clap::Parser;
use esker_view::args::Args;
use esker_view::window;
use std::process::ExitCode;
use std::time::Instant;

fn main() -> ExitCode {
    let start = Instant::now();
    esker_engine::hide_caught_panics();
    match window::run(Args::parse(), start) {
        Ok(code) => code,
        Err(error) => {
            let message = format!("{error:#}");
            eprintln!("error: {}", message.split_whitespace().collect::<Vec<_>>().join(" "));
            ExitCode::FAILURE
        }
    }
}
