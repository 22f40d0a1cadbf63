// Places that the guide rays see, three `vec4<f32>` each. The shader that includes this declares
// `places`.

// include common/place_seen.wgsl

fn place_of(pixel: u32) -> Place {
    let a = places[3u * pixel];
    let b = places[3u * pixel + 1u];
    let c = places[3u * pixel + 2u];
    return Place(a.xyz, a.w, b.xyz, b.w, c.xyz, c.w);
}
