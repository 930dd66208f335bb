//! Option values with a range, as in a configuration file.

use std::fmt::Display;
use std::ops::RangeInclusive;
use std::time::Duration;

use serde::Deserializer;
use serde::de::{DeserializeOwned, Error};

/// A value within `range`.
pub(crate) fn within<'de, D, T>(deserializer: D, range: &RangeInclusive<T>) -> Result<T, D::Error>
where
    D: Deserializer<'de>,
    T: DeserializeOwned + PartialOrd + Display,
{
    let value = T::deserialize(deserializer)?;
    if range.contains(&value) {
        return Ok(value);
    }
    let (least, most) = (range.start(), range.end());
    Err(D::Error::custom(format_args!("{value} is out of range: give {least} to {most}")))
}

/// A count of at least one.
pub(crate) fn above_zero<'de, D: Deserializer<'de>>(deserializer: D) -> Result<u32, D::Error> {
    within(deserializer, &(1..=u32::MAX))
}

/// A count of handshakes that is enough for a link: over byte streams it takes four.
pub(crate) fn of_a_link<'de, D, T>(deserializer: D) -> Result<T, D::Error>
where
    D: Deserializer<'de>,
    T: DeserializeOwned + PartialOrd + Display + From<u8>,
{
    let value = T::deserialize(deserializer)?;
    if value >= T::from(4) {
        return Ok(value);
    }
    Err(D::Error::custom(format_args!("{value} is out of range: a link takes 4, so give at least that")))
}

/// The time after which a silent peer counts as lost.
pub(crate) mod idle_timeout_s {
    pub(crate) use trimaran_net::config::seconds::serialize;

    use super::{Deserializer, Duration, within};

    pub(crate) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Duration, D::Error> {
        within(deserializer, &(0.1..=86_400.0)).map(Duration::from_secs_f64)
    }
}
