//! How WebSockets are set up.

use super::Origin;

/// Options of WebSockets. Those of TCP hold for them as well.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
#[cfg_attr(feature = "config", derive(serde::Serialize, serde::Deserialize, schemars::JsonSchema))]
#[cfg_attr(feature = "config", serde(default, deny_unknown_fields))]
pub struct WsOptions {
    /// Pages from where may connect, as a browser names it: `https://host` or `http://host:port`. Needed
    /// where the page has another host or port than the listener, behind a proxy, and where the listener has
    /// a name. Default none.
    pub allow_origins: Vec<Origin>,
}
