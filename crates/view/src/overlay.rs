//! What lies over the picture on demand: the overview of keys and mouse buttons, and the list of
//! commands in which one is found by its name.

use crate::commands::{COMMANDS, Command, GESTURES};
use crate::theme;
use eframe::egui::{
    Align2, Area, Context, Frame, Grid, Id, Key, Margin, Order, Response, RichText, ScrollArea,
    Sense, TextEdit, Ui, vec2,
};

/// Width of the list of commands, points.
const LIST_WIDTH: f32 = 360.0;

/// What is open.
#[derive(Debug, Default)]
pub struct Overlay {
    /// Whether the overview of keys is shown.
    has_keys: bool,
    list: Option<List>,
}

/// The list of commands.
#[derive(Debug, Default)]
struct List {
    /// What the user has typed.
    text: String,
    /// Row that Enter takes, among those that match.
    row: usize,
}

impl Overlay {
    /// Shows or hides the overview of keys.
    pub fn toggle_keys(&mut self) {
        self.has_keys = !self.has_keys;
    }

    /// Shows or hides the list of commands.
    pub fn toggle_list(&mut self) {
        self.list = if self.list.is_some() { None } else { Some(List::default()) };
    }

    /// Closes what is open. Returns whether anything was.
    pub fn close(&mut self) -> bool {
        let was_open = self.has_keys || self.list.is_some();
        *self = Self::default();
        was_open
    }

    /// Shows what is open. Returns the command that was chosen from the list.
    pub fn show(&mut self, ctx: &Context) -> Option<Command> {
        // In small windows the overview covers the panel, so that a click on it must remove it.
        if self.has_keys && boxed(ctx, "keys", Align2::CENTER_CENTER, keys).clicked() {
            self.has_keys = false;
        }
        let list = self.list.as_mut()?;
        let is_ended = ctx.input(|i| i.key_pressed(Key::Escape));
        let mut chosen = None;
        let shown = boxed(ctx, "commands", Align2::CENTER_TOP, |ui| chosen = list.show(ui));
        // What was clicked beside the list gets the keys.
        if is_ended || shown.clicked_elsewhere() || chosen.is_some() {
            self.list = None;
        }
        chosen
    }
}

impl List {
    fn show(&mut self, ui: &mut Ui) -> Option<Command> {
        ui.set_width(LIST_WIDTH);
        // Taken before the text field gets them.
        let [up, down, enter] = [Key::ArrowUp, Key::ArrowDown, Key::Enter]
            .map(|key| ui.input_mut(|i| i.consume_key(eframe::egui::Modifiers::NONE, key)));
        let field = TextEdit::singleline(&mut self.text).hint_text("Name of a command");
        let field = ui.add(field.desired_width(f32::INFINITY));
        field.request_focus();
        if field.changed() {
            self.row = 0;
        }
        let wanted = self.text.to_lowercase();
        let matches = COMMANDS.iter().filter(|row| {
            row.command != Command::List
                && (row.name.to_lowercase().contains(&wanted) || row.about.contains(&wanted))
        });
        let rows: Vec<_> = matches.collect();
        let last = rows.len().saturating_sub(1);
        self.row = match (up, down) {
            (true, false) => self.row.saturating_sub(1),
            (false, true) => (self.row + 1).min(last),
            _ => self.row.min(last),
        };
        let mut chosen = rows.get(self.row).filter(|_| enter).map(|row| row.command);
        ScrollArea::vertical().show(ui, |ui| {
            for (i, row) in rows.iter().enumerate() {
                let keys = row.keys(ui.ctx());
                let text = format!("{}: {}   {keys}", row.name, row.about);
                if ui.selectable_label(i == self.row, text).clicked() {
                    chosen = Some(row.command);
                }
            }
            if rows.is_empty() {
                ui.label(RichText::new("no command has such a name").color(theme::inks(ui).faint));
            }
        });
        chosen
    }
}

/// Keys and mouse buttons, and what they do; all of them in a window 600 points high.
fn keys(ui: &mut Ui) {
    // A click on its text removes it too.
    ui.style_mut().interaction.selectable_labels = false;
    ScrollArea::vertical().max_height(ui.ctx().content_rect().height() - 56.0).show(ui, |ui| {
        ui.spacing_mut().interact_size.y = 0.0;
        Grid::new("keys").num_columns(2).spacing([18.0, 1.0]).show(ui, |ui| {
            for (key, what) in GESTURES {
                row(ui, key, what);
            }
            for command in &COMMANDS {
                row(ui, &command.keys(ui.ctx()), command.about);
            }
        });
    });
}

fn row(ui: &mut Ui, key: &str, what: &str) {
    ui.label(RichText::new(key).monospace());
    ui.label(RichText::new(what).color(theme::inks(ui).faint));
    ui.end_row();
}

fn boxed(ctx: &Context, name: &str, at: Align2, add: impl FnOnce(&mut Ui)) -> Response {
    let area = Area::new(Id::unique(name)).order(Order::Foreground).sense(Sense::click());
    let offset = if at == Align2::CENTER_TOP { vec2(0.0, 60.0) } else { vec2(0.0, 0.0) };
    let shown = area.anchor(at, offset).show(ctx, |ui| {
        let frame =
            Frame::NONE.fill(theme::inks(ui).panel).inner_margin(Margin::same(16)).corner_radius(8);
        frame.show(ui, add);
    });
    shown.response
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::input_events::button_event;
    use eframe::egui::{Event, PointerButton, Pos2, RawInput, Rect, pos2};

    /// Clicks at a place of a window that shows `overlay`.
    fn click(ctx: &Context, overlay: &mut Overlay, at: Pos2) {
        let button = |pressed| button_event(at, PointerButton::Primary, pressed);
        for events in
            [vec![], vec![Event::PointerMoved(at)], vec![button(true)], vec![button(false)]]
        {
            let screen_rect = Some(Rect::from_min_max(Pos2::ZERO, pos2(900.0, 900.0)));
            let raw = RawInput { events, screen_rect, ..RawInput::default() };
            let _ = ctx.run_ui(raw, |ui| {
                let _ = overlay.show(ui.ctx());
            });
        }
    }

    #[test]
    fn clicks_on_the_overview_and_beside_the_list_close_them() {
        let ctx = Context::default();
        let mut overlay = Overlay::default();
        overlay.toggle_keys();
        click(&ctx, &mut overlay, pos2(5.0, 5.0));
        assert!(overlay.has_keys, "the overview stays beside what is used");
        click(&ctx, &mut overlay, pos2(450.0, 450.0));
        assert!(!overlay.has_keys);
        overlay.toggle_list();
        click(&ctx, &mut overlay, pos2(450.0, 75.0));
        assert!(overlay.list.is_some(), "the list is used");
        click(&ctx, &mut overlay, pos2(5.0, 5.0));
        assert!(overlay.list.is_none());
    }
}
