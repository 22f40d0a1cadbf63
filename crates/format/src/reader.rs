//! Reading a file: footer, metadata and table are read and checked on opening; pages, planes and
//! statistics by positioned reads on request, each checked against its checksum.

use crate::codec;
use crate::columns::ColumnPlaces;
use crate::directory::Directory;
use crate::error::{Fault, FormatError, io_error};
use crate::footer::{Footer, HEADER_BYTES, Section, header};
use crate::growing::{Growing, Outline};
use crate::json::BlockPlace;
use crate::layout::{PageLayout, PlaneKind};
use crate::metadata::Metadata;
use crate::page::Page;
use crate::partial::PartialTable;
use crate::sections::{
    check_counts, check_sections, of_columns, read_footer, read_section, read_table,
};
use crate::statistics::Statistics;
use crate::table;
use crate::table_index::TableIndex;
use esker_points::attribute::CLOSED_BLOCK;
use esker_points::place::no_file_at;
use esker_points::read_at::{self, ReadAt, is_remote};
use esker_points::{Lattice, MultisetHash, Node, NodeTable};
use std::fmt;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// Greatest gap between two planes that is read along with them rather than skipped.
pub(crate) const GAP_BYTES_MAX: u64 = 32 << 10;

/// An opened .esker file, or a tree whose pages are made when they are read. Reading takes `&self`,
/// from any thread. Clones share the file.
#[derive(Clone)]
pub struct EskerFile {
    path: PathBuf,
    pub(crate) source: Arc<dyn ReadAt>,
    footer: Footer,
    metadata: Arc<Metadata>,
    layout: Arc<PageLayout>,
    blocks: Arc<Vec<Vec<BlockPlace>>>,
    pub(crate) table: Arc<NodeTable>,
    /// The tree, and the version of its table, if pages are made.
    growing: Option<(Arc<dyn Growing>, u64)>,
    /// The table, and its version, if only a part of it is known.
    pub(crate) partial: Option<(Arc<PartialTable>, u64)>,
    /// What the file says of parts of its table.
    pub(crate) index: Option<Arc<TableIndex>>,
    /// Bytes read since opening.
    read_bytes: Arc<AtomicU64>,
}

/// Bytes of the directory of the statistics of most files.
const DIRECTORY_BYTES: u64 = 4 << 10;

/// Some planes of one node.
#[derive(Clone, Debug, Default)]
pub struct Planes {
    planes: Vec<(PlaneKind, Vec<u8>)>,
}

impl Planes {
    /// Values of a plane, one a point; `None` if the file has no such plane or it was not
    /// requested.
    pub fn get(&self, kind: PlaneKind) -> Option<&[u8]> {
        self.planes.iter().find(|(k, _)| *k == kind).map(|(_, bytes)| bytes.as_slice())
    }

    /// Kinds and values of all planes.
    pub fn iter(&self) -> impl Iterator<Item = (PlaneKind, &[u8])> {
        self.planes.iter().map(|(kind, bytes)| (*kind, bytes.as_slice()))
    }

    /// Mutable values of a plane.
    pub(crate) fn get_mut(&mut self, kind: PlaneKind) -> Option<&mut Vec<u8>> {
        self.planes.iter_mut().find(|(k, _)| *k == kind).map(|(_, bytes)| bytes)
    }

    /// Keeps the planes of some kinds.
    pub(crate) fn retain(&mut self, stays: impl Fn(PlaneKind) -> bool) {
        self.planes.retain(|(kind, _)| stays(*kind));
    }

    /// Bytes of all planes.
    pub fn bytes(&self) -> u64 {
        self.planes.iter().map(|(_, bytes)| bytes.len() as u64).sum()
    }

    /// Gives the planes other kinds; those without a new kind are left out.
    pub(crate) fn renamed(self, name: impl Fn(PlaneKind) -> Option<PlaneKind>) -> Self {
        let planes = self.planes.into_iter();
        Self { planes: planes.filter_map(|(kind, bytes)| Some((name(kind)?, bytes))).collect() }
    }
}

