//! The report: relations, cases and limits of each axis, exponents of times; as text, as a table in
//! Markdown, and as the reason of a failure.

use serde::Serialize;

/// Outcome of a comparison with a bound.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Verdict {
    /// The bound holds.
    Holds,
    /// It does not, beyond the rated conditions.
    Breaks,
    /// It does not, although it is rated, or must always hold.
    Broken,
    /// The program refuses the condition, with a message.
    Refused,
}

/// What was measured.
#[derive(Clone, Debug, Serialize)]
pub struct StabilityReport {
    /// Whether all values and points were tried.
    pub(super) is_full: bool,
    /// Threads of the pool.
    pub(super) threads: usize,
    /// Relations of each scan.
    pub(super) relations: Vec<Relation>,
    /// What moving each scan does.
    pub(super) floors: Vec<Floor>,
    /// A case for each axis, method and value.
    pub(super) cases: Vec<Case>,
    /// Limits of each axis and method.
    pub(super) axes: Vec<Limits>,
    /// Axes of traced light that the program lacks, as it is built without the feature `light`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(super) left_out: Vec<&'static str>,
    /// Exponents of the times of builds.
    pub(super) stiffness: Vec<Stiffness>,
}

/// A change of a scan that must not change its picture.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Relation {
    pub scan: String,
    pub relation: &'static str,
    /// Method of the picture, or `file` for the bytes of the file.
    pub method: &'static str,
    /// Unit of `bound` and `measured`.
    pub measure: &'static str,
    /// Greatest permitted value; 0 for equal pixels or bytes.
    pub bound: f64,
    pub measured: f64,
    pub verdict: Verdict,
}

/// What moving a scan, with its camera, does to its picture: other points are chosen for the levels
/// of detail, and normals are estimated from other cells.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Floor {
    pub scan: String,
    pub method: &'static str,
    /// Steps of the move along each axis.
    pub steps: i32,
    /// FLIP, the worst of the cameras.
    pub flip: f64,
}

/// A condition and what it does to a picture.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Case {
    pub axis: &'static str,
    pub method: &'static str,
    pub measure: &'static str,
    pub value: f64,
    pub bound: f64,
    /// None if the condition was refused, or nothing was drawn that could be measured.
    pub measured: Option<f64>,
    pub verdict: Verdict,
    /// Notes to the user, and the message of a refusal.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub messages: Vec<String>,
}

/// Limits of an axis for a method.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Limits {
    pub axis: &'static str,
    /// Meaning of the values.
    pub value_is: &'static str,
    pub method: &'static str,
    pub measure: &'static str,
    /// Maximum permissible error.
    pub bound: f64,
    /// Value up to which the bound must hold.
    pub rated_to: f64,
    /// Measure at the rated value.
    pub at_rated: Option<f64>,
    /// Last value of the sweep before the bound breaks.
    pub holds_to: Option<f64>,
    /// First value at which it breaks or is refused.
    pub breaks_at: Option<f64>,
    /// Measure there.
    pub broken_to: Option<f64>,
    /// Message to the user at that value.
    pub message: Option<String>,
}

/// Growth of the time of a build with a property of its scan.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Stiffness {
    /// The property.
    pub axis: &'static str,
    pub values: Vec<f64>,
    /// Median CPU time of a build, milliseconds, for each value.
    pub cpu_ms: Vec<f64>,
    /// Slope of the logarithm of the time over that of the value.
    pub slope: f64,
    pub bound: f64,
    pub verdict: Verdict,
}

impl StabilityReport {
    /// A report of nothing yet.
    pub(super) fn new(is_full: bool) -> Self {
        Self {
            is_full,
            threads: rayon::current_num_threads(),
            relations: Vec::new(),
            floors: Vec::new(),
            cases: Vec::new(),
            axes: Vec::new(),
            left_out: Vec::new(),
            stiffness: Vec::new(),
        }
    }
}

/// What is broken that must hold, in one line; none if all holds. Times do not count: they depend
/// on what else the machine does.
pub fn failure(report: &StabilityReport) -> Option<String> {
    let relations = report.relations.iter().filter(|r| r.verdict == Verdict::Broken);
    let relations = relations.map(|r| format!("{} of {} by {}", r.relation, r.scan, r.method));
    let cases = report.cases.iter().filter(|c| c.verdict == Verdict::Broken);
    let cases = cases.map(|c| format!("{} {} by {}", c.axis, c.value, c.method));
    let all: Vec<String> = relations.chain(cases).collect();
    (!all.is_empty())
        .then(|| format!("{} bounds are broken: {}; please report this", all.len(), all.join(", ")))
}

