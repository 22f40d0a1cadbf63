//! Inputs given point by point, of any schema, with headers that may be wrong; and the check that a
//! build has lost no point, by sums of its own.
#![allow(
    dead_code,
    clippy::unwrap_used,
    reason = "each test file uses a part of it; tests may unwrap"
)]

use esker_builder::{Options, Report, against_sources, build_sources};
use esker_format::EskerFile;
use esker_points::hash::layout_seed;
use esker_points::lattice::{GridKind, Placement};
use esker_points::task::Silent;
use esker_points::{AttrType, Attribute, Batch, Grid, InputGrid, MultisetHash, Rounding};
use esker_points::{ColourDepth, attribute::names};
use esker_points::{Schema, Spread, Task};
use esker_scan::source::{BATCH_POINTS, Sink};
use esker_scan::{ReadReport, ScanError, Source, SourceInfo};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// An input whose points are in memory.
#[derive(Clone)]
pub struct Given {
    pub info: SourceInfo,
    /// Raw coordinates.
    pub positions: Vec<[i32; 3]>,
    /// One column an attribute, as in a batch.
    pub columns: Vec<Vec<u8>>,
}

/// Makes an input without attributes, with correct bounds.
pub fn given(name: &str, scale: [f64; 3], positions: Vec<[i32; 3]>) -> Given {
    let grid = Grid { scale, offset: [0.0; 3] };
    let mut given = Given {
        info: SourceInfo {
            path: PathBuf::from(name),
            format: "given".into(),
            grid: InputGrid { name: name.into(), kind: GridKind::Integer, grid, bounds: None },
            schema: Arc::new(Schema::default()),
            points_hint: positions.len() as u64,
            bytes: 0,
            colour_depth: None,
            crs: None,
            scanner: None,
            verbatim: Vec::new(),
            notes: Vec::new(),
        },
        positions,
        columns: Vec::new(),
    };
    given.info.grid.bounds = given.bounds();
    given
}

impl Given {
    /// Adds an attribute whose value is `value` of the index of a point, truncated to the size of
    /// the type.
    pub fn with(mut self, name: &str, ty: AttrType, value: impl Fn(u64) -> u64) -> Self {
        let old = self.info.schema.attributes.clone();
        let all = Schema::new([old.clone(), vec![Attribute::new(name, ty)]].concat());
        let column = (0..self.positions.len() as u64)
            .flat_map(|i| value(i).to_le_bytes()[..ty.size()].to_vec())
            .collect();
        let at = all.find_typed(name, ty).unwrap();
        self.columns.insert(at, column);
        assert_eq!(all.attributes.len(), old.len() + 1);
        self.info.schema = Arc::new(all);
        self
    }

    /// Moves the grid to `offset`.
    pub fn at(mut self, offset: [f64; 3]) -> Self {
        self.info.grid.grid.offset = offset;
        self.info.grid.bounds = self.bounds();
        self
    }

    /// Claims other bounds than the points have.
    pub fn claiming(mut self, bounds: Option<[[f64; 3]; 2]>) -> Self {
        self.info.grid.bounds = bounds;
        self
    }

    /// Claims a colour depth, as detected from the first points.
    pub fn coloured(mut self, depth: ColourDepth) -> Self {
        self.info.colour_depth = Some(depth);
        self
    }

    pub fn boxed(&self) -> Box<dyn Source> {
        Box::new(self.clone())
    }

    fn bounds(&self) -> Option<[[f64; 3]; 2]> {
        let (mut low, mut high) = ([i32::MAX; 3], [i32::MIN; 3]);
        for p in &self.positions {
            low = [0, 1, 2].map(|i| low[i].min(p[i]));
            high = [0, 1, 2].map(|i| high[i].max(p[i]));
        }
        let Grid { scale, offset } = self.info.grid.grid;
        let world = |p: [i32; 3]| [0, 1, 2].map(|i| f64::from(p[i]) * scale[i] + offset[i]);
        (!self.positions.is_empty()).then(|| [world(low), world(high)])
    }

    fn colour_max(&self) -> u16 {
        let names = [names::RED, names::GREEN, names::BLUE];
        let colours = names.iter().filter_map(|n| self.info.schema.find_typed(n, AttrType::U16));
        let values = colours.flat_map(|i| self.columns[i].chunks_exact(2));
        values.map(|v| u16::from_le_bytes([v[0], v[1]])).max().unwrap_or(0)
    }
}

