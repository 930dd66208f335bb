//! The upstream side of a relay: a display to a culler, or to another relay.

use std::{convert::Infallible, sync::Arc};

use parking_lot::Mutex;
use trimaran_proto::{CloseCode, Identity, Role, RoleMessage, SceneOutline, Walkthrough};
use trimaran_transport::{LinkError, Net, Reconnecting, RecvError, WholeFrame};

use super::{
    RelayError,
    hub::Hub,
    leader::{Leader, ToLeader},
    names::Names,
};
use crate::{
    driver::Views,
    join::{JoinError, PeerEndpoint},
    links::Link,
};

/// The peer upstream.
pub(super) struct Upstream {
    net: Arc<dyn Net>,
    at: PeerEndpoint,
    outline: SceneOutline,
    hub: Arc<Hub>,
}

/// How a link ended.
enum Ended {
    /// Another display leads, or none: the next link says so.
    LeaderChanged,
    /// Nobody leads, and the peer is a culler, which has nothing to watch.
    NothingToWatch,
}

impl Upstream {
    pub(super) fn new(net: &Arc<dyn Net>, at: PeerEndpoint, outline: SceneOutline, hub: &Arc<Hub>) -> Self {
        Self { net: Arc::clone(net), at, outline, hub: Arc::clone(hub) }
    }

    /// Keeps a link for the display that leads. Without one it watches, if the peer is a relay.
    ///
    /// # Errors
    /// When this role's own settings rule out a link.
    pub(super) async fn run(self) -> Result<Infallible, RelayError> {
        let mut leaders = self.hub.leaders();
        loop {
            let leader = leaders.borrow_and_update().clone();
            let session = leader.as_ref().map(|leader| leader.session);
            let identity = Identity { role: Role::Display, scene: Some(self.outline), session };
            let PeerEndpoint { endpoint, options } = &self.at;
            let mut links = Reconnecting::<Walkthrough>::new(&self.net, endpoint, identity, options);
            let ended = links.run(|link| self.talk(link, leader.as_ref())).await;
            let ended =
                ended.map_err(|cause| JoinError::Connect { peer: Role::Culler, cause: Box::new(cause) })?;
            if let Ended::NothingToWatch = ended {
                // The hub lives as long as this.
                let _leads = leaders.changed().await;
            }
        }
    }

    /// Passes on what comes over a link, until it is lost or the leader changes.
    async fn talk(&self, mut link: Link, leader: Option<&Leader>) -> Result<Ended, LinkError> {
        let _watched = self.hub.watch(kind(link.peer.hello.role), &link);
        tracing::info!(address = %link.peer.address, leads = leader.is_some(), "has come upstream");
        let passed = match leader {
            None if link.peer.hello.role != Role::Relay => Ok(Ended::NothingToWatch),
            None => unless(self.changed(None), self.watch(&mut link)).await,
            Some(leader) => unless(self.changed(Some(leader)), self.lead(&mut link, leader)).await,
        };
        if passed.is_ok() {
            let _unheard = link.close(CloseCode::Finished.reason()).await;
        }
        passed
    }

    /// Ends once another display leads, or none.
    async fn changed(&self, leader: Option<&Leader>) {
        let number = |leader: Option<&Leader>| leader.map(|leader| leader.number);
        let mut leaders = self.hub.leaders();
        let _changed = leaders.wait_for(|now| number(now.as_ref()) != number(leader)).await;
    }

    /// The leader's cameras and view states go up, and frames come down.
    async fn lead(&self, link: &mut Link, leader: &Leader) -> Result<Infallible, LinkError> {
        let mut asked = leader.asked.clone();
        let mut told = 0;
        loop {
            tokio::select! {
                biased;
                frame = link.frames_rx.frame() => {
                    let frame = frame.inspect_err(|end| refused(end, leader))?;
                    *leader.answered.lock() = Some(frame.start.header.frame());
                    self.hub.publish(&frame, &leader.names).await;
                    leader.say(ToLeader::Frame(Box::new(frame)));
                }
                message = link.messages_rx.recv() => {
                    let message = message.inspect_err(|end| refused(end, leader))?;
                    leader.say(ToLeader::Message(message));
                }
                Ok(()) = asked.changed() => {
                    let (camera, views) = {
                        let asked = asked.borrow_and_update();
                        let newer = asked.views.iter().filter(|(number, _)| *number > told);
                        (asked.camera, newer.cloned().collect::<Vec<_>>())
                    };
                    for (number, messages) in views {
                        for message in messages.iter() {
                            link.messages_tx.send(message).await?;
                        }
                        told = number;
                    }
                    // A culler that came anew would cull an answered frame again.
                    let answered = *leader.answered.lock();
                    if let Some(camera) = camera.filter(|camera| Some(camera.frame()) != answered) {
                        link.latest_tx.publish(camera)?;
                    }
                }
            }
        }
    }

    /// Frames and view states of a relay upstream come down.
    async fn watch(&self, link: &mut Link) -> Result<Infallible, LinkError> {
        let (mut views, names) = (Views::none(self.outline.objects), Mutex::new(Names::default()));
        // A frame whose view state has not come yet.
        let mut early: Option<WholeFrame<Walkthrough>> = None;
        loop {
            let is_ready =
                |frame: &mut WholeFrame<Walkthrough>| names.lock().get(frame.start.header.view()).is_some();
            if let Some(frame) = early.take_if(is_ready) {
                self.hub.publish(&frame, &names).await;
            }
            tokio::select! {
                biased;
                message = link.messages_rx.recv() => {
                    let RoleMessage::View { version, part, last } = message? else { continue };
                    let named = views.take(version, &part, last).and_then(|state| {
                        if let Some(state) = state {
                            let ours = self.hub.tell(&state)?;
                            names.lock().put(version, ours);
                        }
                        Ok(())
                    });
                    if let Err(error) = named {
                        tracing::warn!(error = &error as &dyn std::error::Error, "a view state is left out");
                        views = Views::none(self.outline.objects);
                    }
                }
                frame = link.frames_rx.frame() => early = Some(frame?),
            }
        }
    }
}

/// The result of passing frames on, or `changed`.
async fn unless(
    changed: impl Future<Output = ()>,
    pass: impl Future<Output = Result<Infallible, LinkError>>,
) -> Result<Ended, LinkError> {
    tokio::select! {
        biased;
        () = changed => Ok(Ended::LeaderChanged),
        passed = pass => passed.map(|never| match never {}),
    }
}

/// A culler that refuses the session tells its display why. One that will be back does not end it.
fn refused(end: &RecvError, leader: &Leader) {
    if let RecvError::Closed { reason, .. } = end
        && !matches!(CloseCode::of(reason), Some(CloseCode::Interrupted | CloseCode::DeviceFailed))
    {
        leader.say(ToLeader::Close(reason.clone()));
    }
}

const fn kind(role: Role) -> &'static str {
    match role {
        Role::Relay => "relay",
        Role::Culler | Role::Display => "culler",
    }
}
