//! Drawing memory of the CPU renderer: a range of addresses from 0 to the budget, in pages that are
//! allocated when they are first written to, so that resident memory grows with use. The streamer
//! assigns slots; only the render thread writes and reads. The budget may change; pages beyond a
//! lower one are freed once no slot lies there.
//!
//! Huge pages are requested from the system, if it has them: a page is filled with zeros at its
//! first use, which takes one huge page a fraction of the time of 512 small ones.

use anyhow::{Context, Result};
use esker_stream::Slot;
use memmap2::MmapMut;

/// Most bytes of a page: what every GPU can bind at once.
pub const PAGE_BYTES_MAX: u64 = 128 << 20;

/// Memory for slots.
#[derive(Debug)]
pub struct DrawingMemory {
    /// The budget.
    bytes: u64,
    /// The greatest budget so far, up to which late bytes may still land.
    bytes_max: u64,
    page_bytes: u64,
    /// Pages up to the last that was written to; `None` for unused ones.
    pages: Vec<Option<MmapMut>>,
}

impl DrawingMemory {
    /// Memory of `bytes` bytes, none of which are allocated yet.
    pub fn new(bytes: u64) -> Self {
        let page_bytes = bytes.clamp(Slot::ALIGNMENT, PAGE_BYTES_MAX);
        Self { bytes, bytes_max: bytes, page_bytes, pages: Vec::new() }
    }

    /// Changes the budget.
    pub fn resize(&mut self, bytes: u64) {
        self.bytes = bytes;
        self.bytes_max = self.bytes_max.max(bytes);
    }

    /// Frees memory from this byte on, where no slot is in use.
    pub fn free_beyond(&mut self, bytes: u64) {
        let whole = usize::try_from(bytes.div_ceil(self.page_bytes)).unwrap_or(usize::MAX);
        self.pages.truncate(whole);
        let last = bytes / self.page_bytes;
        let length = (bytes - last * self.page_bytes) as usize;
        if let Some(Some(page)) = self.pages.get_mut(last as usize)
            && page.len() > length
            && let Ok(mut shorter) = zeros(length as u64)
        {
            shorter.copy_from_slice(&page[..length]);
            *page = shorter;
        }
    }

    /// Bytes of a page; no slot crosses the border of a page.
    pub fn page_bytes(&self) -> u64 {
        self.page_bytes
    }

    /// Page of a slot, and its offset there; `None` if the slot is not within one page.
    fn place(&self, slot: Slot) -> Option<(usize, usize)> {
        let (page, start) = (slot.offset / self.page_bytes, slot.offset % self.page_bytes);
        let fits = start.checked_add(slot.bytes)? <= self.page_bytes
            && slot.offset.checked_add(slot.bytes)? <= self.bytes_max;
        fits.then_some((page as usize, start as usize))
    }

    /// Copies `bytes` to `offset` in a slot; writes nothing if they do not fit.
    ///
    /// # Errors
    /// If the system has no memory for the page.
    pub fn write(&mut self, slot: Slot, offset: u64, bytes: &[u8]) -> Result<()> {
        let within = offset.checked_add(bytes.len() as u64).is_some_and(|end| end <= slot.bytes);
        debug_assert!(within, "{} bytes at {offset} of {slot:?}", bytes.len());
        let Some((page, start)) = self.place(slot).filter(|_| within) else { return Ok(()) };
        let page_start = page as u64 * self.page_bytes;
        if self.pages.len() <= page {
            self.pages.resize_with(page + 1, || None);
        }
        let end = start + offset as usize + bytes.len();
        let page = &mut self.pages[page];
        if page.as_ref().is_none_or(|page| page.len() < end) {
            // Also a page that a lower budget had cut short.
            let length = self.page_bytes.min(self.bytes.saturating_sub(page_start));
            let mut longer = zeros(length.max(end as u64))?;
            if let Some(page) = page {
                longer[..page.len()].copy_from_slice(page);
            }
            *page = Some(longer);
        }
        let Some(page) = page else { return Ok(()) };
        page[start + offset as usize..][..bytes.len()].copy_from_slice(bytes);
        Ok(())
    }

    /// Bytes of a slot; empty if its page was never written to.
    pub fn read(&self, slot: Slot) -> &[u8] {
        let Some((page, start)) = self.place(slot) else { return &[] };
        let page = self.pages.get(page).and_then(Option::as_ref);
        page.and_then(|p| p.get(start..start + slot.bytes as usize)).unwrap_or_default()
    }
}

/// `bytes` zeros, which take memory when they are written to.
fn zeros(bytes: u64) -> Result<MmapMut> {
    let page = MmapMut::map_anon(bytes as usize).with_context(|| {
        format!("the system has no {bytes} bytes for points to be drawn; lower --budget-gpu")
    })?;
    // Only a hint: without huge pages, writing is slower.
    #[cfg(target_os = "linux")]
    let _ = page.advise(memmap2::Advice::HugePage);
    Ok(page)
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
        memory.write(last, 3, b"def").unwrap();
        memory.write(last, 0, b"abc").unwrap();
        assert_eq!(memory.read(last), b"abcdef");
        assert!(memory.pages[..2].iter().all(Option::is_none), "unused pages are not allocated");
        assert_eq!(memory.pages[2].as_ref().unwrap().len(), 512, "never more than the budget");
    }

    #[test]
    fn memory_beyond_a_lower_budget_is_freed_and_comes_back_with_a_higher_one() {
        let mut memory = DrawingMemory::new(PAGE_BYTES_MAX + 1024);
        let (first, last) = (slot(256, 3), slot(PAGE_BYTES_MAX + 512, 3));
        memory.write(first, 0, b"abc").unwrap();
        memory.write(last, 0, b"def").unwrap();
        memory.resize(512);
        assert_eq!(memory.read(last), b"def", "until nothing is drawn from there");
        memory.free_beyond(512);
        assert_eq!(
            (memory.pages.len(), memory.read(last), memory.read(first)),
            (1, &b""[..], &b"abc"[..])
        );
        assert_eq!(memory.pages[0].as_ref().unwrap().len(), 512, "never more than the budget");
        memory.resize(2 * PAGE_BYTES_MAX);
        let grown = slot(2 * PAGE_BYTES_MAX - 256, 3);
        memory.write(grown, 0, b"ghi").unwrap();
        memory.write(slot(1024, 1), 0, b"j").unwrap();
        assert_eq!((memory.read(grown), memory.read(first)), (&b"ghi"[..], &b"abc"[..]));
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
            memory.write(wrong, 0, b"x").unwrap();
            assert_eq!(memory.read(wrong), b"", "{wrong:?}");
        }
        assert!(memory.pages.iter().all(Option::is_none));
    }
}
