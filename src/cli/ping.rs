//! `trimaran ping`: measures round trips over a link of any transport.

mod probe;
mod tally;

use std::{iter, sync::Arc, time::Duration};

use trimaran::{
    config::{PeerFiles, options, security},
    metrics::PathReading,
};
use trimaran_actors::{Link, Listener};
use trimaran_proto::{BatchSize, CloseCode, IdCoding, Identity, RejectionCode, Role, SceneHash, Walkthrough};
use trimaran_transport::{Batching, ConnectError, Endpoint, Net, Options, Refusal, TokioNet, connect};

use super::{
    Failure,
    args::PingArgs,
    log::SAID,
    number, print_json,
    walking::{runtime, stop_on_signal},
};
use probe::{Probe, answer, probe};
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
    let cost = runtime.block_on(stop.unless_requested(pinging)).transpose()?;
    let summary = tally.summary(&args.endpoint, args.ids, cost.unwrap_or_default());
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

/// Pings, and prints the round trips.
async fn ping(
    args: &PingArgs,
    net: &Arc<dyn Net>,
    options: &Options,
    tally: &mut Tally,
) -> Result<Cost, Failure> {
    let timeout = Duration::from_secs_f64(args.timeout);
    let identity = Identity { role: Role::Display, scene: Some(NO_SCENE.into()), session: None };
    let begun = net.now();
    let mut link: Link = connect::<Walkthrough>(net, &args.endpoint, identity, options, begun.after(timeout))
        .await
        .map_err(not_linked)?;
    if !args.json {
        let took = microseconds(net.now().since(begun));
        println!("{} at {}: linked in {} us", args.endpoint, link.peer.address, number(took as u64));
    }
    let before = link.stats.read();
    let plan =
        Probe { count: args.count, interval: Duration::from_secs_f64(args.interval), ids: args.ids, timeout };
    probe(&mut link, net, plan, |reply| tally.add(reply)).await.map_err(Failure::broken)?;
    let carried = link.stats.read() - before;
    let bytes = carried.sent.total_bytes() + carried.received.total_bytes();
    // An error of the other end at this point does not matter.
    let _left = link.close(CloseCode::Finished.reason()).await;
    Ok(Cost { bytes: bytes as f64 / f64::from(args.count), path: carried.path.map(PathReading::from) })
}

fn not_linked(error: ConnectError) -> Failure {
    match error.refusal() {
        // A role of a session refuses strangers: this deserves a clearer message.
        Some(refusal) if is_of_a_session(refusal) => Failure::bad_input(
            "the link works, but a role of a session listens there, and it answers its own session only: \
                 run `trimaran ping --answer` on another port",
        ),
        _ if error.may_pass() => Failure::broken(error),
        _ => Failure::bad_input(error),
    }
}

/// Whether a refusal comes from a role of a session.
fn is_of_a_session(refusal: &Refusal) -> bool {
    match refusal {
        Refusal::Rejected(why) => RejectionCode::Scene.is_of(why) || RejectionCode::Role.is_of(why),
        _ => false,
    }
}
