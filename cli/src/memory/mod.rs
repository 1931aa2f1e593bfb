//! Memory that the system refuses, or that `--memory-limit` does not allow: one line and exit code 1, wherever it happens.
//!
//! The standard library aborts if an allocation fails, and leaves temporary files. A build cannot know beforehand what it will
//! need, and neither can the libraries that decode meshes and images, so the allocator of the program ends it instead.

pub(crate) mod limit;

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
            end(&Reason::Refused(bytes));
        }
        at
    }
}

// SAFETY: all four functions return what the system's allocator returns for the same arguments, or do not return.
unsafe impl GlobalAlloc for Ending {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        limit::more(layout.size());
        // SAFETY: the caller keeps the rules of `GlobalAlloc::alloc`, which are the same.
        self.checked(unsafe { System.alloc(layout) }, layout.size())
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        limit::more(layout.size());
        // SAFETY: as for `alloc`.
        self.checked(unsafe { System.alloc_zeroed(layout) }, layout.size())
    }

    unsafe fn realloc(&self, at: *mut u8, layout: Layout, new_size: usize) -> *mut u8 {
        limit::changed(layout.size(), new_size);
        // SAFETY: as for `alloc`.
        self.checked(unsafe { System.realloc(at, layout, new_size) }, new_size)
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        // SAFETY: as for `alloc`.
        unsafe { System.dealloc(at, layout) }
        limit::less(layout.size());
    }
}

/// Why the program ends.
enum Reason {
    /// The system refuses so many bytes.
    Refused(usize),
    /// More than `--memory-limit` allows: its bytes, those held, and those asked for.
    Limit { limit: u64, held: u64, asked: usize },
}

const MIB: f64 = (1 << 20) as f64;

/// Says why, removes temporary files and ends the program. Nothing here needs memory.
#[cold]
fn end(reason: &Reason) -> ! {
    if ENDS_HERE.replace(true) {
        std::process::abort();
    }
    while ENDS.swap(true, Ordering::SeqCst) {
        // Another thread is about to end the program.
        std::thread::sleep(Duration::from_secs(1));
    }
    // Standard error has no buffer. If it is closed, nobody can be told.
    let mut out = std::io::stderr();
    let _ = match *reason {
        Reason::Refused(bytes) => writeln!(
            out,
            "error: the system refuses {:.1} MiB of memory; free some, or choose a smaller --size, fewer --levels or a lower --memory-limit",
            bytes as f64 / MIB
        ),
        Reason::Limit { limit, held, asked } => writeln!(
            out,
            "error: --memory-limit {}: {} needs more: it holds {:.0} MB and asks for {:.1} MB; raise the limit, or choose fewer --levels",
            limit as f64 / 1e9,
            limit::stage(),
            held as f64 / 1e6,
            asked as f64 / 1e6
        ),
    };
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
