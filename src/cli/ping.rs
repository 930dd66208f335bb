//! `trimaran ping`: measures round trips over a link of any transport.

mod probe;
mod role_answer;
mod tally;

use std::{io::Write as _, iter, sync::Arc, time::Duration};

use trimaran::{
    config::{PeerFiles, options, security},
    metrics::PathReading,
};
use trimaran_actors::{Link, Listener};
use trimaran_proto::{BatchSize, CloseCode, IdCoding, Identity, Role, SceneHash, Walkthrough};
use trimaran_transport::{Batching, ConnectError, Endpoint, Net, Options, TokioNet, connect, connect_once};

use super::{
    Failure,
    args::PingArgs,
    log::SAID,
    number, print_json, printed,
    terminal::stdout,
    walking::{runtime, stop_on_signal},
};
use probe::{Probe, answer, probe};
use role_answer::RoleAnswer;
use tally::{Cost, Tally, microseconds};

/// Stands for the scene of a session: peers that ping have none.
const NO_SCENE: SceneHash = SceneHash(u128::from_be_bytes(*b"trimaran ping  \0"));

/// How long a listener waits for its next peer.
const FOR_EVER: Duration = Duration::from_secs(u32::MAX as u64);

pub(super) fn run(args: &PingArgs) -> Result<(), Failure> {
    let mut options = options(&args.links.options, toml::Table::new()).map_err(Failure::bad_input)?;
    // Neither end of a ping has a role in a session.
    let peer = [PeerFiles { name: "peer", role: None, paths: args.peer.as_slice() }];
    let known = security(&options, iter::once(&args.endpoint), args.keys.as_deref(), &peer);
    options.security = known.map_err(Failure::bad_input)?;
    options.link.batching = Batching {
        size: BatchSize::new(args.batch.into()).map_err(Failure::bad_input)?,
        coded: IdCoding::from(args.coding) == IdCoding::Changes,
    };
    let runtime = runtime()?;
    let net: Arc<dyn Net> = Arc::new(TokioNet::new(runtime.handle().clone()));
    let stop = stop_on_signal(&runtime);
    if args.answer {
        let answering = keep_answering(&net, &args.endpoint, &options);
        return runtime.block_on(stop.unless_requested(answering)).unwrap_or(Ok(()));
    }
    let mut tally = Tally::new().map_err(Failure::broken)?;
    let pinging = ping(args, &net, &options, &mut tally);
    let cost = match runtime.block_on(stop.unless_requested(pinging)).transpose()? {
        Some(Pinged::Role(answer)) if args.json => return print_json(&answer),
        Some(Pinged::Role(answer)) => return printed(writeln!(stdout(), "{answer}")),
        Some(Pinged::Measured(cost)) => cost,
        None => Cost::default(),
    };
    let summary = tally.summary(&args.endpoint, args.ids, cost);
    if args.json {
        return print_json(&summary);
    }
    print!("{}{}", tally.histogram(), summary.text());
    Ok(())
}

/// Serves one peer after the other.
async fn keep_answering(net: &Arc<dyn Net>, at: &Endpoint, options: &Options) -> Result<(), Failure> {
    let identity = Identity { role: Role::Culler, scene: Some(NO_SCENE.into()), session: None };
    let mut listener = Listener::bind(net, at, identity, options).await.map_err(Failure::bad_input)?;
    tracing::info!(target: SAID, "answers pings on {}", listener.local_endpoint());
    loop {
        let link = listener.accept(net.now().after(FOR_EVER)).await.map_err(Failure::broken)?;
        let guest = link.peer.address;
        tracing::info!(%guest, "came");
        match answer(link).await {
            Ok(_) => tracing::info!(%guest, "left"),
            Err(e) => tracing::warn!(%guest, "{e}"),
        }
    }
}

/// The other end of a ping.
enum Pinged {
    /// It sent back what it got.
    Measured(Cost),
    /// It is a role of a session, which sends back nothing.
    Role(RoleAnswer),
}

/// Pings, and counts the round trips.
async fn ping(
    args: &PingArgs,
    net: &Arc<dyn Net>,
    options: &Options,
    tally: &mut Tally,
) -> Result<Pinged, Failure> {
    let timeout = Duration::from_secs_f64(args.timeout);
    // Roles take a display without a scene and a session, and begin nothing with it.
    let identity = Identity { role: Role::Display, scene: None, session: None };
    let (at, begun) = (&args.endpoint, net.now());
    let by = begun.after(timeout);
    let soon = begun.after(timeout.min(options.link.handshake_timeout));
    let mut made = connect_once::<Walkthrough>(net, at, identity, options, soon).await;
    if let Err(error) = &made {
        if let Some(answer) = RoleAnswer::of_refusal(at, error, net.now().since(begun)) {
            return Ok(Pinged::Role(answer));
        }
        if net.now() < by {
            made = connect::<Walkthrough>(net, at, identity, options, by).await;
        }
    }
    let failed = |error: ConnectError| {
        if error.may_pass() { Failure::broken(error) } else { Failure::bad_input(error) }
    };
    let mut link: Link = made.map_err(failed)?;
    let took = net.now().since(begun);
    let Identity { role, scene, .. } = link.peer.hello;
    if scene.is_none_or(|scene| scene.hash != NO_SCENE) {
        let answer = RoleAnswer::new(at, Some(role), scene, took);
        let _left = link.close(CloseCode::Finished.reason()).await;
        return Ok(Pinged::Role(answer));
    }
    if !args.json {
        println!("{at} at {}: linked in {} us", link.peer.address, number(microseconds(took) as u64));
    }
    let before = link.stats.read();
    let plan =
        Probe { count: args.count, interval: Duration::from_secs_f64(args.interval), ids: args.ids, timeout };
    probe(&mut link, net, plan, |reply| tally.add(reply)).await.map_err(Failure::broken)?;
    let carried = link.stats.read() - before;
    let bytes = carried.sent.total_bytes() + carried.received.total_bytes();
    // An error of the other end at this point does not matter.
    let _left = link.close(CloseCode::Finished.reason()).await;
    let bytes = bytes as f64 / f64::from(args.count);
    Ok(Pinged::Measured(Cost { bytes, path: carried.path.map(PathReading::from) }))
}
