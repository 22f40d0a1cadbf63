//! Passes from points to a picture: project, pull, push, shade.
