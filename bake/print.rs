//! What goes to stdout: text, JSON, aligned tables, completion scripts.

use super::args::Args;
use super::failure::Failure;
use clap::CommandFactory;
use lumel::Error;
use std::io::{ErrorKind, Write};
use std::path::Path;

/// Writes `text` to stdout.
///
/// # Errors
/// `ClosedPipe` where nobody reads it any more, `Io` where it can't be written.
pub fn print(text: &str) -> Result<(), Failure> {
    let mut out = std::io::stdout().lock();
    out.write_all(text.as_bytes()).and_then(|()| out.flush()).map_err(|e| match e.kind() {
        ErrorKind::BrokenPipe => Failure::ClosedPipe,
        _ => Failure::Run(Error::io(Path::new("stdout"), e)),
    })
}

/// Writes `value` to stdout as indented JSON; a number that is not finite becomes null.
///
/// # Errors
/// As [`print`].
pub fn json(value: &impl serde::Serialize) -> Result<(), Failure> {
    let text = serde_json::to_string_pretty(value).map_err(|e| Error::invalid("JSON", e))?;
    print(&(text + "\n"))
}

/// Writes the completion script for `shell` to stdout.
///
/// # Errors
/// As [`print`].
pub fn completions(shell: clap_complete::Shell) -> Result<(), Failure> {
    // Through memory: clap_complete panics where the stream it writes to is closed.
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut Args::command(), "lumel", &mut script);
    print(&String::from_utf8_lossy(&script))
}

/// A table with aligned columns; the first row is the heading.
#[derive(Debug)]
pub struct Table {
    rows: Vec<Vec<String>>,
}

impl Table {
    /// A table with this heading. A column whose heading starts with `>` is aligned to the right, as numbers are.
    pub fn new(heading: &[&str]) -> Self {
        Self { rows: vec![heading.iter().map(ToString::to_string).collect()] }
    }

    /// Adds a row; it has as many cells as the heading.
    pub fn row(&mut self, cells: Vec<String>) {
        assert_eq!(cells.len(), self.rows[0].len(), "one cell a column");
        self.rows.push(cells);
    }

    /// The rows as lines, indented by two spaces; nothing where there is only a heading.
    pub fn text(&self) -> String {
        if self.rows.len() < 2 {
            return String::new();
        }
        let columns = self.rows[0].len();
        let right: Vec<bool> = self.rows[0].iter().map(|h| h.starts_with('>')).collect();
        let cell = |row: &[String], c: usize| row[c].trim_start_matches('>').to_string();
        let width: Vec<usize> =
            (0..columns).map(|c| self.rows.iter().map(|r| cell(r, c).chars().count()).max().unwrap_or(0)).collect();
        let mut text = String::new();
        for row in &self.rows {
            let mut line = String::new();
            for c in 0..columns {
                let (value, width) = (cell(row, c), width[c]);
                let value = if right[c] { format!("  {value:>width$}") } else { format!("  {value:<width$}") };
                line.push_str(&value);
            }
            text.push_str(line.trim_end());
            text.push('\n');
        }
        text
    }
}

/// A count with its thousands apart: `1 234 567`.
pub fn count(n: u64) -> String {
    let digits = n.to_string();
    let mut text = String::new();
    for (i, d) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(' ');
        }
        text.push(d);
    }
    text
}

/// A quantity with four significant digits, without an exponent between 0.001 and 1e6.
pub fn number(v: f64) -> String {
    let size = v.abs();
    if v == 0.0 || !v.is_finite() {
        format!("{v}")
    } else if !(1e-3..1e6).contains(&size) {
        format!("{v:.3e}")
    } else {
        let decimals = (3 - size.log10().floor() as i32).max(0) as usize;
        let text = format!("{v:.decimals$}");
        if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_string() } else { text }
    }
}

/// A duration [s] as people say it: `0.35 s`, `12.3 s`, `4 min 05 s`, `1 h 02 min`.
pub fn seconds(s: f64) -> String {
    let whole = s.round() as u64;
    match s {
        s if s < 1.0 => format!("{s:.2} s"),
        s if s < 60.0 => format!("{s:.1} s"),
        s if s < 3600.0 => format!("{} min {:02} s", whole / 60, whole % 60),
        _ => format!("{} h {:02} min", whole / 3600, whole % 3600 / 60),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short_and_exact_enough() {
        assert_eq!(count(1_234_567), "1 234 567");
        assert_eq!(count(12), "12");
        assert_eq!(number(0.5), "0.5");
        assert_eq!(number(12.0), "12");
        assert_eq!(number(1234.567), "1235");
        assert_eq!(number(1e-7), "1.000e-7");
        assert_eq!(seconds(245.0), "4 min 05 s");
    }

    #[test]
    fn columns_line_up() {
        let mut t = Table::new(&["name", ">n"]);
        t.row(vec!["a".into(), "10".into()]);
        t.row(vec!["long".into(), "2".into()]);
        assert_eq!(t.text(), "  name   n\n  a     10\n  long   2\n");
    }
}
