//! Information as a call: counts, bounds, attributes and sources of an `.esker` file, and the shape
//! of its tree; or the header of a scan that is not built yet. Returns an [`InfoReport`].

use crate::cameras::places;
use crate::io::file::{is_copc, is_esker};
use crate::io::quantity::grouped;
use anyhow::Result;
use esker_format::{CrsRecord, EskerFile, Forest, ForestFilter, PlaneKind, SourceRecord};
use esker_points::{Attribute, ColourDepth, MultisetHash, Node, NodeTable, Task};
use esker_scan::las::{GpsTimes, gps_times};
use esker_scan::{Geographic, OpenOptions, SourceInfo};
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;

/// Most notes that [`notes`] returns; a last line counts the others.
const NOTES_MAX: usize = 6;
/// A node with less than this share of the capacity counts as small.
const SMALL_SHARE: f64 = 1.0 / 16.0;

/// What is known about an `.esker` file or a scan.
#[derive(Clone, Debug, Serialize)]
#[serde(untagged)]
pub enum InfoReport {
    /// An `.esker` file, with the files that it names.
    File(Box<FileInfo>),
    /// A scan.
    Scan(Box<ScanInfo>),
}

/// What is known about an `.esker` file and the files that it names.
#[derive(Clone, Debug, Serialize)]
pub struct FileInfo {
    /// Points of all trees.
    pub points: u64,
    /// World bounds of all points; none without points.
    pub bounds: Option<[[f64; 3]; 2]>,
    /// Step of the lattice, an axis.
    pub scale: [f64; 3],
    /// World coordinates of the lattice's origin.
    pub offset: [f64; 3],
    /// Steps that are added to stored coordinates.
    pub shift: [i64; 3],
    /// Metres per unit of each axis, by which coordinates in degrees are scaled to lengths.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub factor: Option<[f64; 3]>,
    /// Greatest distance by which a coordinate was rounded, in the file's unit.
    pub rounding_error_max: f64,
    /// Attributes of the points.
    pub attributes: Vec<FileAttribute>,
    /// Sets of attributes that the points of a source have.
    pub classes: usize,
    /// Coordinate reference system of the first source that has one.
    pub crs: Option<String>,
    /// Unit of that system.
    pub unit: Option<String>,
    /// Nodes of all trees.
    pub nodes: usize,
    /// Most points of a node.
    pub node_capacity: u32,
    /// Mean share of the capacity that nodes fill.
    pub node_fill_mean: f64,
    /// Share of nodes that fill less than a sixteenth.
    pub small_nodes_share: f64,
    /// Nodes and points by depth.
    pub depths: Vec<DepthInfo>,
    /// Bytes of all files.
    pub bytes: u64,
    /// Bytes a point, by kind of plane.
    pub bytes_a_point: BytesAPoint,
    /// Codecs of the trees, separated by commas.
    pub compress: String,
    /// Sources of the trees' normals, separated by commas.
    pub normals: String,
    /// Bytes of a node in memory.
    pub table_bytes_a_node: usize,
    /// Bytes of the node tables in the files.
    pub table_bytes: u64,
    /// Bytes of the joint node table in memory.
    pub structure_bytes: usize,
    /// Multiset hash of all points, hexadecimal.
    pub multiset_hash: String,
    /// Points far from nearly all others, which the files keep beside their trees.
    pub set_aside: u64,
    /// Program that wrote the first file.
    pub generator: Option<String>,
    /// Scans that the trees were built from.
    pub sources: Vec<SourceReport>,
    /// Trees, the file's own first.
    pub trees: Vec<TreeInfo>,
}

/// Contents of the header of a scan; no point is decoded.
#[derive(Clone, Debug, Serialize)]
pub struct ScanInfo {
    /// Path of the scan.
    pub scan: String,
    /// Format of the scan.
    pub format: String,
    /// Points that the header announces.
    pub points: u64,
    /// Bounds that the header announces.
    pub bounds: Option<[[f64; 3]; 2]>,
    /// Step of stored coordinates, an axis.
    pub scale: [f64; 3],
    /// Offset of stored coordinates.
    pub offset: [f64; 3],
    /// Attributes of the points.
    pub attributes: Vec<AttributeInfo>,
    /// Bits of a colour channel; none without colours.
    pub colour_bits: Option<u32>,
    /// Coordinate reference system.
    pub crs: Option<String>,
    /// Unit of that system.
    pub unit: Option<String>,
    /// Kind of the GPS times.
    pub gps_times: Option<&'static str>,
    /// Bytes of the scan.
    pub bytes: u64,
    /// Octree of a COPC file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub octree: Option<OctreeInfo>,
    /// What is odd about the scan, a line each.
    pub notes: Vec<String>,
}

