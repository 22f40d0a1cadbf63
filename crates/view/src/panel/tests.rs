//! Tests of the panel: every control has a name and a tooltip and lies within the panel, whatever
//! is shown, at any size.

mod clips;

use super::data::PanelData;
use super::{PanelState, TABS, Tab, show};
use crate::clouds::Clouds;
use crate::counters::Counters;
use crate::settings::Settings;
use crate::soft::clip::Clip as PaintedPart;
use crate::soft::painter::{Painter, Target};
use crate::theme;
use crate::times::Times;
use crate::tools::ToolName;
use eframe::egui::accesskit::Role;
use eframe::egui::{
    Context, Frame, Margin, Order, Panel, Pos2, RawInput, Rect, ThemePreference, Vec2, ViewportId,
    pos2, vec2,
};
use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT, Queryable};
use esker_engine::calls::{build, info};
use esker_engine::cameras::classes::{self, ClassCount};
use esker_engine::cameras::colour;
use esker_engine::cameras::legend::Legend;
use esker_engine::io::progress::{Progress, Style};
use esker_engine::{Bound, BuildOptions, Classes, Clip, Filter, Forest, Method};
use std::path::Path;
use std::sync::{Arc, OnceLock};

/// Controls, which need a name and a tooltip.
const CONTROLS: [Role; 9] = [
    Role::Button,
    Role::CheckBox,
    Role::ComboBox,
    Role::MultilineTextInput,
    Role::RadioButton,
    Role::Slider,
    Role::SpinButton,
    Role::Tab,
    Role::TextInput,
];

/// Data for a panel, and its state.
struct Shown {
    file: Arc<Forest>,
    clouds: Clouds,
    sources: Vec<String>,
    classes: Vec<ClassCount>,
    legend: Option<Legend>,
    times: Times,
    counters: Counters,
    measured: Vec<String>,
    state: PanelState,
    wanted: Settings,
    is_coarser: bool,
    width: f32,
}

/// The sample scan.
fn sample() -> Arc<Forest> {
    static BUILT: OnceLock<(tempfile::TempDir, Arc<Forest>)> = OnceLock::new();
    let (_, file) = BUILT.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let built = folder.path().join("creek.esker");
        let scan = Path::new("../../tests/sample/creek.laz").to_owned();
        let silent = Progress::new(Style::Silent, Default::default());
        build::build(&[scan], &built, &BuildOptions::default(), 0, &silent).unwrap();
        (folder, Arc::new(Forest::open(&built).unwrap()))
    });
    Arc::clone(file)
}

impl Shown {
    fn new(tab: Tab) -> Self {
        let file = sample();
        let colour = colour::colouring(&file, Some("elevation"), info::bounds(&file)).unwrap();
        Self {
            clouds: Clouds::of(&file),
            sources: colour::offered(&file).unwrap(),
            classes: classes::occurring(&file).unwrap(),
            legend: Some(colour.legend),
            times: Times::new(5.0),
            counters: Counters::default(),
            measured: vec!["1.000  2.000  3.000".into(), "distance 4.000 metres".into()],
            state: PanelState { tab, ..PanelState::default() },
            wanted: Settings {
                method: Method::Points,
                colour_by: Some("elevation".into()),
                ..Settings::default()
            },
            is_coarser: true,
            width: 0.0,
            file,
        }
    }

    fn show(&mut self, ui: &mut eframe::egui::Ui) {
        let message = Ok("picture: creek-0001.png".to_owned());
        let picked = [("x".to_owned(), "1.000".to_owned())];
        let data = PanelData {
            file: &self.file,
            name: "creek.laz",
            about: "841,124 points in 99 nodes",
            clouds: &self.clouds.scans,
            is_built: true,
            together: &[],
            extent: self.clouds.extent,
            crs: self.clouds.crs.as_deref(),
            notes: &["left out: 2 points: no number".to_owned()],
            unit: Some("metre"),
            has_degrees: false,
            is_failed: false,
            times: &self.times,
            counters: &self.counters,
            anon_bytes: 1 << 30,
            backend: "scene: CPU renderer; window: CPU",
            sources: &self.sources,
            has_fronts: true,
            has_flags: true,
            classes: &self.classes,
            legend: self.legend.as_ref(),
            measured: &self.measured,
            picked: &picked,
            picture: [1024, 800],
            speed: 3344.0,
            tool: ToolName::Pick,
            has_fixed_speed: false,
            is_parallel: false,
            up_note: None,
            is_frozen: false,
            faults: &[],
            message: Some(&message),
        };
        let frame = Frame::NONE.fill(theme::inks(ui).panel).inner_margin(Margin::symmetric(12, 10));
        let panel = Panel::right("panel").frame(frame).default_size(256.0);
        let panel = panel.size_range(220.0..=520.0).show(ui, |ui| {
            show(ui, &data, &mut self.state, &mut self.wanted, &mut self.is_coarser)
        });
        self.width = panel.response.rect.width();
    }
}

