//! What a user can do beside moving the camera, in one table: the panel's buttons, the keys, the
//! overview of keys and the list of commands all come from it.

use crate::tools::ToolName;
use crate::views::Side;
use eframe::egui::{
    Button, Context, Event, InputState, Key, KeyboardShortcut, Modifiers, Response, Ui,
};

/// A command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command {
    /// Fly back to the first view.
    Fit,
    /// Look at all of the scan from a side.
    Look(Side),
    /// Choose what the pointer does.
    Tool(ToolName),
    /// Draw parallel (orthographic) pictures, or perspective ones.
    Parallel,
    /// Show or hide compass, scale bar and coordinates.
    Hud,
    /// Write a picture.
    Picture,
    /// Open other files.
    Open,
    /// Keep the file that was built from scans.
    Keep,
    /// Redo what was undone.
    Redo,
    /// Undo the last change.
    Undo,
    /// Save the scene under another name.
    SaveSceneAs,
    /// Save the scene.
    SaveScene,
    /// Draw with the next method.
    NextMethod,
    /// Colour by the next source.
    NextColours,
    /// Skip nodes that are hidden, or draw them.
    Hidden,
    /// Copy the measurements.
    Copy,
    /// Remove the measurements.
    ClearMeasurements,
    /// Keep the speed of flying, or let it follow what is in view.
    FixSpeed,
    /// Keep the chosen nodes, or release them.
    Freeze,
    /// Show or hide the panel.
    Panel,
    /// Show or hide the overview of keys.
    Keys,
    /// Show or hide the list of commands.
    List,
}

/// A row of the table.
pub struct Row {
    /// The command.
    pub command: Command,
    /// Identifier in scripts and tests.
    pub id: &'static str,
    /// Name on buttons.
    pub name: &'static str,
    /// Keys, any of which gives the command.
    keys: &'static [KeyboardShortcut],
    /// What it does.
    pub about: &'static str,
}

const fn plain(key: Key) -> KeyboardShortcut {
    KeyboardShortcut::new(Modifiers::NONE, key)
}

const fn with_command_and_shift(key: Key) -> KeyboardShortcut {
    KeyboardShortcut::new(Modifiers::COMMAND.plus(Modifiers::SHIFT), key)
}

const fn with_command(key: Key) -> KeyboardShortcut {
    KeyboardShortcut::new(Modifiers::COMMAND, key)
}

