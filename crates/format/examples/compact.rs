//! Measures the error of a compact profile of hot planes against its size, on the points of a file:
//! positions of 10 or 8 bits an axis in the node's box (in the node's spacings), colours of 565
//! bits or in palettes of 256 (in CIE76 dE, of which 2.3 is just visible), normals on the
//! octahedron or in a codebook (in degrees). `cargo run --release --example compact -- FILE`.

#![allow(clippy::unwrap_used, reason = "a measurement fails by panicking")]

use esker_format::{EskerFile, PlaneKind};
use esker_points::quant::{oct_decode, oct_encode};

/// Errors, reported by mean, 99th percentile and maximum.
#[derive(Default)]
struct Errors(Vec<f32>);

impl Errors {
    fn report(mut self, what: &str, bits: &str) {
        if self.0.is_empty() {
            return;
        }
        self.0.sort_unstable_by(f32::total_cmp);
        let mean = self.0.iter().map(|&e| f64::from(e)).sum::<f64>() / self.0.len() as f64;
        let at = |share: f64| self.0[((self.0.len() - 1) as f64 * share) as usize];
        println!(
            "{what:34} {bits:>14} bits  mean {mean:8.4}  99 % {:8.4}  max {:8.4}",
            at(0.99),
            at(1.0)
        );
    }
}

fn length(v: [f64; 3]) -> f64 {
    v.iter().map(|c| c * c).sum::<f64>().sqrt()
}

fn main() {
    let path = std::env::args().nth(1).expect("FILE");
    let file = EskerFile::open(path.as_ref()).unwrap();
    println!("{path}: {} points", file.footer().points);
    positions(&file);
    colours(&file);
    normals();
}

fn positions(file: &EskerFile) {
    let scale = file.metadata().lattice.scale;
    let (mut ten, mut eight, mut small) = (Errors::default(), Errors::default(), Errors::default());
    for node in 0..file.table().nodes.len() as u32 {
        let record = file.node(node).unwrap();
        let points = file.read_page(node).unwrap().points().unwrap().positions;
        let extent = [0, 1, 2]
            .map(|axis| points.iter().map(|p| p[axis] - record.box_min[axis]).max().unwrap_or(0));
        let error = |p: &[u32; 3], bits: i32| {
            let steps = f64::from(2.0f32.powi(bits));
            let d = [0, 1, 2].map(|axis| {
                let at = f64::from(p[axis] - record.box_min[axis]);
                let step = (f64::from(extent[axis]) + 1.0) / steps;
                (at - ((at / step).floor() + 0.5) * step) * scale[axis]
            });
            (length(d) / f64::from(record.spacing)) as f32
        };
        ten.0.extend(points.iter().map(|p| error(p, 10)));
        eight.0.extend(points.iter().map(|p| error(p, 8)));
        if points.len() <= 4096 {
            small.0.extend(points.iter().map(|p| error(p, 8)));
        }
    }
    ten.report("position 10-10-10, in spacings", "30");
    eight.report("position 8-8-8, in spacings", "24");
    small.report("position 8-8-8, nodes to 4096", "24");
}

