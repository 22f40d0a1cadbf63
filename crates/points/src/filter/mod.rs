//! Filters of points: a box, a polygon, clips, classes, flags, values, a spacing. [`Filter`] is the
//! user's input in world units; [`LatticeFilter`] is the same on the lattice of one file, where all
//! tests of places are on integers. Each test is first made for a node (its box, the classes and
//! ranges of values of its points, its parent's spacing), so that unwanted nodes are not read, and
//! for single points only in nodes that cross a border.

mod bounds;
mod classes;
mod clip;
mod condition;
mod flags;
mod polygon;
mod region;
mod values;

pub use bounds::Bounds;
pub use classes::Classes;
pub use clip::{Clip, ClipShape};
pub use condition::{FilterError, Side};
pub use flags::Flags;
pub use polygon::{LatticePolygon, Polygon, Ring};
pub use values::{Bound, NodeValues, ValueRange, ValueTests};

use crate::lattice::Lattice;
use crate::node::Node;
use crate::schema::Schema;
use crate::strata::prefix_at_least;
use region::{LatticeBox, LatticeRegion};

/// Wanted points, in world units. Absent conditions accept all points.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Filter {
    /// Points in this box, its faces included.
    pub bounds: Option<Bounds>,
    /// Points over this polygon, its edges included.
    pub polygon: Option<Polygon>,
    /// Points that all of these clips keep; clips that are switched off keep all.
    pub clips: Vec<Clip>,
    /// Points of these classes.
    pub classes: Option<Classes>,
    /// Points with any of these flags; all if empty.
    pub flags: Flags,
    /// No points with any of these flags.
    pub without_flags: Flags,
    /// Points with values within all of these ranges.
    pub values: Vec<ValueRange>,
    /// An even sample whose points are at most about this far apart, the file's unit.
    pub max_spacing: Option<f64>,
}

impl Filter {
    /// Whether all points are wanted.
    pub fn is_all(&self) -> bool {
        let off = |filter: &Self| Self { clips: Vec::new(), ..filter.clone() };
        !self.clips.iter().any(|clip| clip.is_on) && off(self) == Self::default()
    }

    /// The box in the coordinates of `lattice` outside of which no point is wanted, by the box and
    /// the clips; unbounded where these are. Its least corner is above its greatest one if nothing
    /// is wanted.
    pub fn extent(&self, lattice: &Lattice) -> Bounds {
        let clips = self.clips.iter().filter_map(|clip| clip.extent(lattice));
        let all = Bounds { min: [f64::NEG_INFINITY; 3], max: [f64::INFINITY; 3] };
        self.bounds.into_iter().chain(clips).fold(all, |a, b| Bounds {
            min: [0, 1, 2].map(|i| a.min[i].max(b.min[i])),
            max: [0, 1, 2].map(|i| a.max[i].min(b.max[i])),
        })
    }

    /// The filter on the lattice of a file with the attributes of `schema`.
    ///
    /// # Errors
    /// If the polygon or a clip is too far away for the lattice, a clip is invalid
    /// ([`Clip::check`]), the spacing is not a length, or there is no attribute of the name of a
    /// range.
    pub fn on(&self, lattice: &Lattice, schema: &Schema) -> Result<LatticeFilter, FilterError> {
        self.values.iter().try_for_each(|range| range.check(schema))?;
        if let Some(spacing) = self.max_spacing.filter(|s| !(s.is_finite() && *s > 0.0)) {
            return Err(FilterError(format!(
                "a spacing of {spacing} is no length: it must be above 0, such as 0.05, in the scan's unit"
            )));
        }
        Ok(LatticeFilter {
            region: self.bounds.map(|b| LatticeBox::new(lattice, &b)),
            polygon: self.polygon.as_ref().map(|p| p.on(lattice)).transpose()?,
            clips: region::of_clips(&self.clips, lattice)?,
            classes: self.classes,
            flags: [self.flags, self.without_flags],
            values: self.values.clone(),
            max_spacing: self.max_spacing,
        })
    }
}

