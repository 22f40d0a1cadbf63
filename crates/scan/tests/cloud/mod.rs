//! Reads whole files for the tests: every point and attribute, checked against the bounds.

#![allow(dead_code, reason = "each test needs other parts")]

use esker_points::AttrType;
use esker_points::lattice::{GridKind, Lattice};
use esker_points::spread::NO_VALUE_MIN;
use esker_points::task::Silent;
use esker_scan::{OpenOptions, ReadReport, ScanError, SourceInfo};
use std::path::Path;

pub struct Cloud {
    pub info: SourceInfo,
    pub report: ReadReport,
    pub world: Vec<[f64; 3]>,
    pub columns: Vec<Vec<u8>>,
}

impl Cloud {
    pub fn column(&self, name: &str) -> (AttrType, Vec<f64>) {
        let i = self.info.schema.find(name).unwrap_or_else(|| panic!("no attribute {name}"));
        let ty = self.info.schema.attributes[i].ty;
        (ty, self.columns[i].chunks_exact(ty.size()).map(|v| ty.to_f64(v)).collect())
    }

    /// The bytes of the value of a point in a column.
    pub fn column_at(&self, name: &str, row: usize) -> &[u8] {
        let i = self.info.schema.find(name).unwrap();
        let size = self.info.schema.attributes[i].ty.size();
        &self.columns[i][row * size..][..size]
    }

    /// The bytes of a column.
    pub fn bytes(&self, name: &str) -> &[u8] {
        &self.columns[self.info.schema.find(name).unwrap()]
    }

    /// Names and types of the attributes.
    pub fn keys(&self) -> Vec<(&str, AttrType)> {
        self.info.schema.attributes.iter().map(|a| a.key()).collect()
    }

    /// Names of the attributes.
    pub fn names(&self) -> Vec<&str> {
        self.keys().into_iter().map(|(name, _)| name).collect()
    }

    /// Names and types of the attributes, in one line.
    pub fn types(&self) -> String {
        let words: Vec<_> =
            self.keys().iter().map(|(name, ty)| format!("{name}:{}", ty.name())).collect();
        words.join(" ")
    }

    /// Number of points refused for a reason.
    pub fn refused(&self, reason: &str) -> u64 {
        self.report.refused.get(reason).copied().unwrap_or(0)
    }

    /// Whether the points are at these positions, within the reported rounding.
    pub fn lies_at(&self, places: &[[f64; 3]]) -> bool {
        let slack = self.report.rounding_error_max * (1.0 + 1e-9);
        let near = |(a, b): (&[f64; 3], &[f64; 3])| {
            (0..3).all(|i| (a[i] - b[i]).abs() <= slack + b[i].abs() * 4.0 * f64::EPSILON)
        };
        self.world.len() == places.len() && self.world.iter().zip(places).all(near)
    }
}

/// Reads a file twice: on the lattice, and for its bounds alone.
pub fn read_path(path: &Path) -> Result<Cloud, ScanError> {
    read_path_with(path, &OpenOptions::default())
}

/// [`read_path`] with options.
pub fn read_path_with(path: &Path, options: &OpenOptions) -> Result<Cloud, ScanError> {
    let source = esker_scan::open(path, options, &Silent)?;
    let info = source.info().clone();
    let lattice = Lattice::choose(std::slice::from_ref(&info.grid)).unwrap();
    let mut strays = 0;
    let (mut world, mut columns) = (Vec::new(), vec![Vec::new(); info.schema.attributes.len()]);
    let report = source.read(&lattice.placement(&info.grid), &Silent, &mut |batch| {
        assert!(batch.is_consistent() && batch.len() <= esker_scan::source::BATCH_POINTS);
        let first = world.len();
        world.extend(batch.positions.iter().map(|&p| lattice.world(p)));
        batch.outside.iter().for_each(|&(i, place)| world[first + i] = place);
        strays += batch.outside.len();
        for (all, column) in columns.iter_mut().zip(&batch.columns) {
            all.extend_from_slice(column);
        }
        Ok(())
    })?;
    assert_eq!(report.points, world.len() as u64);
    let bounds = source.survey(&Silent)?.bounds();
    assert_eq!(bounds.is_some(), !world.is_empty());
    if info.grid.kind != GridKind::Integer {
        assert!(strays > 0 || info.grid.bounds == bounds, "nothing corrects them");
    }
    if let Some([low, high]) = bounds {
        let slack = |i: usize| {
            let noise = low[i].abs().max(high[i].abs()) * 4.0 * f64::EPSILON;
            report.rounding_error_max + noise
        };
        let within =
            |p: &[f64; 3]| (0..3).all(|i| low[i] - slack(i) <= p[i] && p[i] <= high[i] + slack(i));
        for i in 0..3 {
            let touches = |end: f64| world.iter().any(|p| (p[i] - end).abs() <= slack(i));
            assert!(touches(low[i]) && touches(high[i]), "{low:?} to {high:?} is too wide");
        }
        let is_none = |p: &&[f64; 3]| p.iter().any(|c| c.abs() >= NO_VALUE_MIN);
        let out = world.iter().find(|p| !(within(p) || strays > 0 && is_none(p)));
        assert_eq!(out, None, "{low:?} to {high:?} but for {}", report.rounding_error_max);
    }
    Ok(Cloud { info, report, world, columns })
}

/// Reads bytes as a file whose name does not fit: the content decides.
pub fn read(bytes: impl AsRef<[u8]>) -> Result<Cloud, ScanError> {
    read_with(bytes, &OpenOptions::default())
}

/// [`read`] with options.
pub fn read_with(bytes: impl AsRef<[u8]>, options: &OpenOptions) -> Result<Cloud, ScanError> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("cloud.las");
    std::fs::write(&path, bytes).unwrap();
    read_path_with(&path, options)
}

/// The error of reading bytes, checked to be one line that names the file.
pub fn error(bytes: impl AsRef<[u8]>) -> String {
    let error = read(bytes).err().expect("an error").to_string();
    assert!(error.contains("cloud.las: ") && !error.contains('\n'), "{error}");
    error
}

/// Whether reading succeeded or ended in an error of one line.
pub fn is_error_one_line(read: Result<Cloud, ScanError>) -> bool {
    read.err().is_none_or(|error| !error.to_string().contains('\n'))
}
