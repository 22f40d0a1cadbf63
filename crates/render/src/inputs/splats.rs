//! Splats of a frame as plain discs in the world, for light: all of them, in view or not.

/// A point as a disc.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Splat {
    /// Centre relative to the origin, the file's unit.
    pub centre: [f32; 3],
    /// Drawn radius, the file's unit.
    pub radius: f32,
    /// Unit normal; zero for a point without one.
    pub normal: [f32; 3],
    /// Colour, linear light.
    pub colour: [f32; 3],
    /// Index of the draw in the frame that the point is of.
    pub draw: u32,
    /// Index of the point in its node.
    pub index: u32,
}
