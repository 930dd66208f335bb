//! The log on standard error: for people, for systemd's journal, or as JSON.

use std::{env, fmt, io, os::fd::AsFd, os::unix::fs::MetadataExt, sync::OnceLock};

use tracing::{Event, Level, Subscriber};
use tracing_subscriber::{
    EnvFilter,
    fmt::{
        FmtContext, FormatEvent, FormatFields,
        format::{Format, Full, Writer},
    },
    registry::LookupSpan,
    reload,
};

use super::{Failure, terminal};

/// The target of messages that people see whatever they log: a line that begins with the program's name.
pub(super) const SAID: &str = "trimaran::said";

/// The log of this process, once there is one.
static LOG: OnceLock<Log> = OnceLock::new();

struct Log {
    /// The level without a configured one.
    usual: &'static str,
    /// Flags have said what to log.
    is_given: bool,
    /// Uses another filter.
    use_filter: Box<dyn Fn(EnvFilter) -> Result<(), reload::Error> + Send + Sync>,
}

/// Sends the log to standard error: the `usual` level, and more for each `-v`; `TRIMARAN_LOG` overrides.
/// `TRIMARAN_LOG_FORMAT=json` makes each line an object. A stream to the journal has priorities instead of
/// times (sd-daemon(3)), and an event is a line.
///
/// # Errors
/// If the format is unknown.
pub(super) fn to_stderr(verbose: u8, usual: &'static str) -> Result<(), Failure> {
    let level = match verbose {
        0 => usual,
        1 => "info",
        2 => "debug",
        _ => "trace",
    };
    let filter = EnvFilter::try_from_env("TRIMARAN_LOG").unwrap_or_else(|_| EnvFilter::new(level));
    let log = tracing_subscriber::fmt().with_env_filter(with_said(filter)?);
    // If standard error is closed, a message about that would panic in the task that logs.
    let log = log.log_internal_errors(false);
    // Colours are control characters, which only the terminal's own module may send.
    let log = log.with_ansi(false).with_writer(terminal::stderr);
    let format = Format::default().with_target(false);
    let use_filter: Box<dyn Fn(EnvFilter) -> Result<(), reload::Error> + Send + Sync>;
    match env::var("TRIMARAN_LOG_FORMAT").as_deref() {
        Ok("json") => {
            let log = log.json().with_target(false).with_filter_reloading();
            let handle = log.reload_handle();
            use_filter = Box::new(move |filter| handle.reload(filter));
            log.init();
        }
        Ok("text") | Err(_) => {
            let line = match is_journal() {
                true => Line::Journal(format.without_time().with_level(false)),
                false => Line::ForPeople(format),
            };
            let log = log.event_format(line).with_filter_reloading();
            let handle = log.reload_handle();
            use_filter = Box::new(move |filter| handle.reload(filter));
            log.init();
        }
        Ok(other) => {
            return Err(Failure::bad_input(format!(
                "TRIMARAN_LOG_FORMAT is {other:?}: it may be json or text"
            )));
        }
    }
    let _only_once = LOG.set(Log { usual, is_given: verbose > 0, use_filter });
    Ok(())
}

/// The filter of the log from now on, as configured; without it the usual level. Flags have the last word.
#[derive(Debug)]
pub(super) struct Filter(EnvFilter);

impl Filter {
    /// # Errors
    /// If `configured` is no filter.
    pub(super) fn new(configured: Option<&str>) -> Result<Self, Failure> {
        let usual = LOG.get().map_or("warn", |log| log.usual);
        let filter = EnvFilter::try_new(configured.unwrap_or(usual));
        let invalid =
            |error| format!("log: {error}: give a level such as info, or a filter such as trimaran=debug");
        with_said(filter.map_err(|error| Failure::bad_input(invalid(error)))?).map(Self)
    }

    pub(super) fn set(self) {
        let Some(log) = LOG.get().filter(|log| !log.is_given) else { return };
        if let Err(error) = (log.use_filter)(self.0) {
            tracing::warn!(target: SAID, "logs as before: {error}");
        }
    }
}

/// With the messages that people see whatever they log.
fn with_said(filter: EnvFilter) -> Result<EnvFilter, Failure> {
    Ok(filter.add_directive(format!("{SAID}=info").parse().map_err(Failure::broken)?))
}

/// Whether standard error is the stream to systemd's journal: systemd.exec(5), `JOURNAL_STREAM`.
pub(super) fn is_journal() -> bool {
    let Ok(stream) = env::var("JOURNAL_STREAM") else { return false };
    let file = io::stderr().as_fd().try_clone_to_owned().map(std::fs::File::from);
    let Ok(about) = file.and_then(|file| file.metadata()) else { return false };
    stream == format!("{}:{}", about.dev(), about.ino())
}

/// How an event is written.
enum Line {
    /// As tracing prints it; messages that all people see have only the program's name before them.
    ForPeople(Format<Full>),
    /// In one line, with its priority.
    Journal(Format<Full, ()>),
}

impl<S: Subscriber + for<'a> LookupSpan<'a>, N: for<'a> FormatFields<'a> + 'static> FormatEvent<S, N>
    for Line
{
    fn format_event(
        &self,
        context: &FmtContext<'_, S, N>,
        mut writer: Writer<'_>,
        event: &Event<'_>,
    ) -> fmt::Result {
        match self {
            Self::ForPeople(_) if event.metadata().target() == SAID => {
                writer.write_str("trimaran: ")?;
                context.format_fields(writer.by_ref(), event)?;
                writer.write_char('\n')
            }
            Self::ForPeople(format) => format.format_event(context, writer, event),
            Self::Journal(format) => {
                let mut text = String::new();
                format.format_event(context, Writer::new(&mut text), event)?;
                let lines: Vec<&str> = text.lines().map(str::trim).filter(|line| !line.is_empty()).collect();
                writeln!(writer, "<{}>{}", priority(*event.metadata().level()), lines.join(" "))
            }
        }
    }
}

/// Of syslog(3).
const fn priority(level: Level) -> u8 {
    match level {
        Level::ERROR => 3,
        Level::WARN => 4,
        Level::INFO => 6,
        _ => 7,
    }
}
