//! How vertices become points: which properties are coordinates, the names of attributes and, after
//! one pass over the vertices, the grid. Serves PLY and PCD.

use super::ascii::parse_line;
use super::comments;
use super::header::{Element, Encoding, Header, Shape};
use super::records::{Field, Raw, Record};
use super::rest::Rest;
use crate::error::ScanError;
use crate::fields::recipe::Recipe;
use crate::fields::values::Values;
use crate::fields::{self, Column, LEGACY, LEGACY_BLOCK, Writer};
use crate::las::{self, GpsTimes};
use crate::pcd::packed::Packed;
use crate::pose::Pose;
use crate::text::naming::{NOT_FINITE, axes, colour_max};
use esker_points::attribute::names;
use esker_points::lattice::{Grid, GridKind, Placement, decimal_grid, float_grid};
use esker_points::spread::Corners;
use esker_points::{AttrType, Batch, Rounding, Schema, Spread};
use std::path::Path;
use std::sync::Arc;

/// Greatest number of digits after the point for which decimal text gets a decimal grid.
const DECIMALS_MAX: u32 = 15;
/// Greatest number of steps of a decimal grid that `f64` safely distinguishes.
const STEPS_MAX: f64 = 9.0e15;

/// How the records of a file are read.
#[derive(Clone, Debug)]
pub(crate) struct RecordPlan {
    /// Index of the element with the vertices.
    pub vertex: usize,
    pub encoding: Encoding,
    /// Layout of a record. Coordinates of ASCII files are `f64`, because they are decimals, unless
    /// [`RecordPlan::as_declared`] was called.
    pub record: Record,
    /// Fields of x, y and z.
    axes: [usize; 3],
    /// Fields whose values decide what they mean.
    watched: Vec<usize>,
    /// The attributes, after [`RecordPlan::choose_grid`].
    pub schema: Arc<Schema>,
    /// How each attribute of the schema is made from the fields of a record.
    recipes: Vec<Recipe>,
    /// What is converted or assumed, a line each.
    pub notes: Vec<String>,
    /// Greatest value of 16-bit colours, whose fields may all be dark.
    pub colour_max: u16,
    are_colours_full: bool,
    is_legacy: bool,
    /// Who wrote the file, as far as its header shows that.
    writer: Writer,
    /// Epoch of GPS times that the header states.
    stated_times: Option<GpsTimes>,
    /// The block of the epoch of GPS times.
    times: Option<(String, Vec<u8>)>,
    /// Pose by which points and normals are transformed, and the digits after the point that its
    /// position needs.
    pose: Option<(Pose, [u32; 3])>,
}

/// What one pass over vertices finds.
#[derive(Clone, Debug, Default)]
pub(crate) struct Survey {
    /// Number of vertices, with and without a finite position.
    pub vertices: u64,
    /// Distribution of the points with a finite position, in world coordinates.
    pub spread: Spread,
    decimals: [u32; 3],
    /// Values of the watched fields, in their order.
    values: Vec<Values>,
    /// What follows the last point, if the header promises no other elements.
    pub rest: Option<Rest>,
    /// Packed colours of type F in a PCD file.
    pub packed: Packed,
}

impl Survey {
    pub fn merge(&mut self, other: Self) {
        self.vertices += other.vertices;
        self.spread.merge(other.spread);
        self.packed.merge(other.packed);
        for (decimals, other) in self.decimals.iter_mut().zip(other.decimals) {
            *decimals = (*decimals).max(other);
        }
        if self.values.len() < other.values.len() {
            self.values.resize(other.values.len(), Values::empty(true));
        }
        for (values, other) in self.values.iter_mut().zip(&other.values) {
            values.merge(other);
        }
    }

    /// The decimal grid of the text, if all digits of nearly all points fit a lattice.
    fn decimal_grid(&self) -> Option<(Grid, Corners)> {
        let grid = decimal_grid(self.decimals);
        let bounds = self.spread.within_steps(grid.scale)?;
        let [lo, hi] = bounds;
        let fits = |i: usize| {
            let steps = |length: f64| length / grid.scale[i];
            self.decimals[i] <= DECIMALS_MAX
                && steps(hi[i] - lo[i]) <= f64::from(u32::MAX) - 2.0
                && steps(lo[i].abs().max(hi[i].abs())) < STEPS_MAX
        };
        (0..3).all(fits).then_some((grid, bounds))
    }
}

