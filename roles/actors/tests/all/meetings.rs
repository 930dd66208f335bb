//! The limits of what displays and other cullers can make a culler do by meetings, for the schedule `switch`.

use std::{
    env,
    net::TcpListener,
    process::Command,
    sync::{Arc, LazyLock},
    time::Duration,
};

use tokio::runtime::Runtime;
use trimaran_actors::{FrameStart, Link, LocalCullers, SceneCulling, SessionError, Turns};
use trimaran_cook::generate::PlantOptions;
use trimaran_proto::{
    Camera, DrawableId, FrameNumber, Identity, Role, RoleMessage, SceneOutline, SessionKey, Settings,
    ViewState, ViewVersion, Walkthrough,
};
use trimaran_scene::Scene;
use trimaran_transport::{Net, RecvError, TokioNet, connect, until};

static PLANT: LazyLock<Arc<Scene>> =
    LazyLock::new(|| crate::common::scene(&PlantOptions { seed: 3, objects: 400, triangles: 30_000 }));

/// A culler, as seen by its peers.
struct Guest<'g> {
    net: Arc<dyn Net>,
    culler: &'g LocalCullers,
}

impl Guest<'_> {
    fn settings() -> Settings {
        crate::common::settings(64, 1.0)
    }

    async fn joins(&self, role: Role, key: u64) -> Link {
        let scene: Option<SceneOutline> = Some(PLANT.outline());
        let session = Some((SessionKey(key), Self::settings()));
        let (at, options) = (&self.culler.endpoints[0], &self.culler.options);
        let soon = self.net.now().after(Duration::from_secs(60));
        connect::<Walkthrough>(&self.net, at, Identity { role, scene, session }, options, soon).await.unwrap()
    }

    /// The culler's next message.
    async fn hears(&self, link: &mut Link) -> RoleMessage {
        let soon = self.net.now().after(Duration::from_secs(60));
        until(&*self.net, soon, link.messages_rx.recv()).await.unwrap().unwrap()
    }

    /// Asks the culler to wait for another one, with this key.
    async fn lets_wait(&self, display: &mut Link, key: u64) {
        let key = SessionKey(key);
        display.messages_tx.send(&RoleMessage::Meet { key, at: None }).await.unwrap();
        assert_eq!(self.hears(display).await, RoleMessage::Waits { key });
    }
}

