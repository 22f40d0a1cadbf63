//! Compares the pictures of a view with a thing and without it, and judges whether the thing was
//! needed.

use esker_render::Picture;
use esker_truth::flip::mean_flip;
use serde::Serialize;

/// Difference of a channel beyond which a pixel is off, of 255.
const OFF: u8 = 8;
/// Share of changed pixels below which a thing that was there was not needed.
const NEEDED_SHARE: f64 = 1e-3;

/// How two pictures of the same size differ.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(super) struct Difference {
    /// Share of the pixels of which any channel differs.
    pub changed_share: f64,
    /// Share of the pixels of which any channel differs by more than [`OFF`].
    pub off_share: f64,
    /// Mean of the metric FLIP, 0 to 1.
    pub flip: f64,
}

impl Difference {
    /// Compares the colours of two pictures.
    pub fn of(a: &Picture, b: &Picture) -> Self {
        if a.rgba == b.rgba {
            return Self { changed_share: 0.0, off_share: 0.0, flip: 0.0 };
        }
        let pixels = || a.rgba.as_chunks::<4>().0.iter().zip(b.rgba.as_chunks::<4>().0);
        let differs = |by: u8| {
            let off = |a: &[u8; 4], b: &[u8; 4]| a.iter().zip(b).any(|(a, b)| a.abs_diff(*b) > by);
            pixels().filter(|(a, b)| off(a, b)).count() as f64 / pixels().len().max(1) as f64
        };
        let flip = mean_flip(&a.rgba, &b.rgba, a.width as usize);
        Self { changed_share: differs(0), off_share: differs(OFF), flip }
    }

    /// Whether all pixels are equal, bit for bit.
    pub fn is_equal(&self) -> bool {
        self.changed_share == 0.0
    }
}

/// Who leaves a thing out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum LeftOutBy {
    /// The user, who asks for another picture.
    Request,
    /// The program by a rule, which finds it unneeded but promises no equal picture.
    Rule,
}

/// Whether a thing was needed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub(super) enum Verdict {
    /// It changes the picture.
    #[serde(rename = "needed")]
    Needed,
    /// It was left out, and the picture is the same with it.
    #[serde(rename = "not needed, left out")]
    LeftOut,
    /// It was there, and the picture is nearly the same without it.
    #[serde(rename = "ran, not needed")]
    Idle,
    /// It was left out as not needed, and the picture is another with it.
    #[serde(rename = "fault")]
    Fault,
}

impl Verdict {
    /// Judges a thing by the `differences` of pictures with it and without it. It was left out of
    /// the frame if `is_left_out`.
    pub fn of(differences: impl IntoIterator<Item = Difference>, is_left_out: bool) -> Self {
        let most = differences.into_iter().map(|d| d.changed_share).fold(0.0, f64::max);
        match is_left_out {
            true if most == 0.0 => Self::LeftOut,
            true => Self::Fault,
            false if most >= NEEDED_SHARE => Self::Needed,
            false => Self::Idle,
        }
    }

    /// The verdict in words.
    pub fn text(self) -> &'static str {
        match self {
            Self::Needed => "needed",
            Self::LeftOut => "not needed, left out",
            Self::Idle => "ran, not needed",
            Self::Fault => "FAULT: it was left out, but the picture changes",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(values: [u8; 4]) -> Picture {
        let rgba = values.iter().flat_map(|v| [10, *v, 10, 255]).collect();
        Picture { width: 2, height: 2, rgba, ..Picture::default() }
    }

    #[test]
    fn shares_count_pixels_of_which_a_channel_differs() {
        let plain = picture([10; 4]);
        let equal = Difference::of(&plain, &plain.clone());
        assert!(equal.is_equal() && equal.flip == 0.0);
        let other = Difference::of(&plain, &picture([10, 18, 19, 200]));
        assert_eq!((other.changed_share, other.off_share), (0.75, 0.5));
        assert!(other.flip > 0.01 && !other.is_equal());
    }

    #[test]
    fn what_is_left_out_must_not_change_a_pixel() {
        let by = |changed_share| Difference { changed_share, off_share: 0.0, flip: 0.0 };
        let verdict = |share: f64, left_out| Verdict::of([by(0.0), by(share)], left_out);
        assert_eq!(verdict(0.0, true), Verdict::LeftOut);
        assert_eq!(verdict(1e-9, true), Verdict::Fault);
        assert_eq!(verdict(9e-4, false), Verdict::Idle);
        assert_eq!(verdict(1e-3, false), Verdict::Needed);
    }
}
