//! Sizes of windows that fit their monitor.

use eframe::egui::{Vec2, vec2};

/// Least size of a monitor, points, that the window is made for. On smaller ones, such as those
/// with a large scale factor, everything is drawn smaller.
const LEAST: Vec2 = vec2(800.0, 500.0);
/// Least factor by which everything is drawn smaller.
const ZOOM_MIN: f32 = 0.4;
/// Share of a monitor that a window may take, beside its title and the bars of the desktop.
const ROOM: Vec2 = vec2(1.0, 0.92);

/// Factor by which everything is drawn, at most 1, on a monitor of a size in points.
pub fn zoom(monitor: Vec2) -> f32 {
    if !(monitor.x > 0.0 && monitor.y > 0.0) {
        return 1.0;
    }
    (monitor / LEAST).min_elem().clamp(ZOOM_MIN, 1.0)
}

/// The wanted size of a window, points, or less so that it fits its monitor.
pub fn within(wanted: Vec2, monitor: Vec2) -> Vec2 {
    if monitor.x > 0.0 && monitor.y > 0.0 { wanted.min(monitor * ROOM) } else { wanted }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_fit_their_monitor_at_any_scale_factor() {
        let pixels = vec2(1600.0, 1000.0);
        for scale in [1.0, 1.25, 2.0, 3.0, 4.0] {
            let monitor = pixels / scale;
            let size = within(vec2(1280.0, 800.0), monitor);
            assert!(size.x <= monitor.x && size.y < monitor.y, "{scale}: {size}");
            // In points as they are drawn.
            let seen = monitor / zoom(monitor);
            assert!(zoom(monitor) <= 1.0 && seen.x >= 799.0 && seen.y >= 499.0, "{scale}: {seen}");
        }
        assert_eq!(zoom(vec2(1600.0, 1000.0)), 1.0);
        assert_eq!(within(vec2(1280.0, 800.0), vec2(1600.0, 1000.0)), vec2(1280.0, 800.0));
        assert_eq!((zoom(Vec2::ZERO), within(LEAST, Vec2::ZERO)), (1.0, LEAST));
    }
}
