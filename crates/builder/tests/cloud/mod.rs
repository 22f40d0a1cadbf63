//! Clouds made in memory, as inputs of builds under test.
#![allow(
    dead_code,
    clippy::unwrap_used,
    reason = "each test file uses a part of it; tests may unwrap"
)]

use esker_format::EskerFile;
use esker_points::lattice::{GridKind, Placement};
use esker_points::task::Silent;
use esker_points::{AttrType, Attribute, Batch, Column, Grid, InputGrid, Rounding, Schema};
use esker_points::{Spread, Task};
use esker_scan::source::{BATCH_POINTS, Sink};
use esker_scan::{ReadReport, ScanError, Source, SourceInfo};
use std::path::PathBuf;
use std::sync::Arc;

/// A cloud of raw positions by index, with an intensity and a GPS time that distinguish points.
pub struct Cloud<F> {
    info: SourceInfo,
    count: u64,
    position: F,
}

/// Makes a cloud of `count` points on a grid of this scale.
pub fn cloud<F: Fn(u64) -> [i32; 3] + Send + Sync + 'static>(
    name: &str,
    scale: f64,
    count: u64,
    position: F,
) -> Box<dyn Source> {
    cloud_on(name, [scale; 3], count, position)
}

/// Makes a cloud of `count` points on a grid with these steps.
pub fn cloud_on<F: Fn(u64) -> [i32; 3] + Send + Sync + 'static>(
    name: &str,
    scale: [f64; 3],
    count: u64,
    position: F,
) -> Box<dyn Source> {
    let grid = Grid { scale, offset: [0.0; 3] };
    let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for i in 0..count {
        for (axis, c) in position(i).into_iter().enumerate() {
            low[axis] = low[axis].min(f64::from(c) * scale[axis]);
            high[axis] = high[axis].max(f64::from(c) * scale[axis]);
        }
    }
    let schema = Schema::new(vec![
        Attribute::new("intensity", AttrType::U16),
        Attribute::new("gps_time", AttrType::F64),
    ]);
    Box::new(Cloud {
        info: SourceInfo {
            path: PathBuf::from(name),
            format: "made".into(),
            grid: InputGrid {
                name: name.into(),
                kind: GridKind::Integer,
                grid,
                bounds: Some([low, high]),
            },
            schema: Arc::new(schema),
            points_hint: count,
            bytes: 0,
            colour_depth: None,
            crs: None,
            scanner: None,
            verbatim: Vec::new(),
            notes: Vec::new(),
        },
        count,
        position,
    })
}

impl<F: Fn(u64) -> [i32; 3] + Send + Sync> Source for Cloud<F> {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn read(
        &self,
        placement: &Placement,
        task: &dyn Task,
        sink: &mut Sink<'_>,
    ) -> Result<ReadReport, ScanError> {
        let mut report = ReadReport::default();
        let mut next = 0;
        while next < self.count {
            task.check()?;
            let n = (self.count - next).min(BATCH_POINTS as u64);
            let mut batch = Batch::with_capacity(self.info.schema.clone(), n as usize);
            let mut rounding = Rounding::default();
            let (mut time, mut intensity) = (Column::new(), Column::new());
            for i in next..next + n {
                let (own, grid) = ((self.position)(i), &self.info.grid.grid);
                batch.positions.push(placement.integer(own, grid, &mut rounding));
                time.extend(((i / 3) as f64).to_le_bytes());
                intensity.extend(((i % 7) as u16).to_le_bytes());
            }
            report.rounding_error_max = report.rounding_error_max.max(rounding.error_max);
            batch.outside = rounding.outside;
            batch.columns = vec![time, intensity];
            sink(batch)?;
            next += n;
            report.points = next;
        }
        Ok(report)
    }

    fn survey(&self, _task: &dyn Task) -> Result<Spread, ScanError> {
        Ok(Spread::of(self.info.grid.bounds))
    }
}

/// Builds in a folder of its own. Returns the report, the opened file and the folder.
pub fn built(
    sources: Vec<Box<dyn Source>>,
    options: &esker_builder::Options,
) -> (esker_builder::Report, EskerFile, tempfile::TempDir) {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out.esker");
    let report = esker_builder::build_sources(sources, &out, options, &Silent).unwrap();
    let names: Vec<_> =
        std::fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert_eq!(names, ["out.esker"], "nothing else may be left");
    (report, EskerFile::open(&out).unwrap(), folder)
}

/// Hash of a number (`steele2014`).
pub fn random(seed: u64) -> u64 {
    let mut z = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// A number from 0 to `n - 1`.
pub fn below(seed: u64, n: u32) -> i32 {
    (((random(seed) >> 32) * u64::from(n)) >> 32) as i32
}
