//! Quantities as people write them in profiles.

use std::time::Duration;

use serde::Deserialize;
use serde::de::{Deserializer, Error, Unexpected};

/// The longest time of a network, so that times can be added up.
const LONGEST: Duration = Duration::from_secs(365 * 24 * 3600);

/// A duration such as `5us` or `1ms 500us`; for serde's `deserialize_with`.
pub(crate) fn duration<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Duration, D::Error> {
    let text = String::deserialize(deserializer)?;
    humantime::parse_duration(&text).ok().filter(|duration| *duration <= LONGEST).ok_or_else(|| {
        let expected = "a duration such as \"20ms\" or \"5us\", a year at most";
        D::Error::invalid_value(Unexpected::Str(&text), &expected)
    })
}
