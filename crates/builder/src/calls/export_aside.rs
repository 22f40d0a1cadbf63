//! Export of the points that files keep beside their trees: after all others, if all points are
//! wanted and the format holds coordinates that no lattice does.

use crate::calls::export_colours::{ColourConversion, PointClasses};
use esker_format::{EskerFile, Forest, SetAside};
use esker_points::{Batch, Schema};
use esker_scan::write::{Encode, Encoded};
use std::sync::Arc;

/// What the export of the points set aside needs.
pub struct AsideExport<'a> {
    /// The files.
    pub forest: &'a Forest,
    /// Attributes of all trees.
    pub schema: &'a Arc<Schema>,
    /// Conversion of their colours.
    pub colours: Option<&'a ColourConversion>,
    /// Whether all points are wanted.
    pub is_whole: bool,
}

impl AsideExport<'_> {
    /// Encodes the points; also returns a note if there are some that are not written.
    pub fn encode(&self, encode: &dyn Encode) -> (Vec<Encoded>, Option<String>) {
        let points = || self.forest.files().flat_map(|file| &file.metadata().set_aside);
        let Some(first) = points().next() else { return (Vec::new(), None) };
        let count = points().count() as u64;
        let left_out = |why: &str| {
            let [x, y, z] = first.place;
            let note = format!(
                "{count} points far from nearly all others, the first at {x} {y} {z}, are left out: {why}"
            );
            (Vec::new(), Some(note))
        };
        if !self.is_whole {
            return left_out("filters choose among the points of the tree");
        }
        let mut all = Vec::new();
        for file in self.forest.files() {
            let aside = &file.metadata().set_aside;
            let places: Vec<_> = aside.iter().map(|point| point.place).collect();
            match encode.encode_outside(&places, &self.batch(file, aside).columns) {
                Some(encoded) => all.push(encoded),
                None => return left_out("this format does not hold them; PLY and text do"),
            }
        }
        (all, None)
    }

    /// The points with the attributes that are written; zeros for those that they lack.
    fn batch(&self, file: &EskerFile, aside: &[SetAside]) -> Batch {
        let metadata = file.metadata();
        let classes: Vec<u16> =
            aside.iter().map(|p| metadata.sources[p.source as usize].class).collect();
        let mut batch = Batch::with_capacity(self.schema.clone(), aside.len());
        batch.positions.resize(aside.len(), [0; 3]);
        for (point, &class) in aside.iter().zip(&classes) {
            let mut values = point.values.as_slice();
            let mut own = Vec::new();
            for &index in &metadata.classes[usize::from(class)].present {
                let attribute = &metadata.schema.attributes[usize::from(index)];
                let (value, rest) = values.split_at(attribute.ty.size());
                own.push((attribute.key(), value));
                values = rest;
            }
            for (attribute, column) in self.schema.attributes.iter().zip(&mut batch.columns) {
                match own.iter().find(|(key, _)| *key == attribute.key()) {
                    Some((_, value)) => column.extend_from_slice(value),
                    None => column.resize(column.len() + attribute.ty.size(), 0),
                }
            }
        }
        match self.colours {
            Some(colours) => colours.convert(file, &PointClasses::new(classes), batch),
            None => batch,
        }
    }
}
