//! Attribute schema of a source or a file, classes of points in a file whose sources differ, and
//! the depth of 16-bit colour fields.

use crate::attribute::{AttrType, Attribute, names};
use crate::hash::layout_seed;
use serde::{Deserialize, Serialize};

/// Relative difference below which scales count as equal: the rounding of a decimal number.
const SCALE_NOISE: f64 = 1e-12;

/// Attributes in canonical order: by name, then type; no two alike.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Schema {
    /// Attributes.
    pub attributes: Vec<Attribute>,
}

/// An attribute whose stored values have different meanings in two schemas: what is displayed is
/// the stored value times the scale plus the offset.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Conflict<'a> {
    /// Name of the attribute.
    pub name: &'a str,
    /// The scale in each schema.
    pub scales: [f64; 2],
    /// The offset in each schema.
    pub offsets: [f64; 2],
}

/// Degrees of a step of scan angles (LAS 1.4 R15, table 15).
const SCAN_ANGLE_STEP: f64 = 0.006;

impl Schema {
    /// Factor from stored to displayed values of an attribute: its scale, or the step of scan
    /// angles of LAS point formats 6 to 10. These are recognised by the bit fields of that format,
    /// since another format may have degrees under that name.
    pub fn shown_scale(&self, attribute: usize) -> f64 {
        let attribute = &self.attributes[attribute];
        let bits = [names::RETURNS, names::FLAGS];
        let is_las = || bits.iter().all(|name| self.find_typed(name, AttrType::U8).is_some());
        match attribute.key() {
            (names::SCAN_ANGLE, AttrType::I16) if attribute.scale == 1.0 && is_las() => {
                SCAN_ANGLE_STEP
            }
            _ => attribute.scale,
        }
    }

    /// Sorts into canonical order. The later of two attributes of equal name and type gets a number
    /// appended to its name, so that nothing is lost.
    pub fn new(mut attributes: Vec<Attribute>) -> Self {
        let mut seen = std::collections::HashSet::new();
        for a in &mut attributes {
            let base = a.name.clone();
            let mut n = 2;
            while !seen.insert((a.name.clone(), a.ty)) {
                a.name = format!("{base}#{n}");
                n += 1;
            }
        }
        attributes.sort_by(|a, b| a.key().cmp(&b.key()));
        Self { attributes }
    }

    /// Index of the attribute of this name, of the first type if there are several.
    pub fn find(&self, name: &str) -> Option<usize> {
        self.attributes.iter().position(|a| a.name == name)
    }

    /// Index of the attribute of this name and type.
    pub fn find_typed(&self, name: &str, ty: AttrType) -> Option<usize> {
        self.attributes.iter().position(|a| a.name == name && a.ty == ty)
    }

    /// Bytes of all attribute values of one point.
    pub fn record_bytes(&self) -> usize {
        self.attributes.iter().map(|a| a.ty.size()).sum()
    }

    /// The first attribute that another schema has under the same name and type, but with another
    /// scale or offset of what is displayed, so that stored values differ in meaning. Both cannot
    /// be kept under one name.
    pub fn conflict<'a>(&'a self, other: &Self) -> Option<Conflict<'a>> {
        let is_near = |a: f64, b: f64| a == b || (a - b).abs() <= a.abs() * SCALE_NOISE;
        self.attributes.iter().enumerate().find_map(|(index, own)| {
            let their_index = other.find_typed(&own.name, own.ty)?;
            let theirs = &other.attributes[their_index];
            let scales = [self.shown_scale(index), other.shown_scale(their_index)];
            let offsets = [own.offset, theirs.offset];
            let is_same = is_near(scales[0], scales[1]) && is_near(offsets[0], offsets[1]);
            (!is_same).then_some(Conflict { name: &own.name, scales, offsets })
        })
    }

    /// The union with another schema, in canonical order.
    pub fn union(&self, other: &Self) -> Self {
        let mut all = self.attributes.clone();
        all.extend(
            other.attributes.iter().filter(|a| self.find_typed(&a.name, a.ty).is_none()).cloned(),
        );
        Self::new(all)
    }

    /// Indices of red, green, blue if all three exist with one type, `u8` or `u16` (16-bit first if
    /// both do).
    pub fn rgb(&self) -> Option<[usize; 3]> {
        [AttrType::U16, AttrType::U8].into_iter().find_map(|ty| {
            Some([
                self.find_typed(names::RED, ty)?,
                self.find_typed(names::GREEN, ty)?,
                self.find_typed(names::BLUE, ty)?,
            ])
        })
    }

    /// Indices of nx, ny, nz if all three exist as `f32`.
    pub fn normals(&self) -> Option<[usize; 3]> {
        Some([
            self.find_typed(names::NX, AttrType::F32)?,
            self.find_typed(names::NY, AttrType::F32)?,
            self.find_typed(names::NZ, AttrType::F32)?,
        ])
    }

    /// Indices of the attributes of clip lines, if all exist: their number, and the ends of both.
    pub fn clip_lines(&self) -> Option<(usize, [[usize; 3]; 4])> {
        let number = self.find_typed(names::CLIP, AttrType::U8)?;
        let mut ends = [[0; 3]; 4];
        for (index, name) in ends.iter_mut().flatten().zip(names::CLIP_ENDS.iter().flatten()) {
            *index = self.find_typed(name, AttrType::F64)?;
        }
        Some((number, ends))
    }
}

/// Contents of the 16-bit colour fields of a source.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ColourDepth {
    /// Values over the full 16 bits (or 8 bits in the high byte): the high byte is drawn.
    Sixteen,
    /// Values of 0 to 255 in 16-bit fields: the low byte is drawn.
    Eight,
}

/// Points with one set of attributes. A file whose sources all have the same attributes has one
/// class; otherwise a plane has the class of each point, so that absent values are known to be
/// absent.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PointClass {
    /// Attributes of the file's schema that its points have, ascending indices.
    pub present: Vec<u16>,
    /// Contents of its 16-bit colour fields.
    pub colour_depth: ColourDepth,
}

impl PointClass {
    /// Seed of the multiset hash for points of this class (see [`crate::hash`]).
    pub fn seed(&self, schema: &Schema) -> u64 {
        layout_seed(self.present.iter().map(|&i| schema.attributes[usize::from(i)].key()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn schema(attributes: &[(&str, AttrType, f64)]) -> Schema {
        let of = |&(name, ty, scale): &(&str, AttrType, f64)| Attribute {
            scale,
            ..Attribute::new(name, ty)
        };
        Schema::new(attributes.iter().map(of).collect())
    }

    /// The steps of LAS, 0.006 degrees, are implied by its bit fields or given as the scale.
    #[test]
    fn attributes_that_show_the_same_do_not_conflict() {
        let bits = [(names::RETURNS, AttrType::U8, 1.0), (names::FLAGS, AttrType::U8, 1.0)];
        let angle = |scale| (names::SCAN_ANGLE, AttrType::I16, scale);
        let las = schema(&[bits[0], bits[1], angle(1.0)]);
        let steps = schema(&[angle(0.006)]);
        let degrees = schema(&[angle(1.0)]);
        assert_eq!(las.conflict(&steps), None);
        assert_eq!(steps.conflict(&las), None);
        for union in [las.union(&steps), steps.union(&las)] {
            let index = union.find(names::SCAN_ANGLE).unwrap_or_default();
            assert_eq!(union.shown_scale(index), 0.006);
        }
        let conflict = las.conflict(&degrees).map(|c| (c.name, c.scales));
        assert_eq!(conflict, Some((names::SCAN_ANGLE, [0.006, 1.0])));
    }
}
