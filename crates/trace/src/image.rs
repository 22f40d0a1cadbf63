//! Images of 32-bit floats, one plane a channel, the top row first.

/// An image of `C` channels.
#[derive(Clone, Debug, PartialEq)]
pub struct Image<const C: usize = 3> {
    /// Pixels in a row.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
    /// Values of each channel, row by row.
    pub planes: [Vec<f32>; C],
}

impl<const C: usize> Image<C> {
    /// An image of zeros.
    pub fn new(width: usize, height: usize) -> Self {
        Self { width, height, planes: std::array::from_fn(|_| vec![0.0; width * height]) }
    }

    /// Value of all channels of a pixel.
    pub fn at(&self, x: usize, y: usize) -> [f32; C] {
        let i = y * self.width + x;
        std::array::from_fn(|c| self.planes[c][i])
    }

    /// Number of pixels.
    pub fn len(&self) -> usize {
        self.width * self.height
    }

    /// Whether the image has no pixel.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

impl<const C: usize> Default for Image<C> {
    fn default() -> Self {
        Self::new(0, 0)
    }
}
