//! Times in a configuration file: numbers of seconds.

use std::time::Duration;

use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// The longest time allowed: a day.
const LONGEST_S: f64 = 86_400.0;

/// A time in seconds, 0 to 86,400.
pub mod seconds {
    use super::{Deserialize, Deserializer, Duration, Error, LONGEST_S, Serialize, Serializer};

    /// Writes `time`.
    ///
    /// # Errors
    /// If the serializer fails.
    pub fn serialize<S: Serializer>(time: &Duration, serializer: S) -> Result<S::Ok, S::Error> {
        time.as_secs_f64().serialize(serializer)
    }

    /// Reads a time.
    ///
    /// # Errors
    /// If it is not a number, or outside the range.
    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Duration, D::Error> {
        let seconds = f64::deserialize(deserializer)?;
        if (0.0..=LONGEST_S).contains(&seconds) {
            Ok(Duration::from_secs_f64(seconds))
        } else {
            Err(D::Error::custom(format_args!("{seconds} is out of range: give 0 to {LONGEST_S} seconds")))
        }
    }
}

/// A time in seconds that may be switched off by 0.
pub mod seconds_or_off {
    use super::{Deserializer, Duration, Serializer, seconds};

    /// Writes `time`, none as 0.
    ///
    /// # Errors
    /// If the serializer fails.
    pub fn serialize<S: Serializer>(time: &Option<Duration>, serializer: S) -> Result<S::Ok, S::Error> {
        seconds::serialize(&time.unwrap_or_default(), serializer)
    }

    /// Reads a time, 0 as none.
    ///
    /// # Errors
    /// As [`seconds::deserialize`].
    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<Duration>, D::Error> {
        Ok(Some(seconds::deserialize(deserializer)?).filter(|time| !time.is_zero()))
    }
}