/// Plays a culler, while `guests` connect to it.
fn with_a_culler(guests: impl AsyncFnOnce(Guest<'_>)) {
    let runtime: Runtime =
        tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build().unwrap();
    let turns = Turns::at_once();
    let culler = LocalCullers::new(&PLANT, 1, &turns);
    let net: Arc<dyn Net> = Arc::new(TokioNet::new(runtime.handle().clone()));
    let work = |_, settings: &Settings| {
        Ok(SceneCulling::new(&PLANT, crate::common::Device::default(), settings, &turns))
    };
    let guest = Guest { net, culler: &culler };
    let visit = || {
        runtime.block_on(guests(guest));
        Ok::<_, SessionError>(())
    };
    culler.beside(work, runtime.handle(), visit).unwrap();
}

fn camera(frame: u32) -> Camera {
    crate::common::turned(crate::common::middle(&PLANT), 0.0, 1.0, FrameNumber(frame))
}

/// A culler never connects to an address given by a display; the display learns that it failed, but not why.
#[test]
fn a_culler_connects_to_no_address_that_a_display_names() {
    with_a_culler(async |guest| {
        let victim = TcpListener::bind("127.0.0.1:0").unwrap();
        victim.set_nonblocking(true).unwrap();
        let at = victim.local_addr().unwrap();
        let mut display = guest.joins(Role::Display, 1).await;
        for key in (0..300).map(SessionKey) {
            for at in [
                format!("tcp://{at}"),
                format!("ws://{at}/admin?x=1"),
                "unix:/run/docker.sock".to_owned(),
                "no endpoint at all".to_owned(),
            ] {
                display.messages_tx.send(&RoleMessage::Meet { key, at: Some(at) }).await.unwrap();
                assert_eq!(guest.hears(&mut display).await, RoleMessage::Unmet { key });
            }
        }
        assert!(victim.accept().is_err(), "the culler has connected to it");
        // It continues to serve.
        display.latest_tx.publish(camera(1)).unwrap();
        assert!(matches!(guest.hears(&mut display).await, RoleMessage::Stats(_)));
    });
}

/// Unexpected cullers are closed at once, and do not keep others from meeting.
#[test]
fn cullers_that_nobody_waits_for_are_turned_away() {
    with_a_culler(async |guest| {
        let mut display = guest.joins(Role::Display, 1).await;
        for key in 1_000..1_040 {
            let mut stranger = guest.joins(Role::Culler, key).await;
            let gone = stranger.messages_rx.recv().await;
            assert!(matches!(gone, Err(RecvError::Lost { .. } | RecvError::Closed { .. })), "{gone:?}");
        }
        guest.lets_wait(&mut display, 7).await;
        let _another = guest.joins(Role::Culler, 7).await;
        assert_eq!(guest.hears(&mut display).await, RoleMessage::Met { key: SessionKey(7) });
    });
}

/// The memory of this process, bytes.
fn memory() -> usize {
    let statm = std::fs::read_to_string("/proc/self/statm").unwrap();
    4096 * statm.split_whitespace().nth(1).unwrap().parse::<usize>().unwrap()
}

/// Another culler may send any amount while the display sends no camera: two of its frames are kept.
#[test]
fn frames_of_another_culler_do_not_pile_up() {
    // In a process of its own: the memory of other tests would be counted as well.
    const NAME: &str = "meetings::frames_of_another_culler_do_not_pile_up";
    if env::var_os(NAME).is_none() {
        let mut alone = Command::new(env::current_exe().unwrap());
        let output = alone.args(["--exact", NAME, "--nocapture"]).env(NAME, "alone").output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        return;
    }
    with_a_culler(async |guest| {
        let mut display = guest.joins(Role::Display, 1).await;
        guest.lets_wait(&mut display, 7).await;
        let mut rogue = guest.joins(Role::Culler, 7).await;
        assert_eq!(guest.hears(&mut display).await, RoleMessage::Met { key: SessionKey(7) });
        let ids: Vec<_> = (0..PLANT.drawables().len() as u32).map(DrawableId).collect();
        let mut send = async |frame| {
            let start = FrameStart { frame: FrameNumber(frame), header: camera(frame) };
            rogue.frames_tx.begin(start).await.unwrap();
            rogue.frames_tx.push(&ids).await.unwrap();
            rogue.frames_tx.finish().await.unwrap();
        };
        for frame in 0..50 {
            send(frame).await;
        }
        let before = memory();
        let frames = 100_000_000 / (4 * ids.len() as u32);
        for frame in 50..frames {
            send(frame).await;
        }
        let grown = memory().saturating_sub(before);
        assert!(grown < 30_000_000, "{frames} frames are 100 MB, and {grown} bytes are kept");
        display.latest_tx.publish(camera(1)).unwrap();
        assert!(matches!(guest.hears(&mut display).await, RoleMessage::Stats(_)), "it goes on to serve");
    });
}

/// A view state may name every object of the scene, and no other one: displays choose the size of object
/// sets.
#[test]
fn a_view_state_names_objects_of_the_scene() {
    with_a_culler(async |guest| {
        let objects = PLANT.outline().objects;
        for (hidden, is_taken) in [(vec![0, objects - 1], true), (vec![0, objects], false)] {
            let mut display = guest.joins(Role::Display, 1).await;
            let state = ViewState { hidden: hidden.into_iter().collect(), ..Guest::settings().into() };
            for message in state.to_messages(ViewVersion(1)).unwrap() {
                display.messages_tx.send(&message).await.unwrap();
            }
            // A refusal may have ended the link already.
            let published = display.latest_tx.publish(camera(1).in_view(ViewVersion(1)));
            assert!(published.is_ok() || !is_taken, "{published:?}");
            let soon = guest.net.now().after(Duration::from_secs(60));
            let said = until(&*guest.net, soon, display.messages_rx.recv()).await.unwrap();
            assert_eq!(matches!(said, Ok(RoleMessage::Stats(_))), is_taken, "{said:?}");
            assert_eq!(matches!(said, Err(RecvError::Closed { .. })), !is_taken, "{said:?}");
        }
    });
}
