//! Options of Unix sockets.

use trimaran_net::UnixSocketOptions;

/// Options of Unix sockets.
#[derive(Debug, Clone, PartialEq, Eq)]
#[cfg_attr(feature = "config", derive(serde::Serialize, serde::Deserialize, schemars::JsonSchema))]
#[cfg_attr(feature = "config", serde(default, deny_unknown_fields))]
#[non_exhaustive]
pub struct UnixOptions {
    /// The permissions of the socket's file. Default `0o600`: only the same user may connect.
    #[cfg_attr(feature = "config", serde(with = "file_mode"), schemars(with = "String"))]
    pub mode: u32,
    /// The users whose processes are admitted beside those of the same user, by user id. Default none.
    pub allow_uids: Vec<u32>,
    /// How many connections may wait to be accepted. Default 128.
    pub backlog: i32,
}

impl UnixOptions {
    trimaran_net::setters! {
        with_mode mode: u32,
        with_allow_uids allow_uids: Vec<u32>,
        with_backlog backlog: i32,
    }
}

impl Default for UnixOptions {
    fn default() -> Self {
        let UnixSocketOptions { mode, backlog, .. } = UnixSocketOptions::default();
        Self { mode, allow_uids: Vec::new(), backlog }
    }
}

impl UnixOptions {
    pub(super) fn socket(&self) -> UnixSocketOptions {
        UnixSocketOptions::default().with_mode(self.mode).with_backlog(self.backlog)
    }
}

/// The permissions of a socket's file: as text three octal digits, or four with a zero in front.
#[cfg(feature = "config")]
mod file_mode {
    use serde::de::Error;
    use serde::{Deserialize, Deserializer, Serializer};

    #[expect(clippy::trivially_copy_pass_by_ref, reason = "as serde calls it")]
    pub(super) fn serialize<S: Serializer>(mode: &u32, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(&format_args!("{mode:03o}"))
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<u32, D::Error> {
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

#[cfg(all(test, feature = "config"))]
mod tests {
    use serde::de::IntoDeserializer;
    use serde::de::value::{Error, StrDeserializer};

    use super::file_mode;

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
