//! Reference for pull and push: pull-push as published (marroquim2007, sections 3.2 and 3.3), and
//! with depths moved along the discs' planes, in slow and plain `f64` code. It is written from the
//! paper and shares no code with the crate. Where the paper leaves a choice, it follows the heads
//! of `pull`, `push` and `tangent`.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

/// A pixel of a level of the pyramid.
#[derive(Clone, Copy, Debug)]
pub struct Pixel {
    /// Depth interval.
    pub depth: [f64; 2],
    /// Attributes that are averaged and nothing else: mean depth, red, green, blue, normal z.
    pub carried: [f64; 5],
    /// Normal x and y (view space), and the ratio of the ellipse's minor axis to its major axis.
    pub disc: [f64; 3],
    /// Relative change of depth by one pixel to the right, and minus that by one pixel up. Planes
    /// fitted to depths have it in the place of a normal.
    pub tilt: Option<[f64; 2]>,
    /// Radius, pixels of the picture.
    pub radius: f64,
    /// Vector from the ellipse's centre to the pixel's centre, pixels of the picture.
    pub displacement: [f64; 2],
}

/// An image; `None` is an invalid pixel.
#[derive(Clone, Debug)]
pub struct Image {
    pub width: usize,
    pub height: usize,
    /// Edge of a pixel of this level, pixels of the picture.
    pub edge: f64,
    pub pixels: Vec<Option<Pixel>>,
    /// Focal length and centre of the picture, pixels, if depths are moved along planes; `None` if
    /// they are used as published.
    pub lens: Option<[f64; 3]>,
    /// Number of comparisons whose result rounding to `f32` might change.
    pub near_ties: usize,
}

impl Image {
    fn get(&self, x: i64, y: i64) -> Option<Pixel> {
        let inside = x >= 0 && y >= 0 && x < self.width as i64 && y < self.height as i64;
        if inside { self.pixels[y as usize * self.width + x as usize] } else { None }
    }

    fn centre(&self, x: i64, y: i64) -> [f64; 2] {
        [(x as f64 + 0.5) * self.edge, (y as f64 + 0.5) * self.edge]
    }
}

impl Pixel {
    /// Factor by which depths of this pixel (centred at `centre`) change from its ellipse's centre
    /// to `place`.
    fn factor(&self, lens: Option<[f64; 3]>, centre: [f64; 2], place: [f64; 2]) -> f64 {
        let from = [0, 1].map(|i| centre[i] - self.displacement[i]);
        let to_place = [place[0] - from[0], place[1] - from[1]];
        if let Some([right, up]) = self.tilt {
            return 1.0 / (1.0 - right * to_place[0] + up * to_place[1]).clamp(0.5, 2.0);
        }
        let Some([focal, middle_x, middle_y]) = lens else { return 1.0 };
        let [nx, ny, nz] = [self.disc[0], self.disc[1], self.carried[4]];
        let q = nx * (from[0] - middle_x) - ny * (from[1] - middle_y) - nz * focal;
        let q = q.min(-(nx.abs() + ny.abs()) * focal / 32.0);
        let change = nx * to_place[0] - ny * to_place[1];
        if change == 0.0 { 1.0 } else { 1.0 / (1.0 + change / q).clamp(0.5, 2.0) }
    }

    /// Centre of the ellipse of this pixel, which is centred at `centre`.
    fn ellipse(&self, centre: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|i| centre[i] - self.displacement[i])
    }

    /// This pixel with its depth interval multiplied by `factor`.
    fn moved(&self, factor: f64) -> Pixel {
        Pixel { depth: self.depth.map(|d| d * factor), ..*self }
    }
}

/// Whether two values are so close that rounding may order them either way. Equal values are copies
/// of the same input and compare alike in any arithmetic.
fn near(a: f64, b: f64) -> bool {
    a != b && (a - b).abs() <= 1e-5 * (a.abs() + b.abs())
}

/// Fills all gaps of `picture`. With `smooths`, also smooths the pixels that stay (not published).
pub fn pull_push(picture: Image, smooths: bool) -> Image {
    let mut levels = vec![picture];
    loop {
        let finest = &levels[levels.len() - 1];
        if finest.width == 1 && finest.height == 1 {
            break;
        }
        let coarser = pull(finest);
        levels.push(coarser);
    }
    let mut ties = levels.iter().map(|l| l.near_ties).sum();
    let mut coarser = levels.pop().unwrap();
    while let Some(finer) = levels.pop() {
        coarser = push(&coarser, &finer, smooths && levels.is_empty());
        ties += coarser.near_ties;
    }
    coarser.near_ties = ties;
    coarser
}

