//! How soon a link is there again after its listener's host went down and came up.

use std::sync::Arc;
use std::time::Duration;

use trimaran_transport::conformance::{ARM, Overhead, PANEL, Robot, greeting, pose, send_frame};
use trimaran_transport::{
    ConnectError, Endpoint, FrameEvent, LinkConfig, LinkError, Net, Options, Reconnecting, connect,
    sleep_until,
};

use crate::hosts::{Link, Listener, Machines, acquainted, gigabit};

const PORT: u16 = 7400;
const MILLISECOND: Duration = Duration::from_millis(1);

/// An arm that sends frames without end, 50 a second, once `begins`.
async fn arm(net: Arc<dyn Net>, at: Endpoint, options: Options, sends: bool) {
    let mut listener = Listener::bind(&net, &at, greeting(ARM), &options).await.unwrap();
    while let Ok(link) = listener.accept(net.now().after(Duration::from_secs(3600))).await {
        let clock = Arc::clone(&net);
        net.spawn(Box::pin(async move {
            // All of it: a block that uses two halves would drop the others.
            let mut link = link;
            let mut frame = 0;
            // The first frame says that there is a link.
            while (sends || frame == 0) && send_frame(&mut link.frames_tx, frame, &[]).await.is_ok() {
                frame += 1;
                sleep_until(&*clock, clock.now().after(20 * MILLISECOND)).await;
            }
            let _ends = link.frames_rx.recv().await;
        }));
    }
}

/// The time from listening again to the first frame of the next link. The host is down for `away`. The panel
/// says where it is 50 times a second, or nothing at all.
fn back_after(scheme: &'static str, away: Duration, talks: bool, idle_timeout: Duration) -> Duration {
    let overhead = Overhead { header_bytes: 0, handshake: 1, coded: true };
    let mut options = acquainted();
    for options in &mut options {
        options.link = LinkConfig::default().with_idle_timeout(idle_timeout);
    }
    let (simulation, machines) = Machines::joined([&gigabit(), &gigabit()], 1, scheme, overhead, options);
    let control = simulation.control();
    let [here, there] = machines.nets.clone().map(|net| Arc::new(net) as Arc<dyn Net>);
    let [ours, theirs] = machines.options.clone();
    let anywhere: Endpoint = format!("{scheme}://0.0.0.0:{PORT}").parse().unwrap();
    let at: Endpoint = format!("{scheme}://here:{PORT}").parse().unwrap();
    let mut panel = Reconnecting::<Robot>::new(&there, &at, greeting(PANEL), &theirs);
    let host = machines.nets[0].host();
    let listen = || here.spawn(Box::pin(arm(Arc::clone(&here), anywhere.clone(), ours.clone(), talks)));
    let run = async {
        listen();
        let mut links = 0;
        let (up, mut ups) = tokio::sync::mpsc::unbounded_channel();
        let talk = |link: Link| {
            links += 1;
            let (up, last, net) = (up.clone(), links == 2, Arc::clone(&there));
            async move {
                let mut link = link;
                while !matches!(link.frames_rx.recv().await?, FrameEvent::End(_)) {}
                up.send(()).unwrap();
                if last {
                    return Ok(());
                }
                let says = async {
                    for frame in 0.. {
                        link.latest_tx.publish(pose(frame))?;
                        sleep_until(&*net, net.now().after(20 * MILLISECOND)).await;
                        if !talks {
                            std::future::pending::<()>().await;
                        }
                    }
                    Ok::<_, LinkError>(())
                };
                let hears = async {
                    loop {
                        link.frames_rx.recv().await?;
                    }
                };
                tokio::select! {
                    said = says => said,
                    heard = hears => heard,
                }
            }
        };
        let faults = async {
            ups.recv().await.unwrap();
            sleep_until(&*there, there.now().after(Duration::from_secs(1))).await;
            control.crash(host);
            sleep_until(&*there, there.now().after(away)).await;
            control.restart(host);
            listen();
            let since = there.now();
            ups.recv().await.unwrap();
            there.now().since(since)
        };
        let (ran, took) = tokio::join!(panel.run(talk), faults);
        ran.unwrap();
        took
    };
    simulation.run(run).unwrap()
}

/// The peers have an idle timeout of a second. So the panel knows that the arm is gone before it is back, and
/// asks for it.
#[test]
fn a_listener_that_was_away_for_two_seconds_is_found_within_300_ms() {
    for scheme in ["tcp", "quic", "udp"] {
        for talks in [true, false] {
            let took = back_after(scheme, Duration::from_secs(2), talks, Duration::from_secs(1));
            assert!(took < 300 * MILLISECOND, "{scheme}, talks: {talks}: {took:?}");
        }
    }
}

/// The panel asks for the arm from the beginning. After four seconds QUIC sends a first packet again only
/// every few seconds, so an absent listener is asked anew. Over TCP a pause is a tenth of the time so far.
#[test]
fn a_listener_that_begins_late_is_found_soon() {
    for scheme in ["tcp", "quic", "udp"] {
        let overhead = Overhead { header_bytes: 0, handshake: 1, coded: true };
        let (simulation, machines) =
            Machines::joined([&gigabit(), &gigabit()], 1, scheme, overhead, acquainted());
        let [here, there] = machines.nets.clone().map(|net| Arc::new(net) as Arc<dyn Net>);
        let [ours, theirs] = machines.options.clone();
        let anywhere: Endpoint = format!("{scheme}://0.0.0.0:{PORT}").parse().unwrap();
        let at: Endpoint = format!("{scheme}://here:{PORT}").parse().unwrap();
        let late = there.now().after(Duration::from_secs(4));
        let begin = async {
            sleep_until(&*there, late).await;
            here.spawn(Box::pin(arm(Arc::clone(&here), anywhere, ours, false)));
        };
        let by = there.now().after(Duration::from_secs(60));
        let find = connect::<Robot>(&there, &at, greeting(PANEL), &theirs, by);
        let link = async { tokio::join!(begin, find).1 };
        simulation.run(link).unwrap().unwrap();
        let took = simulation.now().since(late);
        assert!(took < 450 * MILLISECOND, "{scheme}: {took:?}");
    }
}

/// Pauses are a tenth of the time so far. Pauses of 0.1 s would take 270 attempts in 20 s, and doubled ones
/// 13.
#[test]
fn an_absent_listener_is_asked_more_and_more_seldom() {
    let overhead = Overhead { header_bytes: 0, handshake: 1, coded: true };
    let (simulation, machines) = Machines::joined([&gigabit(), &gigabit()], 1, "tcp", overhead, acquainted());
    let there: Arc<dyn Net> = Arc::new(machines.nets[1].clone());
    let [_, options] = machines.options.clone();
    let at: Endpoint = format!("tcp://here:{PORT}").parse().unwrap();
    let by = there.now().after(Duration::from_secs(20));
    let nobody = connect::<Robot>(&there, &at, greeting(PANEL), &options, by);
    let Err(ConnectError::Deadline { attempts, .. }) = simulation.run(nobody).unwrap() else {
        panic!("nobody listens")
    };
    assert!((40..75).contains(&attempts), "{attempts} attempts");
}

/// Here the panel still takes its link for alive when the arm is back. Its next packet is answered with a
/// reset.
#[test]
fn a_listener_that_lost_its_links_says_so() {
    for scheme in ["quic", "udp"] {
        let took = back_after(scheme, Duration::from_secs(2), true, Duration::from_secs(20));
        assert!(took < 300 * MILLISECOND, "{scheme}: {took:?}");
    }
}
