//! A forest: a file and the files that it names, whose trees share one lattice and belong together.
//! To its users it is one cloud: one node table with several roots, and one range of bytes, the
//! files one after the other, which page offsets point into. A file that names no other is a forest
//! of one. Unrelated files are joined as clouds ([`Forest::together`]), each moved by whole steps.
//!
//! The list of a file is complete: it includes the files that the named files name themselves, and
//! their own lists are not followed. So there are no cycles, and no file is in a forest twice.

use crate::error::FormatError;
use crate::layout::PlaneKind;
use crate::metadata::{TREES_MAX, TreeRef};
use crate::normals::Normals;
use crate::reader::{EskerFile, Planes};
use crate::tree_ref::open_named;
use esker_points::address::beside;
use esker_points::palette::Palette;
use esker_points::{Lattice, Node, NodeName, NodeTable, Schema};
use std::ops::Range;
use std::path::{Path, PathBuf};

/// Gap between two files in the range of bytes of the forest: more than is ever read at once.
const FILES_APART_BYTES: u64 = 1 << 32;

/// Opened files whose trees belong together. Reading takes `&self`, from any thread.
#[derive(Clone, Debug)]
pub struct Forest {
    /// The file itself first, then the files that it names, in its order. Never empty.
    trees: Vec<Tree>,
    /// Nodes of all trees, if there are several; otherwise the file's own table is used.
    joined: Option<NodeTable>,
    /// Attributes of all trees.
    schema: Schema,
    /// Lattice of all trees.
    lattice: Lattice,
    /// Metric lattice of all trees.
    metric: Lattice,
    /// Name to show instead of the path.
    name: Option<PathBuf>,
}

/// One file of a forest.
#[derive(Clone, Debug)]
struct Tree {
    file: EskerFile,
    /// Index of its root in the forest's table.
    first_node: u32,
    /// Its first byte in the range of all files.
    first_byte: u64,
    /// Its attribute for each of the forest's.
    attributes: Vec<Option<u16>>,
    /// Cloud that it belongs to.
    cloud: usize,
    /// Steps by which its lattice coordinates are moved.
    moved: [i64; 3],
}

/// Most that a moved cloud may be off whole steps of the lattice, in steps: rounding of coordinates
/// that are given in decimals.
const OFF_STEPS_MAX: f64 = 1e-3;

impl From<EskerFile> for Forest {
    /// The forest of a file's own tree, without the files that it names.
    fn from(file: EskerFile) -> Self {
        let schema = file.metadata().schema.clone();
        let attributes = (0..schema.attributes.len()).map(|i| Some(i as u16)).collect();
        let lattice = file.metadata().lattice;
        let (metric, cloud, moved) = (lattice.metric(), 0, [0; 3]);
        let trees = vec![Tree { file, first_node: 0, first_byte: 0, attributes, cloud, moved }];
        Self { trees, joined: None, schema, lattice, metric, name: None }
    }
}

impl Forest {
    /// Opens a file and all files that it names.
    ///
    /// # Errors
    /// If a file cannot be opened, is not the named one, or is on another lattice.
    pub fn open(path: &Path) -> Result<Self, FormatError> {
        let file = EskerFile::open(path)?;
        let named = file.metadata().forest.clone();
        let open = |tree: &TreeRef| open_named(path, &beside(path, &tree.path), tree);
        let others = named.iter().map(open).collect::<Result<Vec<_>, _>>()?;
        Self::of(file, others)
    }

    /// Opens a file to draw it, as [`EskerFile::open_in_parts`] does; files that name others are
    /// read whole.
    ///
    /// # Errors
    /// As for [`Forest::open`].
    pub fn open_in_parts(path: &Path) -> Result<Self, FormatError> {
        let file = EskerFile::open_in_parts(path)?;
        if file.metadata().forest.is_empty() {
            return Ok(file.into());
        }
        drop(file);
        Self::open(path)
    }

