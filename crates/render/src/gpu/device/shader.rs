//! The shaders, as they were linked and validated when the crate was built, and the check that a structure
//! has the same layout on both sides.

use crate::gpu::device::error::GpuError;
use crate::gpu::device::link::link;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// A linked shader.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Source {
    /// Its file, relative to `shaders/`.
    pub file: &'static str,
    /// Its text.
    pub wgsl: &'static str,
}

/// All shaders and the layouts of their structures; written by `build.rs`.
pub mod sources {
    use super::Source;
    include!(concat!(env!("OUT_DIR"), "/shaders.rs"));
}

/// Refuses to build where a `repr(C)` structure does not lie as the shader's of the same name does.
/// `same_layout!(Draw { base, shift });`
#[macro_export]
macro_rules! same_layout {
    ($name:ident { $($member:ident),* $(,)? }) => {
        const _: () = {
            use $crate::gpu::device::shader::sources::layout::$name as shader;
            assert!(size_of::<$name>() == shader::SIZE, "size");
            $(assert!(std::mem::offset_of!($name, $member) == shader::$member, stringify!($member));)*
        };
    };
}

/// The environment's name for a folder of shaders that are reloaded when they change, in release runs too.
pub const FOLDER: &str = "ESKER_SHADERS";

/// Where the shaders lie that are reloaded when they change: where the environment says, or in the source tree,
/// if this is a debug run on the machine that built it.
pub fn folder() -> Option<PathBuf> {
    if let Some(folder) = std::env::var_os(FOLDER) {
        return Some(folder.into());
    }
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shaders");
    (cfg!(debug_assertions) && folder.is_dir()).then_some(folder)
}

impl Source {
    /// The shader as it lies on the disk, with the time of its newest file.
    ///
    /// # Errors
    /// Which file cannot be read.
    pub fn read(&self, folder: &Path) -> Result<(String, Option<SystemTime>), GpuError> {
        let (text, files) = link(folder, self.file).map_err(GpuError::Shader)?;
        let changed = files.iter().filter_map(|f| f.metadata().ok()?.modified().ok()).max();
        Ok((text, changed))
    }
}
