//! Drawing methods as users choose them, with their names for command lines and reports. The
//! passes of a renderer draw three of them; the fourth, light, is traced (`crate::light`).

use esker_render::Method as Passes;

/// How points become a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Method {
    /// One pixel a point, without lighting.
    Points,
    /// Surfaces closed by pull-push interpolation (`marroquim2007`).
    #[default]
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
            Self::PullPush => Passes::PullPush,
            Self::Ewa | Self::Lit => Passes::Ewa,
        }
    }
}

/// Each method with its name and a description, in the order of help texts.
pub const METHODS: [(Method, &str, &str); 4] = [
    (Method::Points, "points", "One pixel a point"),
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
pub const DEFAULT_METHOD: &str = "pull-push";

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
