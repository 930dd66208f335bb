//! A display that watches, at its relay: frames come by the publisher, view states from here.

use std::sync::Arc;

use trimaran_proto::ViewVersion;
use trimaran_transport::SendError;

use super::hub::Hub;
use crate::links::Link;

/// Serves a watcher until it leaves.
pub(super) async fn serve(hub: Arc<Hub>, link: Link) {
    let _watched = hub.watch("watcher", &link);
    tracing::info!(address = %link.peer.address, "a display watches");
    let Link { frames_tx, mut frames_rx, mut messages_tx, latest_tx, latest_rx, messages_rx, bulk, .. } =
        link;
    let rest = (latest_tx, latest_rx, messages_rx, bulk);
    let mut views = hub.views();
    hub.subscribe(frames_tx).await;
    let tell = async {
        let mut told = ViewVersion(0);
        loop {
            let (newer, newest) = views.borrow_and_update().since(told);
            for message in newer.iter().flat_map(|messages| messages.iter()) {
                messages_tx.send(message).await?;
            }
            told = newest;
            if views.changed().await.is_err() {
                return Ok::<_, SendError>(());
            }
        }
    };
    // A watcher sends no frames: its next word is its last.
    tokio::select! {
        biased;
        _ = frames_rx.recv() => {}
        _ = tell => {}
        () = hub.over() => {}
    }
    tracing::info!("a display watches no longer");
    drop(rest);
}
