//! A pick is a point of the input with its own attributes: the nearest by brute force, never one
//! behind the shown surface, never one that the filter hides.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

#[path = "../../builder/tests/given/mod.rs"]
mod given;

use esker_engine::calls::pick::report::pick_in;
use esker_engine::calls::pick::search::{Aim, find};
use esker_engine::calls::pick::{Picked, REACH_PX, pick};
use esker_engine::calls::render::draw;
use esker_engine::cameras::camera::Camera;
use esker_engine::draw::frame::Appearance;
use esker_engine::draw::scene::{PictureRequest, PictureScene};
use esker_engine::machine::backend::{Backend, DrawWith};
use esker_engine::{BuildOptions, Filter, Forest, Method, Picture, View};
use esker_format::ForestFilter;
use esker_points::AttrType;
use esker_points::task::Silent;
use given::{Given, given};
use glam::{DVec2, DVec3};
use std::collections::HashMap;
use std::path::Path;

const SIZE: [u32; 2] = [320, 240];
/// Step of the scans, metres.
const STEP: f64 = 0.001;
const HILLS: [&str; 4] = [
    "eye=0,-14,6;target=0,0,0",
    "eye=0,-3.5,0.6;target=2,-2,1",
    "eye=5,-5,0.2;direction=-1,1,-0.05;fovy=40",
    "direction=0,0,-1;up=0,1,0;ortho=fit",
];

/// A part of a whole that depends on `i`.
fn share(i: u64, k: f64) -> f64 {
    (i as f64 * k).fract()
}

/// A hilly ground, and a ball and a wall on it.
fn hills(i: u64) -> [f64; 3] {
    let (u, v) = (share(i, 0.754_877_666), share(i, 0.569_840_291));
    match i % 8 {
        0 => {
            let (z, turn) = (2.0 * u - 1.0, v * std::f64::consts::TAU);
            let side = (1.0 - z * z).sqrt();
            [2.1 + side * turn.cos(), -2.2 + side * turn.sin(), 1.4 + z]
        }
        1 => [-2.5 + 2.0 * u, -1.7, 2.2 * v - 0.5],
        _ => {
            let (x, y) = (16.0 * u - 8.0, 12.0 * v - 6.0);
            [x, y, 0.5 * (x * 0.7).sin() + 0.3 * (y * 0.9).cos() - 1.0]
        }
    }
}

/// A scan whose point `i` is at `place(i)`, with its number as an attribute, and a class of 2 or 6.
fn scan(points: u64, place: impl Fn(u64) -> [f64; 3], class: impl Fn(u64) -> u64) -> Given {
    let steps = |i| place(i).map(|c| (c / STEP).round() as i32);
    given("scan", [STEP; 3], (0..points).map(steps).collect())
        .with("number", AttrType::U32, |i| i)
        .with("gps_time", AttrType::F64, |i| (i as f64 / 8.0).to_bits())
        .with("classification", AttrType::U8, class)
}

fn built(scans: &[Given], folder: &Path) -> Forest {
    let out = folder.join("scan.esker");
    let options = BuildOptions { node_capacity: 512, ..BuildOptions::default() };
    let scans = scans.iter().map(Given::boxed).collect();
    esker_builder::build_sources(scans, &out, &options, &Silent).unwrap();
    Forest::open(&out).unwrap()
}

fn request(camera: &str, method: Method, filter: &Filter) -> PictureRequest {
    PictureRequest {
        size: SIZE,
        method,
        camera: Camera::parse(camera).unwrap(),
        filter: filter.clone(),
        with: DrawWith { backend: Backend::Cpu, ..DrawWith::default() },
        ..PictureRequest::default()
    }
}

/// A picture, its view without the margin, and the filter in force.
fn drawn(file: &Forest, request: &PictureRequest) -> (Picture, View, Appearance) {
    let picture = draw(file, request, &Silent).unwrap().0;
    let scene = PictureScene::choose(file, request).unwrap();
    (picture, scene.view.with_margin(0), scene.appearance)
}

/// Depth of the pixel in which a place is, if it is covered.
fn depth_at(picture: &Picture, at: DVec2) -> Option<f64> {
    let depth = picture.depth[at.y as usize * picture.width as usize + at.x as usize];
    depth.is_finite().then(|| f64::from(depth))
}

