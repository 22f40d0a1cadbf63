//! The frustum of a frozen cut, painted as lines when it is seen from outside: from its eye to the
//! corners of a rectangle in front of it.

use eframe::egui::{Color32, Painter, Pos2, Rect, Stroke, pos2};
use esker_engine::View;
use glam::DVec3;

/// Lines are clipped at this multiple of the near plane's distance.
const NEARLY: f64 = 1.001;

/// Corners of the view's picture at this eye depth, world, in their order around it.
pub fn corners(view: &View, depth: f64) -> [DVec3; 4] {
    let half = view.tan_half() * view.parallel_at.unwrap_or(depth);
    [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
        .map(|(x, y)| view.eye + view.world_from_view * DVec3::new(x * half.x, y * half.y, -depth))
}

/// Edges of the frustum down to this depth, as lines between world points. Those of a parallel view
/// begin at its near plane.
pub fn edges(view: &View, depth: f64) -> Vec<[DVec3; 2]> {
    let far = corners(view, depth);
    let near = match view.parallel_at {
        Some(_) => corners(view, view.near),
        None => [view.eye; 4],
    };
    (0..4).flat_map(|i| [[near[i], far[i]], [far[i], far[(i + 1) % 4]]]).collect()
}

/// Projects a line between world points to the picture of the view `seen`, pixels. The line is
/// clipped at the near plane; `None` if all of it is behind it.
pub fn project(seen: &View, line: [DVec3; 2]) -> Option<[[f64; 2]; 2]> {
    let [a, b] = line.map(|p| seen.to_view(p));
    let near = seen.near * NEARLY;
    let cut = |inside: DVec3, outside: DVec3| {
        let share = (near + inside.z) / (inside.z - outside.z);
        inside + (outside - inside) * share
    };
    let [a, b] = match [a, b].map(|p| -p.z >= near) {
        [true, true] => [a, b],
        [true, false] => [a, cut(a, b)],
        [false, true] => [cut(b, a), b],
        [false, false] => return None,
    };
    let on = [a, b].map(|p| {
        let scale = seen.focal_px() / seen.parallel_at.unwrap_or((-p.z).max(seen.near));
        [f64::from(seen.width) * 0.5 + p.x * scale, f64::from(seen.height) * 0.5 - p.y * scale]
    });
    on.iter().flatten().all(|v| v.is_finite()).then_some(on)
}

/// Paints the frustum of `frozen` down to `depth` over a picture of the view `seen` that fills
/// `rect`.
pub fn paint(painter: &Painter, rect: Rect, frozen: &View, seen: &View, depth: f64, ink: Color32) {
    let size = [f64::from(seen.width), f64::from(seen.height)];
    let at = |p: [f64; 2]| -> Pos2 {
        let x = (p[0] / size[0]).clamp(-100.0, 100.0) as f32;
        let y = (p[1] / size[1]).clamp(-100.0, 100.0) as f32;
        pos2(rect.left() + x * rect.width(), rect.top() + y * rect.height())
    };
    for line in edges(frozen, depth) {
        if let Some([a, b]) = project(seen, line) {
            let line = [at(a), at(b)];
            painter.line_segment(line, Stroke::new(3.0, Color32::from_black_alpha(140)));
            painter.line_segment(line, Stroke::new(1.5, ink));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn view(eye: DVec3, target: DVec3) -> View {
        esker_engine::cameras::camera::Camera {
            eye: Some(eye),
            target: Some(target),
            ..Default::default()
        }
        .view([[0.0; 3], [1.0; 3]], [200, 100])
    }

    #[test]
    fn corners_of_a_view_lie_at_the_corners_of_its_picture() {
        let view = view(DVec3::new(1e7, 2e7, 50.0), DVec3::new(1e7 + 3.0, 2e7 + 4.0, 40.0));
        let on = corners(&view, 10.0).map(|c| view.project(c).unwrap());
        for (on, should) in on.iter().zip([[0.0, 100.0], [200.0, 100.0], [200.0, 0.0], [0.0, 0.0]])
        {
            assert!((on.x - should[0]).abs() < 1e-4 && (on.y - should[1]).abs() < 1e-4, "{on}");
        }
    }

    #[test]
    fn a_parallel_view_has_a_frustum_of_equal_sides_and_projects_lines_as_the_picture_does() {
        let bounds = [DVec3::ZERO, DVec3::new(10.0, 20.0, 4.0)];
        let view = view(DVec3::new(-30.0, -30.0, 20.0), DVec3::new(5.0, 10.0, 2.0));
        let view = view.parallel(12.0, bounds[0], bounds[1]);
        for depth in [view.near, view.near + 30.0] {
            let [a, b, c, _] = corners(&view, depth);
            assert!((a.distance(b) - 24.0).abs() < 1e-6 && (b.distance(c) - 12.0).abs() < 1e-6);
        }
        let line = [DVec3::new(1.0, 2.0, 3.0), DVec3::new(9.0, 3.0, 0.0)];
        let on = project(&view, line).unwrap();
        for (on, p) in on.iter().zip(line) {
            let p = view.project(p).unwrap();
            assert!((on[0] - p.x).abs() < 1e-6 && (on[1] - p.y).abs() < 1e-6, "{on:?} and {p}");
        }
    }

    #[test]
    fn lines_are_clipped_at_the_near_plane_and_left_out_behind_it() {
        let seen = view(DVec3::ZERO, DVec3::Y);
        assert_eq!(project(&seen, [-DVec3::Y, -DVec3::Y * 2.0]), None);
        let [a, b] =
            project(&seen, [DVec3::new(0.0, 5.0, 0.0), DVec3::new(0.1, -5.0, 0.0)]).unwrap();
        assert_eq!(a, [100.0, 50.0]);
        assert!(b[0] > 200.0, "the line leaves the picture to the right");
    }
}
