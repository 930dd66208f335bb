//! Short texts on the wire.

use std::fmt;

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// A text of at most `MAX` bytes from a peer, for a person to read. Control characters are shown escaped.
#[derive(Debug, Clone, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Text<const MAX: usize>(String);

/// A text for people, such as why a peer left.
pub type Explanation = Text<200>;

/// The name of an application's protocol with its version, such as `robot/1`.
pub type ProtocolName = Text<32>;

/// A text that is too long for its kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("a text of {bytes} bytes is longer than {most}")]
pub struct TextError {
    /// Its bytes of UTF-8.
    pub bytes: usize,
    /// The limit.
    pub most: usize,
}

impl<const MAX: usize> Text<MAX> {
    /// The longest text, in bytes of UTF-8.
    pub const MAX_BYTES: usize = MAX;

    /// The text, cut after the last whole character within `MAX` bytes.
    #[must_use]
    pub fn new(text: &str) -> Self {
        Self(text[..text.floor_char_boundary(MAX)].to_owned())
    }

    /// The text as received: it may hold control characters.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl<const MAX: usize> TryFrom<String> for Text<MAX> {
    type Error = TextError;

    fn try_from(text: String) -> Result<Self, TextError> {
        if text.len() > MAX { Err(TextError { bytes: text.len(), most: MAX }) } else { Ok(Self(text)) }
    }
}

impl<const MAX: usize> From<Text<MAX>> for String {
    fn from(text: Text<MAX>) -> Self {
        text.0
    }
}

impl<const MAX: usize> fmt::Display for Text<MAX> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.0.escape_debug())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_are_cut_at_a_character_and_escaped() {
        let long = "é".repeat(150);
        let cut = Explanation::new(&long);
        assert_eq!(String::from(cut), "é".repeat(100));
        let odd = Explanation::new(&format!("x{long}"));
        assert_eq!(odd.as_str().len(), 199, "a half character does not travel");
        assert_eq!(Explanation::new("a\u{1b}[31mb").to_string(), "a\\u{1b}[31mb");
        assert_eq!(ProtocolName::new(&long).as_str(), "é".repeat(16));
    }

    #[test]
    fn a_text_from_a_peer_is_no_longer_than_its_kind() {
        assert_eq!(Explanation::try_from("x".repeat(200)).map(|text| text.as_str().len()), Ok(200));
        assert_eq!(Explanation::try_from("x".repeat(201)), Err(TextError { bytes: 201, most: 200 }));
        let name = postcard::to_stdvec(&"x".repeat(33)).unwrap();
        assert!(postcard::from_bytes::<ProtocolName>(&name).is_err());
        assert!(postcard::from_bytes::<Explanation>(&name).is_ok());
    }
}
