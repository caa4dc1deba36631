//! What a run says on stderr: stages with rate and time left, warnings, the result, or the error.
//!
//! On a terminal a bar for each stage; otherwise plain lines, few enough for a log file; or one JSON object a line:
//!
//!     {"event":"stage","name":"direct","total":65536,"seconds":1.25}
//!     {"event":"progress","name":"direct","done":2048,"total":65536,"per_second":1024.0,"seconds_left":62.0}
//!     {"event":"stage-done","name":"direct","done":65536,"seconds":64.1}
//!     {"event":"warning","message":"...","places":["..."],"count":3}
//!     {"event":"done","output":"room_baked","seconds":70.2,"summary":["..."]}
//!     {"event":"error","message":"room.glb: ..."}

use super::args::{ConsoleArgs, LogFormat};
use super::{log, print};
use indicatif::{ProgressBar, ProgressState, ProgressStyle};
use lumel::Error;
use lumel::error::Warnings;
use lumel::progress::Progress;
use serde_json::json;
use std::io::{IsTerminal, Write};
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Least time between two plain or JSON progress lines [ms].
const LINE_INTERVAL: u64 = 3000;
/// Least time between two steps of the bar [ms].
const BAR_INTERVAL: u64 = 80;
/// Places of a warning that are printed; the report holds more.
const PLACES: usize = 3;

/// How it is said.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Style {
    /// Errors alone.
    Quiet,
    Bar,
    Lines,
    Json,
}

/// The run's voice on stderr, and the ear for its interruption.
#[derive(Debug)]
pub struct Console {
    style: Style,
    /// Errors as JSON; kept apart from the style, since a quiet run has errors, too.
    json: bool,
    start: Instant,
    cancelled: Arc<AtomicBool>,
    /// Units done in the current stage. Outside the lock: many threads count at once.
    done: AtomicU64,
    /// When progress is shown next [ms since the start].
    due: AtomicU64,
    stage: Mutex<Option<Stage>>,
    kept: Kept,
}

/// What lies in the place of the result by now.
type Kept = Arc<Mutex<Option<String>>>;

/// The stage that runs.
#[derive(Debug)]
struct Stage {
    name: &'static str,
    total: u64,
    start: Instant,
    /// When it ends, however much is done, after the run began.
    end: Option<Duration>,
    bar: Option<ProgressBar>,
}

/// The part of a [`Console`] that a signal handler needs.
#[derive(Clone, Debug)]
pub struct ErrorVoice {
    json: bool,
    bar: bool,
    kept: Kept,
}

impl Console {
    /// A console as the arguments and the terminal have it.
    pub fn new(args: &ConsoleArgs) -> Self {
        let json = args.log_format == Some(LogFormat::Json);
        // A log between the steps of a bar would tear it to pieces.
        let bar = std::io::stderr().is_terminal() && log::filter().is_none();
        let style = match (args.quiet, json, bar) {
            (true, ..) => Style::Quiet,
            (_, true, _) => Style::Json,
            (_, _, true) => Style::Bar,
            _ => Style::Lines,
        };
        Self {
            style,
            json,
            start: Instant::now(),
            cancelled: Arc::default(),
            done: AtomicU64::new(0),
            due: AtomicU64::new(0),
            stage: Mutex::new(None),
            kept: Kept::default(),
        }
    }

    /// The flag that ends the run once it is set.
    pub fn cancel_flag(&self) -> Arc<AtomicBool> {
        Arc::clone(&self.cancelled)
    }

    /// What a signal handler speaks with.
    pub fn for_errors(&self) -> ErrorVoice {
        ErrorVoice { json: self.json, bar: self.style == Style::Bar, kept: Arc::clone(&self.kept) }
    }

