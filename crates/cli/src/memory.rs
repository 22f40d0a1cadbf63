//! What happens when memory ends: one line that says so, no unfinished file, exit code 1. Without
//! this the standard library aborts, with a backtrace in some environments, and files stay.

use esker_engine::remove_unfinished;
use std::alloc::{GlobalAlloc, Layout, System};

struct Reporting;

#[global_allocator]
static ALLOCATOR: Reporting = Reporting;

// SAFETY: passes every call on to the system's allocator; what it returns is not changed.
unsafe impl GlobalAlloc for Reporting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller's promises are those that are needed here.
        unsafe { System.alloc(layout) }.or_end(layout.size())
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // SAFETY: as above.
        unsafe { System.alloc_zeroed(layout) }.or_end(layout.size())
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        // SAFETY: as above.
        unsafe { System.dealloc(at, layout) };
    }

    unsafe fn realloc(&self, at: *mut u8, layout: Layout, new_size: usize) -> *mut u8 {
        // SAFETY: as above.
        unsafe { System.realloc(at, layout, new_size) }.or_end(new_size)
    }
}

/// Ends the program in place of a null pointer.
trait OrEnd {
    fn or_end(self, bytes: usize) -> Self;
}

impl OrEnd for *mut u8 {
    fn or_end(self, bytes: usize) -> Self {
        if self.is_null() {
            end(bytes);
        }
        self
    }
}

#[cold]
fn end(bytes: usize) -> ! {
    remove_unfinished();
    // Formatting of numbers allocates nothing, and standard error has no buffer.
    eprintln!(
        "error: memory has run out: the system refuses {} KiB more; close other programs, or ask for less (--memory, --threads, --size, --budget-ram)",
        bytes.div_ceil(1024)
    );
    end_at_once()
}

#[cfg(unix)]
fn end_at_once() -> ! {
    // SAFETY: ends the process without running anything of it, which might allocate.
    unsafe { libc::_exit(1) }
}

#[cfg(not(unix))]
fn end_at_once() -> ! {
    std::process::abort()
}
