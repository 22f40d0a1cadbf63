//! The readers that are fuzzed, and what is done with a file: all that a build does with a scan
//! before its points become rows; all that verification and export do with an `.esker` file.

use esker_format::{Forest, verify};
use esker_points::task::Silent;
use esker_points::{Filter, Lattice};
use esker_scan::OpenOptions;
use std::path::Path;

/// A reader.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reader {
    Las,
    Laz,
    Ply,
    Pcd,
    E57,
    Ptx,
    Text,
    Mesh,
    Esker,
}

impl Reader {
    pub const ALL: [Self; 9] = [
        Self::Las,
        Self::Laz,
        Self::Ply,
        Self::Pcd,
        Self::E57,
        Self::Ptx,
        Self::Text,
        Self::Mesh,
        Self::Esker,
    ];

    pub fn name(self) -> &'static str {
        match self {
            Self::Las => "las",
            Self::Laz => "laz",
            Self::Ply => "ply",
            Self::Pcd => "pcd",
            Self::E57 => "e57",
            Self::Ptx => "ptx",
            Self::Text => "text",
            Self::Mesh => "mesh",
            Self::Esker => "esker",
        }
    }

    /// Folders of its seeds, from the crate's.
    pub fn corpus(self) -> Vec<String> {
        match self {
            Self::Esker => vec!["../../data-format/samples".into()],
            _ => vec![format!("tests/fuzz/corpus/{}", self.name())],
        }
    }

    /// Whether a file of the corpus is a seed.
    pub fn takes(self, path: &Path) -> bool {
        self != Self::Esker || path.extension().is_some_and(|ending| ending == "esker")
    }

    /// Reads a file to its end; returns whether it is sound.
    pub fn read(self, path: &Path) -> bool {
        match self {
            Self::Mesh => esker_scan::mesh::read(path, &Silent).is_ok(),
            Self::Esker => read_esker(path),
            _ => read_scan(path).is_some(),
        }
    }
}

/// Opens a scan, chooses a lattice for it, reads it, and surveys it where its bounds are wrong.
fn read_scan(path: &Path) -> Option<()> {
    let source = esker_scan::open(path, &OpenOptions::default(), &Silent).ok()?;
    let mut grid = source.info().grid.clone();
    // The second time with the true bounds.
    for _ in 0..2 {
        let lattice = Lattice::choose(std::slice::from_ref(&grid)).ok()?;
        let mut points = 0;
        let read = source.read(&lattice.placement(&grid), &Silent, &mut |batch| {
            assert!(batch.is_consistent(), "columns of a batch differ in length");
            points += batch.len() as u64;
            Ok(())
        });
        match read {
            Ok(report) => {
                assert_eq!(report.points, points, "points that the report counts");
                return Some(());
            }
            Err(error) => {
                let text = error.to_string();
                assert!(!text.contains('\n'), "an error of several lines: {text}");
                grid.bounds = source.survey(&Silent).ok()?;
            }
        }
    }
    None
}

/// Verifies an `.esker` file, and exports it as text.
fn read_esker(path: &Path) -> bool {
    let Ok(forest) = Forest::open(path) else { return false };
    let is_sound = forest.files().all(|file| verify(file, &Silent).is_ok());
    let out = path.with_extension("csv");
    let exported = esker_builder::export(&forest, &out, &Filter::default(), &Silent);
    assert!(!is_sound || exported.is_ok() || forest.points() == 0, "a sound file is not exported");
    let _ = std::fs::remove_file(out);
    is_sound
}
