//! Statistics: the least and greatest value of each attribute, in its own type, and the classes
//! that occur, for each node's own points and for its subtree; one histogram an attribute for the
//! whole file; and the sides of the nodes' contours. NaN and absent values are ignored; -0 counts
//! as +0.

use crate::error::Fault;
use crate::layout::PageLayout;
use crate::points::PagePoints;
use crate::values::{Bins, count_bytes, finite_range, present, raw_range};
use esker_points::attribute::names;
use esker_points::node::Sides;
use esker_points::{AttrType, NodeTable, Schema};

pub use crate::values::BINS;

const SIGN: u64 = 1 << 63;

/// An unsigned number with the order of the value, which is not NaN.
fn key(ty: AttrType, value: [u8; 8]) -> u64 {
    let bits = u64::from_le_bytes(value);
    let signed = |bits: u32| ((bits as i64) << (64 - 8 * ty.size()) >> (64 - 8 * ty.size())) as u64;
    match ty {
        AttrType::U8 | AttrType::U16 | AttrType::U32 | AttrType::U64 => bits,
        AttrType::I8 | AttrType::I16 | AttrType::I32 => signed(bits as u32) ^ SIGN,
        AttrType::I64 => bits ^ SIGN,
        AttrType::F32 => real_key(f64::from(f32::from_bits(bits as u32))),
        AttrType::F64 => real_key(f64::from_bits(bits)),
    }
}

fn real_key(v: f64) -> u64 {
    let bits = (v + 0.0).to_bits();
    if bits & SIGN == 0 { bits | SIGN } else { !bits }
}

fn real(key: u64) -> f64 {
    f64::from_bits(if key & SIGN == 0 { !key } else { key & !SIGN })
}

/// Appends the value of a key.
fn push_raw(ty: AttrType, key: u64, out: &mut Vec<u8>) {
    let bits = match ty {
        AttrType::U8 | AttrType::U16 | AttrType::U32 | AttrType::U64 => key,
        AttrType::I8 | AttrType::I16 | AttrType::I32 | AttrType::I64 => key ^ SIGN,
        AttrType::F32 => u64::from((real(key) as f32).to_bits()),
        AttrType::F64 => real(key).to_bits(),
    };
    out.extend_from_slice(&bits.to_le_bytes()[..ty.size()]);
}

/// Least and greatest value of each attribute and classes of one node's own points, and the sides
/// of its contour.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NodeStatistics {
    /// Keys of least and greatest value of each attribute.
    ranges: Vec<(u64, u64)>,
    class_bits: [u64; 4],
    /// Zeros if unknown.
    sides: Sides,
}

impl NodeStatistics {
    /// Statistics of these points.
    pub fn of(layout: &PageLayout, points: &PagePoints) -> Self {
        let mut scratch = Vec::new();
        let attributes = layout.schema().attributes.iter().enumerate();
        let ranges = attributes.map(|(a, attribute)| {
            let range = raw_range(attribute.ty, present(layout, points, a, &mut scratch));
            let [least, greatest] = range.map(|value| key(attribute.ty, value));
            (least, greatest)
        });
        Self { ranges: ranges.collect(), class_bits: class_bits(layout, points), sides: [0; 2] }
    }

    /// Statistics of points of which nothing is known: any value and class may be among them.
    pub fn unknown(schema: &Schema) -> Self {
        let ranges = schema.attributes.iter().map(|attribute| match attribute.ty {
            AttrType::F32 | AttrType::F64 => (real_key(f64::NEG_INFINITY), real_key(f64::INFINITY)),
            ty => {
                // Of signed types the least has the sign bit alone.
                let bits = u64::MAX >> (64 - 8 * ty.size());
                let [low, high] = match ty {
                    AttrType::I8 | AttrType::I16 | AttrType::I32 | AttrType::I64 => {
                        [bits ^ bits >> 1, bits >> 1]
                    }
                    _ => [0, bits],
                };
                (key(ty, low.to_le_bytes()), key(ty, high.to_le_bytes()))
            }
        });
        let has_classes = schema.find_typed(names::CLASSIFICATION, AttrType::U8).is_some();
        let class_bits = if has_classes { [u64::MAX; 4] } else { [0; 4] };
        Self { ranges: ranges.collect(), class_bits, sides: [u64::MAX; 2] }
    }