/// Octree of a COPC file, as far as the first page of its hierarchy tells.
#[derive(Clone, Debug, Serialize)]
pub struct OctreeInfo {
    /// Centre of its cube, in the scan's coordinates.
    pub centre: [f64; 3],
    /// Edge of its cube, in the scan's unit.
    pub edge: f64,
    /// Typical distance of the points of the root, in the scan's unit.
    pub spacing: f64,
    /// Levels.
    pub levels: u32,
    /// Voxels with points.
    pub voxels: u64,
    /// Whether other pages have more voxels.
    pub has_more: bool,
}

/// An attribute.
#[derive(Clone, Debug, Serialize)]
pub struct AttributeInfo {
    /// Name of the attribute.
    pub name: String,
    /// Type of a value.
    #[serde(rename = "type")]
    pub ty: &'static str,
    /// Description in the source; empty if there is none.
    pub description: String,
}

/// An attribute of a file.
#[derive(Clone, Debug, Serialize)]
pub struct FileAttribute {
    /// Name, type and description.
    #[serde(flatten)]
    pub attribute: AttributeInfo,
    /// Factor from stored to displayed values.
    pub scale: f64,
    /// Offset from scaled to displayed values.
    pub offset: f64,
}

/// Nodes of a depth.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct DepthInfo {
    /// The depth; 0 for the roots.
    pub depth: usize,
    /// Nodes there.
    pub nodes: u64,
    /// Points of these nodes.
    pub points: u64,
}

/// Bytes a point.
#[derive(Clone, Debug, Serialize)]
pub struct BytesAPoint {
    /// Hot planes.
    pub hot: f64,
    /// Residual planes.
    pub residual: f64,
    /// All other planes.
    pub cold: f64,
    /// Directories of the pages.
    pub directories: f64,
    /// Whole files.
    pub all: f64,
    /// Each plane.
    pub planes: Vec<PlaneBytes>,
}

/// Bytes a point of a plane.
#[derive(Clone, Debug, Serialize)]
pub struct PlaneBytes {
    /// Name of the plane, or of its attribute.
    pub plane: String,
    /// Whether pictures are drawn from it as it is stored.
    pub hot: bool,
    /// Bytes a point.
    pub bytes: f64,
}

/// A scan that a tree was built from.
#[derive(Clone, Debug, Serialize)]
pub struct SourceReport {
    /// Path of the scan, as given to the build.
    pub path: String,
    /// Format of the scan.
    pub format: String,
    /// Points in the file.
    pub points: u64,
    /// Points that were refused, by reason.
    pub refused: BTreeMap<String, u64>,
    /// Greatest distance by which a coordinate was rounded, in the file's unit.
    pub rounding_error_max: f64,
    /// Bits of a colour channel; none without colours.
    pub colour_bits: Option<u32>,
    /// Whether the user set them.
    pub colour_bits_forced: bool,
    /// Coordinate reference system.
    pub crs: Option<String>,
    /// Unit of that system.
    pub unit: Option<String>,
    /// Kind of the GPS times.
    pub gps_times: Option<&'static str>,
    /// What was odd about the scan, a line each.
    pub notes: Vec<String>,
}

/// A tree of a forest.
#[derive(Clone, Debug, Serialize)]
pub struct TreeInfo {
    /// Path of its file.
    pub path: String,
    /// Points of the tree.
    pub points: u64,
    /// Nodes of the tree.
    pub nodes: u64,
    /// Bytes of its file.
    pub bytes: u64,
    /// Multiset hash of its points, hexadecimal.
    pub multiset_hash: String,
    /// Hash of the footer by which other files name it, hexadecimal.
    pub footer_hash: String,
}

/// Bounds of all points on the metric lattice, as views have them; zeros if there are none.
pub fn bounds(forest: &Forest) -> [[f64; 3]; 2] {
    forest.bounds().map_or([[0.0; 3]; 2], |b| b.map(|corner| forest.metric().world(corner)))
}

/// Bounds of all points of the other clouds than `left_out` on the metric lattice; of all clouds if
/// none is left.
pub fn bounds_without(forest: &Forest, left_out: &[usize]) -> [[f64; 3]; 2] {
    let left = forest.bounds_without(left_out);
    left.map_or_else(|| bounds(forest), |b| b.map(|corner| forest.metric().world(corner)))
}

/// Bounds of the coordinates of all points; `None` if there are none.
pub fn world_bounds(forest: &Forest) -> Option<[[f64; 3]; 2]> {
    forest.bounds().map(|b| b.map(|corner| forest.lattice().world(corner)))
}

