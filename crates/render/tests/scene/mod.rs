//! Synthetic scenes for tests, pictures and benchmarks: points in the world become nodes with
//! planes, as the builder would lay them out (Morton order, hot positions and residuals), without
//! its levels.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

use esker_lod::View;
use esker_points::{AttrType, Cell, Clip, Grain, Lattice, Node, morton, quant};
use esker_render::{ColourBy, ColourPlane, DrawNode, Frame};
#[allow(unused_imports, reason = "not every user of this module rolls dice")]
pub use esker_truth::dice::Dice;
pub use esker_truth::sample::ScenePoint;
use glam::DVec3;

/// A node and its planes.
pub struct SceneNode {
    pub node: Node,
    pub position: Vec<u8>,
    pub residual: Vec<u8>,
    pub colour: Vec<u8>,
    pub normal: Vec<u8>,
    /// Empty if no point is clipped.
    pub clip: Vec<u8>,
    /// Empty if all splats are discs.
    pub tangents: Vec<u8>,
}

/// A lattice and the nodes on it.
pub struct Scene {
    pub lattice: Lattice,
    pub nodes: Vec<SceneNode>,
}

impl Scene {
    /// Puts `points` on a lattice of step `step` with the origin of the world in its middle, in
    /// nodes of at most `capacity` points. All nodes have the same spacing and radius.
    pub fn new(
        points: &[ScenePoint],
        step: f64,
        spacing: f64,
        radius: f64,
        capacity: usize,
    ) -> Self {
        Self::clipped(points, |_, _| Clip::default(), step, spacing, radius, capacity)
    }

    /// Version of [`Scene::new`] with clip lines: `clip` maps the lattice and an index of `points`
    /// to the lines of that point.
    pub fn clipped(
        points: &[ScenePoint],
        clip: impl Fn(&Lattice, usize) -> Clip,
        step: f64,
        spacing: f64,
        radius: f64,
        capacity: usize,
    ) -> Self {
        let lattice =
            Lattice { scale: [step; 3], offset: [0.0; 3], shift: [0; 3], ..Lattice::default() };
        let place = |p: &ScenePoint| {
            [0, 1, 2]
                .map(|i| lattice.steps_axis(i, p.at[i]).round().clamp(0.0, 4_294_967_295.0) as u32)
        };
        let lines = (0..points.len()).map(|i| clip(&lattice, i));
        let mut sorted: Vec<_> = points.iter().zip(lines).map(|(p, c)| (place(p), *p, c)).collect();
        sorted.sort_by_cached_key(|(at, ..)| morton::encode3(*at));
        let code = quant::radius_code(radius, spacing);
        let nodes =
            sorted.chunks(capacity).map(|run| SceneNode::new(&lattice, run, spacing as f32, code));
        Self { lattice, nodes: nodes.collect() }
    }

    /// All nodes with all their points, and with the planes that the arguments select.
    pub fn draws(&self, residual: bool, colour: bool, normal: bool) -> Vec<DrawNode<'_>> {
        self.nodes.iter().map(|n| n.draw(residual, colour, normal)).collect()
    }

    /// A frame in RGB with back-face culling.
    pub fn frame<'a>(&'a self, view: &'a View, draws: &'a [DrawNode<'a>]) -> Frame<'a> {
        Frame {
            colour: ColourBy::Rgb,
            cull_back_faces: true,
            ..Frame::new(view, &self.lattice, draws)
        }
    }

    /// The bytes of the colour plane, read as scalars of type `ty`.
    #[allow(dead_code, reason = "not every user of this module tests scalars")]
    pub fn scalar(node: &SceneNode, ty: AttrType) -> ColourPlane<&[u8]> {
        ColourPlane::Scalar { bytes: &node.colour, ty }
    }
}

impl SceneNode {
    /// The node with all its points.
    pub fn draw(&self, residual: bool, colour: bool, normal: bool) -> DrawNode<'_> {
        DrawNode {
            node: &self.node,
            entry: 0,
            prefix: usize::MAX,
            above: 0.0,
            position: &self.position,
            residual: residual.then_some(&self.residual[..]),
            colour: if colour { ColourPlane::Rgba(&self.colour) } else { ColourPlane::None },
            normal: normal.then_some(&self.normal[..]),
            clip: (!self.clip.is_empty()).then_some(&self.clip[..]),
            tangents: (!self.tangents.is_empty()).then_some(&self.tangents[..]),
        }
    }

    fn new(
        lattice: &Lattice,
        run: &[([u32; 3], ScenePoint, Clip)],
        spacing: f32,
        radius_code: u8,
    ) -> Self {
        let fold = |f: fn(u32, u32) -> u32| {
            run.iter().map(|r| r.0).reduce(|a, b| [0, 1, 2].map(|i| f(a[i], b[i]))).unwrap()
        };
        let (min, max) = (fold(u32::min), fold(u32::max));
        let cell = Cell::enclosing(min, max);
        let extent = (0..3).map(|i| max[i] - min[i]).max().unwrap();
        let shift = quant::hot_shift(extent);
        let mut node: Node = bytemuck::Zeroable::zeroed();
        (node.corner, node.cell_log2, node.spacing) = (cell.corner, cell.log2, spacing);
        (node.box_min, node.hot_shift) = (min, shift);
        let steps = |i: usize, at: f64| (at * lattice.scale[i]) as f32;
        let middle = |i: usize| (f64::from(min[i]) + f64::from(max[i])) / 2.0;
        node.contour_centre = [0, 1, 2].map(|i| steps(i, middle(i) - f64::from(cell.corner[i])));
        node.contour_half = [0, 1, 2].map(|i| steps(i, f64::from(max[i] - min[i]) / 2.0));
        node.set_levels(&[run.len()]);
        let mut out = Self {
            node,
            position: Vec::new(),
            residual: Vec::new(),
            colour: Vec::new(),
            normal: Vec::new(),
            clip: Vec::new(),
            tangents: Vec::new(),
        };
        let is_clipped = run.iter().any(|(.., clip)| !clip.is_none());
        for (at, point, clip) in run {
            let q = [0, 1, 2].map(|i| quant::hot(at[i], min[i], shift));
            q.iter().for_each(|q| out.position.extend(q.to_le_bytes()));
            out.position.extend([radius_code, 0]);
            let low = [0, 1, 2].map(|i| quant::residual(at[i], min[i], shift));
            quant::push_residual(low, shift, &mut out.residual);
            out.colour.extend(point.colour.iter().chain(&[255]));
            let oct = quant::oct_encode(point.normal.as_vec3().to_array());
            oct.iter().for_each(|c| out.normal.extend(c.to_le_bytes()));
            if is_clipped {
                let hot = [0, 1, 2].map(|i| quant::exact(q[i], 0, min[i], shift));
                let words = clip.words(hot, Grain::default());
                out.clip.extend(words.iter().flat_map(|w| w.to_le_bytes()));
            }
        }
        out
    }
}

