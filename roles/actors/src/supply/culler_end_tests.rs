use std::{collections::BTreeSet, io, net::SocketAddr, time::Duration};

use trimaran_cull::Viewport;
use trimaran_net::{BoxFuture, Listen, Stream, Timer, UdpSocket};
use trimaran_proto::{Identity, LodRule, NumberList, Role, Settings, Supply, Walkthrough, put_item};
use trimaran_transport::{LinkConfig, TcpOptions, TokioNet, UdpSocketOptions, inproc, until};

use super::super::testing::{PLANT, view};
use super::*;

/// A network whose blocking work waits until released, as on a slow disk.
#[derive(Debug)]
struct SlowDisk {
    net: TokioNet,
    waiting: Mutex<Vec<Waiting>>,
}

struct Waiting(Box<dyn FnOnce() + Send>);

impl std::fmt::Debug for Waiting {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Waiting")
    }
}

impl SlowDisk {
    fn let_go(&self) -> usize {
        let waiting = mem::take(&mut *self.waiting.lock());
        let count = waiting.len();
        waiting.into_iter().for_each(|Waiting(work)| work());
        count
    }
}

impl Net for SlowDisk {
    fn spawn_blocking(&self, work: Box<dyn FnOnce() + Send>) {
        self.waiting.lock().push(Waiting(work));
    }

    fn now(&self) -> Instant {
        self.net.now()
    }

    fn timer(&self) -> Box<dyn Timer> {
        self.net.timer()
    }

    fn spawn(&self, task: BoxFuture<'static, ()>) {
        self.net.spawn(task);
    }

    fn random(&self) -> io::Result<u64> {
        self.net.random()
    }

    fn resolve<'a>(&'a self, address: &'a str) -> BoxFuture<'a, io::Result<Vec<SocketAddr>>> {
        self.net.resolve(address)
    }

    fn connect_tcp(&self, to: SocketAddr, options: TcpOptions) -> BoxFuture<'_, io::Result<Stream>> {
        self.net.connect_tcp(to, options)
    }

    fn listen_tcp(&self, at: SocketAddr, options: TcpOptions) -> io::Result<(Box<dyn Listen>, SocketAddr)> {
        self.net.listen_tcp(at, options)
    }

    fn bind_udp(&self, at: SocketAddr, options: UdpSocketOptions) -> io::Result<Arc<dyn UdpSocket>> {
        self.net.bind_udp(at, options)
    }
}

fn ids(count: u32) -> Vec<DrawableId> {
    (0..count).map(DrawableId).collect()
}

/// A culler's end of a bulk lane on this network, and the display's.
fn pair(net: &Arc<dyn Net>) -> (CullerEnd, Bulk) {
    let settings = Settings::new(Viewport::new(64, 64).unwrap(), LodRule::new(1.0).unwrap());
    let identity = |role| Identity { role, scene: Some(PLANT.outline()), session: None };
    let config = LinkConfig::default().with_max_frame(PLANT.drawables().len() as u32);
    let links = inproc::pair::<Walkthrough>(net, identity(Role::Culler), identity(Role::Display), &config);
    let (culler, display) = links.unwrap();
    let end = CullerEnd::start(net, culler.bulk.unwrap(), &PLANT, &Packed::default());
    end.change_view(&Arc::new(settings.into()));
    (end, display.bulk.unwrap())
}

async fn begin(display: &mut Bulk) {
    demand(display, Demand::Begin { coarser_first: false, ahead: 0 }).await;
}

async fn demand(display: &mut Bulk, demand: Demand) {
    let mut block = Vec::new();
    assert!(put_item(&mut block, &demand));
    display.tx.send(block.into()).await.unwrap();
}

/// During a slow read only the display waits: not culling, not a runtime's thread, and not the end of the
/// session.
#[tokio::test(start_paused = true)]
async fn a_slow_disk_holds_up_neither_culling_nor_the_runtime() {
    let disk = Arc::new(SlowDisk { net: TokioNet::current().unwrap(), waiting: Mutex::default() });
    let net: Arc<dyn Net> = Arc::clone(&disk) as _;
    let (end, mut display) = pair(&net);
    begin(&mut display).await;
    for frame in 0..1_000 {
        end.found(&view(frame), &ids(100)).unwrap();
    }
    let soon = || net.now().after(Duration::from_secs(1));
    assert!(until(&*net, soon(), display.rx.recv()).await.is_none(), "the disk has given nothing yet");
    // Its first look, with the requests until then, which reads the scene.
    let mut blocks = 0;
    while blocks == 0 {
        assert_eq!(disk.let_go(), 1, "one thing at a time");
        blocks += usize::from(until(&*net, soon(), display.rx.recv()).await.is_some());
    }
    let lane = until(&*net, soon(), end.give_back()).await;
    assert!(lane.is_some_and(|lane| lane.is_some()), "the session ends while the disk is read");
}

/// The display's geometry is sent, even if the task sees several frames at once.
#[tokio::test]
async fn what_was_found_before_and_after_the_display_asked_is_sent() {
    let net: Arc<dyn Net> = Arc::new(TokioNet::current().unwrap());
    let (end, mut display) = pair(&net);
    end.found(&view(0), &ids(20)).unwrap();
    begin(&mut display).await;
    let mut due: BTreeSet<u32> = (0..40).collect();
    let (mut taken, mut frame) = (0, 0);
    while !due.is_empty() {
        frame += 1;
        end.found(&view(frame), &ids(40)).unwrap();
        let Some(Ok(block)) =
            until(&*net, net.now().after(Duration::from_millis(20)), display.rx.recv()).await
        else {
            continue;
        };
        taken += block.len() as u64;
        for item in items::<Supply>(&block).unwrap() {
            if let Supply::Entries { packed } = item {
                let entries = trimaran_scene::unpack_entries(&packed).unwrap();
                entries.iter().for_each(|entry| assert!(due.remove(&entry.id)));
            }
        }
        demand(&mut display, Demand::Taken { bytes: taken }).await;
    }
}

/// A display may request frame after frame while the disk is read.
#[test]
fn what_waits_for_the_task_is_bounded() {
    const MOST: usize = 1_000;
    let mut news = News::default();
    for frame in 0..10_000 {
        for _ in 0..3 {
            news.add(&view(frame), &ids(frame % 400), Instant::from_nanos(0), MOST);
        }
        let kept = news.found.iter().map(|found| found.ids.len()).sum::<usize>();
        assert_eq!(kept, news.ids);
        assert!(news.found.len() <= FRAMES && (kept <= MOST || news.found.len() == 1), "{kept}");
        assert_eq!(news.found.back().unwrap().ids.len(), 3 * (frame as usize % 400), "the newest is whole");
    }
    news.add(&view(1), &ids(9), Instant::from_nanos(0), 0);
    assert_eq!((news.found.len(), news.ids), (1, 9), "before the display has asked");
}

#[tokio::test]
async fn a_display_that_names_what_the_scene_lacks_is_a_fault_of_the_session() {
    let net: Arc<dyn Net> = Arc::new(TokioNet::current().unwrap());
    let (end, mut display) = pair(&net);
    let drawables = NumberList::of(vec![u32::MAX]);
    demand(&mut display, Demand::Holds { drawables, geometries: NumberList::default() }).await;
    // Also while nothing is culled.
    let fault = end.failed().await;
    assert!(matches!(fault, SupplyFault::Unknown { what: "drawable", number: u32::MAX }), "{fault:?}");
}
