//! What a build depends on: options and inputs, as pairs of name and value. An interrupted build is
//! resumed only if all of them are equal.

use crate::budget::shares::Shares;
use crate::options::Options;
use crate::rows::journal_record::{Record, RecordReader};
use esker_scan::Source;
use std::collections::HashMap;
use std::path::Path;
use std::time::UNIX_EPOCH;

/// Version of the records of the journal; changes with their content.
const JOURNAL_VERSION: &str = "10";

/// When a file was last changed, as text; "unknown" if the system does not say.
pub fn time_of_change(path: &Path) -> String {
    let modified = path.metadata().and_then(|m| m.modified()).ok();
    let since = modified.and_then(|time| time.duration_since(UNIX_EPOCH).ok());
    since.map_or("unknown".into(), |t| {
        format!("{}.{:09} s since 1970", t.as_secs(), t.subsec_nanos())
    })
}

/// Options and inputs of a build.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Identity {
    /// Names and values, which must be equal.
    entries: Vec<(String, String)>,
    memory_bytes: u64,
    /// Memory for chunks, in bytes: the list of steps depends on it.
    pub chunk_bytes_max: u64,
}

impl Identity {
    /// Identity of a build of `sources`. Must be called before they are read, since it takes their
    /// modification times.
    pub fn of(sources: &[Box<dyn Source>], options: &Options, shares: &Shares) -> Self {
        let mut entries = Self::of_options(options);
        // In the order in which they are read.
        let mut infos: Vec<_> = sources.iter().map(|s| s.info()).collect();
        infos.sort_by_key(|info| info.path.as_os_str().as_encoded_bytes());
        for info in infos {
            let time = time_of_change(&info.path);
            let path = info.path.display();
            // First, so that it is the reported difference if another input was given.
            entries.push((format!("the input {path}"), "named".into()));
            entries.push((format!("the size of {path}"), format!("{} bytes", info.bytes)));
            entries.push((format!("the points of {path}"), info.points_hint.to_string()));
            entries.push((format!("the time of change of {path}"), time));
        }
        let chunk_bytes_max = shares.chunk_bytes_max;
        Self { entries, memory_bytes: options.memory_bytes, chunk_bytes_max }
    }

    fn of_options(options: &Options) -> Vec<(String, String)> {
        let depth = options.colour_depth.map_or("detected".into(), |d| format!("{d:?}"));
        let inherited = &options.inherited;
        vec![
            ("Esker".into(), env!("CARGO_PKG_VERSION").into()),
            ("the form of the journal".into(), JOURNAL_VERSION.into()),
            ("--node-capacity".into(), options.node_capacity.to_string()),
            ("--colour-bits".into(), depth.to_lowercase()),
            ("--compress".into(), options.compress.name().into()),
            ("--normals".into(), format!("{:?}", options.normals).to_lowercase()),
            ("--sharp-features".into(), options.sharp_features.to_string()),
            ("--tangents".into(), options.tangents.to_string()),
            ("--compact".into(), options.compact.to_string()),
            ("--ignore-crs".into(), options.ignore_crs.to_string()),
            ("--columns".into(), options.columns.as_ref().map_or("none".into(), |c| c.to_string())),
            ("--skip-lines".into(), options.skip_lines.to_string()),
            ("--drop-outside".into(), options.drop_outside.to_string()),
            ("--apply-viewpoint".into(), options.apply_viewpoint.to_string()),
            ("--crs".into(), options.crs.as_ref().map_or("none", |crs| &crs.text).to_owned()),
            ("--unit".into(), options.unit.as_deref().unwrap_or("none").to_owned()),
            ("the lattice that is built onto".into(), format!("{:?}", inherited.lattice)),
            ("the palette that is built onto".into(), {
                format!("{:?}", inherited.palette.as_ref().map(|p| p.colours()))
            }),
            ("the forest appended to".into(), format!("{:?}", inherited.forest)),
            ("what is merged".into(), {
                let merged = inherited.merged.as_ref();
                merged.map_or("nothing".into(), |m| format!("{} points, {}", m.points, m.hash))
            }),
        ]
    }

    /// Adds the identity to a record.
    pub fn put(&self, record: &mut Record) {
        record.put([self.memory_bytes, self.chunk_bytes_max, self.entries.len() as u64]);
        for text in self.entries.iter().flat_map(|(name, value)| [name, value]) {
            record.put_all(text.as_bytes());
        }
    }

    /// Reads an identity from a record.
    pub fn get(from: &mut RecordReader<'_>) -> Option<Self> {
        let [memory_bytes, chunk_bytes_max, count] = from.get()?;
        let entry = |_| Some((from.get_text()?, from.get_text()?));
        let entries = (0..count).map(entry).collect::<Option<_>>()?;
        Some(Self { entries, memory_bytes, chunk_bytes_max })
    }

    fn names(&self) -> impl Iterator<Item = &str> {
        self.entries.iter().map(|entry| entry.0.as_str())
    }

    /// Describes the first difference to the identity `now`, for the user. More memory is allowed.
    pub fn difference(&self, now: &Self) -> Option<String> {
        let counts = |of: &Self| {
            let mut counts = HashMap::new();
            Self::names(of).for_each(|name| *counts.entry(name.to_owned()).or_insert(0) += 1);
            counts
        };
        let (before, after) = (counts(self), counts(now));
        if let Some(gone) = Self::names(self).find(|name| !after.contains_key(*name)) {
            return Some(format!("{gone} was given, and is not now"));
        }
        if let Some(new) = Self::names(now).find(|name| !before.contains_key(*name)) {
            return Some(format!("{new} was not given"));
        }
        if let Some(name) = Self::names(self).find(|name| before[*name] != after[*name]) {
            let (was, is) = (before[name], after[name]);
            return Some(format!("{name} was given {was} times, and is {is} times now"));
        }
        let mut pairs = self.entries.iter().zip(&now.entries);
        if let Some(((name, was), (_, is))) = pairs.find(|(was, is)| was != is) {
            return Some(format!("{name} was {was}, and is {is}"));
        }
        (now.chunk_bytes_max < self.chunk_bytes_max).then(|| {
            let (was, is) = (self.memory_bytes, now.memory_bytes);
            format!("--memory was {was} bytes, and is {is}, which is less")
        })
    }
}
