//! The needs of a role: of its machine and of its peers, as its configuration says.

use std::path::Path;

use trimaran_proto::Role;
use trimaran_transport::{Endpoints, Options, keys::Security};

use super::{
    CommonConfig, ConfigError, CullerConfig, DisplayConfig, GpuConfig, PeerFiles, RelayConfig, WatcherConfig,
    security,
};

/// Peers that a role connects to.
#[derive(Debug, Clone, Copy)]
pub struct SoughtPeers<'c> {
    /// The key of the configuration that names them.
    pub key: &'static str,
    /// Their role.
    pub role: Role,
    /// Where they listen.
    pub endpoints: &'c Endpoints,
}

/// The needs of a role: of its machine and of its peers.
pub trait RoleNeeds: Send + Sync {
    /// How it introduces itself to its peers.
    fn role(&self) -> Role;

    /// The keys of every role.
    fn common(&self) -> &CommonConfig;

    /// Its device, if it draws.
    fn gpu(&self) -> Option<&GpuConfig>;

    /// Its scene, if it has one.
    fn scene(&self) -> Option<&Path>;

    /// Where it listens.
    fn listen(&self) -> Option<&Endpoints>;

    /// The peers that it connects to.
    fn sought(&self) -> Vec<SoughtPeers<'_>>;

    /// The public keys of its peers.
    fn known(&self) -> Vec<PeerFiles<'_>>;

    /// The configuration of a display that leads.
    fn display(&self) -> Option<&DisplayConfig> {
        None
    }

    /// The security of its links, with its private keys from the file `keys`.
    ///
    /// # Errors
    /// When a file that is needed is not named, or cannot be used.
    fn security_with(&self, options: &Options, keys: Option<&Path>) -> Result<Option<Security>, ConfigError> {
        let sought = self.sought();
        let sought = sought.iter().flat_map(|peers| peers.endpoints.iter());
        let endpoints = self.listen().into_iter().flat_map(Endpoints::iter).chain(sought);
        security(options, endpoints, keys, &self.known())
    }

    /// The security of its links.
    ///
    /// # Errors
    /// When a file that is needed is not named, or cannot be used.
    fn security(&self, options: &Options) -> Result<Option<Security>, ConfigError> {
        self.security_with(options, self.common().keys.as_deref())
    }
}

/// The peers of a key that may be missing.
fn sought<'c>(key: &'static str, role: Role, endpoints: Option<&'c Endpoints>) -> Option<SoughtPeers<'c>> {
    endpoints.map(|endpoints| SoughtPeers { key, role, endpoints })
}

impl RoleNeeds for CullerConfig {
    fn role(&self) -> Role {
        Role::Culler
    }

    fn common(&self) -> &CommonConfig {
        &self.common
    }

    fn gpu(&self) -> Option<&GpuConfig> {
        Some(&self.gpu)
    }

    fn scene(&self) -> Option<&Path> {
        Some(&self.scene)
    }

    fn listen(&self) -> Option<&Endpoints> {
        self.listen.as_ref()
    }

    fn sought(&self) -> Vec<SoughtPeers<'_>> {
        let displays = sought("displays", Role::Display, self.displays.as_ref());
        displays.into_iter().chain(sought("cullers", Role::Culler, self.cullers.as_ref())).collect()
    }

    fn known(&self) -> Vec<PeerFiles<'_>> {
        vec![
            PeerFiles { name: "peers.displays", role: Some(Role::Display), paths: &self.peers.displays },
            PeerFiles { name: "peers.cullers", role: Some(Role::Culler), paths: &self.peers.cullers },
        ]
    }
}

impl RoleNeeds for DisplayConfig {
    fn role(&self) -> Role {
        Role::Display
    }

    fn common(&self) -> &CommonConfig {
        &self.common
    }

    fn gpu(&self) -> Option<&GpuConfig> {
        Some(&self.gpu)
    }

    fn scene(&self) -> Option<&Path> {
        self.scene.as_deref()
    }

    fn listen(&self) -> Option<&Endpoints> {
        self.listen.as_ref()
    }

    fn sought(&self) -> Vec<SoughtPeers<'_>> {
        sought("cullers", Role::Culler, self.cullers.as_ref()).into_iter().collect()
    }

    fn known(&self) -> Vec<PeerFiles<'_>> {
        vec![PeerFiles { name: "peers.cullers", role: Some(Role::Culler), paths: &self.peers.cullers }]
    }

    fn display(&self) -> Option<&DisplayConfig> {
        Some(self)
    }
}

impl RoleNeeds for RelayConfig {
    fn role(&self) -> Role {
        Role::Relay
    }

    fn common(&self) -> &CommonConfig {
        &self.common
    }

    fn gpu(&self) -> Option<&GpuConfig> {
        None
    }

    fn scene(&self) -> Option<&Path> {
        None
    }

    fn listen(&self) -> Option<&Endpoints> {
        Some(&self.listen)
    }

    fn sought(&self) -> Vec<SoughtPeers<'_>> {
        sought("upstream", Role::Culler, Some(&self.upstream)).into_iter().collect()
    }

    fn known(&self) -> Vec<PeerFiles<'_>> {
        vec![
            PeerFiles { name: "peers.upstream", role: Some(Role::Culler), paths: &self.peers.upstream },
            PeerFiles { name: "peers.displays", role: Some(Role::Display), paths: &self.peers.displays },
        ]
    }
}

impl RoleNeeds for WatcherConfig {
    fn role(&self) -> Role {
        Role::Display
    }

    fn common(&self) -> &CommonConfig {
        &self.common
    }

    fn gpu(&self) -> Option<&GpuConfig> {
        Some(&self.gpu)
    }

    fn scene(&self) -> Option<&Path> {
        Some(&self.scene)
    }

    fn listen(&self) -> Option<&Endpoints> {
        None
    }

    fn sought(&self) -> Vec<SoughtPeers<'_>> {
        sought("relay", Role::Relay, Some(&self.relay)).into_iter().collect()
    }

    fn known(&self) -> Vec<PeerFiles<'_>> {
        vec![PeerFiles { name: "peers.relay", role: Some(Role::Culler), paths: &self.peers.relay }]
    }
}
