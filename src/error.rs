//! The library's errors and warnings: what went wrong, where, and what to do about it.

use std::fmt;
use std::path::Path;

/// `Result` with Lumel's [`Error`].
pub type Result<T> = std::result::Result<T, Error>;

/// Why a call could not give its result.
///
/// Every variant but [`Cancelled`](Error::Cancelled) says the place (a file, with `file: prim or node` where one is
/// known) and a message that ends in what a person can do.
#[derive(Debug)]
pub enum Error {
    /// The input is sound but asks for something that is not implemented.
    Unsupported { place: String, message: String },
    /// The input or a setting is wrong.
    Invalid { place: String, message: String },
    /// The operating system refused a file operation.
    Io { place: String, source: std::io::Error },
    /// The caller asked to stop.
    Cancelled,
    /// So many parts of the work are to be brought from other machines.
    Awaited { parts: usize, of: usize },
}

impl Error {
    /// An [`Error::Invalid`] at `place`.
    pub fn invalid(place: impl fmt::Display, message: impl fmt::Display) -> Self {
        Self::Invalid { place: place.to_string(), message: message.to_string() }
    }

    /// An [`Error::Unsupported`] at `place`.
    pub fn unsupported(place: impl fmt::Display, message: impl fmt::Display) -> Self {
        Self::Unsupported { place: place.to_string(), message: message.to_string() }
    }

    /// An [`Error::Io`] at the file `path`.
    pub fn io(path: &Path, source: std::io::Error) -> Self {
        Self::Io { place: path.display().to_string(), source }
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unsupported { place, message } | Self::Invalid { place, message } => write!(f, "{place}: {message}"),
            Self::Io { place, source } => write!(f, "{place}: {source}"),
            Self::Cancelled => f.write_str("interrupted"),
            Self::Awaited { parts, of } => write!(
                f,
                "{parts} of {of} parts are other shards': bring the cache folders of all shards together, and run this again"
            ),
        }
    }
}

impl std::error::Error for Error {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Self::Io { source, .. } => Some(source),
            _ => None,
        }
    }
}

/// Something that was met, and skipped or replaced. It goes into the report; it is never silent.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Warning {
    /// What happened and what was done instead.
    pub message: String,
    /// The first places where it was met (prim or node paths, files).
    pub places: Vec<String>,
    /// How often it was met in all.
    pub count: usize,
    /// It is about input that is missing or can't be read.
    #[serde(skip)]
    pub is_missing: bool,
}

/// The warnings of a run, equal messages counted together in the order of their first appearance.
#[derive(Clone, Debug, Default, serde::Serialize)]
#[serde(transparent)]
pub struct Warnings(Vec<Warning>);

impl Warnings {
    /// Places kept per message; further ones only count.
    const PLACES: usize = 8;

    /// Counts `message` at `place`.
    pub fn add(&mut self, place: impl fmt::Display, message: impl fmt::Display) {
        self.count(place, message, false);
    }

    /// Counts `message` at `place`, where input is missing or can't be read.
    pub fn add_missing(&mut self, place: impl fmt::Display, message: impl fmt::Display) {
        self.count(place, message, true);
    }

    fn count(&mut self, place: impl fmt::Display, message: impl fmt::Display, is_missing: bool) {
        let message = message.to_string();
        let warning = match self.0.iter_mut().position(|w| w.message == message) {
            Some(i) => &mut self.0[i],
            None => {
                self.0.push(Warning { message, places: Vec::new(), count: 0, is_missing });
                self.0.last_mut().expect("just pushed")
            }
        };
        warning.count += 1;
        if warning.places.len() < Self::PLACES {
            warning.places.push(place.to_string());
        }
    }

    /// Appends the warnings of another stage; what was said of a place before is not said again.
    pub fn extend(&mut self, other: Warnings) {
        for warning in other.0 {
            match self.0.iter_mut().find(|w| w.message == warning.message) {
                None => self.0.push(warning),
                Some(known) if known.places == warning.places && known.count == warning.count => {}
                Some(known) => {
                    known.count += warning.count;
                    let room = Self::PLACES.saturating_sub(known.places.len());
                    known.places.extend(warning.places.into_iter().take(room));
                }
            }
        }
    }

    /// The warnings in order.
    pub fn iter(&self) -> impl Iterator<Item = &Warning> {
        self.0.iter()
    }

    /// True where nothing was met.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}
