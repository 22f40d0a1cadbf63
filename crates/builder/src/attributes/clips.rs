//! Clip lines of splats (`zwicker2004`, section 5) in the form that pages store: from attributes of
//! the sources, or from the rows, if edges were detected.

use crate::rows::row::{RowLayout, Rows, position};
use esker_points::{Clip, ClipLine, ClipWords, Grain, Lattice, Node, Schema};

/// Source of the clip lines of points.
#[derive(Clone, Debug)]
pub struct Clips {
    lattice: Lattice,
    grain: Grain,
    /// Attributes that hold the number of lines and their ends; `None` if edges are detected.
    attributes: Option<(usize, [[usize; 3]; 4])>,
}

impl Clips {
    /// Clip lines that are detected, or else those of the attributes of `schema`; `None` if there
    /// are neither.
    pub fn of(schema: &Schema, lattice: &Lattice, finds_edges: bool) -> Option<Self> {
        let attributes = schema.clip_lines().filter(|_| !finds_edges);
        let grain = Grain::new(lattice.metric().scale);
        let clips = Self { lattice: *lattice, grain, attributes };
        (finds_edges || attributes.is_some()).then_some(clips)
    }

    /// Encodes the clip lines of a node's own points.
    pub fn words(
        &self,
        rows: &Rows<'_>,
        own: &[u32],
        layout: &RowLayout,
        node: &Node,
    ) -> Vec<ClipWords> {
        let words = |&i: &u32| {
            let row = rows.row(i);
            let clip = self.clip(row, layout);
            if clip.is_none() {
                return [0; 4];
            }
            let (p, shift) = (position(row), node.hot_shift);
            let hot = [0, 1, 2].map(|i| {
                let least = node.box_min[i];
                least + (((p[i] - least) >> shift) << shift)
            });
            clip.words(hot, self.grain)
        };
        own.iter().map(words).collect()
    }

    /// Clip lines of a row.
    fn clip(&self, row: &[u8], layout: &RowLayout) -> Clip {
        let Some((number, ends)) = self.attributes else {
            let words = layout.clip_lines(row).unwrap_or_default();
            return Clip::of_words(words, position(row), self.grain);
        };
        let value = |attribute: usize| &row[layout.attribute(attribute)];
        let number = value(number)[0];
        let end = |end: usize| {
            [0, 1, 2].map(|axis| {
                let bytes = value(ends[end][axis]).try_into().unwrap_or_default();
                self.lattice.steps_axis(axis, f64::from_le_bytes(bytes))
            })
        };
        let line = |first: usize| ClipLine::through(end(first), end(first + 1), self.grain);
        let lines = match number {
            0 => [None; 2],
            1 => [line(0), None],
            _ => [line(0), line(2)],
        };
        // A point that either line keeps is kept: if one line is degenerate, that is everything.
        let either = number == 3;
        let lost = either && lines.contains(&None);
        if lost { Clip::default() } else { Clip { lines, either } }
    }
}
