// Rows of a picture that one round of the guided filter makes, and the rows that they need: windows
// reach `radius` rows beyond an output, and the pixels of those windows as many again.
struct Band {
    width: u32,
    height: u32,
    radius: i32,
    unused: u32,
    // First output row, and their number.
    first: u32,
    rows: u32,
    // First row of windows, and their number.
    window_first: u32,
    window_rows: u32,
    // First row of pixels, and their number.
    pixel_first: u32,
    pixel_rows: u32,
    unused_2: u32,
    unused_3: u32,
    // What is added to the variance of each guide.
    epsilon: vec4<f32>,
    // What is added for the noise of the light: multiplied by its variance over the squared mean
    // and the number of pixels.
    noise: vec4<f32>,
}
