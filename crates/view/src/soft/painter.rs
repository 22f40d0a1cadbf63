//! Paints egui's meshes on the CPU: triangles row by row, texture times vertex colour, blended as
//! premultiplied colours in gamma space, as egui defines them. Used on machines without a graphics
//! driver. The colour of a pixel does not depend on the rectangle that is painted, so that parts of
//! the window can be painted again.

use super::clip::Clip;
use eframe::egui::epaint::{ClippedPrimitive, ImageDelta, Mesh, Primitive, Vertex};
use eframe::egui::{Color32, ImageData, TextureFilter, TextureId, TexturesDelta};
use std::collections::{HashMap, HashSet};

/// A picture of 0RGB pixels, in rows.
pub struct Target<'a> {
    /// Width, pixels.
    pub width: usize,
    /// Height, pixels.
    pub height: usize,
    /// Pixels, row by row.
    pub pixels: &'a mut [u32],
}

/// Paints meshes with the textures that egui has sent.
#[derive(Default)]
pub struct Painter {
    textures: HashMap<TextureId, Texture>,
}

/// Premultiplied colours, row by row.
#[derive(Default)]
struct Texture {
    size: [usize; 2],
    pixels: Vec<Color32>,
    /// Whether enlarged texels are interpolated.
    is_linear: bool,
}

/// Values that are interpolated over a triangle: texture coordinates in texels, and colour, 0 to
/// 255.
#[derive(Clone, Copy, Default)]
struct Varying([f32; 6]);

impl Target<'_> {
    /// Fills a rectangle with a colour.
    pub fn clear(&mut self, clip: Clip, colour: u32) {
        let clip = clip.within(Clip::whole([self.width, self.height]));
        if clip.is_empty() {
            return;
        }
        let [x, y] = [clip.x, clip.y].map(|side| side.map(|v| v as usize));
        for row in y[0]..y[1] {
            self.pixels[row * self.width + x[0]..row * self.width + x[1]].fill(colour);
        }
    }
}

impl Painter {
    /// Applies new and changed textures. Returns those in which texels have changed that meshes may
    /// have used; a new letter in an empty place of a font is no such change.
    pub fn take(&mut self, delta: &mut TexturesDelta) -> HashSet<TextureId> {
        let mut changed = HashSet::new();
        for (id, deltas) in delta.set.drain() {
            let texture = self.textures.entry(id).or_default();
            let is_changed = |delta: &ImageDelta| texture.change(delta);
            if deltas.iter().map(is_changed).fold(false, |any, one| any | one) {
                changed.insert(id);
            }
        }
        changed
    }

    /// Removes textures that are no longer used.
    pub fn free(&mut self, delta: &mut TexturesDelta) {
        for id in delta.free.drain() {
            self.textures.remove(&id);
        }
    }

    /// Paints meshes over the pixels of the picture within `part`; `scale` is pixels per point.
    pub fn paint(
        &self,
        primitives: &[ClippedPrimitive],
        scale: f32,
        part: Clip,
        target: &mut Target<'_>,
    ) {
        let size = [target.width, target.height];
        for ClippedPrimitive { clip_rect, primitive } in primitives {
            let Primitive::Mesh(mesh) = primitive else { continue };
            let Some(texture) = self.textures.get(&mesh.texture_id) else { continue };
            let clip = Clip::of(*clip_rect, scale, size).within(part);
            if !clip.is_empty() && mesh.is_valid() {
                paint_mesh(mesh, texture, scale, clip, target);
            }
        }
    }
}

