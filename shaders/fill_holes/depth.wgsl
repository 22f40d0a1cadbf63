// Writes the depth image of the filled level 0: depths at the pixels' centres, infinite without a
// surface. Twin: `Level::depth_image` in crates/render/src/picture/pyramid.rs.

// include common/frame.wgsl
// include common/level.wgsl
// include common/tangent.wgsl
// include common/plane.wgsl

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> front: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> mean_depth: array<f32>;
@group(0) @binding(3) var<storage, read_write> depth: array<f32>;
@group(0) @binding(4) var<storage, read> from_planes: array<vec2<f32>>;
@group(0) @binding(5) var<storage, read> tint: array<vec4<f32>>;

// Distance over which a depth may change between the ellipse's centre and the pixel's: the radius,
// or this many pixels at least.
const REACH_MIN_PX: f32 = 4.0;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let pixel = id.y * frame.width + id.x;
    var here = infinity();
    if is_valid(front[pixel]) {
        here = mean_depth[pixel];
        if PLANE > 0u {
            let displaced = front[pixel].zw;
            let centre = vec2<f32>(id.xy) + 0.5;
            let factor = moved(plane_of(pixel), centre - displaced, displaced);
            let reach = max(tint[pixel].w, REACH_MIN_PX) / frame.focal_px;
            here *= clamp(factor, 1.0 - reach, 1.0 + reach);
        }
    }
    depth[pixel] = here;
}
