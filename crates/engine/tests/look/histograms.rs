//! Histograms of what gives colours count the points of the file, sources that show nothing are not
//! offered, and requests name colour maps.

use super::{build, terrain};
use esker_engine::calls::info;
use esker_engine::cameras::colour::{choices, colouring, offered};
use esker_engine::cameras::histogram::histogram;
use esker_engine::cameras::vertical::Vertical;
use esker_engine::{Gradient, NormalsMode};
use esker_format::{Forest, PlaneKind};
use std::path::Path;

/// Greatest difference of a cumulative share from that of all points; a bin of the statistics has
/// 1/256 of the range.
const SHARE_OFF: f64 = 0.02;

/// Largest difference between the shares of `values` and of `counts` below the end of a bin.
fn off(values: &[f64], counts: &[f64], [low, high]: [f64; 2]) -> f64 {
    let width = (high - low) / counts.len() as f64;
    let mut below = values.iter().filter(|&&value| value < low).count() as f64;
    let off = (0..counts.len()).map(|bin| {
        let end = low + width * (bin + 1) as f64;
        below += counts[bin];
        let exact = values.iter().filter(|&&value| value < end).count() as f64;
        (below - exact).abs() / values.len() as f64
    });
    off.fold(0.0, f64::max)
}

#[test]
fn histograms_of_attributes_are_those_of_all_points() {
    let file = Forest::open(terrain()).unwrap();
    let mut tested = 0;
    for (index, attribute) in file.schema().attributes.iter().enumerate() {
        let kind = match attribute.name.as_str() {
            "intensity" => PlaneKind::Intensity,
            _ => PlaneKind::Attribute(index as u16),
        };
        let Ok(Some(known)) = histogram(&file, &attribute.name, Vertical::default()) else {
            continue;
        };
        let scale = match file.schema().shown_scale(index) {
            0.0 => 1.0,
            scale => scale,
        };
        let mut values = Vec::new();
        for node in 0..file.table().nodes.len() as u32 {
            let planes = file.read_planes(node, &[kind]).unwrap();
            let plane = planes.get(kind).unwrap().chunks_exact(attribute.ty.size());
            let stored = plane.map(|value| attribute.ty.to_f64(value));
            values.extend(stored.map(|stored| stored * scale + attribute.offset));
        }
        assert_eq!(values.len() as u64, file.points());
        let off = off(&values, &known.counts, known.range);
        assert!(off <= SHARE_OFF, "{}: {off} of the points", attribute.name);
        assert_eq!(known.sample, None, "{}: the file has statistics", attribute.name);
        tested += 1;
    }
    assert!(tested >= 3, "{tested}");
}

#[test]
fn heights_are_counted_over_a_sample_along_the_axis_of_elevations() {
    let file = Forest::open(terrain()).unwrap();
    let [low, high] = info::world_bounds(&file).unwrap();
    let up = histogram(&file, "elevation", Vertical::default()).unwrap().unwrap();
    assert!(up.sample.is_some_and(|points| points <= file.points()));
    assert!(up.range[0] >= low[2] - 1e-6 && up.range[1] <= high[2] + 1e-6, "{:?}", up.range);
    let down = Vertical::nearest(-glam::DVec3::Z);
    let down = histogram(&file, "elevation", down).unwrap().unwrap();
    assert!((down.range[0] + up.range[1]).abs() < 1e-9 && down.sample == up.sample);
    for none in ["rgb", "normal", "classification", "plain", "return_number"] {
        assert_eq!(histogram(&file, none, Vertical::default()).unwrap(), None, "{none}");
    }
}

#[test]
fn sources_that_are_zero_everywhere_are_not_offered() {
    let name = format!("{}-zeros.esker", env!("CARGO_CRATE_NAME"));
    let built = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    build(Path::new("../../tests/sample/creek.laz"), &built, NormalsMode::None);
    let file = Forest::open(&built).unwrap();
    let (all, offered) = (choices(&file), offered(&file).unwrap());
    assert!(offered.iter().all(|name| all.contains(name)));
    for name in &all {
        let colouring = colouring(&file, Some(name), info::bounds(&file)).unwrap();
        let is_zero = colouring.legend.note == Some("all values are zero");
        assert_eq!(offered.contains(name), !is_zero, "{name}");
    }
    assert!(offered.len() < all.len(), "the scan has attributes that are zero");
}

#[test]
fn requests_name_colour_maps() {
    let file = Forest::open(terrain()).unwrap();
    let legend = |text: &str| colouring(&file, Some(text), info::bounds(&file)).map(|c| c.legend);
    for (text, gradient, range) in [
        ("elevation:turbo", Gradient::Turbo, None),
        ("intensity:100..4000:Magma", Gradient::Magma, Some([100.0, 4000.0])),
        ("gps_time:cividis", Gradient::Cividis, None),
        ("depth:coolwarm", Gradient::CoolWarm, None),
    ] {
        let legend = legend(text).unwrap();
        assert_eq!(legend.gradient, Some(gradient), "{text}");
        assert!(range.is_none() || legend.range == range, "{text}");
        assert_eq!(legend.bar(3).len(), 3);
    }
    for (text, word) in [
        ("classification:turbo", "no colour map"),
        ("rgb:turbo", "no colour map"),
        ("elevation:rainbow", "viridis"),
    ] {
        let fault = legend(text).unwrap_err().to_string();
        assert!(fault.contains(word), "{text}: {fault}");
    }
}
