//! The query language of searches: `valve and not (size > "100 mm" or status=removed)`.
//!
//! ```text
//! any       = all { "or" all }
//! all       = not { [ "and" ] not }
//! not       = { "not" } ( "(" any ")" | condition )
//! condition = text [ sign text ]
//! sign      = "=" | "!=" | ":" | ">" | "<" | ">=" | "<="
//! text      = word | "quoted text"
//! ```

use std::ops::Range;

use super::{
    error::{QueryError, QueryFault},
    quantity::{Quantity, is_known_unit},
    texts::bare,
    tokens::{Sign, Token, TokenKind, tokens},
};

/// The most bytes of a query.
const LONGEST: usize = 2000;
/// The most conditions of a query.
const MOST: usize = 64;
/// How deep parentheses and `not` may be nested.
const DEEPEST: usize = 32;
/// The attribute that stands for a part's name.
const NAME: &str = "name";

/// A query that has been parsed.
#[derive(Debug, Clone, PartialEq)]
pub struct Query {
    pub(super) expression: Expression,
    /// The bare text of all words, if the query is nothing but several words.
    pub(super) phrase: Option<String>,
    /// The text to look for as it was typed, if the query is nothing but one.
    pub(super) typed: Option<String>,
}

/// Conditions, and how they are joined.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Expression {
    Condition(Condition),
    Not(Box<Self>),
    All(Vec<Self>),
    /// Without any it finds nothing.
    Any(Vec<Self>),
}

/// A condition on a part.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Condition {
    pub(super) field: Field,
    pub(super) test: Test,
}

/// A place to look.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Field {
    /// The name, or any attribute.
    Any,
    /// The name, or an attribute of that name.
    Name,
    /// An attribute by its bare name; with the place of that name in the query.
    Attribute { name: String, at: Range<usize> },
}

/// A property to look for.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Test {
    /// There is such an attribute.
    Exists,
    /// It contains a bare text, which is not empty.
    Contains(String),
    /// It is this text but for case and separators, or this number.
    Is(String),
    /// It is a number in this relation to another one.
    Number(Sign, Quantity),
}

impl Query {
    /// Parses a query. An empty one finds nothing.
    ///
    /// # Errors
    /// Says what is wrong, and where.
    pub fn parse(text: &str) -> Result<Self, QueryError> {
        if text.len() > LONGEST {
            return Err(QueryFault::TooLong(LONGEST).at(text.floor_char_boundary(LONGEST)..text.len()));
        }
        let tokens = tokens(text)?;
        if tokens.is_empty() {
            return Ok(Self { expression: Expression::Any(Vec::new()), phrase: None, typed: None });
        }
        let mut parser = Parser { tokens: &tokens, end: text.len(), conditions: 0, depth: 0 };
        let expression = parser.any()?;
        if let Some(token) = parser.tokens.first() {
            // All else is a condition.
            return Err(QueryFault::ClosesNothing.at(token.at.clone()));
        }
        let are_words = tokens.iter().all(|token| match token.kind {
            TokenKind::Word(word) => Keyword::of(word).is_none(),
            _ => false,
        });
        let phrase = (are_words && tokens.len() > 1).then(|| bare(text));
        let typed = if are_words { Some(text.trim().to_owned()) } else { text_of(&tokens) };
        Ok(Self { expression, phrase, typed })
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Keyword {
    And,
    Or,
    Not,
}

impl Keyword {
    fn of(word: &str) -> Option<Self> {
        let all = [("and", Self::And), ("or", Self::Or), ("not", Self::Not)];
        all.into_iter().find(|(name, _)| word.eq_ignore_ascii_case(name)).map(|(_, keyword)| keyword)
    }
}

struct Parser<'t, 'q> {
    /// Those that are not parsed yet.
    tokens: &'t [Token<'q>],
    /// The end of the query.
    end: usize,
    conditions: usize,
    depth: usize,
}

impl<'t, 'q> Parser<'t, 'q> {
    fn any(&mut self) -> Result<Expression, QueryError> {
        let mut all = vec![self.all()?];
        while self.takes(Keyword::Or) {
            all.push(self.all()?);
        }
        Ok(one_or(all, Expression::Any))
    }

