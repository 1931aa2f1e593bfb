//! Memory for sizes that the user gives.

use crate::fail::Failure;
use crate::words::size;

/// Rejects work that needs more memory than the system gives. `what` names the option that asks for it.
pub(crate) fn check_memory(bytes: usize, what: &str) -> Result<(), Failure> {
    let needs = || format!("{what}: needs {} of memory", size(bytes as u64));
    // Systems promise more than they have: the second check is about the promise, the first about what is there.
    if let Some(available) = esvo_bench::system::available_bytes().filter(|available| bytes as u64 > *available) {
        return Err(format!("{}, and {} are available; make it smaller", needs(), size(available)).into());
    }
    let mut trial: Vec<u8> = Vec::new();
    trial.try_reserve_exact(bytes).map_err(|_| format!("{}, which the system refuses; make it smaller", needs()).into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn too_much_is_refused() {
        assert!(check_memory(1 << 10, "--size").is_ok());
        let Err(Failure::Message(text)) = check_memory(isize::MAX as usize, "--size 9x9") else { panic!("accepted") };
        assert!(text.starts_with("--size 9x9: needs "), "{text}");
    }
}
