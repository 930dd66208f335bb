//! The faults of a query, and their places.

use std::ops::Range;

use thiserror::Error;

/// A query is wrong.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("{fault}")]
pub struct QueryError {
    /// The place of it in the query, in bytes.
    pub at: Range<usize>,
    /// The fault.
    pub fault: QueryFault,
}

/// A fault of a query.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum QueryFault {
    /// It has too many bytes.
    #[error("a query has at most {0} bytes")]
    TooLong(usize),
    /// It has too many conditions.
    #[error("a query has at most {0} conditions")]
    TooMany(usize),
    /// Its parentheses are nested too deep.
    #[error("parentheses are nested at most {0} deep")]
    TooDeep(usize),
    /// A quotation mark opens a text without an end.
    #[error("this quotation mark is never closed")]
    OpenQuote,
    /// An opening parenthesis has no closing one.
    #[error("this parenthesis is never closed")]
    OpenParenthesis,
    /// A closing parenthesis has no opening one.
    #[error("this parenthesis closes nothing; put texts with parentheses in quotation marks")]
    ClosesNothing,
    /// A condition is missing.
    #[error("a condition is missing here")]
    NoCondition,
    /// A comparison has no attribute.
    #[error("the attribute before {0} is missing; put texts with {0} in quotation marks")]
    NoAttribute(&'static str),
    /// A comparison has no value.
    #[error("a word or a text in quotation marks is missing behind {0}")]
    NoValue(&'static str),
    /// A number is compared with something else.
    #[error("{0} compares numbers, such as 150 or \"150 mm\", and this is none")]
    NoNumber(&'static str),
    /// A part's name is compared as a number.
    #[error("a name is no number: use = or : with it")]
    NameIsNoNumber,
    /// A word consists of separators.
    #[error("this has neither letters nor digits, and all else is ignored")]
    NoLetters,
    /// No part has the attribute.
    #[error("no part has an attribute of this name")]
    UnknownAttribute,
}

impl QueryFault {
    pub(super) const fn at(self, at: Range<usize>) -> QueryError {
        QueryError { at, fault: self }
    }
}
