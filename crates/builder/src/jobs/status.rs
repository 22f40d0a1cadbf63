//! What is done of a divided build, what is missing, and what killed jobs have left.

use crate::error::BuildError;
use crate::jobs::cut_file::Cut;
use crate::jobs::joined::Joined;
use crate::jobs::place::{Listed, Place};
use crate::jobs::planned::Planned;
use crate::jobs::step::{Record, Step, failed};

/// State of the steps of one kind.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct StepsState {
    /// Number of steps; `None` while an earlier step decides it.
    pub count: Option<u32>,
    /// Indices of steps that are not finished.
    pub missing: Vec<u32>,
    /// What is wrong with finished steps whose objects are missing or cut short.
    pub damaged: Vec<String>,
}

/// State of a divided build.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Status {
    /// XXH3-128 of the plan.
    pub plan: String,
    /// The takes.
    pub takes: StepsState,
    /// The cut.
    pub cut: StepsState,
    /// Builds of parts.
    pub builds: StepsState,
    /// The joining of the parts.
    pub join: StepsState,
    /// Objects that no record names: jobs are writing them, or were killed.
    pub leftovers: Vec<Listed>,
}

impl StepsState {
    /// Whether all steps are finished.
    pub fn is_done(&self) -> bool {
        self.count.is_some() && self.missing.is_empty() && self.damaged.is_empty()
    }
}

/// Examines a place.
///
/// # Errors
/// If it has no plan, or cannot be read.
pub fn status(place: &dyn Place) -> Result<Status, BuildError> {
    let planned = Planned::read(place)?;
    let mut named = Vec::new();
    let mut of = |steps: Option<u32>, step: &dyn Fn(u32) -> Step| {
        let mut state = StepsState { count: steps, ..StepsState::default() };
        for index in 0..steps.unwrap_or(0) {
            let step = step(index);
            match Record::find(place, &planned.hash, step) {
                Ok(None) => state.missing.push(index),
                Ok(Some(record)) => {
                    let damaged = record.open(place, step).err();
                    state.damaged.extend(damaged.map(|error| error.to_string()));
                    named.push(record.object);
                }
                Err(error) => state.damaged.push(error.to_string()),
            }
        }
        state
    };
    let takes = of(Some(planned.takes.len() as u32), &Step::Take);
    let cut = of(Some(1), &|_| Step::Cut);
    let builds =
        if cut.is_done() { Some(Cut::read(place, &planned)?.builds.len() as u32) } else { None };
    let builds = of(builds, &Step::Build);
    let join = match Joined::find(place, &planned.hash) {
        Ok(Some(_)) => StepsState { count: Some(1), ..StepsState::default() },
        Ok(None) => StepsState { count: Some(1), missing: vec![0], ..StepsState::default() },
        Err(error) => StepsState { damaged: vec![error.to_string()], ..StepsState::default() },
    };
    let mut leftovers = Vec::new();
    for prefix in ["take/", "build/", "cut-", "plan.json-"] {
        let listed = place.list(prefix).map_err(failed(place, prefix, "cannot be listed"))?;
        // The names of records have no random part.
        let is_left = |object: &Listed| object.name.contains('-') && !named.contains(&object.name);
        leftovers.extend(listed.into_iter().filter(is_left));
    }
    Ok(Status { plan: planned.hash, takes, cut, builds, join, leftovers })
}

/// Removes objects that no record names. No job of the build may be running.
///
/// # Errors
/// If the place cannot be written.
pub fn remove_leftovers(place: &dyn Place, status: &Status) -> Result<(), BuildError> {
    for object in &status.leftovers {
        let removed = place.remove(&object.name);
        removed.map_err(failed(place, &object.name, "cannot be removed"))?;
    }
    Ok(())
}