/// Places spread over a picture.
fn clicks(count: u64) -> impl Iterator<Item = DVec2> {
    let size = SIZE.map(f64::from);
    (1..=count).map(move |i| DVec2::new(share(i, 0.618) * size[0], share(i, 0.414_213) * size[1]))
}

/// Number of a picked point, which its attributes state.
fn number(picked: &Picked) -> u64 {
    let value = picked.attributes.iter().find(|a| a.name == "number").unwrap();
    value.value.parse().unwrap()
}

/// Asserts that a pick has the coordinates and attributes of the point of the input that it names.
fn is_of(picked: &Picked, scan: &Given) {
    let i = number(picked);
    let raw = scan.positions[i as usize];
    assert_eq!(picked.steps, raw.map(i64::from));
    assert_eq!(
        picked.coordinates,
        raw.map(|c| {
            let sign = if c < 0 { "-" } else { "" };
            format!("{sign}{}.{:03}", c.unsigned_abs() / 1000, c.unsigned_abs() % 1000)
        })
    );
    let value = |name: &str| &picked.attributes.iter().find(|a| a.name == name).unwrap().value;
    assert_eq!(value("gps_time").parse::<f64>().unwrap(), i as f64 / 8.0);
    let class = scan.info.schema.find("classification").unwrap();
    assert_eq!(*value("classification"), scan.columns[class][i as usize].to_string());
    assert_eq!(picked.scans, ["scan"]);
}

/// Offset on the picture and depth of a point from a place with this depth; `None` off the picture.
fn seen(view: &View, at: DVec2, depth: f64, p: DVec3) -> Option<(f64, f64)> {
    let on = view.project(p).filter(|on| view.is_on_picture(*on))?;
    Some((on.truncate().distance(at), on.z - depth))
}

#[test]
fn every_pick_is_a_point_of_the_input_and_the_nearest_by_brute_force() {
    let folder = tempfile::tempdir().unwrap();
    let input = scan(40_000, hills, |i| if i % 8 < 2 { 6 } else { 2 });
    let file = built(std::slice::from_ref(&input), folder.path());
    assert!(file.table().nodes.len() > 50, "the search chooses among nodes");
    let places: Vec<DVec3> =
        input.positions.iter().map(|p| DVec3::from_array(p.map(|c| f64::from(c) * STEP))).collect();
    for camera in HILLS {
        let (picture, view, appearance) =
            drawn(&file, &request(camera, Method::Auto, &Filter::default()));
        let view = View { near: if view.parallel_at.is_some() { view.near } else { 1e-9 }, ..view };
        let (mut covered, mut picks, mut finer) = (0, 0, 0);
        for at in clicks(400) {
            let Some(depth) = depth_at(&picture, at) else { continue };
            let picked = pick(&file, &view, at, depth, &appearance.shown).unwrap();
            let aim = Aim::new(&view, at, depth).unwrap();
            let reach = aim.reach(&file);
            // The nearest in space of the points before the eye.
            let before = places.iter().filter(|p| view.project(**p).is_some());
            let away = |p: &DVec3| p.distance(aim.place());
            let nearest = before.min_by(|a, b| away(a).total_cmp(&away(b))).unwrap();
            // The nearest on the picture of those about as deep.
            let is_on = seen(&view, at, depth, *nearest).is_some();
            let nearest = away(nearest);
            let radius = if is_on { 2.0 * nearest } else { reach };
            let near = places.iter().filter(|p| nearest <= reach && away(p) <= radius);
            let deep = near.filter_map(|p| seen(&view, at, depth, *p));
            let best = deep.filter(|(_, off)| off.abs() <= nearest).map(|(px, _)| px);
            let best = best.fold(f64::INFINITY, f64::min);
            let Some(picked) = picked else {
                assert!(best.is_infinite(), "{camera} {at}");
                covered += 1;
                continue;
            };
            (covered, picks) = (covered + 1, picks + 1);
            is_of(&picked, &input);
            assert!((picked.offset_px - best).abs() < 1e-6, "{camera} {at}: {picked:?}, {best}");
            let own = places[number(&picked) as usize];
            assert!(picked.at().distance(own) < 1e-9);
            finer += u32::from(own.distance(aim.place()) > nearest * (1.0 + 1e-9));
        }
        assert!(picks > 60 && picks * 20 > covered * 19, "{camera}: {picks} of {covered}");
        println!("{camera}: {picks} picks, {finer} of them not the nearest in space");
    }
}