/// The box, on the metric lattice, that views of a file are fitted to. A few points that lie far
/// from all others may be outside. It is that of all points if a node cannot be read.
pub fn fitted_bounds(forest: &Forest) -> [[f64; 3]; 2] {
    fitted_bounds_without(forest, &[])
}

/// The box, on the metric lattice, that views of a file without these clouds are fitted to, as
/// [`fitted_bounds`]; that of all clouds if none is left.
pub fn fitted_bounds_without(forest: &Forest, left_out: &[usize]) -> [[f64; 3]; 2] {
    let bounds = bounds_without(forest, left_out);
    let shown = ForestFilter::of(forest, None, None);
    let shown = shown.map(|shown| shown.without_clouds(forest, left_out));
    shown.map_or(bounds, |shown| places::fitted_bounds(forest, bounds, &shown).unwrap_or(bounds))
}

/// Reports on an `.esker` file, or on a scan that is not built yet and is opened with `options`.
///
/// # Errors
/// If the file cannot be read.
pub fn info(path: &Path, options: &OpenOptions, task: &dyn Task) -> Result<InfoReport> {
    if is_esker(path)? {
        return Ok(InfoReport::File(Box::new(file_info(&Forest::open(path)?)?)));
    }
    if is_copc(path)? {
        let file = esker_builder::copc::open(path, options, esker_builder::copc::CACHE_BYTES)?;
        return Ok(InfoReport::Scan(Box::new(copc_info(&file))));
    }
    let source = esker_scan::open(path, options, task)?;
    let mut report = scan_info(source.info());
    if let Some(guess) = source.guess() {
        report
            .notes
            .extend(guess.rows.iter().map(|row| format!("one of the first points: `{row}`")));
        report.notes.push(guess.remedy.clone());
    }
    Ok(InfoReport::Scan(Box::new(report)))
}

fn file_info(forest: &Forest) -> Result<FileInfo> {
    let (table, lattice) = (forest.table(), forest.lattice());
    let footers = || forest.files().map(|file| file.footer());
    let capacity = footers().map(|footer| footer.node_capacity).max().unwrap_or(0);
    let first_crs = sources(forest).find_map(|s| s.crs.as_ref());
    let mut hash = MultisetHash::default();
    footers().for_each(|footer| hash += footer.hash);
    let attribute =
        |a: &Attribute| FileAttribute { attribute: a.into(), scale: a.scale, offset: a.offset };
    Ok(FileInfo {
        points: forest.points(),
        bounds: world_bounds(forest),
        scale: lattice.scale,
        offset: lattice.offset,
        shift: lattice.shift,
        factor: lattice.is_scaled().then_some(lattice.factor),
        rounding_error_max: footers().map(|f| f.rounding_error_max).fold(0.0, f64::max),
        attributes: forest.schema().attributes.iter().map(attribute).collect(),
        classes: forest.files().map(|file| file.metadata().classes.len()).sum(),
        crs: first_crs.and_then(|c| text_of(&c.text)),
        unit: first_crs.and_then(|c| c.unit.clone()),
        nodes: table.nodes.len(),
        node_capacity: capacity,
        node_fill_mean: fill(table, capacity),
        small_nodes_share: small_share(table, capacity),
        depths: depths(table),
        bytes: forest.file_bytes(),
        bytes_a_point: bytes_a_point(forest)?,
        compress: distinct(forest, |file| file.metadata().codec.name()),
        normals: distinct(forest, |file| file.metadata().normals.name()),
        table_bytes_a_node: table.bytes_a_node(),
        table_bytes: footers().map(|footer| footer.table.bytes).sum(),
        structure_bytes: table.bytes(),
        multiset_hash: hash.to_string(),
        set_aside: forest.files().map(|file| file.metadata().set_aside.len() as u64).sum(),
        generator: forest.files().next().map(|file| file.metadata().generator.clone()),
        sources: source_reports(forest)?,
        trees: forest.files().map(tree_info).collect(),
    })
}

fn scan_info(info: &SourceInfo) -> ScanInfo {
    ScanInfo {
        scan: info.path.display().to_string(),
        format: info.format.clone(),
        points: info.points_hint,
        bounds: info.grid.bounds,
        scale: info.grid.grid.scale,
        offset: info.grid.grid.offset,
        attributes: info.schema.attributes.iter().map(AttributeInfo::from).collect(),
        colour_bits: info.colour_depth.map(bits),
        crs: info.crs.as_ref().and_then(|c| text_of(&c.text)),
        unit: info.crs.as_ref().and_then(|c| c.unit.clone()),
        gps_times: gps_times(&info.verbatim).map(GpsTimes::name),
        bytes: info.bytes,
        octree: None,
        notes: info.notes.clone(),
    }
}