/// CIE L*a*b* of an sRGB colour under D65 (IEC 61966-2-1, CIE 15).
fn lab(rgb: [u8; 3]) -> [f64; 3] {
    let linear = rgb.map(|c| {
        let c = f64::from(c) / 255.0;
        if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
    });
    let row = |m: [f64; 3]| (0..3).map(|i| m[i] * linear[i]).sum::<f64>();
    let xyz = [
        row([0.4124, 0.3576, 0.1805]) / 0.9505,
        row([0.2126, 0.7152, 0.0722]),
        row([0.0193, 0.1192, 0.9505]) / 1.089,
    ];
    let [x, y, z] = xyz.map(|t| if t > 0.008856 { t.cbrt() } else { 7.787 * t + 16.0 / 116.0 });
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

fn colour_error(a: [u8; 3], b: [u8; 3]) -> f32 {
    let (a, b) = (lab(a), lab(b));
    length([0, 1, 2].map(|i| a[i] - b[i])) as f32
}

/// A palette of at most 256 colours by median cut (heckbert1982), with the mean of each box.
fn palette(colours: &[[u8; 3]]) -> Vec<[u8; 3]> {
    let mut boxes = vec![colours.to_vec()];
    while boxes.len() < 256 {
        let spread = |of: &[[u8; 3]]| {
            let range = |c: usize| {
                let values = || of.iter().map(|v| v[c]);
                values().max().unwrap_or(0) - values().min().unwrap_or(0)
            };
            (0..3).map(|c| (range(c), c)).max().unwrap_or((0, 0))
        };
        // The box with the greatest gain.
        let gain = |of: &Vec<[u8; 3]>| u64::from(spread(of).0) * of.len() as u64;
        let Some(widest) = (0..boxes.len()).max_by_key(|&i| gain(&boxes[i])) else { break };
        let (range, channel) = spread(&boxes[widest]);
        if range == 0 {
            break;
        }
        let mut low = boxes.swap_remove(widest);
        low.sort_unstable_by_key(|v| v[channel]);
        let mut cut = low.len() / 2;
        while cut > 0 && low[cut - 1][channel] == low[cut][channel] {
            cut -= 1;
        }
        if cut == 0 {
            cut = low.iter().position(|v| v[channel] != low[0][channel]).unwrap();
        }
        let high = low.split_off(cut);
        boxes.extend([low, high]);
    }
    let mean = |of: &Vec<[u8; 3]>| {
        [0, 1, 2].map(|c| {
            (of.iter().map(|v| u64::from(v[c])).sum::<u64>() / of.len().max(1) as u64) as u8
        })
    };
    boxes.iter().map(mean).collect()
}

fn nearest(palette: &[[u8; 3]], colour: [u8; 3]) -> [u8; 3] {
    let distance =
        |p: &&[u8; 3]| (0..3).map(|c| (i32::from(p[c]) - i32::from(colour[c])).pow(2)).sum::<i32>();
    palette.iter().min_by_key(distance).copied().unwrap_or_default()
}

fn colours(file: &EskerFile) {
    let mut of_nodes: Vec<Vec<[u8; 3]>> = Vec::new();
    for node in 0..file.table().nodes.len() as u32 {
        let planes = file.read_planes(node, &[PlaneKind::Colour]).unwrap();
        let Some(plane) = planes.get(PlaneKind::Colour) else { return };
        let colours = plane.chunks_exact(4).filter(|c| c[3] == 255);
        of_nodes.push(colours.map(|c| [c[0], c[1], c[2]]).collect());
    }
    let all: Vec<[u8; 3]> = of_nodes.iter().flatten().step_by(7).copied().collect();
    let trained = palette(&all);
    let (mut packed, mut global, mut local) =
        (Errors::default(), Errors::default(), Errors::default());
    let mut palettes = 0;
    for colours in &of_nodes {
        let own = palette(colours);
        palettes += own.len() * 24;
        for &colour in colours.iter().step_by(5) {
            let bits = |c: u8, bits: u32| {
                let max = (1u32 << bits) - 1;
                let q = (u32::from(c) * max + 127) / 255;
                ((q * 255 + max / 2) / max) as u8
            };
            let [r, g, b] = colour;
            packed.0.push(colour_error(colour, [bits(r, 5), bits(g, 6), bits(b, 5)]));
            global.0.push(colour_error(colour, nearest(&trained, colour)));
            local.0.push(colour_error(colour, nearest(&own, colour)));
        }
    }
    let points = of_nodes.iter().map(Vec::len).sum::<usize>().max(1);
    packed.report("colour 5-6-5, dE", "16");
    global.report("colour, one palette a file, dE", "8");
    let each = format!("{:.2}", 8.0 + palettes as f64 / points as f64);
    local.report("colour, one palette a node, dE", &each);
}

/// Unit vectors all over the sphere: the result does not depend on a file.
fn normals() {
    let golden = (1.0 + 5f64.sqrt()) / 2.0;
    let count = 200_000;
    let vectors = (0..count).map(|i| {
        let z = 1.0 - (2 * i + 1) as f64 / f64::from(count);
        let (r, turn) = ((1.0 - z * z).sqrt(), std::f64::consts::TAU * f64::from(i) / golden);
        [r * turn.cos(), r * turn.sin(), z].map(|c| c as f32)
    });
    let vectors: Vec<[f32; 3]> = vectors.collect();
    let degrees = |a: [f32; 3], b: [f32; 3]| {
        let dot = (0..3).map(|i| f64::from(a[i]) * f64::from(b[i])).sum::<f64>();
        dot.clamp(-1.0, 1.0).acos().to_degrees() as f32
    };
    for bits in [8u32, 7, 6, 5] {
        let steps = ((1 << (bits - 1)) - 1) as f32;
        let code = |n: [f32; 3]| {
            // The best of the four neighbouring codes: rounding each axis separately is not
            // optimal.
            let exact = oct_encode(n).map(|c| f32::from(c) / 32767.0 * steps);
            let corners = [[0.0, 0.0], [0.0, 1.0], [1.0, 0.0], [1.0, 1.0]].map(|add: [f32; 2]| {
                let at = |i: usize| ((exact[i].floor() + add[i]).clamp(-steps, steps)) / steps;
                oct_decode([0, 1].map(|i| (at(i) * 32767.0).round() as i16))
            });
            corners.into_iter().map(|c| degrees(n, c)).fold(f32::INFINITY, f32::min)
        };
        let errors = Errors(vectors.iter().map(|&n| code(n)).collect());
        errors.report("normal, octahedron, degrees", &(2 * bits).to_string());
    }
    for bits in [8u32, 10, 12] {
        let errors = Errors(
            vectors.iter().step_by(20).map(|&n| codebook_error(n, 1 << bits, golden)).collect(),
        );
        errors.report("normal, spiral codebook, degrees", &bits.to_string());
    }
}

/// Degrees to the nearest of `count` points of a golden spiral, which are spread almost evenly.
fn codebook_error(n: [f32; 3], count: i32, golden: f64) -> f32 {
    let best = (0..count).map(|i| {
        let z = 1.0 - f64::from(2 * i + 1) / f64::from(count);
        let (r, turn) = ((1.0 - z * z).sqrt(), std::f64::consts::TAU * f64::from(i) / golden);
        f64::from(n[0]) * r * turn.cos() + f64::from(n[1]) * r * turn.sin() + f64::from(n[2]) * z
    });
    best.fold(-1.0, f64::max).min(1.0).acos().to_degrees() as f32
}
