//! Measures the quality of surfaces on analytic scenes: `surface_quality FOLDER [SCENE...]` writes
//! `surfaces.json` (a row for each scene, density and kind of sample, with and without normals, as
//! published and as drawn), `bleeding.json`, and a plot of each. Times are not measured.

#[path = "surface_quality/plots.rs"]
mod plots;
#[allow(dead_code, reason = "shared with the tests, which use more of it")]
#[path = "../tests/scene/mod.rs"]
mod scene;
#[path = "../tests/truth/mod.rs"]
mod truth;

use esker_lod::View;
use esker_truth::dice::Dice;
use esker_truth::image::Image;
use esker_truth::sample::{Kind, sample};
use esker_truth::{Truth, walls, walls_view};
use plots::Panel;
use truth::flicker::{Flicker, flicker, orbit};
use truth::measure::{Cloud, Errors};

/// Points per pixel.
const DENSITIES: [f64; 7] = [0.05, 0.1, 0.25, 0.5, 1.0, 2.0, 4.0];
const SIDE: u32 = 128;
/// Frames of a slow orbit, and distance in pixels by which a point of the surface moves from one to
/// the next.
const WAY: (usize, f64) = (4, 0.25);
/// Ways of drawing: name, with normals, with the published depth intervals.
const WAYS: [(&str, bool, bool); 4] = [
    ("normals", true, false),
    ("without normals", false, false),
    ("normals, published intervals", true, true),
    ("without normals, published intervals", false, true),
];

/// Errors of one way of drawing a sample.
struct Row {
    scene: &'static str,
    density: f64,
    kind: Kind,
    way: usize,
    errors: Errors,
    flicker: Option<Flicker>,
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let out = std::env::args().nth(1).ok_or("give a folder for the figures")?;
    let out = std::path::PathBuf::from(out);
    let only: Vec<String> = std::env::args().skip(2).collect();
    let wanted = |name: &str| only.is_empty() || only.iter().any(|o| o == name);
    let mut rows = Vec::new();
    for (name, truth, view) in esker_truth::scenes(SIDE).into_iter().filter(|s| wanted(s.0)) {
        for density in DENSITIES {
            for kind in [Kind::Regular, Kind::Poisson] {
                rows.extend(measure(name, &truth, &view, density, kind));
            }
        }
    }
    let json: Vec<String> = rows.iter().map(Row::json).collect();
    std::fs::write(out.join("surfaces.json"), format!("[\n{}\n]\n", json.join(",\n")))?;
    std::fs::write(out.join("surfaces.svg"), plots::grid(&panels(&rows)))?;
    if wanted("bleeding") {
        bleeding(&out)?;
    }
    Ok(())
}

fn measure(scene: &'static str, truth: &Truth, view: &View, density: f64, kind: Kind) -> Vec<Row> {
    let cloud = Cloud::of(truth, view, density, kind, &mut Dice(17));
    let image = Image::new(truth, view);
    // Only these scenes lie around the origin, which the orbit turns about.
    let turns = ["sphere", "cube", "torus"].contains(&scene) && kind == Kind::Poisson;
    let row = |(way, (_, normals, published)): (usize, &(&str, bool, bool))| {
        let drawn = match published {
            true => cloud.draw_published(view, *normals),
            false => cloud.draw(view, *normals),
        };
        let around = orbit(view, WAY.0, WAY.1);
        let flicker = (turns && !published).then(|| flicker(&cloud, truth, &around, *normals));
        let row = Row { scene, density, kind, way, errors: drawn.errors(&image), flicker };
        println!("{}", row.json());
        row
    };
    WAYS.iter().enumerate().map(row).collect()
}

impl Row {
    fn json(&self) -> String {
        let (e, f) = (&self.errors, self.flicker.unwrap_or_default());
        let (_, normals, published) = WAYS[self.way];
        format!(
            "{{\"scene\":\"{}\",\"density\":{},\"sample\":\"{:?}\",\"normals\":{normals},\"published\":{published},\"colour\":{:.3},\"depth_px\":{:.4},\"normal_deg\":{:.3},\"holes\":{},\"bleeding\":{},\"swell_px\":{:.3},\"alpha\":{:.4},\"pixels\":{},\"flicker_colour\":{:.3},\"flicker_depth_px\":{:.4},\"flicker_normal_deg\":{:.3}}}",
            self.scene,
            self.density,
            self.kind,
            e.colour,
            e.depth_px,
            e.normal_deg,
            e.holes,
            e.bleeding,
            e.swell_px,
            e.alpha,
            e.pixels,
            f.colour,
            f.depth_px,
            f.normal_deg
        )
    }
}

