//! Ctrl-C (SIGINT, SIGTERM, SIGHUP): the run ends within a second and leaves no half file.
//!
//! The handler sets the flag that stages poll, and gives them [`GRACE`] to return. A stage that can't (a third-party call
//! that runs for long) is not waited for: the handler itself clears the staging folder and ends the process.

use super::console::Console;
use super::failure::INTERRUPTED;
use lumel::Error;
use lumel::store::FolderLock;
use lumel::write::output::{STAGING_NAME, Staging};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// How long the library may take to stop: with the clean-up it stays below the second that is promised.
const GRACE: Duration = Duration::from_millis(700);

/// Sets `cancelled` on the first signal; ends the process where it still runs after [`GRACE`]. `folder` is the output
/// folder that must not keep half a result; without one there is nothing to wait for.
pub fn install(console: &Console, cancelled: Arc<AtomicBool>, folder: Option<PathBuf>) {
    let console = console.for_errors();
    let handler = move || {
        cancelled.store(true, Ordering::Relaxed);
        if let Some(folder) = &folder {
            std::thread::sleep(GRACE);
            // A writer that is still at work may make the folder anew while it is being removed.
            for _ in 0..20 {
                Staging::discard(folder);
                // The lock ends with the process; its file is in the way of an empty folder.
                let _ = std::fs::remove_file(folder.join(FolderLock::NAME));
                let _ = std::fs::remove_dir(folder);
                if !folder.join(STAGING_NAME).exists() {
                    break;
                }
            }
        }
        console.clone().error(&Error::Cancelled);
        std::process::exit(i32::from(INTERRUPTED));
    };
    // It fails only where a handler exists already or the system refuses one; the run is right without it, too.
    if let Err(e) = ctrlc::set_handler(handler) {
        tracing::warn!("Ctrl-C is not handled: {e}");
    }
}
