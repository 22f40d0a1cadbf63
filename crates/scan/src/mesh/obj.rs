//! Reads Wavefront OBJ text, line by line: vertices with colours behind them as many programs write
//! them, normals, and faces with positive or negative indices. Groups, materials, texture places,
//! lines and curves are left out. A vertex used with several normals is split.

use super::triangles::{RawMesh, TRIANGLES_MAX, VERTICES_MAX};
use crate::error::ScanError;
use crate::text::blocks::LineBlocks;
use crate::text::number::number;
use esker_points::Task;
use std::collections::HashMap;
use std::io::BufRead;
use std::path::Path;

/// Marks a corner without a normal.
const NONE: u32 = u32::MAX;

/// Reads the mesh of a stream at the beginning of an OBJ file.
///
/// # Errors
/// If a line is damaged, or has an index of nothing, or if there is no face.
pub(crate) fn read(
    path: &Path,
    stream: Box<dyn BufRead + Send>,
    task: &dyn Task,
) -> Result<RawMesh, ScanError> {
    let mut obj = Obj::default();
    let mut lines = LineBlocks::new(stream, path.to_owned(), 1);
    while let Some(block) = lines.next()? {
        task.check()?;
        for (number, line) in block.lines() {
            obj.line(line)
                .map_err(|what| ScanError::damaged(path, format!("line {number} {what}")))?;
        }
    }
    if obj.mesh.triangles.is_empty() {
        let what = "is no mesh that Esker reads: PLY with faces, or OBJ with lines `v` and `f`";
        return Err(ScanError::unsupported(path, what));
    }
    Ok(obj.finish())
}

#[derive(Default)]
struct Obj {
    mesh: RawMesh,
    /// Number of `v` lines; vertices that are split come behind them at the end.
    normals: Vec<[f32; 3]>,
    /// First normal that each `v` is used with; [`NONE`] before.
    first: Vec<u32>,
    /// Places of vertices used with another normal, counted from the last `v`.
    splits: HashMap<(u32, u32), u32>,
    /// Vertex and normal of each split, in order.
    split: Vec<(u32, u32)>,
    /// Corners as places among `v`, or among the splits with [`SPLIT`] set.
    polygon: Vec<u32>,
    colourless: usize,
    skipped: usize,
}

/// Set in the index of a corner that refers to a split vertex.
const SPLIT: u32 = 1 << 31;

impl Obj {
    fn line(&mut self, line: &[u8]) -> Result<(), String> {
        let mut words = line.split(u8::is_ascii_whitespace).filter(|w| !w.is_empty());
        match words.next() {
            Some(b"v") => self.vertex(words),
            Some(b"vn") => {
                let [x, y, z] = numbers::<3>(&mut words)?.0;
                self.normals.push([x as f32, y as f32, z as f32]);
                self.check_room(self.normals.len(), VERTICES_MAX, "normals")
            }
            Some(b"f") => self.face(words),
            Some(b"l" | b"p" | b"curv" | b"surf") => {
                self.skipped += 1;
                Ok(())
            }
            _ => Ok(()),
        }
    }

    fn check_room(&self, count: usize, most: usize, what: &str) -> Result<(), String> {
        if count > most {
            return Err(format!("is beyond the {most} {what} that can be read"));
        }
        Ok(())
    }

