//! The proof that no point was lost: number and multiset hash of the points in the tree are those
//! of the points that were read.

use crate::error::BuildError;
use crate::options::Merged;
use crate::tree::subtree::Subtree;
use esker_points::{MultisetHash, NodeTable};

/// Hash of all points of a tree.
pub fn hash_of(root: &Subtree) -> MultisetHash {
    let mut sum = MultisetHash::default();
    let mut open = vec![root];
    while let Some(tree) = open.pop() {
        sum += tree.hash;
        open.extend(tree.children.iter());
    }
    sum
}

/// Smallest and largest lattice coordinates of all points.
pub fn bounds_of(root: &Subtree) -> Option<[[u32; 3]; 2]> {
    let mut bounds: Option<[[u32; 3]; 2]> = None;
    let mut open = vec![root];
    while let Some(tree) = open.pop() {
        let [low, high] = tree.bounds;
        let [least, greatest] = bounds.unwrap_or(tree.bounds);
        bounds = Some([
            [0, 1, 2].map(|i| low[i].min(least[i])),
            [0, 1, 2].map(|i| high[i].max(greatest[i])),
        ]);
        open.extend(tree.children.iter());
    }
    bounds
}

/// Compares number and hash of the points written with those of the points read.
///
/// # Errors
/// [`BuildError::Proof`] if they differ.
pub fn prove(
    table: &NodeTable,
    points: u64,
    written: MultisetHash,
    read: MultisetHash,
) -> Result<(), BuildError> {
    let out: u64 = table.nodes.iter().map(|n| n.points() as u64).sum();
    if out != points {
        return Err(BuildError::Proof(format!("{points} points read, {out} written")));
    }
    if written != read {
        return Err(BuildError::Proof(format!("hash {read} read, {written} written")));
    }
    Ok(())
}

/// Compares number and hash of merged points with those in the footers of their files.
///
/// # Errors
/// [`BuildError::Differs`] if they differ.
pub fn prove_merged(merged: &Merged, points: u64, hash: MultisetHash) -> Result<(), BuildError> {
    if (merged.points, merged.hash) == (points, hash) {
        return Ok(());
    }
    Err(BuildError::Differs(format!(
        "the files hold {points} points of hash {hash}, their footers state {} of hash {}: esker verify says which file is damaged",
        merged.points, merged.hash
    )))
}