/// The points decoded from a block, and the number of refused ones.
pub(crate) struct Decoded {
    pub batch: Batch,
    pub not_finite: u64,
    pub rounding: Rounding,
    pub colour_max: u16,
}

impl Decoded {
    /// The reason for which points are refused.
    pub const REASON: &'static str = NOT_FINITE;
}

impl RecordPlan {
    /// Finds coordinates and attributes.
    ///
    /// # Errors
    /// If there is no vertex element, or if it lacks a coordinate.
    pub fn new(header: &Header) -> Result<Self, String> {
        let is_vertex = |e: &Element| e.name.eq_ignore_ascii_case("vertex");
        let vertex = header
            .elements
            .iter()
            .position(is_vertex)
            .ok_or("has no element `vertex`: no points")?;
        let plan = Self::of_element(&header.elements[vertex], header.encoding)
            .ok_or("its vertices lack x, y or z (as numbers, not lists): no points")?;
        let is_own = comments::is_by_esker(&header.text);
        let writer = if is_own { Writer::Esker } else { Writer::Any };
        let stated_times = comments::times_of(&header.text);
        Ok(Self { vertex, writer, stated_times, ..plan })
    }

    /// RecordPlan of a file with a single element; `None` if the element lacks a coordinate.
    pub fn of_element(element: &Element, encoding: Encoding) -> Option<Self> {
        let scalars: Vec<(&str, AttrType)> = scalars(element).collect();
        let axes = axes(scalars.iter().map(|(name, _)| *name))?;
        let is_watched = |f: &usize| {
            let (name, ty) = scalars[*f];
            !axes.contains(f) && fields::is_watched_as(name, ty)
        };
        let watched = (0..scalars.len()).filter(is_watched).collect();
        let ascii = encoding == Encoding::Ascii;
        let types = scalars
            .iter()
            .enumerate()
            .map(|(f, &(_, ty))| if ascii && axes.contains(&f) { AttrType::F64 } else { ty });
        Some(Self {
            vertex: 0,
            encoding,
            record: Record::new(types),
            axes,
            watched,
            schema: Arc::default(),
            recipes: Vec::new(),
            notes: Vec::new(),
            colour_max: 0,
            are_colours_full: false,
            is_legacy: false,
            writer: Writer::Any,
            stated_times: None,
            times: None,
            pose: None,
        })
    }

    /// Transforms points and normals by `pose` from now on; `decimals` are the digits after the
    /// point that its position needs.
    pub fn apply(&mut self, pose: Pose, decimals: [u32; 3]) {
        self.pose = Some((pose, decimals));
    }

    /// Chooses the attributes after the survey.
    fn choose_attributes(&mut self, element: &Element, survey: &Survey) {
        let scalars: Vec<(&str, AttrType)> = scalars(element).collect();
        let others: Vec<usize> = (0..scalars.len()).filter(|f| !self.axes.contains(f)).collect();
        let column = |&f: &usize| {
            let watched = self.watched.iter().position(|w| *w == f);
            let none = watched.map_or(Values::unknown(), |_| Values::empty(true));
            let values = watched.and_then(|w| survey.values.get(w)).copied().unwrap_or(none);
            Column { name: scalars[f].0, ty: Some(scalars[f].1), values, type_with_gaps: None }
        };
        let columns: Vec<Column<'_>> = others.iter().map(column).collect();
        let plan = fields::plan(&columns, self.writer);
        self.schema = plan.schema;
        self.recipes = plan.recipes.into_iter().map(|r| r.of_columns(&others)).collect();
        self.notes = plan.notes;
        self.colour_max = plan.colour_max;
        self.are_colours_full = plan.are_colours_full;
        self.is_legacy = plan.is_legacy;
        let (times, note) = las::times_block(self.stated_times, plan.are_times_beyond_week);
        self.times =
            times.filter(|_| self.schema.find_typed(names::GPS_TIME, AttrType::F64).is_some());
        self.notes.extend(note);
    }

    /// The blocks kept for an export: the header under this name, and what its fields are.
    pub fn verbatim(&self, name: &str, header: &[u8]) -> Vec<(String, Vec<u8>)> {
        let mut blocks = vec![(name.to_owned(), header.to_vec())];
        if self.is_legacy {
            blocks.push((LEGACY_BLOCK.into(), LEGACY.to_vec()));
        }
        blocks.extend(self.times.clone());
        blocks
    }

