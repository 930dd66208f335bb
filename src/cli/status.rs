//! `trimaran status`: the state of a running role in a line, with the exit codes of monitoring plugins.

use std::{io::Write as _, process::ExitCode, sync::Arc, time::Duration};

use trimaran::{
    http::get_by_address,
    metrics::{Status, StatusReading},
};
use trimaran_transport::{Net, TokioNet, causes, until};

use super::{
    Failure,
    args::StatusArgs,
    printed,
    terminal::{stdout, word},
    walking,
};

/// Prints the state. Whatever it is, a plugin's line is on standard output.
pub(super) fn run(args: &StatusArgs) -> ExitCode {
    let (status, line) = match read(args) {
        Ok(reading) => told(&reading, args.json),
        Err(why) => told_of_nothing(&why, args.json),
    };
    match printed(writeln!(stdout(), "{line}")) {
        Ok(()) => ExitCode::from(status.exit_code()),
        Err(failure) => failure.exit_code(),
    }
}

/// Why there is no reading.
enum Unread {
    /// Nothing answers there.
    Silent(String),
    /// The answer is of something else, or this machine cannot ask.
    Unknown(String),
}

fn read(args: &StatusArgs) -> Result<StatusReading, Unread> {
    let unknown = |failure: Failure| Unread::Unknown(failure.to_string());
    let runtime = walking::runtime().map_err(unknown)?;
    let net: Arc<dyn Net> = Arc::new(TokioNet::new(runtime.handle().clone()));
    let (at, time) = (host_and_port(&args.at), Duration::from_secs_f64(args.timeout));
    let asked = runtime.block_on(until(&*net, net.now().after(time), get_by_address(at, "/status")));
    let body = match asked {
        Some(Ok(body)) => body,
        Some(Err(error)) => return Err(Unread::Silent(format!("{at}: {}", causes(&error)))),
        None => return Err(Unread::Silent(format!("{at} has not answered within {} s", args.timeout))),
    };
    let foreign = |error| format!("{at} is no role's --metrics: its /status cannot be read: {error}");
    serde_json::from_slice(&body).map_err(|error| Unread::Unknown(foreign(error)))
}

/// Of `http://HOST:PORT/..`, or of `HOST:PORT`.
fn host_and_port(url: &str) -> &str {
    let rest = url.strip_prefix("http://").unwrap_or(url);
    rest.split('/').next().unwrap_or(rest)
}

fn told(reading: &StatusReading, json: bool) -> (Status, String) {
    let (status, why) = reading.judged();
    if json {
        let told = serde_json::json!({ "status": status.word(), "why": why, "reading": reading });
        return (status, told.to_string());
    }
    let scene = reading.scene.as_ref().map(|scene| format!("; {}", word(&scene.name)));
    let StatusReading { sessions, sessions_total, links, late, .. } = reading;
    let StatusReading { frames_culled, frames_shared, frames_shown, .. } = reading;
    let line = format!(
        "TRIMARAN {}: {why}{} | sessions={sessions} sessions_total={sessions_total}c links={links} \
         frames_culled={frames_culled}c frames_shared={frames_shared}c frames_shown={frames_shown}c late={late}c",
        status.word(),
        scene.unwrap_or_default()
    );
    (status, line)
}

fn told_of_nothing(why: &Unread, json: bool) -> (Status, String) {
    let (status, why) = match why {
        Unread::Silent(why) => (Status::Critical, why),
        Unread::Unknown(why) => (Status::Unknown, why),
    };
    match json {
        true => (status, serde_json::json!({ "status": status.word(), "why": why }).to_string()),
        false => (status, format!("TRIMARAN {}: {why}", status.word())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_may_be_a_url() {
        for url in ["10.0.0.7:9464", "http://10.0.0.7:9464", "http://10.0.0.7:9464/metrics"] {
            assert_eq!(host_and_port(url), "10.0.0.7:9464");
        }
    }

    #[test]
    fn a_line_has_the_state_and_the_figures_that_plugins_read() {
        let reading =
            StatusReading { role: "culler".to_owned(), ready: true, sessions: 2, ..StatusReading::default() };
        let (status, line) = told(&reading, false);
        assert_eq!(status, Status::Ok);
        assert!(line.starts_with("TRIMARAN OK: the culler works | sessions=2 sessions_total=0c "), "{line}");
    }
}
