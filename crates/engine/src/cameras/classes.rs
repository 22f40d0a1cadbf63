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
    /// Points of the class; a multiple of those in a sample if it is an estimate.
    pub points: u64,
    /// Whether only a sample was counted: of a file that is drawn without being built.
    pub is_estimate: bool,
}

/// The classes that occur in a file, ascending; empty if its points have none. Of a file that is
/// drawn without being built, those of its first points.
///
/// # Errors
/// If statistics cannot be read.
pub fn occurring(forest: &Forest) -> Result<Vec<ClassCount>> {
    let mut points = [0u64; 1 << u8::BITS];
    for file in forest.files() {
        let schema = &file.metadata().schema;
        let index = schema.find_typed(names::CLASSIFICATION, AttrType::U8);
        let Some(index) = index.filter(|_| file.footer().points > 0) else { continue };
        let histograms = file.histograms()?;
        let counts = histograms.counts(index);
        let counted = counts.iter().sum::<u64>().max(1);
        let all = if file.is_growing() { file.footer().points } else { counted };
        for (class, points) in (0u8..).zip(&mut points) {
            // Bytes have a bin each.
            let of_class = histograms.bin_of(index, class.into()).map_or(0, |bin| counts[bin]);
            *points += (u128::from(of_class) * u128::from(all) / u128::from(counted)) as u64;
        }
    }
    let of = |(class, points): (u8, u64)| ClassCount {
        class,
        name: Classes::name(class).unwrap_or("class"),
        rgb: srgb(class_colour(class)),
        points,
        is_estimate: forest.is_growing(),
    };
    Ok((0..).zip(points).filter(|(_, points)| *points > 0).map(of).collect())
}
