//! A forest: a file and those that it names, whose trees over one lattice belong together (DESIGN, section 5).
//! To whoever looks at it it is one cloud: one node table with several roots, and one run of bytes, the
//! files one after the other, that page places point into. A file that names no other is a forest of one.
//!
//! The list of a file is complete: what the named files name themselves is in it as well, and is not
//! followed. So there are no cycles, and nothing belongs to a forest twice.

use crate::error::FormatError;
use crate::layout::PlaneKind;
use crate::metadata::TreeRef;
use crate::normals::Normals;
use crate::reader::{EskerFile, Planes};
use esker_points::palette::Palette;
use esker_points::{Lattice, Node, NodeName, NodeTable, Schema};
use std::ops::Range;
use std::path::{Path, PathBuf};

/// Trees of a forest at most: each is an open file.
pub const TREES_MAX: usize = 512;
/// Bytes between two files in the run that they make: more than is ever read at once.
const FILES_APART_BYTES: u64 = 1 << 32;

/// Opened files whose trees belong together. Reading takes `&self`, from any thread.
#[derive(Debug)]
pub struct Forest {
    /// The file itself first, then those that it names, in its order. Never empty.
    trees: Vec<Tree>,
    /// The nodes of all trees, where there are several; else the file's own table serves.
    joined: Option<NodeTable>,
    /// The attributes of all trees.
    schema: Schema,
    /// What it is called instead of its path.
    name: Option<PathBuf>,
}

/// One file of a forest.
#[derive(Debug)]
struct Tree {
    file: EskerFile,
    /// Its root in the forest's table.
    first_node: u32,
    /// Its first byte in the run of all files.
    first_byte: u64,
    /// Its attribute for each of the forest's.
    attributes: Vec<Option<u16>>,
}

impl From<EskerFile> for Forest {
    /// The forest of a file's own tree, whatever other files it names.
    fn from(file: EskerFile) -> Self {
        let schema = file.metadata().schema.clone();
        let attributes = (0..schema.attributes.len()).map(|i| Some(i as u16)).collect();
        let trees = vec![Tree { file, first_node: 0, first_byte: 0, attributes }];
        Self { trees, joined: None, schema, name: None }
    }
}

impl Forest {
    /// Opens a file and all that it names.
    ///
    /// # Errors
    /// Where one cannot be opened, is not the one that was named, or lies on another lattice.
    pub fn open(path: &Path) -> Result<Self, FormatError> {
        let file = EskerFile::open(path)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let named = file.metadata().forest.clone();
        let open = |tree: &TreeRef| open_named(path, &folder.join(&tree.path), tree);
        let others = named.iter().map(open).collect::<Result<Vec<_>, _>>()?;
        Self::of(file, others)
    }

    /// A file and those that belong to it, opened already.
    ///
    /// # Errors
    /// Where they lie on different lattices, or are too many together.
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
        Ok(Self { trees, joined: Some(table), schema, name: None })
    }

    /// The same, called by what it was built from: a file that is temporary means nothing to the user.
    pub fn called(self, name: PathBuf) -> Self {
        Self { name: Some(name), ..self }
    }

    /// The path of the file that names the others, or what it is called instead.
    pub fn path(&self) -> &Path {
        self.name.as_deref().unwrap_or_else(|| self.trees[0].file.path())
    }

    /// The files, the one that names the others first.
    pub fn files(&self) -> impl ExactSizeIterator<Item = &EskerFile> {
        self.trees.iter().map(|tree| &tree.file)
    }

    /// The files by themselves, the one that names the others first.
    pub fn into_files(self) -> impl Iterator<Item = EskerFile> {
        self.trees.into_iter().map(|tree| tree.file)
    }

    /// The nodes of all trees, with places of pages for [`Forest::read_exact_at`].
    pub fn table(&self) -> &NodeTable {
        self.joined.as_ref().unwrap_or_else(|| self.trees[0].file.table())
    }

    /// The lattice of all trees.
    pub fn lattice(&self) -> &Lattice {
        &self.trees[0].file.metadata().lattice
    }

    /// The attributes of all trees; a tree may lack some.
    pub fn schema(&self) -> &Schema {
        &self.schema
    }

    /// Least and greatest lattice coordinates of all points; `None` where there is no point.
    pub fn bounds(&self) -> Option<[[u32; 3]; 2]> {
        let bounds = self.files().filter_map(|file| file.metadata().bounds);
        bounds.reduce(|[low, high], [l, h]| {
            [[0, 1, 2].map(|i| low[i].min(l[i])), [0, 1, 2].map(|i| high[i].max(h[i]))]
        })
    }

    /// Points of all trees.
    pub fn points(&self) -> u64 {
        self.files().fold(0, |sum, file| sum.saturating_add(file.footer().points))
    }

    /// Bytes read since they were opened: of pages and statistics.
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

    /// What a node is called.
    pub fn name_of(&self, node: u32) -> NodeName {
        // Of trees that begin at the same node all but the last are empty.
        let tree = self.trees.partition_point(|tree| tree.first_node <= node) - 1;
        NodeName { tree: tree as u16, index: node - self.trees[tree].first_node }
    }

    /// The file that a node lies in.
    pub fn file_of(&self, node: u32) -> &EskerFile {
        &self.tree_of(node).file
    }

    /// Whether any tree has such planes.
    pub fn has(&self, kind: PlaneKind) -> bool {
        self.trees.iter().any(|tree| tree.has(kind))
    }

    /// The palette of compact planes, where every tree with points has them, and all number the same colours.
    pub fn palette(&self) -> Option<&Palette> {
        let mut trees = self.files().filter(|file| file.footer().nodes > 0);
        let first = trees.next()?.layout().palette()?;
        trees.all(|file| file.layout().palette() == Some(first)).then_some(first)
    }

    /// Whether a point whose normal looks away shows its back, in every tree that has normals.
    pub fn has_oriented_normals(&self) -> bool {
        let mut origins = self.files().map(|f| f.layout().normals());
        self.has(PlaneKind::Normal) && origins.all(|n| n == Normals::None || n.is_oriented())
    }

    /// Whether a node has such a plane.
    pub fn has_plane(&self, node: u32, kind: PlaneKind) -> bool {
        self.tree_of(node).has(kind)
    }

    /// Bytes of one value of a node's plane; 0 where the node has none.
    pub fn value_bytes(&self, node: u32, kind: PlaneKind) -> u64 {
        let tree = self.tree_of(node);
        let layout = tree.file.layout();
        let index = tree.own(kind).and_then(|kind| layout.plane_index(kind));
        index.map_or(0, |i| u64::from(layout.planes()[i].value_bytes))
    }

    /// Where a plane lies in its node's page, where its kind and the count of points tell that.
    pub fn plane_range(&self, node: u32, kind: PlaneKind) -> Option<Range<u64>> {
        let (tree, record) = (self.tree_of(node), self.record(node));
        let kind = tree.own(kind)?;
        tree.file.layout().plane_range(kind, record.points(), record.hot_shift)
    }

    /// A node's record.
    ///
    /// # Panics
    /// If there is no such node.
    pub fn record(&self, node: u32) -> &Node {
        &self.table().nodes[node as usize]
    }

    /// Reads any run of bytes of one file, unchecked, at a place of [`Forest::table`].
    ///
    /// # Errors
    /// Where the file ends before, or cannot be read.
    pub fn read_exact_at(&self, buf: &mut [u8], offset: u64) -> Result<(), FormatError> {
        let tree = &self.trees[self.trees.partition_point(|t| t.first_byte <= offset) - 1];
        tree.file.read_exact_at(buf, offset - tree.first_byte)
    }

    /// Reads these planes of a node, each checked. Planes that it does not have are left out.
    ///
    /// # Errors
    /// Where they cannot be read or are damaged.
    pub fn read_planes(&self, node: u32, kinds: &[PlaneKind]) -> Result<Planes, FormatError> {
        let tree = self.tree_of(node);
        let both = kinds.iter().filter_map(|&kind| Some((kind, tree.own(kind)?)));
        let (named, own): (Vec<_>, Vec<_>) = both.unzip();
        let planes = tree.file.read_planes(node - tree.first_node, &own)?;
        Ok(planes.renamed(|kind| own.iter().position(|&k| k == kind).map(|i| named[i])))
    }
}

