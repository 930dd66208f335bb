//! Quantities as people write them in profiles.

/// A duration such as `5us` or `1ms 500us`; for serde's `with`.
pub(crate) mod duration {
    use std::time::Duration;

    use serde::de::{Deserializer, Error, Unexpected};
    use serde::{Deserialize, Serializer};

    /// No time of a network is longer; so times can be added up.
    const LONGEST: Duration = Duration::from_secs(365 * 24 * 3600);

    pub(crate) fn serialize<S: Serializer>(duration: &Duration, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(&humantime::format_duration(*duration))
    }

    pub(crate) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Duration, D::Error> {
        let text = String::deserialize(deserializer)?;
        humantime::parse_duration(&text).ok().filter(|duration| *duration <= LONGEST).ok_or_else(|| {
            let expected = "a duration such as \"20ms\" or \"5us\", a year at most";
            D::Error::invalid_value(Unexpected::Str(&text), &expected)
        })
    }
}
