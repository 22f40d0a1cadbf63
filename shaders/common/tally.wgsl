// Counts of rays and of what went wrong, as crates/trace/src/paths/stats.rs has them. The shader
// that includes this declares `counts`, two words a count, the low one first.

const SHADOW_RAYS: u32 = 0u;
const BOUNCE_RAYS: u32 = 1u;
const SELF_HITS: u32 = 2u;
const ESCAPED: u32 = 3u;
const WITHOUT_GUIDE: u32 = 4u;
const COUNTS: u32 = 5u;

// Counts of a thread, and of its workgroup.
var<private> tally: array<u32, 5>;
var<workgroup> group_tally: array<atomic<u32>, 5>;

// Adds the counts of a workgroup to those of the picture; all of its threads call it.
fn add_tally(lane: u32) {
    for (var i = 0u; i < COUNTS; i++) {
        atomicAdd(&group_tally[i], tally[i]);
    }
    workgroupBarrier();
    if lane < COUNTS {
        let own = atomicLoad(&group_tally[lane]);
        let before = atomicAdd(&counts[2u * lane], own);
        if before + own < before {
            atomicAdd(&counts[2u * lane + 1u], 1u);
        }
    }
}
