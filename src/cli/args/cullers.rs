//! How many cullers there are, and how frames are dealt to them.

use clap::{Args, ValueEnum};
use trimaran_actors::Schedule;

use crate::cli::Failure;

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum ScheduleArg {
    /// Each culler's own last one: no culler waits for another one.
    Independent,
    /// The paper's SWITCH: of two cullers each draws what the other one finds, as it comes.
    Switch,
}

impl From<ScheduleArg> for Schedule {
    fn from(arg: ScheduleArg) -> Self {
        match arg {
            ScheduleArg::Independent => Self::Independent,
            ScheduleArg::Switch => Self::Switch,
        }
    }
}

/// The cullers.
#[derive(Debug, Clone, Copy, Args)]
pub(crate) struct CullerArgs {
    /// How many cullers there are. Without any the display culls for itself, as on a machine with one GPU.
    #[arg(
        long,
        value_name = "K",
        default_value_t = 2,
        value_parser = clap::value_parser!(u8).range(0..=8)
    )]
    pub(crate) cullers: u8,
    /// Which visible set cullers draw their occluders from.
    #[arg(long, value_enum, default_value = "independent")]
    pub(crate) schedule: ScheduleArg,
}

#[cfg(feature = "lab")]
/// Several numbers of cullers and several schedules, to be tried in all combinations.
#[derive(Debug, Args)]
pub(crate) struct CullerLists {
    /// How many cullers there are; without any the display culls for itself.
    #[arg(
        long,
        value_name = "K,..",
        value_delimiter = ',',
        default_value = "2",
        value_parser = clap::value_parser!(u8).range(0..=8)
    )]
    cullers: Vec<u8>,
    /// Which visible set cullers draw their occluders from; `switch` takes two, and is left out for other
    /// numbers.
    #[arg(long, value_enum, value_delimiter = ',', default_value = "independent")]
    schedule: Vec<ScheduleArg>,
}

impl CullerArgs {
    /// Whether the schedule takes so many cullers.
    pub(crate) fn check(self) -> Result<(), Failure> {
        if self.schedule == ScheduleArg::Switch && self.cullers != 2 {
            return Err(Failure::bad_input("--schedule switch takes two cullers: add --cullers 2"));
        }
        Ok(())
    }
}

#[cfg(feature = "lab")]
impl CullerLists {
    /// Every number of cullers with every schedule that takes so many; at least one.
    pub(crate) fn combinations(&self) -> Result<Vec<CullerArgs>, Failure> {
        let of = |&cullers: &u8| self.schedule.iter().map(move |&schedule| CullerArgs { cullers, schedule });
        let (fit, others): (Vec<_>, Vec<_>) =
            self.cullers.iter().flat_map(of).partition(|at| at.check().is_ok());
        match others.first() {
            Some(other) if fit.is_empty() => other.check().map(|()| fit),
            _ => Ok(fit),
        }
    }
}
