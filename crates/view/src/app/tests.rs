//! Tests of the whole window without a display: what it rests on, copying, faults in words, and a
//! thousand random actions.

use super::*;
use crate::input_events::{button_event, wheel_event};
use crate::source::{self, Opened};
use clap::Parser;
use eframe::egui::accesskit::Role;
use eframe::egui::{Event, Key, Modifiers, OutputCommand, PointerButton, Pos2, Vec2, vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT, Queryable};
use esker_engine::calls::build;
use esker_engine::io::progress::{Progress, Style};
use std::path::Path;
use std::sync::OnceLock;

mod scenes;

/// The sample scan as an `.esker` file, built once.
fn sample() -> &'static Path {
    static BUILT: OnceLock<(tempfile::TempDir, PathBuf)> = OnceLock::new();
    let (_, built) = BUILT.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let built = folder.path().join("creek.esker");
        let scan = Path::new("../../tests/sample/creek.laz").to_owned();
        let silent = Progress::new(Style::Silent, Default::default());
        build::build(&[scan], &built, &BuildOptions::default(), 0, &silent).unwrap();
        (folder, built)
    });
    built
}

/// A window on a file.
fn window(file: &Path, size: Vec2, options: &[&str]) -> Harness<'static, App> {
    let program = ["esker-view", "--backend", "cpu", "--cache", "0"].iter();
    let words = program.chain(options).map(|word| (*word).to_owned());
    let args = Args::parse_from(words.chain([file.display().to_string()]));
    let mut app = App::new(args, Instant::now()).unwrap();
    let mut is_new = true;
    let pass = move |ui: &mut Ui, app: &mut App| {
        if std::mem::take(&mut is_new) {
            app.set_window_painter(ui.ctx(), WindowPainter::default());
        }
        app.pass(ui);
    };
    app.window_painter = WindowPainter::default();
    let builder = Harness::builder().with_size(size).with_accessibility_check(false);
    let builder = builder.allow_missing_glyphs();
    builder.build_ui_state(pass, app)
}

/// Runs passes until the picture is final.
fn settle(harness: &mut Harness<'_, App>) {
    for _ in 0..6000 {
        harness.step();
        let app = harness.state();
        if let Stage::Viewing(viewer) = &app.stage
            && app.counters.settled
            && !viewer.needs_redraw(app.now_s())
        {
            return;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    panic!("the picture does not become final");
}

fn viewer<'a>(harness: &'a Harness<'_, App>) -> &'a Viewer {
    match &harness.state().stage {
        Stage::Viewing(viewer) => viewer,
        Stage::Failed(fault) => panic!("{fault}"),
        _ => panic!("no file is open"),
    }
}

fn press(harness: &Harness<'_, App>, key: Key, modifiers: Modifiers) {
    harness.key_press_modifiers(modifiers, key);
}

#[test]
fn at_rest_the_panel_shows_that_nothing_is_read() {
    let mut harness = window(sample(), vec2(900.0, 700.0), &[]);
    settle(&mut harness);
    assert!(harness.state().counters.status.read_bytes > 0);
    // Passes come when the window asks for them, as in a real window.
    let mut passes = 0;
    loop {
        harness.step();
        let delay = harness.output().viewport_output.values().map(|view| view.repaint_delay).min();
        let Some(delay) = delay.filter(|delay| *delay < Duration::from_secs(60)) else { break };
        std::thread::sleep(delay);
        passes += 1;
        assert!(passes < 200, "the window comes to rest");
    }
    let app = harness.state();
    assert_eq!(app.counters.rates(), [0.0; 2]);
    assert!(app.rest_s.is_some_and(|rest_s| app.anon_bytes.0 > rest_s), "memory at rest");
}

#[test]
fn measured_points_are_copied_by_the_keys_for_copying() {
    let mut harness = window(sample(), vec2(900.0, 700.0), &[]);
    settle(&mut harness);
    let copied = |harness: &mut Harness<'_, App>| {
        harness.event(Event::Copy);
        harness.step();
        let commands = harness.output().platform_output.commands.clone();
        commands.into_iter().find_map(|command| match command {
            OutputCommand::CopyText(text) => Some(text),
            _ => None,
        })
    };
    assert_eq!(copied(&mut harness), None, "nothing is measured");
    let rect = viewer(&harness).picture_rect().unwrap();
    for share in [0.45, 0.55] {
        let at = rect.lerp_inside(vec2(share, 0.5));
        click(&mut harness, at);
        settle(&mut harness);
        // The next click is no second one of a double click.
        harness.run_steps(60);
    }
    settle(&mut harness);
    let lines = viewer(&harness).measured();
    assert_eq!(lines.len(), 3, "{lines:?}");
    assert_eq!(copied(&mut harness), Some(lines.join("\n")));
}

#[test]
fn what_was_done_in_a_preview_stays_when_others_replace_it() {
    let mut harness = window(sample(), vec2(900.0, 700.0), &[]);
    settle(&mut harness);
    press(&harness, Key::M, Modifiers::NONE);
    press(&harness, Key::N, Modifiers::NONE);
    press(&harness, Key::I, Modifiers::NONE);
    press(&harness, Key::Num7, Modifiers::NONE);
    settle(&mut harness);
    let at = viewer(&harness).picture_rect().unwrap().center();
    click(&mut harness, at);
    settle(&mut harness);
    let state = |harness: &Harness<'_, App>| {
        let (viewer, wanted) = (viewer(harness), harness.state().wanted.clone());
        (viewer.camera().pose(), viewer.measured(), viewer.tool(), wanted)
    };
    let before = state(&harness);
    assert_eq!(before.1.len(), 1);
    let ctx = harness.ctx.clone();
    let opened = || Opened::preview(sample()).unwrap();
    for event in [
        source::Event::Preview(opened()),
        source::Event::Preview(opened()),
        source::Event::End(Ok(opened())),
    ] {
        harness.state_mut().take(&ctx, event);
        settle(&mut harness);
        assert_eq!(state(&harness), before);
    }
}

