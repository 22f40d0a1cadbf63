//! Names of the drawing methods, for command lines and reports.

use esker_render::Method;

/// Each method with its name and a description, in the order of help texts.
pub const METHODS: [(Method, &str, &str); 3] = [
    (Method::Points, "points", "One pixel a point"),
    (Method::PullPush, "pull-push", "Surfaces closed by pull-push interpolation"),
    (
        Method::Ewa,
        "ewa",
        "Splats of exact perspective shape, filtered and blended: slower, of the highest quality",
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
        assert_eq!(method_of_name(DEFAULT_METHOD), Some(Method::PullPush));
        assert_eq!(method_of_name("guess"), None);
    }
}
