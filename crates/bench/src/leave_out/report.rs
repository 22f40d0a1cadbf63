//! The report of the benchmark of leaving out, and its table for people.

use crate::leave_out::loaded::LoadedRow;
use crate::leave_out::passes::PassRow;
use crate::leave_out::pictures::{Difference, Verdict};
use crate::quantile::quantile;
use esker_engine::io::quantity::readable_bytes;
use esker_render::PassTimes;
use serde::Serialize;

/// Rows of all files and omissions.
#[derive(Clone, Debug, Serialize)]
pub struct LeaveOutReport {
    /// Name of the GPU.
    pub(super) adapter: Option<String>,
    /// Why the CPU alone is measured.
    pub(super) note: Option<String>,
    /// Threads of the CPU renderer.
    pub(super) threads: usize,
    /// Width of the requested picture, pixels.
    pub(super) width: u32,
    /// Height of the requested picture, pixels.
    pub(super) height: u32,
    /// A row for each file and omission.
    pub(super) rows: Vec<LeaveOutRow>,
    /// A row for each file, view and optional part of its frames.
    pub(super) passes: Vec<PassRow>,
    /// A row for each file and bare picture.
    pub(super) loaded: Vec<LoadedRow>,
    /// Whether the program was built with light.
    pub(super) has_light: bool,
}

/// A thing that is left out of pictures of a file.
#[derive(Clone, Debug, Serialize)]
pub(super) struct LeaveOutRow {
    pub file: String,
    pub left_out: &'static str,
    /// Whether the frames differ in plan, points or planes.
    pub applies: bool,
    /// Whether it was needed.
    pub verdict: Verdict,
    /// How the pictures of the CPU differ.
    #[serde(flatten)]
    pub difference: Difference,
    /// How the pictures of the GPU differ.
    pub gpu_difference: Option<Difference>,
    /// Whether the pictures must be equal, since the frames do not differ.
    pub is_promised: bool,
    /// Width of the picture, which may be smaller than the requested one, pixels.
    pub width: u32,
    /// Height of the picture, pixels.
    pub height: u32,
    /// Cost of a frame with it.
    pub with: FrameCost,
    /// Cost of a frame without it.
    pub without: FrameCost,
    /// Time on the CPU that is saved.
    pub cpu_saving: Option<Saving>,
    /// Time on the GPU that is saved.
    pub gpu_saving: Option<Saving>,
}

/// Time that is saved, as a share of the time with the thing: quartiles over pairs of frames that
/// were drawn one after the other.
#[derive(Clone, Copy, Debug, Serialize)]
pub(super) struct Saving {
    pub lower_quartile: f64,
    pub median: f64,
    pub upper_quartile: f64,
    /// Whether the quartiles have different signs, so that nothing was measured but noise.
    pub is_noise: bool,
}

impl Saving {
    /// Savings of the frames `without` over those `with`, in the order of drawing.
    pub fn of(with: &[PassTimes], without: &[PassTimes]) -> Option<Self> {
        let pairs = with.iter().zip(without);
        let saved: Vec<f64> = pairs.map(|(a, b)| 1.0 - b.total_ms / a.total_ms).collect();
        if saved.is_empty() {
            return None;
        }
        let [lower_quartile, median, upper_quartile] =
            [0.25, 0.5, 0.75].map(|share| quantile(&saved, share));
        let is_noise = lower_quartile <= 0.0 && upper_quartile >= 0.0;
        Some(Self { lower_quartile, median, upper_quartile, is_noise })
    }

    fn text(&self) -> String {
        let Self { lower_quartile, median, upper_quartile, is_noise } = *self;
        let [low, middle, high] = [lower_quartile, median, upper_quartile].map(|s| s * 100.0);
        let noise = if is_noise { ", below noise" } else { "" };
        format!(" saves {middle:.0} % ({low:.0} to {high:.0}{noise})")
    }
}

