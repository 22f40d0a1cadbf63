//! The sun of lit pictures as a window moves it: reads and changes its place in the settings.

use crate::light::lights::defaults;
use crate::light::settings::LightSettings;
use esker_trace::Light;

/// Least and greatest height of a sun that is moved, degrees: a little below the horizon is night.
pub const ELEVATIONS_DEG: [f64; 2] = [-10.0, 90.0];

/// Azimuth and elevation of the first sun of the lights, degrees.
pub fn place(settings: &LightSettings) -> Option<[f64; 2]> {
    let lights = settings.lights.clone().unwrap_or_else(defaults);
    lights.lights.iter().find_map(|light| match light {
        Light::Sun { azimuth_deg, elevation_deg, .. } => Some([*azimuth_deg, *elevation_deg]),
        _ => None,
    })
}

/// Moves the first sun of the lights; does nothing without one. The azimuth is taken into 0 to 360
/// degrees, the elevation into [`ELEVATIONS_DEG`].
pub fn set_place(settings: &mut LightSettings, [azimuth, elevation]: [f64; 2]) {
    let lights = settings.lights.get_or_insert_with(defaults);
    for light in &mut lights.lights {
        if let Light::Sun { azimuth_deg, elevation_deg, .. } = light {
            *azimuth_deg = azimuth.rem_euclid(360.0);
            *elevation_deg = elevation.clamp(ELEVATIONS_DEG[0], ELEVATIONS_DEG[1]);
            return;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::lights::parse;

    #[test]
    fn the_first_sun_is_moved_within_its_range_and_other_lights_stay() {
        let mut settings = LightSettings::default();
        set_place(&mut settings, [370.0, 100.0]);
        assert_eq!(place(&settings), Some([10.0, 90.0]));
        let others =
            |settings: &LightSettings| settings.lights.clone().unwrap().lights[1..].to_vec();
        assert_eq!(others(&settings), defaults().lights[1..]);
        settings.lights = Some(parse("sky").unwrap());
        set_place(&mut settings, [1.0, 2.0]);
        assert_eq!((place(&settings), settings.lights), (None, Some(parse("sky").unwrap())));
    }
}
