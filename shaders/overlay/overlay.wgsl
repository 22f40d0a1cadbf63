// Overlay: draws dots over a finished picture of surfaces, where they are nearer. Twin:
// crates/render/src/passes/overlay.rs.

// include common/frame.wgsl
// include common/draws.wgsl
// include common/place.wgsl
// include common/lookup.wgsl
// include common/colour.wgsl
// include common/point_colour.wgsl
// include common/facing.wgsl
// include common/point_normal.wgsl
// include common/unit.wgsl
// include common/phong.wgsl
// include common/encode.wgsl

// Whether normals are read; without them dots have their own colours.
override NORMALS: bool = false;
// Whether dots have highlights.
override SHINES: bool = true;

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<uniform> lookup: Lookup;
@group(0) @binding(2) var<uniform> encode_table: EncodeTable;
// Hidden dots are removed.
@group(0) @binding(3) var<storage, read_write> dots: array<vec2<u32>>;
@group(0) @binding(4) var<storage, read> draws: array<Draw>;
@group(0) @binding(5) var<storage, read> geometry: array<vec4<u32>>;
@group(0) @binding(6) var<storage, read> paint: array<vec4<u32>>;
@group(0) @binding(7) var<storage, read_write> rgba: array<u32>;
@group(0) @binding(8) var<storage, read_write> depths: array<u32>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < frame.width && id.y < frame.height {
        draw_dot(id.xy);
    }
}

// Draws the dot of a pixel, if it has one that is nearer than the surface.
fn draw_dot(at: vec2<u32>) {
    let pixel = at.y * frame.width + at.x;
    let dot = dots[pixel];
    if dot.y == NO_HIT {
        return;
    }
    // Bits of positive numbers are ordered as these.
    if dot.y >= depths[pixel] {
        dots[pixel] = vec2<u32>(NO_HIT);
        return;
    }
    var colour = point_colour(pixel, dot.y);
    let words = paint[pixel];
    if NORMALS && words.w != NO_NORMAL {
        let draw = words.x & ~HAS_COLOUR;
        let offset = offset_of(geometry[pixel], draws[draw].shift);
        let from_centre = (vec2<f32>(at) + 0.5 - frame.centre_px) * vec2<f32>(1.0, -1.0);
        // Without highlights the light at the eye comes along the axis.
        var to_eye = vec3<f32>(0.0, 0.0, 1.0);
        if SHINES {
            to_eye = unit_or(vec3<f32>(-from_centre, frame.focal_px), to_eye);
        }
        colour = phong(colour, normal_to_eye(words.w, draw, offset).xyz, to_eye);
    }
    rgba[pixel] = encoded_bytes(colour);
    depths[pixel] = dot.y;
}
