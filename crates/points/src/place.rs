//! What stands at a path where a file is asked for. Whoever opens one that was named asks first: a pipe that nobody
//! writes to lets whoever opens it wait for ever, a device may never end.

use std::fs::FileType;
use std::io;
use std::path::Path;

/// What stands at `path` in place of a file, and what to do; `None` where it is a file.
///
/// # Errors
/// Where nothing stands there, or the system does not say.
pub fn no_file_at(path: &Path) -> io::Result<Option<&'static str>> {
    let kind = path.metadata()?.file_type();
    Ok(match kind {
        _ if kind.is_file() => None,
        _ if kind.is_dir() => Some("is a folder; name the files in it"),
        _ => Some(special(kind)),
    })
}

#[cfg(unix)]
fn special(kind: FileType) -> &'static str {
    use std::os::unix::fs::FileTypeExt;
    match () {
        () if kind.is_fifo() => {
            "is a pipe, not a file: save what comes out of it to a file first, and name that"
        }
        () if kind.is_socket() => "is a socket, not a file",
        () => "is a device, not a file: save what it holds to a file first, and name that",
    }
}

#[cfg(not(unix))]
fn special(_kind: FileType) -> &'static str {
    "is no file: save what it holds to a file first, and name that"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_files_and_what_else_there_is_is_named() {
        let folder = std::env::temp_dir();
        assert!(no_file_at(&folder).unwrap().unwrap().contains("folder"));
        let program = std::env::current_exe().unwrap();
        assert_eq!(no_file_at(&program).unwrap(), None);
        no_file_at(&program.join("nowhere")).unwrap_err();
        #[cfg(unix)]
        assert!(no_file_at(Path::new("/dev/null")).unwrap().unwrap().contains("device"));
    }
}
