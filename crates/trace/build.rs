//! Links and validates the shaders of light and generates `shaders.rs` from them, as the build
//! script of `esker-render` does for its own.

#[path = "../render/build/shaders.rs"]
mod shaders;

use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    shaders::generate(|folder| ["filter", "trace"].contains(&folder))
}
