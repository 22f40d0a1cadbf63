//! Columns of the tables for people: titles, widths, and rows of cells.

/// Columns of tables for people: titles and widths, negative for text.
pub(super) const COLUMNS: [(&str, isize); 14] = [
    ("method", -10),
    ("setting", -34),
    ("by", -4),
    ("points", 11),
    ("ms", 8),
    ("CPU ms", 8),
    ("FLIP", 7),
    ("own", 7),
    ("off %", 8),
    ("holes %", 8),
    ("behind %", 8),
    ("depth px", 8),
    ("normal deg", 10),
    ("flicker", 8),
];

/// A value with one digit, or a dash for none.
pub(super) fn or_dash(value: Option<f64>) -> String {
    value.map_or("-".into(), |value| format!("{value:.1}"))
}

/// A row of these cells.
pub(super) fn in_columns(cells: &[String]) -> String {
    COLUMNS.iter().zip(cells).map(|((_, width), cell)| padded(cell, *width)).collect()
}

/// A cell of `width` characters: to the right, or to the left if the width is negative.
pub(super) fn padded(cell: &str, width: isize) -> String {
    let room = width.unsigned_abs();
    if width < 0 { format!("{cell:<room$} ") } else { format!("{cell:>room$} ") }
}
