//! Error of traced light against time: pictures of few samples, with and without the filter, are
//! compared with one of many samples, whose own noise is the floor. It shows other light than the
//! pictures of the other methods, so that these rows stand apart from theirs.

use crate::error_time::columns::COLUMNS;
use esker_engine::io::quantity::grouped;
use serde::Serialize;

#[cfg(feature = "light")]
pub(super) use tracing::measure;

/// A scan lit with one setting. Errors are means over seeds, against the same picture of many
/// samples.
#[derive(Clone, Debug, Serialize)]
pub(super) struct LitRow {
    pub file: String,
    /// Width and height of the picture, pixels.
    pub size: [u32; 2],
    /// Rays through a pixel.
    pub samples: u32,
    /// Filter of indirect light.
    pub filter: &'static str,
    /// Options on the command line.
    pub options: String,
    /// Splats that are traced.
    pub points: u64,
    /// Median time of building the tree, tracing and filtering, milliseconds.
    pub ms: f64,
    /// Median CPU time of the same, over all threads.
    pub cpu_ms: Option<f64>,
    /// Mean of FLIP, 0 to 1, and the least and greatest of the seeds.
    pub flip: f64,
    pub flip_range: [f64; 2],
    /// Share of the pixels of which a channel is off by more than 8 of 255.
    pub off_share: f64,
    /// Samples a pixel of the reference.
    pub reference_samples: u32,
    /// Errors of a picture of other samples that are as many: smaller errors mean nothing.
    pub floor_flip: f64,
    pub floor_off_share: f64,
}

impl LitRow {
    /// Its cells in the columns of the other methods, empty where nothing is measured.
    pub fn cells(&self) -> [String; COLUMNS.len()] {
        let mut cells = [const { String::new() }; COLUMNS.len()];
        let filter = if self.filter == "none" { "no" } else { self.filter };
        let own = [
            "lit".into(),
            format!("samples: {}, {filter} filter", self.samples),
            "cpu".into(),
            grouped(self.points),
            format!("{:.1}", self.ms),
            self.cpu_ms.map_or_else(String::new, |ms| format!("{ms:.1}")),
            format!("{:.4}", self.flip),
            String::new(),
            format!("{:.2}", self.off_share * 100.0),
        ];
        for (cell, value) in cells.iter_mut().zip(own) {
            *cell = value;
        }
        cells
    }
}

/// What the rows of a scan are compared with, in a sentence; none without rows.
pub(super) fn heading(rows: &[&LitRow]) -> Option<String> {
    let LitRow { size: [width, height], reference_samples, floor_flip, floor_off_share, .. } =
        rows.first()?;
    Some(format!(
        "traced light, {width}x{height} pixels; reference: {reference_samples} samples a pixel \
         without a filter, whose own noise is FLIP {floor_flip:.4}, {:.2} % of the pixels off",
        floor_off_share * 100.0
    ))
}

#[cfg(feature = "light")]
mod tracing {
    use super::LitRow;
    use crate::error_time::compare::{Errors, errors};
    use crate::error_time::perfect::Reference;
    use crate::quantile::quantile;
    use anyhow::Result;
    use esker_engine::Method;
    use esker_engine::draw::scene::{PictureRequest, PictureScene};
    use esker_engine::light::settings::{FilterName, LightSettings};
    use esker_engine::light::still;
    use esker_engine::machine::backend::{Backend, DrawWith};
    use esker_engine::machine::system;
    use esker_format::Forest;
    use esker_points::Task;
    use esker_render::Picture;
    use std::time::Instant;

    /// Samples a pixel that are tried, and filters.
    const SAMPLES: [u32; 3] = [1, 4, 16];
    const FILTERS: [FilterName; 2] = [FilterName::Nested, FilterName::None];
    /// Seeds of the pictures, and of the reference and the one it is compared with.
    const SEEDS: [u64; 3] = [1, 2, 3];
    const REFERENCE_SEEDS: [u64; 2] = [101, 102];
    /// Longest side of the picture, pixels, and samples of references: quickly and in full.
    const SIDE_MAX: [u32; 2] = [240, 960];
    const REFERENCE_SAMPLES: [u32; 2] = [128, 256];

