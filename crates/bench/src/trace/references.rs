//! References: two independent pictures of many samples along the Z-order, kept as files (PFM, one
//! 32-bit float a channel) named by the content that they depend on, since they take minutes.

use super::error::Reference;
use super::estimate::{Effort, Estimate};
use super::scene::TraceScene;
use anyhow::{Context, Result, ensure};
use esker_points::Task;
use esker_trace::filter::{FilterKind, Settings};
use esker_trace::{Gloss, Image, Sequence};
use std::fs::File;
use std::io::{BufRead, BufReader, BufWriter, Read, Write};
use std::path::{Path, PathBuf};

/// Raised when the tracer's mean changes, so that older files are not used.
const VERSION: u32 = 3;
/// Seeds of both halves; pictures that are judged have others.
const SEEDS: [u64; 2] = [0x5eed_000a, 0x5eed_000b];
/// Names of the files of a reference.
const PARTS: [&str; 3] = ["a", "b", "lit"];

/// Where references are kept, and how they are made.
#[derive(Clone, Debug)]
pub(super) struct Store {
    /// The folder; it is made if it is missing.
    pub folder: PathBuf,
    /// Samples of each half.
    pub samples: u32,
    /// Whether files that are there are made again.
    pub rebuilds: bool,
}

impl Store {
    /// The reference of a scene at a number of bounces, matte or glossy: read, or made and written.
    ///
    /// # Errors
    /// If files cannot be read or written, are damaged, or `task` is cancelled.
    pub fn reference(
        &self,
        scene: &TraceScene,
        bounces: u32,
        gloss: Option<Gloss>,
        task: &dyn Task,
    ) -> Result<Reference> {
        let efforts = SEEDS.map(|seed| Effort {
            bounces,
            samples: self.samples,
            sequence: Sequence::ZOrder,
            seed,
            gloss,
        });
        let content = scene.content.add(&efforts).add(&VERSION).name();
        let paths =
            PARTS.map(|part| self.folder.join(format!("{}-{content}-{part}.pfm", scene.name)));
        let size = [scene.camera.width, scene.camera.height];
        // Where surfaces are is cheap to trace, and is not kept.
        let first = Effort { samples: 1, ..efforts[0] };
        if !self.rebuilds && paths.iter().all(|path| path.is_file()) {
            let [a, b, lit] = paths.map(|path| read(&path, size));
            let is_hit = Estimate::new(scene, Effort { bounces: 0, ..first }, task)?.guides.is_hit;
            return Ok(Reference { halves: [a?, b?], lit: lit?, is_hit });
        }
        let half = |effort: Effort| {
            let samples = effort.samples;
            task.phase(&format!("reference of {}, {samples} samples", scene.name), None, "rays");
            Estimate::new(scene, effort, task)
        };
        let [mut a, b] = [half(efforts[0])?, half(efforts[1])?];
        let lit = a.lit(Settings::of(FilterKind::None)).0.radiance;
        std::fs::create_dir_all(&self.folder)
            .with_context(|| format!("{}: cannot make the folder", self.folder.display()))?;
        for (path, image) in paths.iter().zip([&a.incident, &b.incident, &lit]) {
            write(image, path)?;
        }
        Ok(Reference { halves: [a.incident, b.incident], lit, is_hit: a.guides.is_hit })
    }
}

/// Writes an image as PFM, the bottom row first; a temporary name beside it is renamed at the end.
fn write(image: &Image<3>, path: &Path) -> Result<()> {
    let context = || format!("{}: cannot write the reference", path.display());
    let folder = path.parent().unwrap_or(Path::new("."));
    let mut file = tempfile::NamedTempFile::new_in(folder).with_context(context)?;
    {
        let mut out = BufWriter::new(file.as_file_mut());
        // A negative scale stands for little-endian values.
        write!(out, "PF\n{} {}\n-1.0\n", image.width, image.height).with_context(context)?;
        for y in (0..image.height).rev() {
            for x in 0..image.width {
                for value in image.at(x, y) {
                    out.write_all(&value.to_le_bytes()).with_context(context)?;
                }
            }
        }
        out.flush().with_context(context)?;
    }
    file.persist(path).map(drop).map_err(|e| e.error).with_context(context)
}

/// Reads a PFM of this size.
fn read(path: &Path, [width, height]: [usize; 2]) -> Result<Image<3>> {
    let context = || format!("{}: cannot read the reference", path.display());
    let mut file = BufReader::new(File::open(path).with_context(context)?);
    let mut head = Vec::new();
    for _ in 0..3 {
        file.by_ref().take(64).read_until(b'\n', &mut head).with_context(context)?;
    }
    let remedy = || format!("{}: is no sound reference; run with --rebuild", path.display());
    ensure!(head == format!("PF\n{width} {height}\n-1.0\n").as_bytes(), remedy());
    let mut image = Image::new(width, height);
    for y in (0..height).rev() {
        for x in 0..width {
            for plane in &mut image.planes {
                let mut bytes = [0; 4];
                file.read_exact(&mut bytes).with_context(remedy)?;
                plane[y * width + x] = f32::from_le_bytes(bytes);
            }
        }
    }
    ensure!(file.fill_buf().with_context(context)?.is_empty(), remedy());
    Ok(image)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reference_comes_back_and_a_damaged_one_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.pfm");
        let mut image = Image::new(3, 2);
        for (c, plane) in image.planes.iter_mut().enumerate() {
            plane.iter_mut().enumerate().for_each(|(i, v)| *v = (10 * c + i) as f32 * 0.1);
        }
        write(&image, &path).unwrap();
        assert_eq!(read(&path, [3, 2]).unwrap(), image);
        let fault = |size| read(&path, size).unwrap_err().to_string();
        assert!(fault([2, 3]).contains("run with --rebuild"));
        let bytes = 3 * 2 * 12 + 12;
        assert_eq!(path.metadata().unwrap().len(), bytes);
        for length in [bytes - 1, 5, 0] {
            File::options().write(true).open(&path).unwrap().set_len(length).unwrap();
            assert!(fault([3, 2]).contains("run with --rebuild"), "{length}");
        }
    }
}