impl fmt::Debug for EskerFile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("EskerFile").field("path", &self.path).finish_non_exhaustive()
    }
}

impl EskerFile {
    /// Opens a file: its own tree alone. [`crate::Forest::open`] also opens the files that it
    /// names.
    ///
    /// # Errors
    /// If it cannot be read, has no valid footer, has another version, or is damaged.
    pub fn open(path: &Path) -> Result<Self, FormatError> {
        if !is_remote(path)
            && let Some(what) = no_file_at(path).map_err(io_error(path, "open it"))?
        {
            return Err(FormatError::Unsupported { path: path.into(), what: what.into() });
        }
        let source = read_at::open(path).map_err(io_error(path, "open it"))?;
        Self::from_shared(path, source, false)
    }

    /// Opens a file as [`EskerFile::open`] does, but reads of the node table of a file at an
    /// address only what views want, if the file allows it ([`EskerFile::is_partial`]): to draw it.
    ///
    /// # Errors
    /// See [`EskerFile::open`].
    pub fn open_in_parts(path: &Path) -> Result<Self, FormatError> {
        if !is_remote(path) {
            return Self::open(path);
        }
        let source = read_at::open(path).map_err(io_error(path, "open it"))?;
        Self::from_shared(path, source, true)
    }

    /// Opens a file behind any positioned reads; `name` is used in messages.
    ///
    /// # Errors
    /// See [`EskerFile::open`].
    pub fn from_source(name: &Path, source: Box<dyn ReadAt>) -> Result<Self, FormatError> {
        Self::from_shared(name, source.into(), false)
    }

    /// Opens a file behind any positioned reads as [`EskerFile::open_in_parts`] does at addresses;
    /// `name` is used in messages.
    ///
    /// # Errors
    /// See [`EskerFile::open`].
    pub fn from_source_in_parts(name: &Path, source: Box<dyn ReadAt>) -> Result<Self, FormatError> {
        Self::from_shared(name, source.into(), true)
    }

    fn from_shared(
        name: &Path,
        source: Arc<dyn ReadAt>,
        in_parts: bool,
    ) -> Result<Self, FormatError> {
        let footer = read_footer(name, source.as_ref())?;
        check_sections(&footer).map_err(|fault| fault.damaged(name))?;
        let mut head = [0; HEADER_BYTES];
        source.read_exact_at(&mut head, 0).map_err(io_error(name, "read its header"))?;
        if head != header(footer.version) {
            return Err(
                Fault::new("header", "it is not that of the footer's version").damaged(name)
            );
        }
        let of =
            |section: Section, most: u64| section.offset..section.offset + section.bytes.min(most);
        source.will_read(&[of(footer.statistics, DIRECTORY_BYTES), of(footer.metadata, u64::MAX)]);
        let json = read_section(name, source.as_ref(), footer.metadata, "metadata")?;
        let decoded = Metadata::decode(&json, footer.verbatim.bytes, footer.version)
            .map_err(|f| f.damaged(name))?;
        drop(json);
        check_counts(&footer, &decoded.metadata).map_err(|fault| fault.damaged(name))?;
        let nodes = footer.nodes as usize;
        let places = ColumnPlaces::read(source.as_ref(), footer.statistics, nodes);
        let places = of_columns(name, places)?;
        places.will_read_parts(source.as_ref());
        let index = of_columns(name, places.parts(source.as_ref()))?;
        let mut file = Self {
            path: name.into(),
            source,
            footer,
            metadata: decoded.metadata.into(),
            layout: decoded.layout.into(),
            blocks: decoded.blocks.into(),
            table: Arc::default(),
            growing: None,
            partial: None,
            index: None,
            read_bytes: Arc::default(),
        };
        match index {
            Some((parts, top)) => file.take_index(TableIndex::new(places, parts, top), in_parts)?,
            None => file.table = file.read_whole(&places)?.into(),
        }
        Ok(file)
    }