impl Tree {
    /// What the file calls a kind of planes: its attributes have their own numbers.
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

/// Bit by bit: what is placed on one is placed on the other.
fn is_same(a: &Lattice, b: &Lattice) -> bool {
    let bits = |l: &Lattice| (l.scale.map(f64::to_bits), l.offset.map(f64::to_bits), l.shift);
    bits(a) == bits(b)
}

/// Opens a file by the name that another has for it.
fn open_named(path: &Path, at: &Path, tree: &TreeRef) -> Result<EskerFile, FormatError> {
    let fault = |fault: String| FormatError::Forest { path: path.into(), tree: at.into(), fault };
    // What is no file may never answer.
    if at.metadata().is_ok_and(|m| !m.is_file()) {
        return Err(fault("is no file".into()));
    }
    let file = EskerFile::open(at).map_err(|error| {
        let error = error.to_string();
        let plain = error.strip_prefix(&format!("{}: ", at.display())).unwrap_or(&error);
        fault(format!(
            "does not open: {plain}; keep the files of a forest where they are to each other"
        ))
    })?;
    let found = file.footer().name_hash();
    if found != tree.footer_hash {
        return Err(fault(format!(
            "is another file than was named (its footer's hash is {found:032x}, not {:032x}); put the right \
             one in its place, or append again",
            tree.footer_hash
        )));
    }
    Ok(file)
}

impl TreeRef {
    /// How a file at `from` names an opened one: by the way from its own folder.
    ///
    /// # Errors
    /// Where there is no such way, or its name is no Unicode.
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
        let way = way(&folder, &absolute(file.path())?).ok_or_else(|| {
            unnamed("lies on another drive; write the forest where its files are")
        })?;
        let parts: Option<Vec<_>> = way.iter().map(|part| part.to_str()).collect();
        let parts = parts.ok_or_else(|| unnamed("has a name that is no Unicode; rename it"))?;
        Ok(Self { path: parts.join("/"), footer_hash: file.footer().name_hash() })
    }
}

/// The way from a folder to a file, both absolute.
fn way(folder: &Path, file: &Path) -> Option<PathBuf> {
    let common = folder.components().zip(file.components()).take_while(|(a, b)| a == b).count();
    let up = folder.components().skip(common).map(|_| std::path::Component::ParentDir);
    (common > 0).then(|| up.chain(file.components().skip(common)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_way_from_a_folder_goes_up_as_far_as_needed() {
        let way = |folder: &str, file: &str| way(Path::new(folder), Path::new(file));
        assert_eq!(way("/a/b", "/a/b/x.esker"), Some("x.esker".into()));
        assert_eq!(way("/a/b", "/a/c/d/x.esker"), Some("../c/d/x.esker".into()));
        assert_eq!(way("/a/b", "/x.esker"), Some("../../x.esker".into()));
        assert_eq!(way("a", "b/x.esker"), None);
    }
}
