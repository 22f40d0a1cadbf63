//! The tables of what is drawn, as the shaders read them (`shaders/common/draws.wgsl`): nodes, and equal
//! chunks of their points. One dispatch goes over all chunks, never one over a node.

use crate::frame::{ColourPlane, DrawNode};
use crate::gpu::device::shader::{same_layout, same_values};
use crate::inputs::camera::Camera;
use bytemuck::{Pod, Zeroable};
use esker_points::AttrType;
use esker_points::clip::CLIP_BYTES;
use esker_points::quant::{HOT_POSITION_BYTES, residual_bytes};
use esker_points::tangents::TANGENT_BYTES;

same_values!(common_draws == crate::gpu::memory::table {
    CHUNK_POINTS,
    NO_PAGE,
    COLOUR_NONE,
    COLOUR_RGBA,
    COLOUR_U8 = scalar_kind(AttrType::U8),
    COLOUR_I8 = scalar_kind(AttrType::I8),
    COLOUR_U16 = scalar_kind(AttrType::U16),
    COLOUR_I16 = scalar_kind(AttrType::I16),
    COLOUR_U32 = scalar_kind(AttrType::U32),
    COLOUR_I32 = scalar_kind(AttrType::I32),
    COLOUR_U64 = scalar_kind(AttrType::U64),
    COLOUR_I64 = scalar_kind(AttrType::I64),
    COLOUR_F32 = scalar_kind(AttrType::F32),
    COLOUR_F64 = scalar_kind(AttrType::F64),
    COLOUR_INDEX,
});

/// Points of a chunk.
pub const CHUNK_POINTS: u32 = 4096;
/// The page of a plane that is not there.
pub const NO_PAGE: u32 = u32::MAX;
/// A node without colours.
pub const COLOUR_NONE: u32 = 0;
/// Red, green, blue and an unused byte.
pub const COLOUR_RGBA: u32 = 1;
/// Values of the first type.
pub const COLOUR_SCALAR: u32 = 2;

/// A number in the last byte of a position.
pub const COLOUR_INDEX: u32 = 12;

/// A place in drawing memory: one range of addresses from 0, cut into pages that no plane straddles.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PlaneAt {
    /// Its first byte, a multiple of 4.
    pub offset: u64,
    /// Bytes.
    pub bytes: u64,
}

/// A drawn node.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct Draw {
    /// As in [`crate::inputs::camera::NodePlace`].
    pub base_high: [i32; 3],
    /// Bits that hot positions drop.
    pub shift: u32,
    /// As in [`crate::inputs::camera::NodePlace`].
    pub base_low: [i32; 3],
    /// Points drawn.
    pub points: u32,
    /// As in [`crate::inputs::camera::NodePlace`].
    pub bias_steps: [f32; 3],
    /// Typical distance of the node's points, the file's unit.
    pub spacing: f32,
    /// Least lattice coordinates.
    pub box_min: [u32; 3],
    /// Its place in the compact octree.
    pub entry: u32,
    /// Page of the positions.
    pub position_page: u32,
    /// Their first word in it.
    pub position_word: u32,
    /// Page of the dropped bits, or [`NO_PAGE`].
    pub residual_page: u32,
    /// Their first word in it.
    pub residual_word: u32,
    /// Page of the colours or values, or [`NO_PAGE`].
    pub colour_page: u32,
    /// Their first word in it.
    pub colour_word: u32,
    /// Page of the normals, or [`NO_PAGE`].
    pub normal_page: u32,
    /// Their first word in it.
    pub normal_word: u32,
    /// Log2 of its cell's edge.
    pub cell_log2: u32,
    /// Its first chunk.
    pub chunk: u32,
    /// What a point of the colour plane is: [`COLOUR_NONE`], [`COLOUR_RGBA`], or [`COLOUR_SCALAR`] and
    /// more in the order of [`AttrType`].
    pub colour_kind: u32,
    /// Points that the colour plane has, at most those drawn.
    pub colour_points: u32,
    /// Points that the normal plane has, at most those drawn.
    pub normal_points: u32,
    /// Page of the clip lines, or [`NO_PAGE`].
    pub clip_page: u32,
    /// Their first word in it.
    pub clip_word: u32,
    /// Points that their plane has, at most those drawn.
    pub clip_points: u32,
    /// Page of the shapes of splats, or [`NO_PAGE`].
    pub tangent_page: u32,
    /// Their first word in it.
    pub tangent_word: u32,
    /// Points that their plane has, at most those drawn.
    pub tangent_points: u32,
    /// To a whole multiple of 16 bytes.
    pub unused: u32,
}

