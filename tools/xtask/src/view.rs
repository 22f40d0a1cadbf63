//! Runs the viewer's tests, which open real windows: on the display, or without one on a display in
//! memory (Xvfb), so that they run on servers too.

use crate::shell::follow_words;
use crate::tally::Tally;
use anyhow::{Result, ensure};
use std::process::{Command, Stdio};

/// Command of the tests.
const TESTS: [&str; 5] = ["cargo", "test", "--release", "-p", "esker-view"];
/// Command of a display in memory, with the size of a small screen. It is not reset when its last
/// window closes: a window that opens meanwhile would find no display.
const XVFB: [&str; 4] = ["xvfb-run", "-a", "-s", "-screen 0 1280x800x24 -noreset"];

/// Runs the tests and counts them.
pub fn test(tally: &mut Tally) -> Result<()> {
    let has_display = cfg!(not(target_os = "linux"))
        || ["DISPLAY", "WAYLAND_DISPLAY"].iter().any(|name| is_set(name));
    let words: Vec<&str> = if has_display {
        TESTS.to_vec()
    } else {
        ensure!(
            has_xvfb(),
            "there is no display, and no xvfb-run to make one: install xvfb (apt-get install xvfb)"
        );
        XVFB.into_iter().chain(TESTS).collect()
    };
    println!("$ {}", words.join(" "));
    let before = tally.passed;
    // Captured output would hide which tests skipped themselves.
    let (lines, ok) = follow_words(&words, &[("RUST_TEST_NOCAPTURE", "1")])?;
    lines.iter().for_each(|line| tally.read(line));
    ensure!(ok && tally.passed > before, "failed, or ran no test: {}", TESTS.join(" "));
    Ok(())
}

fn is_set(name: &str) -> bool {
    std::env::var_os(name).is_some_and(|value| !value.is_empty())
}

fn has_xvfb() -> bool {
    let help = Command::new(XVFB[0]).arg("--help").stdin(Stdio::null()).output();
    help.is_ok_and(|out| out.status.success())
}