    fn vertex<'a>(&mut self, mut words: impl Iterator<Item = &'a [u8]>) -> Result<(), String> {
        let (position, _) = numbers::<3>(&mut words)?;
        let (more, count) = some_numbers::<4>(&mut words)?;
        self.mesh.positions.push(position);
        self.first.push(NONE);
        // Three numbers behind the place are a colour; one is a weight; four are both.
        let colour = match count {
            3 => Some([more[0], more[1], more[2]]),
            4 => Some([more[1], more[2], more[3]]),
            _ => None,
        };
        self.colourless += usize::from(colour.is_none());
        // A conversion to u8 saturates, and makes 0 of what is not a number.
        let byte = |c: f64| (c * 255.0).round() as u8;
        self.mesh.colours.push(colour.map_or([255; 3], |rgb| rgb.map(byte)));
        self.check_room(self.mesh.positions.len(), VERTICES_MAX, "vertices")
    }

    fn face<'a>(&mut self, words: impl Iterator<Item = &'a [u8]>) -> Result<(), String> {
        self.polygon.clear();
        for word in words {
            let mut parts = word.split(|&b| b == b'/');
            let v = index(parts.next().unwrap_or_default(), self.mesh.positions.len(), "vertex")?;
            let normal = match parts.nth(1) {
                Some(n) if !n.is_empty() => index(n, self.normals.len(), "normal")?,
                _ => NONE,
            };
            let corner = self.corner(v, normal)?;
            self.polygon.push(corner);
        }
        if self.polygon.len() < 3 {
            return Err("is a face of fewer than three vertices".into());
        }
        for pair in self.polygon[1..].windows(2) {
            self.mesh.triangles.push([self.polygon[0], pair[0], pair[1]]);
        }
        self.check_room(self.mesh.triangles.len(), TRIANGLES_MAX, "triangles")
    }

    fn corner(&mut self, v: u32, normal: u32) -> Result<u32, String> {
        let first = &mut self.first[v as usize];
        if *first == NONE {
            *first = normal;
        }
        if *first == normal {
            return Ok(v);
        }
        let next = self.split.len() as u32;
        let place = *self.splits.entry((v, normal)).or_insert(next);
        if place == next {
            self.split.push((v, normal));
            self.check_room(self.split.len(), VERTICES_MAX, "vertices")?;
        }
        Ok(place | SPLIT)
    }

    fn finish(self) -> RawMesh {
        let mut mesh = self.mesh;
        if self.skipped > 0 {
            mesh.notes.push(format!("{} lines, points and curves are left out", self.skipped));
        }
        let vertices = mesh.positions.len() as u32;
        for corner in mesh.triangles.as_flattened_mut() {
            if *corner & SPLIT != 0 {
                *corner = vertices + (*corner & !SPLIT);
            }
        }
        if self.colourless == mesh.positions.len() {
            mesh.colours.clear();
        }
        if self.first.iter().any(|&n| n != NONE) {
            // A zero normal is replaced by a computed one later.
            let normal = |n: u32| self.normals.get(n as usize).copied().unwrap_or([0.0; 3]);
            mesh.normals.extend(self.first.iter().map(|&n| normal(n)));
            mesh.normals.extend(self.split.iter().map(|&(_, n)| normal(n)));
        }
        for &(v, _) in &self.split {
            mesh.positions.push(mesh.positions[v as usize]);
            if !mesh.colours.is_empty() {
                mesh.colours.push(mesh.colours[v as usize]);
            }
        }
        mesh
    }
}

/// The place that an index of OBJ names: from 1, or from -1 backwards, of `count` so far.
fn index(word: &[u8], count: usize, kind: &str) -> Result<u32, String> {
    let shown = || String::from_utf8_lossy(&word[..word.len().min(40)]).escape_debug().to_string();
    let number: i64 = std::str::from_utf8(word)
        .ok()
        .and_then(|s| s.parse().ok())
        .ok_or_else(|| format!("has `{}` for a {kind}, which is no whole number", shown()))?;
    let place = if number < 0 { count as i64 + number } else { number - 1 };
    if (0..count as i64).contains(&place) {
        return Ok(place as u32);
    }
    Err(format!("refers to {kind} {number}, and {count} precede it"))
}

/// Exactly `N` numbers, and how many there are.
fn numbers<'a, const N: usize>(
    words: &mut impl Iterator<Item = &'a [u8]>,
) -> Result<([f64; N], usize), String> {
    let mut first = words.by_ref().take(N);
    match some_numbers::<N>(&mut first)? {
        (values, count) if count == N => Ok((values, count)),
        (_, count) => Err(format!("has {count} numbers and needs {N}")),
    }
}

/// Up to `N` numbers, and how many there are.
fn some_numbers<'a, const N: usize>(
    words: &mut impl Iterator<Item = &'a [u8]>,
) -> Result<([f64; N], usize), String> {
    let (mut values, mut count) = ([0.0; N], 0);
    for (value, word) in values.iter_mut().zip(words) {
        *value = number(word).ok_or_else(|| {
            let shown = String::from_utf8_lossy(&word[..word.len().min(40)]);
            format!("has `{}`, which is no number", shown.escape_debug())
        })?;
        count += 1;
    }
    Ok((values, count))
}
