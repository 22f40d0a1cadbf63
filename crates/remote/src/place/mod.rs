//! Places of divided builds in object storage ([`esker_points::objects`]): objects below a prefix
//! of a bucket. Small objects are created by a conditional put, by which the store itself decides
//! who is first; large ones are sent in parts ([`upload`]). Reads take the way of files at
//! addresses, but nothing is kept on the disk, and only a few objects have blocks in memory.

#[cfg(test)]
mod tests;
mod upload;

use crate::address::{Bucket, locate, locate_bucket};
use crate::fetch::{Fault, Fetcher, Patience};
use crate::pool::Pool;
use crate::secrets;
use crate::source::Remote;
use crate::threads::finish;
use bytes::Bytes;
use esker_points::address::shown;
use esker_points::objects::{Listed, Place, Upload};
use esker_points::read_at::ReadAt;
use futures_util::StreamExt;
use object_store::path::{Path, PathPart};
use object_store::{Error, ObjectMeta, ObjectStore, PutMode};
use std::io;
use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};
use upload::ObjectUpload;

/// Objects with blocks in memory. A job may have thousands open, and each has a megabyte at least.
const WITH_BLOCKS: usize = 8;
/// Requests for the pages of a list for which one waits together.
const LIST_PAGES: u32 = 20;

/// A place in object storage.
pub struct ObjectPlace {
    store: Arc<Store>,
    shown: String,
}

/// Where the objects of a place are.
struct Store {
    reads: Arc<dyn ObjectStore>,
    writes: Arc<dyn Bucket>,
    /// Path of the place in its bucket.
    base: Path,
    pool: Arc<Pool>,
    /// Objects with blocks in memory, of which the last one was read last.
    with_blocks: Mutex<Vec<(Path, Arc<Remote>)>>,
}

impl ObjectPlace {
    /// The place below an address, such as `s3://bucket/work`. Nothing is read or written.
    ///
    /// # Errors
    /// If the address is invalid, or does not name object storage that is known and configured.
    pub fn open(address: &str, pool: &Arc<Pool>) -> io::Result<Self> {
        let answer = pool.limits.answer;
        let (writes, base) = locate_bucket(address, answer)?;
        let (reads, _) = locate(address, answer)?;
        let shown = shown(std::path::Path::new(address)).display().to_string();
        Ok(Self::over(reads, writes, base, shown, pool))
    }

    fn over(
        reads: Arc<dyn ObjectStore>,
        writes: Arc<dyn Bucket>,
        base: Path,
        shown: String,
        pool: &Arc<Pool>,
    ) -> Self {
        let (pool, with_blocks) = (Arc::clone(pool), Mutex::default());
        Self { store: Arc::new(Store { reads, writes, base, pool, with_blocks }), shown }
    }
}

impl Store {
    /// Path of an object. Codes in a name have the meaning that they have in addresses.
    fn path(&self, name: &str) -> io::Result<Path> {
        let invalid = |e| io::Error::new(io::ErrorKind::InvalidInput, format!("{name}: {e}"));
        let name = Path::from_url_path(name).map_err(invalid)?;
        Ok(name.parts().fold(self.base.clone(), Path::join))
    }

    fn fetcher(&self, path: Path) -> Fetcher {
        Fetcher::new(Arc::clone(&self.reads), path, self.pool.limits.answer)
    }

    fn patience(&self, bytes: usize) -> Patience {
        Patience::of(bytes as u64, self.pool.limits.answer)
    }

