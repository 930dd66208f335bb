//! The systems by name, and their parts.

use std::{fmt, str::FromStr};

use clap::ValueEnum;
use serde::{Deserialize, Serialize};
use thiserror::Error;
use trimaran_actors::Schedule;

use crate::culling::CullingMethod;

/// A way to divide a frame's work among machines, and to cull.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum System {
    /// GigaWalk (paper, section 5): one pipeline draws occluders and culls on the CPU, and hands the list to
    /// another one through shared memory.
    #[value(name = "gigawalk")]
    #[serde(rename = "gigawalk")]
    GigaWalk,
    /// Distributed GigaWalk (paper, section 5): the same as an occlusion server and a display client.
    #[value(name = "distributed-gigawalk")]
    #[serde(rename = "distributed-gigawalk")]
    DistributedGigaWalk,
    /// The paper's own system: SWITCH, and its culling by hardware queries (sections 4.1 to 4.5.1).
    Paper,
    /// The schedule SWITCH (paper, section 4.3) with Trimaran's culling: of two cullers each draws what the
    /// other one finds, as it comes.
    Switch,
    /// One culler beside the display.
    #[value(name = "independent-1")]
    #[serde(rename = "independent-1")]
    Independent1,
    /// Two cullers, each by what it found itself: what `trimaran run` does.
    #[value(name = "independent-2")]
    #[serde(rename = "independent-2")]
    Independent2,
    /// Four such cullers.
    #[value(name = "independent-4")]
    #[serde(rename = "independent-4")]
    Independent4,
    /// The display culls for itself: occlusion culling in two passes, on one GPU, where that is faster.
    Alone,
    /// CHC++ (Mattausch, Bittner and Wimmer 2008) on one GPU.
    #[value(name = "chc++")]
    #[serde(rename = "chc++")]
    Chc,
    /// Levels of detail and the frustum on one GPU, and nothing else.
    Frustum,
    /// The whole model at full detail on one GPU: no levels, no culling.
    Whole,
    /// One culler that finds the exactly visible nodes with an item buffer.
    Exact,
    /// One culler that finds them by casting rays on the CPU.
    Rays,
}

/// Where the roles of a system run, when it is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// Threads of one process: they share memory.
    Threads,
    /// A process each, joined by a transport.
    Processes,
}

/// No system has this name.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("no system is called {name:?}: take {}", System::ALL.map(System::name).join(", "))]
pub struct UnknownSystem {
    name: String,
}

impl System {
    /// Every system, those of the paper first.
    pub const ALL: [Self; 13] = [
        Self::GigaWalk,
        Self::DistributedGigaWalk,
        Self::Paper,
        Self::Switch,
        Self::Independent1,
        Self::Independent2,
        Self::Independent4,
        Self::Alone,
        Self::Chc,
        Self::Frustum,
        Self::Whole,
        Self::Exact,
        Self::Rays,
    ];

    /// Those that draw the LOD cut, so that their pictures can be compared.
    pub fn of_the_cut() -> impl Iterator<Item = Self> {
        Self::ALL.into_iter().filter(|system| *system != Self::Whole)
    }

