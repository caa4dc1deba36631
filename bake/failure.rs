//! How a run ends: one line on stderr and an exit code.

use super::console::Console;
use lumel::Error;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::process::ExitCode;
use std::sync::{Arc, Mutex, PoisonError};

/// Exit code of a run that was interrupted: 128 + SIGINT, as shells have it.
pub const INTERRUPTED: u8 = 130;

/// Exit code of a bake that is done and differs from one that remembers nothing by more than noise explains.
pub const DIFFERS: u8 = 3;

/// Exit code of a shard that did its part and needs those of others: EX_TEMPFAIL of sysexits.h.
pub const AWAITED: u8 = 75;

/// Why a command ended early.
#[derive(Debug)]
pub enum Failure {
    /// What was asked makes no sense (arguments, config file): exit 2.
    Usage(Error),
    /// The work failed: exit 1, or 130 where it was interrupted.
    Run(Error),
    /// The bake is done, and what `--verify` found has been said: exit 3.
    Differs,
    /// Whoever read our stdout has gone; that is their right (`lumel inspect scene | head`).
    ClosedPipe,
}

impl From<Error> for Failure {
    fn from(e: Error) -> Self {
        Self::Run(e)
    }
}

/// Runs `command` and turns its end into a line on stderr and an exit code. A panic is a defect of ours, but still ends in
/// one line that says so, in place of a stack trace (which RUST_BACKTRACE brings back).
pub fn exit_code(console: &Console, command: impl FnOnce() -> Result<(), Failure>) -> ExitCode {
    let first_panic = Arc::new(Mutex::new(None));
    if std::env::var_os("RUST_BACKTRACE").is_none() {
        let slot = Arc::clone(&first_panic);
        std::panic::set_hook(Box::new(move |info| {
            let payload = info.payload();
            let message = payload.downcast_ref::<&str>().map(|s| (*s).to_string());
            let message = message.or_else(|| payload.downcast_ref::<String>().cloned()).unwrap_or_default();
            let place = info.location().map_or_else(String::new, ToString::to_string);
            slot.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert((place, message));
        }));
    }
    let failure = match catch_unwind(AssertUnwindSafe(command)) {
        Ok(Ok(())) | Ok(Err(Failure::ClosedPipe)) => return ExitCode::SUCCESS,
        Ok(Err(Failure::Differs)) => return ExitCode::from(DIFFERS),
        Ok(Err(failure)) => failure,
        Err(_) => {
            let first = first_panic.lock().unwrap_or_else(PoisonError::into_inner).take();
            let (place, message) = first.unwrap_or_default();
            Failure::Run(Error::invalid("internal error", format!("{message} ({place}); please report it")))
        }
    };
    let (error, code) = match failure {
        Failure::Usage(e) => (e, 2),
        Failure::Run(e @ Error::Cancelled) => (e, INTERRUPTED),
        Failure::Run(e @ Error::Awaited { .. }) => (e, AWAITED),
        Failure::Run(e) => (e, 1),
        Failure::Differs => return ExitCode::from(DIFFERS),
        Failure::ClosedPipe => return ExitCode::SUCCESS,
    };
    console.error(&error);
    ExitCode::from(code)
}
