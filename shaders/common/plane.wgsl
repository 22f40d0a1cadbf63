// Reads a pixel's plane, along which its depths are moved. Needs common/tangent.wgsl and a storage
// variable `from_planes` of two values an element. Twin: `Planes` in
// crates/render/src/picture/pyramid.rs.

// Values of a pixel's plane: none, the two of a fitted plane's tilt, or the four of a normal.
override PLANE: u32 = 0u;
const FITTED: u32 = 2u;
const NORMAL: u32 = 4u;

// The values of a pixel's plane.
fn plane_of(pixel: u32) -> vec4<f32> {
    if PLANE == NORMAL {
        return vec4<f32>(from_planes[2u * pixel], from_planes[2u * pixel + 1u]);
    }
    return vec4<f32>(from_planes[pixel], 0.0, 0.0);
}

// Depth at `origin + by` (pixels) over that at `origin`, on the plane with the values `plane`.
fn moved(plane: vec4<f32>, origin: vec2<f32>, by: vec2<f32>) -> f32 {
    switch PLANE {
        case FITTED: {
            return over_turn(-1.0, turn_of(plane.xy, by));
        }
        case NORMAL: {
            return over_turn(facing(plane, origin), turn_of(plane.xy, by));
        }
        default: {
            return 1.0;
        }
    }
}
