//! A forest: a file and the files that it names, whose trees share one lattice and belong together.
//! To its users it is one cloud: one node table with several roots, and one range of bytes, the
//! files one after the other, which page offsets point into. A file that names no other is a forest
//! of one.
//!
//! The list of a file is complete: it includes the files that the named files name themselves, and
//! their own lists are not followed. So there are no cycles, and no file is in a forest twice.

use crate::error::FormatError;
use crate::layout::PlaneKind;
use crate::metadata::TreeRef;
use crate::normals::Normals;
use crate::reader::{EskerFile, Planes};
use esker_points::palette::Palette;
use esker_points::{Lattice, Node, NodeName, NodeTable, Schema};
use std::ops::Range;
use std::path::{Path, PathBuf};

/// Gap between two files in the range of bytes of the forest: more than is ever read at once.
const FILES_APART_BYTES: u64 = 1 << 32;

/// Opened files whose trees belong together. Reading takes `&self`, from any thread.
#[derive(Debug)]
pub struct Forest {
    /// The file itself first, then the files that it names, in its order. Never empty.
    trees: Vec<Tree>,
    /// Nodes of all trees, if there are several; otherwise the file's own table is used.
    joined: Option<NodeTable>,
    /// Attributes of all trees.
    schema: Schema,
    /// Metric lattice of all trees.
    metric: Lattice,
    /// Name to show instead of the path.
    name: Option<PathBuf>,
}

/// One file of a forest.
#[derive(Debug)]
struct Tree {
    file: EskerFile,
    /// Index of its root in the forest's table.
    first_node: u32,
    /// Its first byte in the range of all files.
    first_byte: u64,
    /// Its attribute for each of the forest's.
    attributes: Vec<Option<u16>>,
}

impl From<EskerFile> for Forest {
    /// The forest of a file's own tree, without the files that it names.
    fn from(file: EskerFile) -> Self {
        let schema = file.metadata().schema.clone();
        let attributes = (0..schema.attributes.len()).map(|i| Some(i as u16)).collect();
        let metric = file.metadata().lattice.metric();
        let trees = vec![Tree { file, first_node: 0, first_byte: 0, attributes }];
        Self { trees, joined: None, schema, metric, name: None }
    }
}

impl Forest {
    /// Opens a file and all files that it names.
    ///
    /// # Errors
    /// If a file cannot be opened, is not the named one, or is on another lattice.
    pub fn open(path: &Path) -> Result<Self, FormatError> {
        let file = EskerFile::open(path)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let named = file.metadata().forest.clone();
        let open = |tree: &TreeRef| open_named(path, &folder.join(&tree.path), tree);
        let others = named.iter().map(open).collect::<Result<Vec<_>, _>>()?;
        Self::of(file, others)
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
        let schema = files.iter().fold(Schema::default(), |all, f| all.union(&f.metadata().schema));
        let (mut table, mut trees, mut first_byte) = (NodeTable::default(), Vec::new(), 0u64);
        for file in files {
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
            trees.push(Tree { file, first_node, first_byte, attributes });
            first_byte = end;
        }
        let metric = lattice.metric();
        Ok(Self { trees, joined: Some(table), schema, metric, name: None })
    }

    /// Sets a name to show instead of the path: that of a temporary file means nothing to the user.
    pub fn called(self, name: PathBuf) -> Self {
        Self { name: Some(name), ..self }
    }

    /// Path of the file that names the others, or the name set by [`Forest::called`].
    pub fn path(&self) -> &Path {
        self.name.as_deref().unwrap_or_else(|| self.trees[0].file.path())
    }

