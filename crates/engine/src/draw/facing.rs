//! How many of the points that a picture shows face away from the camera: a surface that is seen
//! from behind, or normals that point the wrong way.

use crate::draw::scene::PictureScene;
use esker_format::Forest;
use esker_points::quant::{HIDDEN_AT, HOT_POSITION_BYTES, exact, oct_direction};
use esker_render::Picture;
use glam::DVec3;

/// About how many of the drawn points are examined; they are spread evenly.
const SAMPLE: usize = 1 << 17;

/// A point is hidden if it lies behind the surface in its pixel by more than this, over the
/// distance of points. Closed surfaces have as many backs as fronts, but hide them.
const BEHIND_SPACINGS: f64 = 4.0;

/// Share of the points in the picture that no surface hides whose normals look away from the eye.
/// `None` where no normals were read, where they do not tell front from back, or where there is no
/// such point with one.
fn away_share(file: &Forest, scene: &PictureScene, picture: &Picture) -> Option<f64> {
    if !file.has_oriented_normals() || file.is_closed() {
        return None;
    }
    let draws = scene.draws(file);
    let step = (draws.iter().map(|draw| draw.prefix).sum::<usize>() / SAMPLE).max(1);
    let (eye, lattice) = (scene.view.eye, file.metric());
    let view = scene.view.with_margin(0);
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
            let Some(at) = view.project(world).filter(|&at| view.is_on_picture(at)) else {
                continue;
            };
            let pixel = at.y as usize * picture.width as usize + at.x as usize;
            let reach = BEHIND_SPACINGS * f64::from(node.spacing);
            let shown = picture.depth.get(pixel).copied().unwrap_or(f32::INFINITY);
            if view.depth(world) > f64::from(shown) + reach {
                continue;
            }
            all += 1;
            away += u64::from(normal.dot(world - eye) > 0.0);
        }
    }
    (all > 0).then(|| away as f64 / all as f64)
}

/// What to say of a picture in which more than half of the points that it shows face away.
pub fn note(file: &Forest, scene: &PictureScene, picture: &Picture) -> Option<&'static str> {
    let is_most = away_share(file, scene, picture)? > 0.5;
    is_most.then_some(if scene.appearance.culls_back {
        "more than half of the points in view face away from the camera and are left out (--cull-back)"
    } else {
        "more than half of the points in view face away from the camera: they are seen from behind, or their normals are reversed"
    })
}