    fn all(&mut self) -> Result<Expression, QueryError> {
        let mut all = vec![self.not()?];
        while self.takes(Keyword::And) || self.goes_on() {
            all.push(self.not()?);
        }
        Ok(one_or(all, Expression::All))
    }

    fn not(&mut self) -> Result<Expression, QueryError> {
        let at = self.place();
        if self.takes(Keyword::Not) {
            return self.deeper(at, |parser| Ok(Expression::Not(Box::new(parser.not()?))));
        }
        if self.keyword().is_some() {
            return Err(QueryFault::NoCondition.at(at));
        }
        match self.next() {
            Some(Token { kind: TokenKind::Open, at }) => {
                let inner = self.deeper(at.clone(), Self::any)?;
                match self.next() {
                    Some(Token { kind: TokenKind::Close, .. }) => Ok(inner),
                    _ => Err(QueryFault::OpenParenthesis.at(at.clone())),
                }
            }
            Some(Token { kind: TokenKind::Word(text), at }) => self.condition(text, at),
            Some(Token { kind: TokenKind::Quoted(text), at }) => self.condition(text, at),
            Some(Token { kind: TokenKind::Sign(sign), at }) => {
                Err(QueryFault::NoAttribute(sign.text()).at(at.clone()))
            }
            Some(Token { kind: TokenKind::Close, at }) if self.depth == 0 => {
                Err(QueryFault::ClosesNothing.at(at.clone()))
            }
            _ => Err(QueryFault::NoCondition.at(at)),
        }
    }

    /// The condition that begins with this text.
    fn condition(&mut self, text: &str, at: &Range<usize>) -> Result<Expression, QueryError> {
        self.conditions += 1;
        if self.conditions > MOST {
            return Err(QueryFault::TooMany(MOST).at(at.clone()));
        }
        let Some(Token { kind: TokenKind::Sign(sign), at: sign_at }) = self.tokens.first() else {
            let test = Test::Contains(letters(text, at)?);
            return Ok(Expression::Condition(Condition { field: Field::Any, test }));
        };
        self.next();
        let name = letters(text, at)?;
        let field = if name == NAME { Field::Name } else { Field::Attribute { name, at: at.clone() } };
        let (value, value_at) = match self.next() {
            Some(Token { kind: TokenKind::Word(text), at }) => (*text, at),
            Some(Token { kind: TokenKind::Quoted(text), at }) => (&**text, at),
            _ => return Err(QueryFault::NoValue(sign.text()).at(sign_at.clone())),
        };
        let is = |test| Expression::Condition(Condition { field: field.clone(), test });
        Ok(match sign {
            Sign::Contains if value.is_empty() => is(Test::Exists),
            Sign::Contains => is(Test::Contains(letters(value, value_at)?)),
            Sign::Is => is(Test::Is(value.to_owned())),
            // A part that lacks the attribute has no other value of it.
            Sign::IsNot => {
                let other = Expression::Not(Box::new(is(Test::Is(value.to_owned()))));
                Expression::All(vec![is(Test::Exists), other])
            }
            Sign::Above | Sign::Below | Sign::AtLeast | Sign::AtMost => {
                if field == Field::Name {
                    return Err(QueryFault::NameIsNoNumber.at(sign_at.clone()));
                }
                let mut number = Quantity::parse(value)
                    .ok_or_else(|| QueryFault::NoNumber(sign.text()).at(value_at.clone()))?;
                if number.unit.is_empty()
                    && let Some(unit) = self.unit()
                {
                    number.unit = unit;
                }
                is(Test::Number(*sign, number))
            }
        })
    }

    /// The unit behind a number, if the next word is one.
    fn unit(&mut self) -> Option<String> {
        let is_compared = matches!(self.tokens.get(1), Some(Token { kind: TokenKind::Sign(_), .. }));
        match self.tokens.first()?.kind {
            TokenKind::Word(word) if is_known_unit(word) && !is_compared => {
                self.next();
                Some(word.to_lowercase())
            }
            _ => None,
        }
    }

