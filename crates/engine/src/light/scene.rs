//! The scene that is lit: the splats of a frame, relative to an origin near the eye, with the
//! meshes of the user and what shines of both. Bounds the number of splats.

use crate::light::document::{Emissive, Lights};
use crate::light::settings::LightSettings;
use crate::light::tone::srgb_to_linear;
use anyhow::Result;
use esker_points::Task;
use esker_render::{Codebook, ColourBy, Frame, Splat, splats};
use esker_scan::mesh::TriangleMesh;
use esker_trace::Scene;
use esker_trace::scene::{
    Albedo, Emitter, Members, Mesh, MeshTree, Object, SplatInput, adopt_normals,
};
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use std::path::PathBuf;
use std::sync::Arc;

/// A scene ready to be traced.
pub struct LitScene {
    /// What rays meet.
    pub scene: Scene,
    /// Splats of the frame, those that no ray can meet among them.
    pub splats: usize,
}

/// Splats with what a scene is to know of them.
pub(crate) struct GatheredSplats {
    pub(crate) splats: Vec<Splat>,
    /// Number of the entry by which each shines, where there is one.
    classes: Option<Vec<u8>>,
    emitters: Vec<Emitter>,
    albedo: Albedo,
    cull_back_faces: bool,
    /// Place in the world that positions are relative to.
    pub(crate) origin: DVec3,
}

/// Triangle meshes that stand in the scan, on its metric lattice.
#[derive(Default)]
pub struct Meshes(Vec<TriangleMesh>);

impl Meshes {
    /// Reads the meshes of the settings.
    ///
    /// # Errors
    /// If a file cannot be read, or holds no mesh.
    pub fn read(settings: &LightSettings, task: &dyn Task) -> Result<Self> {
        let read = |path: &PathBuf| -> Result<TriangleMesh> {
            let mut mesh = esker_scan::mesh::read(path, task)?;
            let factor = settings.factor;
            for place in &mut mesh.positions {
                *place = [0, 1, 2].map(|i| place[i] * factor[i]);
            }
            Ok(mesh)
        };
        Ok(Self(settings.meshes.iter().map(read).collect::<Result<_>>()?))
    }

    /// Notes on what was left out of the files.
    pub fn notes(&self) -> impl Iterator<Item = &str> {
        self.0.iter().flat_map(|mesh| mesh.notes.iter().map(String::as_str))
    }

    /// The meshes relative to an origin.
    pub(crate) fn objects(&self, origin: DVec3) -> Vec<Object> {
        self.0.iter().map(|mesh| object(mesh, origin)).collect()
    }

    /// Number of triangles.
    pub fn triangles(&self) -> usize {
        self.0.iter().map(|mesh| mesh.triangles.len()).sum()
    }
}

impl GatheredSplats {
    /// The splats of a frame, relative to `origin`. `classes` are the classes of the points of each
    /// draw, where lights choose points by them.
    pub(crate) fn of(
        frame: &Frame<'_>,
        lights: &Lights,
        classes: &[Option<&[u8]>],
        origin: DVec3,
    ) -> Self {
        let mut splats = splats(frame, origin);
        adopt_normals(&mut splats);
        let shining = &lights.emissive;
        let classes: Option<Vec<u8>> = (!shining.is_empty()).then(|| {
            let number = |splat: &Splat| number_of(shining, splat, classes, origin);
            splats.par_iter().map(number).collect()
        });
        let emitters = shining.iter().enumerate().filter_map(emitter).collect();
        let (albedo, cull_back_faces) = (albedo(frame.colour), frame.cull_back_faces);
        Self { splats, classes, emitters, albedo, cull_back_faces, origin }
    }

    /// The splats as a scene takes them.
    pub(crate) fn input(&self) -> SplatInput<'_> {
        SplatInput {
            splats: &self.splats,
            classes: self.classes.as_deref(),
            albedo: self.albedo,
            emitters: &self.emitters,
            cull_back_faces: self.cull_back_faces,
        }
    }
}

impl LitScene {
    /// The scene of a frame, on the CPU. `classes` are those of the points of each draw, where
    /// lights choose points by them.
    pub fn new(
        frame: &Frame<'_>,
        classes: &[Option<&[u8]>],
        meshes: &Meshes,
        lights: &Lights,
        origin: DVec3,
    ) -> Self {
        let splats = GatheredSplats::of(frame, lights, classes, origin);
        let scene = Scene::new(splats.input()).with_objects(meshes.objects(origin));
        Self { scene, splats: splats.splats.len() }
    }
}

/// Albedo for a source of colours. Colours of a scan are scaled, since they hold the light of the
/// day of the scan.
pub(crate) fn albedo(colour: ColourBy) -> Albedo {
    if colour == ColourBy::Plain { Albedo::Plain(PLAIN) } else { Albedo::Rgb }
}

/// Whether the albedo of a source of colours holds light.
pub(crate) fn holds_light(colour: ColourBy) -> bool {
    matches!(colour, ColourBy::Rgb | ColourBy::Codes(Codebook::Own(_)))
}

/// Albedo of scans in one colour: that of concrete.
const PLAIN: [f32; 3] = [0.55; 3];

/// What shines as entry `index` of the points that shine: points are numbered by it, from 1, since
/// an entry may choose them by class and by box at once.
fn emitter((index, emissive): (usize, &Emissive)) -> Option<Emitter> {
    let number = u8::try_from(index + 1).ok()?;
    Some(Emitter { members: Members::Classes(vec![number]), radiance: emissive.radiance })
}

/// Number of the first entry by which a splat shines; 0 without one.
fn number_of(shining: &[Emissive], splat: &Splat, classes: &[Option<&[u8]>], origin: DVec3) -> u8 {
    let place = Vec3::from_array(splat.centre).as_dvec3() + origin;
    let plane = classes.get(splat.draw as usize).copied().flatten();
    let class = plane.and_then(|plane| plane.get(splat.index as usize));
    let shines = |Emissive { classes, bounds, .. }: &Emissive| {
        let of_class = classes.is_empty() || class.is_some_and(|class| classes.contains(class));
        let inside = bounds.is_none_or(|[low, high]| {
            place.cmpge(low.into()).all() && place.cmple(high.into()).all()
        });
        of_class && inside
    };
    let first = shining.iter().position(shines);
    first.and_then(|index| u8::try_from(index + 1).ok()).unwrap_or(0)
}

fn object(mesh: &TriangleMesh, origin: DVec3) -> Object {
    let near = |p: &[f64; 3]| (DVec3::from_array(*p) - origin).as_vec3();
    let mesh = Mesh {
        positions: mesh.positions.iter().map(near).collect(),
        colours: mesh.colours.iter().map(|c| linear(*c)).collect(),
        normals: mesh.normals.iter().map(|&n| Vec3::from_array(n)).collect(),
        triangles: mesh.triangles.clone(),
        ..Mesh::default()
    };
    Object { mesh: Arc::new(MeshTree::new(mesh)), place: glam::Affine3A::IDENTITY }
}

/// Linear light of a colour of sRGB.
fn linear(colour: [u8; 3]) -> Vec3 {
    Vec3::from_array(colour.map(|c| srgb_to_linear(f32::from(c) / 255.0)))
}
