//! A link that is made again after its listener was killed, over each transport.

use std::time::Duration;

use tokio::runtime::{Builder, Runtime};
use trimaran_transport::conformance::{ARM, PANEL, Robot, greeting, pose, send_frame};
use trimaran_transport::{CloseReason, Endpoint, LinkError, LinkState, Options, Reconnecting, sleep_until};

use crate::common::meeting::Meeting;
use crate::common::{Link, Listener, net, soon};

over_every_transport!(a_link_comes_back_after_its_listener_was_killed, a_closed_listener_frees_its_address);

/// Frames until a link's user takes it for good.
const FRAMES: u32 = 5;

/// An arm in a runtime of its own, which sends frames without end. With the runtime it dies without a word.
async fn arm(at: &Endpoint, ours: &Options) -> Runtime {
    let runtime = Builder::new_multi_thread().worker_threads(1).enable_all().build().unwrap();
    let (at, ours) = (at.clone(), ours.clone());
    let listens = runtime.spawn(async move {
        let net = net();
        let listener = Listener::bind(&net, &at, greeting(ARM), &ours).await.unwrap();
        net.spawn(Box::pin(serve(listener)));
    });
    listens.await.unwrap();
    runtime
}

async fn serve(mut listener: Listener) {
    let net = net();
    while let Ok(link) = listener.accept(soon(&net)).await {
        let clock = crate::common::net();
        net.spawn(Box::pin(async move {
            // All of it: a block that uses one half would drop the others.
            let mut link = link;
            for frame in 0.. {
                if send_frame(&mut link.frames_tx, frame, &[]).await.is_err() {
                    return;
                }
                sleep_until(&*clock, clock.now().after(Duration::from_millis(10))).await;
            }
        }));
    }
}

/// Receives some frames, while it says where it is.
async fn listen(link: &mut Link) -> Result<(), LinkError> {
    for frame in 0..FRAMES {
        link.latest_tx.publish(pose(frame))?;
        while !matches!(link.frames_rx.recv().await?, trimaran_transport::FrameEvent::End(_)) {}
    }
    Ok(())
}

async fn a_link_comes_back_after_its_listener_was_killed(endpoint: &str) {
    let Meeting { listener, at, panel, ours, _folder } = Meeting::at(endpoint, &Options::default()).await;
    listener.close().await;
    let mut running = Some(arm(&at, &ours).await);
    let mut robot = Reconnecting::<Robot>::new(&net(), &at, greeting(PANEL), &panel);
    let mut events = robot.events();
    let (tell, mut told) = tokio::sync::mpsc::unbounded_channel();
    // The user's own task, as it may be.
    let (done, result) = tokio::sync::oneshot::channel();
    net().spawn(Box::pin(async move {
        let mut links = 0;
        let talk = |link: Link| {
            links += 1;
            let (link_number, tell) = (links, tell.clone());
            async move {
                let mut link = link;
                listen(&mut link).await?;
                tell.send(link_number).unwrap();
                if link_number == 2 {
                    return Ok(link_number);
                }
                loop {
                    listen(&mut link).await?;
                }
            }
        };
        done.send(robot.run(talk).await).unwrap();
    }));
    assert_eq!(told.recv().await, Some(1));
    assert!(matches!(events.changed().await, Some(LinkState::Up { links: 1 })));
    let killed = running.take().unwrap();
    tokio::task::spawn_blocking(move || killed.shutdown_timeout(Duration::from_secs(10))).await.unwrap();
    let again = arm(&at, &ours).await;
    assert!(matches!(events.changed().await, Some(LinkState::Down { why: Some(_) })));
    assert_eq!(result.await.unwrap().unwrap(), 2);
    assert_eq!(told.recv().await, Some(2));
    tokio::task::spawn_blocking(move || again.shutdown_timeout(Duration::from_secs(10))).await.unwrap();
}

async fn a_closed_listener_frees_its_address(endpoint: &str) {
    let Meeting { mut listener, at, panel, ours, _folder } = Meeting::at(endpoint, &Options::default()).await;
    let net = net();
    for round in 0..3 {
        let link = crate::common::connect(&net, &at, greeting(PANEL), &panel, soon(&net)).await.unwrap();
        let theirs = listener.accept(soon(&net)).await.unwrap();
        let bye = || CloseReason::new(round, "bye");
        let (ours_left, theirs_left) = tokio::join!(link.close(bye()), theirs.close(bye()));
        assert!(ours_left.is_ok() && theirs_left.is_ok(), "{ours_left:?} {theirs_left:?}");
        listener.close().await;
        listener = Listener::bind(&net, &at, greeting(ARM), &ours).await.unwrap();
    }
}
