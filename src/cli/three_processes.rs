//! `trimaran run --link tcp` or `unix`: the three roles as three processes of this machine. This process is the
//! display; the pair are two of `trimaran role switch`.

use std::{
    net::{SocketAddr, TcpListener},
    path::Path,
    process::{Child, Command},
};

use trimaran::{
    config::{PairSeat, SwitchConfig},
    report::schema::Seat,
};
use trimaran_transport::{Endpoint, SocketPath};

use super::{
    Failure,
    args::RunArgs,
    role::{DisplayStage, Show},
    run::conclude,
    walking::{self, open},
};

/// How long the three wait for each other: loading and copying a large scene takes a while.
const PATIENCE_S: f64 = 120.0;

/// How the three processes are joined.
#[derive(Debug, Clone, Copy)]
pub(super) enum Transport {
    Unix,
    Tcp,
}

pub(super) fn run(args: &RunArgs, transport: Transport) -> Result<(), Failure> {
    let plan = walking::plan(&args.walk, args.epsilon, args.visible, walking::pace(args.live))?;
    let file = open(&args.scene)?;
    let trail = walking::trail(&args.walk, &plan, &file.scene)?;
    let runtime = walking::runtime()?;
    let device = args.walk.device.as_deref();
    let configs = tempfile::tempdir().map_err(Failure::broken)?;
    let (listen, pair) = meeting_places(transport, configs.path())?;
    let stage = DisplayStage::set(&file, device, &plan, &trail, &runtime, &listen)?;

    let scene = std::path::absolute(&args.scene).map_err(Failure::broken)?;
    let display = stage.listener.local_endpoint().clone();
    let machine = |seat| {
        let config = SwitchConfig {
            scene: scene.clone(),
            seat,
            display: display.clone(),
            pair: pair.clone(),
            device: args.walk.device.clone(),
            patience_s: PATIENCE_S,
        };
        Machine::start(&config, configs.path())
    };
    let machines = [machine(PairSeat::First)?, machine(PairSeat::Second)?];

    let devices = [Seat::SwitchA, Seat::SwitchB, Seat::Display].map(|seat| (seat, stage.info().clone()));
    let show = Show {
        plan,
        trail,
        path: args.walk.path.clone(),
        seed: args.walk.seed,
        devices: devices.into(),
        patience_s: PATIENCE_S,
    };
    let report = stage.show(&file, show, &args.out, &runtime)?;
    for machine in machines {
        machine.ended_well()?;
    }
    conclude(&report, &args.out, args.json)
}

/// Where the display listens, and where the pair meets.
fn meeting_places(transport: Transport, folder: &Path) -> Result<(Endpoint, Endpoint), Failure> {
    match transport {
        Transport::Unix => {
            let socket = |name| SocketPath::new(folder.join(name)).map(Endpoint::Unix);
            let place = |name| socket(name).map_err(Failure::broken);
            Ok((place("display.sock")?, place("pair.sock")?))
        }
        Transport::Tcp => {
            let display = SocketAddr::from(([127, 0, 0, 1], 0));
            Ok((Endpoint::Tcp(display.into()), Endpoint::Tcp(free_address()?.into())))
        }
    }
}

/// An address of loopback that nobody listens on now.
fn free_address() -> Result<SocketAddr, Failure> {
    let listener = TcpListener::bind("127.0.0.1:0").map_err(Failure::broken)?;
    listener.local_addr().map_err(Failure::broken)
}

/// A machine of the pair as a process of its own, which does not outlive this one's interest in it.
struct Machine {
    child: Child,
}

impl Machine {
    fn start(config: &SwitchConfig, folder: &Path) -> Result<Self, Failure> {
        let path = folder.join(format!("{:?}.toml", config.seat));
        let text = toml::to_string(config).map_err(Failure::broken)?;
        std::fs::write(&path, text).map_err(Failure::broken)?;
        let program = std::env::current_exe().map_err(Failure::broken)?;
        let child = Command::new(program)
            .args(["role", "switch", "--config"])
            .arg(&path)
            .spawn()
            .map_err(Failure::broken)?;
        Ok(Self { child })
    }

    fn ended_well(mut self) -> Result<(), Failure> {
        let status = self.child.wait().map_err(Failure::broken)?;
        if status.success() {
            return Ok(());
        }
        Err(Failure::broken(format!("a machine of the pair ended with {status}")))
    }
}

impl Drop for Machine {
    fn drop(&mut self) {
        // Both fail only for a process that has ended already.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
