//! Fetches ranges of a file by requests, which are repeated where they may succeed the next time.
//! An answer has to be of the same version of the file, complete, and not encoded.

use bytes::Bytes;
use futures_util::TryStreamExt;
use object_store::path::Path;
use object_store::{Attribute, GetOptions, GetRange, GetResult, ObjectMeta, ObjectStore};
use std::error::Error;
use std::io;
use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::{Duration, Instant, SystemTime};

/// Attempts at a request.
const ATTEMPTS: u32 = 6;
/// Longest wait before the second attempt; doubled each time.
const WAIT: Duration = Duration::from_millis(100);
/// Longest waits for an answer, together, after which there is no other attempt.
const ANSWERS: u32 = 2;
/// Rate below which a server counts as one that stalls, bytes a second.
const RATE_MIN: u64 = 8 << 10;
/// The same for bytes that are sent, by which the time for an answer is extended.
const SEND_RATE_MIN: u64 = 64 << 10;
/// Bytes that files have which are fetched whole, by which the time for an answer is extended.
const WHOLE_BYTES: u64 = 4 << 20;
/// Seconds that a file has to be unchanged for its time to tell its version: servers give times in
/// seconds, and clocks differ.
const SETTLED_S: i64 = 60;

/// Message for requests that are refused.
const REFUSED: &str = "the server refuses it: credentials come from the variables of the \
                       environment, and signed addresses expire";

/// Why a range was not fetched.
#[derive(Clone, Debug, PartialEq)]
pub enum Fault {
    /// It may be there the next time.
    Passing(String),
    /// It will not.
    Lasting(io::ErrorKind, String),
}

impl Fault {
    /// The file is another one than when it was opened.
    pub fn changed() -> Self {
        Self::Lasting(
            io::ErrorKind::StaleNetworkFileHandle,
            "it has changed since it was opened; open it again".into(),
        )
    }
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
            Error::PermissionDenied { .. } | Error::Unauthenticated { .. } => {
                Self::Lasting(PermissionDenied, REFUSED.into())
            }
            Error::NotSupported { .. } => Self::Lasting(
                Unsupported,
                "the server does not send parts of files (no support of `Range`), so that all of it \
                 would have to be fetched: download the file and open that, or use another server"
                    .into(),
            ),
            Error::Precondition { .. } => Self::changed(),
            _ => {
                let what = format!("the server does not answer as it should: {}", deepest(&error));
                match status(&error) {
                    // Stores answer so to lists, too.
                    Some(401 | 403) => Self::Lasting(PermissionDenied, REFUSED.into()),
                    // Too many requests, or a wait that was too long.
                    Some(408 | 425 | 429) | None => Self::Passing(what),
                    // S3 answers so to a token that has expired.
                    Some(400) => Self::Lasting(
                        PermissionDenied,
                        format!("{what}; credentials are refused in this way, too"),
                    ),
                    Some(status) if status < 500 => Self::Lasting(Other, what),
                    Some(_) => Self::Passing(what),
                }
            }
        }
    }
}

/// The last cause of an error, in one line. The causes before it repeat the address, which may have
/// a signature.
pub fn deepest(error: &dyn Error) -> String {
    let mut last = error;
    while let Some(cause) = last.source() {
        last = cause;
    }
    let text = last.to_string();
    text.lines().next().unwrap_or_default().trim_end_matches([':', ' ']).to_owned()
}

/// Status of the answer that is behind an error.
fn status(error: &object_store::Error) -> Option<u16> {
    let text = deepest(error);
    text.strip_prefix("Server returned non-2xx status code: ")?.get(..3)?.parse().ok()
}

/// A file in a store.
pub struct Fetcher {
    store: Arc<dyn ObjectStore>,
    path: Path,
    /// Longest wait for an answer.
    answer: Duration,
}

impl Fetcher {
    /// A file at a path; nothing is read.
    pub fn new(store: Arc<dyn ObjectStore>, path: Path, answer: Duration) -> Self {
        Self { store, path, answer }
    }

