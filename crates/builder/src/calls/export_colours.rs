//! The scale of the colours of an export: one for all points. Sources may have colours of 8 bits,
//! colours of 8 bits in fields of 16, and colours of 16 bits; a PLY file gets 8 bits where that
//! loses nothing, since most programs show its 16-bit colours black.

use crate::error::BuildError;
use esker_format::{EskerFile, Forest, PagePoints, PlaneKind};
use esker_points::attribute::names;
use esker_points::{AttrType, Batch, ColourDepth, Column, Schema, Task};
use esker_scan::write::Target;
use rayon::prelude::*;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

const RGB: [&str; 3] = [names::RED, names::GREEN, names::BLUE];
/// Colours of 8 bits in a field of 16: what LAS 1.4 R15 (section 2.6.2) asks for.
const TO_SIXTEEN: u16 = 256;

/// How the points of a class hold their colours.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stored {
    /// In bytes.
    Bytes,
    /// In 16-bit fields, with values of 0 to 255.
    Low,
    /// In 16-bit fields that are used whole.
    Wide,
}

/// How colours are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Written {
    Bytes,
    /// Values of 0 to 255 in 16-bit fields.
    Low,
    Wide,
}

/// Converts colours to one scale.
pub struct ColourConversion {
    written: Written,
    /// The attributes of the export.
    schema: Arc<Schema>,
    /// For each attribute of the forest, its index there; for colours that of the same channel.
    pub index_of: Vec<usize>,
    rounded: AtomicU64,
    error_max: AtomicU64,
    notes: Vec<String>,
}

/// A file and those of its nodes whose points are exported.
pub type Selection<'a> = (&'a EskerFile, Vec<u32>);

