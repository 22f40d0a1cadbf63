//! Guesses what the columns of a file without names hold, from their number and their values: an
//! intensity, three bytes of a colour, three parts of a normal. Only an arrangement that is the
//! only possible one is taken; of PTS files else the usual one, intensity before colour before
//! normal.

use super::ranges::{Range, Unit};
use esker_points::attribute::names;

/// What stands behind x, y and z.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Group {
    Intensity,
    Colour,
    Normal,
}

use Group::{Colour, Intensity, Normal};

/// All arrangements; the first of each number of columns is the usual one.
const ARRANGEMENTS: [&[Group]; 15] = [
    &[Intensity],
    &[Colour],
    &[Normal],
    &[Intensity, Colour],
    &[Colour, Intensity],
    &[Intensity, Normal],
    &[Normal, Intensity],
    &[Colour, Normal],
    &[Normal, Colour],
    &[Intensity, Colour, Normal],
    &[Colour, Intensity, Normal],
    &[Colour, Normal, Intensity],
    &[Intensity, Normal, Colour],
    &[Normal, Intensity, Colour],
    &[Normal, Colour, Intensity],
];

/// Greatest value of an intensity, and of a part of a colour.
const INTENSITY_MAX: f64 = 65_535.0;
const COLOUR_MAX: f64 = 255.0;

impl Group {
    fn columns(self) -> &'static [&'static str] {
        match self {
            Intensity => &[names::INTENSITY],
            Colour => &[names::RED, names::GREEN, names::BLUE],
            Normal => &[names::NX, names::NY, names::NZ],
        }
    }

    /// Whether the columns from `at` may hold this. Vectors of length 1 are no colours.
    fn fits(self, at: usize, ranges: &[Range], units: &[Unit]) -> bool {
        let is_normal = units.get(at).is_some_and(Unit::is_normal);
        match self {
            Intensity => true,
            Normal => is_normal,
            Colour => {
                !is_normal
                    && ranges[at..at + 3]
                        .iter()
                        .all(|range| range.numbers > 0 && range.is_whole_within(0.0, COLOUR_MAX))
            }
        }
    }
}

/// Names for the columns of lines without names: `x`, `y`, `z` and what follows; `column_4` and so
/// on where no guess is possible. `units` are those of the triples of columns from each column.
pub(crate) fn guessed_names(ranges: &[Range], units: &[Unit], is_pts: bool) -> Vec<String> {
    let columns = ranges.len();
    let mut names: Vec<String> = ["x", "y", "z"].map(str::to_owned).to_vec();
    names.extend((4..=columns).map(|n| format!("column_{n}")));
    let width = |groups: &[Group]| groups.iter().map(|group| group.columns().len()).sum::<usize>();
    let fits = |groups: &&&[Group]| {
        let mut at = 3;
        width(groups) + 3 == columns
            && groups.iter().all(|group| {
                let fits = group.fits(at, ranges, units);
                at += group.columns().len();
                fits
            })
    };
    let mut fitting = ARRANGEMENTS.iter().filter(fits);
    let (Some(first), second) = (fitting.next(), fitting.next()) else { return names };
    if second.is_some() && !is_pts {
        return names;
    }
    let mut at = 3;
    for group in *first {
        let is_told =
            *group != Intensity || is_pts || ranges[at].is_whole_within(0.0, INTENSITY_MAX);
        for name in group.columns() {
            if is_told {
                names[at] = (*name).to_owned();
            }
            at += 1;
        }
    }
    names
}

#[cfg(test)]
mod tests {
    use super::*;

    fn guessed(row: &[f64], is_pts: bool) -> String {
        let row = &[&[7.0; 3], row].concat();
        let mut ranges = vec![Range::EMPTY; row.len()];
        ranges.iter_mut().zip(row).for_each(|(range, v)| range.add(*v));
        let mut units = vec![Unit::default(); row.len().saturating_sub(2)];
        units.iter_mut().enumerate().for_each(|(at, unit)| unit.add(&row[at..at + 3]));
        guessed_names(&ranges, &units, is_pts)[3..].join(" ")
    }

    #[test]
    fn only_the_one_possible_arrangement_is_taken() {
        for (row, want) in [
            (&[4.0][..], "intensity"),
            (&[4.5], "column_4"),
            (&[4.0, 5.0], "column_4 column_5"),
            (&[255.0, 0.0, 7.0], "red green blue"),
            (&[256.0, 0.0, 1.0], "column_4 column_5 column_6"),
            (&[0.6, 0.0, 0.8], "nx ny nz"),
            (&[0.0, 0.0, 1.0], "nx ny nz"),
            (&[0.0, 0.0, 0.0], "red green blue"),
            (&[255.0, 0.0, 7.0, 900.0], "red green blue intensity"),
            (&[-900.0, 255.0, 0.0, 7.0], "column_4 red green blue"),
            (&[9.0, 255.0, 0.0, 7.0], "column_4 column_5 column_6 column_7"),
            (&[9.0, 0.6, 0.0, 0.8], "intensity nx ny nz"),
            (&[0.6, 0.0, 0.8, 9.0, 8.0, 7.0], "nx ny nz red green blue"),
            (&[300.0, 9.0, 8.0, 7.0, 0.6, 0.0, 0.8], "intensity red green blue nx ny nz"),
        ] {
            assert_eq!(guessed(row, false), want, "{row:?}");
        }
        assert_eq!(guessed(&[9.0, 255.0, 0.0, 7.0], true), "intensity red green blue");
        assert_eq!(guessed(&[255.0, 0.0, 7.0, 900.0], true), "red green blue intensity");
        assert_eq!(guessed(&[-0.5], true), "intensity");
        assert_eq!(guessed(&[-0.5, 2.0, 3.0], true), "column_4 column_5 column_6");
    }
}
