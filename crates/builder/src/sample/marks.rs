//! Where rows say that their points are on wires: by their class, or by the estimation of normals.

use crate::attributes::normals::WIRE;

/// Classes of wires (`asprs2019`, table 17): guards, conductors and connectors.
const WIRES: [u8; 3] = [13, 14, 16];
/// Whether any class of a range is that of a wire.
pub fn has_wires([low, high]: [f64; 2]) -> bool {
    WIRES.iter().any(|&class| (low..=high).contains(&f64::from(class)))
}

/// Where rows say that their points are on wires.
#[derive(Clone, Copy)]
pub struct WireMarks {
    /// Byte of the ASPRS class; `None` if no class is that of a wire.
    pub class_at: Option<usize>,
    /// First byte of the code of an estimated normal.
    pub normal_at: Option<usize>,
}

impl WireMarks {
    /// Whether any row may have a mark.
    pub fn any(self) -> bool {
        self.class_at.is_some() || self.normal_at.is_some()
    }

    /// Whether the point of a row is on a wire.
    pub fn is_wire(self, row: &[u8]) -> bool {
        let [x, y] = WIRE.map(i16::to_le_bytes);
        let is_marked = |at: usize| row[at..at + 4] == [x[0], x[1], y[0], y[1]];
        self.class_at.is_some_and(|at| WIRES.contains(&row[at]))
            || self.normal_at.is_some_and(is_marked)
    }
}
