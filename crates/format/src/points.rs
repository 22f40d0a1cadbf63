//! A node's points as columns, and their multiset hash.

use crate::layout::PageLayout;
use esker_points::tangents::TANGENT_BYTES;
use esker_points::{ClipWords, MultisetHash};

/// Records that are assembled at a time.
const BLOCK: usize = 128;
/// Greatest size of these, bytes: a record may have 65,000 attributes.
const BLOCK_BYTES: usize = 1 << 20;

/// Points of a node, in their stored order.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PagePoints {
    /// Lattice coordinates.
    pub positions: Vec<[u32; 3]>,
    /// Radius of each point, see [`esker_points::quant::radius_code`].
    pub radius_codes: Vec<u8>,
    /// Class of each point; empty if the file has one class.
    pub classes: Vec<u16>,
    /// Estimated normals, see [`esker_points::quant::oct_encode`]; empty if the layout has none.
    /// Not part of the hash.
    pub normals: Vec<[i16; 2]>,
    /// Clip lines of splats, see [`esker_points::clip`], as stored; empty if the layout has none.
    /// Not part of the hash.
    pub clip_lines: Vec<ClipWords>,
    /// Shapes of splats, see [`esker_points::tangents`]; empty if the layout has none. Not part of
    /// the hash.
    pub tangents: Vec<[u8; TANGENT_BYTES]>,
    /// One column an attribute of the file's schema, raw little-endian values; zero bytes if a
    /// point's class does not have the attribute.
    pub columns: Vec<Vec<u8>>,
}

impl PagePoints {
    /// No points, with all columns of a layout.
    pub fn empty(layout: &PageLayout) -> Self {
        let columns = vec![Vec::new(); layout.schema().attributes.len()];
        Self { columns, ..Self::default() }
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// Whether there is no point.
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// Class of a point.
    pub fn class(&self, point: usize) -> usize {
        self.classes.get(point).map_or(0, |&c| usize::from(c))
    }

    /// Whether every column has one value a point, and every class exists.
    pub fn is_consistent(&self, layout: &PageLayout) -> bool {
        let attributes = &layout.schema().attributes;
        let n = self.len();
        let classes_max = layout.classes().len().max(1);
        self.radius_codes.len() == n
            && self.normals.len() == if layout.normals().is_estimated() { n } else { 0 }
            && self.clip_lines.len() == if layout.has_clip_lines() { n } else { 0 }
            && self.tangents.len() == if layout.has_tangents() { n } else { 0 }
            && self.classes.len() == if layout.classes().len() > 1 { n } else { 0 }
            && self.classes.iter().all(|&c| usize::from(c) < classes_max)
            && self.columns.len() == attributes.len()
            && attributes.iter().zip(&self.columns).all(|(a, c)| c.len() == n * a.ty.size())
    }

    /// Multiset hash of these points; the footer has the sum over all nodes.
    pub fn hash(&self, layout: &PageLayout) -> MultisetHash {
        let mut of_class: Vec<Vec<u32>> = vec![Vec::new(); layout.classes().len().max(1)];
        if self.classes.is_empty() {
            of_class[0] = (0..self.len() as u32).collect();
        }
        for (point, &class) in (0..).zip(&self.classes) {
            of_class[usize::from(class)].push(point);
        }
        let mut hash = MultisetHash::default();
        for (class, points) in of_class.iter().enumerate() {
            self.hash_class(layout, class, points, &mut hash);
        }
        hash
    }

    /// Adds points of one class.
    fn hash_class(
        &self,
        layout: &PageLayout,
        class: usize,
        points: &[u32],
        hash: &mut MultisetHash,
    ) {
        let schema = layout.schema();
        let class = layout.classes().get(class);
        let seed = class.map(|c| c.seed(schema)).unwrap_or_default();
        let present = class.map_or(&[][..], |c| &c.present);
        let size = |a: u16| schema.attributes[usize::from(a)].ty.size();
        let stride = 12 + present.iter().map(|&a| size(a)).sum::<usize>();
        let block = BLOCK.min(BLOCK_BYTES / stride).max(1);
        let mut records = vec![0; block * stride];
        for block in points.chunks(block) {
            let records = &mut records[..block.len() * stride];
            for (record, &i) in records.chunks_exact_mut(stride).zip(block) {
                for (bytes, c) in
                    record.as_chunks_mut::<4>().0.iter_mut().zip(self.positions[i as usize])
                {
                    *bytes = c.to_le_bytes();
                }
            }
            let mut at = 12;
            for &a in present {
                let column = &self.columns[usize::from(a)];
                match size(a) {
                    1 => copy::<1>(column, block, records, stride, at),
                    2 => copy::<2>(column, block, records, stride, at),
                    4 => copy::<4>(column, block, records, stride, at),
                    _ => copy::<8>(column, block, records, stride, at),
                }
                at += size(a);
            }
            records.chunks_exact(stride).for_each(|record| hash.add(seed, record));
        }
    }
}

/// Copies the values of these points into their records.
fn copy<const N: usize>(
    column: &[u8],
    points: &[u32],
    records: &mut [u8],
    stride: usize,
    at: usize,
) {
    let values = column.as_chunks::<N>().0;
    for (record, &i) in records.chunks_exact_mut(stride).zip(points) {
        record[at..at + N].copy_from_slice(&values[i as usize]);
    }
}
