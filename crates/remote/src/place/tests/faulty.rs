//! A store in memory whose requests fail on demand.

use async_trait::async_trait;
use futures_util::StreamExt;
use futures_util::stream::BoxStream;
use object_store::memory::InMemory;
use object_store::multipart::{MultipartStore, PartId};
use object_store::path::Path;
use object_store::{
    CopyOptions, Error, GetOptions, GetResult, ListResult, MultipartId, MultipartUpload,
    ObjectMeta, ObjectStore, PutMode, PutMultipartOptions, PutOptions, PutPayload, PutResult,
    Result,
};
use std::fmt::{self, Debug, Display, Formatter};
use std::sync::Mutex;

/// What happens to a request.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Answer {
    /// It is done.
    Works,
    /// It fails, and may work the next time.
    Fails,
    /// It is done, but its answer is lost.
    Lost,
    /// It is refused.
    Refused,
    /// It is done, whatever its condition.
    Unconditional,
}

/// Decides on requests by their names.
type Answers = Box<dyn FnMut(&'static str) -> Answer + Send>;

/// The store.
pub struct Faulty {
    memory: InMemory,
    answers: Mutex<Answers>,
    /// Requests that were made, and bytes that they sent.
    log: Mutex<Vec<(&'static str, usize)>>,
    /// Uploads in parts that were begun and neither completed nor aborted.
    open: Mutex<Vec<MultipartId>>,
}

impl Faulty {
    pub fn new(answers: impl FnMut(&'static str) -> Answer + Send + 'static) -> Self {
        let (log, open) = (Mutex::default(), Mutex::default());
        Self { memory: InMemory::new(), answers: Mutex::new(Box::new(answers)), log, open }
    }

    /// Requests with these names.
    pub fn count(&self, names: &[&str]) -> usize {
        self.log.lock().unwrap().iter().filter(|(name, _)| names.contains(name)).count()
    }

    /// Bytes of the parts that were sent.
    pub fn parts(&self) -> Vec<usize> {
        let log = self.log.lock().unwrap();
        log.iter().filter(|(name, _)| *name == "part").map(|(_, bytes)| *bytes).collect()
    }

    /// Number of uploads that nobody ended.
    pub fn uploads(&self) -> usize {
        self.open.lock().unwrap().len()
    }

    /// Changes what happens to requests.
    pub fn set(&self, answers: impl FnMut(&'static str) -> Answer + Send + 'static) {
        *self.answers.lock().unwrap() = Box::new(answers);
    }

    async fn answer<T>(
        &self,
        name: &'static str,
        sent: usize,
        work: impl Future<Output = Result<T>>,
    ) -> Result<T> {
        self.log.lock().unwrap().push((name, sent));
        let answer = (self.answers.lock().unwrap())(name);
        let failure = || Error::Generic { store: "test", source: "connection reset".into() };
        match answer {
            Answer::Works | Answer::Unconditional => work.await,
            Answer::Fails => Err(failure()),
            Answer::Lost => Err(work.await.err().unwrap_or_else(failure)),
            Answer::Refused => {
                Err(Error::PermissionDenied { path: "secret".into(), source: "secret".into() })
            }
        }
    }
}

impl Debug for Faulty {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str("Faulty")
    }
}

impl Display for Faulty {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str("Faulty")
    }
}

#[async_trait]
impl ObjectStore for Faulty {
    async fn put_opts(
        &self,
        location: &Path,
        payload: PutPayload,
        opts: PutOptions,
    ) -> Result<PutResult> {
        let mut opts = opts;
        if (self.answers.lock().unwrap())("condition") == Answer::Unconditional {
            opts.mode = PutMode::Overwrite;
        }
        let bytes = payload.content_length();
        self.answer("put", bytes, self.memory.put_opts(location, payload, opts)).await
    }

    async fn put_multipart_opts(
        &self,
        _location: &Path,
        _opts: PutMultipartOptions,
    ) -> Result<Box<dyn MultipartUpload>> {
        unreachable!("parts are sent one by one")
    }

    async fn get_opts(&self, location: &Path, options: GetOptions) -> Result<GetResult> {
        let name = if options.head { "head" } else { "get" };
        self.answer(name, 0, self.memory.get_opts(location, options)).await
    }

    fn delete_stream(
        &self,
        locations: BoxStream<'static, Result<Path>>,
    ) -> BoxStream<'static, Result<Path>> {
        let answer = (self.answers.lock().unwrap())("delete");
        if matches!(answer, Answer::Works | Answer::Unconditional) {
            return self.memory.delete_stream(locations);
        }
        let failure = Error::Generic { store: "test", source: "connection reset".into() };
        futures_util::stream::once(async move { Err(failure) }).boxed()
    }

    fn list(&self, prefix: Option<&Path>) -> BoxStream<'static, Result<ObjectMeta>> {
        self.memory.list(prefix)
    }

    async fn list_with_delimiter(&self, prefix: Option<&Path>) -> Result<ListResult> {
        self.answer("list", 0, self.memory.list_with_delimiter(prefix)).await
    }

    async fn copy_opts(&self, from: &Path, to: &Path, options: CopyOptions) -> Result<()> {
        self.memory.copy_opts(from, to, options).await
    }
}

#[async_trait]
impl MultipartStore for Faulty {
    async fn create_multipart(&self, path: &Path) -> Result<MultipartId> {
        let begun = async {
            let id = self.memory.create_multipart(path).await?;
            self.open.lock().unwrap().push(id.clone());
            Ok(id)
        };
        self.answer("begin", 0, begun).await
    }

    async fn put_part(
        &self,
        path: &Path,
        id: &MultipartId,
        part_idx: usize,
        data: PutPayload,
    ) -> Result<PartId> {
        let bytes = data.content_length();
        self.answer("part", bytes, self.memory.put_part(path, id, part_idx, data)).await
    }

    async fn complete_multipart(
        &self,
        path: &Path,
        id: &MultipartId,
        parts: Vec<PartId>,
    ) -> Result<PutResult> {
        let completed = async {
            let completed = self.memory.complete_multipart(path, id, parts).await?;
            self.open.lock().unwrap().retain(|own| own != id);
            Ok(completed)
        };
        self.answer("complete", 0, completed).await
    }

    async fn abort_multipart(&self, path: &Path, id: &MultipartId) -> Result<()> {
        let aborted = async {
            self.memory.abort_multipart(path, id).await?;
            self.open.lock().unwrap().retain(|own| own != id);
            Ok(())
        };
        self.answer("abort", 0, aborted).await
    }
}
