//! Options of connections over datagrams.

use std::fmt;
use std::time::Duration;

use trimaran_udp::{Config, Repair, Security as Noise};
use trimaran_wire::Format;
use zeroize::Zeroizing;

use crate::handshake::HandshakeError;
use crate::keys::{KnownPeer, Security};
use crate::{LinkConfig, UdpMode, UdpSocketOptions};

/// The largest datagram that fits the buffers here.
pub(crate) const MAX_DATAGRAM: usize = 1500;

/// Options of connections over datagrams.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "config", derive(serde::Serialize, serde::Deserialize, schemars::JsonSchema))]
#[cfg_attr(feature = "config", serde(default, deny_unknown_fields))]
#[non_exhaustive]
pub struct UdpOptions {
    /// The authentication of peers. Default by keys.
    pub trust: Trust,
    /// The mode for frames sent from here that do not arrive in time, unless the endpoint names one. Default
    /// reliable.
    pub mode: UdpMode,
    /// How long after its end a frame sent from here may arrive, in the mode with deadlines. Default 50 ms.
    #[cfg_attr(
        feature = "config",
        serde(rename = "deadline_ms", with = "range::deadline_ms"),
        schemars(with = "f64")
    )]
    pub deadline: Duration,
    /// When frames sent from here get forward error correction, with which most losses cost no time. Default
    /// while packets are lost.
    pub repair: Repair,
    /// The largest share of repair packets, percent of the frames' own bytes. 0 for none. Default 15.
    #[cfg_attr(feature = "config", serde(deserialize_with = "range::repair_percent"))]
    pub repair_percent: u8,
    /// The initial window in packets, at least 2: ten leave at once, the rest over the round trip. Default
    /// 20.
    #[cfg_attr(feature = "config", serde(deserialize_with = "range::initial_window"))]
    pub initial_window: u16,
    /// The largest datagram that is probed, bytes: 1,200 are always used, and at most 1,500 are. Default
    /// 1,452.
    #[cfg_attr(feature = "config", serde(deserialize_with = "range::max_datagram"))]
    pub max_datagram: usize,
    /// How many bytes of frames may be in flight in each direction, sent and not read. Both sides must have
    /// the same. Default 4 MiB.
    pub window: u32,
    /// How many bytes of frames this side keeps until they are acknowledged. Default 4 MiB.
    pub send_buffer: usize,
    /// The UDP socket.
    pub socket: UdpSocketOptions,
}

impl UdpOptions {
    trimaran_net::setters! {
        with_trust trust: Trust,
        with_mode mode: UdpMode,
        with_deadline deadline: Duration,
        with_repair repair: Repair,
        with_repair_percent repair_percent: u8,
        with_initial_window initial_window: u16,
        with_max_datagram max_datagram: usize,
        with_window window: u32,
        with_send_buffer send_buffer: usize,
        with_socket socket: UdpSocketOptions,
    }
}

/// The authentication of peers. Both sides need the same kind.
#[derive(Clone, PartialEq, Eq, Default)]
#[cfg_attr(feature = "config", derive(serde::Serialize, serde::Deserialize, schemars::JsonSchema))]
#[cfg_attr(feature = "config", serde(rename_all = "kebab-case"))]
#[non_exhaustive]
pub enum Trust {
    /// Each has keys and knows the other's public ones: those of
    /// [`Options::security`](crate::Options::security).
    #[default]
    Keys,
    /// Both hold these 32 random bytes, which make a peer. Wiped from memory when dropped.
    #[cfg_attr(feature = "config", serde(skip))]
    SharedKey(Zeroizing<[u8; 32]>),
    /// No encryption and no authentication: only for trusted networks.
    #[cfg_attr(feature = "config", serde(rename = "plain"))]
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
    /// The security of a listener.
    pub(super) fn listening(&self, known: Option<&Security>) -> Result<Noise, HandshakeError> {
        Ok(match self {
            Self::SharedKey(key) => Noise::PreShared(key.clone()),
            Self::Plaintext => Noise::Plaintext,
            Self::Keys => {
                let Security { keys, peers } = known.ok_or(HandshakeError::NoKeys)?;
                Noise::Pinned { own: keys.noise().to_bytes(), peers: pinned(&peers.now()) }
            }
        })
    }

