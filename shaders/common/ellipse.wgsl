// The elliptical box filter (marroquim2007, section 3.2). Needs common/infinite.wgsl. Twin:
// crates/render/src/passes/ellipse.rs, which has the derivation.

// Whether a point of the picture is inside the ellipse of a disc. `from_centre` and `radius` are in
// pixels (y down); `normal` is in view space (y up), with the minor axis over the major one in w.
fn covers(from_centre: vec2<f32>, radius: f32, normal: vec4<f32>) -> bool {
    let beyond = dot(from_centre, from_centre) - radius * radius;
    let along = from_centre.x * normal.x - from_centre.y * normal.y;
    let minor = normal.w * normal.w;
    let tilt = dot(normal.xy, normal.xy);
    let outside = along * along * (1.0 - minor) + beyond * (minor * tilt);
    // NaN if the square of the radius overflows and the disc is seen edge-on: covers nothing.
    return beyond <= 0.0 && (tilt == 0.0 || (outside <= 0.0 && is_number(outside)));
}

// The normal of a disc that faces the viewer, whose ellipse is a circle.
const FACING: vec4<f32> = vec4<f32>(0.0, 0.0, 1.0, 1.0);
