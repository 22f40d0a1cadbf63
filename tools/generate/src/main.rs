//! The command line: `esker-generate synthetic:terrain:1M:1 -o out.laz`, or
//! `esker-generate mesh:bust:545k -o out.ply`.

use anyhow::Result;
use clap::Parser;
use esker_points::task::Silent;
use std::path::PathBuf;
use std::time::Instant;

/// Writes a generated scan as LAS 1.4 or LAZ, point format 7, or a generated mesh as PLY.
#[derive(Parser)]
struct Args {
    /// synthetic:SCENE:POINTS[:SEED], or mesh:NAME[:TRIANGLES]
    scan: PathBuf,
    /// The file, .las, .laz, or .ply of a mesh; without it points are generated and dropped.
    #[arg(short, long)]
    out: Option<PathBuf>,
}

fn main() -> Result<()> {
    let args = Args::parse();
    let start = Instant::now();
    if let Some(mesh) = esker_generate::mesh(&args.scan)? {
        let (triangles, seconds) = (mesh.triangles.len(), start.elapsed().as_secs_f64());
        println!("{}: {triangles} triangles in {seconds:.2} s", args.scan.display());
        if let Some(out) = &args.out {
            let bytes = esker_generate::write_mesh(&mesh, out)?;
            println!("{}: {bytes} bytes", out.display());
        }
        return Ok(());
    }
    let source = esker_generate::open(&args.scan, &Silent)?;
    let points = source.info().points_hint;
    let start = Instant::now();
    let bytes = match &args.out {
        Some(out) => Some(esker_generate::write(source.as_ref(), out, &Silent)?),
        None => esker_generate::generate(source.as_ref(), &Silent).map(|_| None)?,
    };
    let seconds = start.elapsed().as_secs_f64();
    let rate = points as f64 / seconds / 1e6;
    println!("{}: {points} points in {seconds:.2} s, {rate:.1} Mpoints/s", args.scan.display());
    if let (Some(out), Some(bytes)) = (&args.out, bytes) {
        let each = bytes as f64 / points.max(1) as f64;
        println!("{}: {bytes} bytes, {each:.2} a point", out.display());
    }
    Ok(())
}
