//! The plan of a divided build, as it is kept in `plan.json`: what all steps must agree on. The
//! XXH3-128 of its bytes is in the records of all steps. In: the file, or what [`super::plan`]
//! chooses. Out: options, lattice and sources for each step.

use crate::attributes::normals::NormalsMode;
use crate::error::BuildError;
use crate::input::plan::{Computed, Plan};
use crate::jobs::Resources;
use crate::jobs::pieces::Piece;
use crate::jobs::place::Place;
use crate::jobs::step::{VERSION, failed, hash_of, refused};
use crate::options::Options;
use esker_format::Codec;
use esker_points::{ColourDepth, InputGrid, Lattice, PointClass, Schema};
use esker_scan::Crs;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Name of the plan.
pub const NAME: &str = "plan.json";
/// Most bytes of a plan: some 300 for each source.
const BYTES_MAX: u64 = 1 << 30;
/// Least and greatest number of rows from which on takes split cells.
const CELL_ROWS_LEAST: u64 = 1 << 10;
const CELL_ROWS_MOST: u64 = 1 << 20;
/// Program that made a plan, and its version: bytes of another one may differ.
const PROGRAM: &str = concat!("esker ", env!("CARGO_PKG_VERSION"));

/// The plan of a divided build.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Planned {
    version: u32,
    program: String,
    /// Options of the build.
    options: PlannedOptions,
    /// Lattice of the file.
    pub lattice: Lattice,
    /// Attributes of the file.
    pub schema: Schema,
    /// Classes of points, with the colour depths that the first points show.
    pub classes: Vec<PointClass>,
    /// Attributes that the build computes.
    pub computed: Computed,
    /// Log2 of the edge of the cells into which takes sort rows.
    pub cell_log2: u8,
    /// Rows of a part, unless a single cell has more.
    pub part_rows_max: u64,
    /// Number of takes, and of jobs that build parts.
    pub jobs: u32,
    /// What the steps need.
    pub needs: Needs,
    /// Pieces of the sources that each take decodes.
    pub takes: Vec<Vec<Piece>>,
    /// Sources, in the order of their names.
    pub sources: Vec<PlannedSource>,
    /// XXH3-128 of the bytes of the plan.
    #[serde(skip)]
    pub hash: String,
}

/// A source of a plan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlannedSource {
    /// Path as given by the user.
    pub path: PathBuf,
    /// Where it is, from any folder.
    pub at: PathBuf,
    /// Its bytes.
    pub bytes: u64,
    /// Points that its header states.
    pub points: u64,
    /// When it was last changed.
    pub changed: String,
    /// Its grid, with bounds as far as they are known.
    pub grid: InputGrid,
    /// Whether these bounds are those of its points.
    pub is_measured: bool,
    /// Depth of its 16-bit colours; `None` if it has none.
    pub colour_depth: Option<ColourDepth>,
    /// Class of its points.
    pub class: u16,
}

/// Options that change what is built.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct PlannedOptions {
    node_capacity: u32,
    colour_depth: Option<ColourDepth>,
    compress: String,
    normals: String,
    sharp_features: bool,
    tangents: bool,
    compact: bool,
    ignore_crs: bool,
    refuse_loss: bool,
    allow_rounding: bool,
    columns: Option<String>,
    skip_lines: u64,
    apply_viewpoint: bool,
    crs: Option<[Option<String>; 2]>,
    unit: Option<String>,
}

/// Upper bounds of what steps need, in bytes; estimated from the points that headers state.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Needs {
    /// Least `--memory` of a take and of a build.
    pub memory: u64,
    /// Scratch of the largest take.
    pub take_scratch: u64,
    /// Memory of the cut: its lists of cells.
    pub cut_memory: u64,
    /// Scratch of a build of a part.
    pub build_scratch: u64,
    /// Objects of all takes together.
    pub takes: u64,
    /// Parts together, and the file again: hot positions alone, since compressed planes are not
    /// known.
    pub file: u64,
}

