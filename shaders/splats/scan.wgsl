// Replaces the number of splats of each chunk of a batch by the number of those before it in the
// frame, and adds all to the number so far. One thread does it: a batch has few chunks. Host:
// crates/render/src/gpu/splats.rs.

// include common/infinite.wgsl
// include common/splats.wgsl

@group(0) @binding(0) var<uniform> batch: Batch;
@group(0) @binding(1) var<storage, read_write> counts: array<u32>;
// Number of splats of the batches before, then of this one too.
@group(0) @binding(2) var<storage, read_write> number: array<u32>;

@compute @workgroup_size(1)
fn main() {
    var next = select(number[0], 0u, batch.is_first == 1u);
    for (var chunk = 0u; chunk < arrayLength(&counts); chunk++) {
        if batch.first_chunk + chunk >= batch.chunks {
            break;
        }
        let own = counts[chunk];
        counts[chunk] = next;
        next += own;
    }
    number[0] = next;
}
