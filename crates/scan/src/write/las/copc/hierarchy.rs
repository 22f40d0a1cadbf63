//! The hierarchy of a COPC file: where the chunk of each voxel lies, in pages that readers load as
//! they descend. Voxels without points above others get entries without points, so that every
//! voxel is reached from the root.
//!
//! Pages are made bottom-up: where a subtree has more entries than a page, the largest subtrees of
//! its children become pages of their own, until the rest fits (kundu1977).

use std::collections::BTreeMap;

/// Greatest number of entries of a page.
const PAGE_ENTRIES_MAX: usize = 4096;
/// Size of an entry, in bytes.
const ENTRY_BYTES: usize = 32;
/// Number of points in an entry that stands for a page.
const LINK: i32 = -1;

/// A voxel of an octree.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct VoxelKey {
    /// Levels below the root, which is level 0; at most [`VoxelKey::LEVEL_MAX`].
    pub level: u32,
    /// Voxels of its level between it and the root's lowest corner, along x, y and z.
    pub place: [u32; 3],
}

impl VoxelKey {
    /// Greatest level: places have 31 bits.
    pub const LEVEL_MAX: u32 = 31;

    /// The voxel that it is an octant of; `None` for the root.
    pub fn parent(self) -> Option<Self> {
        let level = self.level.checked_sub(1)?;
        Some(Self { level, place: self.place.map(|p| p >> 1) })
    }
}

/// The chunk of a voxel.
#[derive(Clone, Copy, Debug, Default)]
pub struct Entry {
    /// Offset in the file, in bytes; 0 without points.
    pub offset: u64,
    /// Size, in bytes; 0 without points.
    pub bytes: i32,
    /// Number of points.
    pub points: i32,
}

/// All pages, the root's first.
pub struct Pages {
    /// Their bytes.
    pub bytes: Vec<u8>,
    /// Size of the root's page, in bytes.
    pub root_bytes: u64,
}

/// Makes the pages, which will lie at the offset `start` of the file.
pub fn pages(mut entries: BTreeMap<VoxelKey, Entry>, start: u64) -> Pages {
    add_ancestors(&mut entries);
    // For each page, the voxel at its top and its own entries, without links.
    let page_tops = page_tops(&entries);
    let mut page_of: BTreeMap<VoxelKey, VoxelKey> = BTreeMap::new();
    let mut members: BTreeMap<VoxelKey, Vec<VoxelKey>> = BTreeMap::new();
    // Parents have lower levels, so they come first.
    for &key in entries.keys() {
        let above = key.parent().and_then(|parent| page_of.get(&parent)).copied();
        let page = match above {
            Some(above) if !page_tops.contains_key(&key) => above,
            _ => key,
        };
        page_of.insert(key, page);
        members.entry(page).or_default().push(key);
        if let Some(above) = above.filter(|above| *above != page) {
            members.entry(above).or_default().push(key);
        }
    }
    let mut places = BTreeMap::new();
    let mut end = start;
    for (&page, keys) in &members {
        places.insert(page, (end, keys.len() * ENTRY_BYTES));
        end += (keys.len() * ENTRY_BYTES) as u64;
    }
    let mut bytes = Vec::with_capacity((end - start) as usize);
    for (page, keys) in &members {
        for key in keys {
            let entry = match places.get(key).filter(|_| key != page) {
                Some(&(offset, size)) => Entry { offset, bytes: size as i32, points: LINK },
                None => entries.get(key).copied().unwrap_or_default(),
            };
            write_entry(*key, entry, &mut bytes);
        }
    }
    let root_bytes = places.first_key_value().map_or(0, |(_, (_, size))| *size as u64);
    Pages { bytes, root_bytes }
}

/// Adds entries without points where a voxel has none above it, and the root.
fn add_ancestors(entries: &mut BTreeMap<VoxelKey, Entry>) {
    let with_points: Vec<VoxelKey> = entries.keys().copied().collect();
    for key in with_points {
        let mut above = key.parent();
        while let Some(parent) = above.filter(|parent| !entries.contains_key(parent)) {
            entries.insert(parent, Entry::default());
            above = parent.parent();
        }
    }
    entries.entry(VoxelKey::default()).or_default();
}

