// Whether light at one place can stand for that at another. Needs common/place_seen.wgsl. Twin:
// crates/trace/src/paths/lookup.rs.

// Cosine between the normals of a sample and of a guide, below which the guide does not fit.
const FIT_COS: f32 = 0.5;
// Distance of a sample from the plane of its guide, half widths of a pixel, above which it does
// not.
const FIT_PIXELS: f32 = 8.0;

// Whether the light at a guide can stand for that at a place: both lie on one surface. `focal` are
// the pixels of a unit of length at unit depth.
fn fits(guide: Place, seen: Place, focal: f32) -> bool {
    let off = guide.point - seen.point;
    let distance = min(abs(dot(guide.normal, off)), abs(dot(seen.normal, off)));
    let half_width = 0.5 * seen.depth / focal;
    let limit = FIT_PIXELS * half_width + max(guide.lift, seen.lift);
    return dot(guide.normal, seen.normal) >= FIT_COS && distance <= limit;
}
