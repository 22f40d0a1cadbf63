//! The settings that the user can change in the window: budgets, detail, method, colours, filter.
//! The scene compares them as a whole, and changes the running session, or opens another one where
//! that takes one ([`esker_engine::draw::change`]).

use esker_engine::cameras::colour_request::parts;
pub use esker_engine::draw::options::Settings;

/// Selects the colour source that follows the present one in `sources`; the first one follows the
/// last.
pub fn next_colour(settings: &mut Settings, sources: &[String]) {
    let at = |text: &String| {
        let name = parts(text).map_or(text.as_str(), |of| of.name);
        sources.iter().position(|source| source == name)
    };
    let next = settings.colour_by.as_ref().and_then(at).map_or(0, |i| i + 1);
    settings.colour_by = sources.get(next % sources.len().max(1)).cloned();
}
