//! Picking: the point of a file that a pixel shows, with its exact coordinates and all attributes.
//! Takes the view, a place on its picture and the depth there; searches the points of all levels
//! ([`search`]), and reads the one that is found as an export writes it.

pub mod report;
pub mod search;

use anyhow::Result;
use esker_builder::exact_point;
use esker_format::{Forest, ForestFilter};
use esker_lod::View;
use esker_points::AttrType;
use esker_points::attribute::names;
use esker_points::filter::{Classes, Flags};
use esker_points::lattice::ORIGIN;
use esker_points::task::Silent;
use glam::{DVec2, DVec3};
use search::{Aim, Found};
use serde::Serialize;

pub use search::REACH_PX;

/// A point of a file.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Picked {
    /// Its coordinates, as an export to text writes them: in degrees where the scan's are. Those of
    /// a cloud with an offset are moved by it.
    pub coordinates: [String; 3],
    /// Its coordinates in steps of the grid of its file, without the offset of its cloud: times
    /// [`Picked::scale`], plus [`Picked::offset`]. Those of LAS files whose grid the file has.
    pub steps: [i64; 3],
    /// Step of each axis.
    pub scale: [f64; 3],
    /// Coordinate of step 0 of each axis.
    pub offset: [f64; 3],
    /// Position in the lengths of the view: [`Picked::coordinates`], in metres where these are
    /// degrees.
    pub position: [f64; 3],
    /// All attributes of the file, in the order of an export.
    pub attributes: Vec<PickedValue>,
    /// The `.esker` file that has the point.
    pub file: String,
    /// Scans that it may be of: of its file, those with its attributes whose stated bounds hold it.
    /// A single one is certain as far as the bounds are.
    pub scans: Vec<String>,
    /// Its node in the table of the file and those that it names.
    pub node: u32,
    /// Its index in the node.
    pub point: usize,
    /// Distance on the picture from the place that was picked, pixels.
    pub offset_px: f64,
    /// Eye depth, the unit of [`Picked::position`].
    pub depth: f64,
}

/// An attribute of a point.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PickedValue {
    /// Name of the column in an export to text.
    pub name: String,
    /// Type of the exported attribute, such as `u16`.
    #[serde(rename = "type")]
    pub ty: &'static str,
    /// The value as an export to text writes it: with its scale, all digits, `nan` for a stated
    /// no-data value.
    pub value: String,
    /// What it stands for, such as the name of a class.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub meaning: Option<String>,
    /// Whether the scan of the point has the attribute; if not, exports write 0.
    pub is_present: bool,
}

impl Picked {
    /// Position on the metric lattice, on which views are given.
    pub fn at(&self) -> DVec3 {
        self.position.into()
    }

    /// Names and values for people, a pair a row: coordinates, steps, attributes with what they
    /// stand for, scan, distance on the picture.
    pub fn rows(&self) -> Vec<(String, String)> {
        let place = ["x", "y", "z"].into_iter().zip(&self.coordinates);
        let place = place.map(|(name, value)| (name.to_owned(), value.clone()));
        let steps = self.steps.map(|step| step.to_string()).join(" ");
        let values = self.attributes.iter().map(|a| {
            let value = match (&a.meaning, a.is_present) {
                (_, false) => format!("{} (its scan has none)", a.value),
                (Some(meaning), _) => format!("{} ({meaning})", a.value),
                (None, _) => a.value.clone(),
            };
            (a.name.clone(), value)
        });
        let scan = match self.scans.as_slice() {
            [] => None,
            [one] => Some(one.clone()),
            [first, rest @ ..] => Some(format!("{first}, or one of {} more", rest.len())),
        };
        let scan = scan.map(|scan| ("of scan".to_owned(), scan));
        let distance = ("distance".to_owned(), format!("{:.1} pixels", self.offset_px));
        place
            .chain([("steps".to_owned(), steps)])
            .chain(values)
            .chain(scan)
            .chain([distance])
            .collect()
    }
}

/// Finds the point that the picture of `view` shows at the place `at`: the nearest on the picture
/// of the points that are about as deep as `depth`, of all levels, among those that `shown` accepts
/// ([`crate::draw::frame::Appearance::shown`]).
///
/// `at` is in pixels from the top left corner of the shown picture, without its margin; pixel
/// centres are at one half. `depth` is the eye depth that the picture has there; in an empty pixel
/// that of a pixel nearby, as [`shown_depth`] gives it.
///
/// Reads from the disk, so the render thread should not call it.
///
/// `None` if `at` is not on the picture, or no point is within [`REACH_PX`] widths of a pixel of
/// the shown place in space, or within twice the distance of neighbouring points where that is
/// more.
///
/// # Errors
/// If a node, or the statistics, cannot be read or are damaged.
pub fn pick(
    forest: &Forest,
    view: &View,
    at: DVec2,
    depth: f64,
    shown: &ForestFilter,
) -> Result<Option<Picked>> {
    let Some(aim) = Aim::new(view, at, depth) else { return Ok(None) };
    let (grown, found) = found(forest, &aim, shown)?;
    let (forest, Some(found)) = (grown.as_ref().unwrap_or(forest), found) else { return Ok(None) };
    let exact = exact_point(forest, found.node, found.point, &Silent)?;
    let file = forest.file_of(found.node);
    let lattice = file.exact_lattice();
    let stated = |axis: usize| i64::from(exact.lattice[axis]) - ORIGIN + lattice.shift[axis];
    let sources = &file.metadata().sources;
    let attributes = exact.values.into_iter().map(|value| PickedValue {
        meaning: meaning(&value.key.0, value.key.1, &value.stored).filter(|_| value.is_present),
        name: value.name,
        ty: value.key.1.name(),
        value: value.text,
        is_present: value.is_present,
    });
    Ok(Some(Picked {
        coordinates: exact.coordinates,
        steps: [0, 1, 2].map(stated),
        scale: lattice.scale,
        offset: lattice.offset,
        position: found.position.to_array(),
        attributes: attributes.collect(),
        file: file.path().display().to_string(),
        scans: exact.sources.iter().map(|&i| sources[i].path.clone()).collect(),
        node: forest.table().index_in_file(found.node),
        point: found.point,
        offset_px: found.seen.offset_px,
        depth: depth + found.seen.depth_offset,
    }))
}

