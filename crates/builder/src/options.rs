//! What a caller gives to a build and what it gets back: the options, which the user chose or a
//! call such as append adds, and the report. The modules below read them and nothing of `calls`.

use crate::attributes::normals::NormalsMode;
use crate::budget::memory;
use esker_format::{Codec, EskerFile, Normals, SetAside, SourceRecord, TreeRef};
use esker_points::palette::{Misfit, Palette};
use esker_points::{ColourDepth, Lattice, MultisetHash};
use esker_scan::{Columns, Crs, OpenOptions};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Allowed capacities of nodes, in points.
pub const CAPACITY_RANGE: std::ops::RangeInclusive<u32> = 64..=1 << 17;

/// Options of a build.
#[derive(Clone, Debug)]
pub struct Options {
    /// Anonymous memory that the build may use above that of the empty program, in bytes.
    pub memory_bytes: u64,
    /// Folder of scratch files; `None` for the system's folder of temporary files.
    pub scratch: Option<PathBuf>,
    /// Points that a node holds.
    pub node_capacity: u32,
    /// Bits of 16-bit colours, in place of what is detected.
    pub colour_depth: Option<ColourDepth>,
    /// Compression of the planes that are not drawn from.
    pub compress: Codec,
    /// Whether inputs of different coordinate reference systems are accepted, with their
    /// coordinates unchanged.
    pub ignore_crs: bool,
    /// Whether an append leaves out points that the lattice of the file does not hold; otherwise
    /// they are an error.
    pub drop_outside: bool,
    /// Whether refused points are an error, in place of being counted.
    pub refuse_loss: bool,
    /// Whether coordinates may be rounded by more than the typical distance of points.
    pub allow_rounding: bool,
    /// Treatment of interrupted builds.
    pub resume: Resume,
    /// Parts of existing files: see [`crate::append()`] and [`crate::merge()`].
    pub inherited: Inherited,
    /// Source of the normals that are drawn.
    pub normals: NormalsMode,
    /// Whether sharp edges are detected, at which splats are clipped. Requires normals, which are
    /// estimated if no source gives any.
    pub sharp_features: bool,
    /// Whether the shapes of splats are estimated and stored. Requires normals, as edges do.
    pub tangents: bool,
    /// Whether positions are stored a second time, with colours as indices of a palette: drawing
    /// then reads 8 bytes a point instead of 12.
    pub compact: bool,
    /// Which column of text files is which, in place of what the files tell.
    pub columns: Option<Columns>,
    /// Lines at the beginning of text files that are passed over.
    pub skip_lines: u64,
    /// Of how many points about one is read, for a preview; 1 for all. Inputs that cannot be read
    /// in part are refused.
    pub one_in: u32,
    /// Whether PCD files are transformed by the poses in their headers.
    pub apply_viewpoint: bool,
    /// Coordinate reference system of inputs that state none.
    pub crs: Option<Crs>,
    /// Name of the unit of length of inputs that state none.
    pub unit: Option<String>,
}

/// Treatment of interrupted builds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Resume {
    /// Finished steps are not kept.
    #[default]
    Never,
    /// Finished steps are kept for a later build.
    Later,
    /// Finished steps are kept, and this build resumes an interrupted one, if there is one.
    Now,
}

/// Parts of existing files that a build uses. Most builds use none.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Inherited {
    /// Lattice, in place of one chosen for the inputs.
    pub lattice: Option<Lattice>,
    /// Palette of the compact plane, in place of one trained on the inputs.
    pub palette: Option<Palette>,
    /// Files that the new file names.
    pub forest: Vec<TreeRef>,
    /// Records of the points that are merged from files.
    pub merged: Option<Merged>,
}

/// Records of files whose points are merged.
#[derive(Clone, Debug, PartialEq)]
pub struct Merged {
    /// Points set aside, whose sources are indices of `records`.
    pub aside: Vec<SetAside>,
    /// Records of the original sources, each with the path of the input that now has its points.
    pub records: Vec<(PathBuf, SourceRecord)>,
    /// Number of points.
    pub points: u64,
    /// Sum of the files' hashes.
    pub hash: MultisetHash,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            memory_bytes: memory::default_bytes(),
            scratch: None,
            node_capacity: 1 << 16,
            colour_depth: None,
            compress: Codec::default(),
            ignore_crs: false,
            drop_outside: false,
            refuse_loss: false,
            allow_rounding: false,
            resume: Resume::default(),
            inherited: Inherited::default(),
            normals: NormalsMode::default(),
            sharp_features: false,
            tangents: false,
            compact: false,
            columns: None,
            skip_lines: 0,
            one_in: 1,
            apply_viewpoint: false,
            crs: None,
            unit: None,
        }
    }
}

