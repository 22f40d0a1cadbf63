//! The classes that occur in a file, for lists from which people choose.

use crate::cameras::legend::srgb;
use anyhow::Result;
use esker_format::Forest;
use esker_points::AttrType;
use esker_points::attribute::names;
use esker_points::filter::Classes;
use esker_render::inputs::colour::class_colour;

/// A class that occurs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ClassCount {
    /// Number of the class.
    pub class: u8,
    /// Its name in LAS 1.4 R15, or `class` where it has none there.
    pub name: &'static str,
    /// Colour of its points by class, sRGB.
    pub rgb: [u8; 3],
    /// Points of the class.
    pub points: u64,
}

/// The classes that occur in a file, ascending; empty if its points have none.
///
/// # Errors
/// If statistics cannot be read.
pub fn occurring(forest: &Forest) -> Result<Vec<ClassCount>> {
    let mut points = [0u64; 1 << u8::BITS];
    for file in forest.files() {
        let schema = &file.metadata().schema;
        let index = schema.find_typed(names::CLASSIFICATION, AttrType::U8);
        let Some(index) = index.filter(|_| file.footer().points > 0) else { continue };
        let statistics = file.statistics()?;
        let histograms = statistics.histograms();
        let counts = histograms.counts(index);
        for (class, points) in (0u8..).zip(&mut points) {
            // Bytes have a bin each.
            *points += histograms.bin_of(index, class.into()).map_or(0, |bin| counts[bin]);
        }
    }
    let of = |(class, points): (u8, u64)| ClassCount {
        class,
        name: Classes::name(class).unwrap_or("class"),
        rgb: srgb(class_colour(class)),
        points,
    };
    Ok((0..).zip(points).filter(|(_, points)| *points > 0).map(of).collect())
}
