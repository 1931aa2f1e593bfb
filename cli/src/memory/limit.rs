//! The bound of `--memory-limit`: the allocator counts what the program holds, and ends it before it would hold more.
//!
//! Estimates made beforehand ([`esvo_builder::FileOptions::memory_limit`], [`esvo_builder::import::load_mesh_within`]) refuse what cannot fit, with
//! what it needs. Files may need more than an estimate says: their images are as large as they are. This is the bound that holds in
//! any case. Without a limit, it costs a comparison for each allocation.
//!
//! The limit is of resident memory. What the program held when the limit was set (its code, stacks) counts as held all the time.
//! The system's allocator keeps pages of freed blocks; so large blocks are mapped one by one, which returns their pages at once, and
//! what is resident is looked at whenever some megabytes were allocated.

use std::cell::Cell;
use std::sync::atomic::{AtomicBool, AtomicI64, AtomicU64, AtomicUsize, Ordering};

use super::{HANDLES, Reason, end};

/// Whether there is a limit.
static LIMITED: AtomicBool = AtomicBool::new(false);
/// The limit in bytes, as given.
static GIVEN: AtomicU64 = AtomicU64::new(u64::MAX);
/// The limit less [`SPARE`].
static LIMIT: AtomicU64 = AtomicU64::new(u64::MAX);
/// Bytes resident when the limit was set.
static BASE: AtomicU64 = AtomicU64::new(0);
/// Bytes allocated since, but for what threads have not yet told.
static HELD: AtomicI64 = AtomicI64::new(0);
/// `HELD` when resident memory was last looked at.
static LOOKED_AT: AtomicI64 = AtomicI64::new(0);
/// Which of [`STAGES`] the program is in.
static STAGE: AtomicUsize = AtomicUsize::new(0);

const STAGES: [&str; 2] = ["reading the mesh", "the build"];

/// Bytes that a thread allocates or frees before it tells.
const UNTOLD: i64 = 64 << 10;
/// Bytes of growth after which resident memory is looked at.
const LOOK: i64 = 4 << 20;
/// Kept free: what all threads together have not yet told, growth between two looks, and stacks.
const SPARE: u64 = 12 << 20;
/// Blocks from this size on are mapped one by one.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
const MAPPED: i32 = 256 << 10;

thread_local! {
    /// Bytes that this thread has allocated, less those that it has freed, since it last told.
    static MINE: Cell<i64> = const { Cell::new(0) };
}

/// Limits the memory of the program to this many bytes from here on.
pub(crate) fn set(bytes: u64) {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    // SAFETY: changes how blocks are allocated from now on, and nothing about those that exist.
    unsafe {
        libc::mallopt(libc::M_MMAP_THRESHOLD, MAPPED);
        libc::mallopt(libc::M_TRIM_THRESHOLD, MAPPED);
    }
    BASE.store(resident().unwrap_or(0), Ordering::Relaxed);
    GIVEN.store(bytes, Ordering::Relaxed);
    LIMIT.store(bytes.saturating_sub(SPARE), Ordering::Relaxed);
    LIMITED.store(true, Ordering::Relaxed);
    check(0);
}

/// From here on, messages say that the build needs more, not reading the mesh.
pub(crate) fn build_begins() {
    STAGE.store(1, Ordering::Relaxed);
}

/// What the program is doing.
pub(super) fn stage() -> &'static str {
    STAGES[STAGE.load(Ordering::Relaxed)]
}

/// So many bytes are about to be allocated.
pub(super) fn more(bytes: usize) {
    if LIMITED.load(Ordering::Relaxed) {
        count(bytes as i64);
    }
}

/// So many bytes were freed.
pub(super) fn less(bytes: usize) {
    if LIMITED.load(Ordering::Relaxed) {
        count(-(bytes as i64));
    }
}

/// A block is about to change its size. It may be copied, so that both are there for a moment; large ones are moved by their pages.
pub(super) fn changed(old: usize, new: usize) {
    if LIMITED.load(Ordering::Relaxed) {
        count(new as i64 - old as i64);
    }
}

fn count(bytes: i64) {
    // While a thread ends, its counter may be gone: what it frees then is lost to the count.
    let told = MINE.try_with(|mine| {
        let sum = mine.get() + bytes;
        let tell = sum.abs() >= UNTOLD;
        mine.set(if tell { 0 } else { sum });
        if tell { sum } else { 0 }
    });
    match told {
        Ok(0) | Err(_) => {}
        Ok(sum) => {
            let held = HELD.fetch_add(sum, Ordering::Relaxed) + sum;
            if sum > 0 {
                check_all(held, bytes.max(0) as usize);
            } else {
                // Growth is counted from the lowest point on.
                LOOKED_AT.fetch_min(held, Ordering::Relaxed);
            }
        }
    }
}

/// Ends the program if it holds more than it may, `asked` included.
fn check_all(held: i64, asked: usize) {
    let limit = LIMIT.load(Ordering::Relaxed);
    let all = BASE.load(Ordering::Relaxed).saturating_add_signed(held);
    if all > limit {
        refuse(all - asked as u64, asked);
    }
    if held - LOOKED_AT.load(Ordering::Relaxed) >= LOOK {
        LOOKED_AT.store(held, Ordering::Relaxed);
        check(asked);
    }
}

/// Looks at what is resident.
fn check(asked: usize) {
    let limit = LIMIT.load(Ordering::Relaxed);
    let too_much = || resident().filter(|resident| resident + asked as u64 > limit);
    if too_much().is_none() {
        return;
    }
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    // SAFETY: returns free pages to the system; takes the allocator's own locks, none of which this thread holds.
    unsafe {
        libc::malloc_trim(0);
    }
    if let Some(resident) = too_much() {
        refuse(resident, asked);
    }
}

#[cold]
fn refuse(held: u64, asked: usize) {
    if !HANDLES.get() {
        let limit = GIVEN.load(Ordering::Relaxed);
        LIMITED.store(false, Ordering::Relaxed);
        end(&Reason::Limit { limit, held, asked });
    }
}

/// Bytes of this process in memory, without allocating any. `None` if the system does not say.
fn resident() -> Option<u64> {
    #[cfg(target_os = "linux")]
    {
        use std::io::Read;
        let mut text = [0; 128];
        let read = std::fs::File::open("/proc/self/statm").ok()?.read(&mut text).ok()?;
        let pages: u64 = std::str::from_utf8(&text[..read]).ok()?.split_whitespace().nth(1)?.parse().ok()?;
        // SAFETY: asks for a constant of the system.
        let page = unsafe { libc::sysconf(libc::_SC_PAGESIZE) };
        Some(pages * u64::try_from(page).ok()?)
    }
    #[cfg(not(target_os = "linux"))]
    None
}