    /// The name used on the command line and in reports.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::GigaWalk => "gigawalk",
            Self::DistributedGigaWalk => "distributed-gigawalk",
            Self::Paper => "paper",
            Self::Switch => "switch",
            Self::Independent1 => "independent-1",
            Self::Independent2 => "independent-2",
            Self::Independent4 => "independent-4",
            Self::Alone => "alone",
            Self::Chc => "chc++",
            Self::Frustum => "frustum",
            Self::Whole => "whole",
            Self::Exact => "exact",
            Self::Rays => "rays",
        }
    }

    /// A description in one line.
    #[must_use]
    pub const fn about(self) -> &'static str {
        match self {
            Self::GigaWalk => {
                "the paper's GigaWalk: occluders on one pipeline, culling on the CPU, shared memory"
            }
            Self::DistributedGigaWalk => "the same as an occlusion server and a display, joined by a network",
            Self::Paper => "the paper's SWITCH and its culling: all that was visible last, hardware queries",
            Self::Switch => "two cullers, each draws what the other one finds; Trimaran's culling",
            Self::Independent1 => "one culler beside the display",
            Self::Independent2 => "two cullers, each by what it found itself: the default of `run`",
            Self::Independent4 => "four cullers, likewise",
            Self::Alone => "one GPU: occlusion culling in two passes",
            Self::Chc => "one GPU: CHC++, hardware queries that several hidden nodes share",
            Self::Frustum => "one GPU: levels of detail and the frustum, no occlusion culling",
            Self::Whole => "one GPU: the whole model at full detail, no levels, no culling",
            Self::Exact => "one culler, which finds the exactly visible nodes with an item buffer",
            Self::Rays => "one culler without a GPU, which casts a ray through each pixel",
        }
    }

    /// How its cullers cull.
    #[must_use]
    pub const fn culling(self) -> CullingMethod {
        match self {
            Self::GigaWalk | Self::DistributedGigaWalk => CullingMethod::GigaWalk,
            Self::Paper => CullingMethod::Paper,
            Self::Chc => CullingMethod::Chc,
            Self::Frustum => CullingMethod::Frustum,
            Self::Whole => CullingMethod::Whole,
            Self::Exact => CullingMethod::Exact,
            Self::Rays => CullingMethod::Rays,
            _ => CullingMethod::Trimaran,
        }
    }

    /// How many cullers it has; without any the display culls for itself.
    #[must_use]
    pub const fn cullers(self) -> u8 {
        match self {
            Self::Alone | Self::Chc | Self::Frustum | Self::Whole => 0,
            Self::Paper | Self::Switch | Self::Independent2 => 2,
            Self::Independent4 => 4,
            _ => 1,
        }
    }

    /// How frames are dealt to them.
    #[must_use]
    pub const fn schedule(self) -> Schedule {
        match self {
            Self::Paper | Self::Switch => Schedule::Switch,
            _ => Schedule::Independent,
        }
    }

    /// Where its roles run, when it is measured.
    #[must_use]
    pub const fn place(self) -> Place {
        match self {
            Self::GigaWalk | Self::Alone | Self::Chc | Self::Frustum | Self::Whole => Place::Threads,
            _ => Place::Processes,
        }
    }

    /// How many processes it is measured as.
    #[must_use]
    pub const fn processes(self) -> u8 {
        match self.place() {
            Place::Threads => 1,
            Place::Processes => 1 + self.cullers(),
        }
    }

    /// Whether this one and `other` do the same work on the same machines, so that only their links differ.
    #[must_use]
    pub fn same_work(self, other: Self) -> bool {
        let work = |system: Self| (system.culling(), system.cullers(), system.schedule());
        work(self) == work(other)
    }
}

impl fmt::Display for System {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for System {
    type Err = UnknownSystem;

    fn from_str(name: &str) -> Result<Self, UnknownSystem> {
        let known = Self::ALL.into_iter().find(|system| system.name() == name);
        known.ok_or_else(|| UnknownSystem { name: name.to_owned() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_read_back_and_are_those_of_reports_and_of_the_command_line() {
        for system in System::ALL {
            assert_eq!(system.name().parse(), Ok(system));
            assert_eq!(serde_json::to_value(system).unwrap(), system.name());
            let value = system.to_possible_value().unwrap();
            assert_eq!(value.get_name(), system.name());
        }
        let error = "gigawalks".parse::<System>().unwrap_err().to_string();
        assert!(
            error.starts_with("no system is called \"gigawalks\": take gigawalk, distributed-"),
            "{error}"
        );
    }

    #[test]
    fn only_gigawalk_and_its_distributed_form_do_the_same_work() {
        let pairs = System::ALL.iter().flat_map(|a| System::ALL.map(|b| (*a, b)));
        let same: Vec<_> = pairs.filter(|(a, b)| a != b && a.same_work(*b)).collect();
        let (giga, distributed) = (System::GigaWalk, System::DistributedGigaWalk);
        assert_eq!(same, [(giga, distributed), (distributed, giga)]);
        assert_eq!((giga.processes(), distributed.processes()), (1, 2));
    }
}