impl Draw {
    /// The row of a node whose first chunk is `chunk`; `place` gives page and first word of a plane. What of
    /// its points has no position is not drawn, as by [`crate::inputs::camera::Positions::of`].
    pub fn of(
        draw: &DrawNode<'_, PlaneAt>,
        camera: &Camera,
        chunk: u32,
        place: impl Fn(PlaneAt) -> Option<(u32, u32)>,
    ) -> Self {
        let node = draw.node;
        let held = |plane: PlaneAt, point_bytes: usize| plane.bytes / point_bytes.max(1) as u64;
        let place = |plane: Option<PlaneAt>| plane.and_then(&place).unwrap_or((NO_PAGE, 0));
        let (position_page, position_word) = place(Some(draw.position));
        let has_positions = position_page != NO_PAGE;
        let points = held(draw.position, HOT_POSITION_BYTES).min(draw.prefix as u64);
        let points = if has_positions { points.min(u64::from(u32::MAX)) } else { 0 };
        let shift = node.hot_shift.min(crate::inputs::camera::SHIFT_MAX);
        let enough = |r: &PlaneAt| shift > 0 && held(*r, residual_bytes(shift)) >= points;
        let (residual_page, residual_word) = place(draw.residual.filter(enough));
        let is_exact = shift == 0 || residual_page != NO_PAGE;
        let (colour, colour_kind, colour_bytes) = match draw.colour {
            ColourPlane::None => (None, COLOUR_NONE, 4),
            ColourPlane::Rgba(plane) => (Some(plane), COLOUR_RGBA, 4),
            ColourPlane::Indexed => (Some(draw.position), COLOUR_INDEX, HOT_POSITION_BYTES),
            ColourPlane::Scalar { bytes, ty } => (Some(bytes), scalar_kind(ty), ty.size()),
        };
        let (colour_page, colour_word) = place(colour);
        let (normal_page, normal_word) = place(draw.normal);
        let (clip_page, clip_word) = place(draw.clip);
        let (tangent_page, tangent_word) = place(draw.tangents);
        let drawn = |plane: Option<PlaneAt>, bytes: usize| {
            plane.map_or(0, |p| held(p, bytes)).min(points) as u32
        };
        let at = camera.place(node, is_exact);
        Self {
            base_high: at.base_high,
            shift: u32::from(shift),
            base_low: at.base_low,
            points: points as u32,
            bias_steps: at.bias_steps.to_array(),
            spacing: node.spacing,
            box_min: node.box_min,
            entry: u32::try_from(draw.entry).unwrap_or(u32::MAX),
            position_page,
            position_word,
            residual_page,
            residual_word,
            colour_page,
            colour_word,
            normal_page,
            normal_word,
            cell_log2: u32::from(node.cell_log2),
            chunk,
            colour_kind,
            colour_points: drawn(colour, colour_bytes),
            normal_points: drawn(draw.normal, 4),
            clip_page,
            clip_word,
            clip_points: drawn(draw.clip, CLIP_BYTES),
            tangent_page,
            tangent_word,
            tangent_points: drawn(draw.tangents, TANGENT_BYTES),
            unused: 0,
        }
    }
}

const fn scalar_kind(ty: AttrType) -> u32 {
    COLOUR_SCALAR + ty as u32
}

/// A run of a node's points.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct Chunk {
    /// The node, in the table of draws.
    pub draw: u32,
    /// First point, in the node.
    pub first: u32,
    /// Points, at most [`CHUNK_POINTS`].
    pub points: u32,
    /// To a whole multiple of 16 bytes.
    pub unused: u32,
}

same_layout!(Draw {
    base_high,
    shift,
    base_low,
    points,
    bias_steps,
    spacing,
    box_min,
    entry,
    position_page,
    position_word,
    residual_page,
    residual_word,
    colour_page,
    colour_word,
    normal_page,
    normal_word,
    cell_log2,
    chunk,
    colour_kind,
    colour_points,
    normal_points,
    clip_page,
    clip_word,
    clip_points,
    tangent_page,
    tangent_word,
    tangent_points
});
same_layout!(Chunk { draw, first, points });
