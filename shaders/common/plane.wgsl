// A pixel's plane (crates/render/src/pyramid.rs), along which its depths are moved. Needs common/tangent.wgsl.

// Values of each: none, a tilt's or a normal's.
override PLANE: u32 = 0u;
const TOLD: u32 = 2u;
const NORMAL: u32 = 4u;

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
