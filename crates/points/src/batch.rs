//! Columnar batches: a run of decoded points, with positions on the lattice and one column of raw
//! little-endian values an attribute. Readers make batches, the builder consumes them.

use crate::schema::Schema;
use std::sync::Arc;

/// Raw little-endian values of one attribute, contiguous.
pub type Column = Vec<u8>;

/// A run of points that all have the same attributes.
#[derive(Clone, Debug)]
pub struct Batch {
    /// Attributes; `columns` has one entry for each, in this order.
    pub schema: Arc<Schema>,
    /// Lattice coordinates.
    pub positions: Vec<[u32; 3]>,
    /// One column an attribute, `positions.len() * type size` bytes each.
    pub columns: Vec<Column>,
}

impl Batch {
    /// An empty batch with room for `capacity` points.
    pub fn with_capacity(schema: Arc<Schema>, capacity: usize) -> Self {
        let columns = schema
            .attributes
            .iter()
            .map(|a| Column::with_capacity(capacity * a.ty.size()))
            .collect();
        Self { schema, positions: Vec::with_capacity(capacity), columns }
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// Whether there is no point.
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// Whether every column has as many values as there are positions.
    pub fn is_consistent(&self) -> bool {
        self.columns.len() == self.schema.attributes.len()
            && self
                .schema
                .attributes
                .iter()
                .zip(&self.columns)
                .all(|(a, c)| c.len() == self.len() * a.ty.size())
    }

    /// Removes the first `count` points.
    ///
    /// # Panics
    /// If there are fewer.
    pub fn drop_first(&mut self, count: usize) {
        if count == 0 {
            return;
        }
        self.positions.drain(..count);
        for (a, column) in self.schema.attributes.iter().zip(&mut self.columns) {
            column.drain(..count * a.ty.size());
        }
    }

    /// Appends the raw record of point `index` to `out`: x, y, z, then the attributes in the
    /// schema's order. With a schema in canonical order this is the input of
    /// [`crate::MultisetHash`].
    pub fn record_into(&self, index: usize, out: &mut Vec<u8>) {
        for c in self.positions[index] {
            out.extend_from_slice(&c.to_le_bytes());
        }
        for (a, column) in self.schema.attributes.iter().zip(&self.columns) {
            let size = a.ty.size();
            out.extend_from_slice(&column[index * size..][..size]);
        }
    }
}
