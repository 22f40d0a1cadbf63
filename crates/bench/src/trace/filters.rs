//! The filters that are compared, with the same settings for all scenes.

use esker_trace::filter::{FilterKind, GuideKind, Guides, Settings};

/// A filter with its settings.
#[derive(Clone, Debug)]
pub(super) struct Filter {
    /// Name in reports.
    pub name: &'static str,
    /// Settings.
    pub settings: Settings,
}

/// Radii at which the paper's filter is measured, pixels; the paper takes 24 to 32, and its best
/// is compared with the extended filter.
const GUIDED_RADII: [usize; 4] = [8, 16, 24, 32];
/// Radii of the cross-bilateral filter, pixels, and passes of a-trous, as in table 2.
const BILATERAL_RADII: [usize; 3] = [16, 24, 32];
const ATROUS_PASSES: [usize; 3] = [4, 5, 6];
/// Standard deviation of colours for a-trous, in means of the picture.
const COLOUR: f32 = 1.0;
/// Standard deviations that the baselines are swept over: normals (half the unit of normals),
/// depth (diagonals of the scene), and colours of a-trous (means of the picture).
const SWEPT_NORMALS: [f32; 3] = [0.05, 0.1, 0.2];
const SWEPT_DEPTHS: [f32; 3] = [0.001, 0.003, 0.01];
const SWEPT_COLOURS: [f32; 3] = [0.3, 3.0, f32::INFINITY];

fn of(name: &'static str, kind: FilterKind, radius: Option<usize>) -> Filter {
    Filter { name, settings: Settings { radius, ..Settings::of(kind) } }
}

/// A-trous of some passes, with or without weights by colour.
fn atrous(iterations: usize, sigma_colour: f32) -> Filter {
    let name = if sigma_colour.is_finite() { "atrous-colour" } else { "atrous" };
    let settings = Settings { iterations, sigma_colour, ..Settings::of(FilterKind::Atrous) };
    Filter { name, settings }
}

/// The filters of figure 8, and those beyond it.
pub(super) fn compared() -> Vec<Filter> {
    let noise = Settings { is_noise_scaled: true, ..Settings::of(FilterKind::Guided) };
    let mut all = vec![of("none", FilterKind::None, None)];
    all.extend(BILATERAL_RADII.map(|r| of("bilateral", FilterKind::Bilateral, Some(r))));
    all.extend(ATROUS_PASSES.map(|passes| atrous(passes, f32::INFINITY)));
    all.extend(ATROUS_PASSES.map(|passes| atrous(passes, COLOUR)));
    all.extend(GUIDED_RADII.map(|radius| of("guided", FilterKind::Guided, Some(radius))));
    all.push(Filter { name: "guided-noise", settings: Settings { radius: Some(16), ..noise } });
    all.push(of("nested", FilterKind::Nested, None));
    all
}

/// The baselines with other weights than their own, so that it shows how much the choice of
/// weights costs them.
pub(super) fn swept() -> Vec<Filter> {
    let mut all = Vec::new();
    for sigma_normal in SWEPT_NORMALS {
        for sigma_depth in SWEPT_DEPTHS {
            let swept = |filter: Filter| Filter {
                settings: Settings { sigma_normal, sigma_depth, ..filter.settings },
                ..filter
            };
            all.push(swept(of("bilateral", FilterKind::Bilateral, Some(BILATERAL_RADII[0]))));
            for colour in SWEPT_COLOURS {
                all.extend([4, 5].map(|passes| swept(atrous(passes, colour))));
            }
        }
    }
    all
}

/// The filters whose pictures stand side by side in figure 8.
pub(super) fn shown() -> Vec<Filter> {
    vec![
        of("none", FilterKind::None, None),
        of("bilateral", FilterKind::Bilateral, Some(BILATERAL_RADII[0])),
        of("atrous", FilterKind::Atrous, None),
        of("guided", FilterKind::Guided, Some(24)),
        of("nested", FilterKind::Nested, None),
    ]
}

/// A row of table 2: a filter, and the planes of the guides that it gets.
pub(super) struct Timed {
    pub filter: Filter,
    /// Planes of the guides.
    pub channels: usize,
}

/// The settings of table 2, and those of the extended filter.
pub(super) fn timed() -> Vec<Timed> {
    let plain = |filter| Timed { filter, channels: 4 };
    let mut all: Vec<Timed> =
        BILATERAL_RADII.map(|r| plain(of("bilateral", FilterKind::Bilateral, Some(r)))).into();
    all.extend(ATROUS_PASSES.map(|passes| plain(atrous(passes, f32::INFINITY))));
    for channels in [1, 3, 4] {
        for radius in [8, 32] {
            let filter = of("guided", FilterKind::Guided, Some(radius));
            all.push(Timed { filter, channels });
        }
    }
    all.push(plain(of("nested", FilterKind::Nested, None)));
    all
}

/// Guides of one, three or four planes, as in figure 5: the mean of the normal's components, the
/// normal, or the normal and depth.
pub(super) fn of_channels(guides: &Guides, channels: usize) -> Guides {
    match channels {
        1 => {
            let normal = guides.only(&[GuideKind::Normal]);
            let grey = (0..guides.len())
                .map(|i| normal.planes.iter().map(|p| p[i]).sum::<f32>() / 3.0)
                .collect();
            Guides { planes: vec![grey], kinds: vec![GuideKind::Normal], ..normal }
        }
        3 => guides.only(&[GuideKind::Normal]),
        _ => guides.clone(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn guides_have_the_planes_of_figure_5() {
        let surface = Some((Vec3::new(0.0, 0.6, 0.8), 2.0));
        let guides = Guides::of_surfaces(2, 1, &[surface, None], 4.0);
        for (channels, kinds) in [(1, 1), (3, 3), (4, 4)] {
            let some = of_channels(&guides, channels);
            assert_eq!((some.planes.len(), some.kinds.len()), (kinds, kinds));
            assert_eq!(some.is_hit, guides.is_hit);
        }
        let grey = of_channels(&guides, 1).planes[0][0];
        assert!((grey - (0.5 + 0.8 + 0.9) / 3.0).abs() < 1e-6);
    }
}