/// Writes the report for people.
pub fn text(report: &StabilityReport) -> String {
    let mut lines = Vec::new();
    if !report.relations.is_empty() {
        lines.push(format!(
            "{:<28} {:<26} {:<10} {:<7} {:>11} {:>11}  verdict",
            "relation", "scan", "method", "measure", "measured", "bound"
        ));
    }
    for r in &report.relations {
        lines.push(format!(
            "{:<28} {:<26} {:<10} {:<7} {:>11} {:>11}  {}",
            r.relation,
            r.scan,
            r.method,
            r.measure,
            short(r.measured),
            short(r.bound),
            word(r.verdict)
        ));
    }
    for floor in &report.floors {
        let Floor { scan, method, steps, flip } = floor;
        let flip = short(*flip);
        lines.push(format!("floor: {scan} moved by {steps} steps, {method}: flip {flip}"));
    }
    for limits in &report.axes {
        lines.push(format!(
            "\n{} ({}), {}: {} at most {}; rated to {}",
            limits.axis,
            limits.value_is,
            limits.method,
            limits.measure,
            short(limits.bound),
            short(limits.rated_to)
        ));
        let is_own = |case: &&Case| {
            case.axis == limits.axis
                && case.method == limits.method
                && case.measure == limits.measure
        };
        for case in report.cases.iter().filter(is_own) {
            let measured = case.measured.map_or("-".into(), short);
            let messages = case.messages.join("; ");
            let line = format!(
                "{:>11} {measured:>11}  {:<8} {messages}",
                short(case.value),
                word(case.verdict)
            );
            lines.push(line.trim_end().to_owned());
        }
    }
    if !report.left_out.is_empty() {
        let names = report.left_out.join(", ");
        lines.push(format!("\nleft out: {names}; this program is built without traced light"));
    }
    for stiff in &report.stiffness {
        let pairs = stiff.values.iter().zip(&stiff.cpu_ms);
        let pairs: Vec<String> =
            pairs.map(|(value, ms)| format!("{} {ms:.0} ms", short(*value))).collect();
        lines.push(format!(
            "\nbuild against {}: slope {:.2}, at most {}, {}: {}",
            stiff.axis,
            stiff.slope,
            stiff.bound,
            word(stiff.verdict),
            pairs.join(", ")
        ));
    }
    lines.join("\n")
}

/// Writes the limits as a table in Markdown.
pub fn markdown(report: &StabilityReport) -> String {
    let mut lines = vec![
        "| condition | value | method | measure | at most | rated to | there | breaks at | there | message |".to_owned(),
        "|---|---|---|---|---|---|---|---|---|---|".to_owned(),
    ];
    let or_none = |value: Option<f64>| value.map_or("-".into(), short);
    for limits in &report.axes {
        lines.push(format!(
            "| {} | {} | {} | {} | {} | {} | {} | {} | {} | {} |",
            limits.axis,
            limits.value_is,
            limits.method,
            limits.measure,
            short(limits.bound),
            short(limits.rated_to),
            or_none(limits.at_rated),
            or_none(limits.breaks_at),
            or_none(limits.broken_to),
            limits.message.as_deref().unwrap_or("none").replace('|', "\\|")
        ));
    }
    lines.join("\n")
}

/// A number with few digits.
pub(super) fn short(value: f64) -> String {
    let size = value.abs();
    if value == 0.0 {
        "0".into()
    } else if (1e-3..1e5).contains(&size) {
        let digits = (3 - size.log10().floor() as i32).clamp(0, 5) as usize;
        let text = format!("{value:.digits$}");
        if text.contains('.') {
            text.trim_end_matches('0').trim_end_matches('.').into()
        } else {
            text
        }
    } else {
        format!("{value:.0e}")
    }
}

fn word(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Holds => "holds",
        Verdict::Breaks => "breaks",
        Verdict::Broken => "BROKEN",
        Verdict::Refused => "refused",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn case(verdict: Verdict) -> Case {
        Case {
            axis: "noise",
            method: "ewa",
            measure: "FLIP",
            value: 0.5,
            bound: 0.1,
            measured: Some(0.2),
            verdict,
            messages: Vec::new(),
        }
    }

    #[test]
    fn only_what_is_rated_fails() {
        let mut report = StabilityReport::new(false);
        report.cases = [Verdict::Holds, Verdict::Breaks, Verdict::Refused].map(case).to_vec();
        assert_eq!(failure(&report), None);
        report.cases.push(case(Verdict::Broken));
        assert!(failure(&report).is_some_and(|text| text.contains("noise 0.5 by ewa")));
    }

    #[test]
    fn numbers_are_short() {
        let texts = [0.0, 0.05, 174.9, 1e8, 12.0, 0.00012, 300_000.0].map(short);
        assert_eq!(texts, ["0", "0.05", "174.9", "1e8", "12", "1e-4", "3e5"]);
    }
}
