//! A file of tokens: the people who may see a scene, each with a token, and until when.

use std::{
    fmt, fs, io,
    path::{Path, PathBuf},
    str::FromStr,
    time::{Duration, SystemTime},
};

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use thiserror::Error;
use toml::value::Datetime;

use super::Token;

/// The longest name, characters.
const LONGEST: usize = 64;
/// The hexadecimal digits of SHA-256.
const DIGITS: usize = 64;
const DAY: Duration = Duration::from_secs(24 * 60 * 60);

/// The name of a person, for the log and for other people: 1 to 64 characters.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String")]
pub struct PersonName(String);

/// A text is no name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("a name has 1 to {LONGEST} characters, no control characters, and no space at either end")]
pub struct PersonNameError;

impl PersonName {
    /// The name.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl FromStr for PersonName {
    type Err = PersonNameError;

    fn from_str(text: &str) -> Result<Self, PersonNameError> {
        let fits = (1..=LONGEST).contains(&text.chars().count());
        let is_plain = text.trim() == text && !text.chars().any(char::is_control);
        if fits && is_plain { Ok(Self(text.to_owned())) } else { Err(PersonNameError) }
    }
}

impl TryFrom<String> for PersonName {
    type Error = PersonNameError;

    fn try_from(text: String) -> Result<Self, PersonNameError> {
        text.parse()
    }
}

/// SHA-256 of a token, 64 hexadecimal digits. A token is random, so nobody finds it by its hash.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(try_from = "String")]
pub struct TokenHash(String);

/// A text is no hash.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("the SHA-256 of a token has {DIGITS} hexadecimal digits: `trimaran token new NAME` prints one")]
pub struct TokenHashError;

impl TokenHash {
    /// The hash of a token's text.
    #[must_use]
    pub fn of(token: &str) -> Self {
        Self(format!("{:x}", Sha256::digest(token.as_bytes())))
    }

    /// Compares in constant time.
    pub(super) fn is(&self, other: &Self) -> bool {
        self.0.bytes().zip(other.0.bytes()).fold(0, |differs, (a, b)| differs | (a ^ b)) == 0
    }
}

impl TryFrom<String> for TokenHash {
    type Error = TokenHashError;

    fn try_from(text: String) -> Result<Self, TokenHashError> {
        let is_hash = text.len() == DIGITS && text.bytes().all(|b| b.is_ascii_hexdigit());
        if is_hash { Ok(Self(text.to_ascii_lowercase())) } else { Err(TokenHashError) }
    }
}

impl fmt::Display for TokenHash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

/// When a token ends: at the end of a day of UTC, or at a time.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(try_from = "Datetime")]
pub struct Until {
    text: String,
    at: SystemTime,
}

/// A text is no time at which a token can end.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("give a day, such as 2030-12-31, or a time of UTC, such as 2030-12-31T18:00:00Z")]
pub struct UntilError;

impl FromStr for Until {
    type Err = UntilError;

    fn from_str(text: &str) -> Result<Self, UntilError> {
        let time = |text: &str| humantime::parse_rfc3339(text).map_err(|_| UntilError);
        let is_day = text.len() == "2030-12-31".len();
        let at = if is_day {
            time(&format!("{text}T00:00:00Z"))?.checked_add(DAY).ok_or(UntilError)?
        } else {
            time(text)?
        };
        Ok(Self { text: text.to_owned(), at })
    }
}

impl TryFrom<Datetime> for Until {
    type Error = UntilError;

    fn try_from(given: Datetime) -> Result<Self, UntilError> {
        given.to_string().parse()
    }
}

/// The rights of a token's holder.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum May {
    /// Look, and nothing that others see.
    Look,
    /// Write notes as well.
    #[default]
    Write,
}

/// A person's token.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TokenEntry {
    /// The person's name.
    pub name: PersonName,
    /// The hash of the token.
    pub sha256: TokenHash,
    /// When it ends; never without a time.
    pub until: Option<Until>,
    /// The rights of its holder.
    #[serde(default)]
    pub may: May,
}

impl TokenEntry {
    /// When it ends.
    pub(super) fn ends_at(&self) -> Option<SystemTime> {
        self.until.as_ref().map(|until| until.at)
    }
}

/// As in a file of tokens.
impl fmt::Display for TokenEntry {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, sha256, until, may } = self;
        let name = toml::Value::String(name.0.clone());
        write!(f, "[[token]]\nname = {name}\nsha256 = \"{sha256}\"")?;
        until.as_ref().map_or(Ok(()), |until| write!(f, "\nuntil = {}", until.text))?;
        if *may == May::Look { f.write_str("\nmay = \"look\"") } else { Ok(()) }
    }
}

/// The tokens of a file.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct TokenList(pub(super) Vec<TokenEntry>);

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct TokenFile {
    #[serde(default)]
    token: Vec<TokenEntry>,
}

/// Why a file of tokens cannot be used.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum TokenListError {
    /// It cannot be read.
    #[error("cannot read the tokens in {file}", file = file.display())]
    Read {
        /// The file.
        file: PathBuf,
        /// Why.
        #[source]
        cause: io::Error,
    },
    /// It is not what it should be; the cause names line and key.
    #[error("the tokens in {file} are not valid", file = file.display())]
    Parse {
        /// The file.
        file: PathBuf,
        /// The fault and its place.
        #[source]
        cause: Box<toml::de::Error>,
    },
    /// Two people would have the same token.
    #[error("{first} and {second} have the same token in {file}: remove one", file = file.display(),
        first = first.as_str(), second = second.as_str())]
    Twice {
        /// The file.
        file: PathBuf,
        /// The first one's name.
        first: PersonName,
        /// The other one's.
        second: PersonName,
    },
}

