//! The files of the page, which are part of the program, and how they are sent.

use hyper::{
    HeaderMap, Response, StatusCode,
    body::Bytes,
    header::{self, HeaderValue},
};

use super::server::{Body, file};

/// A file of the page.
#[derive(Debug)]
pub(super) struct Asset {
    /// The path by which a browser asks for it.
    pub(super) path: &'static str,
    /// Its media type.
    kind: &'static str,
    /// The entity tag by which a browser names its cached copy: it changes with the content.
    tag: &'static str,
    bytes: &'static [u8],
    /// The compressed forms with the names of their content codings, the smallest first.
    coded: &'static [(&'static str, &'static [u8])],
}

/// All files; empty if the program was built without the page.
pub(super) const ASSETS: &[Asset] = include!(concat!(env!("OUT_DIR"), "/assets.rs"));

impl Asset {
    /// The answer to a request with these headers: the smallest coding that the client accepts, or no bytes
    /// if the client has them (RFC 9110, 8.4 and 13.1.2).
    pub(super) fn answer(&self, asked: &HeaderMap) -> Response<Body> {
        let has_it = said(asked, &header::IF_NONE_MATCH).any(|tag| tag == "*" || tag == self.tag);
        let coded = self.coded.iter().find(|(coding, _)| reads(asked, coding));
        let bytes: &'static [u8] = if has_it { b"" } else { coded.map_or(self.bytes, |&(_, bytes)| bytes) };
        let mut response = file(self.kind, Bytes::from_static(bytes));
        let headers = response.headers_mut();
        headers.insert(header::ETAG, HeaderValue::from_static(self.tag));
        headers.insert(header::VARY, HeaderValue::from_static("accept-encoding"));
        if has_it {
            *response.status_mut() = StatusCode::NOT_MODIFIED;
        } else if let Some((coding, _)) = coded {
            headers.insert(header::CONTENT_ENCODING, HeaderValue::from_static(coding));
        }
        response
    }
}

/// The comma-separated parts of a header.
fn said<'h>(headers: &'h HeaderMap, name: &header::HeaderName) -> impl Iterator<Item = &'h str> {
    let texts = headers.get_all(name).into_iter().filter_map(|value| value.to_str().ok());
    texts.flat_map(|text| text.split(',')).map(str::trim)
}

/// Whether a client accepts a content coding: it names it, with a weight above 0.
fn reads(asked: &HeaderMap, coding: &str) -> bool {
    said(asked, &header::ACCEPT_ENCODING).any(|accepted| {
        let mut parts = accepted.split(';').map(str::trim);
        let is_named = parts.next().is_some_and(|name| name.eq_ignore_ascii_case(coding));
        let weight = parts.find_map(|part| part.strip_prefix("q=").or_else(|| part.strip_prefix("Q=")));
        is_named && weight.is_none_or(|weight| weight.parse::<f32>().is_ok_and(|weight| weight > 0.0))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const SCRIPT: Asset = Asset {
        path: "/x.js",
        kind: "text/javascript",
        tag: "W/\"5\"",
        bytes: b"plain",
        coded: &[("br", b"b"), ("gzip", b"gz")],
    };

    /// The status, the coding and the length of an answer.
    fn asked(headers: &[(header::HeaderName, &'static str)]) -> (u16, Option<String>, u64) {
        let mut map = HeaderMap::new();
        for (name, value) in headers {
            map.append(name, HeaderValue::from_static(value));
        }
        let response = SCRIPT.answer(&map);
        let header = |name| response.headers().get(name).map(|value| value.to_str().unwrap().to_owned());
        assert_eq!(header(header::ETAG).as_deref(), Some("W/\"5\""));
        assert_eq!(header(header::VARY).as_deref(), Some("accept-encoding"));
        let length = hyper::body::Body::size_hint(response.body()).exact().unwrap();
        (response.status().as_u16(), header(header::CONTENT_ENCODING), length)
    }

    #[test]
    fn a_file_is_sent_in_the_smallest_coding_that_is_read() {
        let sent = |accepted| asked(&[(header::ACCEPT_ENCODING, accepted)]);
        let coded = |coding: &str, length| (200, Some(coding.to_owned()), length);
        assert_eq!(asked(&[]), (200, None, 5));
        assert_eq!(sent("gzip, deflate, br, zstd"), coded("br", 1));
        assert_eq!(sent("gzip, deflate"), coded("gzip", 2));
        assert_eq!(sent("GZIP;q=0.5 , br; q=0"), coded("gzip", 2));
        for none in ["", "identity", "gzip;q=0, br;q=0.0", "gzip;q=x", "x-gzip-y", "*;q=0"] {
            assert_eq!(sent(none), (200, None, 5), "{none}");
        }
        let two = [(header::ACCEPT_ENCODING, "identity"), (header::ACCEPT_ENCODING, "gzip")];
        assert_eq!(asked(&two), coded("gzip", 2));
    }

    #[test]
    fn a_file_that_is_there_already_is_not_sent_again() {
        for tags in ["W/\"5\"", "\"4\", W/\"5\"", "*"] {
            let headers = [(header::IF_NONE_MATCH, tags), (header::ACCEPT_ENCODING, "gzip")];
            assert_eq!(asked(&headers), (304, None, 0), "{tags}");
        }
        assert_eq!(asked(&[(header::IF_NONE_MATCH, "W/\"6\"")]), (200, None, 5));
    }
}