/// A window with the panel alone.
fn window(shown: Shown, size: Vec2, scale: f32) -> Harness<'static, Shown> {
    let builder = Harness::builder().with_size(size).with_pixels_per_point(scale);
    let builder = builder.with_context_setup(|ctx| {
        theme::apply(ctx);
        ctx.all_styles_mut(|style| {
            style.interaction.tooltip_delay = 0.0;
            style.interaction.show_tooltips_only_when_still = false;
        });
    });
    let mut harness = builder.build_ui_state(|ui, shown: &mut Shown| shown.show(ui), shown);
    // The histogram is counted by a thread.
    for _ in 0..200 {
        harness.step();
        let state = &harness.state().state;
        if !state.counted.is_counting() && !state.ranges.are_counting() {
            break;
        }
        std::thread::sleep(std::time::Duration::from_millis(10));
    }
    harness.run_steps(3);
    harness
}

/// Names and rectangles of the controls.
fn controls(harness: &Harness<'_, Shown>) -> Vec<(String, Rect)> {
    let nodes = harness.root().children_recursive();
    let nodes = nodes.filter(|node| CONTROLS.contains(&node.accesskit_node().role()));
    let nodes = nodes.filter(|node| !node.accesskit_node().data().is_read_only());
    nodes.map(|node| (node.accesskit_node().label().unwrap_or_default(), node.rect())).collect()
}

fn has_tooltip(harness: &Harness<'_, Shown>) -> bool {
    harness.ctx.memory(|memory| {
        memory.areas().visible_layer_ids().iter().any(|layer| layer.order == Order::Tooltip)
    })
}

/// A clip of each shape, with numbers of many digits.
fn some_clips() -> Vec<Clip> {
    let texts = [
        "centre=4512345.1230000005,-987654321.123,0.30000000000000004;size=1e12,0,0.1;rotation=30.123456789",
        "box=-123456789.123,-1e300,0,123456789.123456,1e300,1e-300;keep=outside",
        "point=4512345.1230000005,2,3;normal=0.1234567890123,1e-9,-1",
    ];
    let mut clips: Vec<Clip> = texts.into_iter().map(|text| text.parse().unwrap()).collect();
    clips[1].name = Some("a long name of a roof of the town hall, beside the bridge".into());
    clips[2].is_on = false;
    clips
}

#[test]
fn every_control_has_a_name_and_a_tooltip() {
    for (tab, name, _) in TABS {
        for method in [Method::Points, Method::Lit] {
            let mut shown = Shown::new(tab);
            shown.wanted.method = method;
            let values = vec!["red:20000..".parse().unwrap()];
            shown.wanted.filter = Filter {
                classes: "2".parse().ok(),
                bounds: "0,0,0,1,1,1".parse().ok(),
                clips: some_clips(),
                values,
                ..Filter::default()
            };
            // So high that no control is scrolled away.
            let mut harness = window(shown, vec2(420.0, 3200.0), 1.0);
            assert_eq!(harness.unnamed_widgets(), Vec::<String>::new(), "{name}");
            let all = controls(&harness);
            assert!(all.len() > 10, "{name}: {all:?}");
            for (control, rect) in all {
                harness.hover_at(rect.center());
                harness.run_steps(4);
                assert!(has_tooltip(&harness), "{name}: {control} has no tooltip");
                harness.hover_at(pos2(2.0, 2.0));
                harness.run_steps(3);
                assert!(!has_tooltip(&harness), "{name}: the tooltip of {control} stays");
            }
        }
    }
}

