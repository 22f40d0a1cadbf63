//! Overlay (method *auto*): draws dots over a finished picture of surfaces, where they are nearer.
//! Dots with a normal are lit as surfaces are ([`crate::passes::shade`]); those without have their
//! own colour.

use crate::frame::Picture;
use crate::inputs::colour::Encoder;
use crate::inputs::lookup::{Lookup, NO_NORMAL, normal_code};
use crate::passes::gather::normal_to_eye;
use crate::passes::project::{EMPTY, unpack};
use crate::passes::shade::phong;
use glam::Vec3;
use rayon::prelude::*;
use std::sync::atomic::AtomicU64;

/// How dots are lit.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DotLight {
    /// Whether normals are read; without them dots have their own colours.
    pub(crate) has_normals: bool,
    /// Whether there are highlights.
    pub(crate) shines: bool,
}

/// Draws the dots of a frame buffer, and removes those from it that are hidden. Returns the number
/// of pixels that showed no surface before.
pub(crate) fn overlay(
    lookup: &Lookup<'_>,
    light: DotLight,
    dots: &mut [AtomicU64],
    picture: &mut Picture,
) -> u64 {
    let width = picture.width as usize;
    let encoder = Encoder::get();
    let rows = picture.rgba.par_chunks_mut(width * 4).zip(picture.depth.par_chunks_mut(width));
    let rows = rows.zip(dots.par_chunks_mut(width)).enumerate();
    let covered = rows.map(|(y, ((rgba, depths), dots))| {
        let mut count = 0;
        let pixels = rgba.as_chunks_mut::<4>().0.iter_mut().zip(depths).zip(dots).enumerate();
        for (x, ((out, shown), dot)) in pixels {
            let value = *dot.get_mut();
            if value == EMPTY {
                continue;
            }
            let (depth, point) = unpack(value);
            if depth >= *shown {
                *dot.get_mut() = EMPTY;
                continue;
            }
            count += u64::from(*shown == f32::INFINITY);
            let [r, g, b] = encoder.bytes(colour_of(lookup, light, [x, y], depth, point));
            (*out, *shown) = ([r, g, b, 255], depth);
        }
        count
    });
    covered.sum()
}

/// Colour of a dot at a pixel, linear light.
fn colour_of(
    lookup: &Lookup<'_>,
    light: DotLight,
    pixel: [usize; 2],
    depth: f32,
    point: u32,
) -> Vec3 {
    let colour = lookup.colour_of(point, depth);
    let (draw, index) = lookup.list.find(point);
    let plane = lookup.frame.draws[draw].normal.filter(|_| light.has_normals);
    let code = plane.and_then(|plane| normal_code(plane, index)).unwrap_or(NO_NORMAL);
    if code == NO_NORMAL {
        return colour;
    }
    let (positions, place) = lookup.places(draw);
    let (offset, _) = positions.offset(index);
    let step = lookup.camera.step.to_array();
    let from_anchor = [0, 1, 2].map(|axis| place.axis_steps(axis, offset[axis]) * step[axis]);
    let frame = lookup.frame;
    let fronts = [frame.cull_back_faces, frame.has_fronts];
    let normal = normal_to_eye(lookup.camera, code, from_anchor, fronts);
    let [cx, cy] = lookup.camera.centre_px;
    let [x, y] = pixel.map(|c| c as f32 + 0.5);
    let ahead = Vec3::new(cx - x, y - cy, lookup.camera.focal_px);
    // Without highlights the light at the eye comes along the axis.
    let to_eye = if light.shines { ahead / ahead.length() } else { Vec3::Z };
    phong(colour, normal, to_eye, light.shines)
}
