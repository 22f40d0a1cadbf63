//! Pictures to PNG files, complete or not at all.

use crate::draw::method::Method;
use crate::io::output;
use crate::io::quantity::readable_bytes;
use anyhow::{Context, Result, ensure};
use esker_builder::budget::memory;
use esker_render::Picture;
use std::io::{BufWriter, Write};
use std::path::Path;

/// Refuses a name with the extension of another format.
///
/// # Errors
/// If `path` has an extension that is not `png`.
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

/// Refuses a picture that the machine has too little memory for, before any work.
///
/// # Errors
/// If the CPU renderer needs more memory than the machine grants.
pub fn check_size([width, height]: [u32; 2], method: Method) -> Result<()> {
    check_bytes([width, height], method, memory::granted().unwrap_or(u64::MAX))
}

/// Bytes a pixel of lit pictures: guides, light and albedo of the pixel's rays, the filter's sums.
const LIT_PIXEL_BYTES: u64 = 400;

/// Bytes a pixel of the CPU renderer, measured at 36 million pixels, and the name of the method.
fn pixel_bytes(method: Method) -> (u64, &'static str) {
    match method {
        Method::Points => (15, "points"),
        Method::Auto => (105, "auto"),
        Method::PullPush => (85, "pull-push"),
        Method::Ewa => (31, "ewa"),
        Method::Lit => (LIT_PIXEL_BYTES, "lit"),
    }
}

/// Memory of points, threads and the program beside a large picture, in bytes.
const BESIDE_BYTES: u64 = 768 << 20;

fn check_bytes([width, height]: [u32; 2], method: Method, granted: u64) -> Result<()> {
    let (each, name) = pixel_bytes(method);
    let bytes = u64::from(width) * u64::from(height) * each;
    // Small pictures are drawn in whatever there is.
    let beside = if bytes > BESIDE_BYTES { BESIDE_BYTES } else { 0 };
    let bytes = bytes.saturating_add(beside);
    ensure!(
        bytes <= granted,
        "a picture of {width}x{height} pixels by {} takes {} of memory, and {} are granted; make it smaller, or choose another --method",
        name,
        readable_bytes(bytes),
        readable_bytes(granted)
    );
    Ok(())
}

/// Writes a picture under a temporary name beside `path`, then renames it.
///
/// # Errors
/// If the file cannot be written.
pub fn write_png(picture: &Picture, path: &Path) -> Result<()> {
    let context = || format!("{}: cannot write the picture", path.display());
    let mut file =
        tempfile::NamedTempFile::new_in(output::folder_of(path)).with_context(context)?;
    {
        let mut out = BufWriter::new(file.as_file_mut());
        encode(picture, &mut out).with_context(context)?;
        out.flush().with_context(context)?;
    }
    readable_by_all(file.as_file()).with_context(context)?;
    file.persist(path).with_context(context)?;
    Ok(())
}

/// The bytes of a picture as a PNG file.
///
/// # Errors
/// If it has not four bytes a pixel, or no pixel.
pub fn encode_png(picture: &Picture) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    encode(picture, &mut bytes)?;
    Ok(bytes)
}

fn encode(picture: &Picture, out: impl Write) -> Result<()> {
    let mut encoder = png::Encoder::new(out, picture.width, picture.height);
    encoder.set_color(png::ColorType::Rgba);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(&picture.rgba)?;
    writer.finish()?;
    Ok(())
}

/// Gives a file the permissions of a new one: temporary files are private.
#[cfg(unix)]
pub(crate) fn readable_by_all(file: &std::fs::File) -> std::io::Result<()> {
    use std::os::unix::fs::PermissionsExt;
    file.set_permissions(std::fs::Permissions::from_mode(0o644))
}

#[cfg(not(unix))]
pub(crate) fn readable_by_all(_file: &std::fs::File) -> std::io::Result<()> {
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_that_needs_too_much_memory_is_refused() {
        let refused = |size, method| check_bytes(size, method, 1 << 30).map_err(|e| e.to_string());
        assert!(refused([3000, 3000], Method::PullPush).is_ok());
        let error = refused([4000, 4000], Method::PullPush).unwrap_err();
        assert!(error.contains("4000x4000 pixels by pull-push takes 2.0 GiB"), "{error}");
        assert!(refused([4000, 4000], Method::Ewa).is_ok());
        // It leaves room for everything else.
        assert!(refused([3500, 3500], Method::PullPush).is_err());
        assert!(check_size([1, 1], Method::PullPush).is_ok());
    }
}
