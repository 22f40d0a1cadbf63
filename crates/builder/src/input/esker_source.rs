//! The points of an `.esker` file as an input: pages are decoded to batches, exactly, on the file's
//! lattice. A source has one set of attributes, so each class of points is a source of its own.

use crate::error::BuildError;
use esker_format::{EskerFile, PagePoints, runs};
use esker_points::lattice::{GridKind, Placement};
use esker_points::{Batch, Grid, InputGrid, PointClass, Schema, Spread, Task};
use esker_scan::source::{BATCH_POINTS, Sink};
use esker_scan::{ReadReport, ScanError, Source, SourceInfo};
use rayon::prelude::*;
use std::ops::Range;
use std::path::PathBuf;
use std::sync::Arc;

/// Runs of points of nodes that are read together, for each thread: enough to keep all busy, few
/// enough to need little memory.
const RUNS_A_THREAD: usize = 2;

/// The points of one class of a file.
pub struct EskerSource {
    file: Arc<EskerFile>,
    class: usize,
    info: SourceInfo,
}

impl EskerSource {
    /// All points of a file, a source for each class.
    pub fn all_of(file: &Arc<EskerFile>) -> Vec<Self> {
        let classes = file.metadata().classes.iter().enumerate();
        classes.map(|(class, of)| Self::of_class(file, class, of)).collect()
    }

    /// Name of the source of a class of a file, in place of a path.
    pub fn path(file: &EskerFile, class: usize) -> PathBuf {
        let mut name = file.path().as_os_str().to_owned();
        if class > 0 {
            name.push(format!(", class {class}"));
        }
        name.into()
    }

    fn of_class(file: &Arc<EskerFile>, class: usize, of: &PointClass) -> Self {
        let metadata = file.metadata();
        let attributes = of.present.iter().map(|&i| &metadata.schema.attributes[usize::from(i)]);
        let schema = Schema { attributes: attributes.cloned().collect() };
        let lattice = metadata.lattice;
        let path = Self::path(file, class);
        let grid = InputGrid {
            name: path.display().to_string(),
            kind: GridKind::Integer,
            grid: Grid { scale: lattice.scale, offset: lattice.offset },
            bounds: metadata.bounds.map(|b| b.map(|corner| lattice.world(corner))),
        };
        let info = SourceInfo {
            path,
            format: "Esker".into(),
            grid,
            schema: Arc::new(schema),
            points_hint: file.footer().points / metadata.classes.len() as u64,
            bytes: file.footer().file_bytes,
            colour_depth: Some(of.colour_depth),
            crs: None,
            scanner: None,
            verbatim: Vec::new(),
            notes: Vec::new(),
        };
        Self { file: file.clone(), class, info }
    }

    /// The points of a node that are of this class, in batches.
    fn batches(&self, points: &PagePoints) -> Vec<Batch> {
        let own: Vec<usize> =
            (0..points.len()).filter(|&i| points.class(i) == self.class).collect();
        let present = &self.file.metadata().classes[self.class].present;
        let batch = |own: &[usize]| {
            let schema = self.info.schema.clone();
            let mut batch = Batch::with_capacity(schema.clone(), own.len());
            batch.positions.extend(own.iter().map(|&i| points.positions[i]));
            let columns = batch.columns.iter_mut().zip(present).zip(&schema.attributes);
            for ((column, &from), attribute) in columns {
                let (from, size) = (&points.columns[usize::from(from)], attribute.ty.size());
                own.iter().for_each(|&i| column.extend_from_slice(&from[i * size..][..size]));
            }
            batch
        };
        own.chunks(BATCH_POINTS).map(batch).collect()
    }
}

impl Source for EskerSource {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn read(
        &self,
        placement: &Placement,
        task: &dyn Task,
        sink: &mut Sink<'_>,
    ) -> Result<ReadReport, ScanError> {
        if *placement.lattice() != self.file.metadata().lattice {
            return Err(ScanError::unsupported(&self.info.path, "lies on another lattice"));
        }
        let mut report = ReadReport::default();
        let row_bytes = self.file.layout().schema().record_bytes();
        let nodes = (0..).zip(&self.file.table().nodes);
        let all: Vec<(u32, Range<usize>)> = nodes
            .flat_map(|(index, node)| runs(node.points(), row_bytes).map(move |run| (index, run)))
            .collect();
        for some in all.chunks(RUNS_A_THREAD * rayon::current_num_threads().max(1)) {
            task.check()?;
            let batches = some.par_iter().map(|(node, run)| {
                let points = self.file.read_page(*node).and_then(|page| {
                    let points = page.points_in(run.clone());
                    points.map_err(|fault| self.file.damaged_page(*node, fault))
                });
                points.map(|points| self.batches(&points))
            });
            let batches: Result<Vec<_>, _> = batches.collect();
            for batch in
                batches.map_err(|e| BuildError::from(e).through_sink())?.into_iter().flatten()
            {
                report.points += batch.len() as u64;
                sink(batch)?;
            }
        }
        Ok(report)
    }

    fn survey(&self, _: &dyn Task) -> Result<Spread, ScanError> {
        Ok(Spread::of(self.info.grid.bounds))
    }
}
