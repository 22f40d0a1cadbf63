//! Intake: opens the inputs, chooses lattice, schema and classes from their headers, and decodes
//! each input once into a partition. If a header was wrong (a point off the lattice, colours of
//! another depth), decoding starts again with corrected values.

use crate::budget::memory::Peak;
use crate::error::BuildError;
use crate::input::degrees;
use crate::input::known::KnownInputs;
use crate::input::outside::{Fate, fate};
use crate::input::plan::{Computed, DecodedInputs, Plan};
use crate::input::taking::{BatchPartitioner, RowCollector};
use crate::rows::journal::Journal;
use crate::rows::journal_record::{Kind, Record};
use crate::rows::partition::{BUCKETS_MAX, Partition};
use crate::rows::scratch::Scratch;
use esker_format::SET_ASIDE_MAX;
use esker_points::spread::join;
use esker_points::{Batch, ColourDepth, InputGrid, Lattice, PointClass, Spread, Task};
use esker_scan::{OpenOptions, ReadReport, ScanError, Source};
use rayon::ScopeFifo;
use rayon::prelude::*;
use std::path::PathBuf;

/// Rows that a bucket should have: few enough for the cache of a core, enough that the overhead of
/// a bucket is negligible.
const BUCKET_ROWS: u64 = 1 << 13;

/// Largest step, in the file's unit: the square of 2^32 such steps, and the distances computed in
/// drawing, are finite in `f32`.
const SCALE_MAX: f64 = 1e26;

/// The opened inputs, in byte order of their paths.
pub struct Intake {
    /// The inputs.
    pub sources: Vec<Box<dyn Source>>,
    known: KnownInputs,
    forced_depth: bool,
    /// The lattice, if it is given.
    pub lattice: Option<Lattice>,
    /// Whether points that a given lattice does not hold are refused; otherwise they are an error.
    pub drops_outside: bool,
    /// Attributes that the build computes.
    pub computed: Computed,
}

/// Why decoding must start again.
pub enum Restart {
    /// The lattice does not hold the points of this source.
    Bounds(usize),
    /// The colours of some sources are of another depth than assumed.
    Colours,
}

fn path_bytes(source: &dyn Source) -> &[u8] {
    source.info().path.as_os_str().as_encoded_bytes()
}

/// Opens all inputs; their formats are detected by content.
///
/// # Errors
/// If an input cannot be opened.
pub fn open(
    inputs: &[PathBuf],
    colour_depth: Option<ColourDepth>,
    task: &dyn Task,
) -> Result<Vec<Box<dyn Source>>, BuildError> {
    open_with(inputs, &OpenOptions { colour_depth, ..OpenOptions::default() }, task)
}

/// Opens all inputs with `options`.
///
/// # Errors
/// If an input cannot be opened.
pub fn open_with(
    inputs: &[PathBuf],
    options: &OpenOptions,
    task: &dyn Task,
) -> Result<Vec<Box<dyn Source>>, BuildError> {
    let open = |path: &PathBuf| {
        task.check()?;
        Ok(esker_scan::open(path, options, task)?)
    };
    // In parallel, since there may be thousands. Of several errors the first input's is reported.
    let opened: Vec<_> = inputs.par_iter().map(open).collect();
    opened.into_iter().collect()
}

impl Intake {
    /// Sorts opened inputs by path; `forced_depth` states that the user chose the colour depth.
    pub fn new(mut sources: Vec<Box<dyn Source>>, forced_depth: bool) -> Self {
        sources.sort_by(|a, b| path_bytes(a.as_ref()).cmp(path_bytes(b.as_ref())));
        let known = KnownInputs::of(&sources);
        Self {
            sources,
            known,
            forced_depth,
            lattice: None,
            drops_outside: false,
            computed: Computed::default(),
        }
    }

    /// Chooses the lattice unless one is given, schema and classes.
    ///
    /// # Errors
    /// If the scale or offset of an input is not a number; if [`Intake::plan_on`] fails.
    pub fn plan(&self) -> Result<Plan, BuildError> {
        let chosen = Lattice::choose(&self.known.grids)?;
        let factor = |system| degrees::factor(&system, self.known.core());
        let factor = degrees::system_of(&self.sources).map_or(chosen.factor, factor);
        self.plan_on(self.lattice.unwrap_or(Lattice { factor, ..chosen }))
    }

