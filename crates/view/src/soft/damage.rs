//! What has changed between two frames of the window: egui gives all of its meshes anew in each
//! pass, and only the rectangles around triangles that differ from those of the last frame are
//! painted again.

use super::clip::Clip;
use eframe::egui::TextureId;
use eframe::egui::epaint::{ClippedPrimitive, Mesh, Primitive, Vertex};
use std::collections::HashSet;

/// Rectangles of the picture in which `after` differs from `before`, pixels; they do not overlap.
/// `changed` are the textures whose pixels have changed, `scale` is pixels per point, and `size` is
/// that of the picture.
pub fn damage(
    before: &[ClippedPrimitive],
    after: &[ClippedPrimitive],
    changed: &HashSet<TextureId>,
    scale: f32,
    size: [usize; 2],
) -> Vec<Clip> {
    let mut damaged = Vec::new();
    for i in 0..before.len().max(after.len()) {
        let pair = [before.get(i), after.get(i)];
        let clip = |p: &ClippedPrimitive| Clip::of(p.clip_rect, scale, size);
        let found = match pair.map(|p| p.and_then(mesh_of)) {
            [Some(a), Some(b)] if is_same_place(pair, a, b) => {
                let clip = after.get(i).map(clip).unwrap_or(Clip::NONE);
                let is_changed = changed.contains(&b.texture_id);
                let found = match is_changed {
                    true => bounds(a, scale).around(bounds(b, scale)),
                    false => difference(a, b, scale),
                };
                found.within(clip)
            }
            meshes => {
                let all = pair
                    .into_iter()
                    .zip(meshes)
                    .filter_map(|(p, mesh)| Some(bounds(mesh?, scale).within(clip(p?))));
                all.fold(Clip::NONE, Clip::around)
            }
        };
        add(&mut damaged, found);
    }
    damaged
}

fn mesh_of(primitive: &ClippedPrimitive) -> Option<&Mesh> {
    match &primitive.primitive {
        Primitive::Mesh(mesh) => Some(mesh),
        Primitive::Callback(_) => None,
    }
}

/// Whether two primitives show the same texture in the same rectangle.
fn is_same_place(pair: [Option<&ClippedPrimitive>; 2], a: &Mesh, b: &Mesh) -> bool {
    let [before, after] = pair.map(|p| p.map(|p| p.clip_rect));
    before == after && a.texture_id == b.texture_id
}

/// Adds a rectangle to others, and joins those that overlap.
pub fn add(damaged: &mut Vec<Clip>, mut found: Clip) {
    if found.is_empty() {
        return;
    }
    while let Some(at) = damaged.iter().position(|other| !other.within(found).is_empty()) {
        found = found.around(damaged.swap_remove(at));
    }
    damaged.push(found);
}

/// Rectangle around the triangles that only one of two meshes has. Those at the beginning and at
/// the end that both have do not count.
fn difference(before: &Mesh, after: &Mesh, scale: f32) -> Clip {
    if before.indices == after.indices && before.vertices == after.vertices {
        return Clip::NONE;
    }
    let [a, b] = [before, after].map(|mesh| mesh.indices.len() / 3);
    let same = |i: usize, j: usize| corners(before, i) == corners(after, j);
    let least = a.min(b);
    let first = (0..least).take_while(|&i| same(i, i)).count();
    let last = (1..=least - first).take_while(|&i| same(a - i, b - i)).count();
    let of = |mesh: &Mesh, count: usize, is_wanted: &dyn Fn(usize) -> bool| {
        let wanted = (first..count - last).filter(|&i| is_wanted(i));
        wanted.map(|i| around_triangle(corners(mesh, i), scale)).fold(Clip::NONE, Clip::around)
    };
    let differs = |i: usize| a != b || !same(i, i);
    of(before, a, &differs).around(of(after, b, &differs))
}

/// Corners of a triangle; `None` if the mesh is damaged.
fn corners(mesh: &Mesh, triangle: usize) -> Option<[Vertex; 3]> {
    let at = |i: usize| {
        let vertex = *mesh.indices.get(3 * triangle + i)? as usize;
        mesh.vertices.get(vertex).copied()
    };
    Some([at(0)?, at(1)?, at(2)?])
}

/// Rectangle around all of a mesh.
fn bounds(mesh: &Mesh, scale: f32) -> Clip {
    around(mesh.vertices.iter().filter(|v| v.pos.is_finite()), scale)
}

/// Rectangle around a triangle; empty if it is not painted.
fn around_triangle(corners: Option<[Vertex; 3]>, scale: f32) -> Clip {
    let corners = corners.filter(|corners| corners.iter().all(|v| v.pos.is_finite()));
    corners.map_or(Clip::NONE, |corners| around(corners.iter(), scale))
}

