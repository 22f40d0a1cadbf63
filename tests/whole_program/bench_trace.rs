//! `esker bench trace` as scripts use it: the fields of its rows, figures, references that are kept
//! and used again, and errors that name what exists.

use crate::folder::Folder;
use crate::program::esker;
use crate::trial;
use libtest_mimic::Trial;
use serde_json::Value;
use std::ffi::OsStr;

pub fn trials(trials: &mut Vec<Trial>) {
    trials.push(trial("bench trace: rows have their fields, references are kept", rows));
    trials.push(trial("bench trace: an unknown scene is refused by name", unknown));
}

fn rows() {
    let folder = Folder::new();
    let (references, figures) = (folder.file("references"), folder.file("figures"));
    let run = || -> Value {
        let words = ["bench", "trace", "--quick", "--scenes", "hall,office", "--size", "48x36"];
        let more = ["--reference-samples", "2", "--json", "--progress", "none"];
        let folders = [OsStr::new("--references"), references.as_os_str()];
        let out = [OsStr::new("--out"), figures.as_os_str()];
        esker(words.iter().chain(&more).map(OsStr::new).chain(folders).chain(out)).json()
    };
    let (first, second) = (run(), run());
    assert_eq!(std::fs::read_dir(&references).unwrap().count(), 9, "three a scene, and of limits");
    // Five a scene; of convergence, limits and what moves.
    assert_eq!(std::fs::read_dir(&figures).unwrap().count(), 13);
    assert_eq!(first["moving"].as_array().unwrap().len(), 4);
    let rows = |report: &Value| report["rows"].as_array().unwrap().clone();
    assert_eq!(rows(&first).len(), rows(&second).len());
    for (row, again) in rows(&first).iter().zip(&rows(&second)) {
        for field in ["bounces", "samples", "trace_ms", "filter_ms", "total_ms", "mrays_per_s"] {
            assert!(row[field].as_f64().is_some_and(|n| n >= 0.0), "`{field}` of {row}");
        }
        for field in ["scene", "backend", "sequence", "filter"] {
            assert!(row[field].is_string(), "`{field}` of {row}");
        }
        for field in ["mse", "p999", "worst"] {
            let has_error = row["part"] != "frames" && row["part"] != "filters";
            assert_eq!(row[field].is_number(), has_error, "`{field}` of {row}");
            assert_eq!(row[field], again[field], "`{field}` of {row}");
        }
    }
}

fn unknown() {
    let outcome = esker(["bench", "trace", "--quick", "--scenes", "teapot"].map(OsStr::new));
    let error = outcome.error();
    assert!(error.contains("there is no scene `teapot`") && error.contains("terrain"), "{error}");
}
