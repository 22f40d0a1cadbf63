//! Changes of a running session: colours, ranges, filter, budgets, occlusion, culling. Resident
//! planes that a change does not affect stay, and the camera and the picture too: frames show the
//! change once the nodes of the picture have the planes for it.
//!
//! What takes another session: light for a session without it, and the other way round; exposure
//! compensation that was off when the session was opened; budgets of a lit session; more memory
//! of a GPU than the session was opened with, or less than one page of it; and a budget of main
//! memory that is too small for what is allocated.

use crate::cameras::boxes::Boxes;
use crate::cameras::vertical::Vertical;
use crate::draw::budget::Shares;
use crate::draw::frame::Appearance;
use crate::draw::method::Method;
use crate::draw::options::{Options, Settings};
use crate::draw::session::Session;
use anyhow::Result;
use esker_format::Forest;
use esker_points::Filter;
use esker_stream::{Limits, Shown};

/// Settings with what is computed for them from a file: made on any thread, since statistics of the
/// file are read for filters and ranges.
#[derive(Clone, Debug)]
pub struct Change {
    settings: Settings,
    appearance: Appearance,
    boxes: Boxes,
}

/// Budgets and detail of pictures, as in [`Settings`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Budgets {
    /// Most points of a picture.
    pub points: u64,
    /// Distance of adjacent points in the picture that is fine enough, pixels.
    pub target_spacing_px: f64,
    /// Bytes of drawing memory; on a GPU, of all buffers.
    pub gpu_bytes: u64,
    /// Bytes of main memory.
    pub ram_bytes: u64,
}

impl Change {
    /// A change of a session on `file` to these settings.
    ///
    /// # Errors
    /// If the file lacks the source of colours or what the filter needs, or the filter is invalid.
    pub fn new(file: &Forest, mut settings: Settings) -> Result<Self> {
        settings.light = settings.light.measured(file.lattice());
        let appearance = Appearance::of(file, &settings)?;
        let boxes = appearance.boxes(file, &settings);
        Ok(Self { settings, appearance, boxes })
    }
}

impl Session {
    /// Changes all settings that differ. Returns false, and changes nothing, if that takes another
    /// session; the head of this module names the cases.
    ///
    /// # Errors
    /// As for [`Change::new`]; if the session has ended. The session then stays as it was.
    pub fn set(&mut self, settings: Settings) -> Result<bool> {
        let change = Change::new(self.file(), settings)?;
        self.apply(change)
    }

    /// Colours points by `colour_by`, a source with a range if the user gave one
    /// ([`crate::cameras::colour::colouring`]); none for the best that the file has. Returns as
    /// [`Session::set`].
    ///
    /// # Errors
    /// As for [`Session::set`].
    pub fn set_colours(&mut self, colour_by: Option<String>) -> Result<bool> {
        self.set(Settings { colour_by, ..self.settings().clone() })
    }

    /// Shows the points that `filter` accepts. Returns as [`Session::set`].
    ///
    /// # Errors
    /// As for [`Session::set`].
    pub fn set_filter(&mut self, filter: Filter) -> Result<bool> {
        self.set(Settings { filter, ..self.settings().clone() })
    }

    /// Shows a cloud of a file that holds several, or not ([`Forest::together`]). Its nodes stay in
    /// memory until others need their place. Returns as [`Session::set`].
    ///
    /// # Errors
    /// As for [`Session::set`].
    pub fn set_visible(&mut self, cloud: usize, is_visible: bool) -> Result<bool> {
        let mut settings = self.settings().clone();
        settings.hidden_clouds.retain(|hidden| *hidden != cloud);
        if !is_visible {
            settings.hidden_clouds.push(cloud);
        }
        self.set(settings)
    }

    /// Measures elevations along `vertical`. Returns as [`Session::set`].
    ///
    /// # Errors
    /// As for [`Session::set`].
    pub fn set_vertical(&mut self, vertical: Vertical) -> Result<bool> {
        self.set(Settings { vertical, ..self.settings().clone() })
    }