/// Cost of a frame.
#[derive(Clone, Debug, Serialize)]
pub(super) struct FrameCost {
    /// Bytes read from the file.
    pub bytes_read: u64,
    /// Bytes of planes in memory.
    pub bytes_resident: u64,
    pub points: u64,
    /// Median time on the CPU.
    pub cpu_ms: Option<f64>,
    /// Median time on the GPU.
    pub gpu_ms: Option<f64>,
}

impl LeaveOutReport {
    /// What was left out with the promise of an equal picture, and changes it.
    pub fn faults(&self) -> Vec<String> {
        let rows = self.rows.iter().filter(|row| row.verdict == Verdict::Fault && row.is_promised);
        let passes = self.passes.iter().filter(|row| row.verdict == Verdict::Fault);
        let rows = rows.map(|row| format!("{}: {}", row.file, row.left_out));
        let passes = passes.map(|row| format!("{}: {} of {}", row.file, row.part, row.view));
        let loaded = self.loaded.iter().filter(|row| row.verdict == Verdict::Fault);
        let loaded = loaded
            .map(|row| format!("{}: {} of {}", row.file, row.unneeded.join(", "), row.picture));
        rows.chain(passes).chain(loaded).collect()
    }
}

/// Writes the report for people.
pub fn text(report: &LeaveOutReport) -> String {
    let mut lines = Vec::new();
    let mut file = "";
    for row in &report.rows {
        if row.file != file {
            file = &row.file;
            lines.push(format!("{file}: with it and without"));
        }
        lines.push(line(row, report));
    }
    let mut view = ("", "");
    for row in &report.passes {
        if view != (&*row.file, row.view) {
            view = (&row.file, row.view);
            let PassRow { file, view, frame_cpu_ms, width, height, .. } = row;
            lines.push(format!("{file}: {view}, {width}x{height}, {frame_cpu_ms:.2} ms a frame"));
        }
        lines.push(pass_line(row));
    }
    lines.extend(report.loaded.iter().map(loaded_line));
    lines.extend(report.adapter.iter().map(|name| format!("gpu: {name}")));
    lines.join("\n")
}

fn line(row: &LeaveOutRow, report: &LeaveOutReport) -> String {
    let name = name_of(row, report);
    let LeaveOutRow { with, without, difference, verdict, .. } = row;
    if !row.applies && *verdict == Verdict::LeftOut {
        return format!("  {name:<50} not in this view: nothing is left out");
    }
    let differs = pictures(difference);
    let on_gpu = row
        .gpu_difference
        .as_ref()
        .map_or(String::new(), |difference| format!(", on the GPU {}", pictures(difference)));
    let bytes = |with: u64, without: u64| {
        format!("{:>10} {:>10}", readable_bytes(with), readable_bytes(without))
    };
    let ms = |with: Option<f64>, without: Option<f64>| match (with, without) {
        (Some(with), Some(without)) => format!("{with:>8.2} {without:>8.2} ms"),
        _ => String::new(),
    };
    let saving = |saving: Option<Saving>| saving.map_or(String::new(), |s| s.text());
    format!(
        "  {name:<50} read {}  resident {}  cpu {}{}{}{}{}",
        bytes(with.bytes_read, without.bytes_read),
        bytes(with.bytes_resident, without.bytes_resident),
        ms(with.cpu_ms, without.cpu_ms),
        saving(row.cpu_saving),
        if with.gpu_ms.is_none() { "" } else { "  gpu " },
        ms(with.gpu_ms, without.gpu_ms),
        saving(row.gpu_saving),
    ) + &format!("\n  {:<50} {differs}{on_gpu}: {}", "", verdict.text())
}

fn pass_line(row: &PassRow) -> String {
    let PassRow { part, runs, cpu_ms, gpu_ms, difference, verdict, .. } = row;
    let takes = if *runs { "takes" } else { "would take" };
    let on_gpu = gpu_ms.map_or(String::new(), |ms| format!(", gpu {ms:.2} ms"));
    let (differs, verdict) = (pictures(difference), verdict.text());
    format!("  {part:<40} {takes} {cpu_ms:.2} ms{on_gpu}; {differs}: {verdict}")
}