    /// Joins opened files.
    ///
    /// # Errors
    /// If they are on different lattices, or too large together.
    pub fn of(file: EskerFile, others: Vec<EskerFile>) -> Result<Self, FormatError> {
        if others.is_empty() {
            return Ok(file.into());
        }
        let path = file.path().to_path_buf();
        let misfit = |tree: &EskerFile, fault: String| FormatError::Forest {
            path: path.clone(),
            tree: tree.path().into(),
            fault,
        };
        let files = std::iter::once(file).chain(others).collect::<Vec<_>>();
        let lattice = files[0].metadata().lattice;
        if let Some(other) = files.iter().find(|f| !is_same(&f.metadata().lattice, &lattice)) {
            let fault = "lies on another lattice; append its scans instead, which are then placed on this one";
            return Err(misfit(other, fault.into()));
        }
        let files = files.into_iter().map(|file| (file, 0, [0; 3])).collect();
        Self::joined(files, lattice)
    }

    /// Joins unrelated files, at least one, to one cloud of points, each moved by an offset in the
    /// unit of its coordinates. Clouds are in the order given ([`Forest::cloud_of`]). The path is
    /// that of the first one.
    ///
    /// # Errors
    /// If the steps of their lattices differ, they are not whole steps apart, they are too far
    /// apart for one lattice, or too large together.
    ///
    /// # Panics
    /// If there is no cloud.
    pub fn together(clouds: Vec<(Self, [f64; 3])>) -> Result<Self, FormatError> {
        let (base, offset) = &clouds[0];
        let (mut lattice, base) = (base.lattice, base.path().to_path_buf());
        lattice.offset = [0, 1, 2].map(|axis| lattice.offset[axis] + offset[axis]);
        let mut files = Vec::new();
        for (cloud, (forest, offset)) in clouds.into_iter().enumerate() {
            let steps = steps_between(&forest.lattice, offset, &lattice);
            let steps = steps.map_err(|fault| FormatError::Clouds {
                path: forest.path().to_path_buf(),
                base: base.clone(),
                fault,
            })?;
            let add = |moved: [i64; 3]| [0, 1, 2].map(|axis| moved[axis] + steps[axis]);
            files.extend(forest.trees.into_iter().map(|tree| (tree.file, cloud, add(tree.moved))));
        }
        if files.len() > TREES_MAX {
            let fault = format!("makes {} trees with it, of {TREES_MAX} at most", files.len());
            return Err(FormatError::Clouds { path: base.clone(), base, fault });
        }
        Self::joined(files, lattice)
    }

    /// Joins files, each with its cloud and the steps by which it is moved.
    fn joined(
        files: Vec<(EskerFile, usize, [i64; 3])>,
        lattice: Lattice,
    ) -> Result<Self, FormatError> {
        let path = files[0].0.path().to_path_buf();
        let misfit = |tree: &EskerFile, fault: String| FormatError::Forest {
            path: path.clone(),
            tree: tree.path().into(),
            fault,
        };
        let schemas = files.iter().map(|(file, ..)| &file.metadata().schema);
        let schema = schemas.fold(Schema::default(), |all, own| all.union(own));
        let (mut table, mut trees, mut first_byte) = (NodeTable::default(), Vec::new(), 0u64);
        for (file, cloud, moved) in files {
            let file = file.whole()?;
            if file.is_growing() {
                return Err(misfit(
                    &file,
                    format!("is drawn alone, as it is no .esker file; {MERGE}"),
                ));
            }
            let bytes = file.footer().file_bytes.checked_next_multiple_of(FILES_APART_BYTES);
            let end = bytes.and_then(|b| first_byte.checked_add(b)?.checked_add(FILES_APART_BYTES));
            let nodes = table.nodes.len() + file.table().nodes.len();
            let (Some(end), true) = (end, nodes < u32::MAX as usize) else {
                return Err(misfit(&file, "is too large together with the others".into()));
            };
            let own = &file.metadata().schema;
            let index = |i: usize| u16::try_from(i).ok();
            let attributes = schema.attributes.iter();
            let attributes =
                attributes.map(|a| own.find_typed(&a.name, a.ty).and_then(index)).collect();
            let first_node = table.nodes.len() as u32;
            table.join(file.table(), first_byte);
            let added = &mut table.nodes[first_node as usize..];
            let are_placed = added.iter_mut().all(|node| {
                let placed = node.moved(moved);
                *node = placed.unwrap_or(*node);
                placed.is_some()
            });
            let is_within = file.metadata().bounds.is_none_or(|bounds| {
                (0..3).all(|axis| {
                    let place = |c: u32| i64::from(c).checked_add(moved[axis]);
                    bounds.iter().all(|p| place(p[axis]).is_some_and(|c| u32::try_from(c).is_ok()))
                })
            });
            if !(are_placed && is_within) {
                return Err(misfit(&file, format!("lies too far from the others; {MERGE}")));
            }
            trees.push(Tree { file, first_node, first_byte, attributes, cloud, moved });
            first_byte = end;
        }
        let metric = lattice.metric();
        Ok(Self { trees, joined: Some(table), schema, lattice, metric, name: None })
    }