/// Searches, and reads what the search lacks of a partial node table; the forest that has the node
/// that was found, if it is a newer one.
fn found(
    forest: &Forest,
    aim: &Aim,
    shown: &ForestFilter,
) -> Result<(Option<Forest>, Option<Found>)> {
    let mut grown = forest.newer();
    loop {
        let newest = grown.as_ref().unwrap_or(forest);
        let newer = shown.grown(newest)?;
        let mut lacking = Vec::new();
        let found = search::find(newest, aim, newer.as_ref().unwrap_or(shown), &mut lacking)?;
        if lacking.is_empty() {
            return Ok((grown, found));
        }
        newest.complete(&lacking)?;
        grown = Some(newest.newer().unwrap_or_else(|| newest.clone()));
    }
}

/// Eye depth that a picture shows in the pixel of column `x` and row `y`. In an empty pixel the
/// least depth in the smallest square around it that has any, at most [`REACH_PX`] pixels away;
/// `None` if there is none. `depth` has `width` pixels a row, infinite where nothing is drawn.
pub fn shown_depth(depth: &[f32], width: u32, [x, y]: [u32; 2]) -> Option<f64> {
    let (width, x, y) = (i64::from(width), i64::from(x), i64::from(y));
    let at = |x: i64, y: i64| {
        let index = usize::try_from(y * width + x).ok().filter(|_| (0..width).contains(&x))?;
        let depth = f64::from(*depth.get(index)?);
        (depth > 0.0 && depth.is_finite()).then_some(depth)
    };
    (0..=REACH_PX as i64).find_map(|r| {
        let ring = (-r..=r).flat_map(|i| [(i, -r), (i, r), (-r, i), (r, i)]);
        ring.filter_map(|(dx, dy)| at(x + dx, y + dy)).reduce(f64::min)
    })
}

/// What a value of an attribute of LAS stands for.
fn meaning(name: &str, ty: AttrType, stored: &[u8]) -> Option<String> {
    let &[byte] = stored else { return None };
    match (name, ty) {
        (names::CLASSIFICATION, AttrType::U8) => Classes::name(byte).map(str::to_owned),
        (names::RETURNS, AttrType::U8) if byte >> 4 > 0 => {
            Some(format!("return {} of {}", byte & 15, byte >> 4))
        }
        (names::FLAGS, AttrType::U8) => {
            let flags: Vec<&str> = Flags::names_of(byte).collect();
            (!flags.is_empty()).then(|| flags.join(", "))
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_empty_pixel_has_the_least_depth_of_the_nearest_square_with_any() {
        let mut depth = vec![f32::INFINITY; 40 * 30];
        (depth[5 * 40 + 10], depth[5 * 40 + 12]) = (7.0, 5.0);
        assert_eq!(shown_depth(&depth, 40, [10, 5]), Some(7.0));
        assert_eq!(shown_depth(&depth, 40, [11, 5]), Some(5.0));
        assert_eq!(shown_depth(&depth, 40, [10, 17]), Some(5.0));
        assert_eq!(shown_depth(&depth, 40, [10, 18]), None);
        // The end of a row is not beside the beginning of the next one.
        depth[6 * 40] = 1.0;
        assert_eq!(shown_depth(&depth, 40, [39, 5]), None);
        assert_eq!(shown_depth(&[], 0, [0, 0]), None);
    }

    #[test]
    fn bits_of_las_are_named() {
        let of = |name: &str, byte: u8| meaning(name, AttrType::U8, &[byte]);
        assert_eq!(of(names::CLASSIFICATION, 6).as_deref(), Some("building"));
        assert_eq!(of(names::CLASSIFICATION, 200), None);
        assert_eq!(of(names::RETURNS, 0x32).as_deref(), Some("return 2 of 3"));
        assert_eq!(of(names::FLAGS, 0b1100).as_deref(), Some("withheld, overlap"));
        assert_eq!(of(names::FLAGS, 0b1100_0000), None);
        assert_eq!(meaning(names::INTENSITY, AttrType::U16, &[1, 0]), None);
    }
}