    /// Chooses attributes and grid after the survey. Decimal text keeps its digits if they fit a
    /// lattice of 32 bits. Otherwise, and for binary numbers, it is the grid for floats; the
    /// coordinates of ASCII files are then read as their declared type.
    pub fn choose_grid(
        &mut self,
        element: &Element,
        survey: &Survey,
    ) -> (GridKind, Grid, Option<Corners>) {
        self.choose_attributes(element, survey);
        let is_turned = self.pose.is_some_and(|(pose, _)| pose.is_turned);
        if self.encoding == Encoding::Ascii {
            let mut survey = survey.clone();
            for (digits, more) in
                survey.decimals.iter_mut().zip(self.pose.unwrap_or((Pose::NONE, [0; 3])).1)
            {
                *digits = (*digits).max(more);
            }
            if let Some((grid, bounds)) = survey.decimal_grid().filter(|_| !is_turned) {
                return (GridKind::Decimal, grid, Some(bounds));
            }
            if self.pose.is_none() {
                self.as_declared(element);
            }
        }
        if self.pose.is_some() {
            // Transformed positions are doubles, whatever the type of the coordinates.
            let (grid, bounds) = float_grid(&survey.spread, false);
            return (GridKind::Float, grid, bounds);
        }
        let (grid, bounds) = float_grid(&survey.spread, self.are_single());
        (GridKind::Float, grid, bounds.map(|b| b.map(|corner| self.rounded(corner))))
    }

    /// Reads single-precision coordinates of an ASCII file as such from now on.
    fn as_declared(&mut self, element: &Element) {
        let types: Vec<AttrType> = scalars(element)
            .enumerate()
            .map(|(f, (_, ty))| match ty {
                AttrType::F32 => ty,
                _ => self.record.fields[f].ty,
            })
            .collect();
        self.record = Record::new(types.into_iter());
    }

    /// Whether all coordinates are singles, or fit singles.
    fn are_single(&self) -> bool {
        self.axes.iter().all(|&axis| {
            !matches!(
                self.record.fields[axis].ty,
                AttrType::F64 | AttrType::U32 | AttrType::I32 | AttrType::U64 | AttrType::I64
            )
        })
    }

    /// Rounds a position to the types of the coordinates.
    fn rounded(&self, corner: [f64; 3]) -> [f64; 3] {
        [0, 1, 2].map(|i| match self.record.fields[self.axes[i]].ty {
            AttrType::F32 => f64::from(corner[i] as f32),
            _ => corner[i],
        })
    }

    /// The records of a block, little-endian.
    fn records(
        &self,
        path: &Path,
        element: &Element,
        raw: Raw,
        mut on_scalar: impl FnMut(usize, &[u8]),
    ) -> Result<Vec<u8>, ScanError> {
        match raw {
            Raw::Binary(mut bytes) => {
                if self.encoding == Encoding::BigEndian {
                    self.record.swap_bytes(&mut bytes);
                }
                Ok(bytes)
            }
            Raw::Lines { block, skip, rows } => {
                let mut out = Vec::new();
                for (n, line) in block.lines().skip(skip as usize).take(rows as usize) {
                    parse_line(line, element, &self.record, &mut out, &mut on_scalar)
                        .map_err(|why| ScanError::damaged(path, format!("line {n} {why}")))?;
                }
                Ok(out)
            }
        }
    }

    fn world(&self, record: &[u8]) -> [f64; 3] {
        let own = self.axes.map(|a| value(record, self.record.fields[a]));
        self.pose.map_or(own, |(pose, _)| pose.placed(own))
    }

    /// Surveys a block.
    ///
    /// # Errors
    /// If a line of an ASCII file is not what the header says.
    pub fn survey(&self, path: &Path, element: &Element, raw: Raw) -> Result<Survey, ScanError> {
        let mut found = Survey::default();
        let records = self.records(path, element, raw, |field, word| {
            self.add_decimals(field, word, &mut found);
        })?;
        self.survey_records(&records, &mut found);
        Ok(found)
    }

    /// Adds the decimals of the word of a field to a survey.
    pub fn add_decimals(&self, field: usize, word: &[u8], found: &mut Survey) {
        if let Some(i) = self.axes.iter().position(|&a| a == field) {
            found.decimals[i] = found.decimals[i].max(crate::text::number::decimals(word));
        }
    }

