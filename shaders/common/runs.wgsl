// Runs: the positions of a page in groups of 256, counted from its first byte, so that the first
// and last run of a node may contain bytes of other planes. Each run has a bounding box beside its
// page. Host: crates/render/src/gpu/memory/runs.rs.

const RUN_POINTS: u32 = 256u;

// Least and greatest hot coordinates of a run.
struct RunBox {
    low: vec3<u32>,
    high: vec3<u32>,
}

fn pack_box(box: RunBox) -> vec4<u32> {
    let words = vec3<u32>(box.low.x, box.low.z, box.high.y);
    return vec4<u32>(words | (vec3<u32>(box.low.y, box.high.x, box.high.z) << vec3<u32>(16u)), 0u);
}

fn unpack_box(words: vec4<u32>) -> RunBox {
    let first = words.xyz & vec3<u32>(0xffffu);
    let second = words.xyz >> vec3<u32>(16u);
    return RunBox(vec3<u32>(first.x, second.x, first.y), vec3<u32>(second.y, first.z, second.z));
}