/// What is known of a COPC file without reading more than the top of its octree.
fn copc_info(file: &EskerFile) -> ScanInfo {
    let (metadata, table) = (file.metadata(), file.table());
    let lattice = &metadata.lattice;
    let with_points = table.nodes.iter().filter(|n| n.points() > 0 && !n.is_continuation());
    let last = table.nodes.iter().map(|n| n.cell_log2).min().unwrap_or(32);
    let root = table.root();
    let octree = OctreeInfo {
        centre: lattice.offset,
        edge: lattice.scale[0] * 2f64.powi(32),
        spacing: root.map_or(0.0, |root| f64::from(root.spacing) / lattice.factor[0]),
        levels: u32::from(32 - last) + 1,
        voxels: with_points.count() as u64,
        has_more: table.nodes.iter().any(|n| n.points() == 0 && n.child_count == 0),
    };
    let source = &metadata.sources[0];
    ScanInfo {
        scan: source.path.clone(),
        format: format!("COPC, {}", source.format),
        points: file.footer().points,
        bounds: source.grid.bounds,
        scale: source.grid.grid.scale,
        offset: source.grid.grid.offset,
        attributes: metadata.schema.attributes.iter().map(AttributeInfo::from).collect(),
        colour_bits: source.colour_depth.map(bits),
        crs: source.crs.as_ref().and_then(|c| text_of(&c.text)),
        unit: source.crs.as_ref().and_then(|c| c.unit.clone()),
        gps_times: gps_times(&source.verbatim).map(GpsTimes::name),
        bytes: file.footer().file_bytes,
        octree: Some(octree),
        notes: source.notes.clone(),
    }
}

impl From<&Attribute> for AttributeInfo {
    fn from(a: &Attribute) -> Self {
        Self { name: a.name.clone(), ty: a.ty.name(), description: a.description.clone() }
    }
}

/// The text of a system; none if only its unit is known.
fn text_of(crs: &str) -> Option<String> {
    Some(crs.to_owned()).filter(|text| !text.is_empty())
}

/// Coordinate reference system of a file as its first source that names one has it: OGC WKT, or
/// the GeoTIFF keys in readable form.
pub fn crs(forest: &Forest) -> Option<String> {
    sources(forest).filter_map(|s| s.crs.as_ref()).find_map(|c| text_of(&c.text))
}

/// Unit of lengths in a file; none if no source names one, or they mix degrees and heights.
pub fn unit(forest: &Forest) -> Option<String> {
    if forest.lattice().is_scaled() {
        return Some("metre".into());
    }
    let first_crs = sources(forest).find_map(|s| s.crs.as_ref())?;
    first_crs.unit.clone().filter(|_| !is_geographic(first_crs))
}

/// Whether lengths mix degrees and heights: coordinates of a source are degrees, and the file does
/// not scale them.
pub fn mixes_degrees(forest: &Forest) -> bool {
    let mut systems = sources(forest).filter_map(|s| s.crs.as_ref());
    !forest.lattice().is_scaled() && systems.any(is_geographic)
}

fn is_geographic(crs: &CrsRecord) -> bool {
    Geographic::of(&crs.text, crs.unit.as_deref()).is_some()
}

/// Notes on the sources of a file: points that were refused, by reason, then what was odd. Each
/// note occurs once; of many only the first ones are returned.
pub fn notes(forest: &Forest) -> Vec<String> {
    let mut refused = BTreeMap::<&str, u64>::new();
    for (reason, points) in sources(forest).flat_map(|s| &s.refused) {
        *refused.entry(reason).or_default() += points;
    }
    let refused = refused
        .into_iter()
        .map(|(reason, points)| format!("left out: {} points: {reason}", grouped(points)));
    let mut all: Vec<String> = refused.collect();
    for note in sources(forest).flat_map(|s| &s.notes) {
        if !all.contains(note) {
            all.push(note.clone());
        }
    }
    if all.len() > NOTES_MAX {
        let more = all.len() - NOTES_MAX;
        all.truncate(NOTES_MAX);
        all.push(format!("and {more} more, see esker info"));
    }
    all
}

/// Sources of all trees.
pub(crate) fn sources(forest: &Forest) -> impl Iterator<Item = &SourceRecord> {
    forest.files().flat_map(|file| &file.metadata().sources)
}