    /// Changes budgets and detail. Memory beyond smaller budgets is freed once no picture is drawn
    /// from it, a frame or a few later. Returns as [`Session::set`].
    ///
    /// # Errors
    /// As for [`Session::set`], and if a budget is too small for any session on the file.
    pub fn set_budgets(&mut self, budgets: Budgets) -> Result<bool> {
        let Budgets { points, target_spacing_px, gpu_bytes, ram_bytes } = budgets;
        self.set(Settings {
            points_budget: points,
            target_spacing_px,
            budget_gpu_bytes: gpu_bytes,
            budget_ram_bytes: ram_bytes,
            ..self.settings().clone()
        })
    }

    /// Leaves hidden nodes out, or not. Returns as [`Session::set`].
    ///
    /// # Errors
    /// As for [`Session::set`].
    pub fn set_occlusion(&mut self, occlusion: bool) -> Result<bool> {
        self.set(Settings { occlusion, ..self.settings().clone() })
    }

    /// Leaves points out whose normal looks away from the eye, or not. Returns as [`Session::set`].
    ///
    /// # Errors
    /// As for [`Session::set`].
    pub fn set_culling(&mut self, culls_back: bool) -> Result<bool> {
        self.set(Settings { culls_back, ..self.settings().clone() })
    }

    /// Makes a change that was prepared for the file of the session. Never waits. Returns as
    /// [`Session::set`].
    ///
    /// # Errors
    /// If a budget is too small for any session on the file, or the session has ended. The session
    /// then stays as it was.
    pub fn apply(&mut self, change: Change) -> Result<bool> {
        let Change { settings, appearance, boxes } = change;
        let Some(shares) = self.shares_for(&settings)? else { return Ok(false) };
        let present = self.shown();
        let wanted = appearance.shown_by(&self.file, &settings.light);
        let Some(limits) = self.limits_for(&settings, &shares, &[&present, &wanted])? else {
            return Ok(false);
        };
        let is_read = !self.appearance.reads_as(&appearance) || present.needs != wanted.needs;
        let is_same = self.options.settings == settings;
        (self.options.settings, self.shares, self.boxes) = (settings, shares, boxes);
        if is_read {
            self.set_look(appearance);
        } else {
            self.appearance = appearance;
        }
        if let Some(streamer) = &self.running()?.streamer {
            streamer.limit(limits);
        }
        if !is_same {
            self.show();
        }
        Ok(true)
    }

    /// Shares of memory for other settings; `None` if they take another session.
    fn shares_for(&self, settings: &Settings) -> Result<Option<Shares>> {
        let present = &self.options.settings;
        let is_lit = |settings: &Settings| settings.method == Method::Lit;
        let memory = |s: &Settings| [s.budget_gpu_bytes, s.budget_ram_bytes];
        let has_memory = memory(settings) == memory(present);
        if is_lit(settings) != is_lit(present)
            || settings.light.meshes != present.light.meshes
            || (settings.evens_exposure && !self.had_exposure)
            || (is_lit(settings) && !has_memory)
        {
            return Ok(None);
        }
        if has_memory {
            return Ok(Some(self.shares));
        }
        // Runs are lent all the time, so that there are always as many.
        let of = |runs| {
            let settings = Settings { evens_exposure: self.had_exposure, ..settings.clone() };
            Shares::of(&self.file, &Options { settings, runs, ..self.options.clone() })
        };
        of(self.options.runs)?;
        Ok(of(Some(self.shares.runs())).ok())
    }

    /// Budgets of streaming for other settings; `None` if they take another session. `shown`: what
    /// is shown at the same time while it changes.
    fn limits_for(
        &mut self,
        settings: &Settings,
        shares: &Shares,
        shown: &[&Shown],
    ) -> Result<Option<Limits>> {
        let points_max = shares.lit.map_or(u64::MAX, |(points_max, _)| points_max);
        let running = self.running()?;
        let Some(drawing_bytes) = running.painter.bytes_within(settings.budget_gpu_bytes) else {
            return Ok(None);
        };
        let limits = Limits {
            drawing_bytes,
            points_budget: settings.points_budget.min(points_max),
            target_spacing_px: settings.target_spacing_px,
            occlusion: settings.occlusion,
        };
        // The newest cut may still show what was set earlier.
        let fits = running.streamer.as_ref().is_some_and(|streamer| {
            let cut = streamer.cut();
            let all: Vec<_> = shown.iter().copied().chain([&*cut.shown]).collect();
            streamer.check(&all, &limits).is_ok()
        });
        if fits {
            running.painter.resize(drawing_bytes);
        }
        Ok(fits.then_some(limits))
    }
}
