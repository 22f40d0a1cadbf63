//! What the stages of a frame took, told to people.

use esker_render::Pass;
use serde_json::Value;

/// Names and times of those stages that took a twentieth of a millisecond; others are most often
/// left out. `times` are milliseconds by name; `before` what ran before the first stage, `all` what
/// all of them are called together.
pub fn taken(times: &Value, before: &[&str], all: &str) -> String {
    let stages = Pass::ALL.map(Pass::name);
    let names = before.iter().copied().chain(stages).chain([all]);
    let times = names.map(|name| (name, times[name].as_f64().unwrap_or(0.0)));
    let taken = times.filter(|(_, ms)| *ms >= 0.05).map(|(name, ms)| format!("{name} {ms:.1}"));
    taken.collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn people_are_told_the_stages_that_took_time_in_their_order() {
        let times = json!({ "antialias": 0.1, "fit_planes": 1.26, "blend": 0.0, "select": 0.2, "draw": 3.0 });
        assert_eq!(
            taken(&times, &["select"], "draw"),
            "select 0.2, fit_planes 1.3, antialias 0.1, draw 3.0"
        );
    }
}