impl TokenList {
    /// The tokens in a file (TOML).
    ///
    /// # Errors
    /// If it cannot be used.
    pub fn read(file: &Path) -> Result<Self, TokenListError> {
        let text = fs::read_to_string(file)
            .map_err(|cause| TokenListError::Read { file: file.to_owned(), cause })?;
        let TokenFile { token } = toml::from_str(&text)
            .map_err(|cause| TokenListError::Parse { file: file.to_owned(), cause: Box::new(cause) })?;
        for (number, second) in token.iter().enumerate() {
            if let Some(first) = token.iter().take(number).find(|first| first.sha256 == second.sha256) {
                let (first, second) = (first.name.clone(), second.name.clone());
                return Err(TokenListError::Twice { file: file.to_owned(), first, second });
            }
        }
        Ok(Self(token))
    }
}

/// The tokens that open a page.
#[derive(Debug, Clone)]
pub enum Tokens {
    /// One for all people.
    One(Token),
    /// One for each person.
    Listed(TokenList),
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use trimaran_transport::causes;

    use super::*;

    fn at(text: &str) -> SystemTime {
        humantime::parse_rfc3339(text).unwrap()
    }

    fn read(text: &str) -> Result<TokenList, TokenListError> {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("plant.tokens");
        fs::write(&file, text).unwrap();
        TokenList::read(&file)
    }

    #[test]
    fn a_token_ends_with_its_day_or_at_its_time() {
        let ends = |text: &str| text.parse::<Until>().map(|until| until.at);
        assert_eq!(ends("2030-12-31"), Ok(at("2031-01-01T00:00:00Z")));
        assert_eq!(ends("2028-02-29T18:30:00Z"), Ok(at("2028-02-29T18:30:00Z")));
        for bad in ["", "2030-13-01", "2030-02-30", "31.12.2030", "18:00", "2030-12-31T18:00:00", "tomorrow"]
        {
            assert_eq!(ends(bad), Err(UntilError), "{bad}");
        }
        assert_eq!(ends("2030-12-31T18:00:00+01:00"), Err(UntilError), "as text and in a file alike");
    }

    #[test]
    fn an_entry_is_read_as_it_is_printed() {
        let entry = |name: &str, token: &str, until: Option<&str>| TokenEntry {
            name: name.parse().unwrap(),
            sha256: TokenHash::of(token),
            until: until.map(|until| until.parse().unwrap()),
            may: May::Write,
        };
        let entries = vec![
            TokenEntry { may: May::Look, ..entry("eve", "0123456789abcdei", Some("2030-12-31")) },
            entry("ada", "0123456789abcdef", Some("2030-12-31")),
            entry("a \"b\" ü", "0123456789abcdeg", Some("2030-12-31T18:00:00Z")),
            entry("a", "0123456789abcdeh", None),
        ];
        let file: String = entries.iter().map(|entry| format!("{entry}\n\n")).collect();
        assert_eq!(read(&file).unwrap(), TokenList(entries), "{file}");
        assert!(file.contains("until = 2030-12-31\n"), "{file}");
        assert_eq!(read("").unwrap(), TokenList::default());
    }

    #[test]
    fn the_hash_is_the_one_that_sha256sum_prints() {
        let known = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(TokenHash::of("abc").to_string(), known);
        let read = TokenHash::try_from(known.to_uppercase()).unwrap();
        assert!(read.is(&TokenHash::of("abc")) && !read.is(&TokenHash::of("abd")));
        for bad in ["", "abc", &known[1..], &known.replace('b', "g")] {
            assert_eq!(TokenHash::try_from(bad.to_owned()), Err(TokenHashError), "{bad}");
        }
    }

    #[test]
    fn a_wrong_file_is_refused_with_its_place() {
        let hash = TokenHash::of("abc");
        let one = format!("[[token]]\nname = \"ada\"\nsha256 = \"{hash}\"\n");
        for (text, told) in [
            (format!("{one}may = 'dance'\n"), "may"),
            (format!("{one}can = 'look'\n"), "can"),
            (one.replace("token", "tokens"), "tokens"),
            (one.replace("ada", ""), "1 to 64 characters"),
            (one.replace(&hash.to_string(), "abc"), "64 hexadecimal digits"),
            (format!("{one}until = 2030-12-31T18:00:00\n"), "UTC"),
            (format!("{one}until = 'tomorrow'\n"), "until"),
            (one.replace("name = \"ada\"\n", ""), "name"),
            (one.repeat(2), "ada and ada have the same token"),
        ] {
            let refused = causes(&read(&text).unwrap_err());
            assert!(refused.contains(told) && refused.contains("plant.tokens"), "{text}: {refused}");
        }
        assert!(matches!(TokenList::read(Path::new("/none")), Err(TokenListError::Read { .. })));
    }

    proptest! {
        #[test]
        fn no_text_panics(text in any::<String>()) {
            let _read = (text.parse::<Until>(), text.parse::<PersonName>(), TokenHash::try_from(text));
        }
    }
}
