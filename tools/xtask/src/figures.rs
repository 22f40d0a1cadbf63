//! The README's table of figures: `cargo xtask figures` writes it from the results under
//! `bench/results`, and the step `house` fails if the two differ. `bench/figures.json` lists the
//! rows: the label, and for each column the result file, the JSON pointer of the number, its unit,
//! its digits after the point and, optionally, a factor (`scale`); `null` stands for "-".

use anyhow::{Context, Result, bail, ensure};
use serde_json::Value;
use std::fmt::Write;
use std::path::Path;

/// Description of the table.
const DESCRIPTION: &str = "bench/figures.json";
/// Document that holds the table.
const README: &str = "README.md";
/// Line above the table.
const BEGIN: &str = "<!-- figures: written by cargo xtask figures -->";
/// Line below the table.
const END: &str = "<!-- end of figures -->";
/// Most digits after the point that a cell may ask for.
const DIGITS_MAX: u64 = 6;

/// Writes the table into the README.
///
/// # Errors
/// If a row of the description has no number, or the README lacks one of the two lines around it.
pub fn write() -> Result<()> {
    let readme = std::fs::read_to_string(README).context(README)?;
    let written = with_table(&readme, &table()?)?;
    if written == readme {
        println!("figures: {README} is up to date");
        return Ok(());
    }
    std::fs::write(README, written).context(README)?;
    println!("figures: {README} has a new table");
    Ok(())
}

/// Compares the README's table with the results.
///
/// # Errors
/// If the two differ, or for the reasons of [`write`].
pub fn check() -> Result<()> {
    let readme = std::fs::read_to_string(README).context(README)?;
    ensure!(
        with_table(&readme, &table()?)? == readme,
        "the table of figures in {README} differs from {DESCRIPTION} and its results; \
         run `cargo xtask figures`"
    );
    Ok(())
}

/// Makes the table from its description and the results.
fn table() -> Result<String> {
    table_of(&read(DESCRIPTION)?, read)
}

/// Reads a JSON file.
fn read(path: &str) -> Result<Value> {
    let text = std::fs::read_to_string(Path::new(path)).with_context(|| path.to_owned())?;
    serde_json::from_str(&text).with_context(|| path.to_owned())
}

/// Makes the table from `description`; `read` gives the JSON of a result file.
fn table_of(description: &Value, read: impl Fn(&str) -> Result<Value>) -> Result<String> {
    let columns = array(description, "columns").context(DESCRIPTION)?;
    let mut text = String::from("| |");
    for column in columns {
        write!(text, " {} |", column.as_str().context("a heading is not a string")?)?;
    }
    write!(text, "\n|---|{}\n", "---:|".repeat(columns.len()))?;
    for row in array(description, "rows").context(DESCRIPTION)? {
        let label = string(row, "label").context(DESCRIPTION)?;
        let in_row = || format!("row \"{label}\" of {DESCRIPTION}");
        let cells = array(row, "cells").with_context(in_row)?;
        ensure!(
            cells.len() == columns.len(),
            "{}: {} cells for {} columns",
            in_row(),
            cells.len(),
            columns.len()
        );
        write!(text, "| {label} |")?;
        for cell in cells {
            write!(text, " {} |", cell_text(cell, &read).with_context(in_row)?)?;
        }
        text.push('\n');
    }
    Ok(text)
}

/// Text of a cell: one number with its unit, linked to the result file.
fn cell_text(cell: &Value, read: impl Fn(&str) -> Result<Value>) -> Result<String> {
    if cell.is_null() {
        return Ok("-".into());
    }
    let (file, field, unit) =
        (string(cell, "file")?, string(cell, "field")?, string(cell, "unit")?);
    let digits = cell["digits"].as_u64().filter(|n| *n <= DIGITS_MAX);
    let digits = digits.with_context(|| format!("`digits` is not a number up to {DIGITS_MAX}"))?;
    let scale = match &cell["scale"] {
        Value::Null => 1.0,
        scale => scale.as_f64().context("`scale` is not a number")?,
    };
    let result = read(file)?;
    let value = result.pointer(field).with_context(|| format!("{file} has no field {field}"))?;
    let Some(number) = value.as_f64() else {
        bail!("{file}: field {field} is not a number ({value})");
    };
    Ok(format!("[{:.*} {unit}]({file})", digits as usize, number * scale))
}

