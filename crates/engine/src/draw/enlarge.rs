//! Enlarges pictures that were drawn at a lower resolution.

use esker_render::Picture;

/// Enlarges a picture to `width` x `height` pixels, bilinearly. Depths are those of the nearest
/// pixels, since depths of different surfaces are not mixed.
pub fn enlarged(picture: &Picture, [width, height]: [u32; 2]) -> Picture {
    if [picture.width, picture.height] == [width, height] {
        return picture.clone();
    }
    let mut out = Picture { width, height, stats: picture.stats, ..Picture::default() };
    let place = |at: u32, to: u32, from: u32| {
        let place = (f64::from(at) + 0.5) * f64::from(from) / f64::from(to) - 0.5;
        let place = place.clamp(0.0, f64::from(from - 1));
        let low = (place as u32).min(from - 1);
        (low, (low + 1).min(from - 1), place - f64::from(low))
    };
    for y in 0..height {
        let (y0, y1, v) = place(y, height, picture.height);
        for x in 0..width {
            let (x0, x1, u) = place(x, width, picture.width);
            let at = |x: u32, y: u32| y as usize * picture.width as usize + x as usize;
            let corners = [
                (at(x0, y0), (1.0 - u) * (1.0 - v)),
                (at(x1, y0), u * (1.0 - v)),
                (at(x0, y1), (1.0 - u) * v),
                (at(x1, y1), u * v),
            ];
            for channel in 0..4 {
                let sum = corners.iter().map(|(i, w)| f64::from(picture.rgba[i * 4 + channel]) * w);
                out.rgba.push(sum.sum::<f64>().round() as u8);
            }
            let nearest = at(if u < 0.5 { x0 } else { x1 }, if v < 0.5 { y0 } else { y1 });
            out.depth.push(picture.depth[nearest]);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_enlarged_plain_picture_stays_plain() {
        let plain = Picture {
            width: 3,
            height: 2,
            rgba: [7, 8, 9, 255].repeat(6),
            depth: vec![2.0; 6],
            ..Picture::default()
        };
        let large = enlarged(&plain, [7, 5]);
        assert_eq!(large.rgba, [7, 8, 9, 255].repeat(35));
        assert_eq!(large.depth, vec![2.0; 35]);
    }
}
