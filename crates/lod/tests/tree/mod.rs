//! Small valid trees for the tests: random points on the lattice, taken by an additive octree with
//! skipped chains, oriented contours, continuations and whole levels; up to three such trees in one
//! table. Simple rather than fast; keeps each node's points for the tests.

use bytemuck::Zeroable;
use esker_points::node::{NONE, SHAPE_CONTINUATION, SHAPE_ORIENTED, pack_rotation};
use esker_points::{Cell, Lattice, Node, NodeTable};
use glam::{DMat3, DVec3};
use proptest::prelude::*;

/// A table of one or more trees, and the points of its nodes.
#[derive(Clone, Debug)]
pub struct Tree {
    pub lattice: Lattice,
    pub table: NodeTable,
    pub points: Vec<Vec<[u32; 3]>>,
}

/// Parameters of a tree.
#[derive(Clone, Debug)]
pub struct Recipe {
    pub seed: u64,
    pub points: usize,
    pub capacity: usize,
    /// Whether contours are tight and rotated; otherwise each is its cell's cube.
    pub tight: bool,
    /// Number of trees, all in the same place.
    pub trees: u64,
}

pub fn recipes(tight: bool) -> impl Strategy<Value = Recipe> {
    (any::<u64>(), 1usize..1500, 4usize..60, 1u64..4).prop_map(
        move |(seed, points, capacity, trees)| Recipe { seed, points, capacity, tight, trees },
    )
}

/// Knuth's MMIX generator: enough for tests.
pub struct Random(pub u64);

impl Random {
    pub fn unit(&mut self) -> f64 {
        self.0 =
            self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }
    pub fn below(&mut self, n: u32) -> u32 {
        (self.unit() * f64::from(n)) as u32
    }
}

pub fn grow(recipe: &Recipe) -> Tree {
    let base = [0; 3].map({
        let mut random = Random(recipe.seed);
        move |_: u32| random.below(1 << 31)
    });
    let mut all: Option<Tree> = None;
    for number in 0..recipe.trees {
        let tree = grow_one(recipe, base, recipe.seed.wrapping_add(number));
        match &mut all {
            Some(all) => {
                all.table.join(&tree.table, 0);
                all.points.extend(tree.points);
            }
            None => all = Some(tree),
        }
    }
    all.expect("a recipe has a tree")
}

fn grow_one(recipe: &Recipe, base: [u32; 3], seed: u64) -> Tree {
    let mut random = Random(seed);
    let lattice = Lattice {
        scale: [0.01, 0.01, 0.01],
        offset: [1e6, -1e6, 0.0],
        shift: [0; 3],
        ..Lattice::default()
    };
    // Clusters of many sizes, including flat ones and coincident points.
    let mut points = Vec::new();
    while points.len() < recipe.points {
        let corner = [0; 3].map(|_: u32| random.below(20_000));
        let coincident = random.below(6) == 0;
        let extent = [0; 3].map(|_: u32| if coincident { 1 } else { 1 << random.below(13) });
        for _ in 0..=random.below(200) {
            points.push([0, 1, 2].map(|i| base[i] + corner[i] + random.below(extent[i])));
        }
    }
    points.truncate(recipe.points);
    let mut tree = Tree { lattice, table: NodeTable::default(), points: Vec::new() };
    // Breadth first: children are contiguous and come after their parents.
    let mut level = vec![(NONE, points, None)];
    while !level.is_empty() {
        let mut below = Vec::new();
        for (parent, share, cell) in level {
            let index = tree.table.nodes.len() as u32;
            if let Some(above) = tree.table.nodes.get_mut(parent as usize) {
                if above.child_count == 0 {
                    above.first_child = index;
                }
                above.child_count += 1;
            }
            let (rest, cell) = tree.add(parent, share, cell, recipe, &mut random);
            below.extend(rest.into_iter().map(|share| (index, share, cell)));
        }
        level = below;
    }
    tree
}

