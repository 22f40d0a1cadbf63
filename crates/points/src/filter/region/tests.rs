//! Clips on random lattices: nodes are judged as their points, a clip and its complement share no
//! point and lose none, points away from the faces lie as exact rational numbers say, and no number
//! is so great or so small that it overflows.

use super::super::{Filter, LatticeFilter};
use super::*;
use crate::lattice::ORIGIN;
use crate::schema::Schema;
use proptest::prelude::*;

fn of(clips: Vec<Clip>) -> Filter {
    Filter { clips, ..Filter::default() }
}

fn on(clip: &Clip, lattice: &Lattice) -> Result<LatticeFilter, FilterError> {
    of(vec![clip.clone()]).on(lattice, &Schema::default())
}

fn keeps(filter: &LatticeFilter, p: [u32; 3]) -> bool {
    filter.in_box(p, p).keeps(p, None, None)
}

/// A number of any size and sign.
fn number() -> impl Strategy<Value = f64> {
    (-1.0f64..1.0, -12i32..20).prop_map(|(share, power)| share * 10f64.powi(power))
}

/// Lattices with steps from 1e-9 to 1e3, far from 0 and near it, also of degrees.
fn lattice() -> impl Strategy<Value = Lattice> {
    let scale = || (1.0f64..10.0, -9i32..3).prop_map(|(share, power)| share * 10f64.powi(power));
    let factor = prop_oneof![Just([1.0; 3]), Just([71_000.0, 111_000.0, 1.0])];
    let shift = || prop_oneof![Just(0i64), -(1i64 << 40)..(1 << 40)];
    (
        [scale(), scale(), scale()],
        [-1e7f64..1e7, -1e7..1e7, -1e4..1e4],
        [shift(), shift(), shift()],
        factor,
    )
        .prop_map(|(scale, offset, shift, factor)| Lattice { scale, offset, shift, factor })
}

/// Places on a lattice as shares of it from its middle: near it, anywhere, and at its ends.
fn place() -> impl Strategy<Value = [u32; 3]> {
    let axis = || {
        prop_oneof![
            ORIGIN as u32 - 1000..ORIGIN as u32 + 1000,
            any::<u32>(),
            prop_oneof![Just(0), Just(u32::MAX)],
        ]
    };
    [axis(), axis(), axis()]
}

/// Shapes whose numbers have the size of the lattice: places are lattice points, lengths steps.
fn shape() -> impl Strategy<Value = (u8, [u32; 3], [u32; 3], [f64; 3])> {
    let angle = || {
        let right = (-8i32..8).prop_map(|n| f64::from(n) * 90.0);
        prop_oneof![-720.0f64..720.0, right, -1e-9f64..1e-9]
    };
    (0u8..3, place(), place(), [angle(), angle(), angle()])
}

fn clip_of((kind, a, b, angles): (u8, [u32; 3], [u32; 3], [f64; 3]), lattice: &Lattice) -> Clip {
    let (start, end) = (lattice.world(a), lattice.world(b));
    let lengths = lattice.measure([0, 1, 2].map(|i| (end[i] - start[i]).abs()));
    Clip::from(match kind {
        0 => ClipShape::Box(Bounds {
            min: [0, 1, 2].map(|i| start[i].min(end[i])),
            max: [0, 1, 2].map(|i| start[i].max(end[i])),
        }),
        1 => ClipShape::Oriented { centre: start, size: lengths, rotation: angles },
        _ => ClipShape::Plane {
            point: start,
            normal: axes(angles)[0].map(|c| if c == 0.0 { 0.0 } else { c * 3.0 }),
        },
    })
}