/// The voxels below the root at which a page begins.
fn page_tops(entries: &BTreeMap<VoxelKey, Entry>) -> BTreeMap<VoxelKey, ()> {
    let mut tops = BTreeMap::new();
    // Sizes of the children's subtrees, as far as they are in the page of their parent.
    let mut below: BTreeMap<VoxelKey, Vec<(usize, VoxelKey)>> = BTreeMap::new();
    for &key in entries.keys().rev() {
        let mut children = below.remove(&key).unwrap_or_default();
        children.sort_unstable();
        let mut sum = 1 + children.iter().map(|(size, _)| size).sum::<usize>();
        while sum > PAGE_ENTRIES_MAX
            && let Some((size, child)) = children.pop()
        {
            // The link takes an entry.
            sum -= size - 1;
            tops.insert(child, ());
        }
        if let Some(parent) = key.parent() {
            below.entry(parent).or_default().push((sum, key));
        }
    }
    tops
}

/// Appends an entry.
fn write_entry(key: VoxelKey, entry: Entry, out: &mut Vec<u8>) {
    out.extend_from_slice(&key.level.to_le_bytes());
    for place in key.place {
        out.extend_from_slice(&place.to_le_bytes());
    }
    out.extend_from_slice(&entry.offset.to_le_bytes());
    out.extend_from_slice(&entry.bytes.to_le_bytes());
    out.extend_from_slice(&entry.points.to_le_bytes());
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    type Found = BTreeMap<VoxelKey, (u64, i32, i32)>;

    /// Follows the pages from the root; adds what is found and returns the greatest page.
    fn walk(pages: &Pages, start: u64, at: (u64, usize), found: &mut Found) -> usize {
        let from = (at.0 - start) as usize;
        let mut greatest = at.1 / ENTRY_BYTES;
        for entry in pages.bytes[from..from + at.1].chunks_exact(ENTRY_BYTES) {
            let word = |i: usize| u32::from_le_bytes(entry[4 * i..][..4].try_into().unwrap());
            let key = VoxelKey { level: word(0), place: [word(1), word(2), word(3)] };
            let offset = u64::from_le_bytes(entry[16..24].try_into().unwrap());
            let (bytes, points) = (word(6) as i32, word(7) as i32);
            if points == LINK {
                greatest = greatest.max(walk(pages, start, (offset, bytes as usize), found));
            } else {
                assert!(found.insert(key, (offset, bytes, points)).is_none(), "{key:?} twice");
            }
        }
        greatest
    }

    fn check(keys: impl IntoIterator<Item = VoxelKey>) -> (usize, Pages) {
        let entry = |i: usize| Entry { offset: i as u64 + 7, bytes: i as i32 + 1, points: 3 };
        let entries: BTreeMap<_, _> =
            keys.into_iter().enumerate().map(|(i, key)| (key, entry(i))).collect();
        let pages = pages(entries.clone(), 1000);
        let mut found = Found::new();
        let greatest = walk(&pages, 1000, (1000, pages.root_bytes as usize), &mut found);
        for (key, entry) in &entries {
            assert_eq!(found[key], (entry.offset, entry.bytes, entry.points));
        }
        for (key, entry) in &found {
            assert!(entries.contains_key(key) || *entry == (0, 0, 0), "{key:?}: {entry:?}");
            let parent = key.parent();
            assert!(parent.is_none_or(|parent| found.contains_key(&parent)), "{key:?}");
        }
        (greatest, pages)
    }

    #[test]
    fn no_voxels_give_a_root_without_points() {
        let (_, pages) = check([]);
        assert_eq!((pages.bytes, pages.root_bytes), (vec![0; ENTRY_BYTES], 32));
    }

    #[test]
    fn large_trees_have_pages_of_a_bounded_number_of_entries() {
        let full = (0..7u32).flat_map(|level| {
            let edge = 1 << level;
            (0..edge * edge).map(move |i| VoxelKey { level, place: [i % edge, i / edge, 0] })
        });
        let entries = full.clone().count();
        let (greatest, pages) = check(full);
        assert!(greatest <= PAGE_ENTRIES_MAX, "{greatest}");
        // Links are few.
        assert!(pages.bytes.len() / ENTRY_BYTES < entries + 16);
        let deep = |x: u32| VoxelKey { level: 31, place: [x << 8, x, 1 << 30] };
        assert!(check((0..2000).map(deep)).0 <= PAGE_ENTRIES_MAX);
    }

    proptest! {
        #[test]
        fn every_voxel_is_reached_once(keys in prop::collection::vec((0u32..32, any::<[u32; 3]>()), 0..300)) {
            let key = |(level, place): (u32, [u32; 3])| VoxelKey {
                level,
                place: place.map(|p| (u64::from(p) >> (32 - level)) as u32),
            };
            check(keys.into_iter().map(key));
        }
    }
}
