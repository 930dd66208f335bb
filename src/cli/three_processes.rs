//! `trimaran run --link tcp` or `unix`: the three roles as three processes of this machine. This process is the
//! display; the pair are two of `trimaran role switch`.

use std::{
    net::{SocketAddr, TcpListener},
    path::Path,
};

use tokio::{
    process::{Child, Command},
    runtime::Runtime,
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
        Machine::start(&config, configs.path(), &runtime)
    };
    let mut machines = [machine(PairSeat::First)?, machine(PairSeat::Second)?];

    let devices = [Seat::SwitchA, Seat::SwitchB, Seat::Display].map(|seat| (seat, stage.info().clone()));
    let show = Show {
        plan,
        trail,
        path: args.walk.path.clone(),
        seed: args.walk.seed,
        devices: devices.into(),
        patience_s: PATIENCE_S,
    };
    let report = stage.show(&file, show, &args.out, &runtime, ended_early(&mut machines))?;
    for machine in machines {
        runtime.block_on(machine.ended_well())?;
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
    fn start(config: &SwitchConfig, folder: &Path, runtime: &Runtime) -> Result<Self, Failure> {
        let path = folder.join(format!("{:?}.toml", config.seat));
        let text = toml::to_string(config).map_err(Failure::broken)?;
        std::fs::write(&path, text).map_err(Failure::broken)?;
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
