//! Measures the size of the planes of a file with each codec, in bytes a point, and their cost, in
//! nanoseconds of CPU time a point: `cargo run --release --example planes -- FILE [POINTS]`. Files
//! are read by their exact points, so they may have any codec. CPU times are those of a thread,
//! which Linux reports.

#![allow(clippy::unwrap_used, reason = "a measurement fails by panicking")]

use esker_format::{
    Codec, EskerFile, Histograms, NodeStatistics, PageLayout, PagePoints, PlaneKind, Ranges,
    encode_page,
};
use esker_points::MultisetHash;
use std::collections::BTreeMap;
use std::hint::black_box;

/// Runs of one measurement; the fastest counts.
const RUNS: usize = 3;

/// CPU time of this thread.
fn cpu_ns() -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap();
    text.split(' ').next().unwrap().parse().unwrap()
}

struct Nodes<'a> {
    file: &'a EskerFile,
    of: Vec<(u32, PagePoints)>,
    points: f64,
}

impl Nodes<'_> {
    /// Cost of `step`, nanoseconds a point.
    fn cost(&self, mut step: impl FnMut(u32, &PagePoints)) -> f64 {
        let run = |_| {
            let start = cpu_ns();
            self.of.iter().for_each(|(node, points)| step(*node, points));
            (cpu_ns() - start) / self.points
        };
        (0..RUNS).map(run).fold(f64::INFINITY, f64::min)
    }

    fn name(&self, kind: PlaneKind) -> String {
        match kind {
            PlaneKind::Attribute(a) => {
                self.file.layout().schema().attributes[usize::from(a)].name.clone()
            }
            kind => format!("{kind:?}").to_lowercase(),
        }
    }
}

fn main() {
    let mut arguments = std::env::args().skip(1);
    let path = arguments.next().expect("FILE [POINTS]");
    let points_max = arguments.next().map_or(u64::MAX, |n| n.parse().unwrap());
    let file = EskerFile::open(path.as_ref()).unwrap();
    // Nodes from all over the file.
    let step = (file.footer().points / points_max.max(1)).max(1) as usize;
    let of: Vec<_> = (0..file.table().nodes.len() as u32)
        .step_by(step)
        .map(|node| (node, file.read_page(node).unwrap().points().unwrap()))
        .collect();
    let points = of.iter().map(|(_, p)| p.len()).sum::<usize>() as f64;
    let nodes = Nodes { file: &file, of, points };
    println!("{path}: {points} points");
    measure_statistics(&nodes);
    let codecs = [Codec::None, Codec::Fast, Codec::Small].map(|codec| measure_codec(&nodes, codec));
    println!("{:20} {:>8} {:>8} {:>8}", "bytes a point", "none", "fast", "small");
    for plane in codecs[0].keys() {
        let [none, fast, small] = [0, 1, 2].map(|i| codecs[i][plane]);
        println!("{plane:20} {none:8.3} {fast:8.3} {small:8.3}");
    }
}

fn measure_statistics(nodes: &Nodes<'_>) {
    let layout = nodes.file.layout();
    let stored = nodes.file.statistics().unwrap();
    let mut histograms = Histograms::new(stored.histograms().ranges().clone());
    let mut ranges = Ranges::new(layout.schema());
    let mut hash = MultisetHash::default();
    let costs = [
        ("statistics", nodes.cost(|_, p| drop(black_box(NodeStatistics::of(layout, p))))),
        ("histograms", nodes.cost(|_, p| histograms.add(layout, p))),
        ("ranges", nodes.cost(|_, p| ranges.add(layout, p))),
        ("hash", nodes.cost(|_, p| hash += p.hash(layout))),
    ];
    costs.iter().for_each(|(what, ns)| println!("{what:20} {ns:8.2} ns a point"));
}

/// Bytes a point of each plane, and of all pages.
fn measure_codec(nodes: &Nodes<'_>, codec: Codec) -> BTreeMap<String, f64> {
    let stored = nodes.file.layout();
    let mut layout: PageLayout = stored.clone();
    layout = layout.with_codec(codec);
    let mut bytes: BTreeMap<String, f64> = BTreeMap::new();
    let encode = |node: u32, points: &PagePoints| {
        let record = nodes.file.node(node).unwrap();
        encode_page(&layout, record.box_min, record.hot_shift, points)
    };
    let encoding = nodes.cost(|node, points| drop(black_box(encode(node, points))));
    let page = |(node, points): &(u32, PagePoints)| {
        nodes.file.page_of(*node, encode(*node, points)).unwrap()
    };
    let pages: Vec<_> = nodes.of.iter().map(page).collect();
    for page in &pages {
        for (plane, entry) in layout.planes().iter().zip(&page.directory().entries) {
            *bytes.entry(nodes.name(plane.kind)).or_default() += f64::from(entry.bytes);
        }
        *bytes.entry("~ whole page".into()).or_default() += page.bytes().len() as f64;
    }
    let start = cpu_ns();
    for page in &pages {
        let cold = layout.planes().iter().filter(|plane| !plane.hot);
        cold.for_each(|plane| drop(black_box(page.plane(plane.kind).unwrap())));
    }
    let decoding = (cpu_ns() - start) / nodes.points;
    let name = codec.name();
    println!("{name:8} encode page {encoding:8.2}, decode cold planes {decoding:8.2} ns a point");
    bytes.values_mut().for_each(|b| *b /= nodes.points);
    bytes
}