impl Texture {
    /// Applies a change. Returns whether texels have changed that were not empty.
    fn change(&mut self, delta: &ImageDelta) -> bool {
        let ImageData::Color(image) = &delta.image;
        self.is_linear = delta.options.magnification == TextureFilter::Linear;
        let differs = |old: &[Color32], new: &[Color32]| {
            old.iter().zip(new).any(|(a, b)| a != b && *a != Color32::TRANSPARENT)
        };
        let Some([x, y]) = delta.pos else {
            // Fonts grow downwards.
            let is_same = self.size[0] == image.size[0] && self.size[1] <= image.size[1];
            let is_changed = !is_same || differs(&self.pixels, &image.pixels);
            self.size = image.size;
            self.pixels.clone_from(&image.pixels);
            return is_changed;
        };
        let [width, height] = image.size;
        if x + width > self.size[0] || y + height > self.size[1] {
            return false;
        }
        let mut is_changed = false;
        for row in 0..height {
            let to = (y + row) * self.size[0] + x;
            let (old, new) =
                (&mut self.pixels[to..to + width], &image.pixels[row * width..][..width]);
            is_changed |= differs(old, new);
            old.copy_from_slice(new);
        }
        is_changed
    }

    /// Colour at a place, in texels: of the nearest one, or between those around.
    fn at(&self, u: f32, v: f32) -> [u32; 4] {
        let [width, height] = self.size;
        if self.pixels.is_empty() {
            return [0; 4];
        }
        let texel = |x: usize, y: usize| self.pixels[y * width + x].to_array().map(u32::from);
        if !self.is_linear {
            let side = |t: f32, side: usize| (t.max(0.0) as usize).min(side - 1);
            return texel(side(u, width), side(v, height));
        }
        // Shares in 256ths, from the centres of texels.
        let side = |t: f32, side: usize| {
            let at = ((t - 0.5).max(0.0) * 256.0) as usize;
            let first = (at >> 8).min(side - 1);
            (first, (first + 1).min(side - 1), (at & 255) as u32)
        };
        let ((x, right, across), (y, below, down)) = (side(u, width), side(v, height));
        if across == 0 && down == 0 {
            return texel(x, y);
        }
        let [a, b, c, d] = [texel(x, y), texel(right, y), texel(x, below), texel(right, below)];
        std::array::from_fn(|i| {
            let upper = a[i] * (256 - across) + b[i] * across;
            let lower = c[i] * (256 - across) + d[i] * across;
            (upper * (256 - down) + lower * down + (1 << 15)) >> 16
        })
    }
}

impl Varying {
    fn of(vertex: &Vertex, texture: &Texture) -> Self {
        let [r, g, b, a] = vertex.color.to_array().map(f32::from);
        let [width, height] = texture.size.map(|side| side as f32);
        Self([vertex.uv.x * width, vertex.uv.y * height, r, g, b, a])
    }

    fn plus(self, other: Self, times: f32) -> Self {
        Self(std::array::from_fn(|i| self.0[i] + other.0[i] * times))
    }
}

/// A texture that is painted in its own size and colours, so that each pixel is one texel.
struct OwnSize;

impl OwnSize {
    /// Tells whether a triangle shows its texture so; `by_x` and `by_y` are the changes from pixel
    /// to pixel.
    fn of(by_x: Varying, by_y: Varying, corners: &[Varying; 3], texture: &Texture) -> Option<Self> {
        /// Greatest part of a texel by which the last pixel may be off.
        const OFF: f32 = 1e-3;
        let most = texture.size[0].max(texture.size[1]).max(1) as f32;
        let is_near = |a: f32, b: f32| (a - b).abs() * most < OFF;
        let is_own = is_near(by_x.0[0], 1.0)
            && is_near(by_x.0[1], 0.0)
            && is_near(by_y.0[0], 0.0)
            && is_near(by_y.0[1], 1.0);
        let is_white = corners.iter().all(|corner| corner.0[2..] == [255.0; 4]);
        (is_own && is_white).then_some(Self)
    }

    /// Texels of the pixels of a row from column `from`; `first` is the place in the texture of the
    /// pixel in column 0. `None` if pixels lie between texels, or beyond the texture. Which of
    /// these is so does not depend on `from`.
    fn texels<'a>(
        &self,
        first: [f32; 2],
        from: i64,
        texture: &'a Texture,
    ) -> Option<impl Iterator<Item = &'a Color32>> {
        /// Greatest distance of pixels from texels: colours have no more steps.
        const APART: f32 = 1.0 / 512.0;
        let texel = first.map(|at| (at - 0.5).round());
        let is_on = (0..2).all(|i| (first[i] - 0.5 - texel[i]).abs() < APART);
        let row = usize::try_from(texel[1] as i64).ok().filter(|_| is_on)?;
        let row = texture.pixels.chunks_exact(texture.size[0].max(1)).nth(row)?;
        let skipped = usize::try_from(texel[0] as i64 + from).unwrap_or(0);
        // A row that ends early repeats its last texel, as elsewhere.
        Some(row.iter().skip(skipped).chain(std::iter::repeat(row.last()?)))
    }
}