/// Two walls one behind the other, seen from both sides, from afar and from nearby.
#[test]
fn no_pick_is_behind_the_shown_wall() {
    // The second walls are about twice as far apart as their points.
    picks_of_walls(60_000, 0.2);
    picks_of_walls(2_400, 0.3);
}

/// Picks points of two walls that are `apart`, each with half of the points.
fn picks_of_walls(points: u64, apart: f64) {
    let wall = |i: u64| {
        let y = if i.is_multiple_of(2) { 0.0 } else { apart };
        [6.0 * share(i, 0.754_877_666), y, 4.0 * share(i, 0.569_840_291)]
    };
    let folder = tempfile::tempdir().unwrap();
    let input = scan(points, wall, |_| 2);
    let file = built(std::slice::from_ref(&input), folder.path());
    let (mut picks, mut none, mut unsure) = (0, 0, 0);
    for (distance, slant) in [(1.5, 0.0), (6.0, 0.0), (6.0, 4.0), (40.0, 0.0), (300.0, 100.0)] {
        for (eye, front) in [(-distance, 0.0), (apart + distance, apart)] {
            let camera = format!("eye={},{eye},2;target=3,{front},2", 3.0 + slant);
            let request = request(&camera, Method::Auto, &Filter::default());
            let (picture, view, appearance) = drawn(&file, &request);
            for at in clicks(100) {
                let Some(depth) = depth_at(&picture, at) else { continue };
                // A pixel of the border shows what it likes.
                let place = Aim::new(&view, at, depth).unwrap().place();
                let is_inside = (0.3..5.7).contains(&place.x) && (0.3..3.7).contains(&place.z);
                if !is_inside || (place.y - front).abs() > apart * 0.25 {
                    unsure += u32::from(is_inside);
                    continue;
                }
                let picked = pick(&file, &view, at, depth, &appearance.shown).unwrap();
                let Some(picked) = picked else {
                    none += 1;
                    continue;
                };
                assert_eq!(picked.position[1], front, "{camera} {at}: {picked:?}");
                picks += 1;
            }
        }
    }
    println!("{points} points: {picks} picks, {none} none, {unsure} places are not on the wall");
    assert!(picks > 100 && none * 20 < picks && unsure < picks, "{picks}, {none}, {unsure}");
}

#[test]
fn what_the_filter_hides_is_never_picked() {
    let folder = tempfile::tempdir().unwrap();
    let input = scan(40_000, hills, |i| if i.is_multiple_of(3) { 6 } else { 2 });
    let file = built(std::slice::from_ref(&input), folder.path());
    let classes = Filter { classes: Some("6".parse().unwrap()), ..Filter::default() };
    let bounds = Some("-3,-3,-9,3,3,9".parse().unwrap());
    let boxed = Filter { bounds, ..Filter::default() };
    let sample = Filter { max_spacing: Some(0.3), ..Filter::default() };
    let clips = vec!["centre=0,0,0;size=9,8,99;rotation=45".parse().unwrap()];
    let clipped = Filter { clips, ..Filter::default() };
    for filter in [classes, boxed, sample, clipped] {
        // The depth may still be that of all points.
        for shown in [Filter::default(), filter.clone()] {
            let (picture, view, _) = drawn(&file, &request(HILLS[0], Method::Auto, &shown));
            let on_lattice = filter.on(file.lattice(), file.schema()).unwrap();
            let accepted = ForestFilter::of(&file, Some(on_lattice), None).unwrap();
            let mut picks = 0;
            for at in clicks(400) {
                let Some(depth) = depth_at(&picture, at) else { continue };
                let Some(picked) = pick(&file, &view, at, depth, &accepted).unwrap() else {
                    continue;
                };
                is_of(&picked, &input);
                let i = number(&picked);
                assert!(filter.classes.is_none() || i.is_multiple_of(3), "{picked:?}");
                let p = picked.position;
                assert!(filter.bounds.is_none() || p[0].abs() <= 3.0 && p[1].abs() <= 3.0);
                let [along, across] = [p[0] + p[1], p[1] - p[0]].map(|c| c.abs() / 2f64.sqrt());
                assert!(filter.clips.is_empty() || along < 4.501 && across < 4.001, "{picked:?}");
                let points = accepted.points_max(picked.node);
                assert!(picked.point < points, "{picked:?}");
                picks += 1;
            }
            assert!(picks > 20, "{picks}");
        }
    }
}