    /// The files, the one that names the others first.
    pub fn files(&self) -> impl ExactSizeIterator<Item = &EskerFile> {
        self.trees.iter().map(|tree| &tree.file)
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
        &self.trees[0].file.metadata().lattice
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
        let bounds = self.files().filter_map(|file| file.metadata().bounds);
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

    /// Reads bytes of one file, unchecked, at an offset of [`Forest::table`].
    ///
    /// # Errors
    /// If the file ends before, or cannot be read.
    pub fn read_exact_at(&self, buf: &mut [u8], offset: u64) -> Result<(), FormatError> {
        let tree = &self.trees[self.trees.partition_point(|t| t.first_byte <= offset) - 1];
        tree.file.read_exact_at(buf, offset - tree.first_byte)
    }

    /// Reads planes of a node, each checked. Planes that it does not have are left out.
    ///
    /// # Errors
    /// If they cannot be read or are damaged.
    pub fn read_planes(&self, node: u32, kinds: &[PlaneKind]) -> Result<Planes, FormatError> {
        let tree = self.tree_of(node);
        let both = kinds.iter().filter_map(|&kind| Some((kind, tree.own(kind)?)));
        let (named, own): (Vec<_>, Vec<_>) = both.unzip();
        let planes = tree.file.read_planes(node - tree.first_node, &own)?;
        Ok(planes.renamed(|kind| own.iter().position(|&k| k == kind).map(|i| named[i])))
    }
}

impl Tree {
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

/// Opens a file that another names.
fn open_named(path: &Path, at: &Path, tree: &TreeRef) -> Result<EskerFile, FormatError> {
    let fault = |fault: String| FormatError::Forest { path: path.into(), tree: at.into(), fault };
    // Opening a pipe or a device may block for ever.
    if at.metadata().is_ok_and(|m| !m.is_file()) {
        return Err(fault("is not a file".into()));
    }
    let file = EskerFile::open(at).map_err(|error| {
        let error = error.to_string();
        let plain = error.strip_prefix(&format!("{}: ", at.display())).unwrap_or(&error);
        fault(format!(
            "does not open: {plain}; keep the files of a forest in the same folders relative to each other"
        ))
    })?;
    let hash = file.footer().name_hash();
    if hash != tree.footer_hash {
        return Err(fault(format!(
            "is not the file that was named (its footer's hash is {hash:032x}, not {:032x}); put the right \
             one in its place, or append again",
            tree.footer_hash
        )));
    }
    Ok(file)
}

impl TreeRef {
    /// Reference to an opened file in a file at `from`: the relative path from the folder of that
    /// file.
    ///
    /// # Errors
    /// If there is no such path, or the name is not Unicode.
    pub fn new(from: &Path, file: &EskerFile) -> Result<Self, FormatError> {
        let unnamed = |fault: &str| FormatError::Forest {
            path: from.into(),
            tree: file.path().into(),
            fault: fault.into(),
        };
        let absolute = |path: &Path| {
            let path = if path.as_os_str().is_empty() { Path::new(".") } else { path };
            path.canonicalize().map_err(crate::error::io_error(path, "find it"))
        };
        let folder = absolute(from.parent().unwrap_or(Path::new("")))?;
        let relative = relative_path(&folder, &absolute(file.path())?).ok_or_else(|| {
            unnamed("lies on another drive; write the forest where its files are")
        })?;
        let parts: Option<Vec<_>> = relative.iter().map(|part| part.to_str()).collect();
        let parts = parts.ok_or_else(|| unnamed("has a name that is not Unicode; rename it"))?;
        Ok(Self { path: parts.join("/"), footer_hash: file.footer().name_hash() })
    }
}

/// Relative path from a folder to a file, both absolute.
fn relative_path(folder: &Path, file: &Path) -> Option<PathBuf> {
    let common = folder.components().zip(file.components()).take_while(|(a, b)| a == b).count();
    let up = folder.components().skip(common).map(|_| std::path::Component::ParentDir);
    (common > 0).then(|| up.chain(file.components().skip(common)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_relative_path_goes_up_as_far_as_needed() {
        let relative = |folder: &str, file: &str| relative_path(Path::new(folder), Path::new(file));
        assert_eq!(relative("/a/b", "/a/b/x.esker"), Some("x.esker".into()));
        assert_eq!(relative("/a/b", "/a/c/d/x.esker"), Some("../c/d/x.esker".into()));
        assert_eq!(relative("/a/b", "/x.esker"), Some("../../x.esker".into()));
        assert_eq!(relative("a", "b/x.esker"), None);
    }
}
