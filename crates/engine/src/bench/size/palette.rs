//! A palette trained on colours: boxes of the histogram are halved at their medians, the fullest and widest first
//! (Heckbert 1982), and then moved to the means of what is nearest to them (Lloyd).

/// Colours of a palette.
pub const COLOURS: usize = 256;
/// Bits of a channel in the histogram.
const BITS: u32 = 5;
/// Rounds of moving.
const ROUNDS: usize = 6;

/// A bin of the histogram: how many colours, and their sums.
#[derive(Clone, Copy, Default)]
struct Bin {
    count: u64,
    sums: [u64; 3],
}

impl Bin {
    fn mean(&self) -> [f32; 3] {
        self.sums.map(|sum| sum as f32 / self.count.max(1) as f32)
    }

    fn add(&mut self, other: &Self) {
        self.count += other.count;
        (0..3).for_each(|i| self.sums[i] += other.sums[i]);
    }
}

/// What a palette is trained on.
pub struct Histogram(Vec<Bin>);

impl Default for Histogram {
    fn default() -> Self {
        Self(vec![Bin::default(); 1 << (3 * BITS)])
    }
}

fn bin_of(rgb: [u8; 3]) -> usize {
    rgb.iter().fold(0, |bin, &c| bin << BITS | usize::from(c >> (8 - BITS)))
}

impl Histogram {
    /// Counts the colours of a plane of RGBA.
    pub fn add(&mut self, plane: &[u8]) {
        for rgba in plane.chunks_exact(4).filter(|rgba| rgba[3] != 0) {
            let rgb = [rgba[0], rgba[1], rgba[2]];
            self.0[bin_of(rgb)].add(&Bin { count: 1, sums: rgb.map(u64::from) });
        }
    }
}

/// At most [`COLOURS`] colours, and for each bin of the histogram the one that it is drawn in.
#[derive(Default)]
pub struct Palette {
    colours: Vec<[u8; 3]>,
    of_bin: Vec<u8>,
}

impl Palette {
    /// Trained on a histogram.
    pub fn trained(histogram: &Histogram) -> Self {
        let filled: Vec<Bin> = histogram.0.iter().filter(|bin| bin.count > 0).copied().collect();
        let mut colours: Vec<[f32; 3]> =
            boxes(filled.clone()).iter().map(|b| total(b).mean()).collect();
        for _ in 0..ROUNDS {
            let mut next = vec![Bin::default(); colours.len()];
            filled.iter().for_each(|bin| next[nearest(&colours, bin.mean())].add(bin));
            for (colour, bin) in colours.iter_mut().zip(&next).filter(|(_, bin)| bin.count > 0) {
                *colour = bin.mean();
            }
        }
        let of_bin = |(i, bin): (usize, &Bin)| {
            let channel = |shift: u32| ((i >> shift) as u8) << (8 - BITS) | 1 << (7 - BITS);
            let middle = [channel(2 * BITS), channel(BITS), channel(0)].map(f32::from);
            if colours.is_empty() {
                0
            } else {
                nearest(&colours, if bin.count > 0 { bin.mean() } else { middle }) as u8
            }
        };
        let of_bin = histogram.0.iter().enumerate().map(of_bin).collect();
        Self { colours: colours.iter().map(|c| c.map(|v| v.round() as u8)).collect(), of_bin }
    }

    /// The palette's colour for a colour: the one nearest to the mean of its bin.
    pub fn nearest(&self, rgb: [u8; 3]) -> [u8; 3] {
        let index = self.of_bin.get(bin_of(rgb)).copied().unwrap_or(0);
        self.colours.get(usize::from(index)).copied().unwrap_or(rgb)
    }
}

fn total(bins: &[Bin]) -> Bin {
    bins.iter().fold(Bin::default(), |mut sum, bin| {
        sum.add(bin);
        sum
    })
}

/// The channel in which bins differ most, and how much.
fn widest(bins: &[Bin]) -> (usize, f32) {
    let spread = |i: usize| {
        let values = bins.iter().map(|bin| bin.mean()[i]);
        values.clone().fold(0.0, f32::max) - values.fold(255.0, f32::min)
    };
    (0..3).map(|i| (i, spread(i))).max_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or((0, 0.0))
}

/// The filled bins in as many boxes as there may be colours.
fn boxes(filled: Vec<Bin>) -> Vec<Vec<Bin>> {
    let worth = |bins: &[Bin]| (total(bins).count as f32).sqrt() * widest(bins).1;
    let mut boxes = if filled.is_empty() { Vec::new() } else { vec![(worth(&filled), filled)] };
    while boxes.len() < COLOURS {
        let divisible = boxes.iter().enumerate().filter(|(_, (_, bins))| bins.len() > 1);
        let Some((at, _)) = divisible.max_by(|a, b| a.1.0.total_cmp(&b.1.0)) else { break };
        let (_, mut bins) = boxes.swap_remove(at);
        let (channel, _) = widest(&bins);
        bins.sort_by(|a, b| a.mean()[channel].total_cmp(&b.mean()[channel]));
        let half = total(&bins).count / 2;
        let mut below = 0;
        let cut = bins
            .iter()
            .position(|bin| {
                below += bin.count;
                below > half
            })
            .unwrap_or(0);
        let upper = bins.split_off(cut.clamp(1, bins.len() - 1));
        boxes.extend([bins, upper].map(|bins| (worth(&bins), bins)));
    }
    boxes.into_iter().map(|(_, bins)| bins).collect()
}

fn nearest(colours: &[[f32; 3]], rgb: [f32; 3]) -> usize {
    let away = |c: &[f32; 3]| (0..3).map(|i| (c[i] - rgb[i]).powi(2)).sum::<f32>();
    let by_distance = |a: &(usize, f32), b: &(usize, f32)| a.1.total_cmp(&b.1);
    colours.iter().map(away).enumerate().min_by(by_distance).map_or(0, |(i, _)| i)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_colours_stay_as_they_are() {
        let colours = [[0u8, 0, 0], [255, 255, 255], [200, 30, 30], [30, 200, 40]];
        let plane: Vec<u8> = colours.iter().flat_map(|c| [c[0], c[1], c[2], 255]).collect();
        let mut histogram = Histogram::default();
        histogram.add(&plane);
        let palette = Palette::trained(&histogram);
        assert!(colours.iter().all(|&c| palette.nearest(c) == c));
    }

    #[test]
    fn many_colours_come_near() {
        let plane: Vec<u8> = (0..1u32 << 15)
            .flat_map(|i| [(i >> 7) as u8, (i >> 3) as u8, (i * 7) as u8, 255])
            .collect();
        let mut histogram = Histogram::default();
        histogram.add(&plane);
        let palette = Palette::trained(&histogram);
        let squares: f64 = plane
            .chunks_exact(4)
            .map(|c| {
                let near = palette.nearest([c[0], c[1], c[2]]);
                (0..3).map(|i| f64::from(c[i].abs_diff(near[i])).powi(2)).sum::<f64>()
            })
            .sum();
        // Colours in even boxes, 8 x 8 x 4 of them, are off by this (root of the mean square).
        let even = ((32f64.powi(2) * 2.0 + 64f64.powi(2)) / 12.0).sqrt();
        let off = (squares / (plane.len() / 4) as f64).sqrt();
        assert!(off < even, "{off} of {even}");
    }
}
