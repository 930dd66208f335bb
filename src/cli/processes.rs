//! The cullers of `trimaran run --link` over anything but `inproc`: each a `trimaran role culler` on this
//! machine.

use std::{
    net::{SocketAddr, TcpListener, UdpSocket},
    path::{Path, PathBuf},
    process::Stdio,
};

use bytesize::ByteSize;
use tokio::{
    process::{Child, ChildStdin, Command},
    runtime::Runtime,
};
use trimaran::config::{CommonConfig, CullerConfig, CullerPeers, GpuConfig};
use trimaran_actors::{CullerId, PeerEndpoint};
use trimaran_proto::Role;
use trimaran_transport::{
    Endpoint, Endpoints, Name, Options, SocketPath,
    keys::{KeyFiles, Keys, KnownPeer, Security},
};

use super::{
    Failure,
    args::{LinkKind, RunArgs},
};

/// Keys that live as long as the session: display and cullers authenticate each other.
pub(super) struct Keyring {
    /// The display's own key, and the cullers' public keys.
    pub(super) security: Security,
    display: KeyFiles,
    cullers: Vec<KeyFiles>,
}

impl Keyring {
    /// For a display and this many cullers.
    pub(super) fn make(folder: &Path, cullers: usize) -> Result<Self, Failure> {
        let make = |name: &str| {
            let name = name.parse().map_err(Failure::broken)?;
            let keys = Keys::generate(name).map_err(Failure::broken)?;
            let files = keys.save(folder).map_err(Failure::broken)?;
            Ok::<_, Failure>((keys, files))
        };
        let (keys, display) = make("display")?;
        let each = (1..=cullers).map(|culler| make(&format!("culler-{culler}")));
        let (known, cullers): (Vec<_>, Vec<_>) = each.collect::<Result<Vec<_>, _>>()?.into_iter().unzip();
        let peers = known.iter().map(|keys| KnownPeer::in_role(keys.public().clone(), Role::Culler));
        Ok(Self { security: Security { keys, peers: peers.collect() }, display, cullers })
    }

    /// The private key of a culler, and the public keys of its peers.
    fn of(&self, culler: CullerId) -> (Option<PathBuf>, CullerPeers) {
        let own = self.cullers.get(culler.index()).map(|own| own.private.clone());
        let cullers = self.cullers.iter().map(|files| files.public.clone()).collect();
        (own, CullerPeers { displays: vec![self.display.public.clone()], cullers })
    }
}

/// Where this many cullers listen: sockets in `folder`, or free ports of loopback.
pub(super) fn endpoints(link: LinkKind, cullers: usize, folder: &Path) -> Result<Vec<Endpoint>, Failure> {
    let any = SocketAddr::from(([127, 0, 0, 1], 0));
    // Each port is held until all are chosen, so that none is chosen twice.
    let mut held: (Vec<TcpListener>, Vec<UdpSocket>) = Default::default();
    let mut tcp = || {
        let listener = TcpListener::bind(any)?;
        let at = listener.local_addr();
        held.0.push(listener);
        at
    };
    let mut udp = || {
        let socket = UdpSocket::bind(any)?;
        let at = socket.local_addr();
        held.1.push(socket);
        at
    };
    let mut endpoint = |culler: CullerId| {
        Ok(match link {
            LinkKind::Inproc => Endpoint::Inproc(Name::unique()),
            LinkKind::Unix => {
                let socket = folder.join(format!("culler-{}.sock", culler.index() + 1));
                Endpoint::Unix(SocketPath::new(socket).map_err(Failure::broken)?)
            }
            LinkKind::Tcp => Endpoint::Tcp(tcp().map_err(Failure::broken)?.into()),
            LinkKind::Ws => Endpoint::Ws(tcp().map_err(Failure::broken)?.into()),
            LinkKind::Quic => Endpoint::Quic(udp().map_err(Failure::broken)?.into()),
            LinkKind::Udp => Endpoint::Udp(udp().map_err(Failure::broken)?.into()),
        })
    };
    CullerId::first(cullers).map(&mut endpoint).collect()
}

