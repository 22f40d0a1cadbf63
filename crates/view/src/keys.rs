//! Decides who gets the keys. Tab walks through the widgets, and the widget that it reaches gets
//! keys such as Space; a widget that was clicked does not keep them, unless it edits text. Keys
//! that fly are those at the places of W, A, S, D, Q and E on any keyboard.

use eframe::egui::{Context, Event, Key, RawInput};

/// Keys that fly, by their places.
const BY_PLACE: [Key; 6] = [Key::W, Key::A, Key::S, Key::D, Key::Q, Key::E];

/// Who has the focus, and why.
#[derive(Debug, Default)]
pub struct Keys {
    /// Whether the pointer gave the focus, not Tab.
    was_clicked: bool,
}

impl Keys {
    /// Changes the input of the next pass.
    pub fn take(&mut self, ctx: &Context, raw: &mut RawInput) {
        if ctx.text_edit_focused() {
            return;
        }
        for event in &raw.events {
            match event {
                Event::PointerButton { .. } => self.was_clicked = true,
                Event::Key { key: Key::Tab, pressed: true, .. } => self.was_clicked = false,
                _ => {}
            }
        }
        if self.was_clicked {
            ctx.memory_mut(|memory| {
                if let Some(id) = memory.focused() {
                    memory.surrender_focus(id);
                }
            });
        }
        raw.events.iter_mut().for_each(fly_by_place);
    }
}

/// Renames a key to the letter at its place on an English keyboard, if that letter or its own one
/// flies.
fn fly_by_place(event: &mut Event) {
    if let Event::Key { key, physical_key: Some(place), modifiers, .. } = event
        && !modifiers.command
        && (BY_PLACE.contains(place) || BY_PLACE.contains(key))
    {
        *key = *place;
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests may panic")]
mod tests {
    use super::*;
    use crate::input_events::{button_event, key_event};
    use eframe::egui::{Button, DragValue, PointerButton, Pos2};

    fn click(at: Pos2) -> Vec<Event> {
        let button = |pressed| button_event(at, PointerButton::Primary, pressed);
        vec![Event::PointerMoved(at), button(true), button(false)]
    }

    #[test]
    fn tab_walks_through_widgets_and_clicked_ones_keep_no_focus_unless_they_edit_text() {
        let ctx = Context::default();
        let mut keys = Keys::default();
        let mut value = 7.0;
        let mut pass = |events: Vec<Event>| {
            let mut raw = RawInput { events, ..RawInput::default() };
            keys.take(&ctx, &mut raw);
            let mut found = None;
            let _ = ctx.run_ui(raw, |ui| {
                let button = ui.add(Button::new("button"));
                found = Some((button, ui.add(DragValue::new(&mut value))));
            });
            found.unwrap()
        };
        let focused = || ctx.memory(|memory| memory.focused());
        let (button, number) = pass(Vec::new());
        pass(vec![key_event(Key::Tab, true)]);
        pass(Vec::new());
        assert_eq!(focused(), Some(button.id), "Tab gives the focus");
        pass(Vec::new());
        assert_eq!(focused(), Some(button.id), "and it stays");
        pass(click(button.rect.center()));
        (0..3).for_each(|_| drop(pass(Vec::new())));
        assert_eq!(focused(), None, "a click gives no focus");
        pass(click(number.rect.center()));
        (0..6).for_each(|_| drop(pass(Vec::new())));
        assert!(ctx.text_edit_focused(), "a number that was clicked is edited");
    }

    #[test]
    fn keys_fly_by_their_places() {
        let named = |key, place| {
            let mut event = key_event(key, true);
            if let Event::Key { physical_key, .. } = &mut event {
                *physical_key = Some(place);
            }
            fly_by_place(&mut event);
            match event {
                Event::Key { key, .. } => key,
                _ => panic!("a key"),
            }
        };
        // AZERTY: Z lies at the place of W, and W at that of Z.
        assert_eq!(named(Key::Z, Key::W), Key::W);
        assert_eq!(named(Key::W, Key::Z), Key::Z);
        assert_eq!(named(Key::Q, Key::A), Key::A);
        // Other letters are letters.
        assert_eq!(named(Key::M, Key::Semicolon), Key::M);
        assert_eq!(named(Key::W, Key::W), Key::W);
    }
}
