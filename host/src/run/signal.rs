//! SIGINT and SIGTERM as a flag that a loop looks at.

use crate::failure::{Exit, Failure};
use std::io;
use std::sync::atomic::{AtomicBool, Ordering};

static STOP: AtomicBool = AtomicBool::new(false);

/// Signals cannot be caught.
#[derive(Debug, thiserror::Error)]
#[error("Ctrl-C and SIGTERM cannot be caught: {0}; run where a process may handle its signals")]
pub struct SignalError(io::Error);

impl From<SignalError> for Failure {
    fn from(error: SignalError) -> Self {
        Self::told(Exit::Failed, error.to_string())
    }
}

/// From now on SIGINT (Ctrl-C) and SIGTERM no longer kill the process but set the flag of [`stop_requested`].
///
/// # Errors
/// [`SignalError`].
pub fn catch_stop() -> Result<(), SignalError> {
    for signal in [libc::SIGINT, libc::SIGTERM] {
        // SAFETY: an all-zero sigaction is valid (no flags, empty mask, default handler).
        let mut action: libc::sigaction = unsafe { std::mem::zeroed() };
        action.sa_sigaction = on_signal as *const () as libc::sighandler_t;
        // SAFETY: the handler only stores to an atomic, which is allowed in a signal handler; the action lives until return.
        if unsafe { libc::sigaction(signal, &action, std::ptr::null_mut()) } != 0 {
            return Err(SignalError(io::Error::last_os_error()));
        }
    }
    Ok(())
}

/// Whether SIGINT or SIGTERM has come since [`catch_stop`].
pub fn stop_requested() -> bool {
    STOP.load(Ordering::Relaxed)
}

extern "C" fn on_signal(_signal: libc::c_int) {
    STOP.store(true, Ordering::Relaxed);
}
