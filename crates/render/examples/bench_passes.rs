//! Measures milliseconds a pass at 1024 x 1024 pixels: `bench_passes [RUNS [least]]` draws a
//! generated terrain of 1 and 5 million points (nodes of 65,536 in Morton order, residuals,
//! colours, with and without normals) and prints medians, or least times. Publish the numbers with
//! the machine that they were measured on.

#[allow(dead_code, reason = "shared with the tests, which use more of it")]
#[path = "../tests/scene/mod.rs"]
mod scene;

use esker_lod::View;
use esker_render::{Method, Pass, PassTimes, Picture, Renderer};
use glam::DVec3;
use scene::{Dice, Scene, ScenePoint};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let runs = std::env::args().nth(1).map_or(Ok(9), |n| n.parse())?;
    let least = std::env::args().nth(2).is_some_and(|a| a == "least");
    let what = if least { "least" } else { "median" };
    println!("{} threads, {what} of {runs}", rayon::current_num_threads());
    println!(
        "points   method     normals  project  gather   pull   push   holes  shade     aa  total   covered"
    );
    for side in [1000, 2236] {
        let scene = terrain(side);
        let view = View::look_at(
            DVec3::new(0.0, -620.0, 420.0),
            DVec3::new(0.0, 0.0, -40.0),
            DVec3::Z,
            1.0,
            1024,
            1024,
        );
        for (method, normals) in
            [(Method::PullPush, true), (Method::PullPush, false), (Method::Points, false)]
        {
            let draws = scene.draws(true, true, normals);
            let mut frame = scene.frame(&view, &draws);
            frame.method = method;
            let (mut renderer, mut picture) = (Renderer::default(), Picture::default());
            let mut stages = Vec::new();
            for _ in 0..runs + 1 {
                renderer.render_into(&frame, &mut picture)?;
                stages.push(picture.stats.stages);
            }
            // The first frame allocates memory.
            let stages = &stages[1..];
            // The median; the least time on a machine with other load.
            let pick = |of: fn(&PassTimes) -> f64| {
                let mut all: Vec<f64> = stages.iter().map(of).collect();
                all.sort_by(f64::total_cmp);
                if least { all[0] } else { all[all.len() / 2] }
            };
            println!(
                "{:8} {:10} {:7} {:8.1} {:7.1} {:6.1} {:6.1} {:6.1} {:6.1} {:6.1} {:6.1} {:8.1} %",
                picture.stats.points_drawn,
                format!("{method:?}"),
                normals,
                pick(|s| s.ms(Pass::Project)),
                pick(|s| s.ms(Pass::Gather)),
                pick(|s| s.ms(Pass::Pull)),
                pick(|s| s.ms(Pass::Push)),
                pick(|s| s.sum_ms(&[Pass::FillHoles, Pass::Silhouette])),
                pick(|s| s.ms(Pass::Shade)),
                pick(|s| s.ms(Pass::Antialias)),
                pick(|s| s.total_ms),
                picture.stats.pixels_covered as f64 / (1 << 20) as f64 * 100.0,
            );
        }
    }
    Ok(())
}

/// Hills, a kilometre wide.
fn terrain(side: usize) -> Scene {
    let mut dice = Dice(3);
    let height = |x: f64, y: f64| {
        40.0 * ((x / 90.0).sin() * (y / 70.0).cos()) + 6.0 * ((x / 17.0).sin() + (y / 13.0).sin())
    };
    let spacing = 1000.0 / side as f64;
    let points: Vec<_> = (0..side * side)
        .map(|i| {
            let x = ((i % side) as f64 + dice.unit()) * spacing - 500.0;
            let y = ((i / side) as f64 + dice.unit()) * spacing - 500.0;
            let z = height(x, y);
            let slope = [height(x + 0.1, y) - z, height(x, y + 0.1) - z].map(|d| -d / 0.1);
            let normal = DVec3::new(slope[0], slope[1], 1.0).normalize_or_zero();
            let green = (140.0 + z) as u8;
            ScenePoint { at: DVec3::new(x, y, z), normal, colour: [120, green, 90] }
        })
        .collect();
    Scene::new(&points, 1e-3, spacing, spacing * 1.42, 65_536)
}
