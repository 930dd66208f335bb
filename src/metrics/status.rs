//! The state of a process in short, for `trimaran status` and `trimaran stat`.

use serde::{Deserialize, Serialize};

use super::{Metrics, TurnedAwayReading};

/// A process's state, as `/status` tells it.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct StatusReading {
    /// The program's version.
    pub version: String,
    /// The process's role.
    pub role: String,
    /// Whether scene, device and sockets are open.
    pub ready: bool,
    /// The scene, once it is open.
    pub scene: Option<SceneReading>,
    /// The name of the device.
    pub device: Option<String>,
    /// Sessions that go on.
    pub sessions: u64,
    /// Sessions that have begun.
    pub sessions_total: u64,
    /// Links to peers.
    pub links: u64,
    /// How many links it should have: the most guests of a service, the cullers of a display.
    pub places: Option<u64>,
    /// Frames culled here.
    pub frames_culled: u64,
    /// Frames whose ids another session had found.
    pub frames_shared: u64,
    /// Frames shown.
    pub frames_shown: u64,
    /// How often a culler was late.
    pub late: u64,
    /// Of the frames shown.
    pub latency: LatencyReading,
    /// Peers turned away, by limit.
    pub turned_away: TurnedAwayReading,
}

/// A scene.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SceneReading {
    /// The file's name.
    pub name: String,
    /// The fingerprint that peers compare.
    pub fingerprint: String,
    /// Triangles at full detail.
    pub triangles: u64,
    /// Objects.
    pub objects: u64,
}

/// The time from a frame's camera to its picture.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct LatencyReading {
    /// How many frames it is of.
    pub frames: u64,
    /// Its sum over them, seconds.
    pub seconds: f64,
}

impl LatencyReading {
    /// The mean of the frames since `before`, milliseconds; none without frames.
    #[must_use]
    pub fn mean_ms_since(&self, before: &Self) -> Option<f64> {
        let frames = self.frames.checked_sub(before.frames).filter(|frames| *frames > 0)?;
        Some(1e3 * (self.seconds - before.seconds) / frames as f64)
    }
}

/// The state in a word, as monitoring plugins tell it (Monitoring Plugins Development Guidelines).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Status {
    /// All is well.
    Ok,
    /// It works, but less well than it should.
    Warning,
    /// It does not work.
    Critical,
    /// Nothing is known.
    Unknown,
}

impl Status {
    /// The word.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Ok => "OK",
            Self::Warning => "WARNING",
            Self::Critical => "CRITICAL",
            Self::Unknown => "UNKNOWN",
        }
    }

    /// The exit code of a plugin.
    #[must_use]
    pub const fn exit_code(self) -> u8 {
        match self {
            Self::Ok => 0,
            Self::Warning => 1,
            Self::Critical => 2,
            Self::Unknown => 3,
        }
    }
}

impl StatusReading {
    /// The state, and its reason in a few words.
    #[must_use]
    pub fn judged(&self) -> (Status, String) {
        let Self { role, links, places, .. } = self;
        let is_display = ["display", "watcher"].contains(&role.as_str());
        if !self.ready {
            return (Status::Critical, format!("the {role} is not ready: it waits for its scene or a port"));
        }
        match places {
            Some(places) if is_display && links < places => {
                (Status::Warning, format!("{links} of {places} links are there"))
            }
            Some(places) if !is_display && links >= places => {
                (Status::Warning, format!("full: {links} of {places} places are taken"))
            }
            _ => (Status::Ok, format!("the {role} works")),
        }
    }
}

impl Metrics {
    /// The state in short.
    #[must_use]
    pub fn status(&self) -> StatusReading {
        let opened = self.0.service.get();
        let [frames_culled, frames_shared, frames_shown] = self.frames().counts();
        StatusReading {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            role: self.0.role.to_owned(),
            ready: self.is_ready(),
            scene: opened.map(|opened| opened.scene.clone()),
            device: opened.map(|opened| opened.device.clone()),
            sessions: self.sessions().running(),
            sessions_total: self.sessions().begun(),
            links: self.links().read().len() as u64,
            places: self.0.service.places().map(|places| places as u64),
            frames_culled,
            frames_shared,
            frames_shown,
            late: self.frames().times_late(),
            latency: self.frames().latency(),
            turned_away: self.links().turned_away(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_state_is_judged_by_what_is_there() {
        let reading = |role: &str, ready, links, places| StatusReading {
            role: role.to_owned(),
            ready,
            links,
            places,
            ..StatusReading::default()
        };
        for (reading, expected) in [
            (reading("culler", false, 0, None), Status::Critical),
            (reading("culler", true, 0, Some(64)), Status::Ok),
            (reading("culler", true, 64, Some(64)), Status::Warning),
            (reading("display", true, 1, Some(2)), Status::Warning),
            (reading("display", true, 2, Some(2)), Status::Ok),
            (reading("display", true, 0, Some(0)), Status::Ok),
            (reading("relay", true, 3, None), Status::Ok),
        ] {
            assert_eq!(reading.judged().0, expected, "{reading:?}");
        }
        let codes = [Status::Ok, Status::Warning, Status::Critical, Status::Unknown].map(Status::exit_code);
        assert_eq!(codes, [0, 1, 2, 3]);
    }

    #[test]
    fn latency_is_of_the_frames_in_between() {
        let at = |frames, seconds| LatencyReading { frames, seconds };
        assert_eq!(at(30, 0.9).mean_ms_since(&at(10, 0.5)), Some(20.0));
        assert_eq!(at(30, 0.9).mean_ms_since(&at(30, 0.9)), None);
        assert_eq!(at(1, 0.1).mean_ms_since(&at(30, 0.9)), None);
    }
}
