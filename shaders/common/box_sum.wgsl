// Sums over sliding windows without subtraction: a thread makes a short run of outputs from the
// part that all of their windows share, and from what each has beyond it on both sides. A value
// far above its neighbours (a firefly) thus leaves no rounding error behind where a window has
// passed it. The shader that includes this declares `item`, the value at a place along the axis
// (0 beyond the ends), and `put`, which stores an output.

// Outputs of a thread.
const RUN: i32 = 16;

fn box_sums(first: i32, radius: i32) {
    if 2 * radius + 1 < RUN {
        for (var i = 0; i < RUN; i++) {
            var sum = 0.0;
            for (var at = first + i - radius; at <= first + i + radius; at++) {
                sum += item(at);
            }
            put(first + i, sum);
        }
        return;
    }
    // What each window has before the shared part.
    var before: array<f32, 16>;
    var sum = 0.0;
    for (var i = RUN - 1; i >= 0; i--) {
        before[i] = sum;
        sum += item(first + i - 1 - radius);
    }
    var shared_part = 0.0;
    for (var at = first + RUN - 1 - radius; at <= first + radius; at++) {
        shared_part += item(at);
    }
    sum = 0.0;
    for (var i = 0; i < RUN; i++) {
        put(first + i, before[i] + shared_part + sum);
        sum += item(first + i + 1 + radius);
    }
}
