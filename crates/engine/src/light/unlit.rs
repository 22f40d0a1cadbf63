//! Stands in for the drawer of lit frames in programs that were built without light: there is none.

use crate::light::check_built;
use crate::light::settings::LightSettings;
use crate::light::status::LitStatus;
use anyhow::{Result, bail};
use esker_render::{Frame, Picture};

/// A drawer of lit frames, which no value can be.
pub(crate) enum Progressive {}

impl Progressive {
    /// Refuses to light.
    ///
    /// # Errors
    /// Always.
    pub(crate) fn new(_: &LightSettings, _: u64) -> Result<Self> {
        check_built()?;
        bail!("this program does not light")
    }

    pub(crate) fn status(&self) -> LitStatus {
        match *self {}
    }

    pub(crate) fn is_converged(&self) -> bool {
        match *self {}
    }

    pub(crate) fn draw(
        &mut self,
        _: &Frame<'_>,
        _: &[Option<&[u8]>],
        _: u64,
        _: &LightSettings,
        _: &mut Picture,
    ) {
        match *self {}
    }
}