    /// Reads and checks the whole node table.
    pub(crate) fn read_whole(&self, places: &ColumnPlaces) -> Result<NodeTable, FormatError> {
        let (footer, source) = (&self.footer, self.source.as_ref());
        let table = read_table(&self.path, source, footer, places)?;
        table::check(&table, &self.layout, footer.table.offset, footer.points)
            .map_err(|fault| fault.damaged(&self.path))?;
        Ok(table)
    }

    /// Takes what the file says of parts of its table, and the top of the table alone or all of it.
    fn take_index(&mut self, index: TableIndex, in_parts: bool) -> Result<(), FormatError> {
        let (nodes, pages_end) = (self.footer.nodes as u32, self.footer.table.offset);
        let top = index.top.table(nodes, &self.layout, pages_end);
        let top = top.map_err(|fault| fault.damaged(&self.path))?;
        let index = Arc::new(index);
        self.index = Some(Arc::clone(&index));
        if in_parts {
            let (source, layout) = (Arc::clone(&self.source), Arc::clone(&self.layout));
            let partial = PartialTable::new(&self.path, source, self.footer, layout, index, top);
            let (version, table) = partial.table(None).unwrap_or_default();
            (self.table, self.partial) = (table, Some((Arc::new(partial), version)));
        } else {
            self.table = self.read_indexed(&index)?;
        }
        Ok(())
    }

    /// A tree whose pages are made when they are read; `name` is used in messages.
    pub fn growing(name: &Path, outline: Outline, tree: Arc<impl Growing + 'static>) -> Self {
        let (version, table) = tree.table(None).unwrap_or_default();
        let Outline { metadata, points, file_bytes } = outline;
        let footer = Footer {
            version: metadata.version(),
            points,
            nodes: table.nodes.len() as u64,
            hash: MultisetHash::default(),
            rounding_error_max: metadata.rounding_error_max(),
            node_capacity: metadata.node_capacity,
            table: Section::default(),
            statistics: Section::default(),
            metadata: Section::default(),
            verbatim: Section::default(),
            file_bytes,
        };
        Self {
            path: name.into(),
            source: tree.clone(),
            footer,
            layout: metadata.layout().into(),
            blocks: Arc::default(),
            metadata: metadata.into(),
            table,
            growing: Some((tree, version)),
            partial: None,
            index: None,
            read_bytes: Arc::default(),
        }
    }

    /// Whether its pages are made when they are read: it is no .esker file, and has no footer with
    /// a proof.
    pub fn is_growing(&self) -> bool {
        self.growing.is_some()
    }

