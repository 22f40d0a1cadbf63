//! Measures surfaces against analytic scenes: `surface_quality FOLDER` writes `surfaces.json` (a row a scene, density,
//! kind of sample, with normals and without) and plots of it. Wall times are not measured here.

#[allow(dead_code, reason = "shared with the tests, which use more of it")]
#[path = "../tests/scene/mod.rs"]
mod scene;
#[path = "../tests/truth/mod.rs"]
mod truth;

use esker_lod::View;
use scene::Dice;
use truth::measure::{Cloud, Errors, Image};
use truth::sample::{Kind, floor, sample};
use truth::{Shape, Truth, walls, walls_view};

/// Points a pixel.
const DENSITIES: [f64; 7] = [0.05, 0.1, 0.25, 0.5, 1.0, 2.0, 4.0];
const SIDE: u32 = 160;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let out = std::env::args().nth(1).ok_or("give a folder for the figures")?;
    let out = std::path::PathBuf::from(out);
    let mut rows = Vec::new();
    let only: Vec<String> = std::env::args().skip(2).collect();
    let step = if only.iter().any(|o| o == "quick") { 3 } else { 1 };
    let wanted = |name: &str| only.len() + 1 == step.min(2) || only.iter().any(|o| o == name);
    for (name, truth, view) in truth::scenes(SIDE).into_iter().filter(|s| wanted(s.0)) {
        let image = Image::new(&truth, &view);
        for density in DENSITIES.into_iter().step_by(step) {
            for kind in [Kind::Regular, Kind::Poisson] {
                let cloud = cloud(&truth, &view, density, kind);
                for normals in [true, false] {
                    let e = cloud.draw(&view, normals).errors(&image);
                    rows.push(row(name, density, kind, normals, &e));
                    println!("{}", rows[rows.len() - 1]);
                }
            }
        }
    }
    if wanted("bleeding") {
        bleeding(&out)?;
    }
    std::fs::write(out.join("surfaces.json"), format!("[\n{}\n]\n", rows.join(",\n")))?;
    Ok(())
}

/// A scene sampled so that a pixel at its middle has so many points.
fn cloud(truth: &Truth, view: &View, density: f64, kind: Kind) -> Cloud {
    let dice = &mut Dice(17);
    if let [(Shape::Floor { z }, paint)] = truth.parts[..] {
        let bands = floor(view, &paint, z, 1.0 / density.sqrt(), kind, dice);
        let scenes = bands
            .iter()
            .map(|(spacing, s)| scene::Scene::new(&s.points, 1e-6, *spacing, s.radius, 1 << 15));
        return Cloud { scenes: scenes.collect(), averages: true };
    }
    let spacing = view.eye.length() / view.focal_px() / density.sqrt();
    let s = sample(truth, spacing, kind, dice);
    Cloud::new(&s.points, spacing, s.radius)
}

fn row(name: &str, density: f64, kind: Kind, normals: bool, e: &Errors) -> String {
    format!(
        "{{\"scene\":\"{name}\",\"density\":{density},\"sample\":\"{kind:?}\",\"normals\":{normals},\"colour\":{:.3},\"depth_px\":{:.4},\"normal_deg\":{:.3},\"holes\":{},\"bleeding\":{},\"swell_px\":{:.3},\"alpha\":{:.4},\"pixels\":{}}}",
        e.colour, e.depth_px, e.normal_deg, e.holes, e.bleeding, e.swell_px, e.alpha, e.pixels
    )
}

/// Shares of the pixels that show the far one of two walls, over the gap's ratio to the radius, as passes draw them and
/// with the published intervals.
fn bleeding(out: &std::path::Path) -> Result<(), Box<dyn std::error::Error>> {
    let (gap, mut rows) = (0.01, Vec::new());
    for spacing_px in [1.5, 5.0] {
        for degrees in [0.0, 45.0, 70.0, 80.0, 85.0] {
            for ratio in [0.25, 0.5, 0.75, 1.05, 1.5, 2.0, 3.0, 5.0] {
                let radius = gap / ratio;
                let spacing = radius / 0.9;
                let view = walls_view(SIDE, degrees, f64::from(SIDE) * spacing / spacing_px);
                let truth = walls(gap, f64::from(SIDE) * spacing / spacing_px * 3.0);
                let image = Image::new(&truth, &view);
                let points = sample(&truth, spacing, Kind::Poisson, &mut Dice(5)).points;
                let cloud = Cloud::new(&points, spacing, radius);
                let inside =
                    (0..image.seen.len()).filter(|&p| image.is_inside(p, 2)).count() as f64;
                let share = |d: &truth::measure::Drawn| 100.0 * d.bleeding(&image) as f64 / inside;
                let [with, bare] = [true, false].map(|n| share(&cloud.draw(&view, n)));
                let [with_old, bare_old] =
                    [true, false].map(|n| share(&cloud.draw_published(&view, n)));
                rows.push(format!(
                    "{{\"spacing_px\":{spacing_px},\"degrees\":{degrees},\"ratio\":{ratio},\"normals\":{with:.4},\"bare\":{bare:.4},\"published_normals\":{with_old:.4},\"published_bare\":{bare_old:.4}}}"
                ));
                println!("{}", rows[rows.len() - 1]);
            }
        }
    }
    std::fs::write(out.join("bleeding.json"), format!("[\n{}\n]\n", rows.join(",\n")))?;
    Ok(())
}
