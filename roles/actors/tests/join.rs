//! Three roles find each other though one of them leaves, and another one comes in its place, before all are
//! there.
#![allow(clippy::disallowed_methods, reason = "the roles are tasks here")]
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test ends where what it needs is not there")]

mod common;

use std::{sync::Arc, time::Duration};

use tokio::task::JoinHandle;
use trimaran_actors::{
    CullerIndex, JoinError, Joined, Link, Listener, PeerEndpoint, again, await_cullers, join_session,
};
use trimaran_proto::{Camera, CloseCode, FrameNumber, Identity, Role, SceneHash, Settings, Walkthrough};
use trimaran_transport::{
    Endpoint, Instant, LinkConfig, Net, Options, RecvError, TokioNet, connect, sleep_until,
};

const SCENE: SceneHash = SceneHash(7);
/// How long a link waits for what its peer is to say, far shorter than the roles wait for each other.
const LINK_PATIENCE: Duration = Duration::from_secs(3);
const PATIENCE: Duration = Duration::from_secs(600);

/// Where three roles of this process meet, in time that passes while nothing happens.
struct Meeting {
    net: Arc<dyn Net>,
    options: Options,
    display: Endpoint,
    meet: Endpoint,
}

impl Meeting {
    /// Places of this name, which no other test has.
    fn at(name: &str) -> Self {
        let link = LinkConfig { timeout: LINK_PATIENCE, ..LinkConfig::default() };
        Self {
            net: Arc::new(TokioNet::current().unwrap()),
            options: Options { link, ..Options::default() },
            display: format!("inproc:{name}-display").parse().unwrap(),
            meet: format!("inproc:{name}-meet").parse().unwrap(),
        }
    }

    fn deadline(&self) -> Instant {
        self.net.now().after(PATIENCE)
    }

    async fn pause(&self, time: Duration) {
        sleep_until(&*self.net, self.net.now().after(time)).await;
    }

    /// A display that waits for its cullers.
    async fn display(&self, first: FrameNumber) -> JoinHandle<Result<[Link; 2], JoinError>> {
        let identity = Identity { role: Role::Display, scene: SCENE, settings: Some(settings(first)) };
        let listener = Listener::bind(&self.net, &self.display, identity, &self.options).await.unwrap();
        tokio::spawn(await_cullers(listener, self.deadline()))
    }

    /// A culler that has joined the display and nobody else.
    async fn early(&self, role: Role) -> Link {
        let identity = Identity { role, scene: SCENE, settings: None };
        connect(&self.net, &self.display, identity, &self.options, self.deadline()).await.unwrap()
    }

    /// A machine that joins the display and the other machine.
    fn culler(&self, index: CullerIndex) -> JoinHandle<Result<Joined, JoinError>> {
        let [display, meet] = [&self.display, &self.meet]
            .map(|endpoint| PeerEndpoint { endpoint: endpoint.clone(), options: self.options.clone() });
        let (net, deadline) = (Arc::clone(&self.net), self.deadline());
        tokio::spawn(async move { join_session(&net, index, SCENE, &display, &meet, deadline).await })
    }
}

fn settings(first: FrameNumber) -> Settings {
    Settings { first, ..common::settings(8, 2.0) }
}

#[tokio::test(start_paused = true)]
async fn a_machine_that_leaves_before_the_other_comes_is_waited_for_again() {
    let cullers = [Role::FirstCuller, Role::SecondCuller];
    for (index, close) in [None, Some(CloseCode::Interrupted.reason())].into_iter().enumerate() {
        for [early, late] in [cullers, [cullers[1], cullers[0]]] {
            let meeting = Meeting::at(&format!("left-{index}-{early}").replace(' ', "-"));
            let display = meeting.display(FrameNumber(0)).await;
            for _ in 0..2 {
                let left = meeting.early(early).await;
                meeting.pause(Duration::from_millis(1)).await;
                match close.clone() {
                    Some(reason) => left.close(reason).await.unwrap(),
                    None => drop(left),
                }
                meeting.pause(Duration::from_millis(1)).await;
            }
            let (came, last) = (meeting.early(early).await, meeting.early(late).await);
            let mut sessions = [came.peer.session, last.peer.session];
            if early == Role::SecondCuller {
                sessions.reverse();
            }
            let links = display.await.unwrap().unwrap();
            assert_eq!(links.each_ref().map(|link| link.peer.hello.role), cullers);
            assert_eq!(links.each_ref().map(|link| link.peer.session), sessions);
        }
    }
}

