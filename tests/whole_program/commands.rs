//! `docs/commands.md` and `--help` describe the same commands with the same options: every command
//! that `esker --help` lists, also nested ones, has a section, and the section has its long options
//! and no others.

use crate::program::esker;
use crate::trial;
use libtest_mimic::Trial;
use std::collections::{BTreeMap, BTreeSet};

/// The page, relative to the package of the `esker` program.
const PAGE: &str = "../../docs/commands.md";
/// Heading of the section whose options need not be repeated in the sections of commands.
const SHARED: &str = "Options of most commands";
/// The command that prints help, which has none itself.
const HELP: &str = "help";
/// The command that passes all arguments on to another program, which may not be built.
const PASSED_ON: &str = "view";
/// Greatest indent of a line that begins with an option; explanations are indented further.
const OPTION_INDENT_MAX: usize = 6;

pub fn trials(trials: &mut Vec<Trial>) {
    trials.push(trial("commands: the page lists what --help lists", page_is_complete));
}

fn page_is_complete() {
    let page = std::fs::read_to_string(PAGE).unwrap();
    let sections = sections(&page);
    let shared = options_in(sections.get(SHARED).unwrap_or_else(|| panic!("no `{SHARED}`")));
    let mut commands = BTreeMap::new();
    collect(&mut Vec::new(), &mut commands);
    assert!(commands.len() > 2, "`esker --help` lists no commands");
    let mut faults = Vec::new();
    for (command, help) in &commands {
        let Some(section) = sections.get(&heading(command)) else {
            faults.push(format!("`{command}` has no section"));
            continue;
        };
        let Some(help) = help else { continue };
        let (listed, described) = (options_of(help), options_in(section));
        let missing = listed.iter().filter(|o| !described.contains(*o) && !shared.contains(*o));
        faults.extend(missing.map(|option| format!("`{command}`: {option} is not described")));
        let unknown = described.difference(&listed);
        faults.extend(unknown.map(|option| format!("`{command}`: there is no {option}")));
    }
    let headings = sections.keys().filter(|h| h.starts_with("`esker "));
    let known: BTreeSet<_> = commands.keys().map(|command| heading(command)).collect();
    faults.extend(headings.filter(|h| !known.contains(*h)).map(|h| format!("{h} is no command")));
    assert!(faults.is_empty(), "{PAGE} differs from --help:\n  {}", faults.join("\n  "));
}

/// Heading of a command's section.
fn heading(command: &str) -> String {
    format!("`{command}`")
}

/// Adds the command `words` and those below it, each with what `--help` prints; `None` for the one
/// that passes all arguments on.
fn collect(words: &mut Vec<String>, commands: &mut BTreeMap<String, Option<String>>) {
    let outcome = esker(words.iter().map(String::as_str).chain(["--help"]));
    let help = outcome.worked().stdout.clone();
    for name in commands_of(&help).into_iter().filter(|name| name != HELP) {
        words.push(name);
        if words.len() == 1 && words[0] == PASSED_ON {
            commands.insert(format!("esker {PASSED_ON}"), None);
        } else {
            collect(words, commands);
        }
        words.pop();
    }
    if !words.is_empty() {
        commands.insert(format!("esker {}", words.join(" ")), Some(help));
    }
}

/// Names of the commands that a help text lists: lines of its part `Commands:` that are indented by
/// two blanks.
fn commands_of(help: &str) -> Vec<String> {
    let part = help.lines().skip_while(|line| *line != "Commands:").skip(1);
    let lines = part.take_while(|line| !line.is_empty());
    let names = lines.filter_map(|line| line.strip_prefix("  ")?.split(' ').next());
    names.filter(|name| !name.is_empty()).map(str::to_owned).collect()
}

/// Long options that a help text lists. What explains them may name others.
fn options_of(help: &str) -> BTreeSet<String> {
    let texts = help.lines().filter_map(|line| {
        let text = line.trim_start();
        let is_option = text.starts_with('-') && line.len() - text.len() <= OPTION_INDENT_MAX;
        is_option.then_some(text)
    });
    texts.filter_map(|text| option_at(text, text.find("--")?)).collect()
}

/// All long options that a text names.
fn options_in(text: &str) -> BTreeSet<String> {
    text.match_indices("--").filter_map(|(at, _)| option_at(text, at)).collect()
}

/// The long option that begins at byte `at` of a text: two hyphens, a lower-case letter, then
/// letters, digits and hyphens.
fn option_at(text: &str, at: usize) -> Option<String> {
    if text[..at].ends_with(|c: char| c == '-' || c.is_ascii_alphanumeric()) {
        return None;
    }
    let name = text[at..].strip_prefix("--")?;
    let is_part = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
    let name = &name[..name.find(|c| !is_part(c)).unwrap_or(name.len())];
    let is_option = name.starts_with(|c: char| c.is_ascii_lowercase());
    is_option.then(|| format!("--{}", name.trim_end_matches('-')))
}

/// The sections of a page by their headings; each ends at the next heading. Code blocks have none.
fn sections(page: &str) -> BTreeMap<String, String> {
    let (mut sections, mut heading, mut is_code) = (BTreeMap::new(), String::new(), false);
    for line in page.lines() {
        is_code ^= line.starts_with("```");
        if line.starts_with('#') && !is_code {
            heading = line.trim_start_matches('#').trim().to_owned();
        } else {
            let section: &mut String = sections.entry(heading.clone()).or_default();
            section.push_str(line);
            section.push('\n');
        }
    }
    sections
}
