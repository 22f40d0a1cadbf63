//! Sends a large object in parts, a few at a time, while it is written. Stores take up to 10,000
//! parts, so that parts grow with the object. No object is there before the last request; an upload
//! that fails or is dropped is aborted, which removes its parts. An object of a single part is sent
//! by one request.

use super::store::{Store, unwritten};
use crate::fetch::Fault;
use crate::secrets;
use crate::threads::{runtime, wait};
use bytes::Bytes;
use esker_points::objects::Upload;
use object_store::multipart::PartId;
use object_store::path::Path;
use object_store::{MultipartId, PutPayload};
use std::collections::VecDeque;
use std::io::{self, ErrorKind, Write};
use std::sync::Arc;
use std::time::Duration;
use tokio::task::JoinHandle;

/// Bytes of the first parts; S3 takes no less than 5 MiB.
const PART_BYTES_MIN: usize = 8 << 20;
/// What parts grow by, and the number of parts after which they grow: an object may have 1.7 TB.
const GROWTH_BYTES: usize = 1 << 20;
const PARTS_OF_SIZE: usize = 32;
/// Most parts that stores take.
const PARTS_MAX: usize = 10_000;
/// Bytes of parts that are sent at a time, unless a single part has more.
const SENDING_BYTES: usize = 4 * PART_BYTES_MIN;
/// Time for the requests that end an upload, in answers.
const END_ANSWERS: u32 = 10;
/// Longest wait for the removal of what was sent.
const ABORT: Duration = Duration::from_secs(10);

/// Bytes of a part.
pub(super) fn part_bytes(index: usize) -> usize {
    PART_BYTES_MIN + index / PARTS_OF_SIZE * GROWTH_BYTES
}

/// An object that is being written.
pub(super) struct ObjectUpload {
    store: Arc<Store>,
    path: Path,
    /// The part that is being filled.
    part: Vec<u8>,
    /// Number of the upload; none before the first part is full.
    id: Option<MultipartId>,
    sent: Vec<PartId>,
    /// The parts after those that are sent, with their bytes.
    sending: VecDeque<(usize, JoinHandle<Result<PartId, Fault>>)>,
    /// Bytes that were written.
    bytes: u64,
    state: State,
}

#[derive(Clone, Copy, PartialEq)]
enum State {
    Open,
    Failed,
    Done,
}

impl ObjectUpload {
    /// Begins an object; nothing is sent yet.
    pub fn new(store: Arc<Store>, path: Path) -> Self {
        let (part, sent, sending) = (Vec::new(), Vec::new(), VecDeque::new());
        Self { store, path, part, id: None, sent, sending, bytes: 0, state: State::Open }
    }

    /// Does some work; the upload is of no use if that fails.
    fn attempt<T>(&mut self, work: impl FnOnce(&mut Self) -> io::Result<T>) -> io::Result<T> {
        if self.state != State::Open {
            return Err(ErrorKind::BrokenPipe.into());
        }
        let done = work(self);
        if done.is_err() {
            self.state = State::Failed;
        }
        done
    }

    /// Number of the part that is being filled.
    fn index(&self) -> usize {
        self.sent.len() + self.sending.len()
    }

    fn fill(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.part.len() >= part_bytes(self.index()) {
            self.send()?;
        }
        let all = part_bytes(self.index());
        if self.part.capacity() == 0 {
            self.part.try_reserve_exact(all).map_err(|_| ErrorKind::OutOfMemory)?;
        }
        let taken = bytes.len().min(all - self.part.len());
        self.part.extend_from_slice(&bytes[..taken]);
        self.bytes += taken as u64;
        Ok(taken)
    }

    /// Number of the upload, which begins with the first part.
    fn id(&mut self) -> io::Result<MultipartId> {
        if let Some(id) = &self.id {
            return Ok(id.clone());
        }
        let (writes, path) = (Arc::clone(&self.store.writes), self.path.clone());
        let id = self.store.finish(self.store.patience(0).repeated(move |_| {
            let (writes, path) = (Arc::clone(&writes), path.clone());
            async move { writes.create_multipart(&path).await.map_err(unwritten) }
        }))?;
        self.id = Some(id.clone());
        Ok(id)
    }

