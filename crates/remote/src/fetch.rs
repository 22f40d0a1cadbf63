//! Fetches runs of blocks: from the disk, else by one request for a range, which is repeated where
//! it may succeed the next time. An answer has to be of the same version of the file and complete.

use crate::blocks::BLOCK;
use bytes::Bytes;
use futures_util::TryStreamExt;
use object_store::path::Path;
use object_store::{GetOptions, GetRange, GetResult, ObjectMeta, ObjectStore};
use std::io;
use std::ops::Range;
use std::time::Duration;

/// Attempts at a request whose answer was cut, stalled or of another length. Refused ones are
/// repeated by the store.
const ATTEMPTS: u32 = 5;
/// Wait before the second attempt; doubled each time.
const WAIT: Duration = Duration::from_millis(100);

/// Why a range was not fetched.
#[derive(Debug)]
pub enum Fault {
    /// It may be there the next time.
    Passing(String),
    /// It will not.
    Lasting(io::ErrorKind, String),
}

impl From<Fault> for io::Error {
    fn from(fault: Fault) -> Self {
        match fault {
            Fault::Passing(what) => Self::other(what),
            Fault::Lasting(kind, what) => Self::new(kind, what),
        }
    }
}

impl From<object_store::Error> for Fault {
    fn from(error: object_store::Error) -> Self {
        use io::ErrorKind::{NotFound, Other, PermissionDenied, Unsupported};
        use object_store::Error;
        match &error {
            Error::NotFound { .. } => Self::Lasting(NotFound, "there is no such file".into()),
            Error::PermissionDenied { .. } | Error::Unauthenticated { .. } => Self::Lasting(
                PermissionDenied,
                "the server refuses it: give credentials by the variables of the environment".into(),
            ),
            Error::NotSupported { .. } => Self::Lasting(
                Unsupported,
                "the server does not send parts of files (no support of `Range`), so that all of it \
                 would have to be fetched: download the file and open that, or use another server"
                    .into(),
            ),
            Error::Precondition { .. } => Self::Lasting(Other, CHANGED.into()),
            _ => {
                // Chains of errors repeat the address, and may have parts of what was sent.
                let text = deepest(&error);
                Self::Passing(format!("the server does not answer as it should: {text}"))
            }
        }
    }
}

/// What is wrong with a file that is another one than when it was opened.
pub const CHANGED: &str = "it has changed since it was opened; open it again";

/// The last cause of an error, in one line.
fn deepest(error: &dyn std::error::Error) -> String {
    let mut last = error;
    while let Some(cause) = last.source() {
        last = cause;
    }
    last.to_string().lines().next().unwrap_or_default().to_owned()
}

/// A file in a store.
pub struct Fetcher {
    store: std::sync::Arc<dyn ObjectStore>,
    path: Path,
}

impl Fetcher {
    /// A file at a path; nothing is read.
    pub fn new(store: std::sync::Arc<dyn ObjectStore>, path: Path) -> Self {
        Self { store, path }
    }

    /// What the store says of the file, and its first bytes, at most `most` of them.
    pub async fn head(&self, most: u64) -> Result<(ObjectMeta, Bytes), Fault> {
        let mut wait = WAIT;
        for _ in 1..ATTEMPTS {
            match self.head_once(most).await {
                Err(Fault::Passing(_)) => tokio::time::sleep(wait).await,
                done => return done,
            }
            wait *= 2;
        }
        self.head_once(most).await
    }

    async fn head_once(&self, most: u64) -> Result<(ObjectMeta, Bytes), Fault> {
        match self.get(0..most).await {
            Ok(result) => {
                let (meta, range) = (result.meta.clone(), result.range.clone());
                let bytes = body(result).await?;
                let wanted = meta.size.min(most);
                if bytes.len() as u64 != wanted || range != (0..wanted) {
                    return Err(Fault::Passing("an answer of another length came".into()));
                }
                Ok((meta, bytes))
            }
            // Some servers refuse a range of an empty file.
            Err(fault) => match self.store_head().await {
                Some(meta) if meta.size == 0 => Ok((meta, Bytes::new())),
                _ => Err(fault.into()),
            },
        }
    }

    async fn store_head(&self) -> Option<ObjectMeta> {
        let options = GetOptions { head: true, ..GetOptions::default() };
        self.store.get_opts(&self.path, options).await.ok().map(|result| result.meta)
    }

    async fn get(&self, range: Range<u64>) -> Result<GetResult, object_store::Error> {
        let range = Some(GetRange::Bounded(range));
        self.store.get_opts(&self.path, GetOptions { range, ..GetOptions::default() }).await
    }

    /// Bytes of a range of the file that `of` describes.
    pub async fn range(&self, range: Range<u64>, of: &ObjectMeta) -> Result<Bytes, Fault> {
        let mut wait = WAIT;
        for _ in 1..ATTEMPTS {
            match self.range_once(range.clone(), of).await {
                Err(Fault::Passing(_)) => tokio::time::sleep(wait).await,
                done => return done,
            }
            wait *= 2;
        }
        self.range_once(range, of).await
    }

    async fn range_once(&self, range: Range<u64>, of: &ObjectMeta) -> Result<Bytes, Fault> {
        let result = self.get(range.clone()).await?;
        if version(&result.meta) != version(of) || result.meta.size != of.size {
            return Err(Fault::Lasting(io::ErrorKind::Other, CHANGED.into()));
        }
        let bytes = body(result).await?;
        if bytes.len() as u64 != range.end - range.start {
            return Err(Fault::Passing(format!(
                "{} bytes came of {}",
                bytes.len(),
                range.end - range.start
            )));
        }
        Ok(bytes)
    }
}

async fn body(result: GetResult) -> Result<Bytes, Fault> {
    let parts: Vec<Bytes> = result.into_stream().try_collect().await?;
    Ok(match &parts[..] {
        [one] => one.clone(),
        _ => parts.concat().into(),
    })
}

/// What tells one version of a file from another: its tag, or when it was changed.
pub fn version(meta: &ObjectMeta) -> String {
    meta.e_tag.clone().unwrap_or_else(|| meta.last_modified.to_rfc3339())
}

/// Bytes of the blocks of a run, of a file of `size` bytes.
pub fn bytes_of(run: &Range<u64>, size: u64) -> Range<u64> {
    (run.start * BLOCK).min(size)..(run.end * BLOCK).min(size)
}
