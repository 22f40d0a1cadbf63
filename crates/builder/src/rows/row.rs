//! Rows: the builder's record of a point. x, y, z on the lattice; the values of all attributes of
//! the file's schema in canonical order, absent ones zero; the class of the point if there are
//! several; then room for attributes that the build computes. Ties between positions are broken by
//! comparing the bytes of rows.

use esker_points::clip::CLIP_BYTES;
use esker_points::quant::oct_encode;
use esker_points::tangents::{Shape, axis_code, axis_of};
use esker_points::{Batch, ClipWords, MultisetHash, PointClass, Schema};
use std::ops::Range;

/// Bytes of the shape of a splat in a row: the code of its axis, two lengths.
const SHAPE_BYTES: usize = 2 + 8;

/// Rows that are made at a time: few enough to stay in the first-level cache until they are copied.
const BLOCK_ROWS: usize = 256;

/// Offsets of values in a row.
#[derive(Clone, Debug)]
pub struct RowLayout {
    /// Bytes in a row of each attribute of the file's schema.
    attributes: Vec<Range<usize>>,
    class_at: Option<usize>,
    normal_at: Option<usize>,
    /// Attributes that hold the normals that sources give, if something is computed from them.
    given_normal: Option<[usize; 3]>,
    clip_at: Option<usize>,
    shape_at: Option<usize>,
    bytes: usize,
    classes: Vec<ClassLayout>,
}

/// Decoded points, of which rows are made.
#[derive(Clone, Copy, Debug)]
pub struct Incoming<'a> {
    /// The points.
    pub batch: &'a Batch,
    /// Class of all points.
    pub class: u16,
    /// The file's attribute for each attribute of the batch.
    pub to_file: &'a [usize],
    /// Octahedral codes of the directions to the scanner; empty if its position is not known.
    pub towards: &'a [[i16; 2]],
}

#[derive(Clone, Debug)]
struct ClassLayout {
    seed: u64,
    /// Ranges of a row that make up the hashed record; adjacent ones are joined.
    hashed: Vec<Range<usize>>,
}

impl RowLayout {
    /// Layout for a file of this schema and these classes.
    pub fn new(schema: &Schema, classes: &[PointClass]) -> Self {
        let mut at = 12;
        let attributes: Vec<_> = schema
            .attributes
            .iter()
            .map(|a| {
                at += a.ty.size();
                at - a.ty.size()..at
            })
            .collect();
        let class_at = (classes.len() > 1).then_some(at);
        let class_layout = |class: &PointClass| {
            let mut hashed = Vec::from_iter(std::iter::once(0..12));
            for &i in &class.present {
                let range = attributes[usize::from(i)].clone();
                match hashed.last_mut() {
                    Some(last) if last.end == range.start => last.end = range.end,
                    _ => hashed.push(range),
                }
            }
            ClassLayout { seed: class.seed(schema), hashed }
        };
        let bytes = at + if class_at.is_some() { 2 } else { 0 };
        let classes = classes.iter().map(class_layout).collect();
        Self {
            classes,
            attributes,
            class_at,
            normal_at: None,
            given_normal: None,
            clip_at: None,
            shape_at: None,
            bytes,
        }
    }

    /// Adds room for an estimated normal. Until it is estimated, the room holds the direction to
    /// the scanner, or up.
    pub fn with_normals(mut self) -> Self {
        self.normal_at = Some(self.bytes);
        self.bytes += 4;
        self
    }

    /// Lets the normals be read that sources give as these attributes of type `f32`.
    pub fn with_given_normals(mut self, attributes: [usize; 3]) -> Self {
        self.given_normal = Some(attributes);
        self
    }

    /// Whether sources give normals from which something is computed.
    pub fn has_given_normals(&self) -> bool {
        self.given_normal.is_some()
    }

    /// Octahedral code of the normal that the source gives a row, as pages store it; that of an
    /// unknown normal if it gives none. `None` if nothing is computed from given normals.
    pub fn given_normal(&self, row: &[u8]) -> Option<[i16; 2]> {
        let component = |attribute: usize| {
            let bytes = row[self.attributes[attribute].clone()].first_chunk::<4>();
            bytes.map_or(0.0, |bytes| f32::from_le_bytes(*bytes))
        };
        Some(oct_encode(self.given_normal?.map(component)))
    }

    /// Adds room for clip lines; at first there are none.
    pub fn with_clip_lines(mut self) -> Self {
        self.clip_at = Some(self.bytes);
        self.bytes += CLIP_BYTES;
        self
    }

    /// Clip lines of a row, relative to its position; `None` if there is no room for them.
    pub fn clip_lines(&self, row: &[u8]) -> Option<ClipWords> {
        let bytes = row[self.clip_at?..].as_chunks::<4>().0;
        Some([0, 1, 2, 3].map(|i| u32::from_le_bytes(bytes[i])))
    }

    /// Sets the clip lines of a row, if there is room for them.
    pub fn set_clip_lines(&self, row: &mut [u8], words: ClipWords) {
        if let Some(at) = self.clip_at {
            row[at..at + CLIP_BYTES].copy_from_slice(&words.map(u32::to_le_bytes).concat());
        }
    }

