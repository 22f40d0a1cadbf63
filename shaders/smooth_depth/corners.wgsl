// Mean radii of discs at the corners of tiles, from the samples of the tiles around, and the
// greatest of them. Twin: `Radii::measure` in crates/render/src/picture/radii.rs.

// include common/frame.wgsl
// include common/radii.wgsl

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> tiles: array<vec2<f32>>;
@group(0) @binding(2) var<storage, read_write> radii: array<f32>;
// Bits of the greatest radius; those of positive numbers have their order.
@group(0) @binding(3) var<storage, read_write> most: atomic<u32>;

// Sum and number of the samples of a tile, zeros outside of the picture. Tiles count from 1.
fn samples(tile: vec2<u32>) -> vec2<f32> {
    let size = radii_size();
    if any(tile < vec2<u32>(1u)) || any(tile > size) {
        return vec2<f32>(0.0);
    }
    return tiles[(tile.y - 1u) * size.x + tile.x - 1u];
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let size = radii_size();
    if any(id.xy > size) {
        return;
    }
    let above = samples(id.xy) + samples(id.xy + vec2<u32>(1u, 0u));
    let below = samples(id.xy + vec2<u32>(0u, 1u)) + samples(id.xy + 1u);
    let found = above + below;
    let radius_px = select(0.0, found.x / found.y, found.y > 0.0);
    radii[id.y * (size.x + 1u) + id.x] = radius_px;
    atomicMax(&most, bitcast<u32>(radius_px));
}
