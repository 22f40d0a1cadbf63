//! Addresses among the names of files, as `https://host/town.esker`: which names are addresses,
//! what of them is shown, and which files lie beside one. Passwords and signatures in an address
//! are kept for its requests alone: messages, reports and documents have what [`shown`] leaves.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fmt::Write;
use std::path::{Component, Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// Whether a path is an address: begins with a scheme, as `https://`.
pub fn is_remote(path: &Path) -> bool {
    let Some((scheme, _)) = path.to_str().and_then(|text| text.split_once("://")) else {
        return false;
    };
    let is_of_scheme = |c: char| c.is_ascii_alphanumeric() || matches!(c, '+' | '-' | '.');
    scheme.starts_with(|c: char| c.is_ascii_alphabetic()) && scheme.chars().all(is_of_scheme)
}

/// Path of a file that a file at `path` names relative to its folder. Addresses have `/` between
/// names on all systems, and `%` before the codes of letters that would mean something else.
pub fn beside(path: &Path, name: &str) -> PathBuf {
    match path.to_str().filter(|_| is_remote(path)).and_then(|text| text.rsplit_once('/')) {
        Some((folder, _)) => format!("{folder}/{}", encoded(name)).into(),
        None => path.parent().unwrap_or(Path::new("")).join(name),
    }
}

/// Whether a name stays in its folder or below, however often a server decodes it: no step
/// upwards, no other host, no second meaning of a letter.
pub fn is_below(name: &str) -> bool {
    let decoded = decoded(&decoded(name));
    let is_step = |part: &str| part.is_empty() || part == "." || part == "..";
    let is_plain = |text: &str| {
        !text.contains(['\\', '\0', '\r', '\n', '\t']) && !text.split('/').any(is_step)
    };
    let stays = |c| matches!(c, Component::Normal(_));
    // An encoded `/` or `\` is no part of a name.
    let has_as_many = decoded.matches('/').count() == name.matches('/').count();
    is_plain(name) && is_plain(&decoded) && has_as_many && Path::new(name).components().all(stays)
}

/// Letters that stand for themselves between the `/` of an address.
fn is_literal(byte: u8) -> bool {
    byte.is_ascii_alphanumeric() || b"-._~/!$&'()*+,;=:@".contains(&byte)
}

fn encoded(name: &str) -> String {
    let mut text = String::with_capacity(name.len());
    for byte in name.bytes() {
        if is_literal(byte) {
            text.push(byte.into());
        } else {
            let _ = write!(text, "%{byte:02X}");
        }
    }
    text
}

/// Replaces the codes of letters that have a meaning in paths.
fn decoded(name: &str) -> String {
    let mut text = name.to_owned();
    for (code, letter) in [("%2e", "."), ("%2f", "/"), ("%5c", "\\"), ("%00", "\0"), ("%25", "%")] {
        text = text.replace(code, letter).replace(&code.to_ascii_uppercase(), letter);
    }
    text
}

/// Whole addresses of this process, by what is shown of them.
static WHOLE: Mutex<BTreeMap<String, String>> = Mutex::new(BTreeMap::new());

/// An address without what may be secret: user, password, query and fragment. They are kept for
/// [`whole`]. Other paths, and what was shown before, stay as they are. Addresses that differ in
/// secrets alone get numbers.
pub fn shown(path: &Path) -> PathBuf {
    let Some(address) = path.to_str().filter(|_| is_remote(path)) else { return path.to_owned() };
    let mut all = WHOLE.lock().unwrap_or_else(PoisonError::into_inner);
    if all.contains_key(address) {
        return path.to_owned();
    }
    let plain = without_secrets(address);
    let mut name = plain.clone();
    for number in 2.. {
        match all.get(&name) {
            Some(other) if other != address => name = format!("{plain}?{number}"),
            _ => break,
        }
    }
    all.insert(name.clone(), address.to_owned());
    name.into()
}

/// The whole of an address of which [`shown`] left a part; any other path as it is.
pub fn whole(path: &Path) -> PathBuf {
    let all = WHOLE.lock().unwrap_or_else(PoisonError::into_inner);
    path.to_str().and_then(|text| all.get(text)).map_or_else(|| path.to_owned(), PathBuf::from)
}

/// [`shown`] for an argument of the command line: an address, or an option with one behind `=`.
pub fn shown_argument(argument: OsString) -> OsString {
    let option = argument.to_str().and_then(|text| text.split_once('='));
    match option.filter(|(name, _)| name.starts_with('-')) {
        Some((name, value)) if is_remote(Path::new(value)) => {
            let mut text = OsString::from(format!("{name}="));
            text.push(shown(Path::new(value)));
            text
        }
        _ => shown(Path::new(&argument)).into(),
    }
}

fn without_secrets(address: &str) -> String {
    let Some((scheme, rest)) = address.split_once("://") else { return address.to_owned() };
    let host = &rest[..rest.find(['/', '\\', '?', '#']).unwrap_or(rest.len())];
    let port = host.rsplit(']').next().and_then(|host| host.split_once(':'));
    let has_port = port.is_none_or(|(_, port)| port.bytes().all(|byte| byte.is_ascii_digit()));
    // A password that is not encoded may have any letter; then the host follows the last `@`.
    let start = match host.rfind('@') {
        Some(at) => at + 1,
        None if has_port => 0,
        None => rest.rfind('@').map_or(0, |at| at + 1),
    };
    let rest = &rest[start..];
    format!("{scheme}://{}", &rest[..rest.find(['?', '#']).unwrap_or(rest.len())])
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests may panic")]
mod tests {
    use super::*;

    #[test]
    fn addresses_begin_with_a_scheme_and_nothing_else_does() {
        for address in ["https://host/town.esker", "s3://bucket/a", "gs://b/c", "az://b/c"] {
            assert!(is_remote(Path::new(address)), "{address}");
        }
        for path in
            ["town.esker", "/a/b", "C:\\a", "a b://c", "://a", "1a://b", "synthetic:office:1M:1"]
        {
            assert!(!is_remote(Path::new(path)), "{path}");
        }
    }

    #[test]
    fn names_lie_beside_the_file_that_names_them() {
        let of = |path: &str, name| beside(Path::new(path), name).to_str().unwrap().to_owned();
        assert_eq!(of("https://host/a/town.esker", "b/c.esker"), "https://host/a/b/c.esker");
        assert_eq!(of("http://host/t", "b c/50%#1?.esker"), "http://host/b%20c/50%25%231%3F.esker");
        assert_eq!(of("a/town.esker", "c d.esker"), "a/c d.esker");
        assert_eq!(of("town.esker", "c.esker"), "c.esker");
    }

    #[test]
    fn names_that_lead_elsewhere_are_not_below() {
        for name in ["a.esker", "b/c d.esker", "50%.esker", "a..b/...c", "é/ü.esker"] {
            assert!(is_below(name), "{name}");
        }
        for name in [
            "",
            "/a.esker",
            "//other/a.esker",
            "../a.esker",
            "b/../../a.esker",
            "./a.esker",
            "b//a.esker",
            "https://other/a.esker",
            "%2e%2e/a.esker",
            "%2E./a.esker",
            "%252e%252e/a.esker",
            "b/%2e%2e%2fa.esker",
            "..%2fa.esker",
            "..%5Ca.esker",
            "..\\a.esker",
            "a\nb.esker",
        ] {
            assert!(!is_below(name), "{name}");
        }
    }

    #[test]
    fn secrets_of_addresses_are_not_shown_and_come_back_for_requests() {
        for (address, seen) in [
            ("https://host/a.esker?sig=secret", "https://host/a.esker"),
            ("https://host/b.esker#secret", "https://host/b.esker"),
            ("https://user:secret@host:80/c.esker?x", "https://host:80/c.esker"),
            ("https://secret@[::1]:80/d.esker", "https://[::1]:80/d.esker"),
            ("https://user:se/c?r#et@host/e.esker", "https://host/e.esker"),
            ("https://user:sec@ret@host/f.esker", "https://host/f.esker"),
            ("https://host/g@1.esker", "https://host/g@1.esker"),
            ("https://host?secret", "https://host"),
        ] {
            let name = shown(Path::new(address));
            assert_eq!(name, Path::new(seen));
            assert_eq!(whole(&name), Path::new(address));
            assert_eq!(shown(&name), name, "shown once more");
        }
        let other = shown(Path::new("https://host/a.esker?sig=other"));
        assert_eq!(other, Path::new("https://host/a.esker?2"));
        assert_eq!(whole(&other), Path::new("https://host/a.esker?sig=other"));
        assert_eq!(whole(Path::new("https://host/a.esker")).to_str().unwrap().len(), 31);
        for path in ["a?b.esker", "/x/y@z"] {
            assert_eq!(shown(Path::new(path)), Path::new(path));
            assert_eq!(whole(Path::new(path)), Path::new(path));
        }
    }

    #[test]
    fn arguments_are_shown_without_secrets_too() {
        for (argument, seen) in [
            ("--against=https://host/h.laz?secret", "--against=https://host/h.laz"),
            ("https://host/i.laz?a=b", "https://host/i.laz"),
            ("--colour=rgb", "--colour=rgb"),
            ("a=b", "a=b"),
        ] {
            assert_eq!(shown_argument(argument.into()), seen);
        }
    }
}
