//! Estimates the normals of a scan from neighbours and from cells, and prints the CPU time a point
//! and, if the scan has normals, the angles to them: `normals FILE [threads] [points]`.

use esker_builder::attributes::blocks::{self, Blocks};
use esker_builder::attributes::density::{Density, Distances};
use esker_builder::attributes::normals::{Bounds, UNKNOWN, estimate};
use esker_points::lattice::Lattice;
use esker_points::morton;
use esker_points::quant::oct_decode;
use esker_points::task::Silent;
use std::path::Path;

/// CPU time of the process in user space, in seconds, to a hundredth (Linux).
fn cpu_seconds() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    stat.split(' ').nth(13).and_then(|t| t.parse().ok()).unwrap_or(0.0) / 100.0
}

type Outcome = Result<(), Box<dyn std::error::Error + Send + Sync>>;

fn main() -> Outcome {
    let mut args = std::env::args().skip(1);
    let path = args.next().ok_or("usage: normals FILE [threads] [points]")?;
    let threads = args.next().map_or(Ok(0), |t| t.parse())?;
    let points_max = args.next().map_or(Ok(usize::MAX), |t| t.parse())?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
    pool.install(|| run(Path::new(&path), points_max))
}

fn run(path: &Path, points_max: usize) -> Outcome {
    let source = esker_scan::open(path, &Default::default(), &Silent)?;
    let lattice = Lattice::choose(std::slice::from_ref(&source.info().grid))?;
    let placement = lattice.placement(&source.info().grid);
    let xyz = source.info().schema.normals();
    let (mut points, mut given) = (Vec::new(), Vec::new());
    source.read(&placement, &Silent, &mut |batch| {
        if points.len() >= points_max {
            return Ok(());
        }
        points.extend_from_slice(&batch.positions);
        if let Some(xyz) = xyz {
            given.extend((0..batch.len()).map(|i| {
                xyz.map(|a| {
                    let b = &batch.columns[a][i * 4..][..4];
                    f32::from_le_bytes([b[0], b[1], b[2], b[3]])
                })
            }));
        }
        Ok(())
    })?;
    // In Morton order, like the rows of a chunk.
    let mut order: Vec<usize> = (0..points.len()).collect();
    order.sort_by_cached_key(|&i| morton::encode3(points[i]));
    let points: Vec<[u32; 3]> = order.iter().map(|&i| points[i]).collect();
    if !given.is_empty() {
        given = order.iter().map(|&i| given[i]).collect();
    }
    let spacing = Density::of(points.iter().copied(), 0).spacing();
    let distances = Distances { spacing, steps_max: f64::INFINITY };
    let bounds = Bounds::new(lattice.scale, &distances);
    let blocks = Blocks::new(lattice.scale, &distances);
    println!(
        "{} points, reach {}, coarsest cells of {:?}",
        points.len(),
        bounds.reach,
        blocks.steps()
    );
    report("neighbours", &given, || estimate(&points, &[], &bounds));
    report("cells", &given, || blocks::estimate(&points, &[], &blocks));
    Ok(())
}

/// Prints what an estimate takes, and how far it is from the `given` normals.
fn report(name: &str, given: &[[f32; 3]], estimate: impl Fn() -> Vec<[i16; 2]>) {
    let start = cpu_seconds();
    let codes = estimate();
    let us = (cpu_seconds() - start) * 1e6 / codes.len() as f64;
    let unknown = codes.iter().filter(|&&c| c == UNKNOWN).count();
    let share = 100.0 * unknown as f64 / codes.len() as f64;
    println!("{name}: {us:.2} us of CPU time a point, {share:.3} % unknown");
    let mut angles: Vec<f32> = codes
        .iter()
        .zip(given)
        .filter_map(|(&code, n)| {
            let norm = n.iter().map(|c| c * c).sum::<f32>().sqrt();
            let ours = oct_decode(code);
            let cos = (0..3).map(|i| ours[i] * n[i]).sum::<f32>() / norm;
            (code != UNKNOWN && cos.is_finite()).then(|| cos.abs().min(1.0).acos().to_degrees())
        })
        .collect();
    angles.sort_by(f32::total_cmp);
    if let Some(last) = angles.len().checked_sub(1) {
        let at = |share: f64| angles[(last as f64 * share) as usize];
        println!(
            "angles to the scan's normals: median {:.2}, 90 % {:.2}, 99 % {:.2} degrees",
            at(0.5),
            at(0.9),
            at(0.99)
        );
    }
}
