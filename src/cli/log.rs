//! The log on standard error: for people, for systemd's journal, or as JSON.

use std::{env, fmt, io, os::fd::AsFd, os::unix::fs::MetadataExt};

use tracing::{Event, Level, Subscriber};
use tracing_subscriber::{
    EnvFilter,
    fmt::{
        FmtContext, FormatEvent, FormatFields,
        format::{Format, Full, Writer},
    },
    registry::LookupSpan,
};

use super::{Failure, terminal};

/// The target of messages that people see whatever they log: a line that begins with the program's name.
pub(super) const SAID: &str = "trimaran::said";

/// Sends the log to standard error: the `usual` level, and more for each `-v`; `TRIMARAN_LOG` overrides.
/// `TRIMARAN_LOG_FORMAT=json` makes each line an object. A stream to the journal has priorities instead of
/// times (sd-daemon(3)), and an event is a line.
///
/// # Errors
/// If the format is unknown.
pub(super) fn to_stderr(verbose: u8, usual: &str) -> Result<(), Failure> {
    let level = match verbose {
        0 => usual,
        1 => "info",
        2 => "debug",
        _ => "trace",
    };
    let filter = EnvFilter::try_from_env("TRIMARAN_LOG").unwrap_or_else(|_| EnvFilter::new(level));
    let said = format!("{SAID}=info").parse().map_err(Failure::broken)?;
    let log = tracing_subscriber::fmt().with_env_filter(filter.add_directive(said));
    // If standard error is closed, a message about that would panic in the task that logs.
    let log = log.log_internal_errors(false);
    // Colours are control characters, which only the terminal's own module may send.
    let log = log.with_ansi(false).with_writer(terminal::stderr);
    let format = Format::default().with_target(false);
    match env::var("TRIMARAN_LOG_FORMAT").as_deref() {
        Ok("json") => log.json().with_target(false).init(),
        Ok("text") | Err(_) => {
            let line = match is_journal() {
                true => Line::Journal(format.without_time().with_level(false)),
                false => Line::ForPeople(format),
            };
            log.event_format(line).init();
        }
        Ok(other) => {
            return Err(Failure::bad_input(format!(
                "TRIMARAN_LOG_FORMAT is {other:?}: it may be json or text"
            )));
        }
    }
    Ok(())
}

/// Whether standard error is the stream to systemd's journal: systemd.exec(5), `JOURNAL_STREAM`.
fn is_journal() -> bool {
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