impl Tree {
    /// Adds a node for `share` of the points, in `cell` if that is given. Returns the points left
    /// for each of its children, and their cell if a child continues this node.
    fn add(
        &mut self,
        parent: u32,
        share: Vec<[u32; 3]>,
        cell: Option<Cell>,
        recipe: &Recipe,
        random: &mut Random,
    ) -> (Vec<Vec<[u32; 3]>>, Option<Cell>) {
        let fold = |f: fn(u32, u32) -> u32| {
            share
                .iter()
                .copied()
                .reduce(|a, b| [0, 1, 2].map(|i| f(a[i], b[i])))
                .expect("a share has points")
        };
        let cell = cell.unwrap_or(Cell::enclosing(fold(u32::min), fold(u32::max)));
        let step = share.len().div_ceil(recipe.capacity);
        // A cell with up to twice the points of a node may have two nodes.
        let continues = cell.log2 == 0 || step == 2 && random.below(2) == 0;
        let (mut own, mut rest) = (Vec::new(), vec![Vec::new(); 8]);
        for (i, p) in share.into_iter().enumerate() {
            match i % step {
                0 => own.push(p),
                _ if continues => rest[0].push(p),
                _ => rest[usize::from(cell.octant(p))].push(p),
            }
        }
        let mut node = Node::zeroed();
        (node.corner, node.cell_log2, node.parent) = (cell.corner, cell.log2, parent);
        node.shape = if cell.log2 == 0 { 0 } else { 1 + random.below(3) as u8 };
        let above = self.table.nodes.get(parent as usize).filter(|p| p.cell() == cell);
        if above.is_some() {
            node.shape |= SHAPE_CONTINUATION;
        }
        let first = own.len().min(1 + random.below(8) as usize);
        node.set_levels(&[first, own.len() - first]);
        let edge = cell.edge() as f64 * self.lattice.scale[0];
        let in_cell = own.len() + above.map_or(0, |p| p.points());
        node.spacing = if cell.log2 == 0 { 0.0 } else { (edge / (in_cell as f64).sqrt()) as f32 };
        self.bound(&mut node, &own, recipe.tight, random);
        self.table.nodes.push(node);
        self.points.push(own);
        rest.retain(|r| !r.is_empty());
        (rest, continues.then_some(cell))
    }

    fn bound(&self, node: &mut Node, own: &[[u32; 3]], tight: bool, random: &mut Random) {
        let corner = DVec3::from_array(self.lattice.world(node.corner));
        let turn = if tight { random.unit() * 3.0 } else { 0.0 };
        let frame = DMat3::from_rotation_x(turn) * DMat3::from_rotation_z(turn * 0.7);
        let (rotation, axes) = pack_rotation(frame.to_cols_array_2d());
        let axes = DMat3::from_cols_array_2d(&axes);
        let cell = node.cell();
        let bounded = if tight { own.to_vec() } else { vec![cell.corner, cell.last()] };
        let local =
            |p: &[u32; 3]| axes.transpose() * (DVec3::from_array(self.lattice.world(*p)) - corner);
        let min = bounded.iter().map(local).fold(DVec3::INFINITY, DVec3::min);
        let max = bounded.iter().map(local).fold(DVec3::NEG_INFINITY, DVec3::max);
        let centre = axes * min.midpoint(max);
        node.contour_centre = centre.as_vec3().to_array();
        // Grown by the rounding error of f32.
        let grown = (max - min) * 0.5 + DVec3::splat(1e-6 * (1.0 + centre.length()));
        node.contour_half = grown.as_vec3().to_array();
        node.contour_rotation = rotation;
        node.shape |= if tight { SHAPE_ORIENTED } else { 0 };
    }

    pub fn world(&self, p: [u32; 3]) -> DVec3 {
        DVec3::from_array(self.lattice.world(p))
    }

    /// Lowest and highest corner of the roots' cells.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        let cells = self.table.roots().map(|root| self.table.nodes[root as usize].cell());
        let bounds = cells.map(|cell| (self.world(cell.corner), self.world(cell.last())));
        bounds.reduce(|a, b| (a.0.min(b.0), a.1.max(b.1))).expect("a tree has a root")
    }

    pub fn is_root(&self, node: u32) -> bool {
        self.table.nodes[node as usize].parent == NONE
    }
}
