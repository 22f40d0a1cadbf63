//! The error of a frame. Points and planes never cause an error: any bits are drawn as a harmless
//! picture. Only a view can be invalid.

/// Reason why a picture cannot be drawn.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RenderError {
    /// The picture has no pixels, or more than the passes support.
    #[error(
        "a picture of {width} x {height} pixels cannot be drawn; give 1 to {side} on each side and at \
         most {pixels} in all"
    )]
    Size {
        /// Width of the view, pixels.
        width: u32,
        /// Height of the view, pixels.
        height: u32,
        /// Most pixels on a side.
        side: u32,
        /// Most pixels in all.
        pixels: u64,
    },
    /// The eye, direction, field of view or near plane of the view is not usable.
    #[error("the camera's {what} is no usable number; give a finite eye, target and field of view")]
    Camera {
        /// Name of the value.
        what: &'static str,
    },
}