    /// What the store says of the file, and its first bytes, at most `most` of them.
    pub async fn head(&self, most: u64) -> Result<(ObjectMeta, Vec<u8>), Fault> {
        self.repeated(most, || self.head_once(most)).await
    }

    async fn head_once(&self, most: u64) -> Result<(ObjectMeta, Vec<u8>), Fault> {
        match self.get(0..most).await {
            Ok(result) => Ok((result.meta.clone(), body(result).await?)),
            // Servers refuse a range of an empty file, or ignore it.
            Err(error) => {
                let may_be_empty = matches!(error, object_store::Error::NotSupported { .. })
                    || status(&error) == Some(416);
                let meta = if may_be_empty { self.only_head().await } else { None };
                let empty = meta.filter(|meta| meta.size == 0).map(|meta| (meta, Vec::new()));
                empty.ok_or_else(|| error.into())
            }
        }
    }

    async fn only_head(&self) -> Option<ObjectMeta> {
        let options = GetOptions { head: true, ..GetOptions::default() };
        self.store.get_opts(&self.path, options).await.ok().map(|result| result.meta)
    }

    /// What the store says of the file, without any of its bytes.
    pub async fn meta(&self) -> Result<ObjectMeta, Fault> {
        let head = || GetOptions { head: true, ..GetOptions::default() };
        let once = || async { Ok(self.store.get_opts(&self.path, head()).await?.meta) };
        self.repeated(0, once).await
    }

    /// All bytes of a file that has no more than `most`; none if there is no file.
    pub async fn whole(&self, most: u64) -> Result<Option<Vec<u8>>, Fault> {
        let once = || async {
            let result = match self.store.get_opts(&self.path, GetOptions::default()).await {
                Err(object_store::Error::NotFound { .. }) => return Ok(None),
                result => result?,
            };
            if result.meta.size > most {
                let what = format!("is longer than {most} bytes");
                return Err(Fault::Lasting(io::ErrorKind::Other, what));
            }
            Ok(Some(body(result).await?))
        };
        self.repeated(most.min(WHOLE_BYTES), once).await
    }

    async fn get(&self, range: Range<u64>) -> Result<GetResult, object_store::Error> {
        let range = Some(GetRange::Bounded(range));
        self.store.get_opts(&self.path, GetOptions { range, ..GetOptions::default() }).await
    }

    /// Bytes of a range of the file that `of` describes.
    pub async fn range(&self, range: Range<u64>, of: &ObjectMeta) -> Result<Vec<u8>, Fault> {
        let bytes = range.end - range.start;
        self.repeated(bytes, || self.range_once(range.clone(), of)).await
    }

    async fn range_once(&self, range: Range<u64>, of: &ObjectMeta) -> Result<Vec<u8>, Fault> {
        let result = match self.get(range).await {
            // The file ends before.
            Err(error) if status(&error) == Some(416) => return Err(Fault::changed()),
            result => result?,
        };
        if version(&result.meta) != version(of) || result.meta.size != of.size {
            return Err(Fault::changed());
        }
        body(result).await
    }

    /// Makes a request for some bytes until it succeeds, cannot, or took too long.
    async fn repeated<T, F>(&self, bytes: u64, once: impl Fn() -> F) -> Result<T, Fault>
    where
        F: Future<Output = Result<T, Fault>>,
    {
        let longest = self.answer + Duration::from_secs(bytes / RATE_MIN);
        repeated(WAIT.min(self.answer / 10), longest, ANSWERS * self.answer, once).await
    }
}

/// Waits for an answer to a request that sends or changes something, and before it is repeated.
#[derive(Clone, Copy, Debug)]
pub struct Patience {
    wait: Duration,
    longest: Duration,
}

impl Patience {
    /// For a request with `bytes` bytes, of a client that waits `answer` for an answer.
    pub fn of(bytes: u64, answer: Duration) -> Self {
        let longest = answer + Duration::from_secs(bytes / SEND_RATE_MIN);
        Self { wait: WAIT.min(answer / 10), longest }
    }

