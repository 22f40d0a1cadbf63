//! What the user can change while looking: budgets, detail, method, colours. Compared as a whole:
//! what the running session cannot change is reopened.

use esker_engine::draw::options::Options;
use esker_engine::{Filter, Method};

/// What a session costs and how it draws.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Points alone, or surfaces.
    pub method: Method,
    /// Where colours come from; the best there is where not said.
    pub colour_by: Option<String>,
    /// Which points are shown.
    pub filter: Filter,
    /// Whether surfaces have highlights.
    pub shines: bool,
    /// Whether differences of exposure between scans are evened out.
    pub evens_exposure: bool,
    /// Whether full planes are read where there are compact ones, too.
    pub full: bool,
    /// Points drawn at most.
    pub points_budget: u64,
    /// Distance of neighbouring points on the picture that is fine enough, pixels.
    pub target_spacing_px: f64,
    /// Drawing memory, bytes.
    pub budget_gpu_bytes: u64,
    /// Main memory beside that, bytes.
    pub budget_ram_bytes: u64,
    /// Whether what is hidden is left out.
    pub occlusion: bool,
}

impl Default for Settings {
    fn default() -> Self {
        let options = Options::default();
        Self {
            method: options.method,
            colour_by: options.colour_by,
            filter: options.filter,
            shines: options.shines,
            evens_exposure: options.evens_exposure,
            full: options.full,
            points_budget: options.points_budget,
            target_spacing_px: options.target_spacing_px,
            budget_gpu_bytes: options.budget_gpu_bytes,
            budget_ram_bytes: options.budget_ram_bytes,
            occlusion: options.occlusion,
        }
    }
}

impl Settings {
    /// Of a session for pictures of at most this size, but for what it draws on.
    pub fn options(&self, size: [u32; 2]) -> Options {
        Options {
            budget_gpu_bytes: self.budget_gpu_bytes,
            budget_ram_bytes: self.budget_ram_bytes,
            size,
            method: self.method,
            colour_by: self.colour_by.clone(),
            filter: self.filter.clone(),
            shines: self.shines,
            evens_exposure: self.evens_exposure,
            full: self.full,
            points_budget: self.points_budget,
            target_spacing_px: self.target_spacing_px,
            occlusion: self.occlusion,
            ..Options::default()
        }
    }
}

impl Settings {
    /// Takes the next of these sources of colours.
    pub fn next_colour(&mut self, sources: &[String]) {
        let at = |name: &String| sources.iter().position(|s| s == name);
        let next = self.colour_by.as_ref().and_then(at).map_or(0, |i| i + 1);
        self.colour_by = sources.get(next % sources.len().max(1)).cloned();
    }
}