/// All of them but one.
fn others(endpoints: &[Endpoint], but: &Endpoint) -> Option<Endpoints> {
    let others = endpoints.iter().filter(|endpoint| *endpoint != but).cloned();
    others.fold(None, |others: Option<Endpoints>, endpoint| {
        Some(match others {
            Some(others) => others.and(endpoint),
            None => endpoint.into(),
        })
    })
}

/// The cullers, which end when this is dropped.
pub(super) struct CullerProcesses(Vec<CullerProcess>);

struct CullerProcess {
    id: CullerId,
    endpoint: Endpoint,
    child: Child,
    /// The child ends when this pipe closes, so it never outlives this process.
    _input: Option<ChildStdin>,
}

impl CullerProcesses {
    /// Starts one at each of `endpoints`, with the scene and the device of `args`.
    pub(super) fn start(
        args: &RunArgs,
        options: &Options,
        endpoints: Vec<Endpoint>,
        keyring: Option<&Keyring>,
        folder: &Path,
        runtime: &Runtime,
    ) -> Result<Self, Failure> {
        let scene = std::path::absolute(&args.scene).map_err(Failure::broken)?;
        let start = |(id, endpoint): (CullerId, Endpoint)| {
            let (keys, peers) = keyring.map(|keyring| keyring.of(id)).unwrap_or_default();
            let config = CullerConfig {
                scene: scene.clone(),
                listen: Some(endpoint.clone().into()),
                displays: None,
                cullers: others(&endpoints, &endpoint),
                culling: args.culling,
                // They serve only this display, which may use all that the device can do.
                max_picture: "65536x65536".to_owned(),
                depth_memory: Some(ByteSize::tib(1)),
                for_one_session: false,
                gpu: GpuConfig {
                    device: args.walk.device.clone(),
                    gpu_memory: args.walk.gpu_memory,
                    device_timeout_s: args.walk.device_timeout,
                    check_device: args.walk.check_device,
                },
                common: CommonConfig { join_timeout_s: 120.0, metrics: None, log: None, keys },
                peers,
            };
            let path = folder.join(format!("culler-{}.toml", id.index() + 1));
            let own = toml::to_string(&config).map_err(Failure::broken)?;
            let links = toml::to_string(options).map_err(Failure::broken)?;
            std::fs::write(&path, own + &links).map_err(Failure::broken)?;
            let program = std::env::current_exe().map_err(Failure::broken)?;
            let mut command = Command::new(program);
            command.args(["role", "culler", "--until-input-ends", "--config"]).arg(&path);
            let _within = runtime.enter();
            let command = command.stdin(Stdio::piped()).kill_on_drop(true);
            let mut child = command.spawn().map_err(Failure::broken)?;
            let input = child.stdin.take();
            Ok(CullerProcess { id, endpoint, child, _input: input })
        };
        let ids = CullerId::first(endpoints.len());
        Ok(Self(ids.zip(endpoints.iter().cloned()).map(start).collect::<Result<_, _>>()?))
    }

    /// Where the display finds them.
    pub(super) fn peers(&self, options: &Options) -> Vec<PeerEndpoint> {
        let peer = |culler: &CullerProcess| PeerEndpoint {
            endpoint: culler.endpoint.clone(),
            options: options.clone(),
        };
        self.0.iter().map(peer).collect()
    }

    /// Waits until one of them ends, and describes a failure of one that ended before it had come.
    pub(super) async fn ended_early(&mut self) -> Failure {
        let each = self.0.iter_mut().map(|culler| Box::pin(async { (culler.id, culler.child.wait().await) }));
        let (id, ended) = match each.len() {
            0 => std::future::pending().await,
            _ => futures_util::future::select_all(each).await.0,
        };
        match ended {
            Ok(status) => Failure::broken(format!(
                "{id} ended with {status} before it had joined the session; its own words are above"
            )),
            Err(e) => Failure::broken(e),
        }
    }
}
