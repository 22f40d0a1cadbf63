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

/// Points that a task makes splats of: enough to outweigh the cost of a task, and few enough that
/// the nodes of a small cut keep all threads busy.
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
    let maker = SplatMaker {
        lookup: &lookup,
        eye: (frame.view.eye - origin).as_vec3(),
        forward: frame.view.forward().as_vec3(),
    };
    let tasks: Vec<(usize, Range<usize>)> = (0..frame.draws.len())
        .flat_map(|draw| {
            let points = list.len(draw);
            let starts = (0..points).step_by(TASK_POINTS);
            starts.map(move |first| (draw, first..(first + TASK_POINTS).min(points)))
        })
        .collect();
    let parts: Vec<Vec<Splat>> =
        tasks.into_par_iter().map(|(draw, points)| maker.splats_of(draw, points)).collect();
    parts.concat()
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
    /// Splats of some points of a draw.
    fn splats_of(&self, draw: usize, points: Range<usize>) -> Vec<Splat> {
        let Lookup { frame, camera, .. } = self.lookup;
        let node = &frame.draws[draw];
        let (positions, place) = self.lookup.places(draw);
        let radii = self.lookup.radii(draw);
        let only_colour = self.lookup.only_colour(draw);
        let mut splats = Vec::with_capacity(points.len());
        for index in points {
            if frame.hides_points && is_hidden(node.position, index) {
                continue;
            }
            let (offset, code) = positions.offset(index);
            let centre = place.steps_from_eye(offset) * camera.step;
            if !centre.is_finite() {
                continue;
            }
            let colour = only_colour.unwrap_or_else(|| {
                let depth = (centre - self.eye).dot(self.forward);
                self.lookup.colour(draw, index, offset, depth)
            });
            let normal = node.normal.map_or(Vec3::ZERO, |plane| normal_at(plane, index));
            let radius = match &radii {
                Some(radii) => radii[usize::from(code)],
                None => self.lookup.radius(draw, offset, code),
            };
            splats.push(Splat {
                centre: centre.to_array(),
                radius,
                normal: normal.to_array(),
                colour: colour.to_array(),
                draw: draw as u32,
                index: index as u32,
            });
        }
        splats
    }
}
