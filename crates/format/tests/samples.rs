//! The sample files of every frozen version stay readable: they are opened, verified, and compared
//! with the contents that were recorded when they were made.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod describe;

use describe::{describe, folder};
use esker_format::{EskerFile, verify};
use esker_points::task::Silent;
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};

fn expected() -> BTreeMap<String, Value> {
    let text = std::fs::read_to_string(folder().join("expected.json")).unwrap();
    serde_json::from_str(&text).unwrap()
}

#[test]
fn every_sample_is_whole_and_holds_what_it_always_held() {
    let expected = expected();
    let there = std::fs::read_dir(folder()).unwrap().map(|entry| entry.unwrap().file_name());
    let there: BTreeSet<String> = there.map(|name| name.into_string().unwrap()).collect();
    let listed = expected.keys().cloned().chain(["expected.json".into()]).collect();
    assert_eq!(there, listed);
    for (name, expected) in &expected {
        let file = EskerFile::open(&folder().join(name)).unwrap();
        let report = verify(&file, &Silent).unwrap();
        assert_eq!(expected["multiset_hash"], report.hash.to_string(), "{name}");
        assert_eq!(*expected, describe(&file), "{name}");
    }
}

#[test]
fn the_samples_have_every_kind_of_plane_and_encoding() {
    let expected = expected();
    let all = |member: &str| -> BTreeSet<String> {
        let lists = expected.values().flat_map(|e| e[member].as_array().unwrap());
        lists.map(|v| v.as_str().map_or_else(|| v.to_string(), Into::into)).collect()
    };
    for kind in
        ["position", "residual", "colour", "intensity", "normal", "class", "colour remainder"]
    {
        assert!(all("planes").contains(kind), "{kind}");
    }
    assert_eq!(all("encodings"), ["0", "1", "2", "3"].map(String::from).into());
    let types: BTreeSet<_> =
        all("attributes").iter().map(|a| a.split(':').next_back().unwrap().to_string()).collect();
    assert_eq!(types.len(), 10, "{types:?}");
    let scaled: Vec<_> = expected.iter().filter(|(_, e)| !e["factor"].is_null()).collect();
    assert_eq!(scaled.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>(), ["degrees.esker"]);
    let nodes = expected.values().flat_map(|e| e["nodes"].as_array().unwrap());
    assert!(nodes.into_iter().any(|n| n["continuation"] == true));
}

#[test]
fn the_forest_of_the_samples_names_the_file_beside_it() {
    let open = |name: &str| EskerFile::open(&folder().join(name)).unwrap();
    let (first, second) = (open("forest-first.esker"), open("forest-second.esker"));
    let [tree] = &second.metadata().forest[..] else { panic!("one tree is named") };
    assert_eq!(tree.path, "forest-first.esker");
    assert_eq!(tree.footer_hash, first.footer().name_hash());
    assert_eq!(first.metadata().lattice, second.metadata().lattice);
}