    /// Whether both are the same opened file.
    pub fn is_same(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.metadata, &other.metadata)
    }

    /// The same tree with its newest table; `None` if this is the newest.
    pub fn newer(&self) -> Option<Self> {
        if let Some((partial, version)) = &self.partial {
            let (version, table) = partial.table(Some(*version))?;
            let partial = Some((Arc::clone(partial), version));
            return Some(Self { table, partial, ..self.clone() });
        }
        let (tree, version) = self.growing.as_ref()?;
        let (version, table) = tree.table(Some(*version))?;
        let mut newer = self.clone();
        newer.footer.nodes = table.nodes.len() as u64;
        (newer.table, newer.growing) = (table, Some((tree.clone(), version)));
        Some(newer)
    }

    /// Most bytes of pages that are kept in memory; `None` for .esker files, of which none is.
    pub fn kept_bytes_max(&self) -> Option<u64> {
        self.growing.as_ref().map(|(tree, _)| tree.kept_bytes_max())
    }

    /// Whether the file that its pages are made of is another one than that which was opened;
    /// `None` for .esker files, whose footers tell.
    ///
    /// # Errors
    /// If it cannot be read.
    pub fn is_changed(&self) -> Option<Result<bool, FormatError>> {
        let (tree, _) = self.growing.as_ref()?;
        Some(tree.is_changed().map_err(io_error(&self.path, "read it")))
    }

    /// Lattice of the exact coordinates of its points: that of its metadata, or that of the file
    /// that its pages are made of.
    pub fn exact_lattice(&self) -> Lattice {
        let own = self.growing.as_ref().map(|(tree, _)| tree.own_lattice());
        own.unwrap_or(self.metadata.lattice)
    }

    /// Coordinates on [`EskerFile::exact_lattice`] of all points of a node, in their order, if
    /// these are not those of its page.
    ///
    /// # Errors
    /// If they cannot be read.
    pub fn exact_positions(&self, node: u32) -> Result<Option<Vec<[u32; 3]>>, FormatError> {
        let Some((tree, _)) = &self.growing else { return Ok(None) };
        let own = tree.own_positions(node).map_err(io_error(&self.path, "read it"))?;
        let moved = |p: [i32; 3]| p.map(|c| c.cast_unsigned() ^ 1 << 31);
        Ok(Some(own.into_iter().map(moved).collect()))
    }

    /// Makes what is not known yet of nodes ([`Growing::complete`]), or reads the children that
    /// they lack ([`EskerFile::is_partial`]).
    ///
    /// # Errors
    /// If they cannot be read.
    pub fn complete(&self, nodes: &[u32]) -> Result<(), FormatError> {
        if let Some((partial, _)) = &self.partial {
            return partial.complete(nodes);
        }
        let Some((tree, _)) = &self.growing else { return Ok(()) };
        tree.complete(nodes).map_err(io_error(&self.path, "read it"))
    }

    /// Path by which it was opened.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Counts, sections, checksums.
    pub fn footer(&self) -> &Footer {
        &self.footer
    }

    /// The file's description of itself.
    pub fn metadata(&self) -> &Metadata {
        &self.metadata
    }

    /// The node table.
    pub fn table(&self) -> &NodeTable {
        &self.table
    }

    /// Planes of its pages.
    pub fn layout(&self) -> &PageLayout {
        &self.layout
    }

    /// Reads bytes, unchecked: for loaders that fetch several planes or pages at once.
    ///
    /// # Errors
    /// If the file ends before, or cannot be read.
    pub fn read_exact_at(&self, buf: &mut [u8], offset: u64) -> Result<(), FormatError> {
        self.read_bytes.fetch_add(buf.len() as u64, Relaxed);
        self.source.read_exact_at(buf, offset).map_err(io_error(&self.path, "read it"))
    }

    /// Says what [`EskerFile::read_exact_at`] reads next.
    pub fn will_read(&self, ranges: &[Range<u64>]) {
        self.source.will_read(ranges);
    }

    /// Requests made for the file and bytes that came, if it is at an address.
    pub fn traffic(&self) -> Option<[u64; 2]> {
        self.source.traffic()
    }

    /// Makes reads that are waiting now fail, because those who need them end.
    pub fn interrupt(&self) {
        self.source.interrupt();
    }

    /// Number of threads that should read at the same time, if the place of the file tells.
    pub fn readers(&self) -> Option<usize> {
        self.source.readers()
    }

    /// Bytes of pages and statistics read since opening.
    pub fn read_bytes(&self) -> u64 {
        self.read_bytes.load(Relaxed)
    }

    /// Reads the statistics, in the order of the whole table.
    ///
    /// # Errors
    /// If they cannot be read or are damaged.
    pub fn statistics(&self) -> Result<Statistics, FormatError> {
        if let Some((tree, _)) = &self.growing {
            return Ok(tree.statistics(&self.table));
        }
        let bytes = self.statistics_bytes()?;
        Statistics::decode(&bytes, self.layout.schema(), self.footer.nodes as usize)
            .map_err(|fault| fault.damaged(&self.path))
    }

    /// Bytes of the section of statistics, whose checksum was compared.
    pub(crate) fn statistics_bytes(&self) -> Result<Vec<u8>, FormatError> {
        read_section(&self.path, self.source.as_ref(), self.footer.statistics, "statistics")
    }

    /// Reads the verbatim blocks of a source, given by its index: name and bytes.
    ///
    /// # Errors
    /// If they cannot be read. `verify` checks their checksum, which is one for all sources.
    pub fn verbatim(&self, source: usize) -> Result<Vec<(String, Vec<u8>)>, FormatError> {
        if self.is_growing() {
            return Ok(self
                .metadata
                .sources
                .get(source)
                .map_or_else(Vec::new, |s| s.verbatim.clone()));
        }
        let blocks = self.blocks.get(source).map_or(&[][..], Vec::as_slice);
        let read = |block: &BlockPlace| {
            let mut bytes = vec![0; block.bytes as usize];
            self.read_exact_at(&mut bytes, self.footer.verbatim.offset + block.offset)?;
            Ok((block.name.clone(), bytes))
        };
        blocks.iter().map(read).collect()
    }

    /// Whether all sources state that their points cover closed surfaces ([`CLOSED_BLOCK`]).
    pub fn is_closed(&self) -> bool {
        let states = |source: &Vec<BlockPlace>| source.iter().any(|b| b.name == CLOSED_BLOCK);
        !self.blocks.is_empty() && self.blocks.iter().all(states)
    }

    /// Checks the verbatim blocks of all sources, which [`EskerFile::verbatim`] does not.
    ///
    /// # Errors
    /// If they cannot be read or are damaged.
    pub fn check_verbatim(&self) -> Result<(), FormatError> {
        if self.is_growing() {
            return Ok(());
        }
        self.check_section(self.footer.verbatim, "verbatim section")
    }

    /// Record of a node.
    ///
    /// # Errors
    /// If there is no such node.
    pub fn node(&self, node: u32) -> Result<&Node, FormatError> {
        self.table.nodes.get(node as usize).ok_or_else(|| {
            Fault::new("node table", format!("there is no node {node}")).damaged(&self.path)
        })
    }

    /// Error for a fault in the page of a node.
    pub fn damaged_page(&self, node: u32, fault: Fault) -> FormatError {
        self.in_node(node)(fault)
    }

    fn in_node(&self, node: u32) -> impl Fn(Fault) -> FormatError + '_ {
        let node = self.table.index_in_file(node);
        move |fault| {
            let section = format!("page of node {node}, {}", fault.section);
            Fault { section, ..fault }.damaged(&self.path)
        }
    }

    /// Reads a node's whole page; every plane is checked.
    ///
    /// # Errors
    /// If it cannot be read or is damaged.
    pub fn read_page(&self, node: u32) -> Result<Page<'_>, FormatError> {
        let record = self.node(node)?;
        let mut bytes = vec![0; record.page_bytes as usize];
        self.read_exact_at(&mut bytes, record.page_offset)?;
        self.page_of(node, bytes)
    }

    /// The page of a node from its bytes, which may be newly encoded; every plane is checked.
    ///
    /// # Errors
    /// If the bytes are damaged.
    pub fn page_of(&self, node: u32, bytes: Vec<u8>) -> Result<Page<'_>, FormatError> {
        let record = self.node(node)?;
        let page_bytes = u32::try_from(bytes.len()).unwrap_or(u32::MAX);
        let directory =
            self.directory_of(record, &bytes, page_bytes).map_err(self.in_node(node))?;
        for (plane, entry) in self.layout.planes().iter().zip(&directory.entries) {
            if crc32fast::hash(&bytes[entry.range()]) != entry.crc {
                let fault = Fault::new(format!("{:?}", plane.kind), "its checksum does not match");
                return Err(self.in_node(node)(fault));
            }
        }
        Ok(self.page(record, directory, bytes))
    }

    /// The page of a node from its parts.
    pub(crate) fn page(&self, record: &Node, directory: Directory, bytes: Vec<u8>) -> Page<'_> {
        Page {
            layout: &self.layout,
            directory,
            points: record.points(),
            box_min: record.box_min,
            hot_shift: record.hot_shift,
            bytes,
        }
    }

    /// Bytes of each plane of the layout in all pages; reads every page's directory.
    ///
    /// # Errors
    /// If one cannot be read or is damaged.
    pub fn plane_bytes(&self) -> Result<Vec<u64>, FormatError> {
        let mut sums = vec![0; self.layout.planes().len()];
        let mut head = vec![0; self.layout.directory_bytes()];
        for (node, record) in (0..).zip(&self.table.nodes) {
            self.read_exact_at(&mut head, record.page_offset)?;
            let directory =
                self.directory_of(record, &head, record.page_bytes).map_err(self.in_node(node))?;
            for (sum, entry) in sums.iter_mut().zip(&directory.entries) {
                *sum += u64::from(entry.bytes);
            }
        }
        Ok(sums)
    }

    /// The directory at the beginning of the page of a node.
    pub(crate) fn directory_of(
        &self,
        record: &Node,
        bytes: &[u8],
        page_bytes: u32,
    ) -> Result<Directory, Fault> {
        let points = record.points();
        Directory::decode(&self.layout, bytes, points, record.hot_shift, page_bytes)
    }

    /// Reads planes of a node, with as few reads as possible, each checked. Planes that the file
    /// does not have are left out.
    ///
    /// # Errors
    /// If they cannot be read or are damaged.
    pub fn read_planes(&self, node: u32, kinds: &[PlaneKind]) -> Result<Planes, FormatError> {
        let record = self.node(node)?;
        let points = record.points();
        // Adjacent ranges are read at once.
        let hot =
            kinds.iter().filter_map(|&k| self.layout.plane_range(k, points, record.hot_shift));
        let mut places: Vec<_> =
            hot.chain(std::iter::once(0..self.layout.directory_bytes() as u64)).collect();
        places.sort_by_key(|place| place.start);
        let mut pieces: Vec<(u64, Vec<u8>)> = Vec::with_capacity(places.len());
        for place in places.chunk_by(|a, b| b.start <= a.end + GAP_BYTES_MAX) {
            let start = place[0].start;
            let end = place.iter().map(|place| place.end).fold(start, u64::max);
            let mut piece = vec![0; (end - start) as usize];
            self.read_exact_at(&mut piece, record.page_offset + start)?;
            pieces.push((start, piece));
        }
        let directory = self
            .directory_of(record, &pieces[0].1, record.page_bytes)
            .map_err(self.in_node(node))?;
        let read_already = |range: Range<usize>| {
            pieces.iter().find_map(|(start, piece)| {
                let first = range.start.checked_sub(*start as usize)?;
                piece.get(first..first + range.len()).map(<[u8]>::to_vec)
            })
        };
        let mut planes = Planes::default();
        for &kind in kinds {
            let Some(index) = self.layout.plane_index(kind) else { continue };
            let entry = directory.entries[index];
            let stored = match read_already(entry.range()) {
                Some(stored) => stored,
                None => {
                    let mut stored = vec![0; entry.bytes as usize];
                    let offset = record.page_offset + u64::from(entry.offset);
                    self.read_exact_at(&mut stored, offset)?;
                    stored
                }
            };
            if crc32fast::hash(&stored) != entry.crc {
                let fault = Fault::new(format!("{kind:?}"), "its checksum does not match");
                return Err(self.in_node(node)(fault));
            }
            let value_bytes = self.layout.planes()[index].value_bytes as usize;
            let values = codec::decode(entry.encoding, &stored, value_bytes, points)
                .map_err(|fault| self.in_node(node)(fault.of_plane(&kind.name())))?;
            planes.planes.push((kind, values));
        }
        Ok(planes)
    }

    /// Reads a section in pieces and compares its checksum.
    pub(crate) fn check_section(
        &self,
        section: Section,
        name: &'static str,
    ) -> Result<(), FormatError> {
        let mut hasher = crc32fast::Hasher::new();
        let mut at = section.offset;
        let end = section.offset + section.bytes;
        let mut buffer = vec![0; section.bytes.min(1 << 20) as usize];
        while at < end {
            let length = (end - at).min(buffer.len() as u64) as usize;
            self.read_exact_at(&mut buffer[..length], at)?;
            hasher.update(&buffer[..length]);
            at += length as u64;
        }
        if hasher.finalize() == section.crc {
            return Ok(());
        }
        Err(Fault::new(name, "its checksum does not match").damaged(&self.path))
    }
}