fn paint_mesh(mesh: &Mesh, texture: &Texture, scale: f32, clip: Clip, target: &mut Target<'_>) {
    for triangle in mesh.triangles() {
        let corners = triangle.map(|i| mesh.vertices[i as usize]);
        let at = corners.map(|v| [v.pos.x * scale, v.pos.y * scale]);
        let is_beside = |side: usize, [from, to]: [i64; 2]| {
            at.iter().all(|p| p[side] < from as f32) || at.iter().all(|p| p[side] > to as f32)
        };
        if is_beside(0, clip.x) || is_beside(1, clip.y) {
            continue;
        }
        if at.iter().flatten().all(|v| v.is_finite()) {
            paint_triangle(at, corners.map(|v| Varying::of(&v, texture)), texture, clip, target);
        }
    }
}

/// X at which an edge crosses a row. It is computed from the upper end of the edge in either
/// direction, so that triangles that share the edge agree on every pixel.
fn crossing(a: [f32; 2], b: [f32; 2], y: f32) -> Option<f32> {
    let (a, b) = if a[1] <= b[1] { (a, b) } else { (b, a) };
    (a[1] <= y && y < b[1]).then(|| a[0] + (y - a[1]) * (b[0] - a[0]) / (b[1] - a[1]))
}

fn paint_triangle(
    at: [[f32; 2]; 3],
    varying: [Varying; 3],
    texture: &Texture,
    clip: Clip,
    target: &mut Target<'_>,
) {
    let [a, b, c] = at;
    let (ab, ac) = ([b[0] - a[0], b[1] - a[1]], [c[0] - a[0], c[1] - a[1]]);
    let area = ab[0] * ac[1] - ab[1] * ac[0];
    if area.abs() < 1e-9 {
        return;
    }
    let [to_b, to_c] = [1, 2].map(|i| varying[i].plus(varying[0], -1.0));
    let along =
        |b_share: f32, c_share: f32| Varying::default().plus(to_b, b_share).plus(to_c, c_share);
    let by_x = along(ac[1] / area, -ab[1] / area);
    let by_y = along(-ac[0] / area, ab[0] / area);
    let is_plain = by_x.0.iter().all(|v| v.abs() < 1e-6) && by_y.0.iter().all(|v| v.abs() < 1e-6);
    let own_size = OwnSize::of(by_x, by_y, &varying, texture);
    let [top, bottom] = [f32::min, f32::max].map(|pick| at.iter().map(|p| p[1]).reduce(pick));
    let rows =
        (pixel(top.unwrap_or(0.0)).max(clip.y[0]))..(pixel(bottom.unwrap_or(0.0)).min(clip.y[1]));
    for row in rows {
        let y = row as f32 + 0.5;
        let edges = [(a, b), (b, c), (c, a)].map(|(p, q)| crossing(p, q, y));
        let crossings = || edges.iter().flatten().copied();
        let (Some(left), Some(right)) =
            (crossings().reduce(f32::min), crossings().reduce(f32::max))
        else {
            continue;
        };
        let [from, to] = [pixel(left).max(clip.x[0]), pixel(right).min(clip.x[1])];
        if from >= to {
            continue;
        }
        let start = row as usize * target.width;
        let line = &mut target.pixels[start + from as usize..start + to as usize];
        if is_plain {
            fill(line, colour(varying[0], texture));
        } else {
            let row = varying[0].plus(by_y, y - a[1]);
            let first = [row.0[0] + 0.5 - a[0], row.0[1]];
            if let Some(texels) = own_size.as_ref().and_then(|own| own.texels(first, from, texture))
            {
                line.iter_mut().zip(texels).for_each(|(pixel, texel)| {
                    *pixel = blend(*pixel, texel.to_array().map(u32::from));
                });
                continue;
            }
            for (x, pixel) in (from..).zip(line) {
                let now = row.plus(by_x, x as f32 + 0.5 - a[0]);
                *pixel = blend(*pixel, colour(now, texture));
            }
        }
    }
}

