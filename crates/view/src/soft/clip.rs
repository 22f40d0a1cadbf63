//! Rectangles of the window's picture, pixels.

use eframe::egui::Rect;

/// A rectangle: begin and end on each side, pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Clip {
    /// First column, and the one behind the last.
    pub x: [i64; 2],
    /// First row, and the one behind the last.
    pub y: [i64; 2],
}

impl Clip {
    /// No pixel.
    pub const NONE: Self = Self { x: [i64::MAX, i64::MIN], y: [i64::MAX, i64::MIN] };

    /// A rectangle in points, at `scale` pixels per point, within a picture of `size` pixels.
    pub fn of(rect: Rect, scale: f32, size: [usize; 2]) -> Self {
        let side = |from: f32, to: f32, most: usize| {
            [from, to].map(|v| ((v * scale).round() as i64).clamp(0, most as i64))
        };
        Self { x: side(rect.min.x, rect.max.x, size[0]), y: side(rect.min.y, rect.max.y, size[1]) }
    }

    /// All of a picture of `size` pixels.
    pub fn whole(size: [usize; 2]) -> Self {
        Self { x: [0, size[0] as i64], y: [0, size[1] as i64] }
    }

    /// Whether it has no pixel.
    pub fn is_empty(self) -> bool {
        self.x[0] >= self.x[1] || self.y[0] >= self.y[1]
    }

    /// Number of pixels.
    pub fn pixels(self) -> usize {
        if self.is_empty() {
            return 0;
        }
        ((self.x[1] - self.x[0]) * (self.y[1] - self.y[0])) as usize
    }

    /// The part that is also in `other`.
    pub fn within(self, other: Self) -> Self {
        let side = |a: [i64; 2], b: [i64; 2]| [a[0].max(b[0]), a[1].min(b[1])];
        Self { x: side(self.x, other.x), y: side(self.y, other.y) }
    }

    /// The least rectangle around both; one without pixels does not count.
    pub fn around(self, other: Self) -> Self {
        if self.is_empty() || other.is_empty() {
            return if self.is_empty() { other } else { self };
        }
        let side = |a: [i64; 2], b: [i64; 2]| [a[0].min(b[0]), a[1].max(b[1])];
        Self { x: side(self.x, other.x), y: side(self.y, other.y) }
    }
}
