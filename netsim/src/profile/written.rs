//! Links as written in a profile.

use std::path::{Path, PathBuf};
use std::time::Duration;

use serde::Deserialize;

use super::ProfileError;
use super::schedule::{self, WrittenDuration, WrittenPhase};
use crate::link::{Conditions, Framing, Jitter, LinkModel, Loss, Probability, QueueModel, Rate, Reorder};

/// A link as written in TOML.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields, expecting = "a table of a link's keys, such as `rate` and `delay`")]
pub(super) struct WrittenLink {
    rate: Option<Rate>,
    #[serde(default, deserialize_with = "crate::text::duration")]
    delay: Duration,
    jitter: Option<Jitter>,
    #[serde(default)]
    loss: Loss,
    #[serde(default)]
    corrupt: Probability,
    #[serde(default)]
    duplicate: Probability,
    reorder: Option<Reorder>,
    #[serde(default)]
    queue: QueueModel,
    #[serde(default = "ethernet_mtu")]
    mtu: u32,
    #[serde(default)]
    framing: Framing,
    #[serde(default)]
    phases: Vec<WrittenPhase>,
    /// A file of phases, beside the profile.
    phases_from: Option<PathBuf>,
    repeat: Option<WrittenDuration>,
}

const fn ethernet_mtu() -> u32 {
    1500
}

/// The smallest MTU of IPv4 that a host must be able to receive (RFC 791): room for every header.
const LEAST_MTU: u32 = 576;

impl WrittenLink {
    /// Reads the link at `key` in a profile; `folder` is that of the profile, if it has one.
    pub(super) fn read(
        mut self,
        profile: &str,
        key: &str,
        folder: Option<&Path>,
    ) -> Result<LinkModel, ProfileError> {
        let wrong = |(part, problem)| ProfileError::Value {
            profile: profile.to_owned(),
            key: format!("{key}.{part}"),
            problem,
        };
        if let Some(file) = &self.phases_from {
            if !self.phases.is_empty() {
                return Err(wrong(("phases_from", "cannot be beside `phases`")));
            }
            let alone =
                || wrong(("phases_from", "needs a network that is a file itself: it lies beside that"));
            let path = folder.ok_or_else(alone)?.join(file);
            self.phases = schedule::read(&path).map_err(|fault| ProfileError::Schedule {
                profile: profile.to_owned(),
                key: format!("{key}.phases_from"),
                path,
                fault,
            })?;
        }
        self.model().map_err(wrong)
    }

    /// The link, or the invalid key and its problem.
    fn model(self) -> Result<LinkModel, (&'static str, &'static str)> {
        let Self { queue, mtu, framing, phases, .. } = self;
        if mtu < LEAST_MTU {
            return Err(("mtu", "is below 576 bytes"));
        }
        if queue.packets == 0 {
            return Err(("queue.packets", "is 0: then nothing could ever be sent"));
        }
        if queue.bytes < u64::from(mtu) + 64 {
            return Err(("queue.bytes", "has no room for a packet of the link's mtu"));
        }
        if !phases.is_sorted_by(|a, b| a.at < b.at) {
            return Err(("phases", "are not in the order of their `at`"));
        }
        let repeat = self.repeat.map(|WrittenDuration(repeat)| repeat);
        if repeat.is_some_and(|repeat| phases.last().is_none_or(|last| last.at >= repeat)) {
            return Err(("repeat", "is not after the last phase"));
        }
        let conditions = Conditions {
            rate: self.rate,
            delay: self.delay,
            jitter: self.jitter,
            loss: self.loss,
            corrupt: self.corrupt,
            duplicate: self.duplicate,
            reorder: self.reorder,
        };
        let phases = phases.into_iter().map(|phase| phase.over(&conditions)).collect();
        Ok(LinkModel { conditions, phases, repeat, queue, mtu, framing })
    }
}