impl Source for Given {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn read(
        &self,
        placement: &Placement,
        task: &dyn Task,
        sink: &mut Sink<'_>,
    ) -> Result<ReadReport, ScanError> {
        let mut report = ReadReport { colour_max: self.colour_max(), ..Default::default() };
        for first in (0..self.positions.len()).step_by(BATCH_POINTS) {
            task.check()?;
            let n = (self.positions.len() - first).min(BATCH_POINTS);
            let mut batch = Batch::with_capacity(self.info.schema.clone(), n);
            let mut rounding = Rounding::default();
            for &p in &self.positions[first..first + n] {
                let place = placement.integer(p, &self.info.grid.grid, &mut rounding);
                batch.positions.push(place);
            }
            report.rounding_error_max = report.rounding_error_max.max(rounding.error_max);
            batch.outside = rounding.outside;
            let sizes = self.info.schema.attributes.iter().map(|a| a.ty.size());
            let part = |(column, size): (&Vec<u8>, usize)| {
                column[first * size..(first + n) * size].to_vec()
            };
            batch.columns = self.columns.iter().zip(sizes).map(part).collect();
            assert!(batch.is_consistent());
            sink(batch)?;
            report.points += n as u64;
        }
        Ok(report)
    }

    fn survey(&self, _task: &dyn Task) -> Result<Spread, ScanError> {
        let mut spread = Spread::default();
        self.positions.iter().for_each(|&p| spread.add(self.info.grid.grid.world(p)));
        Ok(spread)
    }
}

/// Multiset hash of inputs on the lattice of a file, by its definition.
pub fn hash_of(sources: &[Given], file: &EskerFile) -> MultisetHash {
    let mut hash = MultisetHash::default();
    for source in sources {
        let seed = layout_seed(source.info.schema.attributes.iter().map(|a| a.key()));
        let placement = file.metadata().lattice.placement(&source.info.grid);
        let mut record = Vec::new();
        let mut sink = |batch: Batch| {
            for i in 0..batch.len() {
                record.clear();
                batch.record_into(i, &mut record);
                hash.add(seed, &record);
            }
            Ok(())
        };
        source.read(&placement, &Silent, &mut sink).unwrap();
    }
    hash
}

pub fn boxed(sources: &[Given]) -> Vec<Box<dyn Source>> {
    sources.iter().map(Given::boxed).collect()
}

/// Names of the files in a folder.
pub fn names_in(folder: &Path) -> Vec<String> {
    let name =
        |e: std::io::Result<std::fs::DirEntry>| e.unwrap().file_name().into_string().unwrap();
    std::fs::read_dir(folder).unwrap().map(name).collect()
}

/// Builds inputs and checks that all points are in the file: verified, counted, with the hash of
/// the inputs, and compared with them.
pub fn whole(sources: &[Given], options: &Options) -> (Report, EskerFile) {
    whole_by(sources, |out| build_sources(boxed(sources), out, options, &Silent).unwrap())
}

/// Variant of [`whole`] with another way to build.
pub fn whole_by(sources: &[Given], build: impl FnOnce(&Path) -> Report) -> (Report, EskerFile) {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out.esker");
    let report = build(&out);
    assert_eq!(names_in(folder.path()), ["out.esker"], "nothing else may be left");
    let file = EskerFile::open(&out).unwrap();
    let count: usize = sources.iter().map(|s| s.positions.len()).sum();
    assert_eq!((report.points_in, report.points_out), (count as u64, count as u64));
    let verified = esker_format::verify(&file, &Silent).unwrap();
    assert_eq!(verified.points, count as u64);
    assert_eq!(verified.nodes, report.nodes);
    assert_eq!(verified.bytes, report.bytes_out);
    assert_eq!(verified.hash, hash_of(sources, &file));
    assert_eq!(report.hash, verified.hash);
    let against = against_sources(&file, boxed(sources), &Silent).unwrap();
    assert_eq!((against.points, against.hash), (count as u64, verified.hash));
    let capacity = file.metadata().node_capacity as usize;
    assert!(file.table().nodes.iter().all(|n| n.points() <= capacity), "a node is overfull");
    (report, file)
}