    /// Chooses schema and classes on a given lattice.
    ///
    /// # Errors
    /// If the inputs have more different sets of attributes than a file can distinguish; if a step
    /// of the lattice is implausibly long.
    pub fn plan_on(&self, lattice: Lattice) -> Result<Plan, BuildError> {
        self.check_scale(&lattice)?;
        Plan::new(&self.sources, &self.known.depths, lattice, self.computed)
    }

    fn check_scale(&self, lattice: &Lattice) -> Result<(), BuildError> {
        let metric = lattice.metric().scale;
        let Some(axis) = (0..3).find(|&i| metric[i] > SCALE_MAX) else { return Ok(()) };
        let grids = &self.known.grids;
        let scale = |i: &usize| grids[*i].grid.scale[axis];
        let coarsest = (0..grids.len()).max_by(|a, b| scale(a).total_cmp(&scale(b)));
        let path = coarsest.map(|i| self.sources[i].info().path.display().to_string());
        Err(BuildError::Options(format!(
            "{}: coordinates in steps of {:e} along {}, which no scan has; the file is damaged",
            path.unwrap_or_default(),
            lattice.scale[axis],
            ['x', 'y', 'z'][axis],
        )))
    }

    /// Depth of the 16-bit colours of `source`, detected or chosen by the user; `None` if it has no
    /// such colours.
    pub fn colour_depth(&self, source: usize) -> Option<ColourDepth> {
        self.sources[source].info().colour_depth.map(|_| self.known.depths[source])
    }

    /// Grid of `source`, with corrected bounds.
    pub fn grid(&self, source: usize) -> &InputGrid {
        &self.known.grids[source]
    }

    /// Points that the headers state.
    pub fn points_hint(&self) -> u64 {
        self.sources.iter().fold(0, |n, s| n.saturating_add(s.info().points_hint))
    }

    /// Points that the headers state, at most one for each bit of the inputs.
    pub fn points_likely(&self) -> u64 {
        let likely = |s: &dyn Source| match s.info().bytes {
            // A generated source has no bytes.
            0 => s.info().points_hint,
            bytes => s.info().points_hint.min(bytes.saturating_mul(8)),
        };
        self.sources.iter().fold(0, |n, s| n.saturating_add(likely(s.as_ref())))
    }

    /// Journal record of what is known of the inputs beyond their headers.
    pub fn known_record(&self) -> Record {
        self.known.record()
    }

    /// Grids and colour depths of the sources, as far as they are known.
    pub fn known(&self) -> &KnownInputs {
        &self.known
    }

    /// Sources in an order of their own, of which more is known than their headers state.
    pub fn of_known(sources: Vec<Box<dyn Source>>, known: KnownInputs, forced_depth: bool) -> Self {
        let (lattice, computed) = (None, Computed::default());
        Self { sources, known, forced_depth, lattice, drops_outside: false, computed }
    }

    /// Measures what the headers do not state exactly enough to choose a lattice.
    ///
    /// # Errors
    /// If an input is damaged, or on request.
    pub fn measure_doubtful(&mut self, task: &dyn Task) -> Result<(), BuildError> {
        self.measure_coarse_lattice(task)?;
        self.measure_latitude(task)
    }

    /// Measures the bounds of all inputs and the depth of their colours, whatever their headers
    /// state.
    ///
    /// # Errors
    /// If an input is damaged, or on request.
    pub fn measure_all(&mut self, task: &dyn Task) -> Result<(), BuildError> {
        self.measure(0, task)?;
        let lattice = self.plan()?.lattice;
        for (source, depth) in self.sources.iter().zip(&mut self.known.depths) {
            if source.info().colour_depth.is_none() || self.forced_depth {
                continue;
            }
            let placement = lattice.placement(&source.info().grid);
            let report = source.read(&placement, task, &mut |_| Ok(task.check()?))?;
            *depth = depth_of(report.colour_max).unwrap_or(*depth);
        }
        Ok(())
    }

