//! Interrupts: the program removes its temporary files before it ends.

/// Removes temporary files and child processes, then ends with exit code 130.
fn end() -> ! {
    esvo_format::remove_temporaries();
    esvo_bench::interrupted();
    crate::remote::remove_copies();
    std::process::exit(130);
}

/// Lets the program end tidily on an interrupt, a request to terminate, or a hang-up of the terminal. A hang-up that was ignored
/// when the program started, as with `nohup`, stays ignored (on Linux; elsewhere the system does not tell).
///
/// # Errors
/// The system's.
#[cfg(unix)]
pub(crate) fn end_tidily() -> std::io::Result<()> {
    use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};

    let ignored = esvo_bench::system::ignores_signal(SIGHUP.unsigned_abs());
    let wanted = [SIGINT, SIGTERM].into_iter().chain((!ignored).then_some(SIGHUP));
    let mut signals = signal_hook::iterator::Signals::new(wanted)?;
    std::thread::Builder::new().name("signals".into()).spawn(move || {
        if signals.forever().next().is_some() {
            end();
        }
    })?;
    Ok(())
}

/// Lets the program end tidily on an interrupt.
///
/// # Errors
/// The system's.
#[cfg(not(unix))]
pub(crate) fn end_tidily() -> Result<(), ctrlc::Error> {
    ctrlc::set_handler(|| end())
}