#[test]
fn the_panel_has_the_same_width_whatever_it_shows() {
    for (size, scale) in
        [(vec2(800.0, 600.0), 1.0), (vec2(1280.0, 800.0), 1.0), (vec2(800.0, 600.0), 2.0)]
    {
        for (tab, name, _) in TABS {
            let mut harness = window(Shown::new(tab), size, scale);
            let width = harness.state().width;
            assert_eq!(width, 256.0, "{name}");
            // A file that is read fast, and long names.
            let shown = harness.state_mut();
            shown.counters.read_rate = 67.2e6;
            shown.counters.reads_rate = 14_412.0;
            shown.counters.points = 123_456_789_012;
            shown.counters.lod_ms = 1234.5;
            shown.clouds.scans[0].name = "a_very_long_name_of_a_scan_of_a_town_in_2026.laz".into();
            shown.measured.push("distance 123456.789 US survey feet, across 123456.789".into());
            shown.wanted.filter.clips = some_clips();
            shown.wanted.filter.bounds = "-1e300,0,1e-300,1,1e300,123456789.1234567".parse().ok();
            harness.run_steps(3);
            assert_eq!(harness.state().width, width, "{name}");
            let panel = Rect::from_min_max(pos2(size.x - width, 0.0), Pos2::ZERO + size);
            for (control, rect) in controls(&harness) {
                let is_within = rect.left() >= panel.left() && rect.right() <= panel.right();
                assert!(is_within, "{name}: {control} at {rect:?} leaves the panel");
            }
        }
    }
}

#[test]
fn tabs_show_what_their_names_say_and_the_first_is_for_newcomers() {
    let mut harness = window(Shown::new(Tab::default()), vec2(800.0, 600.0), 1.0);
    assert!(harness.query_by_label("Surfaces").is_some());
    for makers in ["nodes drawn", "leave out what is hidden", "Freeze"] {
        assert!(harness.query_by_label(makers).is_none(), "{makers} is for makers");
    }
    for (tab, label) in [
        ("Filter", "Show all points"),
        ("Clouds", "creek.laz"),
        ("Engine", "nodes drawn"),
        ("View", "highlights"),
    ] {
        harness.get_by_role_and_label(Role::Button, tab).click();
        harness.run_steps(3);
        assert!(harness.query_all_by_label(label).next().is_some(), "{tab} shows {label}");
    }
}

#[test]
fn a_handle_of_the_histogram_changes_the_range_of_colours() {
    let mut harness = window(Shown::new(Tab::View), vec2(800.0, 800.0), 1.0);
    let low = harness.get_by_label("lower end of height").rect();
    let high = harness.get_by_label("upper end of height").rect();
    let (from, to) = (low.center(), low.center().lerp(high.center(), 0.5));
    harness.drag_at(from);
    harness.run_steps(2);
    harness.hover_at(to);
    harness.run_steps(2);
    harness.drop_at(to);
    harness.run_steps(2);
    let wanted = harness.state().wanted.colour_by.clone().unwrap();
    let (name, range) = wanted.split_once(':').unwrap();
    let (least, most) = range.split_once("..").unwrap();
    let [least, most] = [least, most].map(|end| end.parse::<f64>().unwrap());
    let of = harness.state().legend.as_ref().unwrap().range.unwrap();
    assert_eq!(name, "elevation");
    assert!((least - of[0].midpoint(of[1])).abs() < (of[1] - of[0]) * 0.1, "{wanted} of {of:?}");
    assert!((most - of[1]).abs() < (of[1] - of[0]) * 0.01, "{wanted} of {of:?}");
    harness.get_by_label("whole range").click();
    harness.run_steps(2);
    assert_eq!(harness.state().wanted.colour_by.as_deref(), Some("elevation"));
}

#[test]
fn measured_lines_are_copied_by_their_buttons() {
    let mut harness = window(Shown::new(Tab::View), vec2(800.0, 600.0), 1.0);
    let lines = harness.state().measured.clone();
    for (i, line) in lines.iter().enumerate() {
        harness.query_all_by_label("copy").nth(i).unwrap().click();
        harness.step();
        let commands = &harness.output().platform_output.commands;
        let copied = eframe::egui::OutputCommand::CopyText(line.clone());
        assert!(commands.contains(&copied), "{line}: {commands:?}");
    }
}

#[test]
fn flags_and_classes_change_the_filter() {
    let mut harness = window(Shown::new(Tab::Filter), vec2(800.0, 1200.0), 1.0);
    harness.get_by_label("overlap").click();
    harness.run_steps(2);
    harness.get_by_label("withheld").click();
    harness.run_steps(2);
    harness.get_by_label("overlap").click();
    harness.run_steps(2);
    let class = harness.state().classes[0].class;
    harness.query_all_by_label("only").next().unwrap().click();
    harness.run_steps(2);
    let filter = &harness.state().wanted.filter;
    assert_eq!(filter.without_flags, "withheld".parse().unwrap());
    let is_alone = |set: Classes| (0..=u8::MAX).filter(|&c| set.has(c)).eq([class]);
    assert!(filter.classes.is_some_and(is_alone));
    harness.get_by_label("Show all points").click();
    harness.run_steps(2);
    assert_eq!(harness.state().wanted.filter, Filter::default());
}

