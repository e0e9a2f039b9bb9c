//! What is waited for, on standard error, where that is a terminal: a line for each step, a bar where its length is
//! known. Nothing is shown elsewhere, nor before [`show`]: a library is silent.

use std::sync::LazyLock;
use std::time::Duration;

use indicatif::{MultiProgress, ProgressBar, ProgressDrawTarget, ProgressStyle};

/// All lines and bars, one below the other.
static LINES: LazyLock<MultiProgress> =
    LazyLock::new(|| MultiProgress::with_draw_target(ProgressDrawTarget::hidden()));

/// Time between two pictures of a line, which tells how long its step has taken.
const TICK: Duration = Duration::from_millis(200);

/// A step's line; gone when this is dropped.
pub struct Step(ProgressBar);

/// Has lines and bars shown from now on.
pub fn show() {
    LINES.set_draw_target(ProgressDrawTarget::stderr());
}

/// Shows that something is done now.
pub fn step(what: &str) -> Step {
    Step(started(ProgressBar::new_spinner(), what, "{spinner} {msg}, {elapsed}"))
}

/// A bar for so many units of work; it is there from now on.
pub fn bar(units: u64, what: &str, template: &str) -> ProgressBar {
    started(ProgressBar::new(units), what, template)
}

/// Runs something that writes to standard error, without a line in its way.
pub fn suspended<T>(run: impl FnOnce() -> T) -> T {
    LINES.suspend(run)
}

/// Tells the operator something on standard error, as one line that begins with the program's name.
/// Nobody who reads it is no error.
pub fn complain(message: &str) {
    use std::io::Write;
    let line: String = message.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    let _ = suspended(|| writeln!(std::io::stderr(), "foveate: {}", line.trim_end()));
}

fn started(bar: ProgressBar, what: &str, template: &str) -> ProgressBar {
    let style = ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar());
    let bar = LINES.add(bar.with_style(style).with_message(what.to_string()));
    if !bar.is_hidden() {
        bar.tick();
        bar.enable_steady_tick(TICK);
    }
    bar
}

impl Drop for Step {
    fn drop(&mut self) {
        self.0.finish_and_clear();
        LINES.remove(&self.0);
    }
}
