//! The cullers of `trimaran run --link` over anything but `inproc`: two of `trimaran role culler` on this
//! machine.

use std::{
    net::{SocketAddr, TcpListener, UdpSocket},
    path::{Path, PathBuf},
};

use tokio::{
    process::{Child, Command},
    runtime::Runtime,
};
use trimaran::config::{CullerConfig, CullerPeers, Which};
use trimaran_actors::JoinTimeouts;
use trimaran_proto::Role;
use trimaran_transport::{
    Endpoint, Name, Options, SocketPath,
    keys::{KeyFiles, Keys, KnownPeer, Security},
};

use super::{
    Failure,
    args::{LinkKind, RunArgs},
};

/// Keys that live as long as the session: each of the three knows the two others.
pub(super) struct Keyring {
    /// The display's own, and whom it knows.
    pub(super) security: Security,
    display: KeyFiles,
    cullers: [KeyFiles; 2],
}

impl Keyring {
    pub(super) fn make(folder: &Path) -> Result<Self, Failure> {
        let make = |name: &str| {
            let name = name.parse().map_err(Failure::broken)?;
            let keys = Keys::generate(name).map_err(Failure::broken)?;
            let files = keys.save(folder).map_err(Failure::broken)?;
            Ok::<_, Failure>((keys, files))
        };
        let ((keys, display), (first, one), (second, two)) =
            (make("display")?, make("first")?, make("second")?);
        let peers = [(first, Role::FirstCuller), (second, Role::SecondCuller)]
            .map(|(keys, role)| KnownPeer::in_role(keys.public().clone(), role));
        Ok(Self { security: Security { keys, peers: peers.into() }, display, cullers: [one, two] })
    }

    /// The private keys of a culler, and whom it knows.
    fn of(&self, index: Which) -> (PathBuf, CullerPeers) {
        let [first, second] = &self.cullers;
        let (own, other) = match index {
            Which::First => (first, second),
            Which::Second => (second, first),
        };
        let public = |files: &KeyFiles| Some(files.public.clone());
        (own.private.clone(), CullerPeers { display: public(&self.display), other: public(other) })
    }
}

/// Where the display listens, and where the cullers meet: for the latter, a port of loopback that nobody
/// listens on now.
pub(super) fn endpoints(link: LinkKind, folder: &Path) -> Result<(Endpoint, Endpoint), Failure> {
    let any = SocketAddr::from(([127, 0, 0, 1], 0));
    let tcp = || TcpListener::bind(any).and_then(|listener| listener.local_addr()).map_err(Failure::broken);
    let udp = || UdpSocket::bind(any).and_then(|socket| socket.local_addr()).map_err(Failure::broken);
    let socket = |name| SocketPath::new(folder.join(name)).map(Endpoint::Unix).map_err(Failure::broken);
    Ok(match link {
        LinkKind::Inproc => (Endpoint::Inproc(Name::unique()), Endpoint::Inproc(Name::unique())),
        LinkKind::Unix => (socket("display.sock")?, socket("cullers.sock")?),
        LinkKind::Tcp => (Endpoint::Tcp(any.into()), Endpoint::Tcp(tcp()?.into())),
        LinkKind::Quic => (Endpoint::Quic(any.into()), Endpoint::Quic(udp()?.into())),
        LinkKind::Udp => (Endpoint::Udp(any.into()), Endpoint::Udp(udp()?.into())),
    })
}

/// The cullers, which do not outlive this process's interest in them.
pub(super) struct CullerProcesses([CullerProcess; 2]);

struct CullerProcess {
    index: Which,
    child: Child,
}

impl CullerProcesses {
    /// Starts them with the scene and the device of `args`. `display` is where the display listens, `meet`
    /// where they meet.
    pub(super) fn start(
        args: &RunArgs,
        options: &Options,
        display: &Endpoint,
        meet: &Endpoint,
        keyring: Option<&Keyring>,
        folder: &Path,
        runtime: &Runtime,
    ) -> Result<Self, Failure> {
        let scene = std::path::absolute(&args.scene).map_err(Failure::broken)?;
        let start = |index| {
            let (keys, peers) = keyring.map(|keyring| keyring.of(index)).unzip();
            let config = CullerConfig {
                scene: scene.clone(),
                index,
                display: display.clone(),
                pair: meet.clone(),
                device: args.walk.device.clone(),
                device_timeout_s: args.walk.device_timeout,
                join_timeout_s: JoinTimeouts::ONCE.join.as_secs_f64(),
                reconnect_s: 0.0,
                metrics: None,
                keys,
                peers: peers.unwrap_or_default(),
            };
            let path = folder.join(format!("{index:?}.toml"));
            let own = toml::to_string(&config).map_err(Failure::broken)?;
            let links = toml::to_string(options).map_err(Failure::broken)?;
            std::fs::write(&path, own + &links).map_err(Failure::broken)?;
            let program = std::env::current_exe().map_err(Failure::broken)?;
            let mut command = Command::new(program);
            command.args(["role", "culler", "--config"]).arg(&path);
            let _within = runtime.enter();
            let child = command.kill_on_drop(true).spawn().map_err(Failure::broken)?;
            Ok(CullerProcess { index, child })
        };
        Ok(Self([start(Which::First)?, start(Which::Second)?]))
    }

    /// Ends when one of them does, with what to say of one that ended before it had joined.
    pub(super) async fn ended_early(&mut self) -> Failure {
        let [first, second] = &mut self.0;
        let (name, ended) = tokio::select! {
            ended = first.child.wait() => (first.name(), ended),
            ended = second.child.wait() => (second.name(), ended),
        };
        match ended {
            Ok(status) => Failure::broken(format!(
                "{name} ended with {status} before it had joined the session; its own words are above"
            )),
            Err(e) => Failure::broken(e),
        }
    }

    /// Waits until they have ended; fails if one ended badly.
    pub(super) async fn ended_well(self) -> Result<(), Failure> {
        for mut culler in self.0 {
            let status = culler.child.wait().await.map_err(Failure::broken)?;
            if !status.success() {
                return Err(Failure::broken(format!("{} ended with {status}", culler.name())));
            }
        }
        Ok(())
    }
}

impl CullerProcess {
    /// How it is spoken of.
    const fn name(&self) -> &'static str {
        match self.index {
            Which::First => "the first culler",
            Which::Second => "the second culler",
        }
    }
}
