//! Several endpoints of one peer.

use std::fmt;
use std::str::FromStr;

use serde::de::{Error as _, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::{Endpoint, EndpointError};

/// One endpoint or several, at which one peer listens.
///
/// Commas separate them in text; a file may also give a list. Several make sense where peers come over
/// different transports.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Endpoints {
    first: Endpoint,
    rest: Vec<Endpoint>,
}

impl Endpoints {
    /// Each of them, in the order given.
    pub fn iter(&self) -> impl Iterator<Item = &Endpoint> {
        std::iter::once(&self.first).chain(&self.rest)
    }

    /// The first one given.
    #[must_use]
    pub const fn first(&self) -> &Endpoint {
        &self.first
    }

    /// The same endpoints, followed by another one.
    #[must_use]
    pub fn and(mut self, endpoint: Endpoint) -> Self {
        self.push(endpoint);
        self
    }

    /// Adds another one.
    pub(crate) fn push(&mut self, endpoint: Endpoint) {
        self.rest.push(endpoint);
    }
}

impl From<Endpoint> for Endpoints {
    fn from(first: Endpoint) -> Self {
        Self { first, rest: Vec::new() }
    }
}

impl fmt::Display for Endpoints {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.first.fmt(f)?;
        self.rest.iter().try_for_each(|endpoint| write!(f, ",{endpoint}"))
    }
}

impl FromStr for Endpoints {
    type Err = EndpointError;

    fn from_str(text: &str) -> Result<Self, EndpointError> {
        let mut parts = text.split(',').map(|part| part.trim().parse());
        let first = parts.next().unwrap_or_else(|| text.parse())?;
        Ok(Self { first, rest: parts.collect::<Result<_, _>>()? })
    }
}

impl Serialize for Endpoints {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(self.iter())
    }
}

impl<'de> Deserialize<'de> for Endpoints {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(OneOrMore)
    }
}

struct OneOrMore;

impl<'de> Visitor<'de> for OneOrMore {
    type Value = Endpoints;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("an endpoint such as \"tcp://host:port\", or a list of them")
    }

    fn visit_str<E: serde::de::Error>(self, text: &str) -> Result<Endpoints, E> {
        text.parse().map_err(E::custom)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Endpoints, A::Error> {
        let first: Endpoint =
            list.next_element()?.ok_or_else(|| A::Error::custom("give one endpoint at least"))?;
        let mut all = Endpoints::from(first);
        while let Some(endpoint) = list.next_element()? {
            all.push(endpoint);
        }
        Ok(all)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::EndpointFault;

    #[derive(Debug, PartialEq, Serialize, Deserialize)]
    struct File {
        listen: Endpoints,
    }

    fn file(text: &str) -> Result<Endpoints, toml::de::Error> {
        toml::from_str::<File>(text).map(|file| file.listen)
    }

    #[test]
    fn one_or_several_are_read_as_a_text_or_as_a_list() {
        let one: Endpoints = "tcp://a:1".parse().unwrap();
        let two: Endpoints = "tcp://a:1, quic://[::1]:2".parse().unwrap();
        assert_eq!(
            (one.to_string(), two.to_string()),
            ("tcp://a:1".into(), "tcp://a:1,quic://[::1]:2".into())
        );
        assert_eq!(file("listen = 'tcp://a:1'").unwrap(), one);
        assert_eq!(file("listen = ['tcp://a:1']").unwrap(), one);
        assert_eq!(file("listen = ['tcp://a:1', 'quic://[::1]:2']").unwrap(), two);
        assert_eq!(file(&toml::to_string(&File { listen: two.clone() }).unwrap()).unwrap(), two);
        assert_eq!(two.iter().map(Endpoint::transport).collect::<Vec<_>>(), ["tcp", "quic"]);
        assert_eq!(two.first(), one.first());
    }

    #[test]
    fn none_or_a_bad_one_is_refused() {
        for text in ["", "tcp://a:1,", ",", "tcp://a:1,b:2"] {
            assert_eq!(text.parse::<Endpoints>().unwrap_err().fault, EndpointFault::Scheme, "{text:?}");
        }
        let message = file("listen = []").unwrap_err().to_string();
        assert!(message.contains("one endpoint at least") && message.contains("line 1"), "{message}");
        let message = file("listen = ['tcp://a:1',\n'tcp://a']").unwrap_err().to_string();
        assert!(message.contains("no port"), "{message}");
    }
}
