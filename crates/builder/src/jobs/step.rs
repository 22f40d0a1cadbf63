//! Steps of a divided build, and how they finish. Each writes one large object under a name of its
//! own, then creates a small record that names it. Steps look for records alone, so a step may be
//! killed, run again, or run twice at the same time: the first record counts, and who comes second
//! removes what it wrote.

use crate::error::BuildError;
use crate::jobs::place::{Place, Upload, unique};
use esker_points::MultisetHash;
use esker_points::read_at::ReadAt;
use serde::{Deserialize, Serialize};
use std::io::{self, Write};
use std::sync::Arc;

/// Version of the records and objects of all steps; changes with their content.
pub const VERSION: u32 = 1;
/// Most bytes of a record.
const RECORD_BYTES_MAX: u64 = 1 << 16;

/// A kind of step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// Decodes pieces of the sources.
    Take(u32),
    /// Sums up all takes, and divides the cells into parts.
    Cut,
    /// Builds some parts.
    Build(u32),
    /// Joins the parts.
    Join,
}

impl Step {
    /// Name of the record of the step.
    pub fn record(self) -> String {
        match self {
            Self::Take(index) => format!("take/{index:05}"),
            Self::Cut => "cut".into(),
            Self::Build(index) => format!("build/{index:05}"),
            Self::Join => "join".into(),
        }
    }

    /// End of the names of objects of the step.
    fn ending(self) -> &'static str {
        match self {
            Self::Take(_) => ".rows",
            Self::Cut => ".parts",
            Self::Build(_) | Self::Join => ".pages",
        }
    }

    /// The step as a command.
    pub fn command(self) -> String {
        match self {
            Self::Take(index) => format!("esker job take --job {index}"),
            Self::Cut => "esker job cut".into(),
            Self::Build(index) => format!("esker job build --job {index}"),
            Self::Join => "esker job join".into(),
        }
    }
}

/// What a step has finished: its object.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Record {
    version: u32,
    /// Hash of the plan.
    plan: String,
    /// Name of the object.
    pub object: String,
    /// Its bytes.
    pub bytes: u64,
    /// Offset of its tail, with which its reading begins, and the hash of the tail.
    pub tail: u64,
    /// XXH3-128 of the tail.
    pub tail_hash: String,
}

/// XXH3-128 of some bytes, in hexadecimal.
pub fn hash_of(bytes: &[u8]) -> String {
    let mut hash = MultisetHash::default();
    hash.add(0, bytes);
    hash.to_string()
}

/// Name of an object for messages.
pub fn shown(place: &dyn Place, name: &str) -> String {
    format!("{}: {name}", place.shown())
}

/// The error of a place.
pub fn failed(
    place: &dyn Place,
    name: &str,
    phase: &'static str,
) -> impl FnOnce(io::Error) -> BuildError {
    let name = shown(place, name);
    move |source| BuildError::Place { name, phase, source }
}

/// The error of a step.
pub fn refused(place: &dyn Place, name: &str, why: impl Into<String>) -> BuildError {
    BuildError::Step { name: shown(place, name), why: why.into() }
}

impl Record {
    /// The record of a finished step; `None` if it is not finished.
    ///
    /// # Errors
    /// If the record cannot be read, or is of another plan.
    pub fn find(place: &dyn Place, plan: &str, step: Step) -> Result<Option<Self>, BuildError> {
        let name = step.record();
        let bytes = place.read(&name, RECORD_BYTES_MAX);
        let Some(bytes) = bytes.map_err(failed(place, &name, "cannot be read"))? else {
            return Ok(None);
        };
        let record: Self = serde_json::from_slice(&bytes)
            .map_err(|e| refused(place, &name, format!("is no record of a step ({e})")))?;
        if record.version != VERSION || record.plan != plan {
            return Err(refused(
                place,
                &name,
                "is of another plan; remove what is left of that, or choose another folder",
            ));
        }
        Ok(Some(record))
    }

    /// The record of a step that must be finished.
    ///
    /// # Errors
    /// As for [`Record::find`]; if the step is not finished.
    pub fn of(place: &dyn Place, plan: &str, step: Step) -> Result<Self, BuildError> {
        Self::find(place, plan, step)?.ok_or_else(|| {
            let why = format!("is missing; run `{}` first", step.command());
            refused(place, &step.record(), why)
        })
    }

