// Adds one path of indirect light at each guide (`bauszat2011` 3.1). Twin:
// crates/trace/src/paths/indirect.rs.

// include common/direct.wgsl
// include common/places.wgsl

@group(0) @binding(0) var<uniform> tree: Tree;
@group(0) @binding(1) var<storage, read> boxes: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> discs: array<vec4<f32>>;
@group(0) @binding(3) var<uniform> world: World;
@group(0) @binding(4) var<storage, read> places: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> lamps: array<Lamp>;
@group(0) @binding(6) var<storage, read> sky_pixels: array<vec4<f32>>;
// Sums of even samples, then those of odd ones.
@group(0) @binding(7) var<storage, read_write> halves: array<vec4<f32>>;

// Low and high words of counts.
@group(0) @binding(8) var<storage, read_write> counts: array<atomic<u32>, 10>;

// Adds the path of a pixel.
fn add_path(id: vec3<u32>) {
    if id.x >= world.width || id.y >= world.part.rows || world.bounces == 0u {
        return;
    }
    let row = id.y + world.part.first;
    let place = place_of(place_at(id.x, row));
    if !receives(place) {
        return;
    }
    let light = incident(place, sample_of(world.sequence, id.x, row, world.number));
    let half = (world.index & 1u) * world.width * world.height;
    halves[half + row * world.width + id.x] += vec4<f32>(light, 1.0);
}

@compute @workgroup_size(8, 8)
fn main(
    @builtin(global_invocation_id) id: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    add_path(id);
    add_tally(lane);
}
