//! The uniform of a frame, which all passes read (`shaders/common/frame.wgsl`): camera, size,
//! background.

use crate::frame::{Background, Frame, PointSize};
use crate::gpu::device::shader::same_values;
use crate::inputs::camera::Camera;
use bytemuck::{Pod, Zeroable};

same_values!(common_infinite == crate { INFINITE_BITS = f32::INFINITY.to_bits() });

/// The uniform of a frame.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct FrameUniform {
    right: [f32; 3],
    focal_px: f32,
    up: [f32; 3],
    near: f32,
    back: [f32; 3],
    width: u32,
    step: [f32; 3],
    height: u32,
    background_top: [f32; 4],
    background_bottom: [f32; 4],
    centre_px: [f32; 2],
    cull_back_faces: u32,
    margin_px: u32,
    point_radius: f32,
    eye_dome: f32,
    has_fronts: u32,
    anchor_depth: f32,
    crowding: f32,
    fitting: f32,
    is_parallel: u32,
    backdrop_from: i32,
    origin_px: [f32; 2],
    backdrop_rows: u32,
    thinned_px: f32,
}

impl FrameUniform {
    /// Values of a frame and its camera. `shares` are those of its plan
    /// ([`crate::FramePlan::shares`]).
    pub fn new<P>(frame: &Frame<'_, P>, camera: &Camera, shares: [f32; 2]) -> Self {
        let [crowding, fitting] = shares;
        let [right, up, back] = camera.view_from_world.map(|r| r.to_array());
        let [top, bottom] = match frame.background {
            Background::Plain(c) => [c, c],
            Background::Gradient([r, g, b], [s, h, c]) => [[r, g, b, 255], [s, h, c, 255]],
        };
        let share = |c: [u8; 4]| c.map(|c| f32::from(c) / 255.0);
        Self {
            right,
            focal_px: camera.focal_px,
            up,
            near: camera.near,
            back,
            width: camera.size[0],
            step: camera.step.to_array(),
            height: camera.size[1],
            background_top: share(top),
            background_bottom: share(bottom),
            centre_px: camera.centre_px,
            cull_back_faces: u32::from(frame.cull_back_faces),
            margin_px: camera.margin_px,
            point_radius: match frame.mixes_dots {
                true => PointSize::Adaptive.radius_max(),
                false => frame.dots.size.radius_max(),
            },
            eye_dome: frame.dots.eye_dome,
            has_fronts: u32::from(frame.has_fronts),
            anchor_depth: camera.anchor_depth,
            crowding,
            fitting,
            is_parallel: u32::from(camera.is_parallel),
            backdrop_from: camera.backdrop_rows[0],
            origin_px: camera.origin_px,
            backdrop_rows: camera.backdrop_rows[1] as u32,
            thinned_px: if frame.thins_points() { frame.target_spacing_px as f32 } else { 0.0 },
        }
    }
}

impl FrameUniform {
    /// Values with another number of pixels.
    pub(crate) fn with_size(self, [width, height]: [u32; 2]) -> Self {
        Self { width, height, ..self }
    }
}

/// The shaders' structure is named `Frame`.
mod layout {
    use super::FrameUniform as Frame;
    use crate::gpu::device::shader::same_layout;

    same_layout!(Frame {
        right,
        focal_px,
        up,
        near,
        back,
        width,
        step,
        height,
        background_top,
        background_bottom,
        centre_px,
        cull_back_faces,
        margin_px,
        point_radius,
        eye_dome,
        has_fronts,
        anchor_depth,
        crowding,
        fitting,
        is_parallel,
        backdrop_from,
        origin_px,
        backdrop_rows,
        thinned_px
    });
}
