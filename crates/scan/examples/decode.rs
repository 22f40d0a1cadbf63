//! Decodes a scan and prints points, seconds and Mpoints/s; for LAZ also those of the `laz` crate
//! alone for the same file, in the same run: `decode FILE [threads]`.

use esker_points::lattice::Lattice;
use esker_points::task::Silent;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::Path;
use std::time::Instant;

type Outcome = Result<(), Box<dyn std::error::Error + Send + Sync>>;

fn main() -> Outcome {
    let mut args = std::env::args().skip(1);
    let path = args.next().ok_or("usage: decode FILE [threads]")?;
    let threads = args.next().map_or(Ok(0), |t| t.parse())?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
    pool.install(|| {
        esker(Path::new(&path))?;
        laz_alone(Path::new(&path))
    })
}

fn show(name: &str, points: u64, start: Instant) {
    let seconds = start.elapsed().as_secs_f64();
    println!(
        "{name}: {points} points, {seconds:.3} s, {:.2} Mpoints/s",
        points as f64 / seconds / 1e6
    );
}

fn esker(path: &Path) -> Outcome {
    let start = Instant::now();
    let source = esker_scan::open(path, &Default::default(), &Silent)?;
    let lattice = Lattice::choose(std::slice::from_ref(&source.info().grid))?;
    let placement = lattice.placement(&source.info().grid);
    let mut batches = 0;
    let report = source.read(&placement, &Silent, &mut |_| {
        batches += 1;
        Ok(())
    })?;
    show("esker", report.points, start);
    println!("{:?}, {batches} batches", source.info().colour_depth);
    source.info().notes.iter().for_each(|note| println!("note: {note}"));
    Ok(())
}

/// Chunked LAZ through `laz`'s own parallel decompressor, a group of 200,000 points at a time.
fn laz_alone(path: &Path) -> Outcome {
    let mut file = BufReader::with_capacity(1 << 20, std::fs::File::open(path)?);
    let mut head = vec![0; 227];
    file.read_exact(&mut head)?;
    let at = |i: usize| u32::from_le_bytes([head[i], head[i + 1], head[i + 2], head[i + 3]]);
    if head[104] < 128 {
        return Ok(());
    }
    let mut vlrs = vec![0; at(96) as usize - 227];
    file.read_exact(&mut vlrs)?;
    let place = vlrs.windows(14).position(|w| w == b"laszip encoded").ok_or("no LASzip record")?;
    let vlr = laz::LazVlr::from_buffer(&vlrs[place + 52..])?;
    file.seek(SeekFrom::Start(at(96).into()))?;
    let start = Instant::now();
    let (points, bytes) = (u64::from(at(107)), vlr.items_size());
    let mut decoder = laz::ParLasZipDecompressor::new(file, vlr)?;
    let mut left = points;
    let mut records = Vec::new();
    while left > 0 {
        let run = left.min(200_000);
        records.resize((run * bytes) as usize, 0);
        decoder.decompress_many(&mut records)?;
        left -= run;
    }
    show("laz alone", points, start);
    Ok(())
}
