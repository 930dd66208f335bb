//! Peers that hang, and peers that reconnect, over every transport between processes.

use std::sync::Arc;
use std::time::Duration;

use tokio::runtime::{Builder, Runtime};
use trimaran_transport::conformance::{PANEL, greeting, points, pose, receive, send_frame, start};
use trimaran_transport::{Endpoint, LinkConfig, Loss, Net, Options, RecvError, SendError, TokioNet};

use crate::common::meeting::Meeting;
use crate::common::{Link, connect, net, soon};

over_every_transport!(
    a_peer_that_hangs_is_lost_by_whoever_listens,
    a_peer_that_hangs_is_lost_by_whoever_waits_for_room,
    a_peer_that_comes_back_goes_on_with_the_next_frame,
);

#[tokio::test]
async fn a_peer_of_this_process_comes_back_as_well() {
    a_peer_that_comes_back_goes_on_with_the_next_frame("inproc:comes-back").await;
}

/// A panel whose process runs until it has read a pose, and then hangs with everything it has. None if the
/// idle timeout ends before that, because the machine is busy.
async fn hanging_panel(at: Endpoint, options: Options) -> Option<(Runtime, Link)> {
    let life = move || {
        let runtime = Builder::new_current_thread().enable_all().build().unwrap();
        let net: Arc<dyn Net> = Arc::new(TokioNet::new(runtime.handle().clone()));
        let link = runtime.block_on(async {
            let mut link = connect(&net, &at, greeting(PANEL), &options, soon(&net)).await.ok()?;
            assert_eq!(link.latest_rx.latest().await.ok()?, pose(1));
            Some(link)
        });
        link.map(|link| (runtime, link))
    };
    tokio::task::spawn_blocking(life).await.unwrap()
}

/// A link to a panel that hangs, and a guard that keeps that panel.
async fn joined_to_a_hanging_panel(endpoint: &str) -> (Link, Runtime, impl Sized) {
    let timeout = Duration::from_secs(3600);
    // The first idle timeout that is long enough here.
    for idle_timeout in (0..).map(|doubled| Duration::from_millis(200) * 2_u32.pow(doubled)) {
        let link = LinkConfig::default().with_timeout(timeout).with_idle_timeout(idle_timeout);
        let Meeting { mut listener, at, panel, _folder, .. } =
            Meeting::at(endpoint, &Options::default().with_link(link)).await;
        let meet = async {
            let mut here = listener.accept(soon(&net())).await.unwrap();
            here.latest_tx.publish(pose(1)).map(|()| here)
        };
        if let (Ok(here), Some((runtime, hangs))) = tokio::join!(meet, hanging_panel(at, panel)) {
            return (here, runtime, (hangs, listener, _folder));
        }
    }
    unreachable!("some idle timeout is long enough")
}

async fn a_peer_that_hangs_is_lost_by_whoever_waits_for_room(endpoint: &str) {
    let (mut here, runtime, _hangs) = joined_to_a_hanging_panel(endpoint).await;
    let send = async {
        here.frames_tx.begin(start(0)).await?;
        loop {
            here.frames_tx.push(&points(100_000)).await?;
        }
    };
    let Err::<(), _>(lost) = send.await else { unreachable!("it never ends well") };
    assert!(matches!(lost, SendError::Lost { cause: Loss::Silent, .. }), "{lost:?}");
    runtime.shutdown_background();
}

async fn a_peer_that_hangs_is_lost_by_whoever_listens(endpoint: &str) {
    let (mut here, runtime, _hangs) = joined_to_a_hanging_panel(endpoint).await;
    let lost = here.frames_rx.recv().await.unwrap_err();
    assert!(matches!(lost, RecvError::Lost { cause: Loss::Silent, .. }), "{lost:?}");
    let lost = here.latest_rx.latest().await.unwrap_err();
    assert!(matches!(lost, RecvError::Lost { cause: Loss::Silent, .. }), "{lost:?}");
    runtime.shutdown_background();
}

async fn a_peer_that_comes_back_goes_on_with_the_next_frame(endpoint: &str) {
    let Meeting { mut listener, at, panel, _folder, .. } = Meeting::at(endpoint, &Options::default()).await;
    let net = net();
    for frame in 0..4 {
        let (there, here) = tokio::join!(
            connect(&net, &at, greeting(PANEL), &panel, soon(&net)),
            listener.accept(soon(&net)),
        );
        let (mut there, mut here) = (there.unwrap(), here.unwrap());
        let send = async {
            send_frame(&mut here.frames_tx, frame, &points(frame * 1000)).await.unwrap();
        };
        let ((), got) = tokio::join!(send, receive(&mut there.frames_rx));
        let got = got.unwrap();
        assert_eq!((got.start, got.points), (start(frame), points(frame * 1000)));
        // It crashes, and its waiting peer gets an error.
        drop(there);
        let lost = here.frames_rx.recv().await.unwrap_err();
        assert!(matches!(lost, RecvError::Lost { .. }), "{lost:?}");
    }
}