/// Distance of a place outside of a clip's shape by its definition, in double precision, and the
/// size of the numbers that it is computed from, in metres.
fn outside_by(clip: &Clip, lattice: &Lattice, p: [u32; 3]) -> (f64, f64) {
    let from = |centre: [f64; 3]| {
        // In steps, whose difference is more exact than that of places.
        let steps = [0, 1, 2].map(|i| f64::from(p[i]) - lattice.steps_axis(i, centre[i]));
        lattice.measure([0, 1, 2].map(|i| steps[i] * lattice.scale[i]))
    };
    let along = |v: [f64; 3], n: [f64; 3]| (0..3).map(|i| v[i] * n[i]).sum::<f64>();
    match clip.shape {
        ClipShape::Box(Bounds { min, max }) => {
            let (above, below) = (from(min), from(max));
            let off = (0..3).flat_map(|i| [-above[i], below[i]]).fold(f64::MIN, f64::max);
            (off, above.iter().chain(&below).fold(0.0, |m, c| m.max(c.abs())))
        }
        ClipShape::Oriented { centre, size, rotation } => {
            let from = from(centre);
            let off = axes(rotation).into_iter().zip(size);
            let off = off.map(|(axis, size)| along(from, axis).abs() - size / 2.0);
            let most = from.iter().chain(&size).fold(0.0, |m: f64, c| m.max(c.abs()));
            (off.fold(f64::MIN, f64::max), most)
        }
        ClipShape::Plane { point, normal } => {
            let from = from(point);
            (along(from, unit(normal)), from.iter().fold(0.0, |m, c| m.max(c.abs())))
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn nodes_are_judged_as_their_points_and_a_complement_is_the_rest(
        lattice in lattice(), shape in shape(), a in place(), b in place(),
        shares in prop::collection::vec(any::<[u32; 3]>(), 12),
    ) {
        let clip = clip_of(shape, &lattice);
        let inside = on(&clip, &lattice).unwrap();
        let outside = on(&clip.clone().inverted(), &lattice).unwrap();
        let [min, max] = [u32::min, u32::max].map(|of| [0, 1, 2].map(|i| of(a[i], b[i])));
        let side = inside.side_of_box(min, max);
        let opposite = match side {
            Side::Inside => Side::Outside,
            Side::Outside => Side::Inside,
            side => side,
        };
        prop_assert_eq!(outside.side_of_box(min, max), opposite);
        let in_box = [&inside, &outside].map(|filter| filter.in_box(min, max));
        let within = shares.iter().map(|share| [0, 1, 2].map(|i| {
            min[i] + ((u64::from(share[i]) * (u64::from(max[i] - min[i]) + 1)) >> 32) as u32
        }));
        for p in within.chain([min, max]) {
            let is_in = keeps(&inside, p);
            prop_assert!(side != Side::Inside || is_in);
            prop_assert!(side != Side::Outside || !is_in);
            prop_assert_eq!(keeps(&outside, p), !is_in);
            prop_assert_eq!(in_box[0].keeps(p, None, None), is_in);
            prop_assert_eq!(in_box[1].keeps(p, None, None), !is_in);
            let alone = if is_in { Side::Inside } else { Side::Outside };
            prop_assert_eq!(inside.side_of_box(p, p), alone);
            // Faces are rounded to 1/256 step along the steepest axis, and slopes to that.
            let (off, size) = outside_by(&clip, &lattice, p);
            let step = lattice.measure(lattice.scale).into_iter().fold(0.0, f64::max);
            let place = (0..3).map(|i| lattice.world(p)[i].abs() * lattice.factor[i]);
            let size = place.fold(size, f64::max);
            if off.abs() > step / 64.0 + size * 1e-12 {
                prop_assert_eq!(is_in, off < 0.0, "{} by {}, {:?}", clip, off, p);
            }
        }
    }

    #[test]
    fn clips_of_any_size_are_refused_or_have_a_side_without_overflow(
        lattice in lattice(), at in [number(), number(), number()],
        other in [number(), number(), number()], angles in [number(), number(), number()],
        kind in 0u8..3, a in place(), b in place(),
    ) {
        let shape = match kind {
            0 => ClipShape::Box(Bounds {
                min: [0, 1, 2].map(|i| at[i].min(other[i])),
                max: [0, 1, 2].map(|i| at[i].max(other[i])),
            }),
            1 => ClipShape::Oriented { centre: at, size: other.map(f64::abs), rotation: angles },
            _ => ClipShape::Plane { point: at, normal: other },
        };
        let clip = Clip::from(shape);
        match on(&clip, &lattice) {
            Ok(filter) => {
                let [min, max] = [u32::min, u32::max].map(|of| [0, 1, 2].map(|i| of(a[i], b[i])));
                let (side, low, high) =
                    (filter.side_of_box(min, max), keeps(&filter, min), keeps(&filter, max));
                prop_assert!(side != Side::Inside || low && high);
                prop_assert!(side != Side::Outside || !low && !high);
            }
            Err(error) => prop_assert!(error.to_string().contains("so far from the points")),
        }
    }

    #[test]
    fn the_text_of_a_clip_is_read_as_the_same_clip(
        lattice in lattice(), shape in shape(), keeps_outside: bool,
    ) {
        let clip = Clip { keeps_outside, ..clip_of(shape, &lattice) };
        prop_assert_eq!(clip.to_string().parse::<Clip>().unwrap(), clip);
    }

    #[test]
    fn an_upright_box_is_that_of_the_filter_and_right_angles_turn_it_exactly(
        low in [-2000i32..2000, -2000..2000, -2000..2000], steps in [0i32..500, 0..500, 0..500],
        turns in -4i32..5, p in [-2600i32..2600, -2600..2600, -2600..2600],
    ) {
        // As people write them: hundredths, which doubles do not hold.
        let lattice = Lattice { scale: [0.01; 3], ..Lattice::default() };
        let [min, max] = [low, [0, 1, 2].map(|i| low[i] + 2 * steps[i])].map(|c| c.map(|c| f64::from(c) / 100.0));
        let bounds = Bounds { min, max };
        let by_box = Filter { bounds: Some(bounds), ..Filter::default() };
        let by_box = by_box.on(&lattice, &Schema::default()).unwrap();
        let upright = on(&Clip::from(ClipShape::Box(bounds)), &lattice).unwrap();
        let centre = [0, 1, 2].map(|i| f64::from(low[i] + steps[i]) / 100.0);
        let size = steps.map(|s| f64::from(2 * s) / 100.0);
        let size = if turns % 2 == 0 { size } else { [size[1], size[0], size[2]] };
        let rotation = [f64::from(turns) * 90.0, 0.0, 0.0];
        let turned = ClipShape::Oriented { centre, size, rotation };
        let turned = on(&Clip::from(turned), &lattice).unwrap();
        // Any point, and one at a corner.
        let corner = [0, 1, 2].map(|i| low[i] + if p[i] % 2 == 0 { 0 } else { 2 * steps[i] });
        for p in [p, corner] {
            let p = p.map(|c| (ORIGIN + i64::from(c)) as u32);
            let wanted = keeps(&by_box, p);
            prop_assert_eq!(keeps(&upright, p), wanted);
            prop_assert_eq!(keeps(&turned, p), wanted);
        }
    }
}

#[test]
fn points_on_a_plane_are_kept_with_those_behind_it() {
    let at = |x: u32| [ORIGIN as u32 + x; 3];
    let lattice = Lattice { scale: [0.01; 3], ..Lattice::default() };
    let behind = on(&"point=0.3,0.3,0.3;normal=0,0,7".parse().unwrap(), &lattice).unwrap();
    assert!(keeps(&behind, at(30)) && !keeps(&behind, at(31)));
    assert_eq!(behind.side_of_box([0; 3], at(30)), Side::Inside);
    assert_eq!(behind.side_of_box(at(31), [u32::MAX; 3]), Side::Outside);
    let before = on(&"point=0.3,0.3,0.3;normal=0,0,7;keep=outside".parse().unwrap(), &lattice);
    let before = before.unwrap();
    assert!(!keeps(&before, at(30)) && keeps(&before, at(31)));
    // Half a diagonal plane of a cube of steps.
    let diagonal: Clip = "point=0,0,0;normal=1,1,1".parse().unwrap();
    let diagonal = on(&diagonal, &lattice).unwrap();
    let kept = (0..27u32).filter(|i| {
        let c = [i % 3, i / 3 % 3, i / 9].map(|c| (ORIGIN - 1) as u32 + c);
        keeps(&diagonal, c)
    });
    // 27 sums of three of -1, 0 and 1: 7 are 0, 10 are below.
    assert_eq!(kept.count(), 17);
}

#[test]
fn nodes_beside_a_turned_box_are_left_out_although_no_face_separates_them() {
    let lattice = Lattice::default();
    let clip = "centre=0,0,0;size=10,10,10;rotation=45".parse().unwrap();
    let clip = on(&clip, &lattice).unwrap();
    let at = |x: i64, y: i64| [ORIGIN + x, ORIGIN + y, ORIGIN].map(|c| c as u32);
    // The corner of the turned box is at 7.07, and two steps are left for rounding.
    assert_eq!(clip.side_of_box(at(10, -1000), at(2000, 1000)), Side::Outside);
    assert_eq!(clip.side_of_box(at(6, -1000), at(2000, 1000)), Side::Across);
}

#[test]
fn clips_that_are_switched_off_have_no_effect() {
    let clip: Clip = "box=0,0,0,1,1,1".parse().unwrap();
    let off = of(vec![Clip { is_on: false, ..clip.clone() }]);
    assert!(off.is_all() && !of(vec![clip.clone()]).is_all());
    let none = off.on(&Lattice::default(), &Schema::default()).unwrap();
    assert_eq!(none.side_of_box([0; 3], [u32::MAX; 3]), Side::Inside);
    assert_eq!(none, Filter::default().on(&Lattice::default(), &Schema::default()).unwrap());
}

#[test]
fn extents_are_those_of_the_clips_that_keep_the_inside() {
    let lattice = Lattice { factor: [2.0, 4.0, 1.0], ..Lattice::default() };
    let parse = |text: &str| text.parse::<Clip>().unwrap();
    let both = of(vec![
        parse("box=0,0,0,9,9,9"),
        parse("centre=5,5,5;size=8,16,2;rotation=90"),
        parse("box=0,0,0,1,1,1;keep=outside"),
        parse("point=0,0,0;normal=0,0,1"),
        Clip { is_on: false, ..parse("box=20,20,20,21,21,21") },
    ]);
    // Turned, 16 metres lie along x, of which 2 are a degree.
    let wanted = Bounds { min: [1.0, 4.0, 4.0], max: [9.0, 6.0, 6.0] };
    assert_eq!(both.extent(&lattice), wanted);
    assert_eq!(Filter::default().extent(&lattice).max, [f64::INFINITY; 3]);
}

#[test]
fn invalid_clips_are_refused() {
    for (text, word) in [
        ("", "it needs box="),
        ("box=0,0,1,1", "six numbers"),
        ("box=2,0,0,1,1,1", "least corner"),
        ("box=0,0,0,1,1,1;keep=left", "`left`"),
        ("box=0,0,0,1,1,1;box=0,0,0,1,1,1", "twice"),
        ("box=0,0,0,1,1,1;size=1,1,1", "`size` does not belong"),
        ("centre=0,0,0", "it needs box="),
        ("centre=0,0,0;size=1,-1,1", "size below 0"),
        ("centre=0,0,0;size=1,1,1;rotation=1,2", "one number or three"),
        ("centre=0,0;size=1,1,1", "three numbers"),
        ("centre=0,0,nan;size=1,1,1", "not made of numbers"),
        ("point=0,0,0;normal=0,0,0", "no direction"),
        ("point=0,0,0;normal", "no `=`"),
    ] {
        let error = text.parse::<Clip>().unwrap_err().to_string();
        assert!(error.contains(word), "{text}: {error}");
    }
    let far: Clip = "point=1e20,-1e20,0;normal=1,1,0".parse().unwrap();
    let error = on(&far, &Lattice::default()).unwrap_err().to_string();
    assert!(error.contains("so far"), "{error}");
    let beside: Clip = "point=1e20,0,0;normal=1,0,0".parse().unwrap();
    assert!(keeps(&on(&beside, &Lattice::default()).unwrap(), [u32::MAX; 3]));
    let huge: Clip = "centre=0,0,0;size=1e308,1e308,1e308;rotation=30".parse().unwrap();
    let fine = Lattice { scale: [1e-9; 3], ..Lattice::default() };
    assert!(keeps(&on(&huge, &fine).unwrap(), [0; 3]));
}