    /// Ends the current stage, if any: says how long it took.
    pub fn finish(&self) {
        let Some(stage) = self.stage().take() else { return };
        let (name, done) = (stage.name, self.done.load(Ordering::Relaxed));
        let seconds = stage.start.elapsed().as_secs_f64();
        if let Some(bar) = &stage.bar {
            bar.finish_and_clear();
        }
        match self.style {
            Style::Quiet => {}
            Style::Bar => say(&format!("{name:>10}  {}", print::seconds(seconds))),
            Style::Lines => self.line(&format!("{name}: done in {}", print::seconds(seconds))),
            Style::Json => {
                say(&json!({"event": "stage-done", "name": name, "done": done, "seconds": seconds}).to_string());
            }
        }
    }

    /// Says what was met on the way: each message with its count and first places.
    pub fn warnings(&self, warnings: &Warnings) {
        for w in warnings.iter() {
            match self.style {
                Style::Quiet => {}
                Style::Json => {
                    let event = json!({"event": "warning", "message": w.message, "places": w.places, "count": w.count});
                    say(&event.to_string());
                }
                Style::Bar | Style::Lines => {
                    let mut places = w.places.iter().take(PLACES).cloned().collect::<Vec<_>>().join(", ");
                    if w.count > w.places.len().min(PLACES) {
                        places += &format!(", ... ({} in all)", w.count);
                    }
                    say(&one_line(&format!("warning: {}: {places}", w.message)));
                }
            }
        }
    }

    /// Says what came out: the library's `summary`, the `folder`, and the time [s].
    pub fn done(&self, folder: &Path, summary: &[String], seconds: f64) {
        match self.style {
            Style::Quiet => {}
            Style::Json => {
                let output = folder.display().to_string();
                say(&json!({"event": "done", "output": output, "seconds": seconds, "summary": summary}).to_string());
            }
            Style::Bar | Style::Lines => {
                summary.iter().for_each(|line| say(line));
                say(&format!("wrote {} in {}", folder.display(), print::seconds(seconds)));
            }
        }
    }

    /// Says why the run ended: one line.
    pub fn error(&self, error: &Error) {
        if let Some(stage) = self.stage().take()
            && let Some(bar) = stage.bar
        {
            bar.finish_and_clear();
        }
        ErrorVoice { bar: false, ..self.for_errors() }.error(error);
    }

    fn stage(&self) -> MutexGuard<'_, Option<Stage>> {
        self.stage.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A plain line with the time since the start.
    fn line(&self, text: &str) {
        say(&format!("[{:7.1} s] {text}", self.start.elapsed().as_secs_f64()));
    }

    fn now(&self) -> u64 {
        self.start.elapsed().as_millis() as u64
    }

    /// Shows how far the current stage is.
    fn show(&self) {
        let stage = self.stage();
        let Some(stage) = stage.as_ref() else { return };
        let (done, total) = (self.done.load(Ordering::Relaxed), stage.total);
        let until_end = stage.end.map(|end| end.saturating_sub(self.start.elapsed()).as_secs_f64());
        if let Some(bar) = &stage.bar {
            bar.set_position(done);
            if let Some(left) = until_end {
                bar.set_message(format!("{} left", print::seconds(left)));
            }
            return;
        }
        let rate = done as f64 / stage.start.elapsed().as_secs_f64().max(1e-3);
        let by_rate = (total > 0 && done > 0).then(|| total.saturating_sub(done) as f64 / rate);
        let left = [by_rate, until_end].into_iter().flatten().reduce(f64::min);
        if self.style == Style::Json {
            let event = json!({"event": "progress", "name": stage.name, "done": done, "total": total,
                               "per_second": rate, "seconds_left": left});
            say(&event.to_string());
            return;
        }
        let mut text = format!("{}: ", stage.name);
        if total > 0 {
            text += &format!("{:.0} % of ", 100.0 * done.min(total) as f64 / total as f64);
            text += &print::count(total);
        } else {
            text += &print::count(done);
        }
        text += &format!(", {}/s", print::number(rate));
        if let Some(left) = left {
            text += &format!(", {} left", print::seconds(left));
        }
        self.line(&text);
    }

