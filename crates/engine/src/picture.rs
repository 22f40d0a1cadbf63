//! Pictures to PNG files, whole or not at all.

use crate::output;
use anyhow::{Context, Result, ensure};
use esker_render::Picture;
use std::io::{BufWriter, Write};
use std::path::Path;

/// Refuses a name whose ending promises another format than PNG.
///
/// # Errors
/// As said.
pub fn check_name(path: &Path) -> Result<()> {
    let ending = path.extension();
    ensure!(
        ending.is_none_or(|ending| ending.eq_ignore_ascii_case("png")),
        "{}: pictures are written as PNG; name it {}",
        path.display(),
        path.with_extension("png").display()
    );
    Ok(())
}

/// Writes a picture under a temporary name beside `path`, then gives it its name.
///
/// # Errors
/// Where the file cannot be written.
pub fn write_png(picture: &Picture, path: &Path) -> Result<()> {
    let context = || format!("{}: cannot write the picture", path.display());
    let mut file =
        tempfile::NamedTempFile::new_in(output::folder_of(path)).with_context(context)?;
    {
        let mut out = BufWriter::new(file.as_file_mut());
        let mut encoder = png::Encoder::new(&mut out, picture.width, picture.height);
        encoder.set_color(png::ColorType::Rgba);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
        let mut writer = encoder.write_header().with_context(context)?;
        writer.write_image_data(&picture.rgba).with_context(context)?;
        writer.finish().with_context(context)?;
        out.flush().with_context(context)?;
    }
    readable_by_all(file.as_file()).with_context(context)?;
    file.persist(path).with_context(context)?;
    Ok(())
}

/// Temporary files are private; a picture has the rights of any new file.
#[cfg(unix)]
fn readable_by_all(file: &std::fs::File) -> std::io::Result<()> {
    use std::os::unix::fs::PermissionsExt;
    file.set_permissions(std::fs::Permissions::from_mode(0o644))
}

#[cfg(not(unix))]
fn readable_by_all(_file: &std::fs::File) -> std::io::Result<()> {
    Ok(())
}