const NORMALS: [(NormalsMode, &str); 4] = [
    (NormalsMode::Keep, "keep"),
    (NormalsMode::Estimate, "estimate"),
    (NormalsMode::Fast, "fast"),
    (NormalsMode::None, "none"),
];

impl PlannedOptions {
    fn of(options: &Options) -> Self {
        let normals = NORMALS.iter().find(|(mode, _)| *mode == options.normals);
        Self {
            node_capacity: options.node_capacity,
            colour_depth: options.colour_depth,
            compress: options.compress.name().into(),
            normals: normals.map_or("", |(_, name)| name).into(),
            sharp_features: options.sharp_features,
            tangents: options.tangents,
            compact: options.compact,
            ignore_crs: options.ignore_crs,
            refuse_loss: options.refuse_loss,
            allow_rounding: options.allow_rounding,
            columns: options.columns.as_ref().map(ToString::to_string),
            skip_lines: options.skip_lines,
            apply_viewpoint: options.apply_viewpoint,
            crs: options.crs.as_ref().map(|crs| [Some(crs.text.clone()), crs.unit.clone()]),
            unit: options.unit.clone(),
        }
    }

    /// Options of a step; `None` if they are not those of this program.
    fn options(&self, resources: &Resources) -> Option<Options> {
        let codecs = [Codec::None, Codec::Fast, Codec::Small];
        let crs = |[text, unit]: &[Option<String>; 2]| {
            Some(Crs { text: text.clone()?, unit: unit.clone() })
        };
        let columns = self.columns.as_ref().map(|text| text.parse().ok());
        Some(Options {
            memory_bytes: resources.memory_bytes,
            scratch: resources.scratch.clone(),
            node_capacity: self.node_capacity,
            colour_depth: self.colour_depth,
            compress: codecs.into_iter().find(|codec| codec.name() == self.compress)?,
            normals: NORMALS.iter().find(|(_, name)| *name == self.normals)?.0,
            sharp_features: self.sharp_features,
            tangents: self.tangents,
            compact: self.compact,
            ignore_crs: self.ignore_crs,
            refuse_loss: self.refuse_loss,
            allow_rounding: self.allow_rounding,
            columns: match columns {
                Some(columns) => Some(columns?),
                None => None,
            },
            skip_lines: self.skip_lines,
            apply_viewpoint: self.apply_viewpoint,
            crs: match &self.crs {
                Some(given) => Some(crs(given)?),
                None => None,
            },
            unit: self.unit.clone(),
            ..Options::default()
        })
    }
}

impl Planned {
    /// The plan for what was chosen; `cell_log2`, `part_rows_max`, `jobs`, what steps need, pieces
    /// and sources are still to be set.
    pub fn new(plan: &Plan, options: &Options) -> Self {
        Self {
            version: VERSION,
            program: PROGRAM.into(),
            options: PlannedOptions::of(options),
            lattice: plan.lattice,
            schema: plan.schema.clone(),
            classes: plan.classes.clone(),
            computed: plan.computed,
            cell_log2: 0,
            part_rows_max: 0,
            jobs: 0,
            needs: Needs::default(),
            takes: Vec::new(),
            sources: Vec::new(),
            hash: String::new(),
        }
    }

