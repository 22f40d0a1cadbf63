//! Prefetch of memory that a processor cannot predict: distant addresses in no pattern.

/// Prefetches the cache line in which an element begins, if there is such an element; reads
/// nothing.
#[inline(always)]
pub fn fetch<T>(of: &[T], index: usize) {
    let Some(element) = of.get(index) else { return };
    // SAFETY: a hint that reads and writes nothing; every x86-64 processor has the instruction.
    #[cfg(all(target_arch = "x86_64", not(miri)))]
    unsafe {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        _mm_prefetch::<_MM_HINT_T0>(std::ptr::from_ref(element).cast());
    }
    #[cfg(not(all(target_arch = "x86_64", not(miri))))]
    let _ = element;
}
