//! All waits may be in tasks of their own, on any thread: a link is made, used and closed by tasks alone.
#![allow(clippy::disallowed_methods, reason = "what is tested is that tasks may be spawned")]

use std::sync::Arc;

use tokio::spawn;
use trimaran_transport::conformance::{ARM, PANEL, finished, greeting, points, pose, receive, send_frame};
use trimaran_transport::{Options, RecvError};

use crate::common::{Listener, connect, net, soon};

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn tasks_make_links_and_use_their_halves_and_leave() {
    for endpoint in ["tcp://127.0.0.1:0", "inproc:tasks"] {
        let (net, options) = (net(), Options::default());
        let (here, keep) = (Arc::clone(&net), options.clone());
        let endpoint = endpoint.parse().unwrap();
        let bound = spawn(async move { Listener::bind(&here, &endpoint, greeting(ARM), &keep).await });
        let mut listener = bound.await.unwrap().unwrap();
        let (there, to) = (Arc::clone(&net), listener.local_endpoint().clone());
        let by = soon(&net);
        let panel = spawn(async move { connect(&there, &to, greeting(PANEL), &options, by).await });
        let mut arm = spawn(async move { listener.accept(by).await }).await.unwrap().unwrap();
        let mut panel = panel.await.unwrap().unwrap();

        let arm = spawn(async move {
            assert_eq!(arm.latest_rx.latest().await.unwrap(), pose(1));
            send_frame(&mut arm.frames_tx, 1, &points(5000)).await.unwrap();
            arm.close(finished()).await
        });
        let panel = spawn(async move {
            panel.latest_tx.publish(pose(1)).unwrap();
            assert_eq!(receive(&mut panel.frames_rx).await.unwrap().points, points(5000));
            let end = panel.frames_rx.recv().await.unwrap_err();
            assert!(matches!(&end, RecvError::Closed { reason, .. } if *reason == finished()), "{end:?}");
            panel.close(finished()).await
        });
        for side in [arm, panel] {
            side.await.unwrap().unwrap();
        }
    }
}
