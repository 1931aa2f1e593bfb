//! Memory that the system refuses: one line and exit code 1, wherever it happens.
//!
//! The standard library aborts if an allocation fails, and leaves temporary files. A build cannot know beforehand what it will
//! need, and neither can the libraries that decode meshes and images, so the allocator of the program ends it instead.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::io::Write;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use crate::fail::Failure;
use crate::words::size;

#[global_allocator]
static ALLOCATOR: Ending = Ending;

/// Whether some thread has begun to end the program.
static ENDS: AtomicBool = AtomicBool::new(false);

thread_local! {
    /// Whether this thread handles refused memory itself.
    static HANDLES: Cell<bool> = const { Cell::new(false) };
    /// Whether this thread has begun to end the program.
    static ENDS_HERE: Cell<bool> = const { Cell::new(false) };
}

/// The system's allocator. If it refuses, the program ends, except within [`refusable`].
struct Ending;

impl Ending {
    fn checked(&self, at: *mut u8, bytes: usize) -> *mut u8 {
        if at.is_null() && !HANDLES.get() {
            end(bytes);
        }
        at
    }
}

// SAFETY: all four functions return what the system's allocator returns for the same arguments.
unsafe impl GlobalAlloc for Ending {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller keeps the rules of `GlobalAlloc::alloc`, which are the same.
        self.checked(unsafe { System.alloc(layout) }, layout.size())
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // SAFETY: as for `alloc`.
        self.checked(unsafe { System.alloc_zeroed(layout) }, layout.size())
    }

    unsafe fn realloc(&self, at: *mut u8, layout: Layout, new_size: usize) -> *mut u8 {
        // SAFETY: as for `alloc`.
        self.checked(unsafe { System.realloc(at, layout, new_size) }, new_size)
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        // SAFETY: as for `alloc`.
        unsafe { System.dealloc(at, layout) }
    }
}

/// Says what was refused, removes temporary files and ends the program. Nothing here needs memory.
#[cold]
fn end(bytes: usize) -> ! {
    if ENDS_HERE.replace(true) {
        std::process::abort();
    }
    while ENDS.swap(true, Ordering::SeqCst) {
        // Another thread is about to end the program.
        std::thread::sleep(Duration::from_secs(1));
    }
    // Standard error has no buffer. If it is closed, nobody can be told.
    let _ = writeln!(
        std::io::stderr(),
        "error: the system refuses {:.1} MiB of memory; free some, or choose a smaller --size, fewer --levels or a lower --memory-limit",
        bytes as f64 / f64::from(1 << 20)
    );
    esvo_format::remove_temporaries();
    std::process::exit(1);
}

/// Runs `work`, in which refused memory is an error that `work` handles.
fn refusable<T>(work: impl FnOnce() -> T) -> T {
    let before = HANDLES.replace(true);
    let result = work();
    HANDLES.set(before);
    result
}

/// Rejects work that needs more memory than the system gives. `what` names the option that asks for it.
pub(crate) fn check_memory(bytes: usize, what: &str) -> Result<(), Failure> {
    let needs = || format!("{what}: needs {} of memory", size(bytes as u64));
    // Systems promise more than they have: the second check is about the promise, the first about what is there.
    if let Some(available) = esvo_bench::system::available_bytes().filter(|available| bytes as u64 > *available) {
        return Err(format!("{}, and {} are available; make it smaller", needs(), size(available)).into());
    }
    refusable(|| Vec::<u8>::new().try_reserve_exact(bytes))
        .map_err(|_| format!("{}, which the system refuses; make it smaller", needs()).into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn too_much_is_refused() {
        assert!(check_memory(1 << 10, "--size").is_ok());
        // More than an address space, and so more than an allocator gives.
        for bytes in [isize::MAX as usize, 1 << 50] {
            let Err(Failure::Message(text)) = check_memory(bytes, "--size 9x9") else { panic!("accepted") };
            assert!(text.starts_with("--size 9x9: needs "), "{text}");
        }
        assert!(refusable(|| Vec::<u8>::new().try_reserve_exact(1 << 60)).is_err());
    }
}