/// Computes the next coarser level (section 3.2).
fn pull(finer: &Image) -> Image {
    let (width, height) = (finer.width.div_ceil(2), finer.height.div_ceil(2));
    let mut coarser = Image {
        width,
        height,
        edge: finer.edge * 2.0,
        pixels: Vec::new(),
        near_ties: 0,
        lens: finer.lens,
    };
    for y in 0..height as i64 {
        for x in 0..width as i64 {
            let mut valid = Vec::new();
            for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                let at = (2 * x + dx, 2 * y + dy);
                if let Some(p) = finer.get(at.0, at.1) {
                    valid.push((p, finer.centre(at.0, at.1)));
                }
            }
            let count = valid.len() as f64;
            let compare_at =
                [0, 1].map(|i| valid.iter().map(|(p, c)| p.ellipse(*c)[i]).sum::<f64>() / count);
            let moved = valid
                .iter()
                .map(|(p, c)| (p.moved(p.factor(finer.lens, *c, compare_at)), (*p, *c)));
            let kept = frontmost(&moved.collect::<Vec<_>>(), &mut coarser.near_ties);
            let centre = coarser.centre(x, y);
            let weight = 1.0 / kept.len() as f64;
            let shares: Vec<_> = kept.iter().map(|&(_, (p, c))| (p, c, weight)).collect();
            let mut pixel = mean(&shares, centre, finer.lens);
            if let Some(out) = &mut pixel {
                let ends = kept.iter().map(|(_, (p, c))| {
                    p.moved(p.factor(finer.lens, *c, out.ellipse(centre))).depth
                });
                let ends: Vec<_> = ends.collect();
                out.depth[0] = ends.iter().map(|d| d[0]).fold(f64::INFINITY, f64::min);
                out.depth[1] = ends.iter().map(|d| d[1]).fold(0.0, f64::max);
                // Not published: a short mean of normals is none.
                let length2 = out.disc[0].powi(2) + out.disc[1].powi(2) + out.carried[4].powi(2);
                coarser.near_ties += usize::from(length2 > 0.0 && near(length2, 0.16));
                if length2 < 0.16 {
                    (out.disc[0], out.disc[1], out.carried[4]) = (0.0, 0.0, 0.0);
                }
            }
            coarser.pixels.push(pixel);
        }
    }
    coarser
}

/// The pixels whose depth interval overlaps that of the frontmost pixel.
fn frontmost<T: Copy>(pixels: &[(Pixel, T)], near_ties: &mut usize) -> Vec<(Pixel, T)> {
    let mut first: Option<Pixel> = None;
    for (p, _) in pixels {
        if let Some(f) = first {
            *near_ties += usize::from(near(p.depth[0], f.depth[0]));
        }
        if first.is_none_or(|f| p.depth[0] < f.depth[0]) {
            first = Some(*p);
        }
    }
    let Some(first) = first else { return Vec::new() };
    *near_ties += pixels.iter().filter(|(p, _)| near(p.depth[0], first.depth[1])).count();
    pixels.iter().copied().filter(|(p, _)| p.depth[0] <= first.depth[1]).collect()
}

/// Weighted mean of `pixels` (pixel, centre, weight), for a pixel centred at `centre`.
fn mean(
    pixels: &[(Pixel, [f64; 2], f64)],
    centre: [f64; 2],
    lens: Option<[f64; 3]>,
) -> Option<Pixel> {
    if pixels.is_empty() {
        return None;
    }
    let mut out = Pixel {
        depth: [0.0; 2],
        carried: [0.0; 5],
        disc: [0.0; 3],
        tilt: pixels.iter().find_map(|(p, ..)| p.tilt.map(|_| [0.0; 2])),
        radius: 0.0,
        displacement: [0.0; 2],
    };
    for (p, c, weight) in pixels {
        (0..2).for_each(|i| out.displacement[i] += (p.displacement[i] + centre[i] - c[i]) * weight);
    }
    for (p, c, weight) in pixels {
        let factor = p.factor(lens, *c, out.ellipse(centre));
        (0..2).for_each(|i| out.depth[i] += p.depth[i] * factor * weight);
        out.carried[0] += p.carried[0] * factor * weight;
        (1..5).for_each(|i| out.carried[i] += p.carried[i] * weight);
        (0..3).for_each(|i| out.disc[i] += p.disc[i] * weight);
        if let (Some(sum), Some(tilt)) = (&mut out.tilt, p.tilt) {
            (0..2).for_each(|i| sum[i] += tilt[i] * weight);
        }
        out.radius += p.radius * weight;
    }
    Some(out)
}

