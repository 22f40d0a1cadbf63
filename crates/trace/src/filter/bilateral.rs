//! Cross-bilateral filter (`petschnigg2004`, `eisemann2004`): the mean over a disc, with weights
//! that fall with the distance of pixels and the difference of their guides. The cost grows with
//! the square of the radius.

use super::input::Input;
use super::taps::{Neighbours, Padded, Tap, slopes};
use super::{GuideKind, Settings};

/// Filters signals, which are zero where a pixel is left out; the last one may ask for the gain
/// ([`Neighbours`]). `kinds` are those of the guides, of which depth is the last normal-free one.
pub(crate) fn bilateral<const N: usize, const GAIN: bool>(
    input: &Input<'_>,
    signals: [&[f32]; N],
    kinds: &[GuideKind],
    radius: usize,
    settings: &Settings,
) -> [Vec<f32>; N] {
    // Half the radius: the border of the disc has a weight of 0.14.
    let sigma = (radius as f32 * 0.5).max(0.5);
    let reach = radius as isize;
    let fall = |d: isize| (-0.5 * (d as f32 / sigma).powi(2)).exp();
    let tap = |y: isize, x: isize| Tap { x, y, weight: fall(x) * fall(y) };
    let square = (-reach..=reach).flat_map(|y| (-reach..=reach).map(move |x| tap(y, x)));
    let taps: Vec<Tap> =
        square.filter(|&Tap { x, y, .. }| x * x + y * y <= reach * reach).collect();
    let guides = Scaled::new(input, kinds, radius, settings);
    let signals = signals.map(|plane| guides.padded.plane(plane, 1.0));
    let signals = signals.each_ref().map(Vec::as_slice);
    let means = guides.neighbours::<N, GAIN>(signals, &[]).means(&taps);
    means.map(|plane| guides.padded.inner(&plane))
}

/// Guides over their standard deviations, depth last.
pub(crate) struct Scaled {
    pub padded: Padded,
    planes: Vec<Vec<f32>>,
    slopes: Option<[Vec<f32>; 2]>,
    mask: Vec<f32>,
}

impl Scaled {
    /// Scales the guides of a picture, for neighbours at most `reach` away.
    pub fn new(input: &Input<'_>, kinds: &[GuideKind], reach: usize, settings: &Settings) -> Self {
        let padded = Padded::new(input.width, reach.next_multiple_of(8));
        // exp(-d^2 / (2 sigma^2)), and infinite for no weight at all.
        let scale = |kind: GuideKind| {
            let sigma = match kind {
                GuideKind::Normal => settings.sigma_normal,
                GuideKind::Depth | GuideKind::Occlusion => settings.sigma_depth,
            };
            std::f32::consts::FRAC_1_SQRT_2 / sigma.max(1e-6)
        };
        let depth = kinds.iter().position(|&kind| kind == GuideKind::Depth);
        let mut order: Vec<usize> = (0..kinds.len()).filter(|&k| Some(k) != depth).collect();
        order.extend(depth);
        let planes =
            order.iter().map(|&k| padded.plane(&input.guides[k], scale(kinds[k]))).collect();
        let slopes = depth.map(|k| {
            let scale = scale(GuideKind::Depth);
            slopes(input, &input.guides[k]).map(|plane| padded.plane(&plane, scale))
        });
        let mask = padded.plane(&input.mask, 1.0);
        Self { padded, planes, slopes, mask }
    }

    /// Neighbours by these guides and `more`, which come first.
    pub fn neighbours<'a, const N: usize, const GAIN: bool>(
        &'a self,
        signals: [&'a [f32]; N],
        more: &'a [Vec<f32>],
    ) -> Neighbours<'a, N, GAIN> {
        let guides = more.iter().chain(&self.planes).map(Vec::as_slice).collect();
        let slopes = self.slopes.as_ref().map(|[right, down]| [&right[..], &down[..]]);
        Neighbours { padded: &self.padded, guides, slopes, mask: &self.mask, signals }
    }
}
