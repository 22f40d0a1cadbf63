//! Runs the test command and the run command of the README, word for word, so that they keep
//! working.

use crate::shell::follow;
use crate::tally::Tally;
use anyhow::{Context, Result, bail, ensure};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

/// Tests of the tools, which are not default members of the workspace.
const OWN_TESTS: &str = "cargo test --release -p xtask";
/// First bytes of every PNG file.
const PNG: [u8; 8] = *b"\x89PNG\r\n\x1a\n";
/// Coarsest resolution of the clocks of file systems.
const CLOCK: Duration = Duration::from_secs(2);

/// Runs the README's test command and the tests of this program, and counts them.
pub fn test(tally: &mut Tally) -> Result<()> {
    let command = command("cargo test --release")?;
    let mut failed = Vec::new();
    for command in [command.as_str(), OWN_TESTS] {
        println!("$ {command}");
        let before = tally.passed;
        // Captured output would hide which tests skipped themselves.
        let (lines, ok) = follow(command, &[("RUST_TEST_NOCAPTURE", "1")])?;
        lines.iter().for_each(|line| tally.read(line));
        if !ok || tally.passed == before {
            failed.push(command);
        }
    }
    ensure!(failed.is_empty(), "failed, or ran no test: {}", failed.join(", "));
    Ok(())
}

/// Runs the README's run command and checks the picture that it names.
pub fn demo() -> Result<()> {
    let command = command("cargo run --release")?;
    println!("$ {command}");
    let start = SystemTime::now() - CLOCK;
    let (lines, ok) = follow(&command, &[])?;
    ensure!(ok, "`{command}` failed");
    let pictures: Vec<_> = lines.iter().flat_map(|line| pictures_in(line)).collect();
    let Some(picture) = pictures.iter().find(|p| p.is_file()) else {
        bail!("`{command}` names no picture that is there ({pictures:?})");
    };
    let changed = picture.metadata()?.modified()?;
    ensure!(changed >= start, "{} is from before the run", picture.display());
    ensure!(is_png(picture)?, "{} is no PNG", picture.display());
    println!("demo: {} is a PNG", picture.display());
    Ok(())
}

/// The command `words` of the README's code blocks.
fn command(words: &str) -> Result<String> {
    let readme = std::fs::read_to_string("README.md").context("README.md")?;
    commands(&readme)
        .find(|c| *c == words)
        .map(str::to_owned)
        .with_context(|| format!("README.md has no code block with the command `{words}`"))
}

/// Lines of fenced code blocks.
fn commands(readme: &str) -> impl Iterator<Item = &str> {
    let mut inside = false;
    readme.lines().map(str::trim).filter(move |line| {
        let fence = line.starts_with("```");
        inside ^= fence;
        inside && !fence && !line.is_empty()
    })
}

/// Words of a line that name a PNG file.
fn pictures_in(line: &str) -> Vec<PathBuf> {
    line.split(|c: char| c.is_whitespace() || "\"'`,;()".contains(c))
        .map(|word| word.trim_end_matches(['.', ':']))
        .filter(|word| word.ends_with(".png"))
        .map(PathBuf::from)
        .collect()
}

fn is_png(path: &Path) -> Result<bool> {
    let mut head = Vec::new();
    std::fs::File::open(path)?.take(PNG.len() as u64).read_to_end(&mut head)?;
    Ok(head == PNG)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_are_those_inside_of_code_blocks() {
        let readme = "run `x`\n```sh\ncargo test --release\n\n```\ncargo clean\n```\na b\n```\n";
        assert_eq!(commands(readme).collect::<Vec<_>>(), ["cargo test --release", "a b"]);
    }

    #[test]
    fn pictures_are_found_in_plain_lines_and_in_json() {
        assert_eq!(pictures_in("look at out/demo.png."), [PathBuf::from("out/demo.png")]);
        assert_eq!(pictures_in("{\"picture\":\"a.png\",\"ms\":1}"), [PathBuf::from("a.png")]);
        assert!(pictures_in("no picture").is_empty());
    }
}