    /// Adds other points of the same node.
    pub(crate) fn merge(&mut self, other: &Self) {
        for (range, o) in self.ranges.iter_mut().zip(&other.ranges) {
            *range = (range.0.min(o.0), range.1.max(o.1));
        }
        self.class_bits.iter_mut().zip(other.class_bits).for_each(|(bits, o)| *bits |= o);
    }

    /// Sets the sides of the contour around the points.
    pub fn with_sides(self, sides: Sides) -> Self {
        Self { sides, ..self }
    }

    /// Packs the statistics into words, to be stored outside of a file.
    pub fn to_words(&self) -> Vec<u64> {
        let ranges = self.ranges.iter().flat_map(|r| [r.0, r.1]);
        self.sides.into_iter().chain(self.class_bits).chain(ranges).collect()
    }

    /// Unpacks the words of [`NodeStatistics::to_words`]; `None` if they are not for `attributes`
    /// attributes.
    pub fn from_words(words: &[u64], attributes: usize) -> Option<Self> {
        let (sides, words) = words.split_first_chunk()?;
        let (class_bits, ranges) = words.split_first_chunk()?;
        let (ranges, rest) = ranges.as_chunks::<2>();
        let fits = ranges.len() == attributes && rest.is_empty();
        let ranges = ranges.iter().map(|r| (r[0], r[1])).collect();
        fits.then_some(Self { ranges, class_bits: *class_bits, sides: *sides })
    }
}

fn class_bits(layout: &PageLayout, points: &PagePoints) -> [u64; 4] {
    let mut bits = [0; 4];
    if let Some(a) = layout.schema().find_typed(names::CLASSIFICATION, AttrType::U8) {
        let counts = count_bytes(present(layout, points, a, &mut Vec::new()));
        for (class, _) in counts.iter().enumerate().filter(|(_, n)| **n > 0) {
            bits[class / 64] |= 1 << (class % 64);
        }
    }
    bits
}

/// Least and greatest finite value of each attribute over all points: the range of its histogram.
#[derive(Clone, Debug, PartialEq)]
pub struct Ranges {
    ranges: Vec<(f64, f64)>,
}

impl Ranges {
    /// Ranges of no points.
    pub fn new(schema: &Schema) -> Self {
        Self { ranges: vec![(f64::INFINITY, f64::NEG_INFINITY); schema.attributes.len()] }
    }

    /// Adds raw values of one attribute, of points that have it.
    pub fn add_column(&mut self, attribute: usize, ty: AttrType, column: &[u8]) {
        let of = finite_range(ty, column);
        let range = &mut self.ranges[attribute];
        *range = (range.0.min(of.0), range.1.max(of.1));
    }

    /// Adds all attributes of these points.
    pub fn add(&mut self, layout: &PageLayout, points: &PagePoints) {
        let mut scratch = Vec::new();
        for (a, attribute) in layout.schema().attributes.iter().enumerate() {
            self.add_column(a, attribute.ty, present(layout, points, a, &mut scratch));
        }
    }

    /// Whether all numbers are equal bit by bit: 0 is not -0.
    pub(crate) fn is_same(&self, other: &Self) -> bool {
        let bits = |r: &(f64, f64)| (r.0.to_bits(), r.1.to_bits());
        self.ranges.iter().map(bits).eq(other.ranges.iter().map(bits))
    }

    /// Adds the ranges of other points.
    pub fn merge(&mut self, other: &Self) {
        for (range, o) in self.ranges.iter_mut().zip(&other.ranges) {
            *range = (range.0.min(o.0), range.1.max(o.1));
        }
    }

    /// Least and greatest value of an attribute; the least is above the greatest if there is no
    /// value.
    pub fn of(&self, attribute: usize) -> (f64, f64) {
        self.ranges[attribute]
    }
}

/// One histogram an attribute: [`BINS`] bins of equal width over its range.
#[derive(Clone, Debug, PartialEq)]
pub struct Histograms {
    pub(crate) ranges: Ranges,
    pub(crate) counts: Vec<[u64; BINS]>,
}

impl Histograms {
    /// Empty histograms over these ranges.
    pub fn new(ranges: Ranges) -> Self {
        let counts = vec![[0; BINS]; ranges.ranges.len()];
        Self { ranges, counts }
    }