    /// Sets a name to show instead of the path: that of a temporary file means nothing to the user.
    pub fn called(self, name: PathBuf) -> Self {
        Self { name: Some(name), ..self }
    }

    /// Whether pages of its tree are made when they are read ([`crate::growing`]).
    pub fn is_growing(&self) -> bool {
        self.trees[0].file.is_growing()
    }

    /// Whether only a part of its node table is known ([`EskerFile::is_partial`]).
    pub fn is_partial(&self) -> bool {
        self.trees[0].file.is_partial()
    }

    /// Whether its table may become larger ([`Forest::newer`]).
    pub fn grows(&self) -> bool {
        self.is_growing() || self.is_partial()
    }

    /// The same forest with whole node tables ([`EskerFile::whole`]).
    ///
    /// # Errors
    /// If a table cannot be read or is damaged.
    pub fn whole(&self) -> Result<Self, FormatError> {
        if !self.is_partial() {
            return Ok(self.clone());
        }
        // Only forests of one tree are partial.
        let file = self.trees[0].file.whole()?;
        Ok(Self { trees: vec![Tree { file, ..self.trees[0].clone() }], ..self.clone() })
    }

    /// Number of nodes, of which a partial table has only some.
    pub fn nodes(&self) -> u64 {
        match self.is_partial() {
            true => self.trees[0].file.footer().nodes,
            false => self.table().nodes.len() as u64,
        }
    }

    /// Whether both are of the same opened files, in one of the states of a tree that grows.
    pub fn is_same(&self, other: &Self) -> bool {
        let same = |(a, b): (&Tree, &Tree)| a.file.is_same(&b.file) && a.moved == b.moved;
        self.trees.len() == other.trees.len() && self.trees.iter().zip(&other.trees).all(same)
    }

    /// The same forest with its newest table; `None` if this is the newest. Only forests of one
    /// tree grow.
    pub fn newer(&self) -> Option<Self> {
        let [tree] = &self.trees[..] else { return None };
        let file = tree.file.newer()?;
        Some(Self { trees: vec![Tree { file, ..tree.clone() }], ..self.clone() })
    }

    /// The same forest with a table of all nodes, and with what is known of those whose pages were
    /// made; `is_exact` makes the pages of all others too.
    ///
    /// # Errors
    /// If nodes cannot be read.
    pub fn grown(self, is_exact: bool) -> Result<Self, FormatError> {
        let mut newest = self;
        loop {
            let nodes = (0u32..).zip(&newest.table().nodes);
            let open = nodes.filter(|(_, n)| is_exact || n.points() == 0 && n.child_count == 0);
            newest.complete(&open.map(|(index, _)| index).collect::<Vec<_>>())?;
            match newest.newer() {
                Some(newer) => newest = newer,
                None => return Ok(newest),
            }
        }
    }

    /// Makes what is not known yet of nodes ([`EskerFile::complete`]).
    ///
    /// # Errors
    /// If they cannot be read.
    pub fn complete(&self, nodes: &[u32]) -> Result<(), FormatError> {
        self.trees[0].file.complete(nodes)
    }

    /// Path of the file that names the others, or the name set by [`Forest::called`].
    pub fn path(&self) -> &Path {
        self.name.as_deref().unwrap_or_else(|| self.trees[0].file.path())
    }

    /// The files, the one that names the others first.
    pub fn files(&self) -> impl ExactSizeIterator<Item = &EskerFile> {
        self.trees.iter().map(|tree| &tree.file)
    }

    /// The files, each with the index of its root in the forest's table.
    pub(crate) fn files_with_first(&self) -> impl Iterator<Item = (&EskerFile, u32)> {
        self.trees.iter().map(|tree| (&tree.file, tree.first_node))
    }

    /// The files as separate values, the one that names the others first.
    pub fn into_files(self) -> impl Iterator<Item = EskerFile> {
        self.trees.into_iter().map(|tree| tree.file)
    }

    /// Nodes of all trees, with page offsets for [`Forest::read_exact_at`].
    pub fn table(&self) -> &NodeTable {
        self.joined.as_ref().unwrap_or_else(|| self.trees[0].file.table())
    }