#[test]
fn the_sky_has_no_point_and_no_place_is_off_the_picture() {
    let folder = tempfile::tempdir().unwrap();
    let file = built(&[scan(5_000, hills, |_| 2)], folder.path());
    let up = request("eye=0,0,5;direction=0,0.2,1", Method::Auto, &Filter::default());
    for pixel in [[0, 0], [160, 120], [319, 239]] {
        let report = pick_in(&file, &up, pixel, &Silent).unwrap();
        assert_eq!((report.depth, report.point), (None, None));
    }
    assert!(pick_in(&file, &up, [320, 0], &Silent).is_err());
    let (_, view, appearance) = drawn(&file, &request(HILLS[0], Method::Auto, &Filter::default()));
    let all = &appearance.shown;
    let middle = DVec2::new(160.0, 120.0);
    for (at, depth) in [
        (middle, f64::NAN),
        (middle, f64::INFINITY),
        (middle, 0.0),
        (middle, -14.0),
        (middle, 1.0),
        (middle, 1e300),
        (DVec2::new(-0.5, 120.0), 14.0),
        (DVec2::new(320.0, 120.0), 14.0),
        (DVec2::new(f64::NAN, 120.0), 14.0),
    ] {
        assert_eq!(pick(&file, &view, at, depth, all).unwrap(), None, "{at} {depth}");
    }
    let empty = built(&[scan(0, hills, |_| 2)], folder.path());
    let none = ForestFilter::default();
    assert_eq!(pick(&empty, &view, middle, 14.0, &none).unwrap(), None);
}

#[test]
fn a_single_point_is_picked_within_reach_also_at_the_border() {
    let folder = tempfile::tempdir().unwrap();
    let input = scan(1, |_| [0.25, 0.5, 0.125], |_| 2);
    let file = built(std::slice::from_ref(&input), folder.path());
    let none = ForestFilter::default();
    // In the middle of the picture, and in its last column and row.
    for (target, at) in [([0.25, 0.5], [160, 120]), ([0.25 - 0.765, 0.5 + 0.573], [319, 239])] {
        let [x, y] = target;
        let camera = format!("eye={x},{y},1.125;target={x},{y},0;up=0,1,0");
        let request = request(&camera, Method::Points, &Filter::default());
        let (picture, view, _) = drawn(&file, &request);
        let covered: Vec<usize> =
            (0..picture.depth.len()).filter(|&i| picture.depth[i].is_finite()).collect();
        let on = covered.iter().map(|i| [(i % 320) as u32, (i / 320) as u32]);
        assert_eq!(on.collect::<Vec<_>>(), [at]);
        let report = pick_in(&file, &request, at, &Silent).unwrap();
        let picked = report.point.unwrap();
        is_of(&picked, &input);
        assert!(picked.offset_px <= std::f64::consts::FRAC_1_SQRT_2, "{picked:?}");
        // From each pixel within reach of it, and from no other.
        let reach = REACH_PX as u32;
        for (away, is_found) in [(1, true), (reach - 1, true), (reach + 2, false)] {
            let beside = [at[0] - away, at[1]];
            let report = pick_in(&file, &request, beside, &Silent).unwrap();
            assert_eq!(report.point.is_some(), is_found, "{away} pixels away");
            let beside = DVec2::new(f64::from(beside[0]), f64::from(beside[1])) + 0.5;
            let found = pick(&file, &view, beside, 1.0, &none).unwrap();
            assert_eq!(found.is_some(), is_found, "{away} pixels away");
        }
    }
}

#[test]
fn points_at_one_place_are_searched_in_bounded_work() {
    let folder = tempfile::tempdir().unwrap();
    let input = scan(100_000, |i| if i < 90_000 { [1.0; 3] } else { hills(i) }, |_| 2);
    let file = built(std::slice::from_ref(&input), folder.path());
    let view = View::look_at(DVec3::new(1.0, -4.0, 1.0), DVec3::ONE, DVec3::Z, 1.0, 320, 240);
    let none = ForestFilter::default();
    let picked = pick(&file, &view, DVec2::new(160.0, 120.0), 5.0, &none).unwrap().unwrap();
    is_of(&picked, &input);
    assert_eq!(picked.steps, [1000; 3]);
    let before = file.read_bytes();
    pick(&file, &view, DVec2::new(20.0, 220.0), 4.5, &none).unwrap();
    let page = file.table().nodes.iter().map(|node| u64::from(node.page_bytes)).max().unwrap();
    let read = file.read_bytes() - before;
    assert!(read < 60 * page, "{} pages", read / page);
}

