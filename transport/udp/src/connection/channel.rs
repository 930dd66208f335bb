//! The lanes of a connection by name: its own, and those of channels.

use trimaran_wire::{ChannelNumber, Format};

use super::units::Units;
use super::{Config, Connection};
use crate::chunk::UnitLane;
use crate::latest::{LatestIn, LatestOut};

/// A channel in both directions: of values or of frames, by its declaration. The other part stays idle.
#[derive(Debug)]
pub(super) struct Channel {
    pub(super) units: Units,
    /// Whether its declaration allows coded batches.
    pub(super) may_be_coded: bool,
    pub(super) latest_out: LatestOut,
    pub(super) latest_in: LatestIn,
}

impl Channel {
    /// All channels of a connection.
    pub(super) fn all(config: &Config) -> Vec<Self> {
        let channels = (0..).zip(config.format.channels);
        channels
            .map(|(number, channel)| {
                let (number, format) = (ChannelNumber(number), Format::of_channel(channel));
                let may_be_coded = channel.count_coded().is_some();
                let config = Config { format, coded: config.coded && may_be_coded, ..*config };
                Self {
                    may_be_coded,
                    units: Units::frames(UnitLane::Channel(number), &config),
                    latest_out: LatestOut::of(number),
                    latest_in: LatestIn::new(format),
                }
            })
            .collect()
    }
}

/// A channel that the connection does not have means its own lane: chunks about one are refused before.
impl Connection {
    pub(super) fn units(&self, lane: UnitLane) -> &Units {
        match lane {
            UnitLane::Frames => &self.frames,
            UnitLane::Messages => &self.messages,
            UnitLane::Bulk => &self.bulk,
            UnitLane::Channel(number) => {
                self.channels.get(number.index()).map_or(&self.frames, |channel| &channel.units)
            }
        }
    }

    pub(super) fn units_mut(&mut self, lane: UnitLane) -> &mut Units {
        match lane {
            UnitLane::Frames => &mut self.frames,
            UnitLane::Messages => &mut self.messages,
            UnitLane::Bulk => &mut self.bulk,
            UnitLane::Channel(number) => match self.channels.get_mut(number.index()) {
                Some(channel) => &mut channel.units,
                None => &mut self.frames,
            },
        }
    }

    /// The lanes of frames: the connection's own, and those of channels.
    pub(super) fn frame_lanes(&self) -> impl Iterator<Item = &Units> {
        [&self.frames].into_iter().chain(self.channels.iter().map(|channel| &channel.units))
    }

    pub(super) fn frame_lanes_mut(&mut self) -> impl Iterator<Item = &mut Units> {
        [&mut self.frames].into_iter().chain(self.channels.iter_mut().map(|channel| &mut channel.units))
    }

    /// The sending sides of values: the connection's own, and those of channels.
    pub(super) fn values_out(&self) -> impl Iterator<Item = &LatestOut> {
        [&self.latest_out].into_iter().chain(self.channels.iter().map(|channel| &channel.latest_out))
    }

    pub(super) fn values_out_mut(&mut self) -> impl Iterator<Item = &mut LatestOut> {
        [&mut self.latest_out]
            .into_iter()
            .chain(self.channels.iter_mut().map(|channel| &mut channel.latest_out))
    }

    pub(super) fn latest_out(&self, channel: Option<ChannelNumber>) -> &LatestOut {
        let of_channel = channel.and_then(|number| self.channels.get(number.index()));
        of_channel.map_or(&self.latest_out, |channel| &channel.latest_out)
    }

    pub(super) fn latest_out_mut(&mut self, channel: Option<ChannelNumber>) -> &mut LatestOut {
        match channel.and_then(|number| self.channels.get_mut(number.index())) {
            Some(channel) => &mut channel.latest_out,
            None => &mut self.latest_out,
        }
    }

    pub(super) fn latest_in(&self, channel: Option<ChannelNumber>) -> &LatestIn {
        let of_channel = channel.and_then(|number| self.channels.get(number.index()));
        of_channel.map_or(&self.latest_in, |channel| &channel.latest_in)
    }

    pub(super) fn latest_in_mut(&mut self, channel: Option<ChannelNumber>) -> &mut LatestIn {
        match channel.and_then(|number| self.channels.get_mut(number.index())) {
            Some(channel) => &mut channel.latest_in,
            None => &mut self.latest_in,
        }
    }
}
