//! Lights relative to the origin of a scene. In: [`Lights`] in world coordinates. Out: the sky, and
//! the lamps that are sampled.

use super::kinds::{Light, Lights};
use super::lamp::Lamp;
use super::sky::Sky;
use glam::{DVec3, Vec3};
use std::sync::Arc;

/// Lights relative to the origin of a scene, ready to be sampled.
#[derive(Clone, Debug, Default)]
pub struct PreparedLights {
    /// Shared by clones: an image of the sky may have a hundred megabytes.
    skies: Arc<Vec<Sky>>,
    lamps: Vec<Lamp>,
}

impl PartialEq for PreparedLights {
    fn eq(&self, other: &Self) -> bool {
        let has_same_skies = Arc::ptr_eq(&self.skies, &other.skies) || self.skies == other.skies;
        has_same_skies && self.lamps == other.lamps
    }
}

impl Lights {
    /// The lights relative to `origin`, world coordinates. Lights with values that are not finite
    /// are left out, negative colours count as zero.
    pub fn prepare(&self, origin: DVec3) -> PreparedLights {
        PreparedLights::of(self, origin)
    }
}

impl PreparedLights {
    fn of(lights: &Lights, origin: DVec3) -> Self {
        let (mut skies, mut lamps) = (Vec::new(), Vec::new());
        for light in &lights.lights {
            if let Light::Sky { sky } = light {
                skies.push(clean(sky));
            } else if let Some(lamp) = lamp(light, origin) {
                lamps.push(lamp);
            }
        }
        Self { skies: skies.into(), lamps }
    }

    /// Radiance of the sky in a direction of unit length.
    pub fn sky(&self, direction: Vec3) -> Vec3 {
        self.skies.iter().map(|sky| sky.radiance(direction)).sum()
    }

    /// Whether there is any sky.
    pub fn has_sky(&self) -> bool {
        !self.skies.is_empty()
    }

    pub(crate) fn skies(&self) -> &[Sky] {
        &self.skies
    }

    pub(crate) fn lamps(&self) -> &[Lamp] {
        &self.lamps
    }

    /// Nearest area light on a ray: its distance and radiance.
    pub(crate) fn meet(&self, origin: Vec3, direction: Vec3) -> Option<(f32, Vec3)> {
        self.lamps
            .iter()
            .filter_map(|lamp| lamp.meet(origin, direction))
            .min_by(|a, b| a.0.total_cmp(&b.0))
    }
}

/// Colour without negative values; `None` if it is not finite or black.
fn colour(value: [f32; 3]) -> Option<Vec3> {
    let value = Vec3::from(value).max(Vec3::ZERO);
    (value.is_finite() && value != Vec3::ZERO).then_some(value)
}

fn clean(sky: &Sky) -> Sky {
    let clean = |value: &[f32; 3]| colour(*value).unwrap_or(Vec3::ZERO).to_array();
    match sky {
        Sky::Constant(value) => Sky::Constant(clean(value)),
        Sky::Gradient { zenith, horizon, ground } => {
            Sky::Gradient { zenith: clean(zenith), horizon: clean(horizon), ground: clean(ground) }
        }
        // Pixels are cleaned when they are looked up.
        Sky::Image(panorama) => Sky::Image(panorama.clone()),
    }
}

fn lamp(light: &Light, origin: DVec3) -> Option<Lamp> {
    let place = |position: &[f64; 3]| {
        let place = (DVec3::from(*position) - origin).as_vec3();
        place.is_finite().then_some(place)
    };
    match light {
        Light::Sun { azimuth_deg, elevation_deg, irradiance, angular_diameter_deg } => {
            let (sin, cos) = elevation_deg.to_radians().sin_cos();
            let (east, north) = azimuth_deg.to_radians().sin_cos();
            let direction = DVec3::new(east * cos, north * cos, sin).as_vec3().try_normalize()?;
            let (x, y) = direction.any_orthonormal_pair();
            // A disc wider than a half space has no tangent.
            let radius = (angular_diameter_deg * 0.5).clamp(0.0, 80.0);
            let tan_radius = radius.to_radians().tan() as f32;
            Some(Lamp::Sun { direction, x, y, tan_radius, irradiance: colour(*irradiance)? })
        }
        Light::Point { position, intensity } => {
            Some(Lamp::Point { position: place(position)?, intensity: colour(*intensity)? })
        }
        Light::Spot { position, direction, intensity, inner_angle_deg, outer_angle_deg } => {
            (outer_angle_deg.is_finite() && inner_angle_deg.is_finite()).then_some(())?;
            let outer = outer_angle_deg.clamp(0.0, 180.0);
            let inner = inner_angle_deg.clamp(0.0, outer);
            let cos = |angle: f64| angle.to_radians().cos() as f32;
            Some(Lamp::Spot {
                position: place(position)?,
                axis: DVec3::from(*direction).try_normalize()?.as_vec3(),
                intensity: colour(*intensity)?,
                cos_inner: cos(inner),
                cos_outer: cos(outer),
            })
        }
        Light::Area { corner, edges, radiance, two_sided } => {
            let edges = edges.map(|edge| DVec3::from(edge).as_vec3());
            let across = edges[0].cross(edges[1]);
            Some(Lamp::Area {
                corner: place(corner)?,
                edges,
                normal: across.try_normalize()?,
                area: across.length(),
                radiance: colour(*radiance)?,
                two_sided: *two_sided,
            })
        }
        Light::Sky { .. } => None,
    }
}
