//! Saying ahead what will be read, where no processor can guess it: places far apart, one after the other in no
//! pattern.

/// Asks for the cache line in which an element begins, where there is one; reads nothing.
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