/// Whether the ellipse of a pixel centred at `centre` covers `place`, computed along its axes.
fn covers(p: &Pixel, centre: [f64; 2], place: [f64; 2], near_ties: &mut usize) -> bool {
    // Vector from the ellipse's centre, with y up as in the normal.
    let v =
        [place[0] - (centre[0] - p.displacement[0]), -(place[1] - (centre[1] - p.displacement[1]))];
    let distance = v[0].hypot(v[1]);
    let flat = p.disc[0].hypot(p.disc[1]);
    *near_ties += usize::from((distance - p.radius).abs() <= 1e-5 * (distance + p.radius));
    if flat == 0.0 {
        return distance <= p.radius;
    }
    let minor_direction = [p.disc[0] / flat, p.disc[1] / flat];
    let along = v[0] * minor_direction[0] + v[1] * minor_direction[1];
    let across = v[0] * -minor_direction[1] + v[1] * minor_direction[0];
    let minor = p.radius * p.disc[2].abs();
    if minor == 0.0 {
        return along == 0.0 && across.abs() <= p.radius;
    }
    let form = (along / minor).powi(2) + (across / p.radius).powi(2);
    *near_ties += usize::from((form - 1.0).abs() < 1e-4);
    form <= 1.0
}

/// Blends a pixel that stays with the coarser pixels that cover it. Their depths are those at the
/// place of comparison.
fn smooth(own: &Pixel, covering: &[(Pixel, Weighted)], near_ties: &mut usize) -> Pixel {
    let (mut out, mut sum) = (*own, 0.0);
    let mut means = [0.0; 6];
    let values =
        |p: &Pixel| [p.carried[1], p.carried[2], p.carried[3], p.carried[4], p.disc[0], p.disc[1]];
    for (p, (_, _, weight)) in covering {
        let [[a, b], [c, d]] = [own.depth, p.depth];
        *near_ties += usize::from(near(a, d) || near(c, b));
        let [n, m] = [own, p].map(|p| [p.disc[0], p.disc[1], p.carried[4]]);
        let dot = |a: [f64; 3], b: [f64; 3]| (0..3).map(|i| a[i] * b[i]).sum::<f64>();
        // Squared cosine of 15 degrees.
        let [cosine, crease] = [dot(n, m) * dot(n, m).max(0.0), 0.933 * dot(n, n) * dot(m, m)];
        *near_ties += usize::from((cosine - crease).abs() < 1e-4 * crease);
        if c <= b && a <= d && cosine >= crease {
            sum += weight;
            means.iter_mut().zip(values(p)).for_each(|(mean, value)| *mean += value * weight);
        }
    }
    if sum > 0.0 {
        // One half if all four coarser pixels contribute, since their weights add up to one.
        let share = 0.5 * sum;
        let old = values(own);
        let new: [f64; 6] = std::array::from_fn(|i| old[i] + (means[i] / sum - old[i]) * share);
        out.carried[1..].copy_from_slice(&new[..4]);
        out.disc[..2].copy_from_slice(&new[4..]);
    }
    out
}

/// A coarser pixel, its centre and its weight.
type Weighted = (Pixel, [f64; 2], f64);

/// Radius from which ellipses hide pixels beside them, as in `push`.
const HIDING_PX: f64 = 24.0;

/// A coarser pixel moved to the place of comparison; the unmoved pixel, its centre and its weight.
type MovedPixel = (Pixel, (Pixel, [f64; 2], f64));

/// Whether a pixel with a normal lies behind all four coarser pixels and between the centres of
/// their ellipses (not published).
fn is_enclosed(own: &Pixel, place: [f64; 2], beside: &[MovedPixel], near_ties: &mut usize) -> bool {
    let mut is_enclosed = beside.len() == 4;
    let mut along: [Vec<f64>; 4] = Default::default();
    for (moved, (p, centre, _)) in beside {
        let [x, y] = [0, 1].map(|i| place[i] - (centre[i] - p.displacement[i]));
        let (away, reach) = (x.hypot(y), 1.15 * p.radius);
        *near_ties += usize::from(near(own.depth[0], moved.depth[1]) || near(away, reach));
        is_enclosed &= moved.depth[1] < own.depth[0] && away <= reach;
        along.iter_mut().zip([x, y, x + y, x - y]).for_each(|(all, one)| all.push(one));
    }
    for along in along {
        *near_ties += usize::from(along.iter().any(|a| a.abs() < 1e-4));
        is_enclosed &= along.iter().any(|&a| a < 0.0) && along.iter().any(|&a| a > 0.0);
    }
    is_enclosed
}

