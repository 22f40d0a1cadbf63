//! Words for faults that the window shows: what the system says of a file, without its numbers, and
//! what to do.

use std::io::{Error, ErrorKind};

/// What the system adds to its text.
const NUMBER: &str = " (os error ";

/// Rewrites what the system says of files in `fault`: "No such file or directory (os error 2)".
pub fn in_words(fault: &str) -> String {
    let mut left = fault;
    let mut words = String::new();
    while let Some((before, after)) = left.split_once(NUMBER) {
        let Some((number, rest)) = after.split_once(')') else { break };
        let kind = number.parse().map(|number| Error::from_raw_os_error(number).kind());
        match kind.ok().and_then(remedy) {
            // The text of the system is what stands behind the last colon.
            Some(remedy) => {
                let told = before.rfind(": ").map_or(0, |colon| colon + 2);
                words += &before[..told];
                words += remedy;
            }
            None => words += before,
        }
        left = rest;
    }
    words + left
}

/// What happened and what to do, for kinds that people meet.
fn remedy(kind: ErrorKind) -> Option<&'static str> {
    Some(match kind {
        ErrorKind::NotFound => "there is no such file or folder; was it moved or renamed?",
        ErrorKind::PermissionDenied => {
            "you may not use this file or folder; change its permissions, or choose another one"
        }
        ErrorKind::StorageFull | ErrorKind::QuotaExceeded => {
            "the disk is full; free some space, or choose another folder by --scratch"
        }
        ErrorKind::ReadOnlyFilesystem => "nothing can be written there; choose another folder",
        ErrorKind::IsADirectory => "this is a folder, not a file",
        ErrorKind::NotADirectory => "a part of this path is a file, not a folder",
        ErrorKind::AlreadyExists => "there is such a file already; remove it first",
        ErrorKind::OutOfMemory => "there is not enough memory; close other programs",
        ErrorKind::StaleNetworkFileHandle | ErrorKind::TimedOut | ErrorKind::HostUnreachable => {
            "the disk or the network does not answer; is it still connected?"
        }
        _ => return None,
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests may panic")]
mod tests {
    use super::*;

    #[test]
    fn faults_of_files_are_said_in_words() {
        let missing = std::fs::File::open("no/such/file.las").unwrap_err();
        let shown = in_words(&format!("no/such/file.las: cannot open: {missing}"));
        let words = "there is no such file or folder; was it moved or renamed?";
        assert_eq!(shown, format!("no/such/file.las: cannot open: {words}"));
        assert_eq!(in_words(&missing.to_string()), words);
        let twice = in_words(&format!("a: {missing}; b: {missing}"));
        assert_eq!(twice, format!("a: {words}; b: {words}"));
        for number in 1..140 {
            let fault = Error::from_raw_os_error(number);
            let shown = in_words(&format!("town.las: {fault}, while it was read"));
            assert!(shown.starts_with("town.las: ") && !shown.contains("os error"), "{shown}");
            assert!(shown.ends_with(", while it was read"), "{shown}");
        }
        for other in ["town.las: damaged (os error ", "no colours", "", "(os error x)"] {
            assert!(in_words(other).starts_with(other.split(NUMBER).next().unwrap()), "{other}");
        }
    }
}