#[test]
fn ranges_of_values_are_added_moved_and_removed() {
    let mut harness = window(Shown::new(Tab::Filter), vec2(800.0, 1600.0), 1.0);
    harness.get_by_role_and_label(Role::ComboBox, "by value").click();
    harness.run_steps(3);
    harness.get_by_label("red").click();
    harness.run_steps(2);
    let added = "red:..".parse().unwrap();
    assert_eq!(harness.state().wanted.filter.values, [added]);
    for _ in 0..200 {
        harness.step();
        if harness.query_by_label("lower end of red").is_some() {
            break;
        }
        std::thread::sleep(std::time::Duration::from_millis(10));
    }
    harness.run_steps(2);
    let low = harness.get_by_label("lower end of red").rect();
    let high = harness.get_by_label("upper end of red").rect();
    let (from, to) = (low.center(), low.center().lerp(high.center(), 0.5));
    harness.drag_at(from);
    harness.run_steps(2);
    harness.hover_at(to);
    harness.run_steps(2);
    harness.drop_at(to);
    harness.run_steps(2);
    let [low, high] = harness.state().wanted.filter.values[0].ends;
    assert!(
        matches!(low, Some(Bound::Whole(low)) if low > 0) && high.is_none(),
        "{low:?} {high:?}"
    );
    harness.get_by_label("remove").click();
    harness.run_steps(2);
    assert_eq!(harness.state().wanted.filter, Filter::default());
}

/// Paints a window with the panel as windows without a graphics driver do. Returns its pixels.
fn painted(shown: &mut Shown, size: Vec2, scale: f32, theme: ThemePreference) -> Vec<u32> {
    let ctx = Context::default();
    theme::apply(&ctx);
    ctx.set_theme(theme);
    let mut painter = Painter::default();
    let [width, height] = [size.x * scale, size.y * scale].map(|side| side as usize);
    let mut pixels = vec![0; width * height];
    for pass in 0..60 {
        let mut raw = RawInput {
            screen_rect: Some(Rect::from_min_size(Pos2::ZERO, size)),
            time: Some(f64::from(pass) * 0.1),
            ..RawInput::default()
        };
        raw.viewports.entry(ViewportId::ROOT).or_default().native_pixels_per_point = Some(scale);
        let output = ctx.run_ui(raw, |ui| shown.show(ui));
        let mut textures = output.textures_delta;
        painter.take(&mut textures);
        let primitives = ctx.tessellate(output.shapes, output.pixels_per_point);
        pixels.fill(0);
        let mut target = Target { width, height, pixels: &mut pixels };
        let whole = PaintedPart::whole([width, height]);
        painter.paint(&primitives, output.pixels_per_point, whole, &mut target);
        painter.free(&mut textures);
        if pass > 8 && !shown.state.counted.is_counting() {
            break;
        }
        std::thread::sleep(std::time::Duration::from_millis(10));
    }
    pixels
}

fn theme_of(preference: ThemePreference) -> theme::Inks {
    let ctx = Context::default();
    ctx.set_theme(preference);
    theme::of(&ctx)
}

#[test]
fn every_tab_is_painted_at_any_size_in_both_themes() {
    for theme in [ThemePreference::Dark, ThemePreference::Light] {
        for (size, scale) in
            [(vec2(800.0, 600.0), 1.0), (vec2(1280.0, 800.0), 1.0), (vec2(640.0, 500.0), 2.0)]
        {
            let mut seen = Vec::new();
            for (tab, name, _) in TABS {
                let mut shown = Shown::new(tab);
                let pixels = painted(&mut shown, size, scale, theme);
                let width = (size.x * scale) as usize;
                let left = width - (256.0 * scale) as usize;
                let panel = |row: &[u32]| row[left + 1..].to_vec();
                let rows: Vec<Vec<u32>> = pixels.chunks_exact(width).map(panel).collect();
                let ground = rows[1][1];
                let [r, g, b, _] = theme_of(theme).panel.to_array().map(u32::from);
                assert_eq!(ground, r << 16 | g << 8 | b, "{name} {size}");
                let painted = rows.iter().filter(|row| row.iter().any(|p| *p != ground)).count();
                assert!(
                    painted * 4 > rows.len().min(600),
                    "{name} {size}: {painted} rows have something"
                );
                let beside =
                    pixels.chunks_exact(width).all(|row| row[..left - 1].iter().all(|p| *p == 0));
                assert!(beside, "{name} {size}: something lies beside the panel");
                assert!(!seen.contains(&rows), "{name} {size}: looks like another tab");
                seen.push(rows);
            }
        }
    }
}