/// Interpolates the invalid and occluded pixels of the finer level (section 3.3).
fn push(coarser: &Image, finer: &Image, smooths: bool) -> Image {
    let mut out = Image { near_ties: 0, ..finer.clone() };
    for y in 0..finer.height as i64 {
        for x in 0..finer.width as i64 {
            let own = finer.get(x, y);
            let above = coarser.get(x / 2, y / 2);
            let place = finer.centre(x, y);
            let compare_at = own.map_or(place, |own| own.ellipse(place));
            let side = [if x % 2 == 1 { 1 } else { -1 }, if y % 2 == 1 { 1 } else { -1 }];
            let mut stays = false;
            if let (Some(own), Some(above)) = (own, above) {
                let factor = above.factor(finer.lens, coarser.centre(x / 2, y / 2), compare_at);
                let [min, max] = above.moved(factor).depth;
                // With a lens, a pixel slightly in front of the interval that it produced stays
                // either way.
                let before = near(own.depth[0], min) && finer.lens.is_none();
                out.near_ties += usize::from(before || near(own.depth[0], max));
                let mut is_hidden = own.depth[0] < min || own.depth[0] > max;
                // Not published: wide ellipses beside the coarser pixel hide it, too.
                for (dx, dy) in [(side[0], 0), (0, side[1]), (side[0], side[1])] {
                    let at = (x / 2 + dx, y / 2 + dy);
                    let Some(beside) = coarser.get(at.0, at.1) else { continue };
                    let centre = coarser.centre(at.0, at.1);
                    let [_, max] =
                        beside.moved(beside.factor(finer.lens, centre, compare_at)).depth;
                    out.near_ties += usize::from(
                        near(own.depth[0], max) || (beside.radius - HIDING_PX).abs() < 1e-4,
                    );
                    is_hidden |= beside.radius >= HIDING_PX && own.depth[0] > max;
                }
                stays = !is_hidden;
            }
            let beside =
                [(0, 0, 9.0), (side[0], 0, 3.0), (0, side[1], 3.0), (side[0], side[1], 1.0)];
            let beside = beside.into_iter().filter_map(|(dx, dy, weight)| {
                let at = (x / 2 + dx, y / 2 + dy);
                let (p, centre) = (coarser.get(at.0, at.1)?, coarser.centre(at.0, at.1));
                let moved = p.moved(p.factor(finer.lens, centre, compare_at));
                Some((moved, (p, centre, weight / 16.0)))
            });
            let beside: Vec<_> = beside.collect();
            let of = own.filter(|own| finer.lens.is_some() && own.tilt.is_none());
            let is_enclosed =
                of.is_some_and(|own| is_enclosed(&own, place, &beside, &mut out.near_ties));
            let mut covering = Vec::new();
            for (moved, (p, centre, weight)) in beside {
                if covers(&p, centre, place, &mut out.near_ties) || is_enclosed {
                    covering.push((moved, (p, centre, weight)));
                }
            }
            let kept = if stays { Vec::new() } else { frontmost(&covering, &mut out.near_ties) };
            if let Some(own) = own {
                let front = kept.iter().min_by(|a, b| a.0.depth[0].total_cmp(&b.0.depth[0]));
                if let Some((front, _)) = front {
                    out.near_ties += usize::from(near(own.depth[0], front.depth[1]));
                    stays |= own.depth[0] <= front.depth[1];
                } else {
                    stays = true;
                }
                if stays && smooths {
                    let at = y as usize * finer.width + x as usize;
                    out.pixels[at] = Some(smooth(&own, &covering, &mut out.near_ties));
                }
                if stays {
                    continue;
                }
            }
            let sum: f64 = kept.iter().map(|(_, (_, _, weight))| weight).sum();
            let shares: Vec<_> =
                kept.iter().map(|&(_, (p, c, weight))| (p, c, weight / sum)).collect();
            if let Some(pixel) = mean(&shares, place, finer.lens) {
                out.pixels[y as usize * finer.width + x as usize] = Some(pixel);
            }
        }
    }
    out
}