    /// For a request that the store makes in up to so many parts.
    pub fn times(self, parts: u32) -> Self {
        Self { longest: self.longest * parts, ..self }
    }

    /// Repeats a request until it succeeds, fails for good, or takes too long. `once` makes it; its
    /// argument is true from the second time on, when an earlier answer may have been lost.
    pub async fn repeated<T, F>(self, once: impl Fn(bool) -> F) -> Result<T, Fault>
    where
        F: Future<Output = Result<T, Fault>>,
    {
        let is_again = AtomicBool::new(false);
        let once = || once(is_again.swap(true, Relaxed));
        repeated(self.wait, self.longest, ANSWERS * self.longest, once).await
    }
}

/// Makes a request of at most `longest` until it succeeds, cannot, or all took `together`; first
/// waits `wait` in between.
async fn repeated<T, F>(
    mut wait: Duration,
    longest: Duration,
    together: Duration,
    once: impl Fn() -> F,
) -> Result<T, Fault>
where
    F: Future<Output = Result<T, Fault>>,
{
    let mut waited = Duration::ZERO;
    let mut attempt = 1;
    loop {
        let start = Instant::now();
        let done = match tokio::time::timeout(longest, once()).await {
            Ok(done) => done,
            Err(_) => Err(Fault::Passing("the server answers too slowly".into())),
        };
        waited += start.elapsed();
        let may_repeat = attempt < ATTEMPTS && waited < together;
        match done {
            Err(Fault::Passing(_)) if may_repeat => tokio::time::sleep(wait).await,
            done => return done,
        }
        wait *= 2;
        attempt += 1;
    }
}

/// Bytes of an answer, which has to have as many as it says and no more.
pub async fn body(result: GetResult) -> Result<Vec<u8>, Fault> {
    let encoding = result.attributes.get(&Attribute::ContentEncoding).map(AsRef::<str>::as_ref);
    if let Some(encoding) = encoding.filter(|name| !matches!(*name, "" | "identity")) {
        let encoding: String = encoding.chars().filter(char::is_ascii_graphic).take(20).collect();
        let what = format!(
            "the server compresses it on the way (`Content-Encoding: {encoding}`), so that its \
             bytes have no places: switch that off for this file"
        );
        return Err(Fault::Lasting(io::ErrorKind::Unsupported, what));
    }
    let wanted = usize::try_from(result.range.end - result.range.start).unwrap_or(usize::MAX);
    let other = |came: usize| Fault::Passing(format!("{came} bytes came where {wanted} should"));
    let mut bytes = Vec::new();
    let mut parts = result.into_stream();
    while let Some(part) = parts.try_next().await? {
        let part: Bytes = part;
        if bytes.len() + part.len() > wanted {
            return Err(other(bytes.len() + part.len()));
        }
        bytes.extend_from_slice(&part);
    }
    if bytes.len() < wanted { Err(other(bytes.len())) } else { Ok(bytes) }
}

/// What tells one version of a file from another: its tag, or when it was changed. A weak tag is
/// the same for files that a server takes for equal.
pub fn version(meta: &ObjectMeta) -> String {
    let time = meta.last_modified.to_rfc3339();
    match &meta.e_tag {
        Some(tag) if tag.starts_with("W/") => format!("{tag} {time}"),
        Some(tag) => tag.clone(),
        None => time,
    }
}

/// Whether no two versions of a file have the same [`version`], so that bytes can be kept for it.
pub fn has_certain_version(meta: &ObjectMeta) -> bool {
    let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).map_or(0, |d| d.as_secs());
    let changed_s = meta.last_modified.timestamp();
    let is_old = changed_s > 0 && i64::try_from(now).is_ok_and(|now| now - changed_s >= SETTLED_S);
    is_old || meta.e_tag.as_ref().is_some_and(|tag| !tag.starts_with("W/"))
}
