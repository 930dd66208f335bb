//! Who is let in: the key files that a configuration names.

use std::path::Path;

use trimaran_proto::Role;
use trimaran_transport::{
    Endpoint, Endpoints, Options,
    keys::{Keys, KnownPeer, PublicKeys, Security},
    udp::Trust,
};

use super::ConfigError;

/// A peer's public keys, as a configuration names them.
#[derive(Debug, Clone, Copy)]
pub struct PeerFile<'p> {
    /// The key of the configuration.
    pub name: &'static str,
    /// The role that their holder may have; any if not given.
    pub role: Option<Role>,
    /// The file, where one is named.
    pub path: Option<&'p Path>,
}

/// Whether both sides prove who they are at `endpoint`.
#[must_use]
pub fn needs_keys(options: &Options, endpoint: &Endpoint) -> bool {
    match endpoint {
        Endpoint::Udp(_) => options.udp.trust == Trust::Keys,
        other => other.needs_keys(),
    }
}

/// What guards the links made at `endpoints`: this machine's `keys`, and the public ones of its `peers`, each
/// for its role. None where no endpoint needs any.
///
/// # Errors
/// When a file that is needed is not named, or cannot be used.
pub fn security(
    options: &Options,
    endpoints: &Endpoints,
    keys: Option<&Path>,
    peers: &[PeerFile<'_>],
) -> Result<Option<Security>, ConfigError> {
    let Some(endpoint) = endpoints.iter().find(|endpoint| needs_keys(options, endpoint)) else {
        return Ok(None);
    };
    let no_keys = |peer| ConfigError::NoKeys { endpoint: endpoint.clone(), peer };
    // A display may have one machine that comes over another transport: so one peer is enough, but it takes
    // one.
    let known = peers
        .iter()
        .filter_map(|peer| peer.path.map(|path| (path, peer.role)))
        .map(|(path, role)| Ok(KnownPeer { keys: PublicKeys::read(path)?, role: role.map(Into::into) }))
        .collect::<Result<Vec<_>, ConfigError>>()?;
    match (keys, peers) {
        (Some(keys), _) if !known.is_empty() => Ok(Some(Security { keys: Keys::read(keys)?, peers: known })),
        (_, [peer, ..]) => Err(no_keys(peer.name)),
        (_, []) => Err(no_keys("peers")),
    }
}