    /// The securities to try with a listener, which may be any of the peers: the first message is sealed for
    /// one of them.
    pub(super) fn connecting(&self, known: Option<&Security>) -> Result<Vec<Noise>, HandshakeError> {
        Ok(match self.listening(known)? {
            Noise::Pinned { own, peers } => {
                peers.into_iter().map(|peer| Noise::Pinned { own: own.clone(), peers: vec![peer] }).collect()
            }
            other => vec![other],
        })
    }
}

/// The public keys of these peers, each once. A key may be known for several roles. They are tried in the order
/// given.
pub(super) fn pinned(peers: &[KnownPeer]) -> Vec<[u8; 32]> {
    let mut known = Vec::with_capacity(peers.len());
    for key in peers.iter().map(|peer| peer.keys.udp.to_bytes()) {
        if !known.contains(&key) {
            known.push(key);
        }
    }
    known
}

impl Default for UdpOptions {
    fn default() -> Self {
        let Config { window, send_buffer, repair, repair_percent, initial_window, max_datagram, .. } =
            Config::new(Format::default());
        Self {
            trust: Trust::default(),
            mode: UdpMode::default(),
            deadline: Duration::from_millis(50),
            repair,
            repair_percent,
            initial_window,
            max_datagram,
            window: u32::try_from(window).unwrap_or(u32::MAX),
            send_buffer,
            socket: UdpSocketOptions::default(),
        }
    }
}

impl UdpOptions {
    /// The configuration of a connection whose endpoint asks for `mode`.
    pub(super) fn config(&self, mode: Option<UdpMode>, link: &LinkConfig, format: Format) -> Config {
        let frame_deadline = match mode.unwrap_or(self.mode) {
            UdpMode::Reliable => None,
            UdpMode::Deadline => Some(self.deadline),
        };
        Config {
            frame_deadline,
            repair: self.repair,
            repair_percent: self.repair_percent,
            initial_window: self.initial_window,
            max_datagram: self.max_datagram.min(MAX_DATAGRAM),
            idle_timeout: link.idle_timeout,
            window: self.window.into(),
            send_buffer: self.send_buffer,
            ..Config::new(format)
        }
    }

    pub(super) fn is_encrypted(&self) -> bool {
        self.trust != Trust::Plaintext
    }
}

#[cfg(feature = "config")]
mod range {
    //! Ranges of the options, for a configuration file.

    use serde::Deserializer;

    use super::MAX_DATAGRAM;
    use crate::config::range::within;
    use crate::udp::MIN_DATAGRAM;

    pub(super) fn repair_percent<'de, D: Deserializer<'de>>(deserializer: D) -> Result<u8, D::Error> {
        within(deserializer, &(1..=100))
    }

    pub(super) fn initial_window<'de, D: Deserializer<'de>>(deserializer: D) -> Result<u16, D::Error> {
        within(deserializer, &(2..=100))
    }

    pub(super) fn max_datagram<'de, D: Deserializer<'de>>(deserializer: D) -> Result<usize, D::Error> {
        within(deserializer, &(MIN_DATAGRAM..=MAX_DATAGRAM))
    }

    /// How long after its end a frame may arrive.
    pub(super) mod deadline_ms {
        use std::time::Duration;

        use serde::{Deserializer, Serialize, Serializer};

        use crate::config::range::within;

        pub(crate) fn serialize<S: Serializer>(time: &Duration, serializer: S) -> Result<S::Ok, S::Error> {
            (time.as_secs_f64() * 1e3).serialize(serializer)
        }

        pub(crate) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Duration, D::Error> {
            within(deserializer, &(0.001..=86_400_000.0)).map(|ms| Duration::from_secs_f64(ms / 1e3))
        }
    }
}
