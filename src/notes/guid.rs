//! The identifiers of notes, replies and views.

use std::{fmt, io, str::FromStr};

use serde::{Deserialize, Serialize};
use thiserror::Error;
use trimaran_transport::Net;

/// The places of the hyphens.
const HYPHENS: [usize; 4] = [8, 13, 18, 23];
const LENGTH: usize = 36;

/// An identifier as BCF has it: 128 bits. Its text has lower-case hexadecimal digits in groups of 8, 4, 4, 4
/// and 12.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Guid(u128);

/// A text is no GUID.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("a GUID has 32 hexadecimal digits in groups of 8, 4, 4, 4 and 12")]
pub struct GuidError;

impl Guid {
    /// A new one (RFC 9562, version 4).
    ///
    /// # Errors
    /// When the system's random numbers fail.
    pub fn random(net: &dyn Net) -> io::Result<Self> {
        Ok(Self::of_bits(u128::from(net.random()?) << 64 | u128::from(net.random()?)))
    }

    /// The one with these bits, but for those that tell its version.
    const fn of_bits(bits: u128) -> Self {
        Self(bits & !(0xf << 76) & !(0x3 << 62) | 0x4 << 76 | 0x2 << 62)
    }
}

impl FromStr for Guid {
    type Err = GuidError;

    fn from_str(text: &str) -> Result<Self, GuidError> {
        let is_sound = |(at, byte): (usize, u8)| {
            if HYPHENS.contains(&at) { byte == b'-' } else { byte.is_ascii_hexdigit() }
        };
        if text.len() != LENGTH || !text.bytes().enumerate().all(is_sound) {
            return Err(GuidError);
        }
        u128::from_str_radix(&text.replace('-', ""), 16).map(Self).map_err(|_| GuidError)
    }
}

impl TryFrom<String> for Guid {
    type Error = GuidError;

    fn try_from(text: String) -> Result<Self, GuidError> {
        text.parse()
    }
}

impl From<Guid> for String {
    fn from(guid: Guid) -> Self {
        guid.to_string()
    }
}

impl fmt::Display for Guid {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(bits) = self;
        let group = |shift: u32, digits: u32| (bits >> shift) & ((1 << (4 * digits)) - 1);
        let (a, b, c, d, e) = (group(96, 8), group(80, 4), group(64, 4), group(48, 4), group(0, 12));
        write!(f, "{a:08x}-{b:04x}-{c:04x}-{d:04x}-{e:012x}")
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use proptest::prelude::*;

    use super::*;

    /// The GUID of a number, for tests.
    pub(crate) fn guid(number: u128) -> Guid {
        Guid(number)
    }

    #[test]
    fn other_tools_write_capitals_and_a_path_is_none() {
        let read = |text: &str| text.parse::<Guid>().map(|guid| guid.to_string());
        let small = "84d4a28c-0638-4813-aa4b-bcd62fe5fc93";
        assert_eq!(read("84D4A28C-0638-4813-AA4B-BCD62FE5FC93"), Ok(small.to_owned()));
        for bad in [
            "",
            "84d4a28c06384813aa4bbcd62fe5fc93",
            "{84d4a28c-0638-4813-aa4b-bcd62fe5fc93}",
            "../4a28c-0638-4813-aa4b-bcd62fe5fc93",
            "+4d4a28c-0638-4813-aa4b-bcd62fe5fc93",
            "84d4a28c-0638-4813-aa4b-bcd62fe5fc9ü",
        ] {
            assert_eq!(read(bad), Err(GuidError), "{bad}");
        }
    }

    #[test]
    fn a_new_one_has_version_4() {
        let text = Guid::of_bits(u128::MAX).to_string();
        assert_eq!(text, "ffffffff-ffff-4fff-bfff-ffffffffffff");
        assert_eq!(Guid::of_bits(0).to_string(), "00000000-0000-4000-8000-000000000000");
    }

    proptest! {
        #[test]
        fn its_text_is_read_as_it_was(bits in any::<u128>()) {
            prop_assert_eq!(Guid(bits).to_string().parse(), Ok(Guid(bits)));
        }

        #[test]
        fn no_text_panics(text in any::<String>()) {
            let _read = text.parse::<Guid>();
        }
    }
}