/// All commands, in the order in which they are listed. Of two with the same key, the one with more
/// modifiers comes first, so that the other one does not take it.
pub const COMMANDS: [Row; 29] = [
    Row {
        command: Command::Fit,
        id: "fit",
        name: "Fit",
        keys: &[plain(Key::F), plain(Key::Home)],
        about: "fly back to the first view, which shows all of the scan unless --camera says otherwise",
    },
    Row {
        command: Command::Look(Side::Top),
        id: "top",
        name: "Top",
        keys: &[plain(Key::Num7)],
        about: "look at all of the scan from above",
    },
    Row {
        command: Command::Look(Side::Bottom),
        id: "bottom",
        name: "Bottom",
        keys: &[with_command(Key::Num7)],
        about: "look at all of the scan from below",
    },
    Row {
        command: Command::Look(Side::Front),
        id: "front",
        name: "Front",
        keys: &[plain(Key::Num1)],
        about: "look at all of the scan from the front: along y where z is up",
    },
    Row {
        command: Command::Look(Side::Back),
        id: "back",
        name: "Back",
        keys: &[with_command(Key::Num1)],
        about: "look at all of the scan from behind",
    },
    Row {
        command: Command::Look(Side::Left),
        id: "left",
        name: "Left",
        keys: &[with_command(Key::Num3)],
        about: "look at all of the scan from the left",
    },
    Row {
        command: Command::Look(Side::Right),
        id: "right",
        name: "Right",
        keys: &[plain(Key::Num3)],
        about: "look at all of the scan from the right",
    },
    Row {
        command: Command::Look(Side::Isometric),
        id: "isometric",
        name: "Isometric",
        keys: &[plain(Key::Num0)],
        about: "look at all of the scan from the front, the right and above",
    },
    Row {
        command: Command::Tool(ToolName::Navigate),
        id: "navigate",
        name: "Navigate",
        keys: &[plain(Key::N)],
        about: "use the pointer to move alone: a click picks nothing",
    },
    Row {
        command: Command::Tool(ToolName::Pick),
        id: "pick",
        name: "Pick",
        keys: &[plain(Key::I)],
        about: "click a point to read its coordinates and attributes, two for their distance; moving works as ever",
    },
    Row {
        command: Command::Parallel,
        id: "orthographic",
        name: "Orthographic",
        keys: &[plain(Key::Num5)],
        about: "draw lengths in one size at any distance, or in perspective; what is in the middle keeps its size",
    },
    Row {
        command: Command::Hud,
        id: "compass",
        name: "Compass and scale",
        keys: &[plain(Key::H)],
        about: "show or hide compass, scale bar and coordinates",
    },
    Row {
        command: Command::Picture,
        id: "picture",
        name: "Picture",
        keys: &[plain(Key::P)],
        about: "write what is in view as a PNG file into the current folder",
    },
    Row {
        command: Command::Open,
        id: "open",
        name: "Open",
        keys: &[with_command(Key::O)],
        about: "open other scans, an .esker file or a scene document",
    },
    Row {
        command: Command::Keep,
        id: "keep",
        name: "Keep as .esker",
        keys: &[with_command(Key::E)],
        about: "copy the file that was built from the scans to a place of your choice",
    },
    Row {
        command: Command::Redo,
        id: "redo",
        name: "Redo",
        keys: &[with_command_and_shift(Key::Z), with_command(Key::Y)],
        about: "make the change again that was undone last",
    },
    Row {
        command: Command::Undo,
        id: "undo",
        name: "Undo",
        keys: &[with_command(Key::Z)],
        about: "take back the last change of settings or measured points",
    },
    Row {
        command: Command::SaveSceneAs,
        id: "save-scene-as",
        name: "Save scene as",
        keys: &[with_command_and_shift(Key::S)],
        about: "write a scene document under another name",
    },
    Row {
        command: Command::SaveScene,
        id: "save-scene",
        name: "Save scene",
        keys: &[with_command(Key::S)],
        about: "write view, colours and filter as a scene document: where it came from, or beside the scan",
    },
    Row {
        command: Command::NextMethod,
        id: "next-method",
        name: "Next method",
        keys: &[plain(Key::M)],
        about: "draw in the next way: surfaces, splats, light, points",
    },
    Row {
        command: Command::NextColours,
        id: "next-colours",
        name: "Next colours",
        keys: &[plain(Key::C)],
        about: "colour the points by the next attribute",
    },
    Row {
        command: Command::Copy,
        id: "copy",
        name: "Copy",
        keys: &[with_command(Key::C)],
        about: "copy the measured coordinates and distances, unless text is selected",
    },
    Row {
        command: Command::ClearMeasurements,
        id: "clear",
        name: "Clear",
        keys: &[plain(Key::Escape)],
        about: "remove the measured points",
    },
    Row {
        command: Command::FixSpeed,
        id: "fix-speed",
        name: "Fixed speed",
        keys: &[plain(Key::V)],
        about: "keep the speed of flying; else it follows the distance of what is in view",
    },
    Row {
        command: Command::Panel,
        id: "panel",
        name: "Panel",
        keys: &[plain(Key::F9), with_command(Key::B)],
        about: "show or hide the panel",
    },
    Row {
        command: Command::Keys,
        id: "keys",
        name: "?",
        keys: &[plain(Key::Questionmark), plain(Key::F1)],
        about: "show what keys and mouse buttons do",
    },
    Row {
        command: Command::List,
        id: "list",
        name: "Commands",
        keys: &[with_command(Key::K)],
        about: "find a command by its name",
    },
    Row {
        command: Command::Hidden,
        id: "hidden",
        name: "Skip hidden points",
        keys: &[plain(Key::O)],
        about: "leave out nodes that lie behind others, or draw them too",
    },
    Row {
        command: Command::Freeze,
        id: "freeze",
        name: "Freeze",
        keys: &[plain(Key::Space)],
        about: "keep the points that are drawn now, to look at them from outside",
    },
];

/// Keys and mouse buttons that move the camera or measure, and what they do.
pub const GESTURES: [(&str, &str); 11] = [
    ("W A S D, arrows", "fly"),
    ("E  Q", "up, down"),
    ("Shift  Alt", "faster, slower"),
    ("left button", "orbit around the point"),
    ("right button, Shift+left", "move sideways"),
    ("middle button", "look around"),
    ("Ctrl+left button", "move the sun (Lit)"),
    ("wheel", "zoom to the pointer"),
    ("wheel while flying", "change the speed"),
    ("click (Pick)", "read a point, measure"),
    ("double click", "fly there"),
];