    fn interval(&self) -> u64 {
        if self.style == Style::Bar { BAR_INTERVAL } else { LINE_INTERVAL }
    }
}

impl Progress for Console {
    fn begin(&self, name: &'static str, total: u64) {
        self.finish();
        self.done.store(0, Ordering::Relaxed);
        self.due.store(self.now() + self.interval(), Ordering::Relaxed);
        match self.style {
            Style::Quiet | Style::Bar => {}
            Style::Lines => self.line(name),
            Style::Json => {
                let seconds = self.start.elapsed().as_secs_f64();
                say(&json!({"event": "stage", "name": name, "total": total, "seconds": seconds}).to_string());
            }
        }
        let bar = (self.style == Style::Bar).then(|| bar(name, total));
        *self.stage() = Some(Stage { name, total, start: Instant::now(), end: None, bar });
    }

    fn advance(&self, units: u64) {
        self.done.fetch_add(units, Ordering::Relaxed);
        if self.style == Style::Quiet {
            return;
        }
        let (now, due) = (self.now(), self.due.load(Ordering::Relaxed));
        let next = now + self.interval();
        // One of the threads that find it due shows it.
        if now >= due && self.due.compare_exchange(due, next, Ordering::Relaxed, Ordering::Relaxed).is_ok() {
            self.show();
        }
    }

    fn cancelled(&self) -> bool {
        self.cancelled.load(Ordering::Relaxed)
    }

    fn elapsed(&self) -> Duration {
        self.start.elapsed()
    }

    fn ends_at(&self, end: Duration) {
        if let Some(stage) = self.stage().as_mut() {
            stage.end = Some(end);
        }
    }

    fn keeps(&self, what: &str) {
        *self.kept.lock().unwrap_or_else(PoisonError::into_inner) = Some(what.to_string());
    }
}

impl ErrorVoice {
    /// Says why the run ended: one line.
    pub fn error(self, error: &Error) {
        let mut message = one_line(&error.to_string());
        let kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        if let (Error::Cancelled, Some(kept)) = (error, kept.as_ref()) {
            message += &format!("; {kept}");
        }
        if self.json {
            say(&json!({"event": "error", "message": message}).to_string());
        } else {
            // Below the bar, if one is on the screen.
            let start = if self.bar { "\n" } else { "" };
            match error {
                Error::Cancelled => say(&format!("{start}{message}")),
                _ => say(&format!("{start}error: {message}")),
            }
        }
    }
}

/// A bar of `total` units, or a spinner where that is unknown (0).
fn bar(name: &'static str, total: u64) -> ProgressBar {
    let (bar, template) = if total > 0 {
        let template = "{prefix:>10}  {bar:30} {percent:>3} %  {human_pos}/{human_len}  {rate}  {eta} left";
        (ProgressBar::new(total), template)
    } else {
        (ProgressBar::new_spinner(), "{prefix:>10}  {spinner} {elapsed}  {msg}")
    };
    // The templates are constants; the default style is what is left where indicatif doesn't take them.
    let bar = match ProgressStyle::with_template(template) {
        Ok(style) => bar.with_style(style.progress_chars("=> ").with_key("rate", rate)),
        Err(_) => bar,
    };
    bar.set_prefix(name);
    bar.enable_steady_tick(Duration::from_millis(200));
    bar
}

/// The bar's rate; indicatif's own has four decimals.
fn rate(state: &ProgressState, out: &mut dyn std::fmt::Write) {
    // A field that can't be drawn is left out.
    let _ = write!(out, "{}/s", print::number(state.per_sec()));
}

/// Writes a line to stderr. A stderr that is closed is no reason to fail (eprintln would panic).
fn say(line: &str) {
    let _ = writeln!(std::io::stderr().lock(), "{line}");
}

/// A message of several lines on one.
fn one_line(text: &str) -> String {
    text.lines().map(str::trim).filter(|l| !l.is_empty()).collect::<Vec<_>>().join("; ")
}
