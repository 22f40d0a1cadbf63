//! A scene of light that the filter blurs, since no guide shows its edges: the contact shadow of a
//! box under a bright sky, the caustic of a polished arc, and light through a narrow door.

use super::content::Content;
use super::meshes::object;
use super::quads::{add_arc, add_box, add_quad};
use super::scene::{Parts, TraceScene};
use esker_lod::View;
use esker_scan::mesh::TriangleMesh;
use esker_trace::{Gloss, Light, Lights, Scene, Sky};
use glam::DVec3;

/// Name of the scene.
pub(super) const NAME: &str = "limits";
/// All surfaces are polished, which only shows at the arc.
pub(super) const GLOSS: Gloss = Gloss { reflectance: 0.4, roughness: 0.3 };

const STONE: [u8; 3] = [200, 196, 188];
const BRICK: [u8; 3] = [190, 120, 96];
/// Height of the wall, and sides of the door in it.
const HIGH: f64 = 1.3;
const DOOR: [f64; 2] = [0.9, 1.0];

fn mesh() -> TriangleMesh {
    let mut mesh = TriangleMesh::default();
    let far = 2.4;
    let floor = [[-far, -far, 0.0], [far, -far, 0.0], [far, far, 0.0], [-far, far, 0.0]];
    add_quad(&mut mesh, floor, STONE);
    // A wall with a door, and the room behind it.
    add_box(&mut mesh, [-far, 1.0, 0.0], [DOOR[0], 1.1, HIGH], BRICK);
    add_box(&mut mesh, [DOOR[1], 1.0, 0.0], [far, 1.1, HIGH], BRICK);
    add_box(&mut mesh, [DOOR[0], 1.0, 1.0], [DOOR[1], 1.1, HIGH], BRICK);
    add_box(&mut mesh, [-far, 2.3, 0.0], [far, 2.4, HIGH], STONE);
    add_box(&mut mesh, [-far, 1.1, 0.0], [-2.3, 2.3, HIGH], STONE);
    add_box(&mut mesh, [2.3, 1.1, 0.0], [far, 2.3, HIGH], STONE);
    add_box(&mut mesh, [-far, 1.0, HIGH], [far, far, HIGH + 0.1], STONE);
    // A box that almost touches the floor, and the polished arc.
    add_box(&mut mesh, [-1.4, -0.7, 0.03], [-0.8, -0.1, 0.5], BRICK);
    add_arc(&mut mesh, [0.2, -0.5], 0.55, 0.4, [0.0, 0.5], [214, 190, 120]);
    mesh
}

/// The scene for pictures of this size.
pub(super) fn scene([width, height]: [u32; 2]) -> TraceScene {
    let mesh = mesh();
    let (eye, target) = (DVec3::new(0.1, -3.4, 2.0), DVec3::new(0.0, 0.0, 0.15));
    let view = View::look_at(eye, target, DVec3::Z, 42f64.to_radians(), width, height);
    let lights = vec![
        Light::Sky { sky: Sky::Constant([0.3, 0.34, 0.4]) },
        Light::Point { position: [0.9, -1.9, 1.0], intensity: [6.0, 5.4, 4.5] },
        Light::Point { position: [-0.6, 1.7, 0.7], intensity: [9.0, 8.0, 6.0] },
    ];
    let parts = Parts {
        view,
        lights: Lights { lights, ..Lights::default() },
        origin: DVec3::ZERO,
        content: Content::default().add_mesh(&mesh),
    };
    let triangles = mesh.triangles.len();
    let scene = Scene::default().with_objects(vec![object(&mesh)]);
    TraceScene { is_scan: false, ..parts.scene(NAME, scene, triangles, 0.0) }
}
