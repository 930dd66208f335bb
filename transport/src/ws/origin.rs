//! The pages that may open a WebSocket, by the origin that a browser sends (RFC 6454).

use std::fmt;
use std::str::FromStr;

use thiserror::Error;
use tokio_tungstenite::tungstenite::http::{HeaderMap, Uri, header, uri::Authority};

use super::WsOptions;

/// The origin of a page: `http://host`, `https://host`, either with `:port` behind it.
#[derive(Debug, Clone, PartialEq, Eq)]
#[cfg_attr(feature = "config", derive(serde::Serialize, serde::Deserialize, schemars::JsonSchema))]
#[cfg_attr(feature = "config", serde(try_from = "String", into = "String"), schemars(with = "String"))]
pub struct Origin(String);

/// A text that is not an origin.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("{0:?} is no origin of pages: give http://host:port or https://host:port, nothing behind it")]
pub struct OriginError(String);

/// A page that may not open WebSockets here.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("a page from {origin} may not connect here: name its origin in ws.allow_origins if it shall")]
pub struct ForeignOrigin {
    /// The origin from its browser.
    pub origin: String,
}

/// A site under the name by which a browser asks for it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Site {
    /// Whether the browser asks over TLS, and so has checked that the name is this site's.
    pub is_encrypted: bool,
    /// The host, with its port unless it is the usual one.
    pub host: String,
}

impl Site {
    /// The site of a request that came without TLS and with these headers.
    #[must_use]
    pub fn of(headers: &HeaderMap) -> Self {
        let host = headers.get(header::HOST).map(|host| String::from_utf8_lossy(host.as_bytes()));
        Self { is_encrypted: false, host: host.unwrap_or_default().into_owned() }
    }

    /// The origin of its pages.
    fn origin(&self) -> String {
        format!("{}://{}", if self.is_encrypted { "https" } else { "http" }, self.host)
    }

    /// Whether no stranger can have given this site its name.
    fn has_own_name(&self) -> bool {
        (self.is_encrypted && !self.host.is_empty()) || has_no_foreign_name(&self.host)
    }
}

impl FromStr for Origin {
    type Err = OriginError;

    fn from_str(text: &str) -> Result<Self, OriginError> {
        let wrong = || OriginError(text.to_owned());
        let uri: Uri = text.parse().map_err(|_| wrong())?;
        let authority = uri.authority().ok_or_else(wrong)?;
        let is_web = matches!(uri.scheme_str(), Some("http" | "https"));
        // As browsers write it: nothing behind the port, and no user names.
        let written = format!("{}://{authority}", uri.scheme_str().unwrap_or_default());
        if !is_web || authority.as_str().contains('@') || !written.eq_ignore_ascii_case(text) {
            return Err(wrong());
        }
        Ok(Self(written.to_ascii_lowercase()))
    }
}

impl fmt::Display for Origin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl TryFrom<String> for Origin {
    type Error = OriginError;

    fn try_from(text: String) -> Result<Self, OriginError> {
        text.parse()
    }
}

impl From<Origin> for String {
    fn from(origin: Origin) -> Self {
        origin.0
    }
}

impl WsOptions {
    /// Whether a request with these headers may open a WebSocket. Non-browsers send no origin, and may. A
    /// page may if it was served under the address to which it connects, and that is an IP address or
    /// `localhost`. Anybody can give this machine a name of theirs, so other names must be allowed.
    ///
    /// # Errors
    /// If it may not.
    pub fn check(&self, headers: &HeaderMap) -> Result<(), ForeignOrigin> {
        self.check_at(&Site::of(headers), headers)
    }

    /// The same for a site that knows more of itself. Over TLS a page may connect under any name by which it
    /// was served: strangers have no certificate for it.
    ///
    /// # Errors
    /// If it may not.
    pub fn check_at(&self, site: &Site, headers: &HeaderMap) -> Result<(), ForeignOrigin> {
        let Some(origin) = headers.get(header::ORIGIN) else { return Ok(()) };
        let origin = String::from_utf8_lossy(origin.as_bytes()).into_owned();
        let is_own = origin == site.origin() && site.has_own_name();
        if is_own || self.allow_origins.iter().any(|allowed| allowed.0 == origin) {
            return Ok(());
        }
        Err(ForeignOrigin { origin })
    }

    /// Whether a page requested with these headers may open a WebSocket later. Its origin has the name of the
    /// requested host, by `https` behind a proxy.
    ///
    /// # Errors
    /// If it may not.
    pub fn check_host(&self, headers: &HeaderMap) -> Result<(), ForeignOrigin> {
        self.check_site(&Site::of(headers))
    }

    /// The same for a site that knows more of itself.
    ///
    /// # Errors
    /// If it may not.
    pub fn check_site(&self, site: &Site) -> Result<(), ForeignOrigin> {
        let origins = ["http", "https"].map(|scheme| format!("{scheme}://{}", site.host));
        if site.has_own_name() || self.allow_origins.iter().any(|allowed| origins.contains(&allowed.0)) {
            return Ok(());
        }
        Err(ForeignOrigin { origin: site.origin() })
    }
}

