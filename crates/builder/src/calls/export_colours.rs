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
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

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

/// What a byte stands for in colours that use 16 bits: programs widen bytes by one of two factors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Factor {
    /// Times 256: the byte is the upper one.
    Upper,
    /// Times 257: both bytes are equal, and white stays white.
    Both,
}

impl Factor {
    /// The number.
    fn number(self) -> u16 {
        match self {
            Self::Upper => TO_SIXTEEN,
            Self::Both => TO_SIXTEEN + 1,
        }
    }

    /// The nearest byte of a 16-bit colour, and how far the colour is from it.
    fn rounded(self, v: u16) -> (u8, u16) {
        let number = u32::from(self.number());
        // At most 255, so that the product fits.
        let byte = ((u32::from(v) + number / 2) / number).min(255) as u16;
        (byte as u8, v.abs_diff(byte * self.number()))
    }
}

/// Converts colours to one scale.
pub struct ColourConversion {
    written: Written,
    /// Factor by which bytes were widened to the colours that use 16 bits.
    factor: Factor,
    /// The attributes of the export.
    schema: Arc<Schema>,
    /// For each attribute of the forest, its index there; for colours that of the same channel.
    pub index_of: Vec<usize>,
    rounded: AtomicU64,
    error_max: AtomicU64,
    notes: Vec<String>,
    /// Note that holds if no colour is rounded.
    exact_note: Option<String>,
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
        let only = |kind| kinds == [kind];
        let is_narrow = match wanted {
            None => target == Target::Ply && !only(Stored::Bytes),
            Some(depth) => depth == ColourDepth::Eight,
        };
        // Bytes widened by one factor are exact in bytes; those of several factors are not.
        let factors = match is_narrow && !kinds.is_empty() {
            true => factors(selected, task)?,
            false => Factors { is_low: false, upper: false, both: false },
        };
        let factor = factors.best();
        let written = match (wanted, target) {
            _ if kinds.is_empty() => return Ok(None),
            (Some(ColourDepth::Eight), _) if target.is_las() => Written::Low,
            (Some(ColourDepth::Eight), _) => Written::Bytes,
            (Some(ColourDepth::Sixteen), _) => Written::Wide,
            (None, Target::Ply) if only(Stored::Bytes) => return Ok(None),
            (None, Target::Ply) => match factors.is_low && factor.is_some() {
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
        let factor = factor.unwrap_or(Factor::Both);
        let stands_for = match (kinds.contains(&Stored::Wide), written) {
            (true, Written::Bytes | Written::Low) => {
                format!("; each stands for {} times its value in 16 bits", factor.number())
            }
            _ => String::new(),
        };
        let is_stated = wanted.is_none() && written == Written::Bytes || !stands_for.is_empty();
        let exact_note = is_stated.then(|| {
            format!("colours are written with 8 bits, which hold all of them{stands_for}")
        });
        if written == Written::Low {
            notes.push(
                "colours are written as 0 to 255; LAS asks for 16 bits, and some programs show them black".into(),
            );
        }
        let ty = if written == Written::Bytes { AttrType::U8 } else { AttrType::U16 };
        let (schema, index_of) = schema_with(forest.schema(), ty);
        Ok(Some(Self {
            written,
            factor,
            schema: Arc::new(schema),
            index_of,
            rounded: AtomicU64::new(0),
            error_max: AtomicU64::new(0),
            notes,
            exact_note,
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
                let (byte, error) = self.factor.rounded(v);
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
                "{rounded} values of colours are rounded to 8 bits, times {}, by at most {most} of 65,535",
                self.factor.number()
            ));
        } else {
            notes.extend(self.exact_note.clone());
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

/// What holds for all colours of a selection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Factors {
    /// Colours of 8 bits in fields of 16 are 0 to 255.
    is_low: bool,
    /// Colours that use 16 bits are bytes times 256.
    upper: bool,
    /// They are bytes times 257.
    both: bool,
}

impl Factors {
    /// A factor by which all colours were widened; that of LAS, if there is a choice.
    fn best(self) -> Option<Factor> {
        let upper = self.upper.then_some(Factor::Upper);
        upper.or(self.both.then_some(Factor::Both))
    }

    fn and(self, other: Self) -> Self {
        Self {
            is_low: self.is_low && other.is_low,
            upper: self.upper && other.upper,
            both: self.both && other.both,
        }
    }
}

/// What holds for all colours of these nodes.
fn factors(selected: &[Selection<'_>], task: &dyn Task) -> Result<Factors, BuildError> {
    const PLANES: [PlaneKind; 3] =
        [PlaneKind::Colour, PlaneKind::ColourRemainder, PlaneKind::Class];
    const ALL: Factors = Factors { is_low: true, upper: true, both: true };
    // Once a node fits no factor, no other needs to be read.
    let is_settled = AtomicBool::new(false);
    let mut all = ALL;
    for (file, nodes) in selected {
        let kinds = stored_of(file).unwrap_or_default();
        let of_node = |&node: &u32| -> Result<Factors, BuildError> {
            task.check()?;
            if is_settled.load(Ordering::Relaxed) {
                return Ok(ALL);
            }
            let planes = file.read_planes(node, &PLANES)?;
            let plane = |kind| planes.get(kind).unwrap_or_default();
            let (hot, cold) = (plane(PlaneKind::Colour), plane(PlaneKind::ColourRemainder));
            let classes = plane(PlaneKind::Class).as_chunks::<2>().0;
            let mut found = ALL;
            let colours = hot.as_chunks::<4>().0.iter().zip(cold.as_chunks::<3>().0).enumerate();
            for (i, (hot, cold)) in colours {
                let class = classes.get(i).map_or(0, |c| usize::from(u16::from_le_bytes(*c)));
                let are = |fits: fn(u8, u8) -> bool| (0..3).all(|k| fits(hot[k], cold[k]));
                match kinds.get(class).copied().flatten() {
                    None | Some(Stored::Bytes) => {}
                    Some(Stored::Low) => found.is_low &= are(|_, cold| cold == 0),
                    Some(Stored::Wide) => {
                        found.upper &= are(|_, cold| cold == 0);
                        found.both &= are(|hot, cold| cold == hot);
                    }
                }
            }
            if !(found.upper || found.both) {
                is_settled.store(true, Ordering::Relaxed);
            }
            Ok(found)
        };
        let of_nodes = nodes.par_iter().map(of_node);
        all = all.and(of_nodes.try_reduce(|| ALL, |a, b| Ok(a.and(b)))?);
    }
    Ok(all)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_are_exact_by_the_factor_that_widened_them() {
        for factor in [Factor::Upper, Factor::Both] {
            for byte in 0..=255u8 {
                assert_eq!(factor.rounded(u16::from(byte) * factor.number()), (byte, 0));
            }
        }
        for v in 0..=u16::MAX {
            assert!(Factor::Both.rounded(v).1 <= 128, "{v}");
            assert!(Factor::Upper.rounded(v).1 <= 255, "{v}");
        }
        assert_eq!(Factor::Both.rounded(65_280), (254, 2));
    }
}
