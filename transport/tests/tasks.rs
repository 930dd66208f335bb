//! All that waits may be a task of its own, on whichever thread: a link is made, used and left by tasks
//! alone.
#![allow(clippy::disallowed_methods, reason = "what is tested is that tasks may be spawned")]
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]

mod common;

use std::sync::Arc;

use common::{camera, identity, ids, net, next_camera, receive, soon, start};
use tokio::spawn;
use trimaran_proto::{Goodbye, Role};
use trimaran_transport::{Listener, Options, RecvError, connect};

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn tasks_make_links_and_use_their_halves_and_leave() {
    for endpoint in ["tcp://127.0.0.1:0", "inproc:tasks"] {
        let (net, options) = (net(), Options::default());
        let (here, keep) = (Arc::clone(&net), options.clone());
        let endpoint = endpoint.parse().unwrap();
        let bound =
            spawn(async move { Listener::bind(&here, &endpoint, identity(Role::SwitchA), &keep).await });
        let mut listener = bound.await.unwrap().unwrap();
        let (there, to) = (Arc::clone(&net), listener.local_endpoint().clone());
        let by = soon(&net);
        let display = spawn(async move { connect(&there, &to, identity(Role::Display), &options, by).await });
        let mut switch = spawn(async move { listener.accept(by).await }).await.unwrap().unwrap();
        let mut display = display.await.unwrap().unwrap();

        let switch = spawn(async move {
            assert_eq!(next_camera(&mut switch.latest_rx).await.unwrap(), camera(1));
            switch.frames_tx.begin(start(1)).await.unwrap();
            switch.frames_tx.push(&ids(5000)).await.unwrap();
            switch.frames_tx.finish().await.unwrap();
            switch.goodbye(Goodbye::Finished).await
        });
        let display = spawn(async move {
            display.latest_tx.publish(camera(1)).unwrap();
            assert_eq!(receive(&mut display.frames_rx).await.unwrap().ids, ids(5000));
            let end = display.frames_rx.recv().await;
            assert!(matches!(end, Err(RecvError::Goodbye { reason: Goodbye::Finished, .. })), "{end:?}");
            display.goodbye(Goodbye::Finished).await
        });
        for side in [switch, display] {
            side.await.unwrap().unwrap();
        }
    }
}
