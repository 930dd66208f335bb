//! How connections over datagrams are set up.

use std::fmt;

use trimaran_udp::{Config, Security as Noise};

use crate::handshake::HandshakeError;
use crate::keys::Security;
use crate::{LinkConfig, UdpSocketOptions};

/// Options of connections over datagrams.
#[derive(Debug, Clone, PartialEq)]
pub struct UdpOptions {
    /// What makes peers trust each other. Default their keys.
    pub trust: Trust,
    /// How many bytes of frames may be under way in each direction, sent and not read. Both sides must have the same. Default
    /// 4 MiB.
    pub window: u32,
    /// How many bytes of frames this side keeps until they are acknowledged. Default 4 MiB.
    pub send_buffer: usize,
    /// The UDP socket.
    pub socket: UdpSocketOptions,
}

/// What makes peers trust each other. Both sides need the same kind.
#[derive(Clone, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Trust {
    /// Each has keys and knows the other's public ones: those of [`Options::security`](crate::Options::security).
    #[default]
    Keys,
    /// Both hold these 32 random bytes: who has them is a peer.
    SharedKey([u8; 32]),
    /// Nothing is hidden and nobody is checked: only for trusted networks.
    Plaintext,
}

impl fmt::Debug for Trust {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Keys => "Keys",
            Self::SharedKey(_) => "SharedKey",
            Self::Plaintext => "Plaintext",
        })
    }
}

impl Trust {
    /// What a listener takes.
    pub(super) fn listening(&self, known: Option<&Security>) -> Result<Noise, HandshakeError> {
        Ok(match self {
            Self::SharedKey(key) => Noise::PreShared(*key),
            Self::Plaintext => Noise::Plaintext,
            Self::Keys => {
                let Security { keys, peers } = known.ok_or(HandshakeError::NoKeys)?;
                let peers = peers.iter().map(|peer| peer.udp.to_bytes()).collect();
                Noise::Pinned { own: keys.noise().to_bytes(), peers }
            }
        })
    }

    /// What to try with a listener, which may be any of the peers: the first message is sealed for one of them.
    pub(super) fn connecting(&self, known: Option<&Security>) -> Result<Vec<Noise>, HandshakeError> {
        Ok(match self.listening(known)? {
            Noise::Pinned { own, peers } => {
                peers.into_iter().map(|peer| Noise::Pinned { own, peers: vec![peer] }).collect()
            }
            other => vec![other],
        })
    }
}

impl Default for UdpOptions {
    fn default() -> Self {
        let Config { window, send_buffer, .. } = Config::default();
        Self {
            trust: Trust::default(),
            window: u32::try_from(window).unwrap_or(u32::MAX),
            send_buffer,
            socket: UdpSocketOptions::default(),
        }
    }
}

impl UdpOptions {
    pub(super) fn config(&self, link: &LinkConfig) -> Config {
        Config {
            lease: link.lease,
            window: self.window.into(),
            send_buffer: self.send_buffer,
            ..Config::default()
        }
    }

    pub(super) fn is_encrypted(&self) -> bool {
        self.trust != Trust::Plaintext
    }
}
