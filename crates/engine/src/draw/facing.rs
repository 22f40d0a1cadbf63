//! How many of the points in a picture face away from the camera: a surface that is seen from
//! behind, or normals that point the wrong way.

use crate::draw::scene::PictureScene;
use esker_format::Forest;
use esker_lod::{Frustum, OrientedBox};
use esker_points::quant::{HIDDEN_AT, HOT_POSITION_BYTES, exact, oct_direction};
use glam::{DMat3, DVec3};

/// About how many of the drawn points are examined; they are spread evenly.
const SAMPLE: usize = 1 << 17;

/// Share of the points in the picture whose normals look away from the eye. `None` where no normals
/// were read, where they do not tell front from back, or where no point with one is in view.
fn away_share(file: &Forest, scene: &PictureScene) -> Option<f64> {
    if !file.has_oriented_normals() || file.is_closed() {
        return None;
    }
    let draws = scene.draws(file);
    let step = (draws.iter().map(|draw| draw.prefix).sum::<usize>() / SAMPLE).max(1);
    let (eye, lattice) = (scene.view.eye, file.lattice());
    let frustum = Frustum::of(&scene.view.with_margin(0));
    let (mut away, mut all) = (0u64, 0u64);
    for draw in &draws {
        let Some(normals) = draw.normal else { continue };
        let points = draw.position.as_chunks::<HOT_POSITION_BYTES>().0.iter();
        let normals = normals.as_chunks::<4>().0;
        for (point, code) in points.zip(normals).take(draw.prefix).step_by(step) {
            let code = [0, 2].map(|at| i16::from_le_bytes([code[at], code[at + 1]]));
            let normal = DVec3::from_array(oct_direction(code).map(f64::from));
            let is_hidden = scene.appearance.shown.hides_any() && point[HIDDEN_AT] != 0;
            if is_hidden || normal == DVec3::ZERO {
                continue;
            }
            let node = draw.node;
            let axis = |i: usize| {
                let hot = u16::from_le_bytes([point[2 * i], point[2 * i + 1]]);
                f64::from(exact(hot, 0, node.box_min[i], node.hot_shift))
            };
            let world = DVec3::from_array([0, 1, 2].map(|i| lattice.world_axis(i, axis(i))));
            let point = OrientedBox { centre: world, half: DVec3::ZERO, axes: DMat3::IDENTITY };
            if !frustum.touches(&point) {
                continue;
            }
            all += 1;
            away += u64::from(normal.dot(world - eye) > 0.0);
        }
    }
    (all > 0).then(|| away as f64 / all as f64)
}

/// What to say of a picture in which more than half of the points face away.
pub fn note(file: &Forest, scene: &PictureScene) -> Option<&'static str> {
    let is_most = away_share(file, scene)? > 0.5;
    is_most.then_some(if scene.appearance.culls_back {
        "more than half of the points in view face away from the camera and are left out (--cull-back)"
    } else {
        "more than half of the points in view face away from the camera: they are seen from behind, or their normals are reversed"
    })
}