    /// Lattice of all trees, on which coordinates are exact.
    pub fn lattice(&self) -> &Lattice {
        &self.lattice
    }

    /// Lattice of the exact coordinates of all points: [`Forest::lattice`], or that of the file
    /// that a tree is made of ([`EskerFile::exact_lattice`]).
    pub fn exact_lattice(&self) -> Lattice {
        if self.is_growing() { self.trees[0].file.exact_lattice() } else { self.lattice }
    }

    /// Least and greatest coordinates of all points on [`Forest::exact_lattice`]; `None` if there
    /// is no point. Those of a tree that grows are the stated ones.
    pub fn exact_bounds(&self) -> Option<[[u32; 3]; 2]> {
        let bounds = self.bounds()?;
        if !self.is_growing() {
            return Some(bounds);
        }
        let exact = self.exact_lattice();
        Some(bounds.map(|corner| {
            let world = self.lattice.world(corner);
            [0, 1, 2].map(|axis| exact.steps_axis(axis, world[axis]).round() as u32)
        }))
    }

    /// Metric lattice of all trees, on which lengths are measured and views are given.
    pub fn metric(&self) -> &Lattice {
        &self.metric
    }

    /// Attributes of all trees; a tree may lack some.
    pub fn schema(&self) -> &Schema {
        &self.schema
    }

    /// Least and greatest lattice coordinates of all points; `None` if there is no point.
    pub fn bounds(&self) -> Option<[[u32; 3]; 2]> {
        self.bounds_without(&[])
    }

    /// Least and greatest lattice coordinates of the points of all clouds but `left_out`; `None` if
    /// there is no point.
    pub fn bounds_without(&self, left_out: &[usize]) -> Option<[[u32; 3]; 2]> {
        let trees = self.trees.iter().filter(|tree| !left_out.contains(&tree.cloud));
        let bounds = trees.filter_map(|tree| {
            let bounds = tree.file.metadata().bounds?;
            Some(bounds.map(|corner| tree.placed(corner)))
        });
        bounds.reduce(|[low, high], [l, h]| {
            [[0, 1, 2].map(|i| low[i].min(l[i])), [0, 1, 2].map(|i| high[i].max(h[i]))]
        })
    }

    /// Number of points of all trees.
    pub fn points(&self) -> u64 {
        self.files().fold(0, |sum, file| sum.saturating_add(file.footer().points))
    }

    /// Bytes of pages and statistics read since opening.
    pub fn read_bytes(&self) -> u64 {
        self.files().fold(0, |sum, file| sum.wrapping_add(file.read_bytes()))
    }

    /// Bytes of all files.
    pub fn file_bytes(&self) -> u64 {
        self.files().fold(0, |sum, file| sum.saturating_add(file.footer().file_bytes))
    }

    fn tree_of(&self, node: u32) -> &Tree {
        &self.trees[self.trees.partition_point(|tree| tree.first_node <= node) - 1]
    }

    /// Tree and index of a node.
    pub fn name_of(&self, node: u32) -> NodeName {
        // Of trees that begin at the same node all but the last are empty.
        let tree = self.trees.partition_point(|tree| tree.first_node <= node) - 1;
        NodeName { tree: tree as u16, index: node - self.trees[tree].first_node }
    }

    /// Number of clouds that [`Forest::together`] joined; 1 for others.
    pub fn clouds(&self) -> usize {
        self.trees.last().map_or(1, |tree| tree.cloud + 1)
    }

    /// Cloud that a node belongs to.
    pub fn cloud_of(&self, node: u32) -> usize {
        self.tree_of(node).cloud
    }

    /// Lattice coordinates of a point of a node, which its file has at `own`. Those beside the
    /// lattice, which no point of a valid file has, become its border.
    pub fn placed(&self, node: u32, own: [u32; 3]) -> [u32; 3] {
        self.tree_of(node).placed(own)
    }

    /// Nodes of the trees of a cloud, in one range.
    pub fn nodes_of_cloud(&self, cloud: usize) -> Range<u32> {
        let first = self.trees.partition_point(|tree| tree.cloud < cloud);
        let behind = self.trees.partition_point(|tree| tree.cloud <= cloud);
        let end = self.table().nodes.len() as u32;
        let at = |tree: usize| self.trees.get(tree).map_or(end, |tree| tree.first_node);
        at(first)..at(behind)
    }

