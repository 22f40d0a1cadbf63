//! Places: where the steps of a divided build keep what others need. A place has objects under
//! names such as `take/00003`. Small objects are created whole and never change: whoever creates
//! one first wins, and that is all that steps need to agree on. Large objects are streams that no
//! reader looks for: a small one names them once they are whole. Places below addresses are opened
//! by what [`set_remote`] was given (`esker_remote`).

use crate::address::whole;
use crate::read_at::ReadAt;
use std::io::{self, Write};
use std::path::Path;
use std::sync::{Arc, OnceLock};

/// Objects under names. Names are relative, of letters, digits, `/`, `-` and `.`.
pub trait Place: Send + Sync {
    /// Creates a small object, unless there is one of that name; returns whether it did. Others see
    /// all of it or nothing.
    ///
    /// # Errors
    /// If the place cannot be written, or cannot tell who is first.
    fn create(&self, name: &str, bytes: &[u8]) -> io::Result<bool>;

    /// Reads an object of at most `bytes_max` bytes; `None` if there is none.
    ///
    /// # Errors
    /// If it cannot be read, or is larger.
    fn read(&self, name: &str, bytes_max: u64) -> io::Result<Option<Vec<u8>>>;

    /// Begins a large object. No other writer may use its name.
    ///
    /// # Errors
    /// If the place cannot be written.
    fn begin(&self, name: &str) -> io::Result<Box<dyn Upload>>;

    /// Opens an object for reads of parts of it.
    ///
    /// # Errors
    /// [`std::io::ErrorKind::NotFound`] if there is none; if it cannot be read.
    fn open(&self, name: &str) -> io::Result<Arc<dyn ReadAt>>;

    /// All objects whose names begin with `prefix`, in order of names.
    ///
    /// # Errors
    /// If the place cannot be read.
    fn list(&self, prefix: &str) -> io::Result<Vec<Listed>>;

    /// Removes an object; one that is not there is no error.
    ///
    /// # Errors
    /// If the place cannot be written.
    fn remove(&self, name: &str) -> io::Result<()>;

    /// The place as the user names it.
    fn shown(&self) -> String;
}

/// A large object being written. Dropped before its end it is removed.
pub trait Upload: Write + Send + Sync {
    /// Ends the object; all bytes are safe after that.
    ///
    /// # Errors
    /// If the place is full.
    fn finish(self: Box<Self>) -> io::Result<()>;
}

/// An object of a list.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Listed {
    /// Its name.
    pub name: String,
    /// Its bytes.
    pub bytes: u64,
}

/// Opens the place below an address.
pub type Opener = Box<dyn Fn(&str) -> io::Result<Box<dyn Place>> + Send + Sync>;

static REMOTE: OnceLock<Opener> = OnceLock::new();

/// Sets what opens places below addresses, for the whole process. The first one stays.
pub fn set_remote(opener: Opener) {
    let _ = REMOTE.set(opener);
}

/// Opens the place below an address, such as `s3://bucket/work`; nothing is read or written.
///
/// # Errors
/// If the address cannot have a place, or nothing in this program opens such places.
pub fn at(address: &Path) -> io::Result<Box<dyn Place>> {
    let none = || {
        io::Error::other(
            "this program cannot write to addresses: build it with `--features remote`, or choose \
             a folder",
        )
    };
    let address = whole(address);
    REMOTE.get().ok_or_else(none)?(address.to_str().unwrap_or_default())
}

/// Splits the address of an object into that of a place and its name there; `None` if there is no
/// name.
pub fn split(address: &Path) -> Option<(&Path, &str)> {
    let (place, name) = address.to_str()?.rsplit_once('/')?;
    let is_named = !name.is_empty() && !place.ends_with('/');
    is_named.then(|| (Path::new(place), name))
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests may panic")]
mod tests {
    use super::*;

    #[test]
    fn addresses_of_objects_have_a_place_and_a_name() {
        let parts = |address: &'static str| split(Path::new(address));
        let (place, name) = parts("s3://bucket/a/town.esker").unwrap();
        assert_eq!((place, name), (Path::new("s3://bucket/a"), "town.esker"));
        assert_eq!(parts("s3://bucket/town.esker").unwrap().0, Path::new("s3://bucket"));
        for address in ["s3://bucket", "s3://bucket/", "s3://bucket/a//b", "town.esker"] {
            assert_eq!(parts(address), None, "{address}");
        }
    }

    #[test]
    fn programs_that_open_no_addresses_say_how_to_get_them() {
        let error = at(Path::new("s3://bucket/work")).err().unwrap().to_string();
        assert!(error.contains("--features remote") && error.contains("a folder"), "{error}");
    }
}