    /// Parses what is nested, which begins at `at`.
    fn deeper<T>(
        &mut self,
        at: Range<usize>,
        parse: impl FnOnce(&mut Self) -> Result<T, QueryError>,
    ) -> Result<T, QueryError> {
        if self.depth == DEEPEST {
            return Err(QueryFault::TooDeep(DEEPEST).at(at));
        }
        self.depth += 1;
        let parsed = parse(self);
        self.depth -= 1;
        parsed
    }

    fn next(&mut self) -> Option<&'t Token<'q>> {
        let (first, rest) = self.tokens.split_first()?;
        self.tokens = rest;
        Some(first)
    }

    /// The place of the next token.
    fn place(&self) -> Range<usize> {
        self.tokens.first().map_or(self.end..self.end, |token| token.at.clone())
    }

    /// The next token, if it is a keyword. A word before a sign is the name of an attribute.
    fn keyword(&self) -> Option<Keyword> {
        match self.tokens {
            [_, Token { kind: TokenKind::Sign(_), .. }, ..] => None,
            [Token { kind: TokenKind::Word(word), .. }, ..] => Keyword::of(word),
            _ => None,
        }
    }

    fn takes(&mut self, keyword: Keyword) -> bool {
        let is_next = self.keyword() == Some(keyword);
        if is_next {
            self.next();
        }
        is_next
    }

    /// Whether another condition stands beside the last one.
    fn goes_on(&self) -> bool {
        let is_close = matches!(self.tokens, [Token { kind: TokenKind::Close, .. }, ..]);
        !self.tokens.is_empty() && !is_close && self.keyword() != Some(Keyword::Or)
    }
}

/// The text in quotation marks, or behind `name:`, if there is nothing else.
fn text_of(tokens: &[Token<'_>]) -> Option<String> {
    let last = match tokens {
        [last] => last,
        [
            Token { kind: TokenKind::Word(name), .. },
            Token { kind: TokenKind::Sign(Sign::Contains), .. },
            last,
        ] if bare(name) == NAME => last,
        _ => return None,
    };
    match &last.kind {
        TokenKind::Word(text) => Some((*text).to_owned()),
        TokenKind::Quoted(text) => Some(text.trim().to_owned()).filter(|text| !text.is_empty()),
        _ => None,
    }
}

/// The bare form of a text that has letters or digits.
fn letters(text: &str, at: &Range<usize>) -> Result<String, QueryError> {
    let bare = bare(text);
    if bare.is_empty() { Err(QueryFault::NoLetters.at(at.clone())) } else { Ok(bare) }
}

fn one_or(mut all: Vec<Expression>, join: impl FnOnce(Vec<Expression>) -> Expression) -> Expression {
    match all.pop() {
        Some(one) if all.is_empty() => one,
        last => {
            all.extend(last);
            join(all)
        }
    }
}

#[cfg(test)]
mod tests {
    use std::fmt;

    use proptest::prelude::*;

    use super::*;

    /// Writes a query with all its parentheses.
    impl fmt::Display for Expression {
        fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            let joined = |f: &mut fmt::Formatter<'_>, all: &[Self], by: &str| {
                let all: Vec<String> = all.iter().map(|one| format!("({one})")).collect();
                f.write_str(&all.join(by))
            };
            match self {
                Self::Condition(Condition { field, test }) => {
                    match field {
                        Field::Any => {}
                        Field::Name => f.write_str("name")?,
                        Field::Attribute { name, .. } => write!(f, "{}", quoted(name))?,
                    }
                    match test {
                        Test::Exists => f.write_str(":\"\""),
                        Test::Contains(text) if *field == Field::Any => f.write_str(&quoted(text)),
                        Test::Contains(text) => write!(f, ":{}", quoted(text)),
                        Test::Is(text) => write!(f, "={}", quoted(text)),
                        Test::Number(sign, Quantity { value, unit }) => {
                            write!(f, "{}\"{value} {unit}\"", sign.text())
                        }
                    }
                }
                Self::Not(one) => write!(f, "not ({one})"),
                Self::All(all) => joined(f, all, " and "),
                Self::Any(all) => joined(f, all, " or "),
            }
        }
    }

