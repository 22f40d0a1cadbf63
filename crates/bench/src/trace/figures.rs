//! Writes the figures of `bauszat2011` for one scene: separation of light (2), guides of 1, 3 and 4
//! planes (5), close-ups of outliers (6), difference maps (7), and the filters side by side (8);
//! beyond the paper, error against samples, and what the filter blurs.

use super::error::Reference;
use super::estimate::Estimate;
use super::filters::{of_channels, shown};
use super::picture::{Tile, worst_area};
use super::plot;
use super::report::TraceRow;
use super::scene::TraceScene;
use anyhow::{Context, Result};
use esker_trace::Image;
use esker_trace::filter::{FilterKind, Settings, filter};
use std::path::{Path, PathBuf};

/// Side of a close-up in the picture, pixels, and its enlargement.
const CLOSE_PX: usize = 64;
const ZOOM: usize = 4;
/// Factor of differences, as light has a mean of 0.3.
const DIFFERENCE: f64 = 4.0;
/// Radius of the paper's filter in figures, pixels.
const RADIUS: usize = 24;

/// Where figures are written, and which were.
pub(super) struct Figures {
    folder: PathBuf,
    /// Files that were written.
    pub written: Vec<PathBuf>,
}

impl Figures {
    /// Begins figures in a folder, which is made if it is missing.
    ///
    /// # Errors
    /// If the folder cannot be made.
    pub fn new(folder: &Path) -> Result<Self> {
        std::fs::create_dir_all(folder)
            .with_context(|| format!("{}: cannot make the folder", folder.display()))?;
        Ok(Self { folder: folder.to_owned(), written: Vec::new() })
    }

    fn write(&mut self, figure: &str, scene: &TraceScene, tile: &Tile) -> Result<()> {
        self.write_named(&format!("{figure}-{}", scene.name), tile)
    }

    /// Writes a figure of this name.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn write_named(&mut self, name: &str, tile: &Tile) -> Result<()> {
        let path = self.folder.join(format!("{name}.png"));
        tile.write(&path)?;
        self.written.push(path);
        Ok(())
    }

    /// Incident light of the scene of limits, and the reference.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn limits(
        &mut self,
        scene: &TraceScene,
        images: &[Image<3>],
        reference: &Reference,
    ) -> Result<()> {
        let (scale, truth) = (reference.scale(), reference.image());
        let all = images.iter().chain([&truth]);
        let tiles: Vec<Tile> = all.map(|image| Tile::of_light(image, scale)).collect();
        self.write_named(&scene.name, &Tile::beside(&tiles))
    }

    /// Plots error against samples.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn convergence(&mut self, scene: &TraceScene, rows: &[TraceRow]) -> Result<()> {
        let path = self.folder.join(format!("convergence-{}.svg", scene.name));
        std::fs::write(&path, plot::convergence(rows))
            .with_context(|| format!("{}: cannot write the figure", path.display()))?;
        self.written.push(path);
        Ok(())
    }

    /// Writes the figures of a scene from a picture of few samples.
    ///
    /// # Errors
    /// If a file cannot be written.
    pub fn of_scene(
        &mut self,
        scene: &TraceScene,
        estimate: &mut Estimate,
        reference: &Reference,
    ) -> Result<()> {
        self.separation(scene, estimate, reference)?;
        self.channels(scene, estimate, reference)?;
        self.filters(scene, estimate, reference)
    }

    /// Figure 2: direct light, indirect light and both; above without, below with the filter. The
    /// last column of the rows ends with the reference.
    fn separation(
        &mut self,
        scene: &TraceScene,
        estimate: &mut Estimate,
        reference: &Reference,
    ) -> Result<()> {
        let scale = scale_of(&reference.lit);
        let reference = Tile::of_light(&reference.lit, scale);
        let rows = [FilterKind::None, FilterKind::Nested].map(|kind| {
            let (lit, _) = estimate.lit(Settings::of(kind));
            let parts = [&lit.direct, &lit.indirect, &lit.radiance];
            let tiles = parts.map(|part| Tile::of_light(part, scale));
            Tile::beside(&[&tiles[..], std::slice::from_ref(&reference)].concat())
        });
        self.write("figure-2", scene, &Tile::above(&rows))
    }

    /// Figure 5: the paper's filter with guides of 1, 3 and 4 planes, and the reference.
    fn channels(
        &mut self,
        scene: &TraceScene,
        estimate: &Estimate,
        reference: &Reference,
    ) -> Result<()> {
        let settings = Settings { radius: Some(RADIUS), ..Settings::of(FilterKind::Guided) };
        let samples = estimate.samples;
        let mut tiles: Vec<Tile> = [1, 3, 4]
            .map(|channels| {
                let guides = of_channels(&estimate.guides, channels);
                let filtered = filter(&estimate.incident, &guides, samples, &settings);
                Tile::of_light(&filtered, reference.scale())
            })
            .into();
        tiles.push(Tile::of_light(&reference.image(), reference.scale()));
        self.write("figure-5", scene, &Tile::beside(&tiles))
    }

    /// Figures 6, 7 and 8: close-ups where each baseline is worst, differences of the filters from
    /// the reference, and the filters side by side with the reference.
    fn filters(
        &mut self,
        scene: &TraceScene,
        estimate: &Estimate,
        reference: &Reference,
    ) -> Result<()> {
        let (scale, truth) = (reference.scale(), reference.image());
        let filtered: Vec<Image<3>> = shown()
            .iter()
            .map(|f| filter(&estimate.incident, &estimate.guides, estimate.samples, &f.settings))
            .collect();
        let tiles: Vec<Tile> =
            filtered.iter().chain([&truth]).map(|image| Tile::of_light(image, scale)).collect();
        self.write("figure-8", scene, &Tile::beside(&tiles))?;
        // The first is unfiltered.
        let differences: Vec<Tile> = filtered[1..]
            .iter()
            .map(|image| Tile::of_difference(image, &truth, scale * DIFFERENCE))
            .collect();
        self.write("figure-7", scene, &Tile::beside(&differences))?;
        let visible = masked(&truth, &reference.is_hit);
        let rows: Vec<Tile> = [1, 2]
            .map(|baseline| {
                let seen = masked(&filtered[baseline], &reference.is_hit);
                let area = worst_area(&seen, &visible, CLOSE_PX);
                let parts: Vec<Tile> = tiles.iter().map(|t| t.close_up(area, ZOOM)).collect();
                Tile::beside(&parts)
            })
            .into();
        self.write("figure-6", scene, &Tile::above(&rows))
    }
}

/// The image with zero where no surface is.
fn masked(image: &Image<3>, is_hit: &[bool]) -> Image<3> {
    let mut image = image.clone();
    for plane in &mut image.planes {
        plane.iter_mut().zip(is_hit).filter(|(_, hit)| !**hit).for_each(|(v, _)| *v = 0.0);
    }
    image
}

/// Factor by which the brightest 2 % of a lit picture are white.
fn scale_of(lit: &Image<3>) -> f64 {
    let mut values: Vec<f32> = lit.planes[1].iter().copied().filter(|v| *v > 0.0).collect();
    values.sort_by(f32::total_cmp);
    let bright = values.get(values.len() * 98 / 100).copied().unwrap_or(1.0);
    1.0 / f64::from(bright.max(f32::MIN_POSITIVE))
}
