// Gives pixels of level 1 that have no normal that of the pixel above them in level 2. Shade then
// takes the normal of level 1 for pixels of the picture that have none. Twin: `normal_around` in
// crates/render/src/picture/surface.rs.

// include common/level.wgsl
// include common/unit.wgsl

@group(0) @binding(0) var<uniform> fine: LevelShape;
@group(0) @binding(1) var<uniform> coarse: LevelShape;
@group(0) @binding(2) var<storage, read_write> fine_normal: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> coarse_normal: array<vec4<f32>>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= fine.width || id.y >= fine.height {
        return;
    }
    let pixel = id.y * fine.width + id.x;
    if !has_direction(fine_normal[pixel].xyz) {
        fine_normal[pixel] = coarse_normal[(id.y >> 1u) * coarse.width + (id.x >> 1u)];
    }
}
