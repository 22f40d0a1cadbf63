//! A field for a path over the picture, where the system shows no dialog for files; and the
//! question whether a file is to be replaced.

use crate::theme;
use eframe::egui::{
    Align2, Area, Context, Frame, Id, Key, Label, Margin, Order, RichText, TextEdit, vec2,
};
use esker_engine::io::address::shown;
use std::path::{Path, PathBuf};

/// Width of the field, points.
const WIDTH: f32 = 420.0;

/// What a path is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// The file is opened.
    Open,
    /// The built file is copied there.
    Keep,
    /// The scene document is written there.
    SaveScene,
}

/// The field.
#[derive(Debug)]
pub struct Prompt {
    purpose: Purpose,
    text: String,
    /// Why the last path was not taken.
    fault: Option<String>,
    /// A file that is there already, which the user may have replaced.
    replaces: Option<PathBuf>,
    /// Whether the field has got the focus.
    is_shown: bool,
}

/// What the user has chosen.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Chosen {
    /// What the path is for.
    pub purpose: Purpose,
    /// The path.
    pub path: PathBuf,
    /// Whether the user wants to replace the file that is there.
    pub may_replace: bool,
}

impl Purpose {
    /// What the user does.
    pub fn title(self) -> &'static str {
        match self {
            Self::Open => "Open a scan, a folder of scans, an .esker file or a scene document",
            Self::Keep => "Keep the built file as",
            Self::SaveScene => "Save the scene as",
        }
    }

    fn button(self) -> &'static str {
        match self {
            Self::Open => "Open",
            Self::Keep => "Keep",
            Self::SaveScene => "Save",
        }
    }
}

impl Prompt {
    /// A field that holds `path`.
    pub fn new(purpose: Purpose, path: &Path) -> Self {
        let text = path.display().to_string();
        Self { purpose, text, fault: None, replaces: None, is_shown: false }
    }

    /// The field with a file that is there already.
    pub fn exists(purpose: Purpose, path: PathBuf) -> Self {
        let fault = Some(format!("{}: there is such a file already", path.display()));
        Self { fault, replaces: Some(path.clone()), ..Self::new(purpose, &path) }
    }

    /// Shows the field. Returns whether it stays open, and what was chosen.
    pub fn show(&mut self, ctx: &Context) -> (bool, Option<Chosen>) {
        let is_ended = ctx.input(|i| i.key_pressed(Key::Escape));
        let (mut chosen, mut is_cancelled) = (None, false);
        let area = Area::new(Id::unique("prompt")).order(Order::Foreground);
        area.anchor(Align2::CENTER_TOP, vec2(0.0, 60.0)).show(ctx, |ui| {
            let inks = theme::inks(ui);
            let frame =
                Frame::NONE.fill(inks.panel).inner_margin(Margin::same(16)).corner_radius(8);
            frame.show(ui, |ui| {
                ui.set_width(WIDTH.min(ctx.content_rect().width() - 48.0));
                let title = ui.label(RichText::new(self.purpose.title()).strong());
                let field = TextEdit::singleline(&mut self.text).desired_width(f32::INFINITY);
                let field = ui.add(field).labelled_by(title.id);
                if !std::mem::replace(&mut self.is_shown, true) {
                    field.request_focus();
                }
                let enter = field.lost_focus() && ui.input(|i| i.key_pressed(Key::Enter));
                if let Some(fault) = &self.fault {
                    ui.add(Label::new(RichText::new(fault).color(inks.fault)).wrap());
                }
                let path = path_of(&self.text);
                let replaces = self.replaces.as_ref() == Some(&path);
                ui.horizontal(|ui| {
                    let name = if replaces { "Replace it" } else { self.purpose.button() };
                    // Enter never replaces a file.
                    let taken = ui.button(name).clicked() || (enter && !replaces);
                    if taken && !self.text.trim().is_empty() {
                        let (purpose, may_replace) = (self.purpose, replaces);
                        chosen = Some(Chosen { purpose, path, may_replace });
                    }
                    is_cancelled = ui.button("Cancel").clicked();
                });
            });
        });
        (!is_ended && !is_cancelled && chosen.is_none(), chosen)
    }
}

/// The path that a text names: without blanks around it, the quotes of file managers, and secrets
/// of an address.
fn path_of(text: &str) -> PathBuf {
    let text = text.trim();
    let inner = text.strip_prefix('"').and_then(|text| text.strip_suffix('"'));
    let inner = inner.or_else(|| text.strip_prefix('\'')?.strip_suffix('\''));
    shown(Path::new(inner.unwrap_or(text)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_are_taken_without_quotes_and_blanks() {
        for text in ["a b.json", " a b.json ", "\"a b.json\"", "'a b.json' "] {
            assert_eq!(path_of(text), Path::new("a b.json"), "{text}");
        }
        assert_eq!(path_of("'a"), Path::new("'a"));
        let address = Path::new("https://host/prompt.esker");
        assert_eq!(path_of(" https://host/prompt.esker?signature=x "), address);
    }
}
