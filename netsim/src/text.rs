//! Quantities as people write them in profiles.

/// A duration such as `5us` or `1ms 500us`; for serde's `with`.
pub(crate) mod duration {
    use std::time::Duration;

    use serde::de::{Deserializer, Error, Unexpected};
    use serde::{Deserialize, Serializer};

    pub(crate) fn serialize<S: Serializer>(duration: &Duration, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(&humantime::format_duration(*duration))
    }

    pub(crate) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Duration, D::Error> {
        let text = String::deserialize(deserializer)?;
        humantime::parse_duration(&text).map_err(|_| {
            D::Error::invalid_value(Unexpected::Str(&text), &"a duration such as \"20ms\" or \"5us\"")
        })
    }
}