impl Command {
    /// The command with this identifier.
    pub fn of(id: &str) -> Option<Self> {
        COMMANDS.iter().find(|row| row.id == id).map(|row| row.command)
    }

    /// Its row of the table.
    pub fn row(self) -> &'static Row {
        COMMANDS.iter().find(|row| row.command == self).unwrap_or(&COMMANDS[0])
    }
}

impl Row {
    /// Its keys, for people.
    pub fn keys(&self, ctx: &Context) -> String {
        let name = |keys| ctx.format_shortcut(keys).replace("Questionmark", "?");
        self.keys.iter().map(name).collect::<Vec<String>>().join("  ")
    }

    /// What it does, and its keys.
    pub fn tooltip(&self, ctx: &Context) -> String {
        let mut about = self.about.to_owned();
        about[..1].make_ascii_uppercase();
        format!("{about} ({})", self.keys(ctx))
    }
}

/// Commands whose keys were pressed in this pass. A widget that has the focus, which Tab gives it,
/// gets the keys that it knows.
pub fn pressed(input: &mut InputState, has_focus: bool) -> Vec<Command> {
    let is_free = |keys: &KeyboardShortcut| {
        !has_focus || !matches!(keys.logical_key, Key::Space | Key::Escape | Key::Home)
    };
    // The system's keys for copying, whichever they are, come as an event of their own.
    let copies = input.events.iter().any(|event| matches!(event, Event::Copy));
    let mut is_pressed = |row: &Row| {
        if row.command == Command::Copy && copies {
            return true;
        }
        let mut keys = row.keys.iter().filter(|keys| is_free(keys));
        // A question mark takes Shift on many keyboards.
        keys.any(|keys| {
            let shifted = keys.logical_key == Key::Questionmark
                && input.consume_key(Modifiers::SHIFT, keys.logical_key);
            shifted || input.consume_shortcut(keys)
        })
    };
    COMMANDS.iter().filter(|row| is_pressed(row)).map(|row| row.command).collect()
}

/// A button for a command, which looks pressed if `is_on`.
pub fn button(ui: &mut Ui, command: Command, is_on: bool) -> Response {
    let row = command.row();
    let tooltip = row.tooltip(ui.ctx());
    ui.add(Button::selectable(is_on, row.name).frame(true)).on_hover_text(tooltip)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::input_events::key_event;
    use eframe::egui::RawInput;
    use std::collections::HashSet;

    #[test]
    fn identifiers_names_and_keys_are_unique_and_every_command_has_them() {
        let mut keys: Vec<String> = Vec::new();
        let ctx = Context::default();
        for row in &COMMANDS {
            assert!(!row.id.is_empty() && !row.name.is_empty() && !row.keys.is_empty());
            assert!(row.tooltip(&ctx).len() > 20, "{}", row.id);
            assert_eq!(row.command.row().id, row.id);
            assert_eq!(Command::of(row.id), Some(row.command));
            keys.extend(row.keys.iter().map(|keys| ctx.format_shortcut(keys)));
        }
        let distinct = |all: Vec<&str>| all.iter().collect::<HashSet<_>>().len() == all.len();
        assert!(distinct(COMMANDS.iter().map(|row| row.id).collect()));
        assert!(distinct(COMMANDS.iter().map(|row| row.name).collect()));
        assert!(distinct(keys.iter().map(String::as_str).collect()));
    }

    #[test]
    fn each_key_gives_its_command_alone_unless_a_widget_has_it() {
        for row in &COMMANDS {
            for shortcut in row.keys {
                let Event::Key { key, physical_key, pressed: is_down, repeat, .. } =
                    key_event(shortcut.logical_key, true)
                else {
                    panic!("a key")
                };
                let modifiers = shortcut.modifiers;
                let event = Event::Key { key, physical_key, pressed: is_down, repeat, modifiers };
                let events = vec![Event::ModifiersChanged(modifiers), event];
                let given = |has_focus: bool| {
                    let ctx = Context::default();
                    let mut given = Vec::new();
                    let raw = RawInput { events: events.clone(), ..RawInput::default() };
                    let _ = ctx.run_ui(raw, |ui| {
                        given.extend(ui.input_mut(|input| pressed(input, has_focus)));
                    });
                    given
                };
                assert_eq!(given(false), [row.command], "{}", row.id);
                let is_taken = matches!(key, Key::Space | Key::Escape | Key::Home);
                assert_eq!(given(true).is_empty(), is_taken, "{}", row.id);
            }
        }
    }
}
