//! Drawing methods as users choose them, with their names for command lines and reports. The
//! passes of a renderer draw all of them but light, which is traced (`crate::light`).

use esker_render::{Dots, Method as Passes, PointSize};

/// How points become a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Method {
    /// Surfaces by pull-push interpolation where points are near each other on the picture and lie
    /// on surfaces, and round dots elsewhere ([`esker_render::Frame::mixes_dots`]).
    #[default]
    Auto,
    /// Points alone, without lighting.
    Points,
    /// Surfaces closed by pull-push interpolation (`marroquim2007`).
    PullPush,
    /// Splats of exact perspective shape, filtered and blended (`zwicker2004`).
    Ewa,
    /// Splats lit by lights of the user, by path tracing (`bauszat2011`).
    Lit,
}

impl Method {
    /// Passes that draw the picture. Lit pictures trace the splats that EWA draws, so that they
    /// choose and read what EWA does.
    pub fn passes(self) -> Passes {
        match self {
            Self::Points => Passes::Points,
            Self::Auto | Self::PullPush => Passes::PullPush,
            Self::Ewa | Self::Lit => Passes::Ewa,
        }
    }
}

/// Dots of [`Method::Auto`]: their eye-dome lighting is weaker than for points alone, since they
/// stand among lit surfaces.
pub const AUTO_DOTS: Dots = Dots { size: PointSize::Adaptive, eye_dome: 0.5 };

/// Each method with its name and a description, in the order of help texts.
pub const METHODS: [(Method, &str, &str); 5] = [
    (Method::Auto, "auto", "Surfaces where points are near each other, round points elsewhere"),
    (Method::Points, "points", "Points alone"),
    (Method::PullPush, "pull-push", "Surfaces closed by pull-push interpolation"),
    (
        Method::Ewa,
        "ewa",
        "Splats of exact perspective shape, filtered and blended: slower, of the highest quality",
    ),
    (
        Method::Lit,
        "lit",
        "Splats under sun, sky and lamps, with shadows and bounced light: slowest",
    ),
];

/// Name of the default method.
pub const DEFAULT_METHOD: &str = "auto";

/// The method called `name`, if there is one.
pub fn method_of_name(name: &str) -> Option<Method> {
    METHODS.iter().find(|(_, own, _)| *own == name).map(|&(method, ..)| method)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_is_a_method() {
        assert_eq!(method_of_name(DEFAULT_METHOD), Some(Method::default()));
        assert_eq!(method_of_name("guess"), None);
    }
}
