//! Properties of any bytes in place of a handshake over byte streams. The fuzz targets search for bytes
//! that break it; an ordinary test of `trimaran-transport` replays the corpus.
//!
//! An input is what is said on each of the four connections, one after the other, each but the last behind a
//! byte of its length. The application is the one of the conformance suite.

use std::sync::Arc;
use std::time::Duration;

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use trimaran_net::Stream;
use trimaran_netsim::link::LinkModel;
use trimaran_netsim::{Simulation, Topology};
use trimaran_transport::conformance::{ARM, PANEL, Robot, greeting};
use trimaran_transport::{Endpoint, LinkConfig, Listener, Net, Options, TcpOptions, connect, until};
use trimaran_wire::{Decoder, Format, Message};

const MINUTE: Duration = Duration::from_secs(60);

fn said(bytes: &[u8]) -> [&[u8]; 4] {
    let (first, rest) = next_said(bytes);
    let (second, rest) = next_said(rest);
    let (third, fourth) = next_said(rest);
    [first, second, third, fourth]
}

fn next_said(bytes: &[u8]) -> (&[u8], &[u8]) {
    let Some((&length, rest)) = bytes.split_first() else { return (&[], &[]) };
    rest.split_at(rest.len().min(usize::from(length)))
}

/// A simulation and two machines in it.
fn machines() -> (Simulation, [Arc<dyn Net>; 2]) {
    let line = LinkModel::clean(None, Duration::from_micros(100));
    let topology = Topology::star(&["here", "there"], &line, &line);
    let simulation = Simulation::new(&topology, 1);
    let nets: Vec<Arc<dyn Net>> =
        topology.hosts().map(|host| Arc::new(simulation.net(host)) as Arc<dyn Net>).collect();
    let Ok(nets) = nets.try_into() else { unreachable!("there are two") };
    (simulation, nets)
}

/// Runs the program to its end.
fn finish(simulation: &Simulation, program: impl Future<Output = bool>) -> bool {
    let Ok(outcome) = simulation.run(program) else { unreachable!("the program waits for nothing") };
    outcome
}

/// A stranger says anything to a listener and waits: it hears whole messages of a handshake, or nothing, and
/// then the end. A peer gets in afterwards. Gives whether the stranger got in as well.
pub fn hellos(bytes: &[u8]) -> bool {
    let (simulation, [here, there]) = machines();
    let options = Options::default();
    let Ok(everywhere) = "tcp://0.0.0.0:4000".parse() else { unreachable!("an endpoint") };
    let Ok(at) = "tcp://here:4000".parse::<Endpoint>() else { unreachable!("an endpoint") };
    let program = async {
        let listener = Listener::<Robot>::bind(&here, &everywhere, greeting(ARM), &options).await;
        let Ok(mut listener) = listener else { unreachable!("the port is free") };
        let stranger = async {
            let mut streams = Vec::new();
            for said in said(bytes) {
                let Ok(to) = there.resolve("here:4000").await else { unreachable!("it has a name") };
                let opened = there.connect_tcp(to[0], TcpOptions::default()).await;
                let Ok(mut stream) = opened else { unreachable!("it listens") };
                // A peer that is refused on one connection may find the others closed.
                let _said = stream.writer.write_all(said).await;
                streams.push(stream);
            }
            let mut accepted = false;
            for stream in streams {
                accepted |= hear(&*there, stream).await;
            }
            accepted
        };
        // A peer that gets in is left at once.
        let accepts = async { while listener.accept(here.now().after(MINUTE * 60)).await.is_ok() {} };
        tokio::select! {
            biased;
            accepted = async {
                let accepted = stranger.await;
                let by = there.now().after(MINUTE);
                let peer = connect::<Robot>(&there, &at, greeting(PANEL), &options, by).await;
                assert!(peer.is_ok(), "a peer is kept out: {peer:?}");
                accepted
            } => accepted,
            () = accepts => unreachable!("an hour is longer"),
        }
    };
    finish(&simulation, program)
}

/// Hears what a listener says until it ends the connection. It has ten seconds for a handshake, and a link
/// ends with its peer. Gives whether the listener accepted.
async fn hear(net: &dyn Net, mut stream: Stream) -> bool {
    let mut heard = Vec::new();
    let end = until(net, net.now().after(MINUTE), stream.reader.read_to_end(&mut heard)).await;
    assert!(end.is_some(), "the connection of a stranger stays open");
    let mut decoder = Decoder::new(Format::of::<Robot>());
    decoder.push(&heard);
    match decoder.next_message().unwrap_or_default() {
        None | Some(Message::Refuse(_)) => false,
        Some(Message::Accept(_)) => true,
        Some(other) => unreachable!("{other:?}"),
    }
}

/// The holder of a listener's address says anything to a peer that connects, each time it does: the peer
/// gets a link, or has tried again until its deadline. Gives whether it got one.
pub fn answers(bytes: &[u8]) -> bool {
    let (simulation, [here, there]) = machines();
    let Ok(at) = "tcp://here:4000".parse::<Endpoint>() else { unreachable!("an endpoint") };
    let program = async {
        let bound = here.listen_tcp(([0, 0, 0, 0], 4000).into(), TcpOptions::default());
        let Ok((mut listener, _)) = bound else { unreachable!("the port is free") };
        let answering = async {
            let mut streams = Vec::new();
            for said in said(bytes).into_iter().cycle() {
                let Ok(mut stream) = listener.accept().await else { unreachable!("it listens") };
                // It may be gone after what it was told on another connection.
                let _said = stream.writer.write_all(said).await;
                streams.push(stream);
            }
        };
        let link = LinkConfig::default().with_handshake_timeout(Duration::from_millis(200));
        let options = Options::default().with_link(link);
        let by = there.now().after(Duration::from_secs(1));
        tokio::select! {
            biased;
            link = connect::<Robot>(&there, &at, greeting(PANEL), &options, by) => {
                if let Err(error) = &link {
                    assert!(error.may_pass(), "what a stranger says ends the attempts: {error:?}");
                    assert!(there.now().after(Duration::from_secs(1)) > by, "it has not tried until then");
                }
                link.is_ok()
            }
            () = answering => unreachable!("it goes on for ever"),
        }
    };
    finish(&simulation, program)
}
