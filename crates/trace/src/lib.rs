//! Path tracing of scans and meshes, with indirect light filtered by the guided image filter
//! (`bauszat2011`). Scans are discs, as EWA splatting draws them ([`esker_render::splats`]). This
//! crate is optional: programs built without the feature `light` contain none of it.
//!
//! A frame: rays through pixel centres make the guides, indirect light is estimated where they
//! hit, filtered, and looked up by the other rays of the pixel, which add direct light.

pub mod accel;
pub mod camera;
pub mod filter;
pub mod gpu;
pub mod image;
pub mod light;
pub mod paths;
pub mod ray;
pub mod scene;
pub mod tracer;

pub use camera::Camera;
pub use image::Image;
pub use light::{Light, Lights, PreparedLights, Sky};
pub use paths::{Gloss, LitImage, Options, Sequence, Stats, Surfaces};
pub use ray::{Hit, Ray};
pub use scene::Scene;
pub use tracer::Tracer;
