//! What whoever may see a scene knows: a part of the page's address.

use std::{fmt, io, str::FromStr};

use serde::{Deserialize, Serialize};
use thiserror::Error;
use trimaran_transport::Net;

/// The fewest characters: 16 of 64 kinds are 96 bits.
const SHORTEST: usize = 16;
const LONGEST: usize = 128;

/// A secret in the address of a page: 16 to 128 letters, digits, hyphens and underscores.
#[derive(Clone, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Token(String);

/// A text is no token.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("a token has {SHORTEST} to {LONGEST} letters, digits, hyphens and underscores")]
pub struct TokenError;

impl Token {
    /// A token that nobody can guess: 128 random bits.
    ///
    /// # Errors
    /// When the system has no randomness to give.
    pub fn random(net: &dyn Net) -> io::Result<Self> {
        Ok(Self(format!("{:016x}{:016x}", net.random()?, net.random()?)))
    }

    /// The token as text.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }

    /// Whether `text` is this token. How long that takes says nothing of how much of it is right.
    pub(super) fn is(&self, text: &str) -> bool {
        let differs = self.0.bytes().zip(text.bytes()).fold(0, |differs, (a, b)| differs | (a ^ b));
        self.0.len() == text.len() && differs == 0
    }
}

/// It is not told to logs.
impl fmt::Debug for Token {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Token")
    }
}

impl FromStr for Token {
    type Err = TokenError;

    fn from_str(text: &str) -> Result<Self, TokenError> {
        let is_plain = text.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'-' || b == b'_');
        let fits = (SHORTEST..=LONGEST).contains(&text.len());
        if is_plain && fits { Ok(Self(text.to_owned())) } else { Err(TokenError) }
    }
}

impl TryFrom<String> for Token {
    type Error = TokenError;

    fn try_from(text: String) -> Result<Self, TokenError> {
        text.parse()
    }
}

impl From<Token> for String {
    fn from(token: Token) -> Self {
        token.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_token_is_long_enough_and_needs_no_quoting_in_an_address() {
        let token: Token = "0123456789abcdef".parse().unwrap();
        for other in ["", "0123456789abcde", "0123456789abcdef0", "1123456789abcdef", "0123456789abcdeg"] {
            assert!(!token.is(other), "{other}");
        }
        assert!(token.is("0123456789abcdef"));
        for bad in ["", "0123456789abcde", "0123456789abcd/f", "0123456789abcdé", &"a".repeat(129)] {
            assert_eq!(bad.parse::<Token>().unwrap_err(), TokenError, "{bad}");
        }
        assert_eq!(format!("{token:?}"), "Token");
    }
}
