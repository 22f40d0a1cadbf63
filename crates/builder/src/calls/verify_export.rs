//! Verifies a LAS, LAZ or COPC file against the `.esker` file that it was exported from: the points
//! of both are encoded to records of one layout, which must be the same multiset. So what an export
//! converts (point formats, scan angles, colours) is compared as it is written.

use crate::calls::selection::Selection;
use crate::error::BuildError;
use crate::input::intake::open;
use esker_format::Forest;
use esker_points::{Batch, Filter, Lattice, MultisetHash, Task};
use esker_scan::write::las::{RecordEncoder, record_encoder, variant_of};
use esker_scan::write::{Encoded, Origin, Outline};
use esker_scan::{ScanError, Source};
use std::path::{Path, PathBuf};

/// A scan whose points are those of an `.esker` file.
#[derive(Clone, Debug, PartialEq)]
pub struct ExportVerified {
    /// Points of the scan.
    pub points: u64,
    /// Multiset hash of its records.
    pub hash: MultisetHash,
    /// Points beside the trees of the file, which LAS does not hold.
    pub set_aside: u64,
}

/// Number and multiset hash of records.
#[derive(Default, PartialEq)]
struct Sum {
    points: u64,
    hash: MultisetHash,
}

impl Sum {
    fn add(&mut self, points: &Encoded, record_bytes: usize) {
        self.points += points.points;
        for record in points.bytes.chunks_exact(record_bytes) {
            self.hash.add(0, record);
        }
    }
}

/// Compares the points of the scan at `path` with all points of the trees of `forest`.
///
/// # Errors
/// [`BuildError::Differs`] if they are not the same; if the scan is not LAS, LAZ or COPC, or one of
/// the files cannot be read; on request.
pub fn verify_export(
    path: &Path,
    forest: &Forest,
    task: &dyn Task,
) -> Result<ExportVerified, BuildError> {
    let differs = |what: String| BuildError::Differs(format!("{}: {what}", path.display()));
    let sources = open(&[PathBuf::from(path)], None, task)?;
    let source = sources.first().ok_or_else(|| differs("holds no scan".into()))?;
    let origin = Origin::from(source.info());
    let variant = variant_of(&origin).ok_or_else(|| {
        let what = "only LAS, LAZ and COPC are compared with an .esker file: build the scan, and verify that";
        BuildError::Options(format!("{}: {what}", path.display()))
    })?;
    let filter = Filter::default();
    let selection = Selection::new(forest, path, &filter, None, task)?;
    let outline = selection.outline()?;
    let wanted = record_encoder(path, &outline, &mut selection.origins(), variant)?;
    let own_outline = outline_of(source.as_ref())?;
    let mut own_origins = std::iter::once(Ok(origin.clone()));
    let own = record_encoder(path, &own_outline, &mut own_origins, variant)?;
    if let Some(what) = difference(&own, &wanted) {
        return Err(differs(what));
    }
    let total = source.info().points_hint.saturating_add(forest.points());
    task.phase("comparing", Some(total), "points");
    let of_scan = sum_of_scan(source.as_ref(), &own_outline.lattice, &own, task)?;
    let of_trees = sum_of_trees(&selection, &wanted, task)?;
    let shown = forest.path().display();
    if of_scan.points != of_trees.points {
        let [own, of_file] = [of_scan.points, of_trees.points];
        return Err(differs(format!("holds {own} points, {shown} holds {of_file}")));
    }
    if of_scan.hash != of_trees.hash {
        return Err(differs(format!("its points are not those of {shown}")));
    }
    let set_aside = forest.files().map(|file| file.metadata().set_aside.len() as u64).sum();
    Ok(ExportVerified { points: of_scan.points, hash: of_scan.hash, set_aside })
}

/// What is known of a scan as if it were to be exported again.
fn outline_of(source: &dyn Source) -> Result<Outline, BuildError> {
    let info = source.info();
    let lattice = Lattice::choose(std::slice::from_ref(&info.grid));
    Ok(Outline {
        lattice: lattice.map_err(BuildError::from)?,
        schema: info.schema.clone(),
        points_max: info.points_hint,
        ranges: Vec::new(),
        classes: Vec::new(),
    })
}

/// What differs between the records of a scan and those that an export has, if anything does.
fn difference(own: &RecordEncoder, wanted: &RecordEncoder) -> Option<String> {
    let [a, b] = [own, wanted].map(|r| (r.point_format, r.record_bytes));
    if a != b {
        return Some(format!(
            "its records have point format {} and {} bytes, those of an export {} and {}",
            a.0, a.1, b.0, b.1
        ));
    }
    let bits = |r: &RecordEncoder| [r.grid.scale, r.grid.offset].map(|v| v.map(f64::to_bits));
    if bits(own) != bits(wanted) {
        return Some("its coordinates have another scale or offset than an export".into());
    }
    let is_same = own.extra_bytes == wanted.extra_bytes;
    (!is_same).then(|| "its extra bytes are described otherwise than in an export".into())
}

fn sum_of_scan(
    source: &dyn Source,
    lattice: &Lattice,
    encoder: &RecordEncoder,
    task: &dyn Task,
) -> Result<Sum, BuildError> {
    let mut sum = Sum::default();
    let placement = lattice.placement(&source.info().grid);
    let mut sink = |batch: Batch| -> Result<(), ScanError> {
        sum.add(&encoder.encode.encode(&batch), encoder.record_bytes);
        task.advance(batch.len() as u64);
        Ok(task.check()?)
    };
    source.read(&placement, task, &mut sink).map_err(BuildError::from_sink)?;
    Ok(sum)
}

fn sum_of_trees(
    selection: &Selection<'_>,
    encoder: &RecordEncoder,
    task: &dyn Task,
) -> Result<Sum, BuildError> {
    let mut sum = Sum::default();
    for (tree, (_, nodes)) in selection.trees.iter().enumerate() {
        let exported = selection.tree(tree, &encoder.encode);
        for node in nodes {
            let encoded = exported.encode_node(node, task)?;
            sum.add(&encoded.encoded, encoder.record_bytes);
            task.advance(encoded.read);
        }
    }
    Ok(sum)
}