    /// Waits for requests. No error has a secret.
    fn finish<T: Send + 'static>(
        &self,
        requests: impl Future<Output = Result<T, Fault>> + Send + 'static,
    ) -> io::Result<T> {
        let done = finish(&self.pool, requests).and_then(|done| done.map_err(io::Error::from));
        done.map_err(secrets::without)
    }

    /// The blocks of an object, in place of those of the object that was not read for longest.
    fn blocks(&self, path: &Path, meta: &ObjectMeta) -> Arc<Remote> {
        let mut all = self.with_blocks.lock().unwrap_or_else(PoisonError::into_inner);
        let found = all.iter().position(|(own, _)| own == path);
        let one = found.map(|at| all.remove(at)).unwrap_or_else(|| {
            let fetcher = self.fetcher(path.clone());
            (path.clone(), Arc::new(Remote::over(fetcher, meta.clone(), None, &self.pool)))
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
fn unwritten(error: Error) -> Fault {
    match error {
        Error::NotFound { .. } => Fault::Lasting(
            io::ErrorKind::NotFound,
            "there is no such bucket or container, or what was sent there was removed".into(),
        ),
        error => error.into(),
    }
}

impl Place for ObjectPlace {
    fn create(&self, name: &str, bytes: &[u8]) -> io::Result<bool> {
        let path = self.store.path(name)?;
        let bytes = Bytes::copy_from_slice(bytes);
        let (writes, patience) = (Arc::clone(&self.store.writes), self.store.patience(bytes.len()));
        let fetcher = Arc::new(self.store.fetcher(path.clone()));
        self.store.finish(patience.repeated(move |is_again| {
            let (writes, fetcher) = (Arc::clone(&writes), Arc::clone(&fetcher));
            let (path, bytes) = (path.clone(), bytes.clone());
            async move {
                match writes.put_opts(&path, bytes.clone().into(), PutMode::Create.into()).await {
                    Ok(_) => Ok(true),
                    Err(Error::AlreadyExists { .. }) => match fetcher.meta().await {
                        // The answer to an earlier request may have been lost.
                        Ok(meta) if is_again && meta.size == bytes.len() as u64 => {
                            Ok(fetcher.whole(meta.size).await?.is_some_and(|own| own == bytes))
                        }
                        Ok(_) => Ok(false),
                        // Stores also answer so while an earlier object is being removed.
                        Err(Fault::Lasting(io::ErrorKind::NotFound, what)) => {
                            Err(Fault::Passing(what))
                        }
                        Err(fault) => Err(fault),
                    },
                    Err(error) => Err(unwritten(error)),
                }
            }
        }))
    }

    fn read(&self, name: &str, bytes_max: u64) -> io::Result<Option<Vec<u8>>> {
        let fetcher = self.store.fetcher(self.store.path(name)?);
        self.store.finish(async move { fetcher.whole(bytes_max).await })
    }

    fn begin(&self, name: &str) -> io::Result<Box<dyn Upload>> {
        Ok(Box::new(ObjectUpload::new(Arc::clone(&self.store), self.store.path(name)?)))
    }

    fn open(&self, name: &str) -> io::Result<Arc<dyn ReadAt>> {
        let path = self.store.path(name)?;
        let fetcher = self.store.fetcher(path.clone());
        let meta = self.store.finish(async move { fetcher.meta().await })?;
        Ok(Arc::new(Object { store: Arc::clone(&self.store), path, meta }))
    }

    fn list(&self, prefix: &str) -> io::Result<Vec<Listed>> {
        let (folder, _) = prefix.rsplit_once('/').unwrap_or(("", prefix));
        let folder = self.store.path(folder)?;
        let (reads, base) = (Arc::clone(&self.store.reads), self.store.base.clone());
        let patience = self.store.patience(0).times(LIST_PAGES);
        let all = self.store.finish(patience.repeated(move |_| {
            let (reads, folder) = (Arc::clone(&reads), folder.clone());
            let folder = (!folder.is_root()).then_some(folder);
            async move { Ok(reads.list_with_delimiter(folder.as_ref()).await?.objects) }
        }))?;
        let listed = |object: ObjectMeta| {
            let parts = object.location.prefix_match(&base)?;
            let parts: Vec<PathPart<'_>> = parts.collect();
            let names: Vec<&str> = parts.iter().map(AsRef::as_ref).collect();
            let name = names.join("/");
            name.starts_with(prefix).then_some(Listed { name, bytes: object.size })
        };
        let mut listed: Vec<Listed> = all.into_iter().filter_map(listed).collect();
        listed.sort_unstable();
        Ok(listed)
    }

    fn remove(&self, name: &str) -> io::Result<()> {
        let path = self.store.path(name)?;
        let (writes, patience) = (Arc::clone(&self.store.writes), self.store.patience(0));
        self.store.finish(patience.repeated(move |_| {
            let (writes, path) = (Arc::clone(&writes), path.clone());
            async move {
                let path = futures_util::stream::once(async move { Ok(path) });
                match writes.delete_stream(path.boxed()).next().await {
                    None | Some(Ok(_) | Err(Error::NotFound { .. })) => Ok(()),
                    Some(Err(error)) => Err(error.into()),
                }
            }
        }))
    }

    fn shown(&self) -> String {
        self.shown.clone()
    }
}

/// An object that is read. Its size and version are those of when it was opened.
struct Object {
    store: Arc<Store>,
    path: Path,
    meta: ObjectMeta,
}

impl ReadAt for Object {
    fn read_exact_at(&self, buf: &mut [u8], offset: u64) -> io::Result<()> {
        let blocks = self.store.blocks(&self.path, &self.meta);
        blocks.read_exact_at(buf, offset).map_err(secrets::without)
    }

    fn bytes(&self) -> io::Result<u64> {
        Ok(self.meta.size)
    }

    fn will_read(&self, ranges: &[Range<u64>]) {
        self.store.blocks(&self.path, &self.meta).will_read(ranges);
    }

    fn readers(&self) -> Option<usize> {
        Some(self.store.pool.limits.requests)
    }
}
