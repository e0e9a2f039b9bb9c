//! The operator's wish to leave: Ctrl-C, or a signal to end.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

use crate::error::{Error, Result};

/// Signals that come so soon after the first are the same wish: some senders signal a program and its group.
const ONE_WISH: Duration = Duration::from_millis(300);

static END: OnceLock<fn(i32) -> !> = OnceLock::new();

/// How the program ends at once with a code: without what drivers do at a program's end, which crashes where they are at
/// work meanwhile.
pub fn end_with(end: fn(i32) -> !) {
    // Whoever came first stays.
    let _ = END.set(end);
}

/// Ends at once.
pub(super) fn end_now(code: i32) -> ! {
    END.get().map_or(std::process::exit as fn(i32) -> !, |end| *end)(code)
}

/// Becomes true when the operator wants to leave. The second wish ends the program at once, after `last_words`.
///
/// # Errors
/// Where signals cannot be listened to.
pub fn stop_signal(last_words: fn()) -> Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    let asked = stop.clone();
    let mut first = None;
    let handler = move || {
        crate::waiting::leave();
        let first = *first.get_or_insert_with(Instant::now);
        if asked.swap(true, Ordering::Relaxed) && first.elapsed() > ONE_WISH {
            last_words();
            end_now(130);
        }
    };
    ctrlc::set_handler(handler)
        .map_err(|e| Error::setting("Ctrl-C", format!("it cannot be listened to ({e}); start again")))?;
    Ok(stop)
}