    /// File that has a node.
    pub fn file_of(&self, node: u32) -> &EskerFile {
        &self.tree_of(node).file
    }

    /// Whether any tree has planes of this kind.
    pub fn has(&self, kind: PlaneKind) -> bool {
        self.trees.iter().any(|tree| tree.has(kind))
    }

    /// Palette of the compact planes, if every tree with points has such planes and all palettes
    /// are equal.
    pub fn palette(&self) -> Option<&Palette> {
        let mut trees = self.files().filter(|file| file.footer().nodes > 0);
        let first = trees.next()?.layout().palette()?;
        trees.all(|file| file.layout().palette() == Some(first)).then_some(first)
    }

    /// Whether normals distinguish front and back, in every tree that has normals.
    pub fn has_oriented_normals(&self) -> bool {
        let mut origins = self.files().map(|f| f.layout().normals());
        self.has(PlaneKind::Normal) && origins.all(|n| n == Normals::None || n.is_oriented())
    }

    /// Whether all points cover closed surfaces, so that what faces away is hidden.
    pub fn is_closed(&self) -> bool {
        self.files().all(EskerFile::is_closed)
    }

    /// Whether a node has a plane of this kind.
    pub fn has_plane(&self, node: u32, kind: PlaneKind) -> bool {
        self.tree_of(node).has(kind)
    }

    /// Bytes of one value of a node's plane; 0 if the node has none.
    pub fn value_bytes(&self, node: u32, kind: PlaneKind) -> u64 {
        let tree = self.tree_of(node);
        let layout = tree.file.layout();
        let index = tree.own(kind).and_then(|kind| layout.plane_index(kind));
        index.map_or(0, |i| u64::from(layout.planes()[i].value_bytes))
    }

    /// Byte range of a plane in its node's page, if it follows from the kind and the number of
    /// points.
    pub fn plane_range(&self, node: u32, kind: PlaneKind) -> Option<Range<u64>> {
        let (tree, record) = (self.tree_of(node), self.record(node));
        let kind = tree.own(kind)?;
        tree.file.layout().plane_range(kind, record.points(), record.hot_shift)
    }

    /// Record of a node.
    ///
    /// # Panics
    /// If there is no such node.
    pub fn record(&self, node: u32) -> &Node {
        &self.table().nodes[node as usize]
    }

    /// Says what [`Forest::read_exact_at`] reads next.
    pub fn will_read(&self, ranges: &[Range<u64>]) {
        let mut ranges = ranges.to_vec();
        ranges.sort_by_key(|range| range.start);
        for of_tree in ranges.chunk_by(|a, b| self.tree_at(a.start) == self.tree_at(b.start)) {
            let tree = &self.trees[self.tree_at(of_tree[0].start)];
            let own = of_tree.iter().map(|r| r.start - tree.first_byte..r.end - tree.first_byte);
            tree.file.will_read(&own.collect::<Vec<_>>());
        }
    }

    /// Says which planes are read next, if that helps.
    pub fn will_read_planes(&self, nodes: impl Iterator<Item = u32>, kinds: &[PlaneKind]) {
        if self.readers().is_none() {
            return;
        }
        let ranges = nodes.flat_map(|node| {
            let (tree, record) = (self.tree_of(node), self.record(node));
            let layout = tree.file.layout();
            let directory = 0..layout.directory_bytes() as u64;
            let planes = kinds.iter().filter_map(move |&kind| self.plane_range(node, kind));
            let at = record.page_offset;
            std::iter::once(directory).chain(planes).map(move |r| at + r.start..at + r.end)
        });
        self.will_read(&ranges.collect::<Vec<_>>());
    }

    /// Requests made for all files and bytes that came, if they are at addresses.
    pub fn traffic(&self) -> Option<[u64; 2]> {
        self.files().filter_map(EskerFile::traffic).reduce(|a, b| [a[0] + b[0], a[1] + b[1]])
    }

    /// Makes reads of the files that are waiting now fail, because those who need them end.
    pub fn interrupt(&self) {
        self.files().for_each(EskerFile::interrupt);
    }

    /// Number of threads that should read at the same time, if the places of the files tell.
    pub fn readers(&self) -> Option<usize> {
        self.files().filter_map(EskerFile::readers).max()
    }

