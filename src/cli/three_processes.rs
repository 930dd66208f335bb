//! `trimaran run --link` over anything but `inproc`: the three roles as three processes of this machine. This
//! process is the display; the pair are two of `trimaran role switch`.

use std::{
    net::{SocketAddr, TcpListener, UdpSocket},
    path::Path,
};

use tokio::{
    process::{Child, Command},
    runtime::Runtime,
};
use trimaran::{
    config::{self, PairSeat, SwitchConfig, SwitchPeers},
    report::schema::Seat,
};
use trimaran_actors::max_frame;
use trimaran_proto::Role;
use trimaran_transport::{
    Endpoint, SocketPath,
    keys::{KeyFiles, Keys, KnownPeer, Security},
};

use super::{
    Failure,
    args::RunArgs,
    display::{DisplayStage, Show},
    recording::{check_trace, open_folder},
    role::{Metrics, upload},
    walking::{self, gpu_options, open, stop_on_signal},
};

/// How long the three wait for each other: loading and copying a large scene takes a while.
const JOIN_TIMEOUT_S: f64 = 120.0;

/// How the three processes are joined.
#[derive(Debug, Clone, Copy)]
pub(super) enum Transport {
    Unix,
    Tcp,
    Quic,
    Udp,
}

pub(super) fn run(args: &RunArgs, transport: Transport) -> Result<(), Failure> {
    let plan = walking::plan(&args.walk, args.epsilon, args.visible, walking::pace(args.live))?;
    let file = open(&args.scene)?;
    let trail = walking::trail(&args.walk, &plan, &file.scene)?;
    check_trace(args.record.as_deref())?;
    let folder = open_folder(&args.out)?;
    let runtime = walking::runtime()?;
    let stop = stop_on_signal(&runtime);
    let gpu = gpu_options(args.walk.device.as_deref(), args.walk.device_timeout);
    let configs = tempfile::tempdir().map_err(Failure::broken)?;
    let (listen, pair) = meeting_places(transport, configs.path())?;
    let mut options = config::options(&args.links.options, toml::Table::new()).map_err(Failure::bad_input)?;
    let keyring =
        if config::needs_keys(&options, &listen) { Some(Keyring::make(configs.path())?) } else { None };
    let links = toml::to_string(&options).map_err(Failure::broken)?;
    options.security = keyring.as_ref().map(|keyring| keyring.security.clone());
    options.link.max_frame = max_frame(&file.scene);
    let drawn = upload(&file, &gpu)?;
    let listen = listen.into();
    let stage = DisplayStage::set(&file, drawn, &plan, &trail, &runtime, &listen, &options);
    let stage = runtime.block_on(stage)?;

    let scene = std::path::absolute(&args.scene).map_err(Failure::broken)?;
    let display = stage.listener.local_endpoint().clone();
    let machine = |seat| {
        let config = SwitchConfig {
            scene: scene.clone(),
            seat,
            display: display.clone(),
            pair: pair.clone(),
            device: args.walk.device.clone(),
            device_timeout_s: args.walk.device_timeout,
            join_timeout_s: JOIN_TIMEOUT_S,
            reconnect_s: 0.0,
            metrics: None,
            keys: keyring.as_ref().map(|keyring| keyring.of(seat).private.clone()),
            peers: keyring.as_ref().map(|keyring| keyring.peers_of(seat)).unwrap_or_default(),
        };
        Machine::start(&config, &links, configs.path(), &runtime)
    };
    let mut machines = [machine(PairSeat::First)?, machine(PairSeat::Second)?];

    let devices = [Seat::SwitchA, Seat::SwitchB, Seat::Display].map(|seat| (seat, stage.info().clone()));
    let show = Show {
        folder: Some(folder),
        plan,
        trail,
        path: args.walk.path.clone(),
        seed: args.walk.seed,
        devices: devices.into(),
        join_timeout_s: JOIN_TIMEOUT_S,
        // Nobody starts a machine of this session again.
        reconnect_s: 0.0,
        metrics: Metrics::show(args.metrics, &runtime)?,
        trace: args.record.clone(),
    };
    let outcome = stage.show(&file, show, &runtime, &stop, ended_early(&mut machines))?;
    if !outcome.report.summary.ended.early() {
        for machine in machines {
            runtime.block_on(machine.ended_well())?;
        }
    }
    outcome.conclude(&args.out, args.json)
}

/// Keys that live as long as the session: each of the three knows the two others.
struct Keyring {
    /// The display's own, and whom it knows.
    security: Security,
    display: KeyFiles,
    pair: [KeyFiles; 2],
}

impl Keyring {
    fn make(folder: &Path) -> Result<Self, Failure> {
        let make = |name: &str| {
            let name = name.parse().map_err(Failure::broken)?;
            let keys = Keys::generate(name).map_err(Failure::broken)?;
            let files = keys.save(folder).map_err(Failure::broken)?;
            Ok::<_, Failure>((keys, files))
        };
        let ((keys, display), (first, one), (second, two)) =
            (make("display")?, make("first")?, make("second")?);
        let peers = [(first, Role::SwitchA), (second, Role::SwitchB)]
            .map(|(keys, role)| KnownPeer::in_role(keys.public().clone(), role));
        Ok(Self { security: Security { keys, peers: peers.into() }, display, pair: [one, two] })
    }

    const fn of(&self, seat: PairSeat) -> &KeyFiles {
        let [first, second] = &self.pair;
        match seat {
            PairSeat::First => first,
            PairSeat::Second => second,
        }
    }

