//! Why no picture could be drawn. Points and planes never cause an error: any bits are a harmless
//! picture. Only the view can ask for what cannot be.

/// Why no picture could be drawn.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RenderError {
    /// No pixels, or more than the passes are made for.
    #[error(
        "a picture of {width} x {height} pixels cannot be drawn; give 1 to {side} on each side and at \
         most {pixels} in all"
    )]
    Size {
        /// Width asked for.
        width: u32,
        /// Height asked for.
        height: u32,
        /// Most pixels on a side.
        side: u32,
        /// Most pixels in all.
        pixels: u64,
    },
    /// An eye, direction, field of view or near plane that is no usable number.
    #[error("the camera's {what} is no usable number; give a finite eye, target and field of view")]
    Camera {
        /// Which value.
        what: &'static str,
    },
}