#[tokio::test(start_paused = true)]
async fn a_machine_that_says_nothing_while_it_waits_has_not_left() {
    let meeting = Meeting::at("quiet");
    let display = meeting.display(FrameNumber(0)).await;
    let first = meeting.early(Role::FirstCuller).await;
    meeting.pause(LINK_PATIENCE * 10).await;
    let second = meeting.early(Role::SecondCuller).await;
    let links = display.await.unwrap().unwrap();
    assert_eq!(links.map(|link| link.peer.session), [first, second].map(|link| link.peer.session));
}

/// A machine that waits for the other one joins whichever display is there when that one comes.
#[tokio::test(start_paused = true)]
async fn a_display_that_leaves_before_both_cullers_are_there_is_looked_for_again() {
    for waiting in [CullerIndex::First, CullerIndex::Second] {
        let meeting = Meeting::at(&format!("display-{waiting:?}").to_lowercase());
        let gone = meeting.display(FrameNumber(0)).await;
        let early = meeting.culler(waiting);
        meeting.pause(LINK_PATIENCE * 10).await;
        gone.abort();
        meeting.pause(LINK_PATIENCE * 10).await;

        let display = meeting.display(FrameNumber(5)).await;
        meeting.pause(Duration::from_secs(2)).await;
        let late = meeting.culler(waiting.other());
        let links = display.await.unwrap().unwrap();
        let [early, late] = [early.await.unwrap().unwrap(), late.await.unwrap().unwrap()];
        assert_eq!([early.settings, late.settings], [settings(FrameNumber(5)); 2]);
        assert_eq!(early.other.peer.session, late.other.peer.session);
        let [first, second] = if waiting == CullerIndex::First { [early, late] } else { [late, early] };
        let joined = [first, second].map(|machine| machine.display.peer.session);
        assert_eq!(links.map(|link| link.peer.session), joined);
    }
}

#[tokio::test(start_paused = true)]
async fn a_culler_whose_other_one_does_not_come_tells_the_display_why_it_leaves() {
    let meeting = Meeting::at("in-vain");
    let identity = Identity { role: Role::Display, scene: SCENE, settings: Some(settings(FrameNumber(0))) };
    let mut listener =
        Listener::bind(&meeting.net, &meeting.display, identity, &meeting.options).await.unwrap();
    let machine = meeting.culler(CullerIndex::First);
    let mut link = listener.accept(meeting.deadline()).await.unwrap();
    let end = loop {
        match link.frames_rx.recv().await {
            Err(RecvError::Silent { .. }) => {}
            end => break end,
        }
    };
    let Err(RecvError::Closed { reason, .. }) = end else { panic!("{end:?}") };
    assert_eq!(CloseCode::of(&reason), Some(CloseCode::PeerLost));
    let why = reason;
    assert!(why.to_string().contains("second culler"), "{why}");
    drop(link);
    let error = machine.await.unwrap().unwrap_err();
    assert!(
        matches!(error, JoinError::Accept { peer: Role::SecondCuller, .. }) && error.may_pass(),
        "{error:?}"
    );
}

/// The camera that a display has handed out before both cullers have come is read by the role, not by who
/// waits.
#[tokio::test(start_paused = true)]
async fn a_camera_that_comes_before_the_other_machine_is_kept() {
    let meeting = Meeting::at("camera");
    let display = meeting.display(FrameNumber(0)).await;
    let first = meeting.culler(CullerIndex::First);
    let second = meeting.early(Role::SecondCuller).await;
    let [mut to_first, _to_second] = display.await.unwrap().unwrap();
    let camera = Camera::new([1.0; 3], [0.0, 0.0, 0.0, 1.0], 0.5, 1.0, 0.1, FrameNumber(0)).unwrap();
    to_first.latest_tx.publish(camera).unwrap();
    meeting.pause(LINK_PATIENCE * 2).await;
    let identity = Identity { role: Role::SecondCuller, scene: SCENE, settings: second.peer.hello.settings };
    let _pair =
        connect::<Walkthrough>(&meeting.net, &meeting.meet, identity, &meeting.options, meeting.deadline())
            .await
            .unwrap();
    let mut joined = first.await.unwrap().unwrap();
    assert_eq!(joined.display.latest_rx.try_latest().unwrap(), Some(camera));
}

