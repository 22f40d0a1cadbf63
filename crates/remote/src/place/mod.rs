//! Places of divided builds in object storage ([`esker_points::objects`]): objects below a prefix
//! of a bucket. Small objects are created by a conditional put, by which the store itself decides
//! who is first; large ones are sent in parts ([`upload`]). Reads take the way of files at
//! addresses, but nothing is kept on the disk, and only a few objects have blocks in memory.

mod store;
#[cfg(test)]
mod tests;
mod upload;

use crate::address::{Bucket, locate, locate_bucket};
use crate::fetch::Fault;
use crate::pool::Pool;
use crate::secrets;
use bytes::Bytes;
use esker_points::address::shown;
use esker_points::objects::{Listed, Place, Upload};
use esker_points::read_at::ReadAt;
use futures_util::StreamExt;
use object_store::path::{Path, PathPart};
use object_store::{Error, ObjectMeta, ObjectStore, PutMode};
use std::io;
use std::ops::Range;
use std::sync::Arc;
use store::{Store, unwritten};
use upload::ObjectUpload;

/// Requests for the pages of a list for which one waits together.
const LIST_PAGES: u32 = 20;

/// A place in object storage.
pub struct ObjectPlace {
    store: Arc<Store>,
    shown: String,
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
        Self { store: Arc::new(Store::new(reads, writes, base, pool)), shown }
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
        let fetcher = self.store.fetcher(self.store.path(name)?);
        let meta = self.store.finish(async move { fetcher.meta().await })?;
        Ok(Arc::new(Object { store: Arc::clone(&self.store), meta }))
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
    meta: ObjectMeta,
}

impl ReadAt for Object {
    fn read_exact_at(&self, buf: &mut [u8], offset: u64) -> io::Result<()> {
        let blocks = self.store.blocks(&self.meta);
        blocks.read_exact_at(buf, offset).map_err(secrets::without)
    }

    fn bytes(&self) -> io::Result<u64> {
        Ok(self.meta.size)
    }

    fn will_read(&self, ranges: &[Range<u64>]) {
        self.store.blocks(&self.meta).will_read(ranges);
    }

    fn readers(&self) -> Option<usize> {
        Some(self.store.pool.limits.requests)
    }
}
