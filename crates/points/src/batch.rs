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
    /// Index and world coordinates of each point that the lattice does not hold, ascending; its
    /// position means nothing.
    pub outside: Vec<(usize, [f64; 3])>,
}

/// What placing points on the lattice changes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Rounding {
    /// Greatest distance along one axis by which a coordinate was rounded, in world units.
    pub error_max: f64,
    /// Number of points placed.
    pub placed: usize,
    /// Number, counted from 0, and world coordinates of each point outside of the lattice.
    pub outside: Vec<(usize, [f64; 3])>,
}

impl Batch {
    /// An empty batch with room for `capacity` points.
    pub fn with_capacity(schema: Arc<Schema>, capacity: usize) -> Self {
        let columns = schema
            .attributes
            .iter()
            .map(|a| Column::with_capacity(capacity * a.ty.size()))
            .collect();
        Self { schema, positions: Vec::with_capacity(capacity), columns, outside: Vec::new() }
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
        self.outside.retain(|(i, _)| *i >= count);
        self.outside.iter_mut().for_each(|(i, _)| *i -= count);
        for (a, column) in self.schema.attributes.iter().zip(&mut self.columns) {
            column.drain(..count * a.ty.size());
        }
    }

    /// Removes the points outside of the lattice; returns the world coordinates of each and the
    /// bytes of its attributes, in the order of the schema.
    pub fn take_outside(&mut self) -> Vec<([f64; 3], Vec<u8>)> {
        if self.outside.is_empty() {
            return Vec::new();
        }
        let mut outside = std::mem::take(&mut self.outside).into_iter().peekable();
        let mut taken = Vec::with_capacity(outside.len());
        let mut kept = 0;
        for i in 0..self.positions.len() {
            let world = outside.next_if(|(at, _)| *at == i).map(|(_, world)| world);
            let mut values = Vec::new();
            for (a, column) in self.schema.attributes.iter().zip(&mut self.columns) {
                let size = a.ty.size();
                match world {
                    Some(_) => values.extend_from_slice(&column[i * size..][..size]),
                    None => column.copy_within(i * size..(i + 1) * size, kept * size),
                }
            }
            match world {
                Some(world) => taken.push((world, values)),
                None => {
                    self.positions[kept] = self.positions[i];
                    kept += 1;
                }
            }
        }
        self.positions.truncate(kept);
        for (a, column) in self.schema.attributes.iter().zip(&mut self.columns) {
            column.truncate(kept * a.ty.size());
        }
        taken
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
