//! Shows, before points are read, what readers guess at the meaning of inputs.

use crate::options::Options;
use esker_points::Task;
use esker_scan::{Guess, Source};

/// Notes the guess at each input, with its first points; inputs of one guess are one note. Also
/// notes that options of text files have no effect, if there is no text file.
pub fn note_guesses(sources: &[Box<dyn Source>], options: &Options, task: &dyn Task) {
    let mut shown: Vec<(&str, &Guess, usize)> = Vec::new();
    for source in sources {
        let Some(guess) = source.guess() else { continue };
        match shown.iter_mut().find(|(_, of, _)| of.what == guess.what) {
            Some((_, _, inputs)) => *inputs += 1,
            None => shown.push((source.info().grid.name.as_str(), guess, 1)),
        }
    }
    for (name, Guess { what, rows, remedy }, inputs) in shown {
        let rows: Vec<String> = rows.iter().map(|row| format!("`{row}`")).collect();
        let rows = if rows.is_empty() { String::new() } else { format!(": {}", rows.join(", ")) };
        let more = match inputs {
            1 => String::new(),
            n => format!(" (and {} more inputs alike)", n - 1),
        };
        task.note(&format!("{name}{more}: {what}{rows}; {remedy}"));
    }
    let is_text = |format: &str| format.starts_with("text") || format.starts_with("PTS");
    let has_options = options.columns.is_some() || options.skip_lines > 0;
    if has_options && !sources.iter().any(|source| is_text(&source.info().format)) {
        task.note("no input is text: --columns and --skip-lines have no effect");
    }
}
