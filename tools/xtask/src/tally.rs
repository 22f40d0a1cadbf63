//! Counts tests from the output of `cargo test`: sums of its `test result:` lines. Tests that print
//! `skipped: reason` and return early count as skipped, not as passed.

use std::fmt;

/// Tests run, over all suites.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// Number of `test result:` lines.
    pub suites: usize,
    /// Tests that passed, those that returned early included.
    pub passed: usize,
    /// Tests that failed.
    pub failed: usize,
    /// Tests that were ignored.
    pub ignored: usize,
    /// Tests that printed that they were skipped.
    pub returned_early: usize,
}

impl Tally {
    /// Reads one line of the output.
    pub fn read(&mut self, line: &str) {
        if line.starts_with("skipped: ") || line.contains(" ... skipped: ") {
            self.returned_early += 1;
            return;
        }
        let Some(counts) = line.strip_prefix("test result: ") else { return };
        self.suites += 1;
        for part in counts.split(['.', ';']) {
            let mut words = part.split_whitespace();
            let (Some(Ok(n)), Some(what)) = (words.next().map(str::parse::<usize>), words.next())
            else {
                continue;
            };
            match what {
                "passed" => self.passed += n,
                "failed" => self.failed += n,
                "ignored" => self.ignored += n,
                _ => {}
            }
        }
    }
}

impl fmt::Display for Tally {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let passed = self.passed.saturating_sub(self.returned_early);
        let skipped = self.ignored + self.returned_early;
        write!(f, "{passed} passed, {} failed, {skipped} skipped", self.failed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_add_up_and_early_returns_count_as_skipped() {
        let mut tally = Tally::default();
        for line in [
            "running 3 tests",
            "skipped: ESKER_DATA is not set",
            "test a ... ok",
            "test result: ok. 3 passed; 0 failed; 1 ignored; 0 measured; 0 filtered out; finished in 0.03s",
            "test result: FAILED. 2 passed; 1 failed; 0 ignored; 0 measured; 0 filtered out; finished in 1.20s",
        ] {
            tally.read(line);
        }
        assert_eq!(tally.to_string(), "4 passed, 1 failed, 2 skipped");
        assert_eq!(tally.suites, 2);
    }
}