    /// Adds whole little-endian records to a survey.
    pub fn survey_records(&self, records: &[u8], found: &mut Survey) {
        found.values.resize(self.watched.len(), Values::empty(true));
        found.vertices += (records.len() / self.record.stride) as u64;
        for record in records.chunks_exact(self.record.stride) {
            let world = self.world(record);
            if !world.iter().all(|c| c.is_finite()) {
                continue;
            }
            found.spread.add(world);
            for (values, &field) in found.values.iter_mut().zip(&self.watched) {
                values.add(value(record, self.record.fields[field]));
            }
        }
    }

    /// Decodes the points of a block to the lattice.
    ///
    /// # Errors
    /// If a line of an ASCII file is not what the header says.
    pub fn decode(
        &self,
        path: &Path,
        element: &Element,
        raw: Raw,
        placement: &Placement,
    ) -> Result<Decoded, ScanError> {
        let records = self.records(path, element, raw, |_, _| {})?;
        self.decode_records(path, &records, placement)
    }

    /// Decodes the points of whole little-endian records to the lattice.
    ///
    /// # Errors
    /// If the file changed since it was surveyed.
    pub fn decode_records(
        &self,
        path: &Path,
        records: &[u8],
        placement: &Placement,
    ) -> Result<Decoded, ScanError> {
        let stride = self.record.stride;
        let mut batch = Batch::with_capacity(self.schema.clone(), records.len() / stride);
        let (mut not_finite, mut rounding) = (0, Rounding::default());
        let mut kept = Vec::with_capacity(records.len() / stride);
        for record in records.chunks_exact(stride) {
            let world = self.world(record);
            if !world.iter().all(|c| c.is_finite()) {
                not_finite += 1;
                continue;
            }
            batch.positions.push(placement.real(world, &mut rounding));
            kept.push(record);
        }
        let attributes = self.schema.attributes.iter().zip(&self.recipes);
        for ((attribute, recipe), column) in attributes.zip(&mut batch.columns) {
            if let Recipe::Same(source) = *recipe {
                let Field { ty, offset } = self.record.fields[source];
                for record in &kept {
                    column.extend_from_slice(&record[offset..][..ty.size()]);
                }
                continue;
            }
            for record in &kept {
                let number = |field: usize| value(record, self.record.fields[field]);
                if !recipe.put(attribute.ty, number, column) {
                    return Err(ScanError::damaged(path, "it changed while it was read"));
                }
            }
        }
        if let Some((pose, _)) = self.pose.filter(|(pose, _)| pose.is_turned) {
            turn_normals(&mut batch, pose);
        }
        let colour_max = match self.are_colours_full && !batch.is_empty() {
            true => u16::MAX,
            false => colour_max(&batch),
        };
        Ok(Decoded { batch, not_finite, rounding, colour_max })
    }
}

/// Turns the normals of a batch by `pose`, if it has any.
fn turn_normals(batch: &mut Batch, pose: Pose) {
    let index = |name: &str| {
        let found = batch.schema.attributes.iter().position(|a| a.name == name)?;
        let ty = batch.schema.attributes[found].ty;
        matches!(ty, AttrType::F32 | AttrType::F64).then_some((found, ty))
    };
    let [Some(x), Some(y), Some(z)] = [names::NX, names::NY, names::NZ].map(index) else { return };
    for i in 0..batch.positions.len() {
        let at = |ty: AttrType| i * ty.size()..(i + 1) * ty.size();
        let own = [x, y, z].map(|(column, ty)| ty.to_f64(&batch.columns[column][at(ty)]));
        for ((column, ty), value) in [x, y, z].into_iter().zip(pose.turned(own)) {
            let target = &mut batch.columns[column][at(ty)];
            match ty {
                AttrType::F32 => target.copy_from_slice(&(value as f32).to_le_bytes()),
                _ => target.copy_from_slice(&value.to_le_bytes()),
            }
        }
    }
}

fn scalars(element: &Element) -> impl Iterator<Item = (&str, AttrType)> {
    element.properties.iter().filter_map(|p| match p.shape {
        Shape::Scalar(ty) => Some((p.name.as_str(), ty)),
        Shape::List { .. } => None,
    })
}

fn value(record: &[u8], field: Field) -> f64 {
    field.ty.to_f64(&record[field.offset..])
}
