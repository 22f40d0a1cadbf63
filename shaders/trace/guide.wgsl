// Guide rays: what the ray through the centre of each pixel sees (`bauszat2011` 3.2). Twin:
// crates/trace/src/paths/guide.rs.

// include common/world.wgsl

@group(0) @binding(0) var<uniform> tree: Tree;
@group(0) @binding(1) var<storage, read> boxes: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> discs: array<vec4<f32>>;
@group(0) @binding(3) var<uniform> world: World;
// Three `vec4<f32>` a pixel.
@group(0) @binding(4) var<storage, read_write> places: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> lamps: array<Lamp>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= world.width || id.y >= world.part.place_rows {
        return;
    }
    let row = id.y + world.part.first_place;
    let place = see(eye_ray(vec2<f32>(vec2<u32>(id.x, row)) + 0.5));
    let at = 3u * place_at(id.x, row);
    places[at] = vec4<f32>(place.point, place.lift);
    places[at + 1u] = vec4<f32>(place.normal, place.depth);
    places[at + 2u] = vec4<f32>(place.colour, place.kind);
}
