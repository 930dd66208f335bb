//! Round trips over a link: one side sends, the other [answers](answer).
//!
//! The messages are those of a session: a camera on the latest lane, or a whole frame of ids on the frames
//! lane.

use std::sync::Arc;
use std::time::Duration;

use thiserror::Error;
use trimaran_actors::{FrameEvent, FrameReceiver, FrameSender, FrameStart, Link};
use trimaran_proto::{Camera, DrawableId, FrameNumber};
use trimaran_transport::{CloseReason, FrameOutcome, Instant, Net, RecvError, SendError, sleep_until};

/// The messages to send, and the timeout.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Probe {
    /// How many round trips.
    pub(super) count: u32,
    /// The time between sends; a round trip that takes longer delays the next one.
    pub(super) interval: Duration,
    /// How many ids there and back as a frame; 0 sends a camera.
    pub(super) ids: u32,
    /// The timeout after which an answer counts as lost. For a frame it is the link's own timeout.
    pub(super) timeout: Duration,
}

/// The result of one round trip.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Reply {
    /// All of it came back after this time.
    Whole(Duration),
    /// A frame came back in part.
    Incomplete(Duration),
    /// It did not come back in time.
    Lost,
}

/// Why probing ended early.
#[derive(Debug, Error)]
pub(super) enum ProbeError {
    /// Sending failed.
    #[error(transparent)]
    Send(#[from] SendError),
    /// Receiving failed.
    #[error(transparent)]
    Receive(#[from] RecvError),
    /// The other side sends unrequested messages: it does not answer probes.
    #[error("the peer does not send back what it gets: is `trimaran ping --answer` running there?")]
    NoEcho,
}

/// Sends and waits for the answer, `probe.count` times; passes each result to `each`.
///
/// # Errors
/// When the link fails, or its peer does not answer.
pub(super) async fn probe(
    link: &mut Link,
    net: &Arc<dyn Net>,
    probe: Probe,
    mut each: impl FnMut(Reply),
) -> Result<(), ProbeError> {
    // Like a walk's ids: rising, and mostly the same each time.
    let ids: Vec<DrawableId> = (0..probe.ids).map(|i| DrawableId(3 * i)).collect();
    let mut due = net.now();
    for number in 0..probe.count {
        sleep_until(&**net, due).await;
        let sent = net.now();
        let camera = Camera::at_origin(FrameNumber(number));
        let reply = if ids.is_empty() {
            link.latest_tx.publish(camera)?;
            camera_back(link, net, sent, camera.frame(), probe.timeout).await?
        } else {
            let Link { frames_tx, frames_rx, .. } = link;
            // Both at once: a frame may be larger than the path's buffers.
            let (there, back) = tokio::join!(send(frames_tx, camera, &ids), whole_frame(frames_rx, &ids));
            there?;
            let took = net.now().since(sent);
            if back? { Reply::Whole(took) } else { Reply::Incomplete(took) }
        };
        each(reply);
        due = due.after(probe.interval).max(net.now());
    }
    Ok(())
}

/// Sends every camera and every frame back until the peer leaves; returns its reason.
///
/// # Errors
/// When the link fails before that.
pub(super) async fn answer(link: Link) -> Result<CloseReason, ProbeError> {
    let Link { mut latest_tx, mut latest_rx, mut frames_tx, mut frames_rx, .. } = link;
    let cameras = async {
        loop {
            match latest_rx.latest().await {
                Ok(camera) => latest_tx.publish(camera)?,
                Err(RecvError::Closed { reason, .. }) => return Ok(reason),
                Err(e) => return Err(e.into()),
            }
        }
    };
    let frames = async {
        loop {
            match frames_rx.recv().await {
                Ok(FrameEvent::Begin(start)) => frames_tx.begin(start).await?,
                Ok(FrameEvent::Batch(batch)) => {
                    let ids: Vec<DrawableId> = batch.iter().collect();
                    frames_tx.push(&ids).await?;
                }
                Ok(FrameEvent::End(_)) => {
                    frames_tx.finish().await?;
                }
                Err(RecvError::Closed { reason, .. }) => return Ok(reason),
                Err(e) => return Err(e.into()),
            }
        }
    };
    tokio::select! {
        left = cameras => left,
        left = frames => left,
    }
}

async fn camera_back(
    link: &mut Link,
    net: &Arc<dyn Net>,
    sent: Instant,
    number: FrameNumber,
    timeout: Duration,
) -> Result<Reply, ProbeError> {
    loop {
        match link.latest_rx.latest_by(sent.after(timeout)).await {
            Ok(camera) if camera.frame() == number => return Ok(Reply::Whole(net.now().since(sent))),
            // A late answer to an earlier one.
            Ok(camera) if camera.frame() < number => {}
            Ok(_) => return Err(ProbeError::NoEcho),
            Err(RecvError::Deadline { .. }) => return Ok(Reply::Lost),
            Err(e) => return Err(e.into()),
        }
    }
}

async fn send(frames: &mut FrameSender, camera: Camera, ids: &[DrawableId]) -> Result<(), SendError> {
    frames.begin(FrameStart { frame: camera.frame(), header: camera }).await?;
    frames.push(ids).await?;
    frames.finish().await.map(|_| ())
}

/// Whether all of `ids` came back.
async fn whole_frame(frames: &mut FrameReceiver, ids: &[DrawableId]) -> Result<bool, ProbeError> {
    let mut got = 0;
    loop {
        match frames.recv().await? {
            FrameEvent::Begin(_) => {}
            FrameEvent::Batch(batch) => got += batch.count(),
            FrameEvent::End(FrameOutcome::Complete(_)) if got == ids.len() => return Ok(true),
            FrameEvent::End(FrameOutcome::Complete(_)) => return Err(ProbeError::NoEcho),
            FrameEvent::End(FrameOutcome::Incomplete { .. }) => return Ok(false),
        }
    }
}

#[cfg(test)]
mod tests {
    use trimaran_proto::{CloseCode, Identity, Role, SceneHash, Walkthrough};

    use super::*;
    use trimaran_transport::{LinkConfig, TokioNet, inproc};

    const PROBE: Probe =
        Probe { count: 5, interval: Duration::ZERO, ids: 0, timeout: Duration::from_secs(60) };

    fn pair() -> (Arc<dyn Net>, Link, Link) {
        let net: Arc<dyn Net> = Arc::new(TokioNet::current().unwrap());
        let identity = |role| Identity { role, scene: Some(SceneHash(0).into()), session: None };
        let config = LinkConfig::default();
        let (here, there) =
            inproc::pair::<Walkthrough>(&net, identity(Role::Display), identity(Role::Culler), &config)
                .unwrap();
        (net, here, there)
    }

    #[tokio::test]
    async fn cameras_and_frames_come_back() {
        for ids in [0, 1, 3000] {
            let (net, mut here, there) = pair();
            let probing = async {
                let mut replies = Vec::new();
                probe(&mut here, &net, Probe { ids, ..PROBE }, |reply| replies.push(reply)).await.unwrap();
                assert_eq!(here.stats.read().received.items, u64::from(5 * ids));
                here.close(CloseCode::Finished.reason()).await.unwrap();
                replies
            };
            let (replies, answered) = tokio::join!(probing, answer(there));
            assert_eq!(replies.len(), 5);
            assert!(replies.iter().all(|reply| matches!(reply, Reply::Whole(_))), "{replies:?}");
            assert_eq!(answered.unwrap(), CloseCode::Finished.reason());
        }
    }

    #[tokio::test]
    async fn who_sends_something_else_does_not_answer() {
        let (net, mut here, mut there) = pair();
        there.latest_tx.publish(Camera::at_origin(FrameNumber(77))).unwrap();
        assert!(matches!(probe(&mut here, &net, PROBE, |_| {}).await, Err(ProbeError::NoEcho)));
        let other_frame = send(&mut there.frames_tx, Camera::at_origin(FrameNumber(0)), &[DrawableId(1)]);
        other_frame.await.unwrap();
        let probing = probe(&mut here, &net, Probe { ids: 5, ..PROBE }, |_| {}).await;
        assert!(matches!(probing, Err(ProbeError::NoEcho)));
    }

    #[tokio::test(start_paused = true)]
    async fn what_does_not_come_back_in_time_is_lost() {
        let (net, mut here, _there) = pair();
        let mut replies = Vec::new();
        let timeout = Duration::from_secs(2);
        probe(&mut here, &net, Probe { timeout, ..PROBE }, |reply| replies.push(reply)).await.unwrap();
        assert_eq!(replies, [Reply::Lost; 5]);
    }
}
