//! The source of a culler's occluders.

use std::{fmt, str::FromStr};

use thiserror::Error;

/// The visible set from which a culler draws its occluders (paper, section 3.2).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Schedule {
    /// Its own visible set of its last frame. No culler waits for another one.
    #[default]
    Independent,
    /// The paper's SWITCH: each of two cullers draws the other one's visible set, as it comes.
    Switch,
}

/// No schedule has this name.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("no schedule is called {0:?}: take independent or switch")]
pub struct UnknownSchedule(String);

impl Schedule {
    /// Every schedule.
    pub const ALL: [Self; 2] = [Self::Independent, Self::Switch];

    /// The name used on the command line, in configurations and reports.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Independent => "independent",
            Self::Switch => "switch",
        }
    }
}

impl fmt::Display for Schedule {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Schedule {
    type Err = UnknownSchedule;

    fn from_str(name: &str) -> Result<Self, UnknownSchedule> {
        let named = Self::ALL.into_iter().find(|schedule| schedule.name() == name);
        named.ok_or_else(|| UnknownSchedule(name.to_owned()))
    }
}
