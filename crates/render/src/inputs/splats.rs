//! Splats of a frame as plain discs in the world, for light (`bauszat2011`): those of all drawn
//! nodes, in view or not, since surfaces out of view reflect light and cast shadows too. A frame
//! and an origin go in; positions relative to the origin come out, subtracted on the lattice
//! ([`crate::inputs::camera`]).

use crate::frame::Frame;
use crate::inputs::camera::Camera;
use crate::inputs::lookup::{DrawList, Lookup, is_hidden, normal_at};
use esker_lod::View;
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

/// Least points that a task makes splats of: enough to outweigh the cost of a task, and few enough
/// that a small cut keeps all threads busy.
const TASK_POINTS: usize = 1 << 12;

/// A point as a disc.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Splat {
    /// Centre relative to the origin, the file's unit; finite.
    pub centre: [f32; 3],
    /// Drawn radius, the file's unit, from 0 to 10^30. It is the typical distance of the points
    /// drawn around this one, not a radius that closes the surface: EWA splatting draws discs of
    /// [`crate::ewa::Options::radius_factor`] times this radius.
    pub radius: f32,
    /// Unit normal; zero for a point without one. Its sign is arbitrary unless the file's normals
    /// are oriented.
    pub normal: [f32; 3],
    /// Colour, linear light.
    pub colour: [f32; 3],
    /// Index of the draw in the frame that the point is of.
    pub draw: u32,
    /// Index of the point in its node.
    pub index: u32,
}

/// Makes splats of all points of a frame, relative to `origin` (world coordinates, the file's
/// unit): draw by draw, in the order of their points, for any number of threads. Hidden points are
/// left out if the frame hides points, and so are points whose position is not finite in `f32`.
/// There are no splats if `origin` is not finite. Positions are exact to a few units in the last
/// place of their distance from `origin`.
pub fn splats(frame: &Frame<'_>, origin: DVec3) -> Vec<Splat> {
    // Only the eye of this camera counts.
    let view = View::look_at(origin, origin + DVec3::Y, DVec3::Z, 1.0, 1, 1);
    let Ok(camera) = Camera::new(&view, frame.lattice) else { return Vec::new() };
    let list = DrawList::new(frame.draws);
    let lookup = Lookup::new(frame, &camera, &list);
    let eye = (frame.view.eye - origin).as_vec3();
    let maker = SplatMaker { lookup: &lookup, eye, forward: frame.view.forward().as_vec3() };
    let mut points = 0;
    let of_draw = |draw| {
        let first = points;
        points += list.len(draw);
        let (radii, colour) = (lookup.radii(draw), lookup.only_colour(draw));
        SplatDraw { draw, points: first..points, radii, colour }
    };
    let draws: Vec<_> = (0..frame.draws.len()).map(of_draw).collect();
    let leaves_out = AtomicBool::new(false);
    // The draw of the last point is that of most next ones.
    let splat = |draw: &mut usize, point: usize| {
        if !draws[*draw].points.contains(&point) {
            *draw = draws.partition_point(|d| d.points.end <= point);
        }
        let own = &draws[*draw];
        maker.splat(own, point - own.points.start).unwrap_or_else(|| {
            leaves_out.store(true, Relaxed);
            LEFT_OUT
        })
    };
    // Written in place: copies of so many splats would take longer than making them.
    let all = (0..points).into_par_iter().with_min_len(TASK_POINTS).map_init(|| 0, splat);
    let mut splats: Vec<Splat> = all.collect();
    if leaves_out.into_inner() {
        splats.retain(|splat| !splat.radius.is_nan());
    }
    splats
}

/// Stands for a point without a splat until all are made. No splat has such a radius.
const LEFT_OUT: Splat = Splat {
    centre: [0.0; 3],
    radius: f32::NAN,
    normal: [0.0; 3],
    colour: [0.0; 3],
    draw: 0,
    index: 0,
};

/// A draw and what its splats share.
struct SplatDraw {
    /// Index in the frame.
    draw: usize,
    /// Its points, by their numbers in the frame.
    points: Range<usize>,
    /// Radii of all codes, if they are the same for all points.
    radii: Option<[f32; 256]>,
    /// Colour of all points, if they have the same.
    colour: Option<Vec3>,
}

/// Makes splats of points.
struct SplatMaker<'a> {
    lookup: &'a Lookup<'a>,
    /// Eye of the frame relative to the origin, for colours by depth.
    eye: Vec3,
    /// Direction of the frame's view.
    forward: Vec3,
}

impl SplatMaker<'_> {
    /// Splat of a point of a draw; `None` if it is hidden or not finite.
    #[inline]
    fn splat(&self, own: &SplatDraw, index: usize) -> Option<Splat> {
        let Lookup { frame, camera, .. } = self.lookup;
        let (draw, node) = (own.draw, &frame.draws[own.draw]);
        if frame.hides_points && is_hidden(node.position, index) {
            return None;
        }
        let (positions, place) = self.lookup.places(draw);
        let (offset, code) = positions.offset(index);
        let centre = place.steps_from_anchor(offset) * camera.step;
        if !centre.is_finite() {
            return None;
        }
        let colour = own.colour.unwrap_or_else(|| {
            let depth = (centre - self.eye).dot(self.forward);
            self.lookup.colour(draw, index, offset, depth)
        });
        let normal = node.normal.map_or(Vec3::ZERO, |plane| normal_at(plane, index));
        let radius = match &own.radii {
            Some(radii) => radii[usize::from(code)],
            None => self.lookup.radius(draw, offset, code),
        };
        Some(Splat {
            centre: centre.to_array(),
            radius,
            normal: normal.to_array(),
            colour: colour.to_array(),
            draw: draw as u32,
            index: index as u32,
        })
    }
}
