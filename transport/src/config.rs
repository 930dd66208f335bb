//! Values of options that have a range, as a configuration file gives them.

use std::fmt::Display;
use std::ops::RangeInclusive;
use std::time::Duration;

use serde::Deserializer;
use serde::de::{DeserializeOwned, Error};

/// A value within `range`.
fn within<'de, D, T>(deserializer: D, range: &RangeInclusive<T>) -> Result<T, D::Error>
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

/// A count of one at least.
pub(crate) fn above_zero<'de, D: Deserializer<'de>>(deserializer: D) -> Result<u32, D::Error> {
    within(deserializer, &(1..=u32::MAX))
}

/// The time after which a silent peer counts as lost.
pub(crate) mod idle_timeout_s {
    pub(crate) use trimaran_net::config::seconds::serialize;

    use super::{Deserializer, Duration, within};

    pub(crate) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Duration, D::Error> {
        within(deserializer, &(0.1..=86_400.0)).map(Duration::from_secs_f64)
    }
}

#[cfg(feature = "udp")]
pub(crate) mod udp {
    //! What holds for datagrams.

    use super::{Deserializer, within};

    pub(crate) fn repair_percent<'de, D: Deserializer<'de>>(deserializer: D) -> Result<u8, D::Error> {
        within(deserializer, &(1..=100))
    }

    pub(crate) fn initial_window<'de, D: Deserializer<'de>>(deserializer: D) -> Result<u16, D::Error> {
        within(deserializer, &(2..=100))
    }

    pub(crate) fn max_datagram<'de, D: Deserializer<'de>>(deserializer: D) -> Result<usize, D::Error> {
        within(deserializer, &(crate::udp::MIN_DATAGRAM..=crate::udp::MAX_DATAGRAM))
    }

    /// How long after its end a frame may arrive.
    pub(crate) mod deadline_ms {
        use serde::{Serialize, Serializer};

        use super::super::{Duration, within};
        use super::Deserializer;

        pub(crate) fn serialize<S: Serializer>(time: &Duration, serializer: S) -> Result<S::Ok, S::Error> {
            (time.as_secs_f64() * 1e3).serialize(serializer)
        }

        pub(crate) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Duration, D::Error> {
            within(deserializer, &(0.001..=86_400_000.0)).map(|ms| Duration::from_secs_f64(ms / 1e3))
        }
    }
}

/// The permissions of a socket's file: as text three octal digits, or four with a zero in front.
#[cfg(feature = "unix")]
pub(crate) mod file_mode {
    use serde::{Deserialize, Serializer};

    use super::{Deserializer, Error};

    #[expect(clippy::trivially_copy_pass_by_ref, reason = "as serde calls it")]
    pub(crate) fn serialize<S: Serializer>(mode: &u32, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(&format_args!("{mode:03o}"))
    }

    pub(crate) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<u32, D::Error> {
        let text = String::deserialize(deserializer)?;
        let digits = text.strip_prefix('0').filter(|rest| rest.len() == 3).unwrap_or(&text);
        let octal = digits.len() == 3 && digits.bytes().all(|digit| (b'0'..=b'7').contains(&digit));
        let mode = u32::from_str_radix(digits, 8).ok().filter(|_| octal);
        mode.ok_or_else(|| {
            let why = "is no file mode: give three octal digits in quotes, such as \"600\" or \"660\"";
            D::Error::custom(format_args!("{text:?} {why}"))
        })
    }
}

#[cfg(all(test, feature = "unix"))]
mod tests {
    use serde::de::IntoDeserializer;
    use serde::de::value::{Error, StrDeserializer};

    use super::*;

    #[test]
    fn a_file_mode_is_three_octal_digits() {
        let read = |text: &'static str| {
            let text: StrDeserializer<'_, Error> = text.into_deserializer();
            file_mode::deserialize(text)
        };
        for (text, mode) in [("600", 0o600), ("0660", 0o660), ("007", 0o007)] {
            assert_eq!(read(text), Ok(mode), "{text}");
        }
        for text in ["", "60", "0600 ", "1600", "800", "0o600", "+60", "00600"] {
            let error = read(text).unwrap_err().to_string();
            assert!(error.contains("three octal digits"), "{error}");
        }
    }
}
