//! Plots the worst relative error of the conic of a projected splat in `f32` over its condition
//! number: `ewa_error OUT.svg`. Compares a million splats and views, extreme ones included, with
//! `f64`.
#![allow(clippy::print_stdout, reason = "a measurement")]

#[allow(dead_code, reason = "shared with tests, which use more of it")]
#[path = "../tests/ewa/exact.rs"]
mod exact;
#[allow(dead_code, reason = "shared with tests, which use more of it")]
#[path = "../tests/scene/mod.rs"]
mod scene;

use esker_render::ewa::splat::Placement;
use std::fmt::Write;

/// Bins a decade of the condition number, and number of decades.
const FINE: usize = 4;
const DECADES: usize = 6;
/// Pixels a decade of the condition number, and of the error.
const WIDE: usize = 90;
const HIGH: usize = 40;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let out = std::env::args().nth(1).ok_or("name the SVG file to write")?;
    let mut dice = scene::Dice(0x9e37_79b9);
    let mut worst = [0f64; FINE * DECADES];
    for _ in 0..1_000_000 {
        let (disc, lens) = exact::case(&mut dice);
        let Placement::Drawn(splat, _) = disc.place(&lens) else { continue };
        if splat.is_by_rays() {
            continue;
        }
        let m = disc.mapping(lens.focal_px);
        let bin = (f64::from(m.condition()).log10().max(0.0) * FINE as f64) as usize;
        if let (Some(error), Some(worst)) =
            (exact::coefficient_error(&disc, &lens), worst.get_mut(bin))
        {
            *worst = worst.max(error);
        }
    }
    let mut svg = String::new();
    let (width, height) = (DECADES * WIDE + 90, 8 * HIGH + 60);
    writeln!(
        svg,
        "<svg xmlns='http://www.w3.org/2000/svg' width='{width}' height='{height}' \
         font-family='sans-serif' font-size='12'><rect width='100%' height='100%' fill='white'/>"
    )?;
    for decade in 0..=DECADES {
        let x = 70 + decade * WIDE;
        writeln!(svg, "<path d='M{x} 10V{}' stroke='#ddd'/>", 10 + 8 * HIGH)?;
        writeln!(svg, "<text x='{}' y='{}'>1e{decade}</text>", x - 10, 28 + 8 * HIGH)?;
    }
    for decade in 0..=8 {
        let y = 10 + decade * HIGH;
        writeln!(svg, "<path d='M70 {y}H{}' stroke='#ddd'/>", 70 + DECADES * WIDE)?;
        writeln!(svg, "<text x='28' y='{}'>1e-{decade}</text>", y + 4)?;
    }
    for (bin, error) in worst.into_iter().enumerate().filter(|(_, error)| *error > 0.0) {
        println!("condition from {:8.1}: {error:.1e}", 10f64.powf(bin as f64 / FINE as f64));
        let x = 70.0 + (bin as f64 + 0.5) * (WIDE / FINE) as f64;
        let y = 10.0 - error.log10() * HIGH as f64;
        writeln!(svg, "<circle cx='{x:.1}' cy='{y:.1}' r='4' fill='#2a6'/>")?;
    }
    writeln!(
        svg,
        "<text x='170' y='{}'>condition number; worst relative error of the conic in f32</text></svg>",
        50 + 8 * HIGH
    )?;
    std::fs::write(&out, svg)?;
    Ok(())
}
