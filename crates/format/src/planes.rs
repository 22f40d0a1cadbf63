//! Raw values of each plane of a page, computed from a node's points.

use crate::layout::{AttributePlane, ColourSource, PageLayout, PlaneKind, PlaneSpec};
use crate::points::PagePoints;
use esker_points::palette::NO_COLOUR;
use esker_points::quant::{HOT_POSITION_BYTES, INDEX_AT, oct_encode, push_residual, residual};

/// A node's points and everything that their planes depend on.
pub(crate) struct Values<'a> {
    pub layout: &'a PageLayout,
    pub box_min: [u32; 3],
    pub hot_shift: u8,
    pub points: &'a PagePoints,
}

impl Values<'_> {
    /// Appends the values of a plane, one a point.
    pub fn push(&self, plane: &PlaneSpec, out: &mut Vec<u8>) {
        let points = self.points;
        match plane.kind {
            PlaneKind::Position => self.push_positions(out),
            PlaneKind::Residual if self.hot_shift > 0 => {
                for p in &points.positions {
                    let bits = |axis| residual(p[axis], self.box_min[axis], self.hot_shift);
                    push_residual([bits(0), bits(1), bits(2)], self.hot_shift, out);
                }
            }
            PlaneKind::Residual => {}
            PlaneKind::Colour => self.push_colour(out),
            PlaneKind::ColourRemainder => self.push_remainder(out),
            PlaneKind::Intensity => {
                let is_there = |&a: &usize| self.layout.plane_of(a) == AttributePlane::Intensity;
                if let Some(a) = (0..points.columns.len()).find(is_there) {
                    out.extend_from_slice(&points.columns[a]);
                }
            }
            PlaneKind::Normal => self.push_normals(out),
            PlaneKind::Class => out.extend(points.classes.iter().flat_map(|c| c.to_le_bytes())),
            PlaneKind::Attribute(a) => out.extend_from_slice(&points.columns[usize::from(a)]),
            PlaneKind::ClipLines => {
                out.extend(points.clip_lines.iter().flatten().flat_map(|w| w.to_le_bytes()));
            }
            PlaneKind::Compact => self.push_compact(out),
            PlaneKind::Tangents => out.extend(points.tangents.iter().flatten()),
            // Planes of unknown kinds are zeros.
            PlaneKind::Unknown(_) => {
                out.resize(out.len() + points.len() * plane.value_bytes as usize, 0);
            }
        }
    }

    fn push_positions(&self, out: &mut Vec<u8>) {
        let start = out.len();
        out.resize(start + self.points.len() * HOT_POSITION_BYTES, 0);
        let records = out[start..].as_chunks_mut::<HOT_POSITION_BYTES>().0;
        let mut outside = false;
        let with_radius = self.points.positions.iter().zip(&self.points.radius_codes);
        for (record, (p, &radius)) in records.iter_mut().zip(with_radius) {
            let [x, y, z] = *p;
            let [x0, y0, z0] = self.box_min;
            outside |= (x < x0) | (y < y0) | (z < z0);
            let step = |c: u32, least: u32| u64::from(c.wrapping_sub(least) >> self.hot_shift);
            let (x, y, z) = (step(x, x0), step(y, y0), step(z, z0));
            outside |= x | y | z > 0xffff;
            let word = x | y << 16 | z << 32 | u64::from(radius) << 48;
            *record = word.to_le_bytes();
        }
        assert!(!outside, "a point outside its box");
    }

    fn push_normals(&self, out: &mut Vec<u8>) {
        let points = self.points;
        if self.layout.normals().is_estimated() {
            out.extend(points.normals.iter().flatten().flat_map(|c| c.to_le_bytes()));
            return;
        }
        let Some(xyz) = self.layout.schema().normals() else { return };
        let columns = xyz.map(|a| points.columns[a].as_chunks::<4>().0);
        for i in 0..points.len() {
            let code = oct_encode(columns.map(|c| f32::from_le_bytes(c[i])));
            out.extend(code.iter().flat_map(|c| c.to_le_bytes()));
        }
    }

    fn push_colour(&self, out: &mut Vec<u8>) {
        self.push_channels(ColourSource::drawn_byte, out, |rgb| match rgb {
            Some([red, green, blue]) => [red, green, blue, 255],
            None => [0; 4],
        });
    }

    /// Appends positions with the index of the palette's nearest colour.
    fn push_compact(&self, out: &mut Vec<u8>) {
        let Some(palette) = self.layout.palette() else { return };
        let (start, mut colours) = (out.len(), Vec::new());
        self.push_positions(out);
        self.push_colour(&mut colours);
        let records = out[start..].as_chunks_mut::<HOT_POSITION_BYTES>().0;
        for (record, &[red, green, blue, has]) in records.iter_mut().zip(colours.as_chunks().0) {
            record[INDEX_AT] =
                if has == 0 { NO_COLOUR } else { palette.nearest([red, green, blue]) };
        }
    }

    fn push_remainder(&self, out: &mut Vec<u8>) {
        let byte = |colour: ColourSource| match colour.depth {
            Some(_) => 1 - colour.drawn_byte(),
            None => usize::MAX,
        };
        self.push_channels(byte, out, Option::unwrap_or_default);
    }

    /// Appends the result of `give` for each point's red, green and blue: for the byte of their
    /// values that `byte` selects, and for `None` without such a byte or without colour.
    fn push_channels<const N: usize>(
        &self,
        byte: impl Fn(ColourSource) -> usize,
        out: &mut Vec<u8>,
        give: impl Fn(Option<[u8; 3]>) -> [u8; N],
    ) {
        let channels: Vec<Option<Channels<'_>>> = (0..self.layout.classes().len().max(1))
            .map(|class| {
                let colour = self.layout.colour_of_class(class)?;
                let (at, stride) = (byte(colour), if colour.depth.is_some() { 2 } else { 1 });
                let [red, green, blue] =
                    colour.rgb.map(|a| self.points.columns[a].get(at..).unwrap_or_default());
                (at < stride).then_some(Channels { red, green, blue, stride })
            })
            .collect();
        let start = out.len();
        out.resize(start + self.points.len() * N, 0);
        for (i, value) in out[start..].as_chunks_mut::<N>().0.iter_mut().enumerate() {
            let channels = channels[self.points.class(i)].as_ref();
            *value = give(channels.map(|c| {
                let at = i * c.stride;
                [c.red[at], c.green[at], c.blue[at]]
            }));
        }
    }
}

/// One byte of the red, green and blue of all points, with a stride.
struct Channels<'a> {
    red: &'a [u8],
    green: &'a [u8],
    blue: &'a [u8],
    stride: usize,
}
