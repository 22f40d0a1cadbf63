//! Fonts of the system, for names of files in scripts that the window's own fonts lack. They are
//! listed when the first such letter is drawn, since that takes a while.

use eframe::egui::Context;
use eframe::egui::epaint::text::{FallbackRequest, FontInsert, FontProvider};
use egui_system_font_provider::SystemFontProvider;
use std::sync::{Arc, OnceLock};

/// The system's fonts, once they are needed.
#[derive(Default)]
struct OnDemand(OnceLock<SystemFontProvider>);

impl FontProvider for OnDemand {
    fn font_for(&self, request: &FallbackRequest<'_>) -> Option<FontInsert> {
        self.0.get_or_init(SystemFontProvider::new).font_for(request)
    }
}

/// Lets a window use the system's fonts.
pub fn apply(ctx: &Context) {
    ctx.add_font_provider(Arc::new(OnDemand::default()));
}