#[tokio::test(start_paused = true)]
async fn a_display_that_comes_to_a_display_is_turned_away_and_the_cullers_waited_for() {
    let meeting = Meeting::at("another-display");
    let display = meeting.display(FrameNumber(0)).await;
    let identity = Identity { role: Role::Display, scene: SCENE, settings: Some(settings(FrameNumber(0))) };
    let stranger = connect::<Walkthrough>(
        &meeting.net,
        &meeting.display,
        identity,
        &meeting.options,
        meeting.deadline(),
    )
    .await;
    if let Ok(mut stranger) = stranger {
        let end = stranger.frames_rx.recv().await.unwrap_err();
        let RecvError::Closed { reason, .. } = &end else { panic!("{end:?}") };
        assert_eq!(CloseCode::of(reason), Some(CloseCode::Failed), "{reason}");
    }
    let cullers = [meeting.early(Role::FirstCuller).await, meeting.early(Role::SecondCuller).await];
    let links = display.await.unwrap().unwrap();
    assert_eq!(links.map(|link| link.peer.session), cullers.map(|link| link.peer.session));
}

/// One line a reason, a pause that grows, and no attempt after what cannot pass or after the deadline.
#[tokio::test(start_paused = true)]
async fn attempts_are_spaced_and_end() {
    #[derive(Debug, thiserror::Error)]
    #[error("{}", if self.0 { "not yet" } else { "never" })]
    struct Fails(bool);
    let net: Arc<dyn Net> = Arc::new(TokioNet::current().unwrap());
    let start = net.now();
    let mut at = Vec::new();
    let deadline = start.after(Duration::from_secs(20));
    let result: Result<(), Fails> = again(
        &net,
        deadline,
        |error: &Fails| error.0,
        || {
            at.push((net.now().since(start).as_secs_f64() * 10.0).round());
            std::future::ready(Err(Fails(true)))
        },
    )
    .await;
    assert!(result.is_err());
    assert_eq!(at, [0.0, 2.0, 6.0, 14.0, 30.0, 62.0, 112.0, 162.0, 200.0], "tenths of a second");
    let mut attempts = 0;
    let result: Result<(), Fails> = again(
        &net,
        deadline.after(Duration::from_secs(9)),
        |error: &Fails| error.0,
        || {
            attempts += 1;
            std::future::ready(Err(Fails(attempts < 3)))
        },
    )
    .await;
    assert!(!result.unwrap_err().0);
    assert_eq!(attempts, 3, "what cannot pass ends them");
}

/// As behind a name that leads to two hosts with a display each.
#[tokio::test(start_paused = true)]
async fn displays_that_get_one_machine_each_end_in_time_and_name_the_one_they_miss() {
    let one = Meeting::at("one-of-two");
    let other = Meeting { meet: one.meet.clone(), ..Meeting::at("other-of-two") };
    let displays = [one.display(FrameNumber(0)).await, other.display(FrameNumber(0)).await];
    let cullers = [one.culler(CullerIndex::First), other.culler(CullerIndex::Second)];
    for (display, missing) in displays.into_iter().zip([Role::SecondCuller, Role::FirstCuller]) {
        let error = display.await.unwrap().unwrap_err();
        assert!(matches!(error, JoinError::Accept { peer, .. } if peer == missing), "{error:?}");
        assert!(error.may_pass(), "{error:?}");
    }
    for culler in cullers {
        let mut joined = culler.await.unwrap().unwrap();
        let end = joined.display.frames_rx.recv().await;
        let Err(RecvError::Lost { peer, .. }) = end else { panic!("{end:?}") };
        assert_eq!(peer.to_string(), "display");
    }
}