#[test]
fn faults_in_the_window_have_no_numbers_of_the_system() {
    let mut harness = window(Path::new("no/such/scan.las"), vec2(900.0, 700.0), &[]);
    for _ in 0..500 {
        harness.step();
        if matches!(harness.state().stage, Stage::Failed(_)) {
            break;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    harness.step();
    let texts = harness.root().children_recursive();
    let texts = texts.filter_map(|node| node.accesskit_node().value());
    let shown: Vec<String> = texts.filter(|text| text.contains("scan.las")).collect();
    assert!(!shown.is_empty(), "the fault is shown");
    for text in shown {
        assert!(!text.contains("os error") && text.contains("no such file"), "{text}");
    }
}

/// Numbers that look random, the same in each run (Marsaglia's xorshift).
struct Random(u64);

impl Random {
    fn below(&mut self, end: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 % end as u64) as usize
    }

    fn share(&mut self) -> f32 {
        self.below(1000) as f32 / 999.0
    }

    fn of<T: Copy>(&mut self, all: &[T]) -> T {
        all[self.below(all.len())]
    }
}

/// Keys that are pressed at random. P writes a file, as Enter may in the list of commands; Escape
/// is pressed at the end.
const KEYS: [Key; 21] = [
    Key::W,
    Key::A,
    Key::S,
    Key::D,
    Key::Q,
    Key::E,
    Key::F,
    Key::M,
    Key::C,
    Key::O,
    Key::V,
    Key::Space,
    Key::Tab,
    Key::ArrowUp,
    Key::ArrowDown,
    Key::ArrowLeft,
    Key::ArrowRight,
    Key::F9,
    Key::F1,
    Key::Home,
    Key::K,
];

/// Presses and releases the left button.
fn click(harness: &mut Harness<'_, App>, at: Pos2) {
    harness.hover_at(at);
    harness.step();
    for pressed in [true, false] {
        harness.event(button_event(at, PointerButton::Primary, pressed));
        harness.step();
    }
}

/// Does something that a person could do. Returns what.
fn act(harness: &mut Harness<'_, App>, random: &mut Random) -> String {
    let rect = viewer(harness).picture_rect().unwrap();
    let place = |random: &mut Random| rect.lerp_inside(vec2(random.share(), random.share()));
    match random.below(8) {
        0..=2 => {
            let nodes: Vec<(String, Pos2)> = harness
                .root()
                .children_recursive()
                .filter(|node| {
                    let role = node.accesskit_node().role();
                    let controls = [
                        Role::Button,
                        Role::CheckBox,
                        Role::ComboBox,
                        Role::RadioButton,
                        Role::Slider,
                        Role::SpinButton,
                        Role::TextInput,
                    ];
                    controls.contains(&role)
                })
                .map(|node| {
                    let name = node.accesskit_node().label().unwrap_or_default();
                    (name, node.rect().lerp_inside(vec2(random.share(), 0.5)))
                })
                // They write or open files.
                .filter(|(name, _)| {
                    !["Picture", "Open", "Save", "Keep"].iter().any(|word| name.starts_with(word))
                })
                .collect();
            let (name, at) = nodes[random.below(nodes.len())].clone();
            click(harness, at);
            format!("click {name}")
        }
        3 => {
            let key = random.of(&KEYS);
            let modifiers = random.of(&[
                Modifiers::NONE,
                Modifiers::NONE,
                Modifiers::SHIFT,
                Modifiers::COMMAND,
            ]);
            // With Ctrl these write or open files.
            let is_file = [Key::O, Key::S, Key::E].contains(&key);
            let modifiers = if is_file { Modifiers::NONE } else { modifiers };
            press(harness, key, modifiers);
            format!("{modifiers:?} {key:?}")
        }
        4 => {
            let button = random.of(&[
                PointerButton::Primary,
                PointerButton::Secondary,
                PointerButton::Middle,
            ]);
            let [from, to] = [place(random), place(random)];
            let modifiers = Modifiers::NONE;
            let press = |pos, pressed| Event::PointerButton { pos, button, pressed, modifiers };
            harness.event(Event::PointerMoved(from));
            harness.event(press(from, true));
            harness.step();
            harness.event(Event::PointerMoved(from.lerp(to, 0.5)));
            harness.step();
            harness.event(Event::PointerMoved(to));
            harness.event(press(to, false));
            format!("drag {button:?}")
        }
        5 => {
            harness.event(Event::PointerMoved(place(random)));
            let points = random.share() * 400.0 - 200.0;
            harness.event(wheel_event(points.into()));
            format!("wheel {points}")
        }
        6 => {
            let at = place(random);
            click(harness, at);
            "click the picture".into()
        }
        _ => {
            let text = random.of(&["2", "600000", ",", "-1", "town", "0.5", "é", "深"]);
            harness.event(Event::Text(text.to_owned()));
            format!("type {text}")
        }
    }
}

#[test]
fn a_thousand_random_actions_break_nothing() {
    let mut harness = window(sample(), vec2(800.0, 520.0), &["--budget-points", "200000"]);
    harness.state_mut().has_panel = Some(true);
    settle(&mut harness);
    let mut random = Random(0x9e37_79b9_7f4a_7c15);
    let mut done: Vec<String> = Vec::new();
    for step in 0..1000 {
        done.push(act(&mut harness, &mut random));
        harness.run_steps(2);
        let last = || done.iter().rev().take(8).rev().cloned().collect::<Vec<_>>().join("; ");
        let app = harness.state();
        let viewer = viewer(&harness);
        assert_eq!(viewer.fault(), None, "step {step}: {}", last());
        assert_eq!(viewer.pick_fault(), None, "step {step}: {}", last());
        assert_eq!(app.counters.status.fault, None, "step {step}: {}", last());
        let budget = viewer.settings().map_or(u64::MAX, |settings| settings.budget_gpu_bytes);
        let taken = app.counters.status.drawing_bytes;
        assert!(taken <= budget, "step {step}: {taken} of {budget}: {}", last());
        assert!(viewer.camera().eye().is_finite(), "step {step}: {}", last());
    }
    let mut clicked: Vec<&String> = done.iter().filter(|what| what.starts_with("click ")).collect();
    clicked.sort();
    clicked.dedup();
    assert!(clicked.len() > 40, "{clicked:?}");
    // What is left: nothing that Escape and a moment do not remove.
    harness.remove_cursor();
    for _ in 0..3 {
        press(&harness, Key::Escape, Modifiers::NONE);
        harness.run_steps(2);
    }
    settle(&mut harness);
    assert_eq!(viewer(&harness).measured(), Vec::<String>::new());
    assert_eq!(harness.state().shots.message(), None);
}
