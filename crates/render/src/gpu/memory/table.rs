//! Rows of the tables of the cut (`shaders/common/draws.wgsl`): nodes, and chunks of their points.
//! Dispatches run over chunks of many nodes, never over a single node.

use crate::frame::{ColourPlane, DrawNode};
use crate::gpu::device::shader::{same_layout, same_values};
use crate::inputs::camera::Camera;
use crate::inputs::thinning::Thinning;
use bytemuck::{Pod, Zeroable};
use esker_points::AttrType;
use esker_points::clip::CLIP_BYTES;
use esker_points::node::LEVELS_MAX;
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

/// Points of a chunk at most.
pub const CHUNK_POINTS: u32 = 4096;
/// Page of a plane that does not exist.
pub const NO_PAGE: u32 = u32::MAX;
/// Kind of colour plane: none.
pub const COLOUR_NONE: u32 = 0;
/// Kind of colour plane: bytes red, green, blue and an unused one.
pub const COLOUR_RGBA: u32 = 1;
/// Kind of colour plane: values of the first [`AttrType`]; the other types follow.
pub const COLOUR_SCALAR: u32 = 2;

/// Kind of colour plane: the last byte of each position.
pub const COLOUR_INDEX: u32 = 12;

/// Place of a plane in drawing memory, which is one range of addresses in pages that no plane
/// straddles.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PlaneAt {
    /// Its first byte, a multiple of 4.
    pub offset: u64,
    /// Length, bytes.
    pub bytes: u64,
}

/// Row of a node.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct Draw {
    /// Field of [`crate::inputs::camera::NodePlace`].
    pub base_high: [i32; 3],
    /// Bits that hot positions drop.
    pub shift: u32,
    /// Field of [`crate::inputs::camera::NodePlace`].
    pub base_low: [i32; 3],
    /// Number of points drawn.
    pub points: u32,
    /// Field of [`crate::inputs::camera::NodePlace`].
    pub bias_steps: [f32; 3],
    /// Spacing of the node, in the file's unit.
    pub spacing: f32,
    /// Least lattice coordinates of the node.
    pub box_min: [u32; 3],
    /// Index of the node's cell in the compact octree.
    pub entry: u32,
    /// Page of the positions.
    pub position_page: u32,
    /// First word of that plane.
    pub position_word: u32,
    /// Page of the residual bits, or [`NO_PAGE`].
    pub residual_page: u32,
    /// First word of that plane.
    pub residual_word: u32,
    /// Page of the colours or values, or [`NO_PAGE`].
    pub colour_page: u32,
    /// First word of that plane.
    pub colour_word: u32,
    /// Page of the normals, or [`NO_PAGE`].
    pub normal_page: u32,
    /// First word of that plane.
    pub normal_word: u32,
    /// Log2 of the edge of the node's cell, steps.
    pub cell_log2: u32,
    /// First chunk of the node.
    pub chunk: u32,
    /// Kind of the colour plane: [`COLOUR_NONE`], [`COLOUR_RGBA`], [`COLOUR_INDEX`], or
    /// [`COLOUR_SCALAR`] plus the number of the [`AttrType`].
    pub colour_kind: u32,
    /// Points of the colour plane, at most those drawn.
    pub colour_points: u32,
    /// Points of the normal plane, at most those drawn.
    pub normal_points: u32,
    /// Page of the clip lines, or [`NO_PAGE`].
    pub clip_page: u32,
    /// First word of that plane.
    pub clip_word: u32,
    /// Points of the plane of clip lines, at most those drawn.
    pub clip_points: u32,
    /// Page of the shapes of splats, or [`NO_PAGE`].
    pub tangent_page: u32,
    /// First word of that plane.
    pub tangent_word: u32,
    /// Points of the plane of shapes, at most those drawn.
    pub tangent_points: u32,
    /// Field of [`Thinning`].
    pub per_reach: f32,
    /// Field of [`Thinning`].
    pub above: f32,
    /// Field of [`Thinning`].
    pub per_point: f32,
    /// 1 if [`Thinning`] is that of a line.
    pub is_line: u32,
    /// Field of [`Thinning`].
    pub level_ends: [u32; LEVELS_MAX],
    /// Padding to a multiple of 16 bytes.
    pub unused: u32,
}

impl Draw {
    /// The row of a node whose first chunk is `chunk`; `place` gives page and first word of a
    /// plane. Points without a position are not drawn, as in
    /// [`crate::inputs::camera::Positions::of`].
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
            ..Self::default()
        }
    }

    /// The row of a node whose points are thinned.
    pub(crate) fn thinned(self, thinning: &Thinning) -> Self {
        let &Thinning { per_reach, above, per_point, is_line, ends } = thinning;
        Self { per_reach, above, per_point, is_line: u32::from(is_line), level_ends: ends, ..self }
    }
}

const fn scalar_kind(ty: AttrType) -> u32 {
    COLOUR_SCALAR + ty as u32
}

/// Row of a chunk: consecutive points of a node.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct Chunk {
    /// Row of the node in the table of nodes.
    pub draw: u32,
    /// First point in the node.
    pub first: u32,
    /// Number of points, at most [`CHUNK_POINTS`].
    pub points: u32,
    /// Padding to a multiple of 16 bytes.
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
    tangent_points,
    per_reach,
    above,
    per_point,
    is_line,
    level_ends
});
same_layout!(Chunk { draw, first, points });