fn loaded_line(row: &LoadedRow) -> String {
    let LoadedRow { file, picture, planes, shaders, built, unneeded, .. } = row;
    let planes: Vec<_> =
        planes.iter().map(|(name, bytes)| format!("{name} {}", readable_bytes(*bytes))).collect();
    let built = built.as_ref().map_or(String::new(), |all| format!(", {} built", all.len()));
    let excess = match &unneeded[..] {
        [] => "nothing that it does not need".to_owned(),
        all => format!("FAULT: also {}", all.join(", ")),
    };
    let (planes, shaders) = (planes.join(", "), shaders.len());
    format!("{file}: {picture} load {planes}; {shaders} shaders{built}: {excess}")
}

/// How two pictures differ, in words.
fn pictures(difference: &Difference) -> String {
    let Difference { changed_share, off_share, flip } = difference;
    if difference.is_equal() {
        return "pictures are equal".into();
    }
    let [changed, off] = [changed_share, off_share].map(|share| share * 100.0);
    format!("{changed:.2} % of the pixels change, {off:.2} % clearly, FLIP {flip:.4}")
}

/// Name of the omission, and the size of the picture if it is not the requested one.
fn name_of(row: &LeaveOutRow, report: &LeaveOutReport) -> String {
    let LeaveOutRow { left_out, width, height, .. } = *row;
    if (width, height) == (report.width, report.height) {
        left_out.into()
    } else {
        format!("{left_out} ({width}x{height})")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_must_not_change_a_picture_fails() {
        let cost = || FrameCost {
            bytes_read: 1,
            bytes_resident: 1,
            points: 1,
            cpu_ms: None,
            gpu_ms: None,
        };
        let row = |left_out, verdict, is_promised: bool| LeaveOutRow {
            file: "scan".into(),
            left_out,
            applies: !is_promised,
            verdict,
            difference: Difference { changed_share: 0.1, off_share: 0.0, flip: 0.1 },
            gpu_difference: None,
            is_promised,
            width: 8,
            height: 8,
            with: cost(),
            without: cost(),
            cpu_saving: None,
            gpu_saving: None,
        };
        let loaded = |picture, verdict, unneeded: &[&str]| LoadedRow {
            kind: "loaded",
            file: "scan".into(),
            picture,
            planes: std::collections::BTreeMap::new(),
            shaders: Vec::new(),
            built: None,
            unneeded: unneeded.iter().map(|&name| name.to_owned()).collect(),
            verdict,
        };
        let report = LeaveOutReport {
            adapter: None,
            note: None,
            threads: 1,
            width: 8,
            height: 8,
            rows: vec![
                row("a rule", Verdict::Fault, false),
                row("a promise", Verdict::Fault, true),
                row("a choice", Verdict::Needed, false),
            ],
            passes: Vec::new(),
            loaded: vec![
                loaded("points", Verdict::Fault, &["plane normal"]),
                loaded("surfaces", Verdict::LeftOut, &[]),
            ],
            has_light: false,
        };
        assert_eq!(report.faults(), ["scan: a promise", "scan: plane normal of points"]);
        let text = text(&report);
        assert_eq!(text.matches("FAULT").count(), 3, "{text}");
    }

    #[test]
    fn savings_whose_quartiles_differ_in_sign_are_noise() {
        let frames = |times: &[f64]| -> Vec<PassTimes> {
            times.iter().map(|&total_ms| PassTimes { total_ms, ..PassTimes::default() }).collect()
        };
        let with = frames(&[10.0, 10.0, 20.0, 10.0]);
        let half = Saving::of(&with, &frames(&[5.0, 4.0, 10.0, 6.0])).unwrap();
        assert_eq!((half.lower_quartile, half.median, half.upper_quartile), (0.4, 0.5, 0.5));
        assert!(!half.is_noise && half.text() == " saves 50 % (40 to 50)");
        let same = Saving::of(&with, &frames(&[9.0, 11.0, 21.0, 9.0])).unwrap();
        assert!(same.is_noise && same.text().ends_with("below noise)"), "{same:?}");
        assert!(Saving::of(&[], &[]).is_none());
    }
}