#[test]
fn scans_with_other_attributes_are_told_apart() {
    let folder = tempfile::tempdir().unwrap();
    let beside =
        |i: u64| [20.0 + 4.0 * share(i, 0.754_877_666), 4.0 * share(i, 0.569_840_291), 0.0];
    let first = scan(5_000, hills, |_| 2);
    let second = scan(5_000, beside, |_| 6).with("extra", AttrType::I16, |i| i % 500);
    let (mut second, mut third) = (second, scan(5_000, |i| beside(i).map(|c| c + 30.0), |_| 2));
    second.info.path = "second".into();
    third.info.path = "third".into();
    let file = built(&[first, second, third], folder.path());
    let none = ForestFilter::default();
    for (target, name) in [([0.0, 0.0], "scan"), ([22.0, 2.0], "second"), ([52.0, 32.0], "third")] {
        let [x, y] = target;
        let camera = format!("eye={x},{y},60;target={x},{y},0;up=0,1,0");
        let (picture, view, _) = drawn(&file, &request(&camera, Method::Auto, &Filter::default()));
        let at = DVec2::new(160.5, 120.5);
        let depth = depth_at(&picture, at).unwrap();
        let picked = pick(&file, &view, at, depth, &none).unwrap().unwrap();
        assert_eq!(picked.scans, [name], "{picked:?}");
        let extra = picked.attributes.iter().find(|a| a.name == "extra").unwrap();
        assert_eq!(extra.is_present, name == "second");
        let expected = if extra.is_present { number(&picked) % 500 } else { 0 };
        assert_eq!(extra.value, expected.to_string());
    }
}

/// Every byte of the pages is wrong once: a pick fails or gives a point of the input.
#[test]
fn damaged_pages_are_errors() {
    let folder = tempfile::tempdir().unwrap();
    let input = scan(3_000, hills, |i| i % 7);
    let file = built(std::slice::from_ref(&input), folder.path());
    let request = request(HILLS[0], Method::Auto, &Filter::default());
    let (picture, view, _) = drawn(&file, &request);
    let at = DVec2::new(160.5, 150.5);
    let depth = depth_at(&picture, at).unwrap();
    let path = folder.path().join("scan.esker");
    let mut bytes = Vec::new();
    std::io::Read::read_to_end(&mut std::fs::File::open(&path).unwrap(), &mut bytes).unwrap();
    let end = file.table().nodes.iter().map(|n| n.page_offset + u64::from(n.page_bytes)).max();
    let damaged = folder.path().join("damaged.esker");
    let mut outcomes = HashMap::new();
    for place in (64..end.unwrap() as usize).step_by(97) {
        let mut copy = bytes.clone();
        copy[place] ^= 0x5a;
        std::fs::write(&damaged, &copy).unwrap();
        let file = Forest::open(&damaged).unwrap();
        let filter = Filter { classes: Some("0-3".parse().unwrap()), ..Filter::default() };
        let accepted = filter.on(file.lattice(), file.schema()).unwrap();
        let accepted = ForestFilter::of(&file, Some(accepted), None).unwrap();
        let outcome = pick(&file, &view, at, depth, &accepted);
        if let Ok(Some(picked)) = &outcome {
            is_of(picked, &input);
        }
        *outcomes.entry(outcome.is_ok()).or_insert(0) += 1;
    }
    assert!(outcomes.contains_key(&false), "{outcomes:?}");
}

/// The search itself, which windows may call for a mark without attributes.
#[test]
fn the_search_alone_finds_the_picked_point() {
    let folder = tempfile::tempdir().unwrap();
    let file = built(&[scan(20_000, hills, |_| 2)], folder.path());
    let (picture, view, appearance) =
        drawn(&file, &request(HILLS[0], Method::Points, &Filter::default()));
    for at in clicks(60) {
        let Some(depth) = depth_at(&picture, at) else { continue };
        let aim = Aim::new(&view, at, depth).unwrap();
        let found = find(&file, &aim, &appearance.shown, &mut Vec::new()).unwrap().unwrap();
        let picked = pick(&file, &view, at, depth, &appearance.shown).unwrap().unwrap();
        assert_eq!((found.node, found.point), (picked.node, picked.point));
        assert_eq!(found.position, picked.at());
    }
}