impl Options {
    /// Whether edges or shapes are computed, which requires normals.
    pub(crate) fn needs_normals(&self) -> bool {
        self.sharp_features || self.tangents
    }

    /// Whether normals are estimated from blocks of cells. Edges and shapes need the nearest
    /// neighbours anyway.
    pub(crate) fn estimates_fast(&self) -> bool {
        matches!(self.normals, NormalsMode::Keep | NormalsMode::Fast) && !self.needs_normals()
    }

    /// Options for sources that join `files`, as one set of inputs: [`NormalsMode::Keep`]
    /// estimates normals only if those of the files are estimated.
    pub(crate) fn beside<'a>(
        &self,
        files: impl IntoIterator<Item = &'a EskerFile>,
        are_given: bool,
    ) -> Self {
        let is_estimated = || files.into_iter().any(|f| f.metadata().normals.is_estimated());
        let stays_bare = self.normals == NormalsMode::Keep
            && !are_given
            && !self.needs_normals()
            && !is_estimated();
        let normals = if stays_bare { NormalsMode::None } else { self.normals };
        Self { normals, ..self.clone() }
    }

    /// Whether they ask for what only a build gives, so that a scan that could be drawn as it is
    /// (COPC) is built first.
    pub fn ask_for_build(&self) -> bool {
        let usual = Self::default();
        self.node_capacity != usual.node_capacity
            || self.normals != usual.normals
            || self.sharp_features
            || self.tangents
            || self.compact
            || self.one_in > 1
            || self.crs.is_some()
            || self.unit.is_some()
    }

    /// Options with which inputs are opened.
    pub fn open_options(&self) -> OpenOptions {
        OpenOptions {
            colour_depth: self.colour_depth,
            memory_bytes: Some(self.memory_bytes),
            columns: self.columns.clone(),
            skip_lines: self.skip_lines,
            one_in: self.one_in,
            apply_viewpoint: self.apply_viewpoint,
            crs: self.crs.clone(),
            unit: self.unit.clone(),
        }
    }
}

/// Result of a build.
#[derive(Clone, Debug, PartialEq)]
pub struct Report {
    /// Points decoded, including those refused or set aside.
    pub points_in: u64,
    /// Points in the file.
    pub points_out: u64,
    /// Points refused, by reason.
    pub points_refused: BTreeMap<String, u64>,
    /// Points far from nearly all others, which the metadata keep.
    pub points_set_aside: u64,
    /// Multiset hash of the points.
    pub hash: MultisetHash,
    /// Largest sample of the anonymous memory above that at the start, in bytes.
    pub peak_anon_bytes: u64,
    /// Largest resident set, in bytes.
    pub peak_rss_bytes: u64,
    /// Upper bound of the scratch space at one time, in bytes, as estimated before work started;
    /// `None` for a resumed build.
    pub scratch_bytes_estimated: Option<u64>,
    /// Bytes written to scratch.
    pub scratch_bytes: u64,
    /// Most bytes that scratch held at one time.
    pub scratch_bytes_peak: u64,
    /// Most bytes that scratch and the file held together at one time.
    pub disk_bytes_peak: u64,
    /// Bytes of the file.
    pub bytes_out: u64,
    /// Number of nodes.
    pub nodes: u64,
    /// Largest depth of a node; 0 for the root alone.
    pub depth: u32,
    /// Largest distance by which a coordinate was rounded, in the file's unit.
    pub rounding_error_max: f64,
    /// Differences between colours and those of the compact plane, if there is one.
    pub palette_misfit: Option<Misfit>,
    /// Source of the normals that are drawn.
    pub normals: Normals,
    /// Whether the file has the shapes of splats.
    pub has_tangents: bool,
    /// Notes for the user, a line each.
    pub notes: Vec<String>,
}