    /// Measures the rows of a file, which is called `name`.
    ///
    /// # Errors
    /// If points cannot be read, or `task` is cancelled.
    pub(in crate::error_time) fn measure(
        name: &str,
        file: &Forest,
        base: &PictureRequest,
        is_full: bool,
        task: &dyn Task,
    ) -> Result<Vec<LitRow>> {
        task.phase(&format!("{name}: traced light"), None, "frames");
        let of_extent = usize::from(is_full);
        let longest = base.size[0].max(base.size[1]).max(1);
        let scale = (f64::from(SIDE_MAX[of_extent]) / f64::from(longest)).min(1.0);
        let size = base.size.map(|side| ((f64::from(side) * scale).round() as u32).max(1));
        let with = DrawWith { backend: Backend::Cpu, ..DrawWith::default() };
        let request = PictureRequest { size, method: Method::Lit, with, ..base.clone() };
        let scene = PictureScene::read(file, &request, task)?;
        let draw = |settings: &LightSettings| still::draw(file, &scene, settings, None, task);
        let samples = REFERENCE_SAMPLES[of_extent];
        let filter = FilterName::None;
        let [seed, other_seed] = REFERENCE_SEEDS;
        let (picture, of_reference, _) =
            draw(&LightSettings { samples, filter, seed, ..request.light.clone() })?;
        // All pictures have the exposure of the reference, so that none differs by its own.
        let light = LightSettings { exposure: Some(of_reference.exposure), ..request.light };
        let reference =
            Reference { width: picture.width as usize, rgba: picture.rgba, depth: picture.depth };
        let off = |picture: &Picture| errors(picture, &reference, scene.view.focal_px());
        let other = draw(&LightSettings { samples, filter, seed: other_seed, ..light.clone() })?;
        let floor = off(&other.0);
        let mut rows = Vec::new();
        for (samples, filter) in
            SAMPLES.into_iter().flat_map(|samples| FILTERS.map(|filter| (samples, filter)))
        {
            let (mut ms, mut cpu_ms, mut found) = (Vec::new(), Vec::new(), Vec::new());
            let mut points = 0;
            for seed in SEEDS {
                let (start, before) = (Instant::now(), system::cpu_ms());
                let (picture, report, _) =
                    draw(&LightSettings { samples, filter, seed, ..light.clone() })?;
                ms.push(start.elapsed().as_secs_f64() * 1e3);
                cpu_ms.extend(system::cpu_ms().zip(before).map(|(now, before)| now - before));
                found.push(off(&picture));
                points = report.splats as u64;
            }
            let of = |value: fn(&Errors) -> f64| -> Vec<f64> { found.iter().map(value).collect() };
            let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len().max(1) as f64;
            let flips = of(|errors| errors.flip);
            rows.push(LitRow {
                file: name.to_owned(),
                size,
                samples,
                filter: filter.name(),
                options: format!("--method lit --samples {samples} --filter {}", filter.name()),
                points,
                ms: quantile(&ms, 0.5),
                cpu_ms: (!cpu_ms.is_empty()).then(|| quantile(&cpu_ms, 0.5)),
                flip: mean(&flips),
                flip_range: [quantile(&flips, 0.0), quantile(&flips, 1.0)],
                off_share: mean(&of(|errors| errors.off_share)),
                reference_samples: REFERENCE_SAMPLES[of_extent],
                floor_flip: floor.flip,
                floor_off_share: floor.off_share,
            });
        }
        Ok(rows)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_that_do_not_apply_are_empty() {
        let row = LitRow {
            file: "a".into(),
            size: [240, 150],
            samples: 4,
            filter: "none",
            options: String::new(),
            points: 1234,
            ms: 5.0,
            cpu_ms: Some(9.0),
            flip: 0.05,
            flip_range: [0.04, 0.06],
            off_share: 0.125,
            reference_samples: 128,
            floor_flip: 0.01,
            floor_off_share: 0.02,
        };
        let cells = row.cells();
        assert_eq!(cells[1], "samples: 4, no filter");
        assert_eq!((&*cells[6], &*cells[8]), ("0.0500", "12.50"));
        let is_empty = |title: &str| {
            let at = COLUMNS.iter().position(|(own, _)| *own == title);
            at.is_some_and(|at| cells[at].is_empty())
        };
        assert!(["own", "holes %", "normal deg", "flicker"].into_iter().all(is_empty));
        assert!(heading(&[&row]).is_some_and(|text| text.contains("128 samples")));
        assert_eq!(heading(&[]), None);
    }
}
