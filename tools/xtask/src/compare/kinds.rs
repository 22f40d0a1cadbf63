//! Rows of reports that can be compared: which list of a report they are in, which fields tell a
//! row from others, and which figures have a direction. Times are those of the CPU where both rows
//! have them; wall time depends on what else the machine does.

use serde_json::Value;

/// Rows of one kind.
pub struct Kind {
    /// Name for people.
    pub name: &'static str,
    /// Field of the report that has the rows.
    pub list: &'static str,
    /// JSON pointers of fields that every row of this kind has, and rows of others do not.
    pub marks: &'static [&'static str],
    /// JSON pointers of what tells a row from others; a field may be missing.
    pub id: &'static [&'static str],
    /// Whether a row counts.
    pub counts: fn(&Value) -> bool,
    /// What is compared.
    pub figures: &'static [Figure],
}

/// A figure of a row.
pub struct Figure {
    /// Where it is, in order of preference: the first source that both rows have is compared.
    pub sources: &'static [Source],
    /// Differences up to this are none, in the unit of the figure.
    pub least: f64,
    /// Whether it is a time, which depends on the machine.
    pub is_time: bool,
}

/// Where a figure is.
pub struct Source {
    /// JSON pointer of the value.
    pub field: &'static str,
    /// What the same program measures again.
    pub noise: Noise,
}

/// Differences between runs of the same program.
#[derive(Clone, Copy)]
pub enum Noise {
    /// Between the least and the greatest of all values at this JSON pointer.
    Range(&'static str),
    /// Beside the quartiles at this JSON pointer, as far as a value is no outlier.
    Quartiles(&'static str),
    /// Spread of other values, at this JSON pointer, around their median; the figure itself has
    /// none.
    SpreadOf(&'static str),
    /// A share of the value. It is 0 for what does not depend on time or threads.
    Share(f64),
}

/// Share of a time below which no difference counts, whatever the range of a few runs.
pub const SHARE_LEAST: f64 = 0.05;

const fn error(sources: &'static [Source], least: f64) -> Figure {
    Figure { sources, least, is_time: false }
}

const fn time(sources: &'static [Source]) -> Figure {
    Figure { sources, least: 0.0, is_time: true }
}

const fn source(field: &'static str, noise: Noise) -> Source {
    Source { field, noise }
}

const NO_NOISE: Noise = Noise::Share(0.0);

fn always(_: &Value) -> bool {
    true
}

/// All kinds.
pub static KINDS: [Kind; 8] = [
    Kind {
        name: "error against run time",
        list: "rows",
        marks: &["/settings/method", "/flip"],
        id: &["/file", "/backend", "/settings", "/build/options"],
        // Settings that were chosen for a time follow the speed of the machine.
        counts: |row| row.pointer("/settings/budget_ms").is_none(),
        figures: &[
            time(&[
                source("/cpu_ms", Noise::Quartiles("/cpu_ms_quartiles")),
                source("/ms", Noise::Quartiles("/ms_quartiles")),
            ]),
            error(&[source("/flip", NO_NOISE)], 2e-4),
            error(&[source("/hole_share", NO_NOISE)], 1e-4),
            error(&[source("/bleeding_share", NO_NOISE)], 1e-4),
            error(&[source("/depth_px", NO_NOISE)], 0.01),
            error(&[source("/normal_deg", NO_NOISE)], 0.02),
            error(&[source("/flicker", NO_NOISE)], 0.02),
            error(&[source("/build/bytes", NO_NOISE)], 0.0),
        ],
    },
    Kind {
        name: "streaming",
        list: "streaming",
        marks: &["/area_ms", "/priority"],
        id: &["/file", "/view", "/priority"],
        counts: always,
        figures: &[time(&[source("/area_ms", Noise::Quartiles("/area_quartiles_ms"))])],
    },
    Kind {
        name: "build",
        list: "rows",
        marks: &["/program", "/input", "/seconds"],
        id: &["/program", "/input", "/points"],
        counts: |row| ["esker", "decode"].iter().any(|program| row["program"] == *program),
        figures: &[
            time(&[
                source("/cpu_seconds", Noise::SpreadOf("/seconds_each")),
                source("/seconds", Noise::Range("/seconds_each")),
            ]),
            error(&[source("/peak_rss_bytes", Noise::Share(0.05))], 0.0),
            error(&[source("/bytes_out", NO_NOISE)], 0.0),
        ],
    },
    Kind {
        name: "frames by method",
        list: "rows",
        marks: &["/model", "/total_ms", "/least_ms"],
        id: &["/backend", "/method", "/model", "/width", "/height", "/points", "/radius_factor"],
        counts: always,
        figures: &[time(&[source("/least_ms/total", Noise::Share(0.1))])],
    },
    Kind {
        name: "size",
        list: "rows",
        marks: &["/packing", "/bytes_a_point"],
        id: &["/file", "/view", "/packing"],
        counts: always,
        figures: &[
            error(&[source("/bytes", NO_NOISE)], 0.0),
            error(&[source("/picture_difference", NO_NOISE)], 0.0),
        ],
    },
    Kind {
        name: "relations",
        list: "relations",
        marks: &["/relation", "/measured"],
        id: &["/scan", "/relation", "/method", "/measure"],
        counts: always,
        figures: &[error(&[source("/measured", NO_NOISE)], 0.0)],
    },
    Kind {
        name: "conditions",
        list: "cases",
        marks: &["/axis", "/measured"],
        id: &["/axis", "/method", "/measure", "/value"],
        counts: always,
        figures: &[error(&[source("/measured", NO_NOISE)], 1e-4)],
    },
    Kind {
        name: "exponents of build times",
        list: "stiffness",
        marks: &["/axis", "/slope"],
        id: &["/axis"],
        counts: always,
        figures: &[error(&[source("/slope", Noise::Share(0.1))], 0.1)],
    },
];

impl Kind {
    /// The rows of this kind in a report.
    pub fn rows<'a>(&self, report: &'a Value) -> Vec<&'a Value> {
        let is_own = |row: &&Value| self.marks.iter().all(|mark| row.pointer(mark).is_some());
        let all = report[self.list].as_array().map_or(&[][..], Vec::as_slice);
        all.iter().filter(is_own).filter(|row| (self.counts)(row)).collect()
    }

    /// What tells a row from others, as text. The method of settings is named once.
    pub fn id(&self, row: &Value) -> String {
        let parts = self.id.iter().filter_map(|field| row.pointer(field)).map(words);
        parts.filter(|part| !part.is_empty()).collect::<Vec<_>>().join(", ")
    }
}

/// A value in words: fields of an object as `name value`, without quotation marks.
fn words(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Object(fields) => {
            let field = |(name, value): (&String, &Value)| format!("{name} {}", words(value));
            fields.iter().map(field).collect::<Vec<_>>().join(" ")
        }
        other => other.to_string(),
    }
}
