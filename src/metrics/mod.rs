//! Figures of a running process for a monitoring system. A server on a port of its own has `/metrics` for
//! Prometheus, `/livez` and `/readyz` for probes, and `/status`, `/links` and `/listener` as JSON.
//!
//! No label names a session or a peer of a listener, so the number of series does not grow with guests. Links
//! and sessions that have ended stay counted.

mod exposition;
mod frames;
mod links;
mod path;
mod process;
mod server;
mod service;
mod sessions;
mod skipped;
mod status;
mod turned_away;

use std::{fmt, sync::Arc};

use prometheus_client::{encoding::text, metrics::info::Info, registry::Registry};

pub use frames::FrameMetrics;
pub use links::{Carried, LinkMetrics, LinkReading, Watching};
pub use path::PathReading;
pub use server::{MetricsError, Serving};
pub use service::{DeviceMemory, Opened};
pub use sessions::{RunningSession, SessionMetrics};
pub use skipped::SkippedReading;
pub use status::{LatencyReading, SceneReading, Status, StatusReading};
pub use turned_away::TurnedAwayReading;

use self::{process::Process, service::Service};

/// The figures of a process. Clones share them.
#[derive(Debug, Clone)]
pub struct Metrics(Arc<Inner>);

#[derive(Debug)]
struct Inner {
    role: &'static str,
    links: LinkMetrics,
    frames: FrameMetrics,
    sessions: SessionMetrics,
    service: Service,
    registry: Registry,
}

impl Metrics {
    /// Those of a process with this role, such as `culler`.
    #[must_use]
    pub fn new(role: &'static str) -> Self {
        Self::of(role, LinkMetrics::default())
    }

    /// The same, with links that are watched already.
    #[must_use]
    pub fn of(role: &'static str, links: LinkMetrics) -> Self {
        let (frames, sessions, service) =
            (FrameMetrics::default(), SessionMetrics::default(), Service::default());
        let mut registry = Registry::default();
        registry.register_collector(Box::new(Process));
        let ours = registry.sub_registry_with_prefix("trimaran");
        let build = Info::new([("version", env!("CARGO_PKG_VERSION")), ("role", role)]);
        ours.register("build", "The program's version and the role of this process", build);
        ours.register_collector(Box::new(service.clone()));
        frames.register(ours);
        sessions.register(ours);
        ours.sub_registry_with_prefix("link").register_collector(Box::new(links.clone()));
        Self(Arc::new(Inner { role, links, frames, sessions, service, registry }))
    }

    /// The process's links.
    #[must_use]
    pub fn links(&self) -> &LinkMetrics {
        &self.0.links
    }

    /// The frames of its roles.
    #[must_use]
    pub fn frames(&self) -> &FrameMetrics {
        &self.0.frames
    }

    /// The sessions that it serves.
    #[must_use]
    pub fn sessions(&self) -> &SessionMetrics {
        &self.0.sessions
    }

    /// Its scene and its device are open.
    pub fn opened(&self, opened: Opened) {
        self.0.service.opened(opened);
    }

    /// How many links it should have from now on: the most guests of a service, the cullers of a display.
    pub fn has_places(&self, places: usize) {
        self.0.service.has_places(places);
    }

    /// It works from now on: its sockets are open as well.
    pub fn ready(&self) {
        self.0.service.ready();
    }

    /// Whether it works.
    #[must_use]
    pub fn is_ready(&self) -> bool {
        self.0.service.is_ready()
    }

    /// All figures in Prometheus's text format.
    ///
    /// # Errors
    /// Never in practice: text is written to memory.
    pub fn text(&self) -> Result<String, fmt::Error> {
        let mut text = String::new();
        text::encode(&mut text, &self.0.registry)?;
        Ok(exposition::in_text_format(&text))
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use trimaran_actors::{RoleError, SessionObserver as _};

    use super::*;

    /// The series of a text, without their values.
    fn series(text: &str) -> BTreeSet<String> {
        let lines = text.lines().filter(|line| !line.starts_with('#'));
        lines.filter_map(|line| Some(line.rsplit_once(' ')?.0.to_owned())).collect()
    }

    fn after(sessions: u32) -> String {
        let metrics = Metrics::new("culler");
        for number in 0..sessions {
            let session = metrics.sessions().begin();
            metrics.frames().shared();
            if number % 2 == 0 {
                metrics.sessions().failed(&RoleError::Panic("a bug".to_owned()));
            }
            drop(session);
        }
        metrics.text().unwrap()
    }

    /// Names of our metrics, without the suffixes of histograms.
    fn names(text: &str) -> BTreeSet<String> {
        let words = text.split(|letter: char| !letter.is_ascii_alphanumeric() && letter != '_');
        let ours = words.filter(|word| word.starts_with("trimaran_") || word.starts_with("process_"));
        ours.map(|name| name.trim_end_matches("_bucket").to_owned()).collect()
    }

    #[tokio::test]
    async fn alerts_and_board_name_metrics_that_are_there() {
        let metrics = Metrics::of("display", links::tests::of_a_path());
        metrics.sessions().failed(&RoleError::Panic("a bug".to_owned()));
        metrics.frames().shared();
        metrics.frames().culled(&trimaran_proto::FrameStats::default());
        metrics.opened(service::tests::plant());
        metrics.has_places(64);
        let shown = names(&metrics.text().unwrap());
        let files = [
            include_str!("../../deploy/prometheus/rules.yml"),
            include_str!("../../deploy/grafana/board.json"),
        ];
        for file in files {
            let asked = names(file);
            assert!(asked.len() > 5, "{asked:?}");
            let missing: Vec<_> = asked.difference(&shown).collect();
            assert!(missing.is_empty(), "{missing:?} of {shown:?}");
        }
    }

    #[test]
    fn a_thousand_sessions_have_as_many_series_as_ten_and_are_all_counted() {
        let (ten, thousand) = (after(10), after(1000));
        assert_eq!(series(&ten), series(&thousand));
        for line in [
            "trimaran_sessions 0",
            "trimaran_sessions_total 1000",
            "trimaran_frames_total{stage=\"shared\"} 1000",
            "trimaran_errors_total{kind=\"panic\"} 500",
        ] {
            assert!(thousand.lines().any(|found| found == line), "no {line} in {thousand}");
        }
    }
}
