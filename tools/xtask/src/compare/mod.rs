//! `cargo xtask compare OLD NEW`: compares two results, files or folders of `bench/results`, row by
//! row and by ratio, and prints what became worse or better beyond noise. Files of folders belong
//! together if their names differ in the commit alone. [`kinds`] has the rows that can be compared,
//! [`figure`] the noise. As in CodSpeed and the benchmarks of rustls, times are those of the CPU
//! where reports have them.

mod figure;
mod kinds;

use anyhow::{Context, Result, bail, ensure};
use figure::{Change, Pair};
use kinds::KINDS;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;

/// Most characters of a commit at the end of a file's name, and fewest.
const COMMIT_CHARS: std::ops::RangeInclusive<usize> = 7..=12;

/// Compares the two results that `arguments` name.
///
/// # Errors
/// If something became worse, nothing can be compared, or a file cannot be read.
pub fn run(arguments: &[String]) -> Result<()> {
    let [old, new] = arguments else {
        bail!("name two folders of results, or two files: cargo xtask compare OLD NEW");
    };
    let is_other_machine = machine(old) != machine(new);
    let (old, new) = (reports(Path::new(old))?, reports(Path::new(new))?);
    let mut all = Vec::new();
    for (name, report) in &new {
        match old.get(name) {
            Some(before) => all.extend(compared(name, before, report)),
            None => println!("{name}: only in the new results"),
        }
    }
    for name in old.keys().filter(|name| !new.contains_key(*name)) {
        println!("{name}: only in the old results");
    }
    ensure!(!all.is_empty(), "the results have no row in common that can be compared");
    let summary = summary(&all, is_other_machine);
    println!("{}", summary.text);
    ensure!(summary.worse == 0, "{} figures became worse", summary.worse);
    Ok(())
}

/// A figure of a row that is in both results.
struct Compared {
    /// Report and kind, and what tells the row from others.
    row: String,
    pair: Pair,
}

/// What became of all figures.
struct Summary {
    text: String,
    worse: usize,
}

/// The machine that the name of a folder of results ends in, after the date.
fn machine(path: &str) -> Option<String> {
    let parts = Path::new(path).components().rev();
    let names = parts.filter_map(|part| part.as_os_str().to_str().map(String::from));
    let is_date = |text: &str| text.chars().all(|c| c.is_ascii_digit() || c == '-');
    names.take(2).find_map(|name| {
        let (date, machine) = name.split_at_checked("2026-01-01-".len())?;
        is_date(date).then(|| machine.to_owned())
    })
}

/// Reports of a folder, or the one of a file, by name without the commit. Of several commits, the
/// file that was written last counts.
fn reports(path: &Path) -> Result<BTreeMap<String, Value>> {
    let context = || format!("{}", path.display());
    if path.is_file() {
        return Ok(BTreeMap::from([("report".to_owned(), read(path)?)]));
    }
    let mut files = Vec::new();
    for entry in std::fs::read_dir(path).with_context(context)? {
        let file = entry.with_context(context)?.path();
        if file.extension().is_some_and(|end| end == "json") {
            files.push((file.metadata()?.modified()?, file));
        }
    }
    files.sort();
    let mut all = BTreeMap::new();
    for (_, file) in &files {
        let stem = file.file_stem().unwrap_or_default().to_string_lossy();
        all.insert(without_commit(&stem).to_owned(), read(file)?);
    }
    Ok(all)
}

fn read(path: &Path) -> Result<Value> {
    let text = std::fs::read_to_string(path).with_context(|| path.display().to_string())?;
    serde_json::from_str(&text).with_context(|| path.display().to_string())
}

/// The name of a report without the commit at its end.
fn without_commit(stem: &str) -> &str {
    match stem.rsplit_once('-') {
        Some((name, end))
            if COMMIT_CHARS.contains(&end.len())
                && end.chars().all(|c| c.is_ascii_hexdigit())
                && end.contains(|c: char| c.is_ascii_digit()) =>
        {
            name
        }
        _ => stem,
    }
}

/// Figures of the rows that both reports have. Rows that nothing tells apart are compared in order.
fn compared(name: &str, old: &Value, new: &Value) -> Vec<Compared> {
    let mut all = Vec::new();
    for kind in &KINDS {
        let (old, new) = (kind.rows(old), kind.rows(new));
        let mut by_id: BTreeMap<String, Vec<&Value>> = BTreeMap::new();
        old.iter().rev().for_each(|row| by_id.entry(kind.id(row)).or_default().push(row));
        let mut matched = 0;
        for row in &new {
            let id = kind.id(row);
            let Some(before) = by_id.get_mut(&id).and_then(Vec::pop) else { continue };
            matched += 1;
            let pairs = kind.figures.iter().filter_map(|figure| Pair::of(figure, before, row));
            let row = format!("{name}: {id}");
            all.extend(pairs.map(|pair| Compared { row: row.clone(), pair }));
        }
        if !old.is_empty() || !new.is_empty() {
            let (old, new) = (old.len(), new.len());
            println!("{name}: {}: {matched} rows in both, of {old} and {new}", kind.name);
        }
    }
    all
}

/// Judges all figures. The times of another machine are divided by the median of their ratios.
fn summary(all: &[Compared], is_other_machine: bool) -> Summary {
    let times = all.iter().filter(|one| one.pair.is_time);
    let mut ratios: Vec<f64> = times.filter_map(|one| one.pair.ratio()).collect();
    ratios.sort_by(f64::total_cmp);
    let median = ratios.get(ratios.len() / 2).copied();
    let slower = median.filter(|_| is_other_machine).unwrap_or(1.0);
    let mut lines = Vec::new();
    let mut counts = [0; 2];
    let changes = [(Change::Worse, "worse"), (Change::Better, "better")];
    for ((change, word), count) in changes.into_iter().zip(&mut counts) {
        let mut own: Vec<&Compared> =
            all.iter().filter(|one| one.pair.change(slower) == change).collect();
        let size = |one: &&Compared| one.pair.ratio().map_or(f64::INFINITY, |r| r.ln().abs());
        own.sort_by(|a, b| size(b).total_cmp(&size(a)));
        *count = own.len();
        lines.extend(own.iter().map(|one| line(word, one)));
    }
    let [worse, better] = counts;
    if let Some(median) = median {
        let machines = match is_other_machine {
            true => "; the machines differ, so that times are compared after division by it",
            false => "",
        };
        lines.push(format!("median ratio of times, new over old: {median:.3}{machines}"));
    }
    let same = all.len() - worse - better;
    lines.push(format!("{worse} figures worse, {better} better, {same} the same within noise"));
    Summary { text: lines.join("\n"), worse }
}

fn line(word: &str, one: &Compared) -> String {
    let Pair { field, old, new, .. } = &one.pair;
    let ratio = one.pair.ratio().map_or(String::new(), |ratio| format!(" (x {ratio:.3})"));
    let [low, high] = old.range;
    let range = match high - low > f64::EPSILON * old.value.abs() {
        true => format!("; noise {} to {}", short(low), short(high)),
        false => String::new(),
    };
    let values = format!("{} -> {}", short(old.value), short(new.value));
    format!("{word:<7} {field} {values}{ratio}{range}: {}", one.row)
}

/// A number with four digits.
fn short(value: f64) -> String {
    let digits = if value == 0.0 { 0.0 } else { 3.0 - value.abs().log10().floor() };
    format!("{value:.*}", digits.clamp(0.0, 7.0) as usize)
}

#[cfg(test)]
mod tests;
