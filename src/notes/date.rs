//! Dates of notes, as XML Schema writes them (`xs:dateTime`).

use std::{fmt, str::FromStr, time::SystemTime};

use serde::{Deserialize, Serialize};
use thiserror::Error;
use time::{OffsetDateTime, format_description::well_known::Rfc3339};

/// The longest text.
const LONGEST: usize = 40;

/// A day and a time, such as `2026-11-30T13:05:00Z` or `2015-03-23T10:59:26.5+01:00`. The text stays as it
/// was read.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Date(String);

/// A text is no date.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("give a day and a time, such as 2026-11-30T13:05:00Z")]
pub struct DateError;

impl Date {
    /// This moment, in UTC, to the millisecond.
    #[must_use]
    pub fn of(moment: SystemTime) -> Self {
        Self(humantime::format_rfc3339_millis(moment).to_string())
    }

    /// The text.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl FromStr for Date {
    type Err = DateError;

    fn from_str(text: &str) -> Result<Self, DateError> {
        if is_date(text) { Ok(Self(text.to_owned())) } else { Err(DateError) }
    }
}

impl TryFrom<String> for Date {
    type Error = DateError;

    fn try_from(text: String) -> Result<Self, DateError> {
        text.parse()
    }
}

impl From<Date> for String {
    fn from(date: Date) -> Self {
        date.0
    }
}

impl fmt::Display for Date {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

/// As in RFC 3339, with a `T` between day and time, and also without a zone.
fn is_date(text: &str) -> bool {
    let is_moment = |text: &str| OffsetDateTime::parse(text, &Rfc3339).is_ok();
    text.len() <= LONGEST
        && text.as_bytes().get("2026-11-30".len()) == Some(&b'T')
        && !text.ends_with('z')
        && (is_moment(text) || is_moment(&format!("{text}Z")))
}

#[cfg(test)]
mod tests {
    use std::time::{Duration, UNIX_EPOCH};

    use proptest::prelude::*;

    use super::*;

    #[test]
    fn dates_of_other_tools_are_read_and_other_texts_are_not() {
        for good in [
            "2026-11-30T13:05:00Z",
            "2015-03-23T10:59:26+01:00",
            "2021-02-17T09:15:35.610Z",
            "2021-02-17T09:15:35.6104832-11:30",
            "2021-02-17T23:59:59",
        ] {
            assert_eq!(good.parse::<Date>().map(String::from).as_deref(), Ok(good));
        }
        for bad in [
            "",
            "2026-11-30",
            "2026-11-30 13:05:00Z",
            "2026-13-30T13:05:00Z",
            "2026-11-00T13:05:00Z",
            "2026-02-30T13:05:00Z",
            "2026-11-30t13:05:00Z",
            "2026-11-30T13:05:00z",
            "2026-11-30T13:60:00Z",
            "2026-11-30T13:05:61Z",
            "2026-11-30T13:05:00+24:00",
            "2026-11-30T13:05:00+01:60",
            "2026-11-30T24:05:00Z",
            "2026-11-30T13:05:0Z",
            "2026-11-30T13:05:00.Z",
            "2026-11-30T13:05:00+1:00",
            "2026-11-30T13:05:00+01:00Z",
            "2026-11-30T13:05:00Z\u{0}",
            "+026-11-30T13:05:00Z",
            "2026-11-30T13:05:00.0000000000000000000000Z",
        ] {
            assert_eq!(bad.parse::<Date>(), Err(DateError), "{bad}");
        }
    }

    #[test]
    fn now_is_a_date() {
        let date = Date::of(UNIX_EPOCH + Duration::from_secs(1_796_043_900));
        assert_eq!(date.as_str(), "2026-11-30T13:05:00.000Z");
        assert_eq!(date.as_str().parse(), Ok(date));
    }

    proptest! {
        #[test]
        fn no_text_panics(text in any::<String>(), like in "[0-9T:.Z+-]{0,45}") {
            let _read = (text.parse::<Date>(), like.parse::<Date>());
        }
    }
}