    /// Index of the tree whose file has a byte of [`Forest::table`].
    fn tree_at(&self, offset: u64) -> usize {
        self.trees.partition_point(|t| t.first_byte <= offset) - 1
    }

    /// Reads bytes of one file, unchecked, at an offset of [`Forest::table`].
    ///
    /// # Errors
    /// If the file ends before, or cannot be read.
    pub fn read_exact_at(&self, buf: &mut [u8], offset: u64) -> Result<(), FormatError> {
        let tree = &self.trees[self.tree_at(offset)];
        tree.file.read_exact_at(buf, offset - tree.first_byte)
    }

    /// Reads planes of a node, each checked. Planes that it does not have are left out.
    ///
    /// # Errors
    /// If they cannot be read or are damaged.
    pub fn read_planes(&self, node: u32, kinds: &[PlaneKind]) -> Result<Planes, FormatError> {
        let tree = self.tree_of(node);
        if tree.file.readers().is_some() {
            // All planes by one round trip.
            self.will_read_planes(std::iter::once(node), kinds);
        }
        let both = kinds.iter().filter_map(|&kind| Some((kind, tree.own(kind)?)));
        let (named, own): (Vec<_>, Vec<_>) = both.unzip();
        let planes = tree.file.read_planes(node - tree.first_node, &own)?;
        Ok(planes.renamed(|kind| own.iter().position(|&k| k == kind).map(|i| named[i])))
    }
}

impl Tree {
    /// Coordinates of the file, moved.
    fn placed(&self, own: [u32; 3]) -> [u32; 3] {
        [0, 1, 2].map(|axis| {
            let placed = i64::from(own[axis]).saturating_add(self.moved[axis]);
            placed.clamp(0, i64::from(u32::MAX)) as u32
        })
    }

    /// The file's own kind for a kind of the forest: attributes are numbered differently.
    fn own(&self, kind: PlaneKind) -> Option<PlaneKind> {
        match kind {
            PlaneKind::Attribute(i) => {
                self.attributes.get(usize::from(i)).copied().flatten().map(PlaneKind::Attribute)
            }
            kind => Some(kind),
        }
    }

    fn has(&self, kind: PlaneKind) -> bool {
        self.own(kind).is_some_and(|kind| self.file.layout().has(kind))
    }
}

/// Compares bit by bit: points are then placed equally on both.
fn is_same(a: &Lattice, b: &Lattice) -> bool {
    let bits = |l: &Lattice| ([l.scale, l.offset, l.factor].map(|v| v.map(f64::to_bits)), l.shift);
    bits(a) == bits(b)
}

/// What to do with clouds that are not placed beside each other.
const MERGE: &str = "build one file of their scans, which places all on one lattice";

/// Steps from a lattice, moved by an offset, to another one: what is to be added to coordinates.
///
/// # Errors
/// If they are not whole; the message says what differs, and what to do.
fn steps_between(from: &Lattice, offset: [f64; 3], to: &Lattice) -> Result<[i64; 3], String> {
    let bits = |v: [f64; 3]| v.map(f64::to_bits);
    if bits(from.scale) != bits(to.scale) {
        let (own, other) = (from.scale, to.scale);
        return Err(format!("has steps of {own:?}, the other one of {other:?}; {MERGE}"));
    }
    if bits(from.factor) != bits(to.factor) {
        return Err(format!("has degrees of another length than the other one; {MERGE}"));
    }
    let mut steps = [0; 3];
    for axis in 0..3 {
        let (step, name) = (from.scale[axis], ["x", "y", "z"][axis]);
        let apart = (from.offset[axis] - to.offset[axis] + offset[axis]) / step;
        // Not a number is not whole either.
        if !((apart - apart.round()).abs() <= OFF_STEPS_MAX && apart.abs() < STEPS_APART_MAX) {
            return Err(format!(
                "lies {apart:.3} steps of {step} beside the other one along {name}, which are not \
                 whole steps; change its offset, or {MERGE}"
            ));
        }
        let shift = from.shift[axis].checked_sub(to.shift[axis]);
        let sum = shift.and_then(|shift| shift.checked_add(apart.round() as i64));
        steps[axis] = sum.ok_or_else(|| format!("lies too far from the other one; {MERGE}"))?;
    }
    Ok(steps)
}

/// Steps between two clouds that doubles still tell apart.
const STEPS_APART_MAX: f64 = (1u64 << 40) as f64;
