//! Paths of a document: from its folder, and back. Generated scans have no place, and addresses
//! stay as they are, without secrets.

use anyhow::{Context, Result};
use esker_points::address::{self, is_remote};
use esker_scan::synthetic::is_spec;
use std::path::{Path, PathBuf};

/// Path of a file that a document in `folder` names.
pub(super) fn placed(name: &str, folder: &Path) -> PathBuf {
    let path = Path::new(name);
    if is_spec(path) || is_remote(path) { address::shown(path) } else { folder.join(path) }
}

/// Name of the file at `path` in a document in `folder`: relative, also upwards; absolute where no
/// path leads from one to the other.
///
/// # Errors
/// If the file or the folder does not exist, or the name is no Unicode.
pub(super) fn named(path: &Path, folder: &Path) -> Result<String> {
    let shown = path.display();
    let text = |path: &Path| {
        let name = path.to_str().map(str::to_owned);
        name.with_context(|| {
            format!(
                "{shown}: the name is no Unicode, which a scene document cannot hold; rename it"
            )
        })
    };
    if is_spec(path) || is_remote(path) {
        return text(&address::shown(path));
    }
    // Links to files keep their own names and places.
    let resolved = |path: &Path| match (path.parent(), path.file_name()) {
        (Some(parent), Some(name)) => {
            let parent = if parent == Path::new("") { Path::new(".") } else { parent };
            path.metadata()?;
            parent.canonicalize().map(|parent| parent.join(name))
        }
        _ => path.canonicalize(),
    };
    let place = resolved(path).with_context(|| format!("{shown}: cannot open"))?;
    let folder = if folder == Path::new("") { Path::new(".") } else { folder };
    let base = folder
        .canonicalize()
        .with_context(|| format!("{}: cannot open the folder", folder.display()))?;
    let relative = pathdiff::diff_paths(&place, &base).unwrap_or(place);
    let name = text(&relative)?;
    let name =
        if relative.is_relative() { name.replace(std::path::MAIN_SEPARATOR, "/") } else { name };
    Ok(if name.is_empty() { ".".into() } else { name })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_leads_from_the_document_to_the_file() {
        let root = tempfile::tempdir().unwrap();
        let [scans, scenes] = ["scans", "my scenes"].map(|name| root.path().join(name));
        std::fs::create_dir_all(&scans).unwrap();
        std::fs::create_dir_all(&scenes).unwrap();
        let scan = scans.join("a b.laz");
        std::fs::write(&scan, "x").unwrap();
        assert_eq!(named(&scan, &scans).unwrap(), "a b.laz");
        assert_eq!(named(&scan, root.path()).unwrap(), "scans/a b.laz");
        let up = named(&scan, &scenes).unwrap();
        assert_eq!(up, "../scans/a b.laz");
        let found = placed(&up, &scenes).canonicalize().unwrap();
        assert_eq!(found, scan.canonicalize().unwrap());
        assert_eq!(named(&scans, &scans).unwrap(), ".");
        let generated = Path::new("synthetic:office:1k:1");
        assert_eq!(placed(&named(generated, &scans).unwrap(), &scenes), generated);
        let address = Path::new("https://host/places/a b.esker?signature");
        let there = Path::new("https://host/places/a b.esker");
        assert_eq!(named(address, &scans).unwrap(), there.to_str().unwrap());
        assert_eq!(placed(there.to_str().unwrap(), &scenes), there);
        let fault = format!("{:#}", named(&scans.join("none.laz"), &scans).unwrap_err());
        assert!(fault.contains("none.laz: cannot open"), "{fault}");
    }
}