/// Rectangle around vertices.
fn around<'a>(vertices: impl Iterator<Item = &'a Vertex>, scale: f32) -> Clip {
    let none = [[f32::INFINITY; 2], [f32::NEG_INFINITY; 2]];
    let [low, high] = vertices.fold(none, |[low, high], v| {
        let at = [v.pos.x * scale, v.pos.y * scale];
        [0, 1].map(|end| {
            [0, 1].map(|i| if end == 0 { low[i].min(at[i]) } else { high[i].max(at[i]) })
        })
    });
    let side = |i: usize| [low[i].floor() as i64, high[i].ceil() as i64];
    if low[0] <= high[0] { Clip { x: side(0), y: side(1) } } else { Clip::NONE }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::soft::painter::{Painter, Target};
    use eframe::egui::{
        Align2, Color32, Context, Event, FontId, RawInput, Rect, Slider, TexturesDelta, pos2, vec2,
    };

    const SIZE: [usize; 2] = [500, 300];
    const SCALE: f32 = 1.25;

    /// A window with several kinds of shapes, in which the pointer moves. Returns its meshes.
    fn pass(
        ctx: &Context,
        pointer: Event,
        value: &mut f32,
        text: &str,
    ) -> (Vec<ClippedPrimitive>, TexturesDelta) {
        let screen = Rect::from_min_size(pos2(0.0, 0.0), vec2(400.0, 240.0));
        let events = vec![pointer];
        let raw = RawInput { events, screen_rect: Some(screen), ..RawInput::default() };
        let output = ctx.run_ui(raw, |ui| {
            let half = Color32::from_rgba_unmultiplied(90, 200, 20, 99);
            ui.painter().circle_filled(pos2(300.0, 60.3), 31.7, half);
            ui.label("a line of text that stays as it is");
            let _ = ui.button("button").on_hover_text("a tooltip");
            ui.add(Slider::new(value, 0.0..=1.0));
            ui.label(text);
            let at = pos2(120.0, 220.0);
            let font = FontId::monospace(12.3);
            ui.painter().text(at, Align2::LEFT_BOTTOM, text, font, Color32::RED);
        });
        (ctx.tessellate(output.shapes, SCALE), output.textures_delta)
    }

    fn paint(painter: &Painter, primitives: &[ClippedPrimitive], pixels: &mut [u32], clip: Clip) {
        let mut target = Target { width: SIZE[0], height: SIZE[1], pixels };
        target.clear(clip, 0x0010_2030);
        painter.paint(primitives, SCALE, clip, &mut target);
    }

    #[test]
    fn frames_painted_where_they_changed_are_equal_to_those_painted_anew() {
        let ctx = Context::default();
        ctx.set_pixels_per_point(SCALE);
        let mut painter = Painter::default();
        let (mut kept, mut before) = (vec![0; SIZE[0] * SIZE[1]], Vec::new());
        let (mut value, mut painted) = (0.3, Vec::new());
        let whole = Clip::whole(SIZE);
        for step in 0..60_u16 {
            let at = pos2(5.0 + f32::from(step) * 3.7, 8.0 + f32::from(step * 13 % 90));
            let text = format!("{} of {}", step / 2, "x".repeat(usize::from(step % 7)));
            if step == 40 {
                value = 0.8;
            }
            let (after, mut delta) = pass(&ctx, Event::PointerMoved(at), &mut value, &text);
            let changed = painter.take(&mut delta);
            let damaged = match step {
                0 => vec![whole],
                _ => damage(&before, &after, &changed, SCALE, SIZE),
            };
            damaged.iter().for_each(|clip| paint(&painter, &after, &mut kept, *clip));
            let mut anew = vec![0; SIZE[0] * SIZE[1]];
            paint(&painter, &after, &mut anew, whole);
            assert!(kept == anew, "step {step}");
            painted.push(damaged.iter().map(|clip| clip.pixels()).sum::<usize>());
            before = after;
        }
        painted.sort_unstable();
        let share = painted[painted.len() / 2] as f64 / whole.pixels() as f64;
        assert!(share > 0.0 && share < 0.3, "{share} of the picture is painted in a usual step");
    }

    #[test]
    fn a_picture_whose_pixels_change_is_painted_again_and_nothing_else() {
        let rect = Rect::from_min_size(pos2(40.0, 20.0), vec2(80.0, 40.0));
        let mut mesh = Mesh::with_texture(TextureId::User(7));
        let whole = Rect::from_min_max(pos2(0.0, 0.0), pos2(1.0, 1.0));
        mesh.add_rect_with_uv(rect, whole, Color32::WHITE);
        let clip_rect = Rect::from_min_size(pos2(0.0, 0.0), vec2(100.0, 100.0));
        let all = [ClippedPrimitive { clip_rect, primitive: Primitive::Mesh(mesh) }];
        let none = HashSet::new();
        assert_eq!(damage(&all, &all, &none, 1.0, SIZE), []);
        let changed = HashSet::from([TextureId::User(7)]);
        let expected = Clip { x: [40, 100], y: [20, 60] };
        assert_eq!(damage(&all, &all, &changed, 1.0, SIZE), [expected]);
        assert_eq!(damage(&[], &all, &none, 1.0, SIZE), [expected]);
        assert_eq!(damage(&all, &[], &none, 1.0, SIZE), [expected]);
    }
}