impl ColourConversion {
    /// Chooses the scale; `None` if colours are written as they are stored. `wanted` is the user's
    /// choice.
    ///
    /// # Errors
    /// If a page cannot be read; on request.
    pub fn choose(
        forest: &Forest,
        selected: &[Selection<'_>],
        target: Target,
        wanted: Option<ColourDepth>,
        task: &dyn Task,
    ) -> Result<Option<Self>, BuildError> {
        let mut kinds = Vec::new();
        for (file, _) in selected {
            let Some(of_file) = stored_of(file) else { return Ok(None) };
            for kind in of_file.into_iter().flatten() {
                if !kinds.contains(&kind) {
                    kinds.push(kind);
                }
            }
        }
        let is_las = matches!(target, Target::Las | Target::Laz);
        let only = |kind| kinds == [kind];
        let written = match (wanted, target) {
            _ if kinds.is_empty() => return Ok(None),
            (Some(ColourDepth::Eight), _) if is_las => Written::Low,
            (Some(ColourDepth::Eight), _) => Written::Bytes,
            (Some(ColourDepth::Sixteen), _) => Written::Wide,
            (None, Target::Ply) if only(Stored::Bytes) => return Ok(None),
            (None, Target::Ply) => match fits_bytes(selected, task)? {
                true => Written::Bytes,
                false => Written::Wide,
            },
            (None, _) if kinds.len() == 1 => return Ok(None),
            (None, _) => Written::Wide,
        };
        let mut notes = Vec::new();
        if kinds.len() > 1 && written == Written::Wide {
            notes.push(format!(
                "the sources have colours of 8 and of 16 bits: all are written with 16, those of 8 bits times {TO_SIXTEEN}"
            ));
        }
        if written == Written::Wide && target == Target::Ply {
            notes.push(
                "colours have 16 bits, which some programs show black: --colour-bits 8 rounds them"
                    .into(),
            );
        }
        if wanted.is_none() && written == Written::Bytes {
            notes.push("colours are written with 8 bits, which hold all of them".into());
        }
        if written == Written::Low {
            notes.push(
                "colours are written as 0 to 255; LAS asks for 16 bits, and some programs show them black".into(),
            );
        }
        let ty = if written == Written::Bytes { AttrType::U8 } else { AttrType::U16 };
        let (schema, index_of) = schema_with(forest.schema(), ty);
        Ok(Some(Self {
            written,
            schema: Arc::new(schema),
            index_of,
            rounded: AtomicU64::new(0),
            error_max: AtomicU64::new(0),
            notes,
        }))
    }

    /// The attributes of the export.
    pub fn schema(&self) -> &Arc<Schema> {
        &self.schema
    }

    /// Converts points of `file`, which have all attributes of the forest in `batch`; `classes` are
    /// the classes of the points.
    pub fn convert(&self, file: &EskerFile, classes: &PointClasses, batch: Batch) -> Batch {
        let mut columns: Vec<Column> = vec![Column::new(); self.schema.attributes.len()];
        let Batch { schema, positions, columns: own, outside } = batch;
        let mut stored: Vec<(usize, AttrType, Column)> = Vec::new();
        for (index, (attribute, column)) in schema.attributes.iter().zip(own).enumerate() {
            match RGB.iter().position(|c| is_colour(attribute.key(), c)) {
                Some(channel) => stored.push((channel, attribute.ty, column)),
                None => columns[self.index_of[index]] = column,
            }
        }
        let kinds = stored_of(file).unwrap_or_default();
        for (channel, name) in RGB.iter().enumerate() {
            let ty = if self.written == Written::Bytes { AttrType::U8 } else { AttrType::U16 };
            let Some(at) = self.schema.find_typed(name, ty) else { continue };
            let find = |ty| stored.iter().find(|s| s.0 == channel && s.1 == ty).map(|s| &s.2[..]);
            let (bytes, words) = (find(AttrType::U8), find(AttrType::U16));
            let out = &mut columns[at];
            for i in 0..positions.len() {
                let byte = || bytes.map_or(0, |b| b[i]);
                let word = || words.map_or(0, |w| u16::from_le_bytes([w[2 * i], w[2 * i + 1]]));
                let value = match kinds.get(classes.of(i)).copied().flatten() {
                    Some(Stored::Bytes) => self.of_byte(byte()),
                    Some(Stored::Low) => self.of_low(word()),
                    Some(Stored::Wide) => self.of_wide(word()),
                    None => 0,
                };
                match self.written {
                    Written::Bytes => out.push(value as u8),
                    Written::Low | Written::Wide => out.extend(value.to_le_bytes()),
                }
            }
        }
        Batch { schema: self.schema.clone(), positions, columns, outside }
    }

    fn of_byte(&self, v: u8) -> u16 {
        match self.written {
            Written::Bytes | Written::Low => v.into(),
            Written::Wide => u16::from(v) * TO_SIXTEEN,
        }
    }

    fn of_low(&self, v: u16) -> u16 {
        let byte = v.min(u8::MAX.into());
        if byte != v {
            // The user said that there are 8 bits.
            self.count(u64::from(v - byte));
        }
        self.of_byte(byte as u8)
    }

    fn of_wide(&self, v: u16) -> u16 {
        match self.written {
            Written::Wide => v,
            Written::Bytes | Written::Low => {
                let (byte, error) = rounded(v);
                if error > 0 {
                    self.count(error.into());
                }
                byte.into()
            }
        }
    }

    fn count(&self, error: u64) {
        self.rounded.fetch_add(1, Ordering::Relaxed);
        self.error_max.fetch_max(error, Ordering::Relaxed);
    }

    /// What the conversion did, a line each.
    pub fn notes(&self) -> Vec<String> {
        let mut notes = self.notes.clone();
        let rounded = self.rounded.load(Ordering::Relaxed);
        if rounded > 0 {
            let most = self.error_max.load(Ordering::Relaxed);
            notes.push(format!(
                "{rounded} values of colours are rounded to 8 bits, by at most {most} of 65,535"
            ));
        }
        notes
    }
}

/// Classes of points, kept while their columns are converted.
pub struct PointClasses(Vec<u16>);

impl PointClasses {
    /// These classes, one a point.
    pub fn new(classes: Vec<u16>) -> Self {
        Self(classes)
    }

    /// Those of `points`.
    pub fn of_points(points: &PagePoints) -> Self {
        Self(points.classes.clone())
    }

