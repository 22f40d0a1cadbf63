//! Draws a box with two blocks and a ball, lit by a lamp, a window of sky or both, as PNG: a
//! picture to look at while working on the tracer.
//!
//! `cargo run --release -p esker-trace --example lit -- OUT.png [SAMPLES] [BOUNCES] [FILTER]
//! [PART]`
//! FILTER: none, guided, nested, bilateral, atrous. PART: radiance, direct, indirect.

use esker_lod::View;
use esker_trace::filter::{FilterKind, Settings};
use esker_trace::scene::{Material, Mesh, MeshTree, Object};
use esker_trace::{Camera, Light, Lights, Options, Scene, Sky, Tracer};
use glam::{Affine3A, DVec3, Quat, Vec3};
use std::error::Error;
use std::sync::Arc;
use std::time::Instant;

fn object(positions: Vec<Vec3>, quads: &[[u32; 4]], albedo: Vec3, place: Affine3A) -> Object {
    let triangles = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    let material = Material { albedo, ..Default::default() };
    let mesh = Mesh { positions, triangles, material, ..Default::default() };
    Object { mesh: Arc::new(MeshTree::new(mesh)), place }
}

/// Sides of the unit cube, one quad each: x-, x+, y-, y+, z-, z+.
const SIDES: [[u32; 4]; 6] =
    [[0, 2, 6, 4], [1, 5, 7, 3], [0, 4, 5, 1], [2, 3, 7, 6], [0, 1, 3, 2], [4, 6, 7, 5]];

fn cube(sides: &[usize], albedo: Vec3, place: Affine3A) -> Object {
    let corner = |i: u32| Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32);
    let quads: Vec<_> = sides.iter().map(|&side| SIDES[side]).collect();
    object((0..8).map(corner).collect(), &quads, albedo, place)
}

fn ball(albedo: Vec3, place: Affine3A) -> Object {
    let (columns, rows) = (96, 48);
    let at = |i: u32| {
        let (u, v) = ((i % columns) as f32 / columns as f32, (i / columns) as f32 / rows as f32);
        let (sin, cos) = (v * std::f32::consts::PI).sin_cos();
        let (y, x) = (u * std::f32::consts::TAU).sin_cos();
        Vec3::new(x * sin, y * sin, cos)
    };
    let positions: Vec<_> = (0..columns * (rows + 1)).map(at).collect();
    let quad = |i: u32| {
        let (row, next) = (i - i % columns, (i + 1) % columns);
        [i, i + columns, row + columns + next, row + next]
    };
    let quads: Vec<_> = (0..columns * rows).map(quad).collect();
    let triangles = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    let normals = positions.clone();
    let material = Material { albedo, ..Default::default() };
    let mesh = Mesh { positions, normals, triangles, material, ..Default::default() };
    Object { mesh: Arc::new(MeshTree::new(mesh)), place }
}

fn scene() -> Scene {
    let white = Vec3::splat(0.75);
    let block = |angle: f32, size: Vec3, at: Vec3| {
        Affine3A::from_scale_rotation_translation(size, Quat::from_rotation_z(angle), at)
    };
    let objects = vec![
        cube(&[3, 4, 5], white, Affine3A::IDENTITY),
        cube(&[0], Vec3::new(0.63, 0.07, 0.05), Affine3A::IDENTITY),
        cube(&[1], Vec3::new(0.14, 0.45, 0.09), Affine3A::IDENTITY),
        cube(
            &[0, 1, 2, 3, 5],
            white,
            block(0.3, Vec3::new(0.3, 0.3, 0.6), Vec3::new(0.18, 0.5, 0.0)),
        ),
        ball(white, block(0.0, Vec3::splat(0.17), Vec3::new(0.68, 0.3, 0.17))),
    ];
    Scene::default().with_objects(objects)
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let argument = |i: usize| arguments.get(i).map(String::as_str);
    let out = argument(0).ok_or("name the picture to write")?;
    let number = |i: usize| argument(i).map_or(Ok(1), str::parse::<u32>);
    let kind = match argument(3).unwrap_or("nested") {
        "none" => FilterKind::None,
        "guided" => FilterKind::Guided,
        "bilateral" => FilterKind::Bilateral,
        "atrous" => FilterKind::Atrous,
        _ => FilterKind::Nested,
    };
    let view = View::look_at(
        DVec3::new(0.5, -1.35, 0.5),
        DVec3::new(0.5, 0.0, 0.5),
        DVec3::Z,
        0.7,
        1024,
        768,
    );
    let lights = Lights::from(vec![
        Light::Area {
            corner: [0.35, 0.35, 0.999],
            edges: [[0.0, 0.3, 0.0], [0.3, 0.0, 0.0]],
            radiance: [14.0, 11.0, 7.0],
            two_sided: false,
        },
        Light::Sky { sky: Sky::Constant([0.1, 0.14, 0.2]) },
    ]);
    let mut tracer = Tracer::new(Options {
        bounces: number(2)?,
        filter: Settings::of(kind),
        ..Options::default()
    });
    let (camera, scene) = (Camera::new(&view, DVec3::ZERO), scene());
    let began = Instant::now();
    tracer.trace(&scene, 0, &lights.prepare(DVec3::ZERO), &camera, number(1)?, &|| false);
    let picture = tracer.resolve();
    println!("{:.0} ms, {:?}", began.elapsed().as_secs_f64() * 1e3, tracer.stats());
    let part = match argument(4) {
        Some("direct") => picture.direct,
        Some("indirect") => picture.indirect,
        _ => picture.radiance,
    };
    let mut bytes = Vec::new();
    for i in 0..part.len() {
        bytes.extend(part.planes.iter().map(|plane| {
            let light = plane[i].clamp(0.0, 1.0);
            let value = if light <= 0.003_130_8 {
                12.92 * light
            } else {
                1.055 * light.powf(1.0 / 2.4) - 0.055
            };
            (value * 255.0 + 0.5) as u8
        }));
    }
    let file = std::io::BufWriter::new(std::fs::File::create(out)?);
    let mut encoder = png::Encoder::new(file, part.width as u32, part.height as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.write_header()?.write_image_data(&bytes)?;
    Ok(())
}
