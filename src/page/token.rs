//! The secret that grants access to a scene: a part of the page's address.

use std::{
    fmt,
    fs::{self, File},
    io::{self, Read, Write},
    path::{Path, PathBuf},
    str::FromStr,
};

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

/// A text is not a valid token.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("a token has {SHORTEST} to {LONGEST} letters, digits, hyphens and underscores")]
pub struct TokenError;

/// Why there is no token in a file.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum TokenFileError {
    /// The file cannot be read.
    #[error("cannot read the token in {file}", file = file.display())]
    Read {
        /// The file.
        file: PathBuf,
        /// Why.
        #[source]
        cause: io::Error,
    },
    /// It has something else.
    #[error("{file} has no token", file = file.display())]
    Token {
        /// The file.
        file: PathBuf,
        /// Why.
        #[source]
        cause: TokenError,
    },
}

impl Token {
    /// A token that cannot be guessed: 128 random bits.
    ///
    /// # Errors
    /// When the system's random numbers fail.
    pub fn random(net: &dyn Net) -> io::Result<Self> {
        Ok(Self(format!("{:016x}{:016x}", net.random()?, net.random()?)))
    }

    /// The token in a file that only its owner may read. If there is none, a new one, which is saved there.
    ///
    /// # Errors
    /// When the file cannot be written, or the system's random numbers fail.
    pub fn kept(file: &Path, net: &dyn Net) -> io::Result<Self> {
        if let Some(token) = Self::read(file) {
            return Ok(token);
        }
        let token = Self::random(net)?;
        // Such a file has mode 600 from its beginning.
        let folder = file.parent().unwrap_or(Path::new("."));
        let mut temporary =
            tempfile::Builder::new().prefix(".trimaran-").suffix(".tmp").tempfile_in(folder)?;
        temporary.write_all(token.0.as_bytes())?;
        temporary.persist(file)?;
        Ok(token)
    }

    /// The token that is all of a file, but for white space around it.
    ///
    /// # Errors
    /// If the file cannot be read, or has something else.
    pub fn from_file(file: &Path) -> Result<Self, TokenFileError> {
        let read = fs::read_to_string(file);
        let text = read.map_err(|cause| TokenFileError::Read { file: file.to_owned(), cause })?;
        text.trim().parse().map_err(|cause| TokenFileError::Token { file: file.to_owned(), cause })
    }

    /// The token in a file, if it is valid and other users cannot read the file.
    fn read(file: &Path) -> Option<Self> {
        if !fs::symlink_metadata(file).ok()?.is_file() {
            return None;
        }
        let file = File::open(file).ok()?;
        #[cfg(unix)]
        if std::os::unix::fs::PermissionsExt::mode(&file.metadata().ok()?.permissions()) & 0o077 != 0 {
            return None;
        }
        let mut text = String::new();
        file.take(LONGEST as u64 + 1).read_to_string(&mut text).ok()?;
        text.parse().ok()
    }

    /// The token as text.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

/// Keeps it out of logs.
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
        assert_eq!(token.as_str(), "0123456789abcdef");
        for bad in ["", "0123456789abcde", "0123456789abcd/f", "0123456789abcdé", &"a".repeat(129)] {
            assert_eq!(bad.parse::<Token>().unwrap_err(), TokenError, "{bad}");
        }
        assert_eq!(format!("{token:?}"), "Token");
    }

    #[test]
    fn a_file_has_a_token_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("token");
        let read = |text: &str| {
            fs::write(&file, text).unwrap();
            Token::from_file(&file).map(String::from).map_err(|error| error.to_string())
        };
        for text in ["0123456789abcdef", "0123456789abcdef\n", " 0123456789abcdef\r\n\n"] {
            assert_eq!(read(text).as_deref(), Ok("0123456789abcdef"), "{text:?}");
        }
        for text in ["", "short", "0123456789abcdef 0123456789abcdef", "TRIMARAN_TOKEN=0123456789abcdef"] {
            let refused = read(text).unwrap_err();
            assert!(refused.contains("has no token") && !refused.contains("0123456789"), "{refused}");
        }
        fs::remove_file(&file).unwrap();
        assert!(matches!(Token::from_file(&file), Err(TokenFileError::Read { .. })));
    }

    #[cfg(unix)]
    #[tokio::test]
    async fn a_kept_token_is_the_same_until_others_could_read_it() {
        use std::os::unix::fs::PermissionsExt;

        let net = trimaran_transport::TokioNet::current().unwrap();
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("view.token");
        let kept = || Token::kept(&file, &net).unwrap().0;
        let first = kept();
        assert_eq!((kept(), fs::read_to_string(&file).unwrap()), (first.clone(), first.clone()));
        assert_eq!(fs::metadata(&file).unwrap().permissions().mode() & 0o777, 0o600);
        fs::set_permissions(&file, fs::Permissions::from_mode(0o644)).unwrap();
        let second = kept();
        assert_ne!(second, first, "somebody may have read it");
        assert_eq!(kept(), second);
        for damaged in ["", "short", &"a".repeat(1 << 20), "0123456789abcdef\n"] {
            fs::write(&file, damaged).unwrap();
            let new = kept();
            assert!(new != damaged && new == kept(), "{damaged:.20}");
        }
        assert!(Token::kept(&folder.path().join("no/folder"), &net).is_err());
    }
}
