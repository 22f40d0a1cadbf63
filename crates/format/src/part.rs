//! Part of a node: exact positions, classes of points, and the values of some attributes. Only the
//! planes that these need are read and checked, so that a column of a large file costs its own
//! bytes.

use crate::error::{Fault, FormatError};
use crate::layout::{AttributePlane, PageLayout, PlaneKind};
use crate::page::Page;
use crate::points::PagePoints;
use crate::reader::{EskerFile, GAP_BYTES_MAX};
use std::ops::Range;

/// Attributes of a file whose values are read, and the planes that hold them.
#[derive(Clone, Debug, PartialEq)]
pub struct Wanted {
    /// Whether each attribute of the schema is read.
    attributes: Vec<bool>,
    /// Planes to read.
    kinds: Vec<PlaneKind>,
}

impl Wanted {
    /// The attributes at these indices of the schema of `layout`; others are passed over.
    pub fn of(layout: &PageLayout, indices: impl IntoIterator<Item = usize>) -> Self {
        let mut attributes = vec![false; layout.schema().attributes.len()];
        for index in indices {
            if let Some(wanted) = attributes.get_mut(index) {
                *wanted = true;
            }
        }
        let wanted = attributes.iter().enumerate().filter(|(_, wanted)| **wanted);
        let mut kinds = vec![PlaneKind::Position, PlaneKind::Residual, PlaneKind::Class];
        for (index, _) in wanted {
            match layout.plane_of(index) {
                AttributePlane::Own => kinds.push(PlaneKind::Attribute(index as u16)),
                AttributePlane::Intensity => kinds.push(PlaneKind::Intensity),
                AttributePlane::Colour => {
                    kinds.extend([PlaneKind::Colour, PlaneKind::ColourRemainder]);
                }
            }
        }
        kinds.sort_unstable();
        kinds.dedup();
        kinds.retain(|&kind| layout.has(kind));
        Self { attributes, kinds }
    }

    /// Bytes of the values of a point.
    pub fn record_bytes(&self, layout: &PageLayout) -> usize {
        let all = layout.schema().attributes.iter().zip(&self.attributes);
        all.filter(|(_, wanted)| **wanted).map(|(a, _)| a.ty.size()).sum()
    }
}

impl EskerFile {
    /// Reads the points `range` of a node: positions, classes, and the columns of the `wanted`
    /// attributes. Other columns, radii and normals stay empty.
    ///
    /// # Errors
    /// If the planes cannot be read or are damaged.
    pub fn read_part(
        &self,
        node: u32,
        range: Range<usize>,
        wanted: &Wanted,
    ) -> Result<PagePoints, FormatError> {
        let page = self.read_page_of(node, &wanted.kinds)?;
        page.part_in(range, &wanted.attributes).map_err(|fault| self.damaged_page(node, fault))
    }

    /// Says which bytes [`EskerFile::read_part`] reads of these nodes next: their pages, if most of
    /// these are wanted; otherwise a file at an address is read plane by plane.
    pub fn will_read_parts(&self, nodes: impl Iterator<Item = u32>, wanted: &Wanted) {
        if self.readers().is_none() || wanted.kinds.len() * 2 < self.layout().planes().len() {
            return;
        }
        let page = |node: u32| {
            let record = self.table().nodes.get(node as usize)?;
            Some(record.page_offset..record.page_offset + u64::from(record.page_bytes))
        };
        self.will_read(&nodes.filter_map(page).collect::<Vec<_>>());
    }

    /// Reads planes of a page and its directory; each of these planes is checked. The bytes of
    /// others are zero.
    fn read_page_of(&self, node: u32, kinds: &[PlaneKind]) -> Result<Page<'_>, FormatError> {
        let record = self.node(node)?;
        let in_page = |fault| self.damaged_page(node, fault);
        let mut bytes = vec![0; record.page_bytes as usize];
        let head = bytes.get_mut(..self.layout().directory_bytes());
        let head = head.ok_or_else(|| in_page(Fault::new("directory", "it ends too early")))?;
        self.read_exact_at(head, record.page_offset)?;
        let directory = self.directory_of(record, &bytes, record.page_bytes).map_err(in_page)?;
        let index = |&kind: &PlaneKind| self.layout().plane_index(kind).map(|index| (kind, index));
        let planes: Vec<_> = kinds.iter().filter_map(index).collect();
        let mut ranges: Vec<_> =
            planes.iter().map(|&(_, index)| directory.entries[index].range()).collect();
        ranges.sort_by_key(|range| range.start);
        for near in ranges.chunk_by(|a, b| b.start <= a.end + GAP_BYTES_MAX as usize) {
            let start = near[0].start;
            let end = near.iter().map(|range| range.end).fold(start, usize::max);
            self.read_exact_at(&mut bytes[start..end], record.page_offset + start as u64)?;
        }
        for (kind, index) in planes {
            let entry = directory.entries[index];
            if crc32fast::hash(&bytes[entry.range()]) != entry.crc {
                return Err(in_page(Fault::new(
                    format!("{kind:?}"),
                    "its checksum does not match",
                )));
            }
        }
        Ok(self.page(record, directory, bytes))
    }
}