    /// Decodes all inputs once into `partition`, on a plan that was made before.
    ///
    /// # Errors
    /// If an input is damaged, if scratch space fails, or on request; the inner error if the plan
    /// does not fit.
    pub fn decode_on(
        &self,
        plan: &Plan,
        partition: Partition,
        scratch: &mut Scratch,
        task: &dyn Task,
        peak: &Peak,
    ) -> Result<Result<DecodedInputs, Restart>, BuildError> {
        let partitioner = BatchPartitioner::new(&self.sources, &self.known, plan);
        let mut journal = Journal::none();
        let collector = RowCollector::new(&partitioner, (scratch, &mut journal), partition);
        self.read(collector, task, peak)
    }

    /// Decodes all inputs into a partition that keeps `buffer_bytes_max` in memory.
    ///
    /// # Errors
    /// If an input is damaged, if scratch space fails, or on request.
    pub fn decode(
        &mut self,
        (scratch, journal): (&mut Scratch, &mut Journal),
        buffer_bytes_max: usize,
        task: &dyn Task,
        peak: &Peak,
    ) -> Result<(Plan, DecodedInputs), BuildError> {
        let mut earlier = self.resume(journal)?;
        self.measure_coarse_lattice(task)?;
        self.measure_latitude(task)?;
        // Bounds and colours can be wrong once each, bounds again if an input changes meanwhile.
        for _ in 0..4 {
            let mut plan = self.plan()?;
            let earlier = std::mem::take(&mut earlier);
            let partitioner = BatchPartitioner::new(&self.sources, &self.known, &plan);
            let partition = self.new_partition(&plan, buffer_bytes_max);
            let files = (&mut *scratch, &mut *journal);
            let mut collector = RowCollector::new(&partitioner, files, partition);
            collector.resume(earlier)?;
            let restart = match self.read(collector, task, peak)? {
                Ok(decoded) => match self.correct_colours(&mut plan, &decoded.reports) {
                    None => return Ok((plan, decoded)),
                    Some(restart) => restart,
                },
                Err(restart) => restart,
            };
            match restart {
                Restart::Bounds(source) => {
                    let path = self.sources[source].info().path.display().to_string();
                    task.note(&format!("{path}: points lie outside its header's bounds; measuring what is left and starting again"));
                    self.measure(source, task)?;
                }
                Restart::Colours => task.note(
                    "colours are of another depth than the first points showed; starting again",
                ),
            }
            journal.append(self.known_record())?;
            scratch.clear()?;
        }
        Err(BuildError::Options("the inputs change while they are read".into()))
    }

    /// Measures all inputs if their headers' bounds need a lattice coarser than their
    /// coordinates: a header may claim more room than its points have, and the lattice
    /// must not be coarser for it.
    fn measure_coarse_lattice(&mut self, task: &dyn Task) -> Result<(), BuildError> {
        let scale = self.plan()?.lattice.scale;
        let finest = |axis: usize| {
            self.known.grids.iter().map(|g| g.grid.scale[axis]).fold(f64::INFINITY, f64::min)
        };
        if self.lattice.is_none() && (0..3).any(|axis| scale[axis] > finest(axis)) {
            task.note(
                "the inputs' bounds need a lattice coarser than their coordinates; measuring them",
            );
            task.phase("measuring", None, "points");
            let spreads: Result<Vec<Spread>, _> =
                self.sources.iter().map(|source| source.survey(task)).collect();
            let (known, spreads) = (&mut self.known, spreads?);
            for (grid, spread) in known.grids.iter_mut().zip(&spreads) {
                grid.bounds = spread.bounds();
            }
            known.measured.fill(true);
            Lattice::narrow(&mut known.grids, &spreads)?;
        }
        Ok(())
    }

    /// Measures where nearly all points are, if they are geographic and the known bounds may not be
    /// theirs: lengths depend on the latitude.
    fn measure_latitude(&mut self, task: &dyn Task) -> Result<(), BuildError> {
        let system = degrees::system_of(&self.sources).filter(|_| self.lattice.is_none());
        let known = self.known.core();
        let is_measured = self.known.core.is_some() || self.points_hint() < 2;
        let Some(system) = system.filter(|_| !is_measured) else { return Ok(()) };
        if degrees::must_be_measured(&system, known) {
            task.phase("measuring", None, "points");
            let spreads: Result<Vec<Spread>, _> =
                self.sources.iter().map(|source| source.survey(task)).collect();
            self.known.core = spreads?.iter().filter_map(Spread::core).reduce(join);
        }
        Ok(())
    }