    fn peers_of(&self, seat: PairSeat) -> SwitchPeers {
        let other = match seat {
            PairSeat::First => PairSeat::Second,
            PairSeat::Second => PairSeat::First,
        };
        let public = |files: &KeyFiles| Some(files.public.clone());
        SwitchPeers { display: public(&self.display), other: public(self.of(other)) }
    }
}

/// Where the display listens, and where the pair meets: for the latter, a port of loopback that nobody
/// listens on now.
fn meeting_places(transport: Transport, folder: &Path) -> Result<(Endpoint, Endpoint), Failure> {
    let display = SocketAddr::from(([127, 0, 0, 1], 0));
    match transport {
        Transport::Unix => {
            let socket = |name| SocketPath::new(folder.join(name)).map(Endpoint::Unix);
            let place = |name| socket(name).map_err(Failure::broken);
            Ok((place("display.sock")?, place("pair.sock")?))
        }
        Transport::Tcp => {
            let pair = TcpListener::bind(display).and_then(|listener| listener.local_addr());
            Ok((Endpoint::Tcp(display.into()), Endpoint::Tcp(pair.map_err(Failure::broken)?.into())))
        }
        Transport::Quic => {
            let pair = UdpSocket::bind(display).and_then(|socket| socket.local_addr());
            Ok((Endpoint::Quic(display.into()), Endpoint::Quic(pair.map_err(Failure::broken)?.into())))
        }
        Transport::Udp => {
            let pair = UdpSocket::bind(display).and_then(|socket| socket.local_addr());
            Ok((Endpoint::Udp(display.into()), Endpoint::Udp(pair.map_err(Failure::broken)?.into())))
        }
    }
}

/// Ends when one of `machines` does, with what to say of one that ended before it had joined.
async fn ended_early([first, second]: &mut [Machine; 2]) -> Failure {
    tokio::select! {
        failure = first.ended_early() => failure,
        failure = second.ended_early() => failure,
    }
}

/// A machine of the pair as a process of its own, which does not outlive this one's interest in it.
struct Machine {
    seat: PairSeat,
    child: Child,
}

impl Machine {
    fn start(config: &SwitchConfig, links: &str, folder: &Path, runtime: &Runtime) -> Result<Self, Failure> {
        let path = folder.join(format!("{:?}.toml", config.seat));
        let own = toml::to_string(config).map_err(Failure::broken)?;
        std::fs::write(&path, own + links).map_err(Failure::broken)?;
        let program = std::env::current_exe().map_err(Failure::broken)?;
        let mut command = Command::new(program);
        command.args(["role", "switch", "--config"]).arg(&path);
        Self::spawn(config.seat, command, runtime)
    }

    fn spawn(seat: PairSeat, mut command: Command, runtime: &Runtime) -> Result<Self, Failure> {
        let _within = runtime.enter();
        let child = command.kill_on_drop(true).spawn().map_err(Failure::broken)?;
        Ok(Self { seat, child })
    }

    /// How it is spoken of.
    const fn name(&self) -> &'static str {
        match self.seat {
            PairSeat::First => "the first machine of the pair",
            PairSeat::Second => "the second machine of the pair",
        }
    }

    async fn ended_early(&mut self) -> Failure {
        match self.child.wait().await {
            Ok(status) => Failure::broken(format!(
                "{} ended with {status} before it had joined the session; its own words are above",
                self.name()
            )),
            Err(e) => Failure::broken(e),
        }
    }

    async fn ended_well(mut self) -> Result<(), Failure> {
        let status = self.child.wait().await.map_err(Failure::broken)?;
        if status.success() {
            return Ok(());
        }
        Err(Failure::broken(format!("{} ended with {status}", self.name())))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::walking::runtime;

    fn machine(seat: PairSeat, program: &str, args: &[&str], runtime: &Runtime) -> Machine {
        let mut command = Command::new(program);
        command.args(args);
        Machine::spawn(seat, command, runtime).unwrap()
    }

    #[test]
    fn the_machine_that_ends_early_is_named_with_its_status() {
        let runtime = runtime().unwrap();
        let sleeper = |seat| machine(seat, "sleep", &["1000"], &runtime);
        let loser = |seat| machine(seat, "sh", &["-c", "exit 3"], &runtime);
        for (mut machines, name) in [
            ([loser(PairSeat::First), sleeper(PairSeat::Second)], "the first machine"),
            ([sleeper(PairSeat::First), loser(PairSeat::Second)], "the second machine"),
        ] {
            let said = runtime.block_on(ended_early(&mut machines)).to_string();
            assert!(said.contains(name) && said.contains("exit status: 3"), "{said}");
        }
    }

    #[test]
    fn a_machine_that_nobody_is_interested_in_is_stopped() {
        let runtime = runtime().unwrap();
        let mut command = Command::new("sh");
        // Its standard output is open for as long as it lives.
        command.args(["-c", "exec sleep 1000"]).stdout(std::process::Stdio::piped());
        let mut machine = Machine::spawn(PairSeat::First, command, &runtime).unwrap();
        let mut output = machine.child.stdout.take().unwrap();
        drop(machine);
        let mut all = Vec::new();
        let read = runtime.block_on(tokio::io::AsyncReadExt::read_to_end(&mut output, &mut all));
        assert_eq!(read.unwrap(), 0);
    }
}
