// The elliptical box filter (marroquim2007 section 3.2). Needs common/infinite.wgsl. Twin: crates/render/src/passes/ellipse.rs, which has the
// derivation.

// Whether a place lies in the ellipse; `from_centre` and `radius` in pixels (y down), `normal` in view space
// (y up): its x and y, and in w the minor axis over the major one.
fn covers(from_centre: vec2<f32>, radius: f32, normal: vec4<f32>) -> bool {
    let beyond = dot(from_centre, from_centre) - radius * radius;
    let along = from_centre.x * normal.x - from_centre.y * normal.y;
    let minor = normal.w * normal.w;
    let tilt = dot(normal.xy, normal.xy);
    let outside = along * along * (1.0 - minor) + beyond * (minor * tilt);
    // No number where a radius that has no square meets an edge-on disc: covers nothing.
    return beyond <= 0.0 && (tilt == 0.0 || (outside <= 0.0 && is_number(outside)));
}

// The normal of a disc that faces the viewer: the ellipse is a circle.
const FACING: vec4<f32> = vec4<f32>(0.0, 0.0, 1.0, 1.0);