    /// Adds room for the shape of a splat; it is round until it is estimated.
    pub fn with_tangents(mut self) -> Self {
        self.shape_at = Some(self.bytes);
        self.bytes += SHAPE_BYTES;
        self
    }

    /// Shape of the splat of a row; `None` if there is no room for it.
    pub fn shape(&self, row: &[u8]) -> Option<Shape> {
        let at = self.shape_at?;
        let [x, y, rest @ ..] = row.get(at..at + SHAPE_BYTES)?.first_chunk::<SHAPE_BYTES>()?;
        let lengths = rest.as_chunks::<4>().0;
        let [apart, aspect] = [0, 1].map(|i| f32::from_le_bytes(lengths[i]));
        Some(Shape { along: axis_of([*x, *y].map(u8::cast_signed)), apart, aspect })
    }

    /// Sets the shape of the splat of a row, if there is room for it.
    pub fn set_shape(&self, row: &mut [u8], shape: &Shape) {
        if let Some(at) = self.shape_at {
            let axis = axis_code(shape.along).map(i8::cast_unsigned);
            row[at..at + 2].copy_from_slice(&axis);
            let lengths = [shape.apart, shape.aspect].map(f32::to_le_bytes).concat();
            row[at + 2..at + SHAPE_BYTES].copy_from_slice(&lengths);
        }
    }

    /// First byte in a row of the code of an estimated normal; `None` if there is no room for it.
    pub fn normal_at(&self) -> Option<usize> {
        self.normal_at
    }

    /// Octahedral code of the normal of a row; `None` if there is no room for it.
    pub fn normal(&self, row: &[u8]) -> Option<[i16; 2]> {
        let at = self.normal_at?;
        Some([at, at + 2].map(|at| i16::from_le_bytes([row[at], row[at + 1]])))
    }

    /// Sets the octahedral code of the normal of a row, if there is room for it.
    pub fn set_normal(&self, row: &mut [u8], [x, y]: [i16; 2]) {
        if let Some(at) = self.normal_at {
            row[at..at + 2].copy_from_slice(&x.to_le_bytes());
            row[at + 2..at + 4].copy_from_slice(&y.to_le_bytes());
        }
    }

    /// Bytes of a row.
    pub fn bytes(&self) -> usize {
        self.bytes
    }

    /// Class of a row.
    pub fn class(&self, row: &[u8]) -> u16 {
        self.class_at.map_or(0, |at| u16::from_le_bytes([row[at], row[at + 1]]))
    }

    /// Whether the class of a row exists: a damaged row may have any.
    pub fn is_possible(&self, row: &[u8]) -> bool {
        usize::from(self.class(row)) < self.classes.len()
    }

    /// Bytes of an attribute in a row.
    pub fn attribute(&self, index: usize) -> Range<usize> {
        self.attributes[index].clone()
    }

    /// Number of attributes.
    pub fn attribute_count(&self) -> usize {
        self.attributes.len()
    }

    /// Whether rows carry a class.
    pub fn has_class(&self) -> bool {
        self.class_at.is_some()
    }

    /// Adds a row to the multiset hash.
    fn hash(&self, row: &[u8], scratch: &mut Vec<u8>, hash: &mut MultisetHash) {
        let class = &self.classes[usize::from(self.class(row))];
        if let [whole] = class.hashed.as_slice() {
            return hash.add(class.seed, &row[whole.clone()]);
        }
        scratch.clear();
        class.hashed.iter().for_each(|r| scratch.extend_from_slice(&row[r.clone()]));
        hash.add(class.seed, scratch);
    }

    /// Adds all rows to the multiset hash. `scratch` is a buffer.
    pub fn hash_all(&self, rows: &[u8], scratch: &mut Vec<u8>, hash: &mut MultisetHash) {
        let rows = rows.chunks_exact(self.bytes);
        if let [ClassLayout { seed, hashed }] = self.classes.as_slice()
            && let [whole] = hashed.as_slice()
        {
            return rows.for_each(|row| hash.add(*seed, &row[whole.clone()]));
        }
        rows.for_each(|row| self.hash(row, scratch, hash));
    }

    /// Makes rows of a batch and passes them to `take` in order, a few at a
    /// time. Returns their hash.
    pub fn for_each_rows(
        &self,
        points: &Incoming<'_>,
        take: &mut dyn FnMut(&[u8]),
    ) -> MultisetHash {
        let (mut hash, mut scratch) = (MultisetHash::default(), Vec::new());
        let mut rows = vec![0u8; BLOCK_ROWS * self.bytes];
        let count = points.batch.len();
        for first in (0..count).step_by(BLOCK_ROWS) {
            let rows = &mut rows[..(count - first).min(BLOCK_ROWS) * self.bytes];
            self.fill(points, first, rows);
            self.hash_all(rows, &mut scratch, &mut hash);
            take(rows);
        }
        hash
    }