    /// Opens the object of a step, and checks its length.
    ///
    /// # Errors
    /// If it is missing, cut short, or cannot be read.
    pub fn open(&self, place: &dyn Place, step: Step) -> Result<Arc<dyn ReadAt>, BuildError> {
        let remedy = || format!("remove the record {} and run `{}`", step.record(), step.command());
        let object = match place.open(&self.object) {
            Err(e) if e.kind() == io::ErrorKind::NotFound => {
                let why = format!("is missing, although its step is finished; {}", remedy());
                return Err(refused(place, &self.object, why));
            }
            object => object.map_err(failed(place, &self.object, "cannot be opened"))?,
        };
        let bytes = object.bytes().map_err(failed(place, &self.object, "cannot be read"))?;
        if bytes != self.bytes {
            let why = format!("has {bytes} bytes instead of {}; {}", self.bytes, remedy());
            return Err(refused(place, &self.object, why));
        }
        Ok(object)
    }

    /// Reads the tail of the object of a step.
    ///
    /// # Errors
    /// If the object is missing, cut short or damaged.
    pub fn tail(&self, place: &dyn Place, step: Step) -> Result<Vec<u8>, BuildError> {
        let object = self.open(place, step)?;
        // The object has as many bytes.
        let bytes = self.bytes.saturating_sub(self.tail);
        let mut tail = vec![0; usize::try_from(bytes).unwrap_or(usize::MAX)];
        let read = object.read_exact_at(&mut tail, self.tail);
        read.map_err(failed(place, &self.object, "cannot be read"))?;
        if hash_of(&tail) != self.tail_hash { Err(self.damaged(place, step)) } else { Ok(tail) }
    }

    /// The error for an object whose bytes are not those that were written.
    pub fn damaged(&self, place: &dyn Place, step: Step) -> BuildError {
        let (record, command) = (step.record(), step.command());
        let why = format!("is damaged; remove the record {record} and run `{command}`");
        refused(place, &self.object, why)
    }
}

/// The object of a step being written.
pub struct Output<'a> {
    place: &'a dyn Place,
    step: Step,
    plan: &'a str,
    object: String,
    upload: Box<dyn Upload>,
    bytes: u64,
}

impl<'a> Output<'a> {
    /// Begins the object of a step of a plan, under a name of its own.
    ///
    /// # Errors
    /// If the place cannot be written.
    pub fn begin(place: &'a dyn Place, plan: &'a str, step: Step) -> Result<Self, BuildError> {
        let object = format!("{}-{}{}", step.record(), unique(), step.ending());
        let upload = place.begin(&object).map_err(failed(place, &object, "cannot be written"))?;
        Ok(Self { place, step, plan, object, upload, bytes: 0 })
    }

    /// Bytes that were written.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Appends bytes.
    ///
    /// # Errors
    /// If the place is full.
    pub fn write(&mut self, bytes: &[u8]) -> Result<(), BuildError> {
        self.bytes += bytes.len() as u64;
        let written = self.upload.write_all(bytes);
        written.map_err(failed(self.place, &self.object, "cannot be written"))
    }

    /// Appends the tail and creates the record of the step. Returns it, and whether it is this
    /// one: another job may have finished the step meanwhile, whose record counts.
    ///
    /// # Errors
    /// If the place is full; if the other job has another plan.
    pub fn publish(mut self, tail: &[u8]) -> Result<(Record, bool), BuildError> {
        let at = self.bytes;
        self.write(tail)?;
        let Self { place, step, plan, object, upload, bytes } = self;
        upload.finish().map_err(failed(place, &object, "cannot be written"))?;
        let record = Record {
            version: VERSION,
            plan: plan.into(),
            object: object.clone(),
            bytes,
            tail: at,
            tail_hash: hash_of(tail),
        };
        let name = step.record();
        let created = serde_json::to_vec(&record)
            .map_err(io::Error::from)
            .and_then(|text| place.create(&name, &text));
        if matches!(created, Ok(true)) {
            return Ok((record, true));
        }
        // A lost answer looks like a failure, or, once the request was repeated, like another job.
        match Record::find(place, plan, step)? {
            Some(found) if found.object == object => Ok((found, true)),
            Some(found) => {
                let removed = place.remove(&object);
                removed.map_err(failed(place, &object, "cannot be removed"))?;
                Ok((found, false))
            }
            None => {
                created.map_err(failed(place, &name, "cannot be created"))?;
                Err(refused(place, &name, "was removed while the step ended; run it again"))
            }
        }
    }
}
