//! The words and signs of a query.

use std::{borrow::Cow, ops::Range};

use super::error::{QueryError, QueryFault};

/// How an attribute is compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Sign {
    Contains,
    Is,
    IsNot,
    Above,
    Below,
    AtLeast,
    AtMost,
}

/// A word, a text or a sign of a query.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum TokenKind<'q> {
    Word(&'q str),
    Quoted(Cow<'q, str>),
    Sign(Sign),
    Open,
    Close,
}

/// One with its place, in bytes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Token<'q> {
    pub(super) kind: TokenKind<'q>,
    pub(super) at: Range<usize>,
}

/// How signs are written. Of two that begin alike, the longer one comes first.
const SIGNS: [(&str, Sign); 10] = [
    ("!=", Sign::IsNot),
    ("≠", Sign::IsNot),
    (">=", Sign::AtLeast),
    ("≥", Sign::AtLeast),
    ("<=", Sign::AtMost),
    ("≤", Sign::AtMost),
    ("=", Sign::Is),
    (":", Sign::Contains),
    (">", Sign::Above),
    ("<", Sign::Below),
];

/// Phones write curved marks.
const QUOTES: [char; 4] = ['"', '“', '”', '„'];

impl Sign {
    /// How it is written.
    pub(super) fn text(self) -> &'static str {
        SIGNS.iter().find(|(_, sign)| *sign == self).map_or("", |(text, _)| text)
    }

    fn at_start(text: &str) -> Option<(&'static str, Self)> {
        SIGNS.into_iter().find(|(sign, _)| text.starts_with(sign))
    }
}

/// Splits a query.
///
/// # Errors
/// If a quotation mark is not closed.
pub(super) fn tokens(query: &str) -> Result<Vec<Token<'_>>, QueryError> {
    let mut tokens = Vec::new();
    let mut from = 0;
    while let Some(rest) = query.get(from..).filter(|rest| !rest.is_empty()) {
        let space = rest.len() - rest.trim_start().len();
        let (kind, length) = if space > 0 {
            from += space;
            continue;
        } else if let Some((text, sign)) = Sign::at_start(rest) {
            (TokenKind::Sign(sign), text.len())
        } else if rest.starts_with('(') {
            (TokenKind::Open, 1)
        } else if rest.starts_with(')') {
            (TokenKind::Close, 1)
        } else if rest.starts_with(QUOTES) {
            let (text, length) = quoted(rest).ok_or_else(|| {
                let mark = rest.chars().next().map_or(0, char::len_utf8);
                QueryFault::OpenQuote.at(from..from + mark)
            })?;
            (TokenKind::Quoted(text), length)
        } else {
            let word = word(rest);
            (TokenKind::Word(word), word.len())
        };
        tokens.push(Token { kind, at: from..from + length });
        from += length;
    }
    Ok(tokens)
}

/// The word with which a text begins. A quotation mark within it is a part of it: `5"`.
fn word(text: &str) -> &str {
    let ends = |(at, letter): &(usize, char)| {
        letter.is_whitespace()
            || "()".contains(*letter)
            || text.get(*at..).is_some_and(|rest| Sign::at_start(rest).is_some())
    };
    let end = text.char_indices().find(ends).map_or(text.len(), |(at, _)| at);
    text.get(..end).unwrap_or(text)
}

/// The text in the quotation marks with which this begins, and the bytes up to behind the closing one. Two
/// equal marks within it stand for one.
fn quoted(text: &str) -> Option<(Cow<'_, str>, usize)> {
    let mut marks = text.char_indices().filter(|(_, letter)| QUOTES.contains(letter)).peekable();
    let (_, open) = marks.next()?;
    let start = open.len_utf8();
    while let Some((at, mark)) = marks.next() {
        let after = at + mark.len_utf8();
        if marks.next_if_eq(&(after, mark)).is_none() {
            let inside = Cow::Borrowed(text.get(start..at)?);
            return Some((QUOTES.into_iter().fold(inside, single), after));
        }
    }
    None
}

/// The text with one of these marks in place of two.
fn single(text: Cow<'_, str>, mark: char) -> Cow<'_, str> {
    let two = [mark, mark].iter().collect::<String>();
    if text.contains(&two) { text.replace(&two, &mark.to_string()).into() } else { text }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn kinds(query: &str) -> Vec<TokenKind<'_>> {
        tokens(query).unwrap().into_iter().map(|token| token.kind).collect()
    }

    #[test]
    fn words_end_at_spaces_and_signs_and_texts_at_marks() {
        use TokenKind::{Close, Open, Quoted, Word};
        assert_eq!(
            kinds(" (a!b != \"c d\")x>=5\" "),
            [
                Open,
                Word("a!b"),
                TokenKind::Sign(IsNot),
                Quoted("c d".into()),
                Close,
                Word("x"),
                TokenKind::Sign(AtLeast),
                Word("5\""),
            ]
        );
        assert_eq!(kinds("“é ü” \"a \"\"b\"\"\" \"\""), ["é ü", "a \"b\"", ""].map(|it| Quoted(it.into())));
        use Sign::{Above, AtLeast, AtMost, Below, Contains, Is, IsNot};
        let signs = [AtLeast, AtMost, IsNot, AtLeast, AtMost, IsNot, Is, Contains, Above, Below];
        assert_eq!(kinds("≥≤≠ >= <= != = : > <"), signs.map(TokenKind::Sign));
        assert_eq!(kinds(" \t\u{a0}"), []);
    }

    #[test]
    fn an_open_mark_is_told_with_its_place() {
        for (query, at) in [("a \"b", 2..3), ("“", 0..3), ("\"a\"\"", 0..1)] {
            assert_eq!(tokens(query), Err(QueryFault::OpenQuote.at(at)), "{query}");
        }
    }

    proptest! {
        /// Tokens cover everything but spaces, in order.
        #[test]
        fn nothing_is_lost_between_tokens(query in "[a\"“ ()=!<>:é]{0,20}|\\PC*") {
            if let Ok(tokens) = tokens(&query) {
                let mut end = 0;
                for token in tokens {
                    prop_assert!(query[end..token.at.start].trim().is_empty());
                    prop_assert!(token.at.end > token.at.start);
                    end = token.at.end;
                }
                prop_assert!(query[end..].trim().is_empty());
            }
        }
    }
}