    /// Writes the plan into a place, which has none or this one. Returns whether it had none.
    ///
    /// # Errors
    /// If the place has another plan, or cannot be written; if the plan cannot be kept.
    pub fn create(&mut self, place: &dyn Place) -> Result<bool, BuildError> {
        let mut text = serde_json::to_vec_pretty(self)
            .map_err(|e| refused(place, NAME, format!("the plan cannot be kept: {e}")))?;
        text.push(b'\n');
        self.hash = hash_of(&text);
        // Numbers that are none are lost.
        let is_kept = serde_json::from_slice::<Self>(&text)
            .is_ok_and(|kept| Self { hash: self.hash.clone(), ..kept } == *self);
        if !is_kept || text.len() as u64 > BYTES_MAX {
            let why = "the plan cannot be kept: a header has bounds or scales that are no numbers, \
                       or there are too many sources; mend bounds with --measure";
            return Err(refused(place, NAME, why));
        }
        let create = |bytes: &[u8]| {
            place.create(NAME, bytes).map_err(failed(place, NAME, "cannot be created"))
        };
        if create(&text)? {
            // Some object storage ignores the condition of a put. All records depend on it.
            if create(b"")? {
                place.remove(NAME).map_err(failed(place, NAME, "cannot be removed"))?;
                let why = "would be replaced by another plan: this storage ignores `If-None-Match`, \
                           by which jobs agree who is first; choose another place";
                return Err(refused(place, NAME, why));
            }
            return Ok(true);
        }
        let earlier = place.read(NAME, BYTES_MAX);
        if earlier.map_err(failed(place, NAME, "cannot be read"))?.as_ref() == Some(&text) {
            return Ok(false);
        }
        let why = "is there already, for other inputs or options; choose another folder, or remove \
                   all of this one first";
        Err(refused(place, NAME, why))
    }

    /// Reads the plan of a place.
    ///
    /// # Errors
    /// If there is none, or it is of another version.
    pub fn read(place: &dyn Place) -> Result<Self, BuildError> {
        let bytes = place.read(NAME, BYTES_MAX);
        let bytes = bytes.map_err(failed(place, NAME, "cannot be read"))?;
        let none = || refused(place, NAME, "is missing; run `esker job plan` first");
        let bytes = bytes.ok_or_else(none)?;
        #[derive(Deserialize)]
        struct Head {
            version: u32,
            program: String,
        }
        let no_plan = |e| refused(place, NAME, format!("is no plan of a build ({e})"));
        let head: Head = serde_json::from_slice(&bytes).map_err(no_plan)?;
        if head.version != VERSION || head.program != PROGRAM {
            let why = format!(
                "was made by {}, and this is {PROGRAM}: all steps must be done by one version",
                head.program
            );
            return Err(refused(place, NAME, why));
        }
        let mut planned: Self = serde_json::from_slice(&bytes).map_err(no_plan)?;
        planned.hash = hash_of(&bytes);
        let sources = planned.sources.len();
        let pieces = planned.takes.iter().flatten();
        let is_sound = planned.cell_log2 <= 32
            && pieces.map(|piece| piece.source as usize).all(|source| source < sources)
            && planned.sources.iter().all(|s| usize::from(s.class) < planned.classes.len());
        if !is_sound {
            return Err(refused(place, NAME, "is damaged"));
        }
        Ok(planned)
    }

    /// Options of a step.
    ///
    /// # Errors
    /// If they are not those of this program.
    pub fn options(&self, place: &dyn Place, resources: &Resources) -> Result<Options, BuildError> {
        let options = self.options.options(resources);
        options.ok_or_else(|| refused(place, NAME, "has options that this program does not know"))
    }

    /// Rows of a cell of a take, unless all coincide: few enough that the same cell of all takes is
    /// no larger than a part, and that the cut can hold them.
    pub fn cell_rows_max(&self) -> u64 {
        let share = self.part_rows_max / (self.takes.len() as u64).max(1);
        share.clamp(CELL_ROWS_LEAST, CELL_ROWS_MOST)
    }

    /// Lattice, schema and classes for a build.
    pub fn plan(&self) -> Plan {
        let (schema, classes) = (self.schema.clone(), self.classes.clone());
        Plan::made(self.lattice, schema, classes, self.computed)
    }

    /// Whether the user chose the depth of 16-bit colours.
    pub fn has_forced_depth(&self) -> bool {
        self.options.colour_depth.is_some()
    }
}
