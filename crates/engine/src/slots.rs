//! Drawing memory of the CPU renderer: one range of addresses from 0 to the budget in pages that come
//! into being when they are first written, so that the resident set grows with use. The streamer gives
//! out its slots; only the render thread writes and reads.

use esker_stream::Slot;

/// Bytes of a page at most: what every GPU binds at once.
pub const PAGE_BYTES_MAX: u64 = 128 << 20;

/// Memory for slots.
#[derive(Debug)]
pub struct DrawingMemory {
    bytes: u64,
    page_bytes: u64,
    /// As far as they were written to; a page that nothing was written to is empty.
    pages: Vec<Vec<u8>>,
}

impl DrawingMemory {
    /// Room for so many bytes, none of them taken yet.
    pub fn new(bytes: u64) -> Self {
        let page_bytes = bytes.clamp(Slot::ALIGNMENT, PAGE_BYTES_MAX);
        Self { bytes, page_bytes, pages: Vec::new() }
    }

    /// Bytes of a page, which no slot straddles.
    pub fn page_bytes(&self) -> u64 {
        self.page_bytes
    }

    /// Page of a slot and its place there; `None` for a slot that is not within one page.
    fn place(&self, slot: Slot) -> Option<(usize, usize)> {
        let (page, start) = (slot.offset / self.page_bytes, slot.offset % self.page_bytes);
        let fits = start.checked_add(slot.bytes)? <= self.page_bytes
            && slot.offset.checked_add(slot.bytes)? <= self.bytes;
        fits.then_some((page as usize, start as usize))
    }

    /// Copies bytes to `offset` in a slot. What does not fit the slot is not written.
    pub fn write(&mut self, slot: Slot, offset: u64, bytes: &[u8]) {
        let within = offset.checked_add(bytes.len() as u64).is_some_and(|end| end <= slot.bytes);
        debug_assert!(within, "{} bytes at {offset} of {slot:?}", bytes.len());
        let Some((page, start)) = self.place(slot).filter(|_| within) else { return };
        let page_start = page as u64 * self.page_bytes;
        if self.pages.len() <= page {
            self.pages.resize_with(page + 1, Vec::new);
        }
        let page = &mut self.pages[page];
        if page.is_empty() {
            // Zeroed memory of this size comes from the system untouched: it takes room when written.
            *page = vec![0; self.page_bytes.min(self.bytes - page_start) as usize];
        }
        page[start + offset as usize..][..bytes.len()].copy_from_slice(bytes);
    }

    /// The bytes of a slot; none where nothing near it was written.
    pub fn read(&self, slot: Slot) -> &[u8] {
        let Some((page, start)) = self.place(slot) else { return &[] };
        let page = self.pages.get(page);
        page.and_then(|p| p.get(start..start + slot.bytes as usize)).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn slot(offset: u64, bytes: u64) -> Slot {
        Slot { offset, bytes }
    }

    #[test]
    fn what_is_written_in_parts_is_read_whole() {
        let mut memory = DrawingMemory::new(PAGE_BYTES_MAX * 2 + 512);
        assert_eq!((memory.page_bytes(), memory.pages.len()), (PAGE_BYTES_MAX, 0));
        let last = slot(PAGE_BYTES_MAX * 2 + 256, 6);
        assert_eq!(memory.read(last), b"");
        memory.write(last, 3, b"def");
        memory.write(last, 0, b"abc");
        assert_eq!(memory.read(last), b"abcdef");
        assert!(memory.pages[0].is_empty() && memory.pages[1].is_empty(), "only what is used");
        assert_eq!(memory.pages[2].len(), 512, "never more than the budget");
    }

    #[test]
    fn slots_outside_of_the_memory_or_across_pages_have_no_bytes() {
        let mut memory = DrawingMemory::new(PAGE_BYTES_MAX + 256);
        for wrong in [
            slot(PAGE_BYTES_MAX + 256, 1),
            slot(PAGE_BYTES_MAX - 256, 512),
            slot(u64::MAX, 2),
            slot(0, u64::MAX),
        ] {
            memory.write(wrong, 0, b"x");
            assert_eq!(memory.read(wrong), b"", "{wrong:?}");
        }
        assert!(memory.pages.iter().all(Vec::is_empty));
    }
}