/// First pixel whose centre is not left of `v`.
fn pixel(v: f32) -> i64 {
    (v - 0.5).ceil() as i64
}

fn colour(varying: Varying, texture: &Texture) -> [u32; 4] {
    let [u, v, rest @ ..] = varying.0;
    let texel = texture.at(u, v);
    // Rounded before the product, so that 255 times 255 stays 255.
    std::array::from_fn(|i| (rest[i].clamp(0.0, 255.0) + 0.5) as u32 * texel[i] / 255)
}

fn fill(line: &mut [u32], colour: [u32; 4]) {
    if colour[3] == 255 {
        line.fill(colour[0] << 16 | colour[1] << 8 | colour[2]);
    } else if colour != [0; 4] {
        line.iter_mut().for_each(|pixel| *pixel = blend(*pixel, colour));
    }
}

fn blend(below: u32, [r, g, b, a]: [u32; 4]) -> u32 {
    let left = 255 - a.min(255);
    let mix = |colour: u32, shift: u32| {
        let below = below >> shift & 255;
        (colour + (below * left + 127) / 255).min(255) << shift
    };
    mix(r, 16) | mix(g, 8) | mix(b, 0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use eframe::egui::epaint::{Primitive, WHITE_UV};
    use eframe::egui::{ColorImage, Rect, TextureOptions, pos2, vec2};
    use std::sync::Arc;

    fn white() -> Painter {
        let mut painter = Painter::default();
        let mut delta = TexturesDelta::default();
        let image = ColorImage::filled([2, 2], Color32::WHITE);
        let image = ImageDelta::full(ImageData::Color(Arc::new(image)), TextureOptions::NEAREST);
        delta.push(TextureId::default(), image);
        painter.take(&mut delta);
        painter
    }

    fn paint(rect: Rect, clip: Rect, colour: Color32, below: u32) -> Vec<u32> {
        let mut mesh = Mesh::default();
        mesh.add_colored_rect(rect, colour);
        let primitive = ClippedPrimitive { clip_rect: clip, primitive: Primitive::Mesh(mesh) };
        let mut pixels = vec![below; 16 * 8];
        let mut target = Target { width: 16, height: 8, pixels: &mut pixels };
        white().paint(&[primitive], 1.0, Clip::whole([16, 8]), &mut target);
        pixels
    }

    #[test]
    fn a_rectangle_of_two_triangles_covers_each_of_its_pixels_once() {
        assert_eq!(WHITE_UV, pos2(0.0, 0.0));
        let rect = Rect::from_min_size(pos2(3.0, 2.0), vec2(7.0, 4.0));
        let half = Color32::from_rgba_premultiplied(100, 0, 0, 128);
        let pixels = paint(rect, Rect::EVERYTHING, half, 0x0000_00ff);
        for (i, &pixel) in pixels.iter().enumerate() {
            let inside = (3..10).contains(&(i % 16)) && (2..6).contains(&(i / 16));
            let once = 100 << 16 | 127;
            assert_eq!(pixel, if inside { once } else { 0xff }, "pixel {i}");
        }
    }

    #[test]
    fn enlarged_pictures_are_interpolated_if_their_texture_says_so() {
        let row = |options: TextureOptions, size: usize| -> Vec<u32> {
            let mut painter = Painter::default();
            let mut delta = TexturesDelta::default();
            let image = ColorImage::new([2, 1], vec![Color32::BLACK, Color32::from_gray(200)]);
            let image = ImageDelta::full(ImageData::Color(Arc::new(image)), options);
            delta.push(TextureId::default(), image);
            painter.take(&mut delta);
            let mut mesh = Mesh::default();
            let rect = Rect::from_min_size(pos2(0.0, 0.0), vec2(size as f32, 1.0));
            let whole = Rect::from_min_max(pos2(0.0, 0.0), pos2(1.0, 1.0));
            mesh.add_rect_with_uv(rect, whole, Color32::WHITE);
            let primitive = Primitive::Mesh(mesh);
            let primitives = [ClippedPrimitive { clip_rect: Rect::EVERYTHING, primitive }];
            let mut pixels = vec![0; size];
            let mut target = Target { width: size, height: 1, pixels: &mut pixels };
            painter.paint(&primitives, 1.0, Clip::whole([size, 1]), &mut target);
            pixels.into_iter().map(|pixel| pixel & 255).collect()
        };
        assert_eq!(row(TextureOptions::NEAREST, 8), [0, 0, 0, 0, 200, 200, 200, 200]);
        assert_eq!(row(TextureOptions::LINEAR, 8), [0, 0, 25, 75, 125, 175, 200, 200]);
        assert_eq!(row(TextureOptions::LINEAR, 2), [0, 200], "in its own size it stays as it is");
    }

    #[test]
    fn nothing_is_painted_beyond_the_clip_or_the_picture() {
        let rect = Rect::from_min_max(pos2(-1e6, -50.0), pos2(1e6, 50.0));
        let clip = Rect::from_min_max(pos2(4.0, 1.0), pos2(6.0, 3.0));
        let pixels = paint(rect, clip, Color32::WHITE, 0);
        assert_eq!(pixels.iter().filter(|&&p| p == 0x00ff_ffff).count(), 4);
        assert_eq!(pixels.iter().filter(|&&p| p == 0).count(), 16 * 8 - 4);
    }

    #[test]
    fn a_picture_in_its_own_size_is_copied_wherever_it_lies() {
        let (width, height) = (13, 7);
        let texel = |i: usize| Color32::from_rgb(i as u8, (i * 3) as u8, (i * 7) as u8);
        let image = ColorImage::new([width, height], (0..width * height).map(texel).collect());
        let mut painter = Painter::default();
        let mut delta = TexturesDelta::default();
        let image = ImageDelta::full(ImageData::Color(Arc::new(image)), TextureOptions::LINEAR);
        delta.push(TextureId::default(), image);
        painter.take(&mut delta);
        let whole = Rect::from_min_max(pos2(0.0, 0.0), pos2(1.0, 1.0));
        for (at, part) in
            [([0.0, 0.0], [0, 16, 0, 8]), ([2.0, 1.0], [0, 16, 0, 8]), ([2.0, 1.0], [5, 9, 3, 4])]
        {
            let mut mesh = Mesh::default();
            let rect = Rect::from_min_size(at.into(), vec2(width as f32, height as f32));
            mesh.add_rect_with_uv(rect, whole, Color32::WHITE);
            let primitive = Primitive::Mesh(mesh);
            let primitives = [ClippedPrimitive { clip_rect: Rect::EVERYTHING, primitive }];
            let mut pixels = vec![0xff_ffff; 16 * 8];
            let mut target = Target { width: 16, height: 8, pixels: &mut pixels };
            let clip = Clip { x: [part[0], part[1]], y: [part[2], part[3]] };
            painter.paint(&primitives, 1.0, clip, &mut target);
            for (i, pixel) in pixels.into_iter().enumerate() {
                let place = [(i % 16) as i64, (i / 16) as i64];
                let [x, y] = [0, 1].map(|side| place[side] - at[side] as i64);
                let is_painted = (part[0]..part[1]).contains(&place[0])
                    && (part[2]..part[3]).contains(&place[1])
                    && (0..width as i64).contains(&x)
                    && (0..height as i64).contains(&y);
                let [r, g, b, _] =
                    texel((y * width as i64 + x).max(0) as usize).to_array().map(u32::from);
                let expected = if is_painted { r << 16 | g << 8 | b } else { 0xff_ffff };
                assert_eq!(pixel, expected, "{at:?} {part:?}: pixel {i}");
            }
        }
    }
}
