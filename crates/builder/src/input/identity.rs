//! What a build is made of, by name: options and inputs. A build goes on only where all of it is
//! the same.

use crate::budget::shares::Shares;
use crate::calls::build::Options;
use crate::rows::journal_record::{Reading, Record};
use esker_scan::Source;
use std::collections::HashMap;
use std::time::UNIX_EPOCH;

/// Of what records of the journal hold; another where that changes.
const FORM: &str = "5";

/// Names and what stands behind them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Identity {
    /// Texts, that must be the same.
    parts: Vec<(String, String)>,
    memory_bytes: u64,
    /// What memory leaves for a chunk: where pages stand depends on it.
    pub chunk_bytes_max: u64,
}

impl Identity {
    /// Of a build of these inputs. Their times are looked at now, before they are read.
    pub fn of(sources: &[Box<dyn Source>], options: &Options, shares: &Shares) -> Self {
        let depth = options.colour_depth.map_or("detected".into(), |d| format!("{d:?}"));
        let mut parts = vec![
            ("Esker".into(), env!("CARGO_PKG_VERSION").into()),
            ("the form of the journal".into(), FORM.into()),
            ("--node-capacity".into(), options.node_capacity.to_string()),
            ("--colour-bits".into(), depth.to_lowercase()),
            ("--compress".into(), options.compress.name().into()),
            ("--normals".into(), format!("{:?}", options.normals).to_lowercase()),
            ("--sharp-features".into(), options.sharp_features.to_string()),
            ("--tangents".into(), options.tangents.to_string()),
            ("--compact".into(), options.compact.to_string()),
            ("--ignore-crs".into(), options.ignore_crs.to_string()),
            ("the lattice that is built onto".into(), format!("{:?}", options.onto.lattice)),
            ("the palette that is built onto".into(), {
                format!("{:?}", options.onto.palette.as_ref().map(|p| p.colours()))
            }),
            ("the forest appended to".into(), format!("{:?}", options.onto.forest)),
            ("what is merged".into(), {
                let merged = options.onto.merged.as_ref();
                merged.map_or("nothing".into(), |m| format!("{} points, {}", m.points, m.hash))
            }),
        ];
        // In the order in which they are read.
        let mut infos: Vec<_> = sources.iter().map(|s| s.info()).collect();
        infos.sort_by_key(|info| info.path.as_os_str().as_encoded_bytes());
        for info in infos {
            let modified = info.path.metadata().and_then(|m| m.modified()).ok();
            let since = modified.and_then(|time| time.duration_since(UNIX_EPOCH).ok());
            let time = since.map_or("unknown".into(), |t| {
                format!("{}.{:09} s since 1970", t.as_secs(), t.subsec_nanos())
            });
            let path = info.path.display();
            // First, so that it is what is missed where the input is another.
            parts.push((format!("the input {path}"), "named".into()));
            parts.push((format!("the size of {path}"), format!("{} bytes", info.bytes)));
            parts.push((format!("the points of {path}"), info.points_hint.to_string()));
            parts.push((format!("the time of change of {path}"), time));
        }
        let chunk_bytes_max = shares.chunk_bytes_max;
        Self { parts, memory_bytes: options.memory_bytes, chunk_bytes_max }
    }

    /// Writes it down.
    pub fn put(&self, record: &mut Record) {
        record.put([self.memory_bytes, self.chunk_bytes_max, self.parts.len() as u64]);
        for text in self.parts.iter().flat_map(|(name, text)| [name, text]) {
            record.put_all(text.as_bytes());
        }
    }

    /// What was written down.
    pub fn get(from: &mut Reading<'_>) -> Option<Self> {
        let [memory_bytes, chunk_bytes_max, count] = from.get()?;
        let part = |_| Some((from.get_text()?, from.get_text()?));
        let parts = (0..count).map(part).collect::<Option<_>>()?;
        Some(Self { parts, memory_bytes, chunk_bytes_max })
    }

    fn names(&self) -> impl Iterator<Item = &str> {
        self.parts.iter().map(|part| part.0.as_str())
    }

    /// What is not as it was, in words; more memory is no matter.
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
        let mut pairs = self.parts.iter().zip(&now.parts);
        if let Some(((name, was), (_, is))) = pairs.find(|(was, is)| was != is) {
            return Some(format!("{name} was {was}, and is {is}"));
        }
        (now.chunk_bytes_max < self.chunk_bytes_max).then(|| {
            let (was, is) = (self.memory_bytes, now.memory_bytes);
            format!("--memory was {was} bytes, and is {is}, which is less")
        })
    }
}