    /// Begins to send the part that is filled.
    fn send(&mut self) -> io::Result<()> {
        let index = self.index();
        if index >= PARTS_MAX {
            let what = format!("is larger than {} bytes, too large for object storage", self.bytes);
            return Err(io::Error::new(ErrorKind::FileTooLarge, what));
        }
        let id = self.id()?;
        let part = Bytes::from(std::mem::take(&mut self.part));
        let bytes = part.len();
        self.wait_for(SENDING_BYTES.saturating_sub(bytes))?;
        let (writes, path) = (Arc::clone(&self.store.writes), self.path.clone());
        let sending = self.store.patience(bytes).repeated(move |_| {
            let (writes, path, id) = (Arc::clone(&writes), path.clone(), id.clone());
            let part = PutPayload::from(part.clone());
            async move { writes.put_part(&path, &id, index, part).await.map_err(unwritten) }
        });
        self.sending.push_back((bytes, runtime()?.spawn(sending)));
        Ok(())
    }

    /// Waits until no more than so many bytes are being sent.
    fn wait_for(&mut self, most_bytes: usize) -> io::Result<()> {
        while self.sending.iter().map(|(bytes, _)| bytes).sum::<usize>() > most_bytes {
            let Some((_, sending)) = self.sending.pop_front() else { break };
            let sent = wait(&self.store.pool, sending).and_then(|sent| Ok(sent?));
            self.sent.push(sent.map_err(secrets::without)?);
        }
        Ok(())
    }

    /// Sends an object that is a single part.
    fn send_whole(&mut self) -> io::Result<()> {
        let whole = Bytes::from(std::mem::take(&mut self.part));
        let (writes, path) = (Arc::clone(&self.store.writes), self.path.clone());
        self.store.finish(self.store.patience(whole.len()).repeated(move |_| {
            let (writes, path) = (Arc::clone(&writes), path.clone());
            let whole = PutPayload::from(whole.clone());
            async move {
                let sent = writes.put_opts(&path, whole, Default::default()).await;
                sent.map(|_| ()).map_err(unwritten)
            }
        }))
    }

    /// Makes one object of the parts, and checks its length.
    fn complete(&mut self, id: MultipartId) -> io::Result<()> {
        if !self.part.is_empty() {
            self.send()?;
        }
        self.wait_for(0)?;
        let (parts, bytes) = (self.sent.clone(), self.bytes);
        let (writes, path) = (Arc::clone(&self.store.writes), self.path.clone());
        let fetcher = Arc::new(self.store.fetcher(self.path.clone()));
        let patience = self.store.patience(0).times(END_ANSWERS);
        self.store.finish(async move {
            let (own, of) = (Arc::clone(&fetcher), path);
            let completed = patience.repeated(move |is_again| {
                let (writes, fetcher) = (Arc::clone(&writes), Arc::clone(&own));
                let (path, id, parts) = (of.clone(), id.clone(), parts.clone());
                async move {
                    let Err(error) = writes.complete_multipart(&path, &id, parts).await else {
                        return Ok(());
                    };
                    // The answer to an earlier request may have been lost; the upload is gone then.
                    let is_whole = is_again && fetcher.meta().await.is_ok_and(|m| m.size == bytes);
                    if is_whole { Ok(()) } else { Err(unwritten(error)) }
                }
            });
            completed.await?;
            let stored = fetcher.meta().await?.size;
            let other = format!("{stored} bytes are stored where {bytes} should be");
            let other = Fault::Lasting(ErrorKind::Other, other);
            if stored == bytes { Ok(()) } else { Err(other) }
        })
    }
}

impl Write for ObjectUpload {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.attempt(|upload| upload.fill(bytes))
    }

    /// Does nothing: parts are sent when they are full.
    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Upload for ObjectUpload {
    fn finish(mut self: Box<Self>) -> io::Result<()> {
        self.attempt(|upload| {
            // A part that fills exactly is sent with the next byte, so that a single one is whole.
            match upload.id.clone() {
                None => upload.send_whole(),
                Some(id) => upload.complete(id),
            }
        })?;
        self.state = State::Done;
        Ok(())
    }
}

impl Drop for ObjectUpload {
    fn drop(&mut self) {
        let (Some(id), Ok(runtime)) = (self.id.take(), runtime()) else { return };
        if self.state == State::Done {
            return;
        }
        self.sending.iter().for_each(|(_, sending)| sending.abort());
        let (writes, path) = (Arc::clone(&self.store.writes), self.path.clone());
        let aborted = self.store.patience(0).repeated(move |_| {
            let (writes, path, id) = (Arc::clone(&writes), path.clone(), id.clone());
            async move { writes.abort_multipart(&path, &id).await.map_err(unwritten) }
        });
        let _ = runtime.block_on(async { tokio::time::timeout(ABORT, aborted).await });
    }
}