    /// Fills `rows` from the points of a batch from `first` on.
    fn fill(&self, points: &Incoming<'_>, first: usize, rows: &mut [u8]) {
        let Incoming { batch, class, to_file, towards } = points;
        for (row, [x, y, z]) in rows.chunks_exact_mut(self.bytes).zip(&batch.positions[first..]) {
            row[..4].copy_from_slice(&x.to_le_bytes());
            row[4..8].copy_from_slice(&y.to_le_bytes());
            row[8..12].copy_from_slice(&z.to_le_bytes());
            if let Some(at) = self.class_at {
                row[at..at + 2].copy_from_slice(&class.to_le_bytes());
            }
        }
        if !towards.is_empty() {
            let rows = rows.chunks_exact_mut(self.bytes);
            rows.zip(&towards[first..]).for_each(|(row, &code)| self.set_normal(row, code));
        }
        for (column, &attribute) in batch.columns.iter().zip(*to_file) {
            let Range { start, end } = self.attributes[attribute];
            let values = &column[first * (end - start)..];
            match end - start {
                1 => put::<1>(rows, self.bytes, start, values),
                2 => put::<2>(rows, self.bytes, start, values),
                4 => put::<4>(rows, self.bytes, start, values),
                _ => put::<8>(rows, self.bytes, start, values),
            }
        }
    }
}

/// Copies values of `N` bytes to the offset `at` of each row.
fn put<const N: usize>(rows: &mut [u8], stride: usize, at: usize, values: &[u8]) {
    for (row, value) in rows.chunks_exact_mut(stride).zip(values.chunks_exact(N)) {
        row[at..at + N].copy_from_slice(value);
    }
}

/// Copies a row by words of 16 bytes; the last word may overlap the one before it. Written without
/// a loop, which would be compiled to a call for each row.
#[inline]
pub fn copy_row(to: &mut [u8], from: &[u8]) {
    const WORD: usize = 16;
    let (Some(last), Some(end)) = (from.last_chunk::<WORD>(), to.last_chunk_mut::<WORD>()) else {
        return to.copy_from_slice(from);
    };
    *end = *last;
    match (to.as_chunks_mut().0, from.as_chunks::<WORD>().0) {
        ([a], [x]) => *a = *x,
        ([a, b], [x, y]) => (*a, *b) = (*x, *y),
        ([a, b, c], [x, y, z]) => (*a, *b, *c) = (*x, *y, *z),
        ([a, b, c, d], [x, y, z, w]) => (*a, *b, *c, *d) = (*x, *y, *z, *w),
        (to, from) => to.copy_from_slice(from),
    }
}

/// Lattice position of a row.
#[inline]
pub fn position(row: &[u8]) -> [u32; 3] {
    // One bounds check, and no closures: no other function is called as often.
    let words = row[..12].as_chunks::<4>().0;
    [u32::from_le_bytes(words[0]), u32::from_le_bytes(words[1]), u32::from_le_bytes(words[2])]
}

/// Consecutive rows.
#[derive(Clone, Copy, Debug)]
pub struct Rows<'a> {
    /// Bytes of all rows.
    pub bytes: &'a [u8],
    /// Bytes of a row.
    pub stride: usize,
}

impl<'a> Rows<'a> {
    /// Number of rows.
    pub fn len(&self) -> usize {
        self.bytes.len() / self.stride
    }

    /// Bytes of a row.
    pub fn row(&self, index: u32) -> &'a [u8] {
        &self.bytes[index as usize * self.stride..][..self.stride]
    }

    /// Position of a row.
    #[inline]
    pub fn position(&self, index: u32) -> [u32; 3] {
        position(&self.bytes[index as usize * self.stride..][..12])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use esker_points::{AttrType, Attribute, ColourDepth};
    use std::sync::Arc;

    #[test]
    fn absent_attributes_are_not_hashed_so_unions_add_up() {
        let a = Arc::new(Schema::new(vec![
            Attribute::new("gps_time", AttrType::F64),
            Attribute::new("user_data", AttrType::U8),
        ]));
        let alone = [PointClass { present: vec![0, 1], colour_depth: ColourDepth::Sixteen }];
        let mut batch = Batch::with_capacity(a.clone(), 1);
        batch.positions.push([1, 2, 3]);
        batch.columns = vec![7.5f64.to_le_bytes().to_vec(), vec![9]];

        let one = Incoming { batch: &batch, class: 0, to_file: &[0, 1], towards: &[] };
        let hash_alone = RowLayout::new(&a, &alone).for_each_rows(&one, &mut |_| ());

        let union = a.union(&Schema::new(vec![Attribute::new("intensity", AttrType::U16)]));
        let classes = [
            PointClass { present: vec![1], colour_depth: ColourDepth::Sixteen },
            PointClass { present: vec![0, 2], colour_depth: ColourDepth::Sixteen },
        ];
        let layout = RowLayout::new(&union, &classes);
        let other = Incoming { batch: &batch, class: 1, to_file: &[0, 2], towards: &[] };
        let mut rows = Vec::new();
        let hash_union = layout.for_each_rows(&other, &mut |some| rows.extend_from_slice(some));
        assert_eq!(hash_alone, hash_union);
        assert_eq!((layout.class(&rows), position(&rows)), (1, [1, 2, 3]));
        assert_eq!(rows.len(), layout.bytes());
    }
}