/// Points on the unit sphere, as even as the builder's samples: points of a spiral, each moved at
/// random by up to half a spacing an axis.
#[allow(dead_code, reason = "not every user of this module tests outlines")]
pub fn even_sphere(dice: &mut Dice, spacing: f64) -> Vec<ScenePoint> {
    let count = (4.0 * std::f64::consts::PI / spacing.powi(2)) as usize;
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    let jitter = |dice: &mut Dice| (dice.unit() - 0.5) * spacing;
    (0..count)
        .map(|i| {
            let z = 1.0 - 2.0 * (i as f64 + 0.5) / count as f64;
            let (s, c) = (i as f64 * golden).sin_cos();
            let r = (1.0 - z * z).sqrt();
            let moved = DVec3::new(r * c + jitter(dice), r * s + jitter(dice), z + jitter(dice));
            let normal = moved.normalize_or_zero();
            ScenePoint { at: normal, normal, colour: [220, 180, 120] }
        })
        .collect()
}

/// Points on a sphere, uniformly random.
pub fn sphere(
    dice: &mut Dice,
    centre: DVec3,
    radius: f64,
    count: usize,
    colour: [u8; 3],
) -> Vec<ScenePoint> {
    (0..count)
        .map(|_| {
            let z = 2.0 * dice.unit() - 1.0;
            let (s, c) = (dice.unit() * std::f64::consts::TAU).sin_cos();
            let normal = DVec3::new((1.0 - z * z).sqrt() * c, (1.0 - z * z).sqrt() * s, z);
            ScenePoint { at: centre + normal * radius, normal, colour }
        })
        .collect()
}

/// Points on a parallelogram, stratified: one random point in each cell of a grid of `side` x
/// `side`.
pub fn sheet(
    dice: &mut Dice,
    corner: DVec3,
    u: DVec3,
    v: DVec3,
    side: usize,
    colour: [u8; 3],
) -> Vec<ScenePoint> {
    let normal = u.cross(v).normalize_or_zero();
    (0..side * side)
        .map(|i| {
            let a = ((i % side) as f64 + dice.unit()) / side as f64;
            let b = ((i / side) as f64 + dice.unit()) / side as f64;
            ScenePoint { at: corner + u * a + v * b, normal, colour }
        })
        .collect()
}

/// The Stanford bunny in the folder that `ESKER_DATA` names, `None` if that is not set: the
/// vertices of a binary little-endian PLY file, six floats each (position and normal).
#[allow(dead_code, reason = "not every user of this module reads files")]
pub fn bunny() -> Option<Vec<ScenePoint>> {
    let path = std::path::Path::new(&std::env::var_os("ESKER_DATA")?).join("models/bunny-36k.ply");
    let mut bytes = Vec::new();
    std::io::Read::read_to_end(&mut std::fs::File::open(path).unwrap(), &mut bytes).unwrap();
    let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let count = std::str::from_utf8(&bytes[..end])
        .unwrap()
        .lines()
        .find_map(|l| l.strip_prefix("element vertex ")?.trim().parse::<usize>().ok())
        .unwrap();
    let vertex = |b: &[u8]| {
        let v: [f64; 6] = std::array::from_fn(|i| {
            f64::from(f32::from_le_bytes([0, 1, 2, 3].map(|k| b[i * 4 + k])))
        });
        let [at, normal] = [DVec3::new(v[0], v[1], v[2]), DVec3::new(v[3], v[4], v[5])];
        ScenePoint { at, normal: normal.normalize_or_zero(), colour: [200, 190, 180] }
    };
    Some(bytes[end..].chunks_exact(24).take(count).map(vertex).collect())
}

/// A ball on a floor in random colours, some points a pixel in the views of the tests.
#[allow(dead_code, reason = "not every user of this module tests crowds")]
pub fn speckled() -> Scene {
    let mut dice = Dice(12);
    let mut points = sphere(&mut dice, DVec3::Z, 1.0, 36_000, [0; 3]);
    let (u, v) = (DVec3::X * 4.0, DVec3::Y * 4.0);
    points.extend(sheet(&mut dice, -(u + v) / 2.0, u, v, 180, [0; 3]));
    for p in &mut points {
        p.colour = dice.bits().to_le_bytes()[3..6].try_into().unwrap();
    }
    Scene::new(&points, 1e-5, 0.0225, 0.0225, 3000)
}
