//! Links and validates the shaders of `shaders/`, but for those of other crates, and generates
//! `shaders.rs` from them (`build/shaders.rs`).

#[path = "build/shaders.rs"]
mod shaders;

use std::error::Error;

/// Folders of `shaders/` that the crate `esker-trace` links, so that programs without light contain
/// none of them.
const OF_OTHERS: [&str; 2] = ["filter", "trace"];

fn main() -> Result<(), Box<dyn Error>> {
    shaders::generate(|folder| !OF_OTHERS.contains(&folder))
}
