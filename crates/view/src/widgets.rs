//! Where the widgets of the window are, by their accessible names, for scripts: what assistive
//! programs get of each pass.

use eframe::egui::accesskit::{Action, Node, NodeId};
use eframe::egui::{Context, FullOutput, Plugin, Pos2, Rect, pos2};

/// A widget that can be clicked.
#[derive(Clone, Debug, PartialEq)]
pub struct Widget {
    /// Its accessible name.
    pub name: String,
    /// Where it is in the window, points.
    pub rect: Rect,
    /// Its identifier in requests of assistive programs.
    pub id: NodeId,
}

/// The widgets of the last pass.
#[derive(Debug, Default)]
struct Widgets(Vec<Widget>);

impl Plugin for Widgets {
    fn debug_name(&self) -> &'static str {
        "widgets by name"
    }

    fn output_hook(&mut self, _ctx: &Context, output: &mut FullOutput) {
        if let Some(update) = &output.platform_output.accesskit_update {
            self.0 = update.nodes.iter().filter_map(|(id, node)| widget(*id, node)).collect();
        }
    }
}

fn widget(id: NodeId, node: &Node) -> Option<Widget> {
    let bounds = node.bounds().filter(|_| !node.is_disabled() && !node.is_hidden())?;
    let [x0, y0, x1, y1] = [bounds.x0, bounds.y0, bounds.x1, bounds.y1].map(|v| v as f32);
    let rect = Rect::from_min_max(pos2(x0, y0), pos2(x1, y1));
    let name = node.label().filter(|_| node.supports_action(Action::Click))?;
    Some(Widget { name: name.to_owned(), rect, id })
}

/// Begins to collect the widgets of `ctx`.
pub fn collect(ctx: &Context) {
    ctx.add_plugin(Widgets::default());
    ctx.enable_accesskit();
}

/// The widgets of the last pass, if they are collected.
pub fn of(ctx: &Context) -> Vec<Widget> {
    ctx.plugin_opt::<Widgets>().map_or_else(Vec::new, |plugin| plugin.lock().0.clone())
}

/// The widget with this name: the one nearest to the top of the window, if there are several.
pub fn find<'a>(widgets: &'a [Widget], name: &str) -> Option<&'a Widget> {
    let named = widgets.iter().filter(|widget| widget.name == name);
    let place = |at: Pos2| (at.y, at.x);
    named.min_by(|a, b| {
        let [a, b] = [a, b].map(|widget| place(widget.rect.center()));
        a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1))
    })
}