/// The array `key` of an object.
fn array<'a>(object: &'a Value, key: &str) -> Result<&'a Vec<Value>> {
    object[key].as_array().with_context(|| format!("`{key}` is not an array"))
}

/// The string `key` of an object.
fn string<'a>(object: &'a Value, key: &str) -> Result<&'a str> {
    object[key].as_str().with_context(|| format!("`{key}` is not a string"))
}

/// The document with `table` between the lines [`BEGIN`] and [`END`].
fn with_table(document: &str, table: &str) -> Result<String> {
    let find = |line: &str| {
        document
            .find(&format!("{line}\n"))
            .with_context(|| format!("{README} has no line `{line}`"))
    };
    let (begin, end) = (find(BEGIN)? + BEGIN.len() + 1, find(END)?);
    ensure!(begin <= end, "{README} has `{END}` before `{BEGIN}`");
    Ok(format!("{}\n{table}\n{}", &document[..begin], &document[end..]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    /// A description of one row with these cells.
    fn described(cells: &Value) -> Value {
        json!({"columns": ["CPU", "GPU"], "rows": [{"label": "build", "cells": cells}]})
    }

    /// The results of these tests: one file.
    fn results(path: &str) -> Result<Value> {
        ensure!(path == "a.json", "{path} is missing");
        Ok(json!({"rows": [{"seconds": 3.25, "program": "esker"}]}))
    }

    /// The error of a table whose only cell has this file and this field.
    fn error(file: &str, field: &str) -> String {
        let cell = json!({"file": file, "field": field, "unit": "s", "digits": 1});
        let error = table_of(&described(&json!([cell, null])), results).err();
        format!("{:#}", error.expect("an error"))
    }

    #[test]
    fn a_cell_has_one_number_with_its_digits_scale_and_unit() {
        let cell = json!({"file": "a.json", "field": "/rows/0/seconds", "unit": "ms", "digits": 0, "scale": 1000});
        let table = table_of(&described(&json!([cell, null])), results).expect("a table");
        let expected = "| | CPU | GPU |\n|---|---:|---:|\n| build | [3250 ms](a.json) | - |\n";
        assert_eq!(table, expected);
    }

    #[test]
    fn errors_name_the_row() {
        let row = "row \"build\" of bench/figures.json: ";
        assert_eq!(error("b.json", "/rows"), format!("{row}b.json is missing"));
        assert_eq!(error("a.json", "/rows/1"), format!("{row}a.json has no field /rows/1"));
        let text = error("a.json", "/rows/0/program");
        assert_eq!(text, format!("{row}a.json: field /rows/0/program is not a number (\"esker\")"));
        let error = table_of(&described(&json!([null])), results).expect_err("too few cells");
        assert_eq!(format!("{error:#}"), format!("{row}1 cells for 2 columns"));
    }

    #[test]
    fn cells_without_a_unit_or_with_too_many_digits_are_refused() {
        for (key, value) in [("unit", Value::Null), ("digits", json!(7)), ("scale", json!("k"))] {
            let mut cell =
                json!({"file": "a.json", "field": "/rows/0/seconds", "unit": "s", "digits": 1});
            cell[key] = value;
            let error = table_of(&described(&json!([cell, null])), results).expect_err(key);
            assert!(format!("{error:#}").contains(key), "{error:#}");
        }
    }

    #[test]
    fn the_table_replaces_what_is_between_its_lines() {
        let readme = format!("# A\n\n{BEGIN}\nold\n{END}\n\nafter\n");
        let once = with_table(&readme, "| new |\n").expect("both lines");
        assert_eq!(once, format!("# A\n\n{BEGIN}\n\n| new |\n\n{END}\n\nafter\n"));
        assert_eq!(with_table(&once, "| new |\n").expect("both lines"), once);
        for wrong in [format!("{BEGIN}\n"), format!("{END}\n"), format!("{END}\n{BEGIN}\n")] {
            assert!(with_table(&wrong, "").is_err(), "{wrong}");
        }
    }
}
