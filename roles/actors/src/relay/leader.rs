//! The display that leads, at its relay: its cameras and view states go up, and frames come down.

use std::{collections::VecDeque, sync::Arc};

use parking_lot::Mutex;
use tokio::sync::{mpsc, watch};
use trimaran_proto::{
    Camera, CloseCode, FrameNumber, Role, RoleMessage, SessionKey, Settings, ViewState, ViewStateError,
    ViewVersion, Walkthrough,
};
use trimaran_transport::{CloseReason, FrameStart, RecvError, SendError, WholeFrame};

use super::{hub::Hub, names::Names};
use crate::{
    deal::Disorder,
    driver::{RoleError, Views, reason},
    links::{FrameSender, LatestReceiver, Link, MessageReceiver, MessageSender},
};

/// How many of its view states are kept for a culler that comes anew.
const KEPT: usize = 4;
/// The most frames and messages that wait for it: more than a display has under way.
const UNSENT: usize = 16;

/// A display that leads. Clones are the same one.
#[derive(Debug, Clone)]
pub(super) struct Leader {
    /// Tells leaders apart.
    pub(super) number: u64,
    pub(super) session: (SessionKey, Settings),
    /// The requests that go upstream.
    pub(super) asked: watch::Receiver<Asked>,
    /// The relay's versions for the leader's.
    pub(super) names: Arc<Mutex<Names>>,
    /// The last frame that it has got.
    pub(super) answered: Arc<Mutex<Option<FrameNumber>>>,
    unsent: mpsc::Sender<ToLeader>,
}

/// The requests of a leader.
#[derive(Debug, Clone, Default)]
pub(super) struct Asked {
    /// The newest camera.
    pub(super) camera: Option<Camera>,
    /// Its last view states, numbered as they came.
    pub(super) views: VecDeque<(u64, Arc<[RoleMessage]>)>,
}

/// A word for a leader.
#[derive(Debug)]
pub(super) enum ToLeader {
    Frame(Box<WholeFrame<Walkthrough>>),
    Message(RoleMessage),
    Close(CloseReason),
}

impl Leader {
    /// Sends it this. One that takes nothing any more is noticed by its own link.
    pub(super) fn say(&self, word: ToLeader) {
        if self.unsent.try_send(word).is_err() {
            tracing::warn!("the display that leads does not take what is sent to it");
        }
    }
}

/// Lets the display at the other end of `link` lead until it leaves.
pub(super) fn start(hub: &Arc<Hub>, link: Link, session: (SessionKey, Settings)) {
    let (unsent, due) = mpsc::channel(UNSENT);
    let (ask, asked) = watch::channel(Asked::default());
    let names = Arc::new(Mutex::new(Names::default()));
    let number = hub.lead(|number| {
        let (names, answered) = (Arc::clone(&names), Arc::default());
        Leader { number, session, asked, names, answered, unsent }
    });
    tracing::info!(address = %link.peer.address, settings = %session.1, "a display leads");
    let views = Views::new(session.1, hub.outline.objects);
    let requests = Requests { hub: Arc::clone(hub), ask, names, views, count: 0 };
    hub.net.spawn(Box::pin(serve(link, session.1, requests, due, number)));
}

/// Serves it until it leaves, or is to go.
async fn serve(
    mut link: Link,
    settings: Settings,
    mut requests: Requests,
    due: mpsc::Receiver<ToLeader>,
    number: u64,
) {
    let hub = Arc::clone(&requests.hub);
    let watched = hub.watch("display", &link);
    let Link { latest_rx, messages_rx, messages_tx, frames_tx, frames_rx, .. } = &mut link;
    let told = requests.name(ViewVersion(0), &settings.into());
    let served = async {
        told?;
        tokio::select! {
            biased;
            error = requests.take(latest_rx, messages_rx) => Err(error),
            // A display sends no frames.
            end = frames_rx.recv() => Err(end.map_or_else(lost, |_| disorder())),
            closed = answer(due, frames_tx, messages_tx) => closed,
            () = hub.over() => Ok(CloseCode::Interrupted.reason()),
        }
    };
    let served = served.await;
    hub.leave(number);
    drop(watched);
    let why = served.unwrap_or_else(|error| {
        tracing::info!(error = &error as &dyn std::error::Error, "the display that led is gone");
        reason(&error)
    });
    let _unheard = link.close(why).await;
}

/// A leader's request.
struct Requests {
    hub: Arc<Hub>,
    ask: watch::Sender<Asked>,
    names: Arc<Mutex<Names>>,
    views: Views,
    /// How many view states have come.
    count: u64,
}

impl Requests {
    /// Takes its cameras and view states until it leaves.
    async fn take(&mut self, cameras: &mut LatestReceiver, messages: &mut MessageReceiver) -> RoleError {
        loop {
            tokio::select! {
                biased;
                message = messages.recv() => {
                    let heard = message.map_err(lost).and_then(|message| self.hear(message));
                    if let Err(error) = heard {
                        return error;
                    }
                }
                camera = cameras.latest() => match camera {
                    Ok(camera) => self.ask.send_modify(|asked| asked.camera = Some(camera)),
                    Err(end) => return lost(end),
                },
            }
        }
    }

    fn hear(&mut self, message: RoleMessage) -> Result<(), RoleError> {
        match message {
            RoleMessage::View { version, part, last } => {
                if let Some(state) = self.views.take(version, &part, last)? {
                    self.name(version, &state)?;
                    let messages = state.to_messages(version)?.into();
                    self.count += 1;
                    self.ask.send_modify(|asked| {
                        if asked.views.len() == KEPT {
                            asked.views.pop_front();
                        }
                        asked.views.push_back((self.count, messages));
                    });
                }
            }
            // It has one culler here, which meets no other one.
            RoleMessage::Meet { key, .. } => {
                if let Some(leader) = &*self.hub.leaders().borrow() {
                    leader.say(ToLeader::Message(RoleMessage::Unmet { key }));
                }
            }
            _ => {}
        }
        Ok(())
    }

    /// Tells watchers a view state before a frame of it comes.
    fn name(&self, version: ViewVersion, state: &ViewState) -> Result<(), ViewStateError> {
        let ours = self.hub.tell(state)?;
        self.names.lock().put(version, ours);
        Ok(())
    }
}

/// Sends a leader its frames and messages. Returns why to close its link.
async fn answer(
    mut due: mpsc::Receiver<ToLeader>,
    frames: &mut FrameSender,
    messages: &mut MessageSender,
) -> Result<CloseReason, RoleError> {
    let mut number = FrameNumber(0);
    let failed = |cause: SendError| RoleError::Link { doing: "answering the display", cause: cause.into() };
    while let Some(word) = due.recv().await {
        match word {
            ToLeader::Frame(frame) => {
                let start = FrameStart { frame: number, header: frame.start.header };
                number = FrameNumber(number.0.wrapping_add(1));
                frames.begin(start).await.map_err(failed)?;
                for batch in &frame.batches {
                    frames.push(&batch.iter().collect::<Vec<_>>()).await.map_err(failed)?;
                }
                frames.finish().await.map_err(failed)?;
            }
            ToLeader::Message(message) => messages.send(&message).await.map_err(failed)?,
            ToLeader::Close(reason) => return Ok(reason),
        }
    }
    Ok(CloseCode::Replaced.reason())
}

fn lost(end: RecvError) -> RoleError {
    RoleError::Link { doing: "serving the display", cause: end.into() }
}

fn disorder() -> RoleError {
    RoleError::Order { peer: Role::Display.to_string(), cause: Disorder::Unexpected("a frame") }
}