/// Wanted points, on a lattice.
#[derive(Clone, Debug, PartialEq)]
pub struct LatticeFilter {
    region: Option<LatticeBox>,
    polygon: Option<LatticePolygon>,
    clips: Vec<LatticeRegion>,
    classes: Option<Classes>,
    /// Wanted and unwanted flags.
    flags: [Flags; 2],
    values: Vec<ValueRange>,
    max_spacing: Option<f64>,
}

/// Conditions that the points of one node must be tested for.
#[derive(Clone, Debug)]
pub struct PointTest {
    region: Option<LatticeBox>,
    polygon: Option<LatticePolygon>,
    clips: Vec<LatticeRegion>,
    classes: Option<Classes>,
    flags: [Flags; 2],
}

impl LatticeFilter {
    /// Side of the points of a box, both corners included.
    pub fn side_of_box(&self, min: [u32; 3], max: [u32; 3]) -> Side {
        let by_region = self.region.map_or(Side::Inside, |region| region.side_of_box(min, max));
        let by_clip = |side: Side, clip: &LatticeRegion| match side {
            Side::Outside => side,
            _ => side.and(clip.side_of_box(min, max)),
        };
        let by_boxes = self.clips.iter().fold(by_region, by_clip);
        if by_boxes == Side::Outside {
            return by_boxes;
        }
        let by_polygon = self.polygon.as_ref().map_or(Side::Inside, |p| p.side_of_box(min, max));
        by_boxes.and(by_polygon)
    }

    /// Side of points of these classes (one bit each, as in the statistics); `None` if points have
    /// no class, which makes none of them wanted by a filter of classes. With `all_have_one` false,
    /// some of them have no class.
    pub fn side_of_classes(&self, bits: Option<[u64; 4]>, all_have_one: bool) -> Side {
        let by_class = match (self.classes, bits) {
            (None, _) => Side::Inside,
            (Some(_), None) => Side::Outside,
            (Some(wanted), Some(bits)) => match wanted.side_of(bits) {
                Side::Inside if !all_have_one => Side::Across,
                side => side,
            },
        };
        match by_class {
            // Points of other classes may have the flag of overlap.
            Side::Outside if self.wants_overlap() => Side::Across,
            side if self.flags == [Flags::default(); 2] => side,
            // The statistics do not have flags.
            side => side.and(Side::Across),
        }
    }

    fn wants_overlap(&self) -> bool {
        self.classes.is_some_and(Classes::has_overlap)
    }

    /// Whether points of a class may be wanted.
    pub fn wants_class(&self, class: u8) -> bool {
        self.classes.is_none_or(|wanted| wanted.has(class) || wanted.has_overlap())
    }

    /// Whether the filter depends on classes.
    pub fn needs_classes(&self) -> bool {
        self.classes.is_some() || self.needs_flags()
    }

    /// Whether the filter depends on flags, and so on classes.
    pub fn needs_flags(&self) -> bool {
        self.wants_overlap() || self.flags != [Flags::default(); 2]
    }

    /// Whether the filter depends on statistics of nodes.
    pub fn needs_statistics(&self) -> bool {
        self.needs_classes() || !self.values.is_empty()
    }

    /// Tests of values, for a file with the attributes of `schema`. They apply beside those of
    /// [`PointTest`].
    pub fn value_tests(&self, schema: &Schema) -> ValueTests {
        ValueTests::new(&self.values, schema)
    }

    /// Number of a node's points that the spacing wants, from the first one on: none if its parent
    /// is dense enough, all if the node itself is not denser than wanted, otherwise the smallest
    /// prefix of whole strata that is dense enough. Selection for a picture works the same way: a
    /// prefix and the ancestors' points are an even sample, whose distance grows with the root of
    /// the share that is left out (`docs/design/choosing-and-streaming.md`).
    pub fn prefix(&self, node: &Node, parent: Option<&Node>) -> usize {
        let count = node.points();
        let Some(wanted) = self.max_spacing else { return count };
        if parent.is_some_and(|p| spacing(p) <= wanted) {
            return 0;
        }
        let share = (spacing(node) / wanted).powi(node.dimension().clamp(1, 2) as i32);
        if share >= 1.0 {
            return count;
        }
        // A rounding error above a whole number must not cost a stratum.
        let points = (count as f64 * share - 1e-6).ceil() as usize;
        prefix_at_least(node.levels(), points.clamp(1, count.max(1)))
    }