    fn quoted(text: &str) -> String {
        let mark = |letter: char| usize::from("\"“”„".contains(letter)) + 1;
        let inside: String =
            text.chars().flat_map(|letter| std::iter::repeat_n(letter, mark(letter))).collect();
        format!("\"{inside}\"")
    }

    /// How a query is understood.
    fn read(text: &str) -> String {
        Query::parse(text).unwrap_or_else(|error| panic!("{text}: {error}")).expression.to_string()
    }

    #[test]
    fn words_beside_each_other_are_all_wanted() {
        for (text, expected) in [
            ("Valve", r#""valve""#),
            ("20 CE50", r#"("20") and ("ce50")"#),
            ("20-CE50", r#""20ce50""#),
            ("\"20 CE50\"", r#""20ce50""#),
            ("“ball valve”", r#""ballvalve""#),
            ("a and b or not c d", r#"(("a") and ("b")) or ((not ("c")) and ("d"))"#),
            ("a AND (b OR c)", r#"("a") and (("b") or ("c"))"#),
            ("a(b)", r#"("a") and ("b")"#),
            ("not not a", r#"not (not ("a"))"#),
            ("\"and\" or \"or\"", r#"("and") or ("or")"#),
        ] {
            assert_eq!(read(text), expected, "{text}");
        }
    }

    #[test]
    fn attributes_are_compared_by_signs() {
        for (text, expected) in [
            ("name:valve", r#"name:"valve""#),
            ("NAME = /20-CE50", r#"name="/20-CE50""#),
            ("status=new", r#""status"="new""#),
            ("\"Line Size\" = \"a \"\"b\"\"\"", r#""linesize"="a ""b""""#),
            ("status != new", r#"("status":"") and (not ("status"="new"))"#),
            ("tag:\"\"", r#""tag":"""#),
            ("tag=\"\"", r#""tag"="""#),
            ("size>100", r#""size">"100 ""#),
            ("size ≥ 100 mm valve", r#"("size">="100 mm") and ("valve")"#),
            ("size<100mm", r#""size"<"100 mm""#),
            // These are words and names of attributes.
            ("size <= 100 in", r#"("size"<="100 ") and ("in")"#),
            ("size > 100 mm=3", r#"("size">"100 ") and ("mm"="3")"#),
            ("not=a or and:or", r#"("not"="a") or ("and":"or")"#),
        ] {
            assert_eq!(read(text), expected, "{text}");
        }
    }

    #[test]
    fn a_text_alone_is_kept_as_it_was_typed() {
        let typed = |text| Query::parse(text).unwrap().typed;
        for (text, expected) in [
            (" 20- ", "20-"),
            ("20 CE-50", "20 CE-50"),
            ("\" 20 CE\"", "20 CE"),
            ("name:/20", "/20"),
            ("NAME : \"a b\"", "a b"),
        ] {
            assert_eq!(typed(text).as_deref(), Some(expected), "{text}");
        }
        for text in ["", "a or b", "not a", "name=a", "name:\"\"", "tag:a", "name:a b", "(a)", "\"a\" b"] {
            assert_eq!(typed(text), None, "{text}");
        }
    }

    #[test]
    fn several_words_alone_are_a_phrase() {
        let phrase = |text| Query::parse(text).unwrap().phrase;
        assert_eq!(phrase("20 ce-50"), Some("20ce50".to_owned()));
        for text in ["20", "20 and ce", "20 \"ce\"", "20 ce=5", "(20 ce)", ""] {
            assert_eq!(phrase(text), None, "{text}");
        }
    }

    #[test]
    fn what_is_wrong_is_told_with_its_place() {
        use QueryFault as F;
        for (text, at, fault) in [
            ("a and", 5..5, F::NoCondition),
            ("and a", 0..3, F::NoCondition),
            ("a or or b", 5..7, F::NoCondition),
            ("not", 3..3, F::NoCondition),
            ("()", 1..2, F::NoCondition),
            ("a (b or (c)", 2..3, F::OpenParenthesis),
            ("a) b", 1..2, F::ClosesNothing),
            (")", 0..1, F::ClosesNothing),
            ("é \"b", 3..4, F::OpenQuote),
            ("=5", 0..1, F::NoAttribute("=")),
            ("a = = 5", 2..3, F::NoValue("=")),
            ("a !=", 2..4, F::NoValue("!=")),
            ("a=(b)", 1..2, F::NoValue("=")),
            ("size > big", 7..10, F::NoNumber(">")),
            ("size < \"\"", 7..9, F::NoNumber("<")),
            ("name > 5", 5..6, F::NameIsNoNumber),
            ("a /", 2..3, F::NoLetters),
            ("\"\"", 0..2, F::NoLetters),
            ("\"-\"=5", 0..3, F::NoLetters),
            ("a:-", 2..3, F::NoLetters),
        ] {
            assert_eq!(Query::parse(text), Err(fault.at(at)), "{text}");
        }
    }

    #[test]
    fn a_query_is_bounded_in_length_conditions_and_depth() {
        let fault = |text: &str| Query::parse(text).map_err(|error| error.fault);
        assert_eq!(fault(&"é".repeat(LONGEST / 2 + 1)), Err(QueryFault::TooLong(LONGEST)));
        assert!(fault(&"é".repeat(LONGEST / 2)).is_ok());
        assert_eq!(fault(&"a ".repeat(MOST + 1)), Err(QueryFault::TooMany(MOST)));
        assert!(fault(&"a ".repeat(MOST)).is_ok());
        let nested = |depth| format!("{}a{}", "(".repeat(depth), ")".repeat(depth));
        assert_eq!(fault(&nested(DEEPEST + 1)), Err(QueryFault::TooDeep(DEEPEST)));
        assert!(fault(&nested(DEEPEST)).is_ok());
        assert_eq!(fault(&format!("{}a", "not ".repeat(DEEPEST + 1))), Err(QueryFault::TooDeep(DEEPEST)));
        assert_eq!(fault(&"(".repeat(LONGEST)), Err(QueryFault::TooDeep(DEEPEST)));
        for empty in ["", " \t"] {
            assert_eq!(Query::parse(empty).unwrap().expression, Expression::Any(Vec::new()));
        }
    }

    fn condition() -> impl Strategy<Value = Expression> {
        let field = prop_oneof![
            Just(Field::Name),
            "[a-z]{1,4}"
                .prop_filter("it is the name", |name| name != NAME)
                .prop_map(|name| Field::Attribute { name, at: 0..0 }),
        ];
        let text = || "[a-z0-9é]{1,4}".prop_map(Test::Contains);
        let number = (0.0..1e6_f64, "(|mm|ea)").prop_map(|(value, unit)| Quantity { value, unit });
        let numbers = number.prop_map(|number| Test::Number(Sign::AtMost, number));
        let any = text().prop_map(|test| Condition { field: Field::Any, test });
        let of_field = (field, prop_oneof![Just(Test::Exists), text(), "[ -~“”„é]{0,5}".prop_map(Test::Is)]);
        let number = ("[b-m]{1,3}", numbers)
            .prop_map(|(name, test)| Condition { field: Field::Attribute { name, at: 0..0 }, test });
        let of_field = of_field.prop_map(|(field, test)| Condition { field, test });
        prop_oneof![any, of_field, number].prop_map(Expression::Condition)
    }

    fn expression() -> impl Strategy<Value = Expression> {
        condition().prop_recursive(3, 24, 3, |inner| {
            let several = || prop::collection::vec(inner.clone(), 2..4);
            prop_oneof![
                inner.clone().prop_map(|one| Expression::Not(Box::new(one))),
                several().prop_map(Expression::All),
                several().prop_map(Expression::Any),
            ]
        })
    }

    proptest! {
        #[test]
        fn what_is_written_is_read_as_it_was_meant(expression in expression()) {
            let text = expression.to_string();
            prop_assert_eq!(read(&text), text);
        }

        /// Its place is within the query, between letters.
        #[test]
        fn any_text_is_a_query_or_wrong_somewhere(
            text in "(and|or|not|[a( )=!<>:\"“é5]){0,30}|\\PC{0,80}",
        ) {
            if let Err(QueryError { at, .. }) = Query::parse(&text) {
                prop_assert!(text.get(at.clone()).is_some(), "{:?}", at);
            }
        }
    }
}
