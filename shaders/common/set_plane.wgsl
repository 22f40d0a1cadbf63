// Writes a pixel's plane. Needs common/plane.wgsl and a storage variable `to_planes` of two values
// an element.

fn set_plane(pixel: u32, plane: vec4<f32>) {
    if PLANE == FITTED {
        to_planes[pixel] = plane.xy;
    } else if PLANE == NORMAL {
        to_planes[2u * pixel] = plane.xy;
        to_planes[2u * pixel + 1u] = plane.zw;
    }
}
