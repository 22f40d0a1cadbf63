//! The `esker-view` binary: parses its command line and shows the window. The exit code is 0 only
//! if all of the work succeeded.

use clap::Parser;
use esker_engine::io::address::shown_argument;
use esker_engine::io::visible::visible;
use esker_view::args::Args;
use esker_view::source::remove_temporary_files;
use esker_view::window;
use std::process::ExitCode;
use std::time::Instant;

/// Exit code after Ctrl-C, which is the one that shells report.
const INTERRUPTED: i32 = 130;

fn main() -> ExitCode {
    let start = Instant::now();
    esker_engine::hide_caught_panics();
    #[cfg(feature = "remote")]
    esker_remote::install(
        esker_remote::Disk::of_user(),
        esker_remote::Pool::new(esker_remote::Limits::default(), Default::default()),
    );
    // The file that was built for this window is removed with it, also on Ctrl-C. It stays if the
    // handler cannot be installed.
    let _ = ctrlc::set_handler(|| {
        remove_temporary_files();
        std::process::exit(INTERRUPTED);
    });
    let args = Args::parse_from(std::env::args_os().map(shown_argument));
    match window::run(args, start) {
        Ok(code) => code,
        Err(error) => {
            let message = format!("{error:#}");
            let message = message.split_whitespace().collect::<Vec<_>>().join(" ");
            eprintln!("error: {}", visible(&message));
            ExitCode::FAILURE
        }
    }
}