/// Whether nobody else can have given this machine that name.
fn has_no_foreign_name(host: &str) -> bool {
    let Ok(authority) = host.parse::<Authority>() else { return false };
    let host = authority.host();
    let bare = host.strip_prefix('[').and_then(|host| host.strip_suffix(']')).unwrap_or(host);
    host == "localhost" || bare.parse::<std::net::IpAddr>().is_ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_is_served_by_a_name_from_which_it_may_connect() {
        let allow_origins = ["https://plant.example", "http://pages:7480"];
        let options = WsOptions::default()
            .with_allow_origins(allow_origins.map(|origin| origin.parse().unwrap()).into());
        let is_served = |host: &str| {
            let headers = HeaderMap::from_iter([(header::HOST, host.parse().unwrap())]);
            options.check_host(&headers).is_ok()
        };
        for host in ["127.0.0.1:7480", "localhost:1", "[::1]:80", "plant.example", "pages:7480"] {
            assert!(is_served(host), "{host}");
        }
        for host in
            ["", "pages", "pages:7481", "plant.example:7480", "evil.example", "127.0.0.1.evil.example"]
        {
            assert!(!is_served(host), "{host}");
        }
        assert!(options.check_host(&HeaderMap::new()).is_err());
    }

    fn is_taken(options: &WsOptions, origin: Option<&str>, host: &str) -> bool {
        let mut headers = HeaderMap::new();
        headers.insert(header::HOST, host.parse().unwrap());
        if let Some(origin) = origin {
            headers.insert(header::ORIGIN, origin.parse().unwrap());
        }
        options.check(&headers).is_ok()
    }

    #[test]
    fn a_page_may_connect_to_where_it_comes_from_and_no_other() {
        let options = WsOptions::default();
        for host in ["127.0.0.1:7400", "localhost:7400", "[::1]:80", "10.0.0.1"] {
            assert!(is_taken(&options, None, host));
            assert!(is_taken(&options, Some(&format!("http://{host}")), host), "{host}");
            for origin in
                ["null", "", "http://", "http://evil.example", "file://", &format!("https://{host}")]
            {
                assert!(!is_taken(&options, Some(origin), host), "{origin} at {host}");
            }
        }
        assert!(!is_taken(&options, Some("http://localhost:7400"), "localhost:7401"));
    }

    #[test]
    fn a_name_that_somebody_gave_this_machine_opens_nothing_unless_it_is_allowed() {
        let options = WsOptions::default();
        for host in ["evil.example", "localhost.evil.example:80", "127.0.0.1.evil.example"] {
            assert!(!is_taken(&options, Some(&format!("http://{host}")), host), "{host}");
        }
        let allow_origins = vec!["https://plant.example".parse().unwrap()];
        let options = WsOptions::default().with_allow_origins(allow_origins);
        assert!(is_taken(&options, Some("https://plant.example"), "10.0.0.1:7400"));
        assert!(!is_taken(&options, Some("http://plant.example"), "plant.example"));
        assert!(!is_taken(&options, Some("https://plant.example:8443"), "plant.example:8443"));
    }

    #[test]
    fn over_tls_a_page_may_connect_under_the_name_that_its_browser_has_checked() {
        let options = WsOptions::default();
        let is_taken = |is_encrypted, host: &str, origin: &str| {
            let site = Site { is_encrypted, host: host.to_owned() };
            let headers = HeaderMap::from_iter([(header::ORIGIN, origin.parse().unwrap())]);
            assert_eq!(options.check_site(&site).is_ok(), site.has_own_name(), "{site:?}");
            options.check_at(&site, &headers).is_ok()
        };
        for host in ["plant.example", "plant.example:8443", "10.0.0.1:7480"] {
            assert!(is_taken(true, host, &format!("https://{host}")), "{host}");
            assert!(!is_taken(true, host, &format!("http://{host}")), "{host}");
            assert!(!is_taken(false, host, &format!("https://{host}")), "{host}");
        }
        assert!(!is_taken(false, "plant.example", "http://plant.example"));
        // Without its port a host is another one.
        assert!(!is_taken(true, "plant.example", "https://plant.example:8443"));
        assert!(!is_taken(true, "", "https://"));
    }

    #[test]
    fn origins_are_written_as_browsers_do() {
        for text in ["http://plant.example", "https://10.0.0.1:8443", "http://[::1]:80"] {
            assert_eq!(text.parse::<Origin>().unwrap().to_string(), text);
        }
        assert_eq!("HTTPS://Plant.Example".parse::<Origin>().unwrap().to_string(), "https://plant.example");
        for text in
            ["", "plant.example", "ws://a", "http://a/", "http://a/b", "http://u@a", "http://a b", "null"]
        {
            let message = text.parse::<Origin>().unwrap_err().to_string();
            assert!(
                message.contains(&format!("{text:?}")) && message.contains("https://host:port"),
                "{message}"
            );
        }
    }
}