/// One panel for each scene and error, with Poisson-disk samples and a curve for each way of
/// drawing.
fn panels(rows: &[Row]) -> Vec<Vec<Panel>> {
    type Error = (&'static str, fn(&Row) -> Option<f64>);
    const ERRORS: [Error; 7] = [
        ("colour, of 255", |r| Some(r.errors.colour)),
        ("depth, px", |r| Some(r.errors.depth_px)),
        ("normal, degrees", |r| Some(r.errors.normal_deg)),
        ("hole pixels", |r| Some(r.errors.holes as f64)),
        ("bleeding pixels", |r| Some(r.errors.bleeding as f64)),
        ("swelling, px", |r| Some(r.errors.swell_px)),
        ("flicker of colour, of 255", |r| r.flicker.map(|f| f.colour)),
    ];
    let mut scenes: Vec<&str> = rows.iter().map(|r| r.scene).collect();
    scenes.dedup();
    let curve = |scene: &str, way: usize, of: fn(&Row) -> Option<f64>| {
        let own = |r: &&Row| r.scene == scene && r.way == way && r.kind == Kind::Poisson;
        rows.iter().filter(own).filter_map(|r| Some((r.density, of(r)?))).collect::<Vec<_>>()
    };
    let panel = |scene: &str, (error, of): Error| Panel {
        title: format!("{scene}: {error}"),
        curves: WAYS.iter().enumerate().map(|(i, w)| (w.0, curve(scene, i, of))).collect(),
        x: "points a pixel",
    };
    scenes.iter().map(|scene| ERRORS.iter().map(|&e| panel(scene, e)).collect()).collect()
}

/// Writes the shares of pixels that show the farther one of two walls, over the ratio of gap and
/// radius, as drawn and with the published intervals.
fn bleeding(out: &std::path::Path) -> Result<(), Box<dyn std::error::Error>> {
    const RATIOS: [f64; 8] = [0.25, 0.5, 0.75, 1.05, 1.5, 2.0, 3.0, 5.0];
    let (gap, mut rows, mut panels) = (0.01, Vec::new(), Vec::new());
    for spacing_px in [1.5, 5.0] {
        let mut line = Vec::new();
        for degrees in [0.0, 45.0, 70.0, 80.0, 85.0] {
            let mut curves: Vec<_> = WAYS.iter().map(|w| (w.0, Vec::new())).collect();
            for ratio in RATIOS {
                let radius = gap / ratio;
                let spacing = radius / 0.9;
                let view = walls_view(SIDE, degrees, f64::from(SIDE) * spacing / spacing_px);
                let truth = walls(gap, f64::from(SIDE) * spacing / spacing_px * 3.0);
                let image = Image::new(&truth, &view);
                let points = sample(&truth, spacing, Kind::Poisson, &mut Dice(5)).points;
                let cloud = Cloud::new(&points, spacing, radius);
                let inside =
                    (0..image.pixels.len()).filter(|&p| image.is_inside(p, 2)).count() as f64;
                let share = |d: &truth::measure::Drawn| 100.0 * d.bleeding(&image) as f64 / inside;
                let shares = WAYS.map(|(_, normals, published)| match published {
                    true => share(&cloud.draw_published(&view, normals)),
                    false => share(&cloud.draw(&view, normals)),
                });
                curves.iter_mut().zip(shares).for_each(|(c, share)| c.1.push((ratio, share)));
                let [with, bare, with_old, bare_old] = shares;
                rows.push(format!(
                    "{{\"spacing_px\":{spacing_px},\"degrees\":{degrees},\"ratio\":{ratio},\"normals\":{with:.4},\"bare\":{bare:.4},\"published_normals\":{with_old:.4},\"published_bare\":{bare_old:.4}}}"
                ));
                println!("{}", rows[rows.len() - 1]);
            }
            let title = format!("{spacing_px} px apart, {degrees} degrees: % of the pixels");
            line.push(Panel { title, curves, x: "gap over radius" });
        }
        panels.push(line);
    }
    std::fs::write(out.join("bleeding.json"), format!("[\n{}\n]\n", rows.join(",\n")))?;
    std::fs::write(out.join("bleeding.svg"), plots::grid(&panels))?;
    Ok(())
}