    /// Measures the true bounds of source `from` and all after it: if one header is wrong, others
    /// may be, and each would restart decoding.
    fn measure(&mut self, from: usize, task: &dyn Task) -> Result<(), BuildError> {
        task.phase("measuring", None, "points");
        let KnownInputs { grids, measured, .. } = &mut self.known;
        let inputs = self.sources.iter().zip(grids).zip(measured).skip(from);
        for ((source, grid), is_measured) in inputs.filter(|(_, is_measured)| !**is_measured) {
            let spread = source.survey(task)?;
            grid.bounds = match self.lattice {
                Some(lattice) => spread.within_steps(lattice.scale),
                None => spread.bounds(),
            };
            *is_measured = true;
        }
        self.measure_coarse_lattice(task)
    }

    /// Restores what an earlier build knew of the inputs; returns the records of the rows that it
    /// decoded since.
    fn resume(&mut self, journal: &mut Journal) -> Result<Vec<Vec<u8>>, BuildError> {
        let mut decoded = Vec::new();
        loop {
            if let Some(known) = journal.next_if(Kind::Inputs)? {
                self.known
                    .restore(&known)
                    .ok_or_else(|| journal.damaged("what it knows of the inputs"))?;
                decoded.clear();
            } else if let Some(more) = journal.next_if(Kind::Rows)? {
                decoded.push(more);
            } else {
                return Ok(decoded);
            }
        }
    }

    /// An empty partition for all points.
    fn new_partition(&self, plan: &Plan, buffer_bytes_max: usize) -> Partition {
        let row_bytes = plan.row_bytes();
        let log2 = self.partition_log2(plan, BUCKETS_MAX as u64);
        let bytes = self.points_likely().saturating_mul(row_bytes as u64);
        let is_spilling = bytes > buffer_bytes_max as u64;
        Partition::new(row_bytes, log2, buffer_bytes_max, is_spilling)
    }

    fn read(
        &self,
        collector: RowCollector<'_>,
        task: &dyn Task,
        peak: &Peak,
    ) -> Result<Result<DecodedInputs, Restart>, BuildError> {
        task.phase("reading", Some(self.points_hint()), "points");
        rayon::in_place_scope_fifo(|scope| self.read_into(collector, scope, task, peak))
    }