fn source_reports(forest: &Forest) -> Result<Vec<SourceReport>> {
    let mut all = Vec::new();
    for file in forest.files() {
        for (i, record) in file.metadata().sources.iter().enumerate() {
            all.push(source_report(record, gps_times(&file.verbatim(i)?)));
        }
    }
    Ok(all)
}

fn source_report(s: &SourceRecord, gps_times: Option<GpsTimes>) -> SourceReport {
    SourceReport {
        path: s.path.clone(),
        format: s.format.clone(),
        points: s.points,
        refused: s.refused.clone(),
        rounding_error_max: s.rounding_error_max,
        colour_bits: s.colour_depth.map(bits),
        colour_bits_forced: s.colour_depth_forced,
        crs: s.crs.as_ref().and_then(|c| text_of(&c.text)),
        unit: s.crs.as_ref().and_then(|c| c.unit.clone()),
        gps_times: gps_times.map(GpsTimes::name),
        notes: s.notes.clone(),
    }
}

fn tree_info(file: &EskerFile) -> TreeInfo {
    let footer = file.footer();
    TreeInfo {
        path: file.path().display().to_string(),
        points: footer.points,
        nodes: footer.nodes,
        bytes: footer.file_bytes,
        multiset_hash: footer.hash.to_string(),
        footer_hash: format!("{:032x}", footer.name_hash()),
    }
}

fn bits(depth: ColourDepth) -> u32 {
    match depth {
        ColourDepth::Eight => 8,
        ColourDepth::Sixteen => 16,
    }
}

/// Mean share of the capacity that nodes fill.
fn fill(table: &NodeTable, capacity: u32) -> f64 {
    let points: usize = table.nodes.iter().map(Node::points).sum();
    points as f64 / (table.nodes.len().max(1) as f64 * f64::from(capacity.max(1)))
}

/// Share of nodes that are small.
fn small_share(table: &NodeTable, capacity: u32) -> f64 {
    let small =
        table.nodes.iter().filter(|n| (n.points() as f64) < f64::from(capacity) * SMALL_SHARE);
    small.count() as f64 / table.nodes.len().max(1) as f64
}

/// Nodes and points by depth.
fn depths(table: &NodeTable) -> Vec<DepthInfo> {
    let mut all: Vec<DepthInfo> = Vec::new();
    for (node, depth) in table.nodes.iter().zip(table.depths()) {
        let depth = depth as usize;
        while all.len() <= depth {
            all.push(DepthInfo { depth: all.len(), nodes: 0, points: 0 });
        }
        all[depth].nodes += 1;
        all[depth].points += node.points() as u64;
    }
    all
}

/// Values of the files of a forest, sorted, each once, separated by commas.
fn distinct(forest: &Forest, of: impl Fn(&EskerFile) -> &'static str) -> String {
    let mut values: Vec<_> = forest.files().map(of).collect();
    values.sort_unstable();
    values.dedup();
    values.join(", ")
}

/// Bytes a point of hot planes, residuals and everything else in the pages; and of each plane.
fn bytes_a_point(forest: &Forest) -> Result<BytesAPoint> {
    let (mut hot, mut residual, mut cold, mut directories) = (0u64, 0u64, 0u64, 0u64);
    let mut planes: Vec<((String, bool, bool), u64)> = Vec::new();
    for file in forest.files() {
        let layout = file.layout();
        directories += (layout.directory_bytes() * file.table().nodes.len()) as u64;
        for (plane, bytes) in layout.planes().iter().zip(file.plane_bytes()?) {
            *match plane.kind {
                PlaneKind::Residual => &mut residual,
                _ if plane.hot => &mut hot,
                _ => &mut cold,
            } += bytes;
            let name = match plane.kind {
                PlaneKind::Attribute(a) => layout.schema().attributes[usize::from(a)].name.clone(),
                kind => kind.name(),
            };
            // An attribute can have the name of a plane.
            let is_attribute = matches!(plane.kind, PlaneKind::Attribute(_));
            let key = (name, plane.hot, is_attribute);
            match planes.iter_mut().find(|p| p.0 == key) {
                Some(known) => known.1 += bytes,
                None => planes.push((key, bytes)),
            }
        }
    }
    let points = forest.points().max(1) as f64;
    let planes = planes.into_iter();
    let planes = planes.map(|((plane, hot, _), bytes)| {
        let bytes = bytes as f64 / points;
        PlaneBytes { plane, hot, bytes }
    });
    Ok(BytesAPoint {
        hot: hot as f64 / points,
        residual: residual as f64 / points,
        cold: cold as f64 / points,
        directories: directories as f64 / points,
        all: forest.file_bytes() as f64 / points,
        planes: planes.collect(),
    })
}
