//! Figure 6 of zwicker2004: without moiré, a checkerboard up to the horizon.

use crate::passes::draw;
use crate::scene::{Scene, ScenePoint};
use esker_lod::View;
use esker_render::ewa::Options;
use glam::DVec3;

const SPACING: f64 = 0.05;
const HEIGHT: f64 = 4.0;
const WIDTH: u32 = 128;
const ROWS: u32 = 176;
/// Samples of the reference along the side of a pixel.
const FINE: u32 = 8;

/// A plane of points whose colour changes after every second point.
fn checkerboard() -> Scene {
    let mut points = Vec::new();
    let near = 4.0;
    let far = 26.0;
    let rows = (far / SPACING) as i32;
    for j in (near / SPACING) as i32..rows {
        let half = (f64::from(j) * SPACING * 0.75 / SPACING) as i32 + 20;
        for i in -half..half {
            let white = (i.div_euclid(2) + j.div_euclid(2)) % 2 == 0;
            let at = DVec3::new(f64::from(i) * SPACING, f64::from(j) * SPACING, 0.0);
            let colour = if white { [255; 3] } else { [0; 3] };
            points.push(ScenePoint { at, normal: DVec3::Z, colour });
        }
    }
    Scene::new(&points, 1.0 / 4096.0, SPACING, SPACING, 1 << 16)
}

/// Red of each pixel, linear light; the picture has `fine` pixels along the side of a pixel.
fn picture(scene: &Scene, fine: u32, options: Options) -> Vec<f32> {
    let eye = DVec3::new(0.013, 0.0, HEIGHT);
    // A focal length of 100 pixels.
    let fovy = 2.0 * (f64::from(ROWS) / 200.0).atan();
    let view = View::look_at(eye, eye + DVec3::Y, DVec3::Z, fovy, WIDTH * fine, ROWS * fine);
    let draws = scene.draws(true, true, true);
    let (level, ..) = draw(&scene.frame(&view, &draws), options);
    (0..level.tint.len()).map(|i| if level.is_valid(i) { level.tint[i].x } else { 0.0 }).collect()
}

#[test]
fn the_lowpass_filter_removes_moire() {
    let scene = checkerboard();
    let options = Options::default();
    let bare = Options { lowpass: false, ..options };
    let fine = picture(&scene, FINE, bare);
    // Samples of the reference are weighted by the same Gaussian, of a variance of one pixel, with
    // the filter's cutoff.
    let reference = |x: u32, y: u32| {
        let reach = (options.cutoff * FINE as f32) as i32;
        let (mut sum, mut weights) = (0.0, 0.0);
        for j in -reach..=reach {
            for i in -reach..=reach {
                let at = [
                    (x * FINE) as i32 + FINE as i32 / 2 + i,
                    (y * FINE) as i32 + FINE as i32 / 2 + j,
                ];
                let d = [i, j].map(|c| (c as f32 + 0.5) / FINE as f32);
                let squared = d[0] * d[0] + d[1] * d[1];
                if squared < options.cutoff * options.cutoff {
                    let weight = (-0.5 * squared).exp();
                    sum += weight * fine[at[1] as usize * (WIDTH * FINE) as usize + at[0] as usize];
                    weights += weight;
                }
            }
        }
        sum / weights
    };
    // Rows where the spacing along the view is smaller than a pixel but larger than a sample of the
    // reference: distances of 5 to 10, at which it is 0.8 to 0.2 pixels.
    let band = |y: u32| (40..80).contains(&(y - ROWS / 2));
    let [with, without] = [options, bare].map(|options| {
        let drawn = picture(&scene, 1, options);
        let mut sum = 0.0;
        let mut count = 0;
        for y in (ROWS / 2 + 20..ROWS - 2).filter(|&y| band(y)) {
            for x in 4..WIDTH - 4 {
                let error = drawn[(y * WIDTH + x) as usize] - reference(x, y);
                sum += f64::from(error * error);
                count += 1;
            }
        }
        (sum / f64::from(count)).sqrt()
    });
    eprintln!("error against the reference: {without:.4} without the low-pass, {with:.4} with it");
    assert!(without > 5.0 * with, "{without} and {with}");
}
