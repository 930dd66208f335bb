//! A remote service of a scene: the window's requests outside its links, like those of a page.

use std::{str::FromStr, time::Duration};

use serde::Deserialize;
use thiserror::Error;
use tokio::runtime::Handle;
use trimaran_proto::Viewport;
use trimaran_scene::heightfield::Tile;
use trimaran_transport::{Endpoint, EndpointError, Net, Options, TokioNet, until, ws::WsOptions};

use super::navigate::Start;
use crate::http::{GetError, get, get_over_tls};

/// The timeout of a request.
pub(super) const TIMEOUT: Duration = Duration::from_secs(10);

/// The address of a service, and the token that grants access.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ServiceAt {
    /// Whether it is reached over TLS.
    is_encrypted: bool,
    /// Host and port.
    at: String,
    token: String,
    ws: WsOptions,
}

/// A text is not the address of a service.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("give the address that `trimaran serve` has printed: http://HOST:PORT/?token=TOKEN, or https://..")]
pub struct NoService;

/// Why a request to a service failed.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum AskError {
    /// The request failed.
    #[error(transparent)]
    Get(#[from] GetError),
    /// It timed out.
    #[error("it has not answered within {TIMEOUT:?}")]
    Late,
    /// The answer is invalid. The service may be of another release.
    #[error("its answer cannot be read")]
    Answer(#[source] serde_json::Error),
    /// The answer is not a valid tile.
    #[error("it has sent something that is no tile")]
    Tile,
    /// The address of its links is invalid.
    #[error("it has no links there")]
    Link(#[source] EndpointError),
}

/// A service's description of its scene.
#[derive(Debug, Clone, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Described {
    pub(super) name: String,
    has_floors: bool,
    eye_height: f64,
    pub(super) tile_side: f64,
    pub(super) clearance: f64,
    vfov_deg: f64,
    pub(super) max_picture: Viewport,
    start: Place,
}

#[derive(Debug, Clone, Deserialize)]
struct Place {
    eye: [f64; 3],
    forward: [f64; 3],
}

impl Described {
    /// Where a person begins.
    pub(super) fn start(&self) -> Start {
        let Self { has_floors, eye_height, vfov_deg, start, .. } = self;
        let (eye, forward) = (start.eye.into(), start.forward.into());
        Start { eye, forward, eye_height: *eye_height, has_floors: *has_floors, vfov_deg: *vfov_deg }
    }
}

impl ServiceAt {
    /// The same, reached with these options.
    #[must_use]
    pub fn with_ws(self, ws: WsOptions) -> Self {
        Self { ws, ..self }
    }

    /// The endpoint of its links.
    pub(super) fn endpoint(&self) -> Result<Endpoint, AskError> {
        let scheme = if self.is_encrypted { "wss" } else { "ws" };
        format!("{scheme}://{}/link?token={}", self.at, self.token).parse().map_err(AskError::Link)
    }

    /// The options of its links.
    pub(super) fn options(&self) -> Options {
        Options::default().with_ws(self.ws.clone())
    }

    /// Gets the description of its scene.
    pub(super) fn describe(&self, runtime: &Handle) -> Result<Described, AskError> {
        let text = self.ask("/scene", "", runtime)?;
        serde_json::from_slice(&text).map_err(AskError::Answer)
    }

    /// Gets a tile of the heightfield.
    pub(super) fn tile(&self, x: i32, z: i32, runtime: &Handle) -> Result<Tile, AskError> {
        let bytes = self.ask("/tile", &format!("&x={x}&z={z}"), runtime)?;
        Tile::from_bytes(&bytes).ok_or(AskError::Tile)
    }

    fn ask(&self, what: &str, which: &str, runtime: &Handle) -> Result<Vec<u8>, AskError> {
        let target = format!("{what}?token={}{which}", self.token);
        let (net, links) = (TokioNet::new(runtime.clone()), self.endpoint()?);
        let answer = async {
            match &links {
                Endpoint::Wss(links) => get_over_tls(&links.at, &target, &self.ws).await,
                _ => get(&self.at, &target).await,
            }
        };
        let answer = runtime.block_on(until(&net, net.now().after(TIMEOUT), answer));
        Ok(answer.ok_or(AskError::Late)??.to_vec())
    }
}

impl FromStr for ServiceAt {
    type Err = NoService;

    fn from_str(url: &str) -> Result<Self, NoService> {
        let (scheme, rest) = url.split_once("://").ok_or(NoService)?;
        let (is_encrypted, usual_port) = match scheme {
            "http" => (false, 80),
            "https" => (true, 443),
            _ => return Err(NoService),
        };
        let (at, rest) = rest.split_once('/').ok_or(NoService)?;
        let (_, query) = rest.split_once('?').ok_or(NoService)?;
        let query = query.split_once('#').map_or(query, |(query, _)| query);
        let token = query.split('&').find_map(|pair| pair.strip_prefix("token=")).ok_or(NoService)?;
        let is_plain = |text: &str, more: &str| {
            !text.is_empty() && text.chars().all(|c| c.is_ascii_alphanumeric() || more.contains(c))
        };
        if !is_plain(at, ".:-[]_") || !is_plain(token, "-_") {
            return Err(NoService);
        }
        let at = if at.rsplit_once(':').is_some_and(|(_, port)| port.parse::<u16>().is_ok()) {
            at.to_owned()
        } else {
            format!("{at}:{usual_port}")
        };
        Ok(Self { is_encrypted, at, token: token.to_owned(), ws: WsOptions::default() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_address_that_serve_prints_is_read_and_nothing_else() {
        let read = |url: &str| url.parse::<ServiceAt>().map(|service| (service.at, service.token));
        let of = |at: &str| Ok((at.to_owned(), "0123456789abcdef".to_owned()));
        assert_eq!(read("http://10.0.0.1:7480/?token=0123456789abcdef"), of("10.0.0.1:7480"));
        assert_eq!(read("http://[::1]:7480/?token=0123456789abcdef#view=7"), of("[::1]:7480"));
        assert_eq!(read("http://plant.example/?a=b&token=0123456789abcdef"), of("plant.example:80"));
        assert_eq!(read("https://plant.example/?token=0123456789abcdef"), of("plant.example:443"));
        for bad in [
            "plant.scene",
            "ftp://plant.example/?token=0123456789abcdef",
            "http://plant.example",
            "http://plant.example/",
            "http://plant.example/?token=",
            "http:///?token=0123456789abcdef",
            "http://a b/?token=0123456789abcdef",
            "http://plant.example/?token=a\r\nb",
        ] {
            assert_eq!(read(bad), Err(NoService), "{bad}");
        }
    }

    #[test]
    fn links_are_where_pages_have_them() {
        let links = |url: &str| url.parse::<ServiceAt>().unwrap().endpoint().unwrap().to_string();
        let at = "10.0.0.1:7480/link?token=0123456789abcdef";
        assert_eq!(links("http://10.0.0.1:7480/?token=0123456789abcdef"), format!("ws://{at}"));
        assert_eq!(links("https://10.0.0.1:7480/?token=0123456789abcdef"), format!("wss://{at}"));
    }
}
