// Grow: a pixel shows the nearest of the points whose dots reach it. Twin:
// crates/render/src/passes/grow.rs.

// include common/frame.wgsl
// include common/hits.wgsl

// Whether dots have radii of their own.
override ADAPTS: bool = false;

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> hits: array<vec2<u32>>;
@group(0) @binding(2) var<storage, read> radii: array<f32>;
@group(0) @binding(3) var<storage, read_write> grown: array<vec2<u32>>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let here = vec2<i32>(id.xy);
    let steps = i32(frame.point_radius);
    let low = max(here - steps, vec2<i32>(0));
    let high = min(here + steps, vec2<i32>(vec2<u32>(frame.width, frame.height)) - 1);
    var nearest = vec2<u32>(NO_HIT);
    for (var y = low.y; y <= high.y; y++) {
        for (var x = low.x; x <= high.x; x++) {
            let pixel = u32(y) * frame.width + u32(x);
            let hit = hits[pixel];
            // Bits of positive depths are ordered as these; no point is behind all.
            if hit.y > nearest.y || (hit.y == nearest.y && hit.x >= nearest.x) {
                continue;
            }
            let away = vec2<f32>(vec2<i32>(x, y) - here);
            var radius = frame.point_radius;
            if ADAPTS {
                radius = radii[pixel];
            }
            if dot(away, away) <= radius * radius {
                nearest = hit;
            }
        }
    }
    grown[id.y * frame.width + id.x] = nearest;
}
