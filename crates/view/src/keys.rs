//! Decides who gets the keys: a text field that is being edited, else the window. By itself, egui
//! moves the focus between widgets by Tab, and sends keys to the widget that was clicked last.

use eframe::egui::{Context, Event, Key, RawInput};

/// Takes the focus from widgets that edit no text, and removes the Tab key, which shows or hides
/// the panel, from the input. Called before each pass; returns whether Tab was pressed.
pub fn take(ctx: &Context, raw: &mut RawInput) -> bool {
    if ctx.text_edit_focused() {
        return false;
    }
    ctx.memory_mut(|memory| {
        if let Some(id) = memory.focused() {
            memory.surrender_focus(id);
        }
    });
    let mut is_pressed = false;
    raw.events.retain(|event| match event {
        Event::Key { key: Key::Tab, pressed, repeat, modifiers, .. } if modifiers.is_none() => {
            is_pressed ^= *pressed && !repeat;
            false
        }
        _ => true,
    });
    is_pressed
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests may panic")]
mod tests {
    use super::*;
    use eframe::egui::{Button, DragValue, Modifiers, PointerButton, Pos2};

    fn tab() -> Event {
        Event::Key {
            key: Key::Tab,
            physical_key: None,
            pressed: true,
            repeat: false,
            modifiers: Modifiers::NONE,
        }
    }

    fn click(at: Pos2) -> Vec<Event> {
        let button = |pressed| Event::PointerButton {
            pos: at,
            button: PointerButton::Primary,
            pressed,
            modifiers: Modifiers::NONE,
        };
        vec![Event::PointerMoved(at), button(true), button(false)]
    }

    #[test]
    fn tab_belongs_to_the_panel_unless_a_number_is_edited_and_clicked_widgets_keep_no_focus() {
        let ctx = Context::default();
        let mut value = 7.0;
        let mut pass = |events: Vec<Event>| {
            let mut raw = RawInput { events, ..RawInput::default() };
            let is_pressed = take(&ctx, &mut raw);
            let mut found = None;
            let _ = ctx.run_ui(raw, |ui| {
                let button = ui.add(Button::new("button"));
                found = Some((button, ui.add(DragValue::new(&mut value))));
            });
            let (button, number) = found.unwrap();
            (is_pressed, button, number)
        };
        let (_, button, number) = pass(Vec::new());
        assert!(pass(vec![tab()]).0);
        assert!(!pass(Vec::new()).0);
        assert_eq!(ctx.memory(|m| m.focused()), None, "Tab moves no focus");
        ctx.memory_mut(|m| m.request_focus(button.id));
        (0..4).for_each(|_| drop(pass(Vec::new())));
        assert_eq!(ctx.memory(|m| m.focused()), None);
        pass(click(number.rect.center()));
        (0..6).for_each(|_| drop(pass(Vec::new())));
        assert!(ctx.text_edit_focused(), "a number that was clicked is edited");
        assert!(!pass(vec![tab()]).0, "Tab then belongs to the number");
    }
}
