//! Elliptical splats: on a surface scanned in lines they blur less along the lines than discs,
//! which have to reach from line to line, and leave no hole. Coarser samples are drawn with discs.

use crate::passes::draw;
use crate::scene::{Dice, Scene, ScenePoint};
use esker_lod::View;
use esker_points::tangents::Shape;
use esker_render::ewa::Options;
use esker_render::inputs::colour;
use glam::DVec3;

const SIZE: u32 = 200;
/// Distance of points along a line.
const ALONG: f64 = 0.02;
/// Distance of lines, in distances of points.
const APART: f64 = 4.0;
/// Period of the texture along the lines, in points.
const PERIOD: f64 = 8.0;

/// Texture at height `z` along the lines.
fn is_red(z: f64) -> bool {
    (z / (ALONG * PERIOD)).rem_euclid(1.0) < 0.5
}

/// A wall scanned in vertical lines, each with a random offset along itself. With `shaped`, its
/// splats are ellipses.
pub fn lines(shaped: bool) -> Scene {
    let mut dice = Dice(5);
    let mut points = Vec::new();
    for line in -22..=22 {
        let moved = dice.unit();
        for step in -90..=90 {
            let [x, z] = [f64::from(line) * ALONG * APART, (f64::from(step) + moved) * ALONG];
            let colour = if is_red(z) { [255, 0, 0] } else { [0, 0, 255] };
            points.push(ScenePoint { at: DVec3::new(x, 0.0, z), normal: DVec3::NEG_Y, colour });
        }
    }
    let spacing = ALONG * APART.sqrt();
    let mut scene = Scene::new(&points, 1e-5, spacing, spacing, 3000);
    let shape = Shape {
        along: [1.0, 0.0, 0.0],
        apart: (ALONG * APART) as f32,
        aspect: APART.sqrt() as f32,
    };
    if shaped {
        for node in &mut scene.nodes {
            let points = node.position.len() / 8;
            node.tangents = shape.code(spacing as f32).repeat(points);
        }
    }
    scene
}

/// View from the front at a distance at which lines are `line_px` pixels apart.
pub fn front(line_px: f64) -> View {
    let distance = f64::from(SIZE) / (2.0 * 0.3f64.tan()) * ALONG * APART / line_px;
    let mut view = View::look_at(DVec3::NEG_Y * distance, DVec3::ZERO, DVec3::Z, 0.6, SIZE, SIZE);
    view.near = 0.01;
    view
}

/// Root mean square error of red against the texture averaged over each pixel, and the number of
/// pixels without a splat. `factor` multiplies all radii.
fn error(shaped: bool, line_px: f64, factor: f64) -> (f64, usize) {
    let (mut scene, view) = (lines(shaped), front(line_px));
    // A coarser sample is drawn with radii that are larger by `factor`.
    scene.nodes.iter_mut().for_each(|n| {
        n.position.chunks_mut(8).for_each(|p| {
            p[6] = (f64::from(p[6]) + 16.0 * factor.log2()).round() as u8;
        })
    });
    let draws = scene.draws(true, true, true);
    let (level, depth, _) = draw(&scene.frame(&view, &draws), Options::default());
    let (mut sum, mut holes, mut count) = (0.0, 0, 0.0);
    for y in 20..SIZE - 20 {
        for x in 20..SIZE - 20 {
            let pixel = (y * SIZE + x) as usize;
            holes += usize::from(!depth[pixel].is_finite());
            let per_px = ALONG * APART / line_px;
            let red = |k: u32| {
                let z =
                    (f64::from(SIZE) / 2.0 - f64::from(y) - (f64::from(k) + 0.5) / 16.0) * per_px;
                f64::from(u8::from(is_red(z)))
            };
            let wanted = (0..16).map(red).sum::<f64>() / 16.0;
            let found = level.tint[pixel].truncate() * colour::linear([255, 0, 0]);
            sum += (f64::from(found.x) - wanted).powi(2);
            count += 1.0;
        }
    }
    ((sum / count).sqrt(), holes)
}

#[test]
fn ellipses_keep_the_detail_of_scan_lines_and_close_the_gaps_between_them() {
    for line_px in [6.0, 10.0, 16.0] {
        let ((discs, _), (shapes, holes)) = (error(false, line_px, 1.0), error(true, line_px, 1.0));
        println!(
            "lines {line_px} pixels apart: off by {discs:.3} with discs, {shapes:.3} with shapes"
        );
        assert!(shapes < 0.82 * discs, "{line_px}: {shapes} {discs}");
        assert_eq!(holes, 0, "{line_px}");
    }
}

#[test]
fn coarser_samples_are_drawn_with_discs_whatever_their_shapes() {
    // The points of the sample are at least as far apart as the lines.
    let ((discs, _), (shapes, _)) = (error(false, 8.0, 4.0), error(true, 8.0, 4.0));
    assert!((discs - shapes).abs() < 1e-3, "{discs} {shapes}");
}
