//! Pages of finished nodes in the order of the file, which are taken out of the nodes and give them
//! their places.

use crate::tree::subtree::Subtree;

/// Pages of nodes, in the order of the file.
#[derive(Default)]
pub struct Pages {
    pages: Vec<Vec<u8>>,
    /// Offset of the first page.
    offset: u64,
    bytes: u64,
    /// CRC-32 of all pages, if chunks are recorded.
    crc: Option<crc32fast::Hasher>,
}

impl Pages {
    /// No pages yet; the first one gets its place at `offset`.
    pub fn new(offset: u64, with_crc: bool) -> Self {
        Self { offset, crc: with_crc.then(crc32fast::Hasher::new), ..Self::default() }
    }

    /// Takes the pages of siblings, then of the nodes below each, unless they have been taken, and
    /// gives the nodes their places.
    pub fn take(&mut self, siblings: &mut [Subtree]) {
        let mut open = vec![siblings];
        while let Some(group) = open.pop() {
            for tree in group.iter_mut().filter(|t| !t.page.is_empty()) {
                let page = std::mem::take(&mut tree.page);
                tree.node.page_bytes = page.len() as u32;
                tree.node.page_offset = self.offset + self.bytes;
                self.bytes += page.len() as u64;
                self.crc.iter_mut().for_each(|crc| crc.update(&page));
                self.pages.push(page);
            }
            let below = group.iter_mut().map(|t| t.children.as_mut_slice());
            open.extend(below.filter(|b| b.iter().any(|c| !c.page.is_empty())).rev());
        }
    }

    /// Bytes of all pages.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// The pages, and their CRC-32 if it is wanted.
    pub fn into_parts(self) -> (Vec<Vec<u8>>, Option<crc32fast::Hasher>) {
        (self.pages, self.crc)
    }
}
