//! The configuration of a zenoh session between two peers.

use anyhow::{Result, anyhow};
use zenoh::Config;

/// Listens or connects, as `key` says, at `endpoint` over TCP, and looks for nobody else.
pub(crate) fn config(key: &str, endpoint: &str) -> Result<Config> {
    let mut config = Config::default();
    for (key, value) in [
        ("mode", "\"peer\"".to_owned()),
        ("scouting/multicast/enabled", "false".to_owned()),
        ("scouting/gossip/enabled", "false".to_owned()),
        ("listen/endpoints", "[]".to_owned()),
        (key, format!("[\"tcp/{endpoint}\"]")),
    ] {
        config.insert_json5(key, &value).map_err(|e| anyhow!(e))?;
    }
    Ok(config)
}
