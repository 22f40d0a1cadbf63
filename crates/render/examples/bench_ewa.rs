//! Measures millions of splats per second by EWA splatting, as table 1 of `zwicker2004`: splats of
//! a constant size in the picture, nine pixels on average, all facing the viewer and in view, in
//! one pass and in three. The time should be linear in their number.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a measurement")]

#[path = "../tests/scene/mod.rs"]
#[allow(dead_code, reason = "shared with tests, which use more of it")]
mod scene;

use esker_lod::View;
use esker_render::ewa::Passes;
use esker_render::{Frame, Method, Pass, Picture, Renderer};
use glam::DVec3;
use scene::{Dice, Scene, sheet};

fn main() {
    if std::env::args().nth(1).is_some() {
        return measure([512, 512], Passes::Three, 806);
    }
    for size in [[512, 512], [1280, 1024]] {
        for passes in [Passes::One, Passes::Three] {
            for side in [316, 574, 806, 2236] {
                measure(size, passes, side);
            }
        }
    }
}

fn measure([width, height]: [u32; 2], passes: Passes, side: usize) {
    let view = View::look_at(DVec3::NEG_Y * 4.0, DVec3::ZERO, DVec3::Z, 0.6, width, height);
    // A wall that just fills the picture.
    let half = 4.0 * 0.3f64.tan() * 0.98;
    let (u, v) =
        (DVec3::X * half * 2.0 * f64::from(width) / f64::from(height), DVec3::Z * half * 2.0);
    let mut renderer = Renderer::default();
    renderer.ewa.options.passes = passes;
    // The area of an ellipse with the low-pass is nine pixels.
    let cutoff = f64::from(renderer.ewa.options.cutoff);
    let radius_px = (9.0 / std::f64::consts::PI - cutoff * cutoff).sqrt();
    let radius = radius_px * 4.0 / view.focal_px();
    renderer.ewa.options.radius_factor = 1.0;
    let points = sheet(&mut Dice(7), (u + v) * -0.5, u, v, side, [200, 120, 60]);
    let scene = Scene::new(&points, 1e-6, radius, radius, 1 << 16);
    let draws = scene.draws(true, true, true);
    let frame = Frame { method: Method::Ewa, ..scene.frame(&view, &draws) };
    let mut picture = Picture::default();
    let mut times = [f64::INFINITY; 3];
    for _ in 0..5 {
        renderer.render_into(&frame, &mut picture).unwrap();
        let s = picture.stats.stages;
        for (best, ms) in times.iter_mut().zip([s.ms(Pass::Place), s.ms(Pass::Blend), s.total_ms]) {
            *best = best.min(ms);
        }
    }
    let splats = picture.stats.splats_drawn;
    let [place, blend, all] = times;
    println!(
        "{width} x {height}, {passes:?}: {splats:8} splats, {:6.2} M/s; place {place:.1} ms, blend {blend:.1}, all {all:.1}",
        splats as f64 / all / 1e3
    );
}