    fn of(&self, point: usize) -> usize {
        self.0.get(point).map_or(0, |&class| usize::from(class))
    }
}

/// The byte of a 16-bit colour, and how far the colour is from it: none if its low byte is 0 or
/// equals the high one, as programs widen bytes.
fn rounded(v: u16) -> (u8, u16) {
    let [low, high] = v.to_le_bytes();
    if low == 0 {
        return (high, 0);
    }
    let byte = (u32::from(v) + 128) / 257;
    let byte = byte.min(255) as u16;
    (byte as u8, v.abs_diff(byte * 257))
}

/// How the points of each class hold their colours; `None` if a class has colours that are not
/// drawn, which stay as they are.
fn stored_of(file: &EskerFile) -> Option<Vec<Option<Stored>>> {
    let layout = file.layout();
    let schema = layout.schema();
    let classes = layout.classes().iter().enumerate().map(|(class, of)| {
        let drawn = layout.drawn_colour(class).map(|(rgb, _)| rgb);
        let is_other = |a: &usize| {
            let key = schema.attributes[*a].key();
            RGB.iter().any(|c| is_colour(key, c)) && drawn.is_none_or(|rgb| !rgb.contains(a))
        };
        let present = of.present.iter().map(|&a| usize::from(a));
        if present.into_iter().any(|a| is_other(&a)) {
            return None;
        }
        Some(drawn.map(|rgb| match (schema.attributes[rgb[0]].ty, of.colour_depth) {
            (AttrType::U8, _) => Stored::Bytes,
            (_, ColourDepth::Eight) => Stored::Low,
            (_, ColourDepth::Sixteen) => Stored::Wide,
        }))
    });
    classes.collect()
}

fn is_colour((name, ty): (&str, AttrType), colour: &str) -> bool {
    name == colour && matches!(ty, AttrType::U8 | AttrType::U16)
}

/// The schema with one red, green and blue, of type `ty`, and the index of each old attribute.
fn schema_with(schema: &Schema, ty: AttrType) -> (Schema, Vec<usize>) {
    let mut attributes = Vec::with_capacity(schema.attributes.len());
    for attribute in &schema.attributes {
        let mut attribute = attribute.clone();
        if RGB.iter().any(|c| is_colour(attribute.key(), c)) {
            attribute.ty = ty;
            if attributes.iter().any(|a: &esker_points::Attribute| a.key() == attribute.key()) {
                continue;
            }
        }
        attributes.push(attribute);
    }
    let new = Schema::new(attributes);
    let index_of = schema.attributes.iter().map(|a| {
        let is_rgb = RGB.iter().any(|c| is_colour(a.key(), c));
        new.find_typed(&a.name, if is_rgb { ty } else { a.ty }).unwrap_or(0)
    });
    let index_of = index_of.collect();
    (new, index_of)
}

/// Whether all colours of these nodes are bytes, exactly.
fn fits_bytes(selected: &[Selection<'_>], task: &dyn Task) -> Result<bool, BuildError> {
    const PLANES: [PlaneKind; 3] =
        [PlaneKind::Colour, PlaneKind::ColourRemainder, PlaneKind::Class];
    for (file, nodes) in selected {
        let kinds = stored_of(file).unwrap_or_default();
        let does_fit = |&node: &u32| -> Result<bool, BuildError> {
            task.check()?;
            let planes = file.read_planes(node, &PLANES)?;
            let plane = |kind| planes.get(kind).unwrap_or_default();
            let (hot, cold) = (plane(PlaneKind::Colour), plane(PlaneKind::ColourRemainder));
            let classes = plane(PlaneKind::Class).as_chunks::<2>().0;
            let colours = hot.as_chunks::<4>().0.iter().zip(cold.as_chunks::<3>().0).enumerate();
            Ok(colours.into_iter().all(|(i, (hot, cold))| {
                let class = classes.get(i).map_or(0, |c| usize::from(u16::from_le_bytes(*c)));
                let fits = |k: usize| match kinds.get(class).copied().flatten() {
                    None | Some(Stored::Bytes) => true,
                    Some(Stored::Low) => cold[k] == 0,
                    Some(Stored::Wide) => cold[k] == 0 || cold[k] == hot[k],
                };
                (0..3).all(fits)
            }))
        };
        // The first in order that does not fit, or the first error, ends the search.
        let misfit = nodes.par_iter().map(does_fit).find_first(|fits| !matches!(fits, Ok(true)));
        if let Some(misfit) = misfit {
            return misfit;
        }
    }
    Ok(true)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_are_exact_in_both_ways_to_widen_them() {
        for byte in 0..=255u8 {
            assert_eq!(rounded(u16::from(byte) * 256), (byte, 0));
            assert_eq!(rounded(u16::from(byte) * 257), (byte, 0));
        }
        for v in 0..=u16::MAX {
            assert!(rounded(v).1 <= 128, "{v}");
        }
    }
}
