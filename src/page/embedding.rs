//! The pages of other sites that may show this one in a frame and drive it.

use std::str::FromStr;

use hyper::header::HeaderValue;
use serde::{Serialize, Serializer};
use thiserror::Error;
use trimaran_transport::ws::Origin;

use super::server::POLICY;

/// The origin of a page that may show this one in a frame, such as `https://portal.example`. As browsers
/// write it: in small letters, without the usual port.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FrameAncestor(String);

/// A text is no origin of a page.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("{0:?} is no origin: give http://host:port or https://host:port, nothing behind it, and no *")]
pub struct FrameAncestorError(String);

impl FromStr for FrameAncestor {
    type Err = FrameAncestorError;

    fn from_str(text: &str) -> Result<Self, FrameAncestorError> {
        let wrong = || FrameAncestorError(text.to_owned());
        let origin = text.parse::<Origin>().map_err(|_| wrong())?.to_string();
        let (scheme, host) = origin.split_once("://").ok_or_else(wrong)?;
        // Others that hosts may have, as `;`, mean something else in a policy (CSP 3, 2.3.1).
        let is_plain = |letter: char| letter.is_ascii_alphanumeric() || ".-_:[]".contains(letter);
        if host.is_empty() || !host.chars().all(is_plain) {
            return Err(wrong());
        }
        let usual = if scheme == "https" { ":443" } else { ":80" };
        Ok(Self(format!("{scheme}://{}", host.strip_suffix(usual).unwrap_or(host))))
    }
}

impl Serialize for FrameAncestor {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(&self.0)
    }
}

/// The policy of a page that these may show in a frame, besides pages of its own origin.
pub(super) fn policy(ancestors: &[FrameAncestor]) -> HeaderValue {
    let mut policy = POLICY.to_owned();
    for FrameAncestor(origin) in ancestors {
        policy.push(' ');
        policy += origin;
    }
    // An origin has letters that a header may have.
    HeaderValue::try_from(policy).unwrap_or_else(|_| HeaderValue::from_static(POLICY))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Option<String> {
        text.parse().ok().map(|FrameAncestor(origin)| origin)
    }

    #[test]
    fn an_origin_is_as_browsers_write_it() {
        for (text, origin) in [
            ("https://portal.example", "https://portal.example"),
            ("HTTPS://Portal.Example:443", "https://portal.example"),
            ("http://portal.example:443", "http://portal.example:443"),
            ("http://127.0.0.1:80", "http://127.0.0.1"),
            ("http://[::1]:8080", "http://[::1]:8080"),
        ] {
            assert_eq!(read(text).as_deref(), Some(origin), "{text}");
        }
        for wrong in [
            "",
            "*",
            "https://*.example",
            "https://",
            "portal.example",
            "'self'",
            "data:",
            "ftp://portal.example",
            "https://portal.example/",
            "https://portal.example/path",
            "https://user@portal.example",
            "https://portal.example;script-src",
            "https://portal.example script-src",
            "https://portal.example,https://b.example",
            "https://portal.example\r\nx: y",
            "https://pörtal.example",
        ] {
            assert_eq!(read(wrong), None, "{wrong:?}");
        }
        assert_eq!(read(&format!("https://{}", "a".repeat(1 << 20))), None, "a megabyte");
    }

    #[test]
    fn none_but_the_page_itself_may_show_it_unless_named() {
        assert!(policy(&[]).to_str().unwrap().ends_with("; frame-ancestors 'self'"));
        let named = ["https://a.example", "http://b.example:81"].map(|text| text.parse().unwrap());
        let policy = policy(&named);
        let (before, ancestors) = policy.to_str().unwrap().split_once("frame-ancestors").unwrap();
        assert_eq!(ancestors, " 'self' https://a.example http://b.example:81");
        assert!(POLICY.starts_with(before) && before.starts_with("default-src 'none'"));
    }
}
