//! The peers that are let in: the key files that a configuration names.

use std::path::{Path, PathBuf};

use trimaran_proto::Role;
use trimaran_transport::{
    Endpoint, Options,
    keys::{Keys, KnownPeer, PublicKeys, Security},
    udp::Trust,
};

use super::ConfigError;

/// The public keys of peers, as a configuration names them.
#[derive(Debug, Clone, Copy)]
pub struct PeerFiles<'p> {
    /// The key of the configuration.
    pub name: &'static str,
    /// The role that their holders may have; any if not given.
    pub role: Option<Role>,
    /// The files.
    pub paths: &'p [PathBuf],
}

/// Whether both sides prove who they are at `endpoint`.
#[must_use]
pub fn needs_keys(options: &Options, endpoint: &Endpoint) -> bool {
    match endpoint {
        Endpoint::Udp(_) => options.udp.trust == Trust::Keys,
        other => other.needs_keys(),
    }
}

/// The security of the links made at `endpoints`: this machine's `keys`, and the public ones of its `peers`,
/// each for its role. None where no endpoint needs any.
///
/// # Errors
/// When a file that is needed is not named, or cannot be used.
pub fn security<'e>(
    options: &Options,
    mut endpoints: impl Iterator<Item = &'e Endpoint>,
    keys: Option<&Path>,
    peers: &[PeerFiles<'_>],
) -> Result<Option<Security>, ConfigError> {
    let Some(endpoint) = endpoints.find(|endpoint| needs_keys(options, endpoint)) else {
        return Ok(None);
    };
    // Some peers may come over another transport, so one is enough, but it takes one.
    let known = peers
        .iter()
        .flat_map(|peers| peers.paths.iter().map(|path| (path, peers.role)))
        .map(|(path, role)| {
            let mut peer = KnownPeer::from(PublicKeys::read(path)?);
            peer.role = role.map(Into::into);
            Ok(peer)
        })
        .collect::<Result<Vec<_>, ConfigError>>()?;
    match keys {
        Some(keys) if !known.is_empty() => {
            Ok(Some(Security { keys: Keys::read(keys)?, peers: known.into() }))
        }
        _ => {
            let peer = peers.first().map_or("peers", |peers| peers.name);
            Err(ConfigError::NoKeys { endpoint: endpoint.clone(), peer })
        }
    }
}
