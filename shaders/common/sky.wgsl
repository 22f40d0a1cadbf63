// Radiance of the sky. The shader that includes this declares `world` and `sky_pixels`. Twin:
// crates/trace/src/light/sky.rs.

const FULL_TURN: f32 = 6.2831855;
const HALF_TURN: f32 = 3.1415927;

// Light of a pixel of the image; columns go around.
fn sky_pixel(x: i32, y: u32) -> vec3<f32> {
    let width = i32(world.sky_width);
    let column = u32(((x % width) + width) % width);
    return sky_pixels[y * world.sky_width + column].xyz;
}

// Radiance of the image of the sky, bilinear between the centres of pixels.
fn sky_image(direction: vec3<f32>) -> vec3<f32> {
    let size = vec2<f32>(f32(world.sky_width), f32(world.sky_height));
    let turn = atan2(direction.x, direction.y) / FULL_TURN + 0.5;
    let down = acos(clamp(direction.z, -1.0, 1.0)) / HALF_TURN;
    let x = turn * size.x - 0.5;
    let y = clamp(down * size.y - 0.5, 0.0, size.y - 1.0);
    let left = i32(floor(x));
    let top = u32(y);
    let low = min(top + 1u, world.sky_height - 1u);
    let across = x - floor(x);
    let above = mix(sky_pixel(left, top), sky_pixel(left + 1, top), across);
    let below = mix(sky_pixel(left, low), sky_pixel(left + 1, low), across);
    return mix(above, below, y - floor(y));
}

// Radiance of the sky in a direction of unit length.
fn sky(direction: vec3<f32>) -> vec3<f32> {
    let end = select(world.ground.xyz, world.zenith.xyz, direction.z >= 0.0);
    let gradient = mix(world.horizon.xyz, end, min(abs(direction.z), 1.0));
    if world.sky_width == 0u {
        return gradient;
    }
    return gradient + sky_image(direction);
}
