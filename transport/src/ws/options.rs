//! Options of WebSockets.

use std::path::PathBuf;

use super::Origin;

/// Options of WebSockets. Those of TCP apply as well.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
#[cfg_attr(feature = "config", derive(serde::Serialize, serde::Deserialize, schemars::JsonSchema))]
#[cfg_attr(feature = "config", serde(default, deny_unknown_fields))]
#[non_exhaustive]
pub struct WsOptions {
    /// The origins of pages that may connect, as a browser names them: `https://host` or `http://host:port`.
    /// Needed if the page has another host or port than the listener, behind a proxy, and if the listener has
    /// a name. Default none.
    pub allow_origins: Vec<Origin>,
    /// The certificate authorities, a PEM file, that vouch for the listeners of `wss://`, such as a
    /// plant's own. Default those of the system.
    pub ca: Option<PathBuf>,
}

impl WsOptions {
    trimaran_net::setters! {
        with_allow_origins allow_origins: Vec<Origin>,
        with_ca ca: Option<PathBuf>,
    }
}
