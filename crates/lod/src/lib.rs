//! What to draw for a view: frustum, prefixes, budget; pure, without threads, files or GPU.

pub mod view;

pub use view::View;