    /// Counts the values of these points. Values that are not finite or outside the range are not
    /// counted.
    pub fn add(&mut self, layout: &PageLayout, points: &PagePoints) {
        for a in 0..layout.schema().attributes.len() {
            let counts = self.ranges.counts_of(a, layout, points);
            self.add_counts(a, &counts);
        }
    }

    /// Adds counts of other points to an attribute's bins.
    pub fn add_counts(&mut self, attribute: usize, counts: &[u64; BINS]) {
        self.counts[attribute].iter_mut().zip(counts).for_each(|(sum, n)| *sum += n);
    }

    /// Adds the counts of other points over the same ranges.
    pub fn merge(&mut self, other: &Self) {
        for (a, counts) in other.counts.iter().enumerate() {
            self.add_counts(a, counts);
        }
    }

    /// Ranges of the histograms.
    pub fn ranges(&self) -> &Ranges {
        &self.ranges
    }

    /// Bin of an attribute that a value falls into; `None` outside of its range.
    pub fn bin_of(&self, attribute: usize, value: f64) -> Option<usize> {
        let (least, greatest) = self.ranges.of(attribute);
        Some(Bins::new(least, greatest).of(value)).filter(|&bin| bin < BINS)
    }

    /// Bins of an attribute.
    pub fn counts(&self, attribute: usize) -> &[u64; BINS] {
        &self.counts[attribute]
    }
}

impl Ranges {
    /// Ranges given as pairs, one an attribute.
    pub fn from_pairs(ranges: Vec<(f64, f64)>) -> Self {
        Self { ranges }
    }

    /// Number of values of an attribute of these points in each bin.
    pub(crate) fn counts_of(
        &self,
        a: usize,
        layout: &PageLayout,
        points: &PagePoints,
    ) -> [u64; BINS] {
        let (least, greatest) = self.ranges[a];
        let ty = layout.schema().attributes[a].ty;
        Bins::new(least, greatest).counts(ty, present(layout, points, a, &mut Vec::new()))
    }
}

/// Side table: columns over the nodes, in table order.
#[derive(Clone, Debug, PartialEq)]
pub struct Statistics {
    pub(crate) types: Vec<AttrType>,
    pub(crate) nodes: usize,
    /// For each attribute: least and greatest value of own points, then of the subtree's.
    pub(crate) ranges: Vec<[Vec<u8>; 4]>,
    /// Whether the file has a classification.
    pub(crate) has_classes: bool,
    /// Classes of own points, then of the subtree's; empty without classification.
    pub(crate) class_bits: [Vec<[u64; 4]>; 2],
    pub(crate) histograms: Histograms,
    /// Sides of the contours; `None` in files written before there was such a column.
    pub(crate) sides: Option<Vec<Sides>>,
}

impl Statistics {
    /// Joins the nodes' own statistics, in table order, and sums up subtrees.
    ///
    /// # Panics
    /// If `own` does not have one entry for each node.
    pub fn assemble(
        table: &NodeTable,
        schema: &Schema,
        own: Vec<NodeStatistics>,
        histograms: Histograms,
    ) -> Self {
        assert_eq!(own.len(), table.nodes.len(), "statistics for each node");
        let types: Vec<_> = schema.attributes.iter().map(|a| a.ty).collect();
        let ranges = types.iter().enumerate().map(|(a, &ty)| {
            let mine: Vec<_> = own.iter().map(|n| n.ranges[a]).collect();
            let below = fold_up(table, mine.clone(), |p, c| (p.0.min(c.0), p.1.max(c.1)));
            let column = |keys: &mut dyn Iterator<Item = u64>| {
                let mut out = Vec::with_capacity(own.len() * ty.size());
                keys.for_each(|key| push_raw(ty, key, &mut out));
                out
            };
            [
                column(&mut mine.iter().map(|r| r.0)),
                column(&mut mine.iter().map(|r| r.1)),
                column(&mut below.iter().map(|r| r.0)),
                column(&mut below.iter().map(|r| r.1)),
            ]
        });
        let has_classes = schema.find_typed(names::CLASSIFICATION, AttrType::U8).is_some();
        let mut class_bits = [Vec::new(), Vec::new()];
        if has_classes {
            let mine: Vec<_> = own.iter().map(|n| n.class_bits).collect();
            let or = |p: [u64; 4], c: [u64; 4]| [0, 1, 2, 3].map(|i| p[i] | c[i]);
            let below = fold_up(table, mine.clone(), or);
            class_bits = [mine, below];
        }
        let ranges = ranges.collect();
        let has_sides = own.iter().all(|n| n.sides != [0; 2]);
        let sides = has_sides.then(|| own.iter().map(|n| n.sides).collect());
        Self { types, nodes: table.nodes.len(), ranges, has_classes, class_bits, histograms, sides }
    }