    /// Tests for the points in a box that crosses a border.
    pub fn in_box(&self, min: [u32; 3], max: [u32; 3]) -> PointTest {
        PointTest {
            region: self.region,
            polygon: self.polygon.as_ref().map(|p| p.in_box(min, max)),
            clips: self.clips.iter().filter_map(|clip| clip.in_box(min, max)).collect(),
            classes: self.classes,
            flags: self.flags,
        }
    }
}

impl PointTest {
    /// Whether a point is wanted; `class` and `flags` if it has them.
    pub fn keeps(&self, p: [u32; 3], class: Option<u8>, flags: Option<u8>) -> bool {
        let [wanted, unwanted] = self.flags;
        let of_class = |classes: Classes| {
            class.is_some_and(|c| classes.has(c))
                || classes.has_overlap() && Flags::OVERLAP.any(flags, class)
        };
        self.region.is_none_or(|region| region.contains(p))
            && self.clips.iter().all(|clip| clip.keeps(p))
            && self.classes.is_none_or(of_class)
            && (wanted.is_empty() || wanted.any(flags, class))
            && !unwanted.any(flags, class)
            && self.polygon.as_ref().is_none_or(|polygon| polygon.contains([p[0], p[1]]))
    }
}

fn spacing(node: &Node) -> f64 {
    let spacing = f64::from(node.spacing);
    if spacing.is_finite() { spacing.max(0.0) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;
    use proptest::prelude::*;

    fn lattice() -> Lattice {
        Lattice {
            scale: [0.01, 0.001, 0.25],
            offset: [500_000.0, -3.5, 0.1],
            shift: [0, 7, -9],
            ..Lattice::default()
        }
    }

    fn side(filter: &str, min: [u32; 3], max: [u32; 3]) -> Side {
        let bounds = Some(filter.parse().unwrap());
        Filter { bounds, ..Filter::default() }
            .on(&lattice(), &Schema::default())
            .unwrap()
            .side_of_box(min, max)
    }

    #[test]
    fn a_box_beside_everything_holds_nothing() {
        let whole = ([0; 3], [u32::MAX; 3]);
        assert_eq!(side("1e12,0,2e12,1", whole.0, whole.1), Side::Outside);
        assert_eq!(side("-1e15,-1e15,1e15,1e15", whole.0, whole.1), Side::Inside);
    }

    #[test]
    fn spacings_take_nodes_until_they_are_dense_enough() {
        let filter = Filter { max_spacing: Some(1.0), ..Filter::default() };
        let filter = filter.on(&lattice(), &Schema::default()).unwrap();
        let node = |spacing: f32, shape: u8| {
            let mut node = Node::zeroed();
            (node.spacing, node.shape) = (spacing, shape);
            node.set_levels(&[64, 1600]);
            node
        };
        assert_eq!(filter.prefix(&node(2.0, 2), None), 1664);
        // A quarter of them is 416: the first level and four strata of the second.
        assert_eq!(filter.prefix(&node(0.5, 2), Some(&node(2.0, 2))), 64 + 4 * 100);
        assert_eq!(filter.prefix(&node(0.5, 2), Some(&node(1.0, 2))), 0);
        assert!(filter.prefix(&node(0.0, 0), None) > 0);
        for wrong in [0.0, -1.0, f64::NAN] {
            let filter = Filter { max_spacing: Some(wrong), ..Filter::default() };
            assert!(
                filter
                    .on(&lattice(), &Schema::default())
                    .unwrap_err()
                    .to_string()
                    .contains("no length")
            );
        }
    }

    #[test]
    fn a_face_as_people_write_it_is_the_step_that_it_names() {
        let lattice = Lattice { scale: [0.01; 3], ..Lattice::default() };
        for hundredths in 0..2000u32 {
            let p = [0, 0, crate::lattice::ORIGIN as u32 + 99_000 + hundredths];
            let face = format!("{}.{:02}", 990 + hundredths / 100, hundredths % 100);
            let bounds = format!("-1e9,-1e9,{face},1e9,1e9,{face}").parse().unwrap();
            let filter = Filter { bounds: Some(bounds), ..Filter::default() }
                .on(&lattice, &Schema::default())
                .unwrap();
            assert!(filter.in_box(p, p).keeps(p, None, None), "{face}");
            assert!(!filter.in_box(p, p).keeps([p[0], p[1], p[2] + 1], None, None), "{face}");
        }
    }

    #[test]
    fn classes_and_flags_decide_for_nodes_and_points() {
        let on = |classes: Option<&str>, flags: &str, without: &str| {
            let parse = |word: &str| match word {
                "" => Flags::default(),
                word => word.parse().unwrap(),
            };
            let classes = classes.map(|c| c.parse().unwrap());
            let (flags, without_flags) = (parse(flags), parse(without));
            Filter { classes, flags, without_flags, ..Filter::default() }
                .on(&lattice(), &Schema::default())
                .unwrap()
        };
        let keeps = |filter: &LatticeFilter, class, flags| {
            filter.in_box([0; 3], [0; 3]).keeps([0; 3], class, flags)
        };
        // Class 2 alone: 4 in the statistics.
        let ground = Some([4, 0, 0, 0]);
        let overlap = on(Some("overlap"), "", "");
        assert_eq!(overlap.side_of_classes(ground, true), Side::Across);
        assert_eq!(overlap.side_of_classes(Some([1 << 12, 0, 0, 0]), true), Side::Inside);
        assert!(keeps(&overlap, Some(12), None) && keeps(&overlap, Some(2), Some(0b1000)));
        assert!(!keeps(&overlap, Some(2), Some(0b0111)));
        let flagged = on(None, "withheld,synthetic", "");
        assert_eq!(flagged.side_of_classes(None, false), Side::Across);
        assert!(keeps(&flagged, None, Some(0b0101)) && !keeps(&flagged, None, Some(0b1010)));
        assert!(!keeps(&flagged, Some(2), None));
        let clean = on(Some("ground"), "", "withheld");
        assert_eq!(clean.side_of_classes(ground, true), Side::Across);
        assert_eq!(clean.side_of_classes(Some([2, 0, 0, 0]), true), Side::Outside);
        assert!(keeps(&clean, Some(2), None) && keeps(&clean, Some(2), Some(0b1000)));
        assert!(!keeps(&clean, Some(2), Some(0b0100)) && !keeps(&clean, Some(3), None));
        assert!(clean.needs_flags() && !on(Some("ground"), "", "").needs_flags());
    }

    proptest! {
        #[test]
        fn a_point_is_kept_exactly_where_its_steps_lie_in_the_box_and_the_rectangle(
            p: [u32; 3], a: [u32; 3], b: [u32; 3], equal in 0usize..4,
        ) {
            let mut a = a;
            if equal < 3 { a[equal] = p[equal]; }
            let (low, high) = ([0, 1, 2].map(|i| a[i].min(b[i])), [0, 1, 2].map(|i| a[i].max(b[i])));
            let (min, max) = (lattice().world(low), lattice().world(high));
            let filter = Filter { bounds: Some(Bounds { min, max }), ..Filter::default() };
            let filter = filter.on(&lattice(), &Schema::default()).unwrap();
            let within = |axes: usize| (0..axes).all(|i| low[i] <= p[i] && p[i] <= high[i]);
            prop_assert_eq!(filter.in_box(p, p).keeps(p, None, None), within(3));
            prop_assert_eq!(filter.side_of_box(p, p), if within(3) { Side::Inside } else { Side::Outside });
            let ring = vec![[min[0], min[1]], [max[0], min[1]], [max[0], max[1]], [min[0], max[1]]];
            let over = Filter { polygon: Some(Polygon::new(vec![ring]).unwrap()), ..Filter::default() };
            let over = over.on(&lattice(), &Schema::default()).unwrap();
            // A rectangle without area has no edge that a corner could lie on.
            if low[0] < high[0] || low[1] < high[1] {
                prop_assert_eq!(over.in_box(p, p).keeps(p, None, None), within(2));
            }
        }
    }
}
