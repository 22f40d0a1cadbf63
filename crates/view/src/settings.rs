//! What the user can change while looking: budgets, detail, method, colours, filter. Settings are
//! compared as a whole: the session is opened again for those that it cannot change while it runs.

pub use esker_engine::draw::options::Settings;

/// Changes the source of colours to the next one of `sources`.
pub fn next_colour(settings: &mut Settings, sources: &[String]) {
    let at = |name: &String| sources.iter().position(|s| s == name);
    let next = settings.colour_by.as_ref().and_then(at).map_or(0, |i| i + 1);
    settings.colour_by = sources.get(next % sources.len().max(1)).cloned();
}