    fn read_into<'s, 'a: 's>(
        &self,
        mut collector: RowCollector<'a>,
        scope: &ScopeFifo<'s>,
        task: &dyn Task,
        peak: &Peak,
    ) -> Result<Result<DecodedInputs, Restart>, BuildError> {
        let (first, mut skipped) = collector.added;
        for i in 0..first {
            task.advance(collector.reports[i].points);
        }
        let mut aside = 0;
        for (i, source) in self.sources.iter().enumerate().skip(first) {
            let placement = collector.plan().lattice.placement(&source.info().grid);
            let mut sink = |mut batch: Batch| -> Result<(), ScanError> {
                task.advance(batch.len() as u64);
                self.check_outside(i, &batch.outside, &mut aside)?;
                let known = batch.len().min(usize::try_from(skipped).unwrap_or(usize::MAX));
                skipped -= known as u64;
                batch.drop_first(known);
                if !batch.is_empty() {
                    collector.add(i, batch, scope).map_err(BuildError::through_sink)?;
                }
                peak.sample();
                Ok(task.check()?)
            };
            match source.read(&placement, task, &mut sink) {
                Ok(report) => collector.reports.push(report),
                Err(ScanError::OffLattice { .. }) => return Ok(Err(Restart::Bounds(i))),
                Err(e) => {
                    // A resumed build uses what is in scratch. The error that stopped this build is
                    // the one to report.
                    let _ = collector.record_spilled();
                    return Err(BuildError::from_sink(e));
                }
            }
            skipped = 0;
        }
        Ok(Ok(collector.finish()?))
    }

    /// Checks that points of source `i` may lie outside of the lattice; `aside` counts strays.
    fn check_outside(
        &self,
        i: usize,
        outside: &[(usize, [f64; 3])],
        aside: &mut usize,
    ) -> Result<(), ScanError> {
        let path = &self.sources[i].info().path;
        for &(_, world) in outside {
            match fate(world, self.known.grids[i].bounds) {
                Fate::Refused => continue,
                Fate::Misfit if self.drops_outside => continue,
                Fate::Misfit if self.lattice.is_some() => {
                    return Err(BuildError::misfit(path, world).through_sink());
                }
                Fate::SetAside if self.known.measured[i] => *aside += 1,
                _ => return Err(ScanError::OffLattice { path: path.clone(), world }),
            }
        }
        if *aside > SET_ASIDE_MAX {
            let error = BuildError::Options(format!(
                "{}: over {SET_ASIDE_MAX} points lie far from nearly all others, more than a file keeps; build the parts one by one",
                path.display()
            ));
            return Err(error.through_sink());
        }
        Ok(())
    }

    /// Chooses the size of the partition's cells: by the bounds, and the smaller the more points
    /// there are, up to about `cells_max` cells.
    pub fn partition_log2(&self, plan: &Plan, cells_max: u64) -> u8 {
        let (mut min, mut max) = ([u32::MAX; 3], [0u32; 3]);
        for bounds in self.known.grids.iter().filter_map(|g| g.bounds) {
            for (corner, axis) in (0..6).map(|i| (i / 3, i % 3)) {
                // `as` saturates, also for bounds that are not numbers.
                let c = plan.lattice.steps_axis(axis, bounds[corner][axis]) as u32;
                min[axis] = min[axis].min(c);
                max[axis] = max[axis].max(c);
            }
        }
        if (0..3).any(|i| min[i] > max[i]) {
            (min, max) = ([0; 3], [u32::MAX; 3]);
        }
        let buckets = (self.points_hint() / BUCKET_ROWS).clamp(64, cells_max);
        // Scans are surfaces: cells are counted on the largest side of the box. A volume fills more
        // cells, and the partition coarsens.
        let mut edges = [0, 1, 2].map(|i| u64::from(max[i] - min[i]));
        edges.sort_unstable();
        let cells = |log2: u8| ((edges[2] >> log2) + 1).saturating_mul((edges[1] >> log2) + 1);
        (0..32).rev().find(|&log2| cells(log2) >= buckets).unwrap_or(0)
    }

    /// Compares assumed colour depths with those that decoding found, and corrects the classes. If
    /// that is not possible, all inputs must be decoded again.
    fn correct_colours(&mut self, plan: &mut Plan, reports: &[ReadReport]) -> Option<Restart> {
        if self.forced_depth {
            return None;
        }
        let found = reports.iter().zip(&self.sources).map(|(report, source)| {
            source.info().colour_depth.and_then(|_| depth_of(report.colour_max))
        });
        let depths = &mut self.known.depths;
        depths.iter_mut().zip(found).for_each(|(depth, found)| *depth = found.unwrap_or(*depth));
        let is_corrected = correct_classes(&mut plan.classes, &plan.class_of, depths);
        (!is_corrected).then_some(Restart::Colours)
    }
}

/// Depth of colours of which this is the greatest value; `None` if all are black.
pub fn depth_of(colour_max: u16) -> Option<ColourDepth> {
    let depth = if colour_max <= 255 { ColourDepth::Eight } else { ColourDepth::Sixteen };
    (colour_max > 0).then_some(depth)
}

/// Gives classes the colour depth of their sources, which are of the classes `class_of`. Returns
/// whether the sources of each class agree, and no two classes are alike.
pub fn correct_classes(
    classes: &mut [PointClass],
    class_of: &[u16],
    depths: &[ColourDepth],
) -> bool {
    let mut agree = true;
    for (class, entry) in classes.iter_mut().enumerate() {
        let own = class_of.iter().zip(depths).filter(|(of, _)| usize::from(**of) == class);
        let mut depths = own.map(|(_, &depth)| depth);
        let Some(first) = depths.next() else { continue };
        if depths.all(|depth| depth == first) {
            entry.colour_depth = first;
        } else {
            agree = false;
        }
    }
    // Two classes that were assumed different may turn out equal.
    agree && !(1..classes.len()).any(|i| classes[..i].contains(&classes[i]))
}
