// A pixel's plane (crates/render/src/picture/pyramid.rs), along which its depths are moved. Needs common/tangent.wgsl
// and a storage variable `from_planes`, of two values each.

// Values of each: none, a tilt's or a normal's.
override PLANE: u32 = 0u;
const TOLD: u32 = 2u;
const NORMAL: u32 = 4u;

// The values of a pixel's plane.
fn plane_of(pixel: u32) -> vec4<f32> {
    if PLANE == NORMAL {
        return vec4<f32>(from_planes[2u * pixel], from_planes[2u * pixel + 1u]);
    }
    return vec4<f32>(from_planes[pixel], 0.0, 0.0);
}

// Depth at `origin + by` (pixels) over that at `origin`, on a plane that has its values in `plane`.
fn moved(plane: vec4<f32>, origin: vec2<f32>, by: vec2<f32>) -> f32 {
    switch PLANE {
        case TOLD: {
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
