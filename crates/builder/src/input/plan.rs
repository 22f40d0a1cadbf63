//! The plan of a build: what is chosen for all inputs before their points are decoded (lattice,
//! schema, classes, what rows have room for), and what decoding them yields.

use crate::error::BuildError;
use crate::rows::partition::Partition;
use crate::rows::row::RowLayout;
use esker_format::{Ranges, SetAside};
use esker_points::{ColourDepth, Lattice, MultisetHash, PointClass, Schema};
use esker_scan::{ReadReport, Source};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Attributes that the build computes, for which rows have room.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Computed {
    /// Normals.
    pub normals: bool,
    /// Clip lines or shapes from the normals that sources give.
    pub beside_given_normals: bool,
    /// Clip lines at sharp edges.
    pub clip_lines: bool,
    /// Shapes of splats.
    pub tangents: bool,
}

impl Computed {
    /// Whether anything is computed for each point from the points around it.
    pub fn is_any(&self) -> bool {
        self.normals || self.clip_lines || self.tangents
    }
}

/// Lattice, schema and classes for all inputs.
pub struct Plan {
    /// Lattice of the file.
    pub lattice: Lattice,
    /// All attributes.
    pub schema: Schema,
    /// Classes of points.
    pub classes: Vec<PointClass>,
    /// Class of each source.
    pub class_of: Vec<u16>,
    /// Attributes that the build computes.
    pub computed: Computed,
    /// For each source, the file's attribute for each of its own.
    to_file: Vec<Vec<usize>>,
}

/// Points of all inputs, decoded.
pub struct DecodedInputs {
    /// Rows by cell.
    pub partition: Partition,
    /// Report of each source, without the points outside of the lattice.
    pub reports: Vec<ReadReport>,
    /// Strays.
    pub aside: Vec<SetAside>,
    /// Hash of all points, as they were decoded.
    pub hash: MultisetHash,
    /// Range of each attribute.
    pub ranges: Ranges,
    /// Whether the position of the scanner is known for all points.
    pub knows_scanners: bool,
}

impl Plan {
    /// Chooses schema and classes for `sources`, whose colours have `depths`.
    ///
    /// # Errors
    /// If the inputs have more different sets of attributes than a file can distinguish.
    pub fn new(
        sources: &[Box<dyn Source>],
        depths: &[ColourDepth],
        lattice: Lattice,
        computed: Computed,
    ) -> Result<Self, BuildError> {
        let schema = schema_of(sources);
        let (mut classes, mut class_of, mut to_file) = (Vec::new(), Vec::new(), Vec::new());
        for (source, &colour_depth) in sources.iter().zip(depths) {
            let attributes = &source.info().schema.attributes;
            let own: Vec<usize> =
                attributes.iter().filter_map(|a| schema.find_typed(&a.name, a.ty)).collect();
            let mut present: Vec<u16> = own.iter().map(|&i| i as u16).collect();
            present.sort_unstable();
            let class = PointClass { present, colour_depth };
            let index = classes.iter().position(|c| *c == class).unwrap_or(classes.len());
            if index == classes.len() {
                classes.push(class);
            }
            class_of.push(u16::try_from(index).map_err(|_| {
                BuildError::Options(
                    "the inputs have over 65,536 different sets of attributes".into(),
                )
            })?);
            to_file.push(own);
        }
        if classes.is_empty() {
            classes.push(PointClass { present: Vec::new(), colour_depth: ColourDepth::Sixteen });
        }
        Ok(Self { lattice, schema, classes, class_of, computed, to_file })
    }

    /// The plan for some of the sources that it was made for, of these classes.
    pub fn for_some(self, sources: &[Box<dyn Source>], class_of: Vec<u16>) -> Self {
        let schemas = sources.iter().map(|source| &source.info().schema);
        let own = |schema: &Arc<Schema>| {
            let attributes = schema.attributes.iter();
            attributes.filter_map(|a| self.schema.find_typed(&a.name, a.ty)).collect()
        };
        let to_file = schemas.map(own).collect();
        Self { class_of, to_file, ..self }
    }

    /// A plan that was made before.
    pub fn made(
        lattice: Lattice,
        schema: Schema,
        classes: Vec<PointClass>,
        computed: Computed,
    ) -> Self {
        Self { lattice, schema, classes, computed, class_of: Vec::new(), to_file: Vec::new() }
    }

    /// Layout of rows.
    pub fn rows(&self) -> RowLayout {
        let rows = RowLayout::new(&self.schema, &self.classes);
        let rows = if self.computed.normals { rows.with_normals() } else { rows };
        let given = self.schema.normals().filter(|_| self.computed.beside_given_normals);
        let rows = if let Some(given) = given { rows.with_given_normals(given) } else { rows };
        let rows = if self.computed.clip_lines { rows.with_clip_lines() } else { rows };
        if self.computed.tangents { rows.with_tangents() } else { rows }
    }

    /// Bytes of a row.
    pub fn row_bytes(&self) -> usize {
        self.rows().bytes()
    }

    /// The file's attribute for each attribute of `source`.
    pub fn to_file(&self, source: usize) -> &[usize] {
        &self.to_file[source]
    }
}

/// Attributes that any source has.
pub fn schema_of(sources: &[Box<dyn Source>]) -> Schema {
    sources.iter().fold(Schema::default(), |all, s| all.union(&s.info().schema))
}
