//! A scene of the benchmark, ready to be traced, and what it is made of: surfaces, a camera and
//! lights. Its content names the references.

use super::content::Content;
use anyhow::{Context, Result};
use esker_lod::View;
use esker_trace::{Camera, Lights, PreparedLights, Scene};
use glam::DVec3;
use std::path::PathBuf;

/// A scene ready to be traced.
#[derive(Clone)]
pub(super) struct TraceScene {
    pub name: String,
    /// Whether it is a scan, of splats.
    pub is_scan: bool,
    pub scene: Scene,
    pub lights: PreparedLights,
    pub camera: Camera,
    /// Hash of surfaces, camera and lights.
    pub content: Content,
    /// Triangles or splats.
    pub surfaces: usize,
    /// Building of the tree, milliseconds.
    pub build_ms: f64,
}

/// Surfaces, camera and lights before the tree is built.
pub(super) struct Parts {
    pub view: View,
    pub lights: Lights,
    pub origin: DVec3,
    pub content: Content,
}

/// The folder of real scans.
pub(super) fn data() -> Result<PathBuf> {
    let folder = std::env::var_os("ESKER_DATA").map(PathBuf::from);
    folder.context("this scene needs a folder of real scans: set ESKER_DATA")
}

impl Parts {
    /// The scene of these parts.
    pub fn scene(self, name: &str, scene: Scene, surfaces: usize, build_ms: f64) -> TraceScene {
        let Self { view, lights, origin, content } = self;
        TraceScene {
            name: name.to_owned(),
            is_scan: true,
            scene,
            lights: lights.prepare(origin),
            camera: Camera::new(&view, origin),
            content: content.add(&view).add(&lights),
            surfaces,
            build_ms,
        }
    }
}
