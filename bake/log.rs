//! The library's log (`tracing` events) to stderr, where LUMEL_LOG or RUST_LOG asks for it.

use super::args::{ConsoleArgs, LogFormat};
use super::failure::Failure;
use lumel::Error;
use serde_json::{Map, Value};
use std::fmt;
use tracing::field::{Field, Visit};
use tracing::{Event, Subscriber};
use tracing_subscriber::EnvFilter;
use tracing_subscriber::fmt::format::Writer;
use tracing_subscriber::fmt::{FmtContext, FormatEvent, FormatFields};
use tracing_subscriber::registry::LookupSpan;

/// The filter that the environment asks for, with the name of its variable.
pub fn filter() -> Option<(&'static str, String)> {
    let set = |name: &'static str| std::env::var(name).ok().filter(|v| !v.is_empty()).map(|v| (name, v));
    set("LUMEL_LOG").or_else(|| set("RUST_LOG"))
}

/// Starts the log.
///
/// # Errors
/// `Usage` where the filter can't be read.
pub fn start(args: &ConsoleArgs) -> Result<(), Failure> {
    let Some((name, text)) = filter() else { return Ok(()) };
    let filter = EnvFilter::try_new(&text).map_err(|e| Failure::Usage(Error::invalid(name, format!("{text}: {e}"))))?;
    let log = tracing_subscriber::fmt().with_env_filter(filter).with_writer(std::io::stderr);
    // A second subscriber can't be set; there is only this one.
    let _ = match args.log_format {
        Some(LogFormat::Json) => tracing::subscriber::set_global_default(log.event_format(JsonLines).finish()),
        _ => tracing::subscriber::set_global_default(log.without_time().finish()),
    };
    Ok(())
}

/// One JSON object an event, shaped as the progress lines are: `{"event":"log","level":...,"target":...,"message":...}`.
struct JsonLines;

impl<S, N> FormatEvent<S, N> for JsonLines
where
    S: Subscriber + for<'a> LookupSpan<'a>,
    N: for<'a> FormatFields<'a> + 'static,
{
    fn format_event(&self, _: &FmtContext<'_, S, N>, mut writer: Writer<'_>, event: &Event<'_>) -> fmt::Result {
        let mut fields = Fields(Map::new());
        fields.0.insert("event".into(), "log".into());
        fields.0.insert("level".into(), event.metadata().level().as_str().to_lowercase().into());
        fields.0.insert("target".into(), event.metadata().target().into());
        event.record(&mut fields);
        writeln!(writer, "{}", Value::Object(fields.0))
    }
}

/// The fields of an event as JSON values.
struct Fields(Map<String, Value>);

impl Visit for Fields {
    fn record_debug(&mut self, field: &Field, value: &dyn fmt::Debug) {
        self.0.insert(field.name().into(), format!("{value:?}").into());
    }
    fn record_str(&mut self, field: &Field, value: &str) {
        self.0.insert(field.name().into(), value.into());
    }
    fn record_u64(&mut self, field: &Field, value: u64) {
        self.0.insert(field.name().into(), value.into());
    }
    fn record_i64(&mut self, field: &Field, value: i64) {
        self.0.insert(field.name().into(), value.into());
    }
    fn record_f64(&mut self, field: &Field, value: f64) {
        self.0.insert(field.name().into(), value.into());
    }
    fn record_bool(&mut self, field: &Field, value: bool) {
        self.0.insert(field.name().into(), value.into());
    }
}
