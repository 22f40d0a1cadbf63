//! What the objects of a place share: the clients that read and write them, the path of the place,
//! and the blocks of the few objects that were read last.

use crate::address::Bucket;
use crate::fetch::{Fault, Fetcher, Patience};
use crate::pool::Pool;
use crate::secrets;
use crate::source::Remote;
use crate::threads::finish;
use object_store::path::Path;
use object_store::{Error, ObjectMeta, ObjectStore};
use std::io;
use std::sync::{Arc, Mutex, PoisonError};

/// Objects with blocks in memory. A job may have thousands open, and each has a megabyte at least.
const WITH_BLOCKS: usize = 8;

/// Where the objects of a place are.
pub(super) struct Store {
    pub reads: Arc<dyn ObjectStore>,
    pub writes: Arc<dyn Bucket>,
    /// Path of the place in its bucket.
    pub base: Path,
    pub pool: Arc<Pool>,
    /// Objects with blocks in memory, of which the last one was read last.
    with_blocks: Mutex<Vec<(ObjectMeta, Arc<Remote>)>>,
}

impl Store {
    /// The place at a path of a bucket, which is read and written by clients of their own.
    pub fn new(
        reads: Arc<dyn ObjectStore>,
        writes: Arc<dyn Bucket>,
        base: Path,
        pool: &Arc<Pool>,
    ) -> Self {
        Self { reads, writes, base, pool: Arc::clone(pool), with_blocks: Mutex::default() }
    }

    /// Path of an object. Codes in a name have the meaning that they have in addresses.
    pub fn path(&self, name: &str) -> io::Result<Path> {
        let invalid = |e| io::Error::new(io::ErrorKind::InvalidInput, format!("{name}: {e}"));
        let name = Path::from_url_path(name).map_err(invalid)?;
        Ok(name.parts().fold(self.base.clone(), Path::join))
    }

    /// Reads an object.
    pub fn fetcher(&self, path: Path) -> Fetcher {
        Fetcher::new(Arc::clone(&self.reads), path, self.pool.limits.answer)
    }

    /// Waits for a request that sends so many bytes.
    pub fn patience(&self, bytes: usize) -> Patience {
        Patience::of(bytes as u64, self.pool.limits.answer)
    }

    /// Waits for requests. No error has a secret.
    pub fn finish<T: Send + 'static>(
        &self,
        requests: impl Future<Output = Result<T, Fault>> + Send + 'static,
    ) -> io::Result<T> {
        let done = finish(&self.pool, requests).and_then(|done| done.map_err(io::Error::from));
        done.map_err(secrets::without)
    }

    /// The blocks of an object, in place of those of the object that was not read for longest.
    pub fn blocks(&self, meta: &ObjectMeta) -> Arc<Remote> {
        let mut all = self.with_blocks.lock().unwrap_or_else(PoisonError::into_inner);
        let found = all.iter().position(|(own, _)| own == meta);
        let one = found.map(|at| all.remove(at)).unwrap_or_else(|| {
            let fetcher = self.fetcher(meta.location.clone());
            (meta.clone(), Arc::new(Remote::over(fetcher, meta.clone(), None, &self.pool)))
        });
        let blocks = Arc::clone(&one.1);
        if all.len() == WITH_BLOCKS {
            all.remove(0);
        }
        all.push(one);
        blocks
    }
}

/// The fault of a request that writes.
pub(super) fn unwritten(error: Error) -> Fault {
    match error {
        Error::NotFound { .. } => Fault::Lasting(
            io::ErrorKind::NotFound,
            "there is no such bucket or container, or what was sent there was removed".into(),
        ),
        error => error.into(),
    }
}
