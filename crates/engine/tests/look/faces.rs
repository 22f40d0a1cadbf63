//! Faces of a cube, each of its own colour, from bare points to a picture by EWA splatting: where
//! sharp edges are known, no face shows through another one or beyond the outline.

use super::splats::request;
use esker_engine::NormalsMode;
use esker_engine::calls::render::draw;
use esker_engine::draw::scene::{PictureRequest, PictureScene};
use esker_format::Forest;
use esker_lod::View;
use esker_points::task::Silent;
use glam::{DVec2, DVec3};
use std::f64::consts::FRAC_PI_8;
use std::fmt::Write;
use std::path::{Path, PathBuf};

const SIZE: [u32; 2] = [500, 350];
/// Points on an edge of the cube.
const SIDE: i32 = 34;
/// Distance from the outline of a face within which pixels may mix colours.
const BLUR_PX: f64 = 2.0;
/// Cameras, of which some see a hidden face at a grazing angle behind the edge of another one.
const CAMERAS: [&str; 6] = [
    "",
    "eye=2.5,-2,1.8;target=0.5,0.5,0.5;fovy=35",
    "eye=-1.6,-2.4,0.9;target=0.5,0.5,0.5;fovy=35",
    "eye=3,2.6,-1.5;target=0.5,0.5,0.5;fovy=35",
    "eye=0.5,-3,1.4;target=0.5,0.5,0.5;fovy=35",
    "eye=2.5,-2,1.8;target=1,0,0.9;fovy=9",
];

/// Colour of a face: which of red, green and blue it has.
fn colour([axis, side]: [usize; 2]) -> [bool; 3] {
    let all = [[0, 1, 1], [1, 0, 1], [0, 0, 1], [1, 1, 0], [1, 0, 0], [0, 1, 0]];
    all[2 * axis + side].map(|part| part == 1)
}

/// A cube of edge 1, with a grid of points on each face.
fn scan(folder: &Path) -> PathBuf {
    let mut points = String::new();
    for i in 0..SIDE * SIDE {
        let [u, v] = [i % SIDE, i / SIDE].map(|k| (f64::from(k) + 0.5) / f64::from(SIDE));
        for (axis, side) in [(0, 0), (0, 1), (1, 0), (1, 1), (2, 0), (2, 1)] {
            let mut at = [u, v, u];
            (at[axis], at[(axis + 1) % 3], at[(axis + 2) % 3]) = (side as f64, u, v);
            let [r, g, b] = colour([axis, side]).map(|part| if part { 255 } else { 0 });
            writeln!(points, "{} {} {} {r} {g} {b}", at[0], at[1], at[2]).unwrap();
        }
    }
    let path = folder.join("cube.csv");
    std::fs::write(&path, format!("x y z red green blue\n{points}")).unwrap();
    path
}

/// The face that a place of the picture shows.
fn face(view: &View, place: DVec2) -> Option<[usize; 2]> {
    let centre = DVec2::new(f64::from(SIZE[0]), f64::from(SIZE[1])) * 0.5;
    let from = (place - centre) / view.focal_px();
    let ray = view.view_from_world().transpose() * DVec3::new(from.x, -from.y, -1.0);
    let (begin, end) = (-view.eye / ray, (DVec3::ONE - view.eye) / ray);
    let (enter, leave) = (begin.min(end), begin.max(end));
    let at = enter.max_element();
    let axis = (0..3).find(|&axis| enter[axis] == at).unwrap();
    (at < leave.min_element()).then(|| [axis, usize::from(end[axis] < begin[axis])])
}

/// Pixels more than [`BLUR_PX`] from all outlines: inside of faces, those that show another colour,
/// and outside of the cube those that show any.
fn wrong(file: &Forest, camera: &str) -> [usize; 3] {
    let request = PictureRequest { shines: false, ..request(camera, SIZE) };
    let view = PictureScene::choose(file, &request).unwrap().view;
    let (drawn, _) = draw(file, &request, &Silent).unwrap();
    let [mut inside, mut wrong, mut outside] = [0; 3];
    for (i, rgba) in drawn.rgba.as_chunks::<4>().0.iter().enumerate() {
        let place = DVec2::new((i % SIZE[0] as usize) as f64, (i / SIZE[0] as usize) as f64) + 0.5;
        let own = face(&view, place);
        let around = |k: i32| place + DVec2::from_angle(f64::from(k) * FRAC_PI_8) * BLUR_PX;
        if (0..16).any(|k| face(&view, around(k)) != own) {
            continue;
        }
        let is_drawn = drawn.depth[i].is_finite();
        if let Some(own) = own {
            inside += 1;
            let greatest = *rgba[..3].iter().max().unwrap();
            // A share of 5 % in linear light.
            let shown = [0, 1, 2].map(|part| rgba[part] > greatest / 4);
            wrong += usize::from(!is_drawn || shown != colour(own));
        } else {
            outside += usize::from(is_drawn);
        }
    }
    [inside, wrong, outside]
}

#[test]
fn a_cube_with_sharp_edges_shows_no_colour_of_another_face() {
    let folder = tempfile::tempdir().unwrap();
    let scan = scan(folder.path());
    for (normals, tangents) in [(NormalsMode::Estimate, true), (NormalsMode::Fast, false)] {
        let out = folder.path().join(format!("{tangents}.esker"));
        let options = esker_builder::Options {
            normals,
            tangents,
            sharp_features: true,
            ..Default::default()
        };
        esker_builder::build(std::slice::from_ref(&scan), &out, &options, &Silent).unwrap();
        let file = Forest::open(&out).unwrap();
        for camera in CAMERAS {
            let [inside, wrong, outside] = wrong(&file, camera);
            assert!(inside > 10_000, "{camera}: {inside}");
            assert!(wrong * 1000 <= inside, "{camera}: {wrong} of {inside}");
            assert_eq!(outside, 0, "{camera}");
        }
    }
}
