//! Draws synthetic scenes with and without normals, to be looked at: `pictures FOLDER` writes PNG
//! files. With `ESKER_DATA` set it draws the bunny too.

#[allow(dead_code, reason = "shared with the tests, which use more of it")]
#[path = "../tests/scene/mod.rs"]
mod scene;

use esker_lod::View;
use esker_render::{ColourBy, Method, Picture, Renderer};
use glam::DVec3;
use scene::{Dice, Scene, sheet, sphere};
use std::path::Path;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = std::env::args().nth(1).ok_or("give a folder for the pictures")?;
    let folder = Path::new(&folder);
    let view = View::look_at(
        DVec3::new(3.4, -4.6, 2.6),
        DVec3::new(0.0, 0.0, 0.7),
        DVec3::Z,
        0.75,
        1024,
        768,
    );
    for (name, points) in [("dense", 400_000), ("sparse", 12_000)] {
        let scene = still_life(points);
        for (kind, normals, method, colour) in [
            ("normals", true, Method::PullPush, ColourBy::Rgb),
            ("clay", true, Method::PullPush, ColourBy::Plain),
            ("bare", false, Method::PullPush, ColourBy::Rgb),
            ("bare-clay", false, Method::PullPush, ColourBy::Plain),
            ("points", false, Method::Points, ColourBy::Rgb),
        ] {
            let draws = scene.draws(true, true, normals);
            let mut frame = scene.frame(&view, &draws);
            (frame.method, frame.colour) = (method, colour);
            let picture = Renderer::default().render(&frame)?;
            println!("{name}-{kind}: {:?}", picture.stats);
            write_png(&folder.join(format!("render-{name}-{kind}.png")), &picture)?;
        }
    }
    if let Some(points) = scene::bunny() {
        let scene = Scene::new(&points, 1e-7, 0.0011, 0.0014, 8192);
        let (eye, centre) = (DVec3::new(0.1, 0.2, 0.35), DVec3::new(-0.017, 0.1, -0.0015));
        let view = View::look_at(eye, centre, DVec3::Y, 0.5, 1024, 1024);
        for normals in [true, false] {
            let draws = scene.draws(true, false, normals);
            let picture = Renderer::default().render(&scene.frame(&view, &draws))?;
            write_png(&folder.join(format!("render-bunny-{normals}.png")), &picture)?;
        }
    }
    Ok(())
}

/// A sphere on a floor before two walls, and a small sphere in front. The number of points of each
/// part follows from `points`.
fn still_life(points: usize) -> Scene {
    let mut dice = Dice(7);
    let side = (points as f64 / 3.0).sqrt() as usize;
    let mut all = sheet(
        &mut dice,
        DVec3::new(-2.0, -2.0, 0.0),
        DVec3::X * 4.0,
        DVec3::Y * 4.0,
        side,
        [200, 190, 170],
    );
    all.extend(sheet(
        &mut dice,
        DVec3::new(-2.0, 2.0, 0.0),
        DVec3::X * 4.0,
        DVec3::Z * 2.5,
        side,
        [120, 150, 180],
    ));
    all.extend(sheet(
        &mut dice,
        DVec3::new(-2.0, -2.0, 0.0),
        DVec3::Y * 4.0,
        DVec3::Z * 2.5,
        side,
        [170, 120, 110],
    ));
    all.extend(sphere(&mut dice, DVec3::new(0.2, 0.2, 1.0), 1.0, points, [220, 170, 60]));
    all.extend(sphere(&mut dice, DVec3::new(1.3, -1.2, 0.35), 0.35, points / 8, [90, 170, 90]));
    // Random points leave larger gaps than even samples, which the radius covers.
    let spacing = 4.0 / side as f64;
    Scene::new(&all, 1e-4, spacing, spacing * 1.42, 1 << 15)
}

fn write_png(path: &Path, picture: &Picture) -> Result<(), Box<dyn std::error::Error>> {
    let file = std::io::BufWriter::new(std::fs::File::create(path)?);
    let mut encoder = png::Encoder::new(file, picture.width, picture.height);
    encoder.set_color(png::ColorType::Rgba);
    encoder.write_header()?.write_image_data(&picture.rgba)?;
    Ok(())
}