    /// Checks that the statistics belong to this table and schema.
    pub(crate) fn check_shape(&self, table: &NodeTable, schema: &Schema) -> Result<(), Fault> {
        let types = schema.attributes.iter().map(|a| a.ty);
        if self.nodes != table.nodes.len() || !types.eq(self.types.iter().copied()) {
            return Err(Fault::new("statistics", "they are of another table or schema"));
        }
        Ok(())
    }

    fn range(&self, node: u32, attribute: usize, columns: [usize; 2]) -> Option<(f64, f64)> {
        let ty = *self.types.get(attribute)?;
        let value = |column: usize| {
            let bytes = self.ranges[attribute][column].get(node as usize * ty.size()..)?;
            (bytes.len() >= ty.size()).then(|| ty.to_f64(bytes))
        };
        let (least, greatest) = (value(columns[0])?, value(columns[1])?);
        (least <= greatest).then_some((least, greatest))
    }

    /// Least and greatest value of an attribute among a node's own points; `None` if no point has a
    /// value.
    pub fn own(&self, node: u32, attribute: usize) -> Option<(f64, f64)> {
        self.range(node, attribute, [0, 1])
    }

    /// Least and greatest value of an attribute in a node's subtree; `None` if no point has a
    /// value.
    pub fn subtree(&self, node: u32, attribute: usize) -> Option<(f64, f64)> {
        self.range(node, attribute, [2, 3])
    }

    /// Stored bytes of least and greatest value, without rounding.
    fn stored(&self, node: u32, attribute: usize, columns: [usize; 2]) -> Option<[&[u8]; 2]> {
        let ty = *self.types.get(attribute)?;
        let value = |column: usize| {
            self.ranges[attribute][column].get(node as usize * ty.size()..)?.get(..ty.size())
        };
        let ends = [value(columns[0])?, value(columns[1])?];
        let [least, greatest] = ends.map(|bytes| {
            let mut raw = [0; 8];
            raw[..bytes.len()].copy_from_slice(bytes);
            key(ty, raw)
        });
        (least <= greatest).then_some(ends)
    }

    /// Bytes of the least and greatest value of an attribute among a node's own points, as stored;
    /// `None` if no point has a value.
    pub fn own_stored(&self, node: u32, attribute: usize) -> Option<[&[u8]; 2]> {
        self.stored(node, attribute, [0, 1])
    }

    /// Bytes of the least and greatest value of an attribute in a node's subtree, as stored; `None`
    /// if no point has a value.
    pub fn subtree_stored(&self, node: u32, attribute: usize) -> Option<[&[u8]; 2]> {
        self.stored(node, attribute, [2, 3])
    }

    /// One bit for each ASPRS class among a node's own points (class `c`: bit `c % 64` of word
    /// `c / 64`); `None` if the file has no classification.
    pub fn own_classes(&self, node: u32) -> Option<[u64; 4]> {
        self.class_bits[0].get(node as usize).copied()
    }

    /// Classes in a node's subtree, as in [`Statistics::own_classes`].
    pub fn subtree_classes(&self, node: u32) -> Option<[u64; 4]> {
        self.class_bits[1].get(node as usize).copied()
    }

    /// Histograms of the file.
    pub fn histograms(&self) -> &Histograms {
        &self.histograms
    }
}

/// Folds every node's value into its parent's, deepest first: parents come before their children.
fn fold_up<T: Copy>(table: &NodeTable, mut values: Vec<T>, join: impl Fn(T, T) -> T) -> Vec<T> {
    for index in (1..values.len()).rev() {
        let parent = table.nodes[index].parent as usize;
        values[parent] = join(values[parent], values[index]);
    }
    values
}
