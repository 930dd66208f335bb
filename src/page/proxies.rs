//! Proxies in front of the service. What their headers say of a request counts, and no one else's.

use std::{
    net::{IpAddr, SocketAddr},
    str::FromStr,
};

use hyper::{
    HeaderMap,
    header::{HeaderName, HeaderValue},
};
use ipnet::IpNet;
use thiserror::Error;
use trimaran_net::StreamPeer;
use trimaran_transport::ws::Site;

use super::tokens::PersonName;

// As proxies have them; RFC 7239 has a newer form, which few send.
const FORWARDED_FOR: HeaderName = HeaderName::from_static("x-forwarded-for");
const FORWARDED_HOST: HeaderName = HeaderName::from_static("x-forwarded-host");
const FORWARDED_PROTO: HeaderName = HeaderName::from_static("x-forwarded-proto");

/// The addresses of proxies: one, or a network such as `10.0.0.0/8`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ProxyNetwork(IpNet);

/// A text is neither an address nor a network.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("give an IP address or a network of them, such as 127.0.0.1 or 10.0.0.0/8")]
pub struct ProxyNetworkError;

impl FromStr for ProxyNetwork {
    type Err = ProxyNetworkError;

    fn from_str(text: &str) -> Result<Self, ProxyNetworkError> {
        let network = text.parse().or_else(|_| text.parse::<IpAddr>().map(IpNet::from));
        network.map(Self).map_err(|_| ProxyNetworkError)
    }
}

/// The proxies in front of a service. Default none.
#[derive(Debug, Clone, Default)]
pub struct Proxies {
    /// Their addresses.
    pub trusted: Vec<ProxyNetwork>,
    /// The header in which they name the person whom they have let in.
    pub name_header: Option<HeaderName>,
}

/// A request as its client made it, as far as that is known.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Asked {
    /// The client. The port is that of the connection to this service.
    pub(super) peer: StreamPeer,
    /// The site that was asked.
    pub(super) site: Site,
    /// The person's name.
    pub(super) name: Option<PersonName>,
}

impl Proxies {
    /// A request with these headers that came from `peer`, over TLS if it `is_encrypted`.
    pub(super) fn asked(&self, peer: StreamPeer, headers: &HeaderMap, is_encrypted: bool) -> Asked {
        let mut asked = Asked { peer, site: Site { is_encrypted, ..Site::of(headers) }, name: None };
        let StreamPeer::Tcp(from) = peer else { return asked };
        if !self.trusts(from.ip()) {
            return asked;
        }
        if let Some(scheme) = values(headers, &FORWARDED_PROTO).next() {
            asked.site.is_encrypted = matches!(scheme, "https" | "wss");
        }
        if let Some(host) = values(headers, &FORWARDED_HOST).next() {
            host.clone_into(&mut asked.site.host);
        }
        asked.peer = StreamPeer::Tcp(SocketAddr::new(self.client(from.ip(), headers), from.port()));
        let name = self.name_header.as_ref().and_then(|name| headers.get_all(name).iter().next_back());
        asked.name = name.and_then(person);
        asked
    }

    fn trusts(&self, address: IpAddr) -> bool {
        let address = address.to_canonical();
        self.trusted.iter().any(|ProxyNetwork(network)| network.contains(&address))
    }

    /// The client of the first trusted proxy. Each proxy adds the address from which it was asked, so what
    /// stands before an address that is not trusted is only claimed.
    fn client(&self, proxy: IpAddr, headers: &HeaderMap) -> IpAddr {
        let mut client = proxy;
        for hop in values(headers, &FORWARDED_FOR) {
            let Some(address) = address(hop) else { break };
            client = address;
            if !self.trusts(client) {
                break;
            }
        }
        client.to_canonical()
    }
}

/// The values of a header, from the one that was added last.
fn values<'h>(headers: &'h HeaderMap, name: &HeaderName) -> impl Iterator<Item = &'h str> {
    let texts = headers.get_all(name).into_iter().rev().filter_map(|value| value.to_str().ok());
    texts.flat_map(|text| text.rsplit(',')).map(str::trim)
}

/// The address of a hop, which some proxies write with its port.
fn address(hop: &str) -> Option<IpAddr> {
    let with_port = || hop.parse().map(|at: SocketAddr| at.ip()).ok();
    hop.parse().ok().or_else(with_port)
}

