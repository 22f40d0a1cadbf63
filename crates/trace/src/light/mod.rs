//! Lights: what users state ([`Lights`]), and what is sampled ([`PreparedLights`], relative to the
//! origin of a scene; emitting surfaces of the scene).

mod emitter;
mod kinds;
mod lamp;
mod prepared;
mod sky;

pub(crate) use emitter::Emitters;
pub use kinds::{LIGHTS_VERSION, Light, Lights, SUN_DIAMETER_DEG};
pub(crate) use lamp::{Arrival, Lamp};
pub use prepared::PreparedLights;
pub use sky::{Panorama, PanoramaFile, Sky};