fn person(name: &HeaderValue) -> Option<PersonName> {
    str::from_utf8(name.as_bytes()).ok()?.parse().ok()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn proxies(trusted: &[&str]) -> Proxies {
        let trusted = trusted.iter().map(|network| network.parse().unwrap()).collect();
        Proxies { trusted, name_header: Some(HeaderName::from_static("x-forwarded-user")) }
    }

    fn headers(given: &[(&'static str, &str)]) -> HeaderMap {
        let mut headers = HeaderMap::new();
        for (name, value) in given {
            let value = HeaderValue::from_bytes(value.as_bytes()).unwrap();
            headers.append(HeaderName::from_static(name), value);
        }
        headers
    }

    fn peer(address: &str) -> StreamPeer {
        StreamPeer::Tcp(SocketAddr::new(address.parse().unwrap(), 5000))
    }

    const OF_A_PROXY: [(&str, &str); 5] = [
        ("host", "127.0.0.1:7480"),
        ("x-forwarded-host", "plant.example:8443"),
        ("x-forwarded-proto", "https"),
        ("x-forwarded-for", "203.0.113.9"),
        ("x-forwarded-user", "Ada Lövelace"),
    ];

    #[test]
    fn a_trusted_proxy_says_who_asks_for_which_site() {
        for (trusted, from) in [
            ("127.0.0.1", "127.0.0.1"),
            ("10.0.0.0/8", "10.255.0.1"),
            ("10.0.0.0/8", "::ffff:10.0.0.1"),
            ("fd00::/8", "fd12::1"),
        ] {
            let asked = proxies(&["192.0.2.1", trusted]).asked(peer(from), &headers(&OF_A_PROXY), false);
            let site = Site { is_encrypted: true, host: "plant.example:8443".to_owned() };
            assert_eq!((asked.site, asked.peer), (site, peer("203.0.113.9")), "{trusted} {from}");
            assert_eq!(asked.name, Some("Ada Lövelace".parse().unwrap()));
        }
    }

    #[test]
    fn headers_from_elsewhere_count_for_nothing() {
        let headers = headers(&OF_A_PROXY);
        for (trusted, from) in
            [(&["10.0.0.0/8"][..], "11.0.0.1"), (&[], "127.0.0.1"), (&["127.0.0.1"], "::1")]
        {
            for is_encrypted in [false, true] {
                let asked = proxies(trusted).asked(peer(from), &headers, is_encrypted);
                let site = Site { is_encrypted, host: "127.0.0.1:7480".to_owned() };
                assert_eq!(asked, Asked { peer: peer(from), site, name: None }, "{from}");
            }
        }
    }

    #[test]
    fn a_proxy_that_says_nothing_leaves_the_request_as_it_is() {
        let given = headers(&[("host", "plant.example")]);
        let asked = proxies(&["127.0.0.1"]).asked(peer("127.0.0.1"), &given, false);
        let site = Site { is_encrypted: false, host: "plant.example".to_owned() };
        assert_eq!(asked, Asked { peer: peer("127.0.0.1"), site, name: None });
    }

    /// A client may send such headers itself: proxies add theirs behind.
    #[test]
    fn what_a_client_claims_stands_before_what_proxies_add() {
        let proxies = proxies(&["10.0.0.0/8"]);
        let client = |forwarded: &[&str]| {
            let given: Vec<_> = forwarded.iter().map(|hops| ("x-forwarded-for", *hops)).collect();
            let StreamPeer::Tcp(at) = proxies.asked(peer("10.0.0.1"), &headers(&given), false).peer else {
                panic!("no address")
            };
            at.ip().to_string()
        };
        assert_eq!(client(&["203.0.113.9"]), "203.0.113.9");
        assert_eq!(client(&["1.1.1.1, 203.0.113.9"]), "203.0.113.9");
        assert_eq!(client(&["1.1.1.1, 203.0.113.9,10.0.0.2"]), "203.0.113.9");
        assert_eq!(client(&["1.1.1.1", "203.0.113.9, 10.0.0.2"]), "203.0.113.9");
        assert_eq!(client(&["203.0.113.9:4711"]), "203.0.113.9");
        assert_eq!(client(&["[2001:db8::1]:4711"]), "2001:db8::1");
        assert_eq!(client(&["10.0.0.3, 10.0.0.2"]), "10.0.0.3", "all of them are proxies");
        for nonsense in ["", "unknown", "1.1.1.1, _hidden"] {
            assert_eq!(client(&[nonsense]), "10.0.0.1", "{nonsense}");
        }
        let given = headers(&[
            ("x-forwarded-host", "evil.example, plant.example"),
            ("x-forwarded-proto", "https,http"),
        ]);
        let asked = proxies.asked(peer("10.0.0.1"), &given, true);
        assert_eq!(asked.site, Site { is_encrypted: false, host: "plant.example".to_owned() });
    }

    #[test]
    fn a_name_that_is_none_is_left_out() {
        for name in ["", "a\tb", &"x".repeat(65)] {
            let given = headers(&[("x-forwarded-user", name)]);
            assert_eq!(proxies(&["10.0.0.1"]).asked(peer("10.0.0.1"), &given, false).name, None, "{name:?}");
        }
        let unnamed = Proxies { name_header: None, ..proxies(&["10.0.0.1"]) };
        assert_eq!(unnamed.asked(peer("10.0.0.1"), &headers(&OF_A_PROXY), false).name, None);
    }

    #[test]
    fn a_proxy_is_an_address_or_a_network() {
        for bad in ["", "localhost", "10.0.0.0/33", "10.0.0.1:80", "*"] {
            assert_eq!(bad.parse::<ProxyNetwork>(), Err(ProxyNetworkError), "{bad}");
        }
    }

    proptest! {
        #[test]
        fn no_header_panics(values: Vec<Vec<u8>>) {
            let mut headers = HeaderMap::new();
            for value in values.iter().filter_map(|value| HeaderValue::from_bytes(value).ok()) {
                for name in [FORWARDED_FOR, FORWARDED_HOST, FORWARDED_PROTO] {
                    headers.append(name, value.clone());
                }
                headers.append("x-forwarded-user", value);
            }
            let _asked = proxies(&["10.0.0.1"]).asked(peer("10.0.0.1"), &headers, false);
        }
    }
}
