//! Wireshark's reading of captured sessions, by the dissector of this repository, compared with the sent
//! data.

mod repaired;

use std::collections::BTreeMap;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::time::Duration;

use bytes::BytesMut;
use tempfile::TempDir;
use trimaran::simulate::{Knobs, Load, Scenario, Transport, Workload, simulate_watched};
use trimaran::trace::Trace;
use trimaran::walkthrough::{FrameRecord, Plan};
use trimaran_actors::{CullerId, FrameEvent, FrameStart, Listener, Schedule};
use trimaran_netsim::Profile;
use trimaran_proto::{
    BatchSize, Camera, DrawableId, FrameNumber, FrameStats, IdCoding, Identity, LodRule, Role, SceneHash,
    SentBytes, Settings, Viewport, Walkthrough,
};
use trimaran_transport::{Lane, Net, Options, SessionId, TokioNet, connect, sleep_until};
use trimaran_wire::{ChannelList, Hello, Message, Protocol, ProtocolName, WireVersions};

const FRAMES: u32 = 12;
const SCENE: SceneHash = SceneHash(0x0123_4567_89ab_cdef_0011_2233_4455_6677);

/// A capture and its capture file.
struct Capture {
    folder: TempDir,
}

/// A capture file; `None`, which skips the test, if tshark is missing and `TRIMARAN_REQUIRE_TSHARK` is not
/// set.
fn capture() -> Option<Capture> {
    match Command::new("tshark").arg("--version").stdout(Stdio::null()).status() {
        Ok(_) => Some(Capture { folder: tempfile::tempdir().unwrap() }),
        Err(error) if std::env::var_os("TRIMARAN_REQUIRE_TSHARK").is_none() => {
            println!("skipped: no tshark ({error}); ./x setup installs it");
            None
        }
        Err(error) => panic!("no tshark: {error}"),
    }
}

impl Capture {
    fn path(&self) -> PathBuf {
        self.folder.path().join("session.pcapng")
    }

    /// The packets that match `filter`, each with its values of `fields`.
    fn read<const N: usize>(&self, filter: &str, fields: [&str; N]) -> Vec<[Vec<String>; N]> {
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("proto/wireshark/trimaran.lua");
        let mut tshark = Command::new("tshark");
        tshark.arg("-r").arg(self.path()).arg("-X").arg(format!("lua_script:{}", script.display()));
        tshark.args(["-o", "ip.check_checksum:TRUE", "-o", "tcp.check_checksum:TRUE"]);
        // Captured at the sender, lost packets are included; without this Wireshark takes their
        // retransmissions for faults.
        tshark.args(["-o", "tcp.reassemble_out_of_order:TRUE"]);
        tshark.args(["-o", "udp.check_checksum:TRUE", "-Y", filter, "-T", "fields"]);
        tshark.args(["-E", "separator=|", "-E", "aggregator=,"]);
        tshark.args(fields.iter().flat_map(|field| ["-e", field]));
        let output = tshark.output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success() && !said.contains("Lua"), "{said}");
        let parts = |cell: &str| cell.split(',').filter(|part| !part.is_empty()).map(str::to_owned).collect();
        let line = |line: &str| {
            let cells: Vec<Vec<String>> = line.split('|').map(parts).collect();
            cells.try_into().unwrap()
        };
        String::from_utf8(output.stdout).unwrap().lines().map(line).collect()
    }

    /// Nothing in it is malformed, every checksum is correct, and the dissector has no error.
    fn is_sound(&self) {
        let bad = "_ws.malformed || trimaran.malformed || trimaran_udp.malformed || ip.checksum.status == 0 \
                   || tcp.checksum.status == 0 || udp.checksum.status == 0 || _ws.expert.message contains \"Lua Error\"";
        let bad = self.read(bad, ["frame.number", "frame.protocols", "_ws.col.Info"]);
        assert!(bad.is_empty(), "{bad:?}");
    }

    /// The ids of each frame, by the display's frame number and the receiver's address, collected like a
    /// receiver.
    fn frames(&self) -> BTreeMap<(String, u32), Vec<u32>> {
        let mut open: BTreeMap<String, u32> = BTreeMap::new();
        let mut frames: BTreeMap<(String, u32), Vec<u32>> = BTreeMap::new();
        let fields = ["ip.dst", "ip.src", "trimaran.camera.frame", "trimaran.id"];
        for [to, from, begun, ids] in self.read("trimaran.begin || trimaran.id", fields) {
            let lane = format!("{}>{}", from[0], to[0]);
            assert!(begun.len() <= 1, "no packet holds two frames' begins: {begun:?}");
            if let [begun] = &begun[..] {
                open.insert(lane.clone(), begun.parse().unwrap());
            }
            let frame = open[&lane];
            let ids = ids.iter().map(|id| id.parse::<u32>().unwrap());
            frames.entry((lane, frame)).or_default().extend(ids);
        }
        frames
    }
}

/// A walk whose frames lose and gain some ids.
fn walk() -> Workload {
    let settings = Settings::new(Viewport::new(64, 64).unwrap(), LodRule::new(2.0).unwrap());
    let plan = Plan::new(Settings { batch: BatchSize::new(64).unwrap(), ..settings });
    let ms = Duration::from_millis;
    let record = |frame: u32| {
        let ids: Vec<DrawableId> =
            (0..700).filter(|id| !(id + frame).is_multiple_of(13)).map(|id| DrawableId(3 * id)).collect();
        let busy = 2_000_000;
        FrameRecord {
            camera: Camera::new(
                [frame.into(), 1.5, -2.0],
                [0.0, 0.0, 0.0, 1.0],
                0.5,
                0.25,
                FrameNumber(frame),
            )
            .unwrap(),
            culler: CullerId::of(0),
            for_loss: 0,
            lacking: 0,
            again: false,
            picture: None,
            published: ms(0),
            begun: ms(1),
            drawing: ms(2),
            shown: ms(4),
            on_device: ms(0),
            traffic: SentBytes::default(),
            arrivals: vec![(ids.len() as u32, ms(2))],
            stats: Some(FrameStats { or_busy_ns: busy, hc_end_ns: busy, ..FrameStats::default() }),
            ids,
        }
    };
    let records: Vec<FrameRecord> = (0..FRAMES).map(record).collect();
    Workload::of_trace(Trace::of(SCENE, &plan, &records).unwrap())
}

fn session(capture: &Capture, link: Transport, workload: &Workload, knobs: Knobs) {
    session_on("gigabit", capture, link, Schedule::Independent, workload, knobs);
}

fn session_on(
    network: &str,
    capture: &Capture,
    link: Transport,
    schedule: Schedule,
    workload: &Workload,
    knobs: Knobs,
) {
    let scenario = Scenario {
        network: Profile::find(network).unwrap(),
        link,
        cullers: 2,
        schedule,
        batch: BatchSize::new(100).unwrap(),
        frames: FRAMES,
        seed: 1,
        workload: workload.clone(),
        geometry: None,
        knobs,
    };
    let file = File::create(capture.path()).unwrap();
    simulate_watched(&scenario, Some(Box::new(file)), || ()).unwrap();
}

/// Every frame to the display, and in the schedule `switch` to the other culler.
fn holds_every_id(capture: &Capture, workload: &Workload, schedule: Schedule) {
    let frames = capture.frames();
    let (display, other): (Vec<_>, Vec<_>) =
        frames.iter().partition(|((lane, _), _)| lane.ends_with("10.0.0.3"));
    let others = if schedule == Schedule::Switch { FRAMES } else { 0 };
    assert_eq!((display.len() as u32, other.len() as u32), (FRAMES, others));
    for ((lane, frame), ids) in &frames {
        let sent: Vec<u32> = workload.ids(*frame).iter().map(|id| id.0).collect();
        assert_eq!(*ids, sent, "frame {frame} on {lane}");
    }
}

#[test]
fn a_session_over_tcp_is_read_id_by_id() {
    let Some(capture) = capture() else { return };
    let load = Load { nodes: 1000, or: Duration::ZERO, hc: Duration::from_millis(1), rvg: Duration::ZERO };
    let workload = Workload::steady(load);
    let switch = Schedule::Switch;
    session_on("gigabit", &capture, Transport::Tcp, switch, &workload, Knobs::default());
    capture.is_sound();
    holds_every_id(&capture, &workload, switch);
    let ends = capture.read("trimaran.end", ["trimaran.end", "trimaran.end.ids"]);
    let ids: Vec<&String> = ends.iter().flat_map(|[_, ids]| ids).collect();
    assert_eq!(ids.len() as u32, 2 * FRAMES);
    assert!(ids.iter().all(|ids| *ids == "1000"));
    // Three links of four lanes, a hello and an accept each. The connecting side sends settings.
    let fields = ["trimaran.version", "trimaran.version.lowest", "trimaran.session", "trimaran.lane"];
    let hellos = capture.read("trimaran.kind == 1", fields);
    assert_eq!(hellos.len(), 12);
    assert!(hellos.iter().all(|[highest, lowest, session, lane]| {
        highest[0] == "5" && lowest[0] == "4" && session.len() == 1 && lane.len() == 1
    }));
    let fields = ["trimaran.role", "trimaran.settings.width", "trimaran.settings.batch"];
    let hellos = capture.read("trimaran.kind == 1 && trimaran.session_key", fields);
    assert_eq!(hellos.len(), 12, "{hellos:?}");
    let says = |hello: &[Vec<String>; 3]| hello.each_ref().map(|values| values[0].clone());
    for (role, lanes) in [("0", 4), ("1", 8)] {
        let expected = [role, "1024", "100"].map(str::to_owned);
        assert_eq!(hellos.iter().filter(|hello| says(hello) == expected).count(), lanes, "{hellos:?}");
    }
    // The display introduces the cullers to each other: meet, met, switch, switched.
    for message in [1, 2, 4, 5] {
        let said = capture.read(&format!("trimaran.message == {message}"), ["trimaran.meeting"]);
        assert_eq!(said.len(), 2, "{message}: {said:?}");
    }
    assert!(!capture.read("trimaran.close == 0", ["frame.number"]).is_empty());
}

#[test]
fn what_tcp_repeats_is_read_once() {
    let Some(capture) = capture() else { return };
    let load = Load { nodes: 8000, or: Duration::ZERO, hc: Duration::from_millis(1), rvg: Duration::ZERO };
    let workload = Workload::steady(load);
    session_on("wifi", &capture, Transport::Tcp, Schedule::Independent, &workload, Knobs::default());
    let repeated = capture.read("tcp.analysis.retransmission && tcp.len > 0", ["frame.number"]);
    assert!(!repeated.is_empty(), "1 % of the packets are lost");
    capture.is_sound();
    // The packet that fills a gap may bring the end of a frame and the begin of the next one.
    let ends = capture.read("trimaran.end", ["trimaran.end.ids"]);
    let ends: Vec<&String> = ends.iter().flatten().flatten().collect();
    assert_eq!(ends, vec!["8000"; FRAMES as usize]);
    let ids: usize = capture.read("trimaran.id", ["trimaran.id"]).iter().flatten().map(Vec::len).sum();
    assert_eq!(ids, 8000 * ends.len());
}

#[test]
fn coded_ids_are_decoded_against_the_frames_before() {
    let Some(capture) = capture() else { return };
    let workload = walk();
    session(&capture, Transport::Tcp, &workload, Knobs { coding: IdCoding::Changes, ..Knobs::default() });
    capture.is_sound();
    let coded = capture.read("trimaran.kind == 0x24", ["trimaran.coded.back"]);
    assert!(!coded.is_empty(), "most batches are shorter as changes");
    holds_every_id(&capture, &workload, Schedule::Independent);
    let eyes = capture.read(
        "trimaran.begin && trimaran.camera.frame == 5",
        ["trimaran.camera.eye", "trimaran.camera.near"],
    );
    let eye: Vec<f64> = eyes[0][0].iter().map(|value| value.parse().unwrap()).collect();
    assert_eq!((eye, eyes[0][1][0].as_str()), (vec![5.0, 1.5, -2.0], "0.25"));
}

#[test]
fn datagrams_in_the_clear_are_read_and_sealed_ones_called_so() {
    let Some(capture) = capture() else { return };
    let workload = walk();
    session(&capture, Transport::Udp, &workload, Knobs { in_the_clear: true, ..Knobs::default() });
    capture.is_sound();
    holds_every_id(&capture, &workload, Schedule::Independent);
    let cameras = capture.read("trimaran_udp.camera", ["trimaran_udp.camera", "trimaran.camera.frame"]);
    assert!(cameras.len() as u32 >= FRAMES, "{cameras:?}");
    let coding = IdCoding::Changes;
    session(&capture, Transport::Udp, &workload, Knobs { in_the_clear: true, coding, ..Knobs::default() });
    capture.is_sound();
    assert!(!capture.read("trimaran.kind == 0x24", ["frame.number"]).is_empty(), "frames travel as changes");
    holds_every_id(&capture, &workload, Schedule::Independent);
    let hellos = capture.read("trimaran_udp.form == 1", ["trimaran.role", "trimaran_udp.version"]);
    assert!(hellos.iter().all(|[role, version]| role.len() == 1 && version[0] == "4"), "{hellos:?}");

    session(&capture, Transport::Udp, &workload, Knobs::default());
    capture.is_sound();
    let data = capture.read("trimaran_udp.form == 0", ["trimaran_udp.sealed", "trimaran_udp.packet"]);
    assert!(data.len() as u32 > 2 * FRAMES);
    assert!(data.iter().all(|[sealed, packet]| sealed.len() == 1 && packet.len() == 1), "{data:?}");
    assert!(capture.read("trimaran", ["frame.number"]).is_empty(), "nothing of what is sealed is shown");
}

/// A capture of datagrams between two ports of this machine, each with the end that it is from.
fn between_two(datagrams: &[(usize, Vec<u8>)]) -> Vec<u8> {
    // The head of a file of IPv4 packets (link type 228), with times in microseconds.
    let mut file = [0xa1b2_c3d4_u32, 4 << 16 | 2, 0, 0, 65_535, 228].map(u32::to_le_bytes).concat();
    for (index, (from, datagram)) in datagrams.iter().enumerate() {
        let ports = if *from == 0 { [7400_u16, 7401] } else { [7401, 7400] };
        let udp = [ports[0], ports[1], 8 + datagram.len() as u16, 0].map(u16::to_be_bytes).concat();
        let size = (20 + udp.len() + datagram.len()) as u32;
        file.extend([index as u32, 0, size, size].map(u32::to_le_bytes).concat());
        // Version 4, no options, 64 hops, UDP, from 127.0.0.1 to itself; the checksum is the ones' complement
        // of the sum of the rest.
        let mut ip = [0x4500, size as u16, 0, 0, 0x4011, 0, 0x7f00, 1, 0x7f00, 1];
        let sum: u32 = ip.iter().map(|word| u32::from(*word)).sum();
        ip[5] = !((sum & 0xffff) + (sum >> 16)) as u16;
        file.extend(ip.map(u16::to_be_bytes).concat());
        file.extend(udp);
        file.extend(datagram);
    }
    file
}

/// The hello of a machine, as bytes.
fn hello() -> BytesMut {
    let identity = Identity { role: Role::Culler, scene: Some(SCENE.into()), session: None };
    let hello = Hello {
        versions: WireVersions::SUPPORTED,
        protocol: ProtocolName::new(Walkthrough::NAME),
        session: SessionId(7),
        lane: Lane::Frames,
        idle_timeout: Duration::from_secs(20).into(),
        channels: ChannelList::default(),
        application: postcard::to_stdvec(&identity).unwrap().into(),
    };
    let mut bytes = BytesMut::new();
    Message::Hello(hello).encode(&mut bytes);
    bytes
}

/// A peer that migrates to another address gets a path challenge there, and answers it.
#[test]
fn the_question_for_a_new_address_and_its_answer_are_read() {
    let Some(capture) = capture() else { return };
    let hello = hello();
    // A first packet of id 10 in the clear.
    let mut initial = [
        (trimaran_udp::VERSION << 2 | 1).to_le_bytes().to_vec(),
        vec![10, 0, 0, 0, 0],
        vec![hello.len() as u8, 0],
    ]
    .concat();
    initial.extend(&hello);
    initial.resize(1200, 0);
    let data = |to: u8, packet: u64, code: u8, cookie: [u8; 24]| {
        let head = [(packet << 2).to_le_bytes().to_vec(), vec![to, 0, 0, 0], vec![code]].concat();
        [head, cookie.to_vec(), vec![0; 100], vec![0xcc; 16]].concat()
    };
    let cookie: [u8; 24] = std::array::from_fn(|at| at as u8 * 7);
    let datagrams = [(0, initial), (1, data(10, 3, 0x06, cookie)), (0, data(20, 4, 0x07, cookie))];
    std::fs::write(capture.path(), between_two(&datagrams)).unwrap();
    capture.is_sound();
    let read = |field: &str| {
        let found = capture.read(field, ["trimaran_udp.packet", field, "trimaran_udp.pad"]);
        found
            .into_iter()
            .map(|values| values.map(|value| value.concat().replace(':', "")))
            .collect::<Vec<_>>()
    };
    let hex: String = cookie.iter().map(|byte| format!("{byte:02x}")).collect();
    let said = |packet: &str| [packet.to_owned(), hex.clone(), "100".to_owned()];
    assert_eq!(read("trimaran_udp.challenge"), [said("3")]);
    assert_eq!(read("trimaran_udp.response"), [said("4")]);
}

/// Stops with the test.
struct Sniffer(Child);

impl Drop for Sniffer {
    fn drop(&mut self) {
        let _gone = self.0.kill();
        let _status = self.0.wait();
    }
}

/// A link over the real loopback, captured by tshark itself, if the machine allows that.
#[tokio::test(flavor = "multi_thread")]
async fn a_real_link_over_loopback_is_read_the_same() {
    let Some(capture) = capture() else { return };
    let net: Arc<dyn Net> = Arc::new(TokioNet::current().unwrap());
    let identity = |role| Identity { role, scene: Some(SCENE.into()), session: None };
    let endpoint = "tcp://127.0.0.1:0".parse().unwrap();
    let options = Options::default();
    let mut listener = Listener::bind(&net, &endpoint, identity(Role::Display), &options).await.unwrap();
    let endpoint = listener.local_endpoint().clone();
    let port = endpoint.to_string().rsplit(':').next().unwrap().to_owned();
    let mut sniffer = Command::new("tshark");
    sniffer.args(["-i", "lo", "-l", "-P", "-f", &format!("tcp port {port}"), "-w"]).arg(capture.path());
    let mut sniffer = Sniffer(sniffer.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap());
    if !begun(&capture, &mut sniffer, &port) {
        assert!(std::env::var_os("TRIMARAN_REQUIRE_CAPTURE").is_none(), "this user may not capture");
        println!("skipped: this user may not capture on the loopback");
        return;
    }

    let deadline = net.now().after(Duration::from_secs(30));
    let (joined, accepted) = tokio::join!(
        connect::<Walkthrough>(&net, &endpoint, identity(Role::Culler), &options, deadline),
        listener.accept(deadline)
    );
    let (mut machine, mut display) = (joined.unwrap(), accepted.unwrap());
    let ids: Vec<DrawableId> = (0..5000).map(|id| DrawableId(id * id)).collect();
    let camera = Camera::at_origin(FrameNumber(7));
    machine.frames_tx.begin(FrameStart { frame: FrameNumber(7), header: camera }).await.unwrap();
    machine.frames_tx.push(&ids).await.unwrap();
    machine.frames_tx.finish().await.unwrap();
    while !matches!(display.frames_rx.recv().await.unwrap(), FrameEvent::End(_)) {}

    // Packets reach the file some time after they passed.
    let until = net.now().after(Duration::from_secs(30));
    while capture.read("trimaran.end", ["trimaran.end"]).is_empty() {
        assert!(net.now() < until, "the frame's end was never captured");
        sleep_until(&*net, net.now().after(Duration::from_millis(200))).await;
    }
    let frames = capture.frames();
    assert_eq!(frames.len(), 1);
    let sent: Vec<u32> = ids.iter().map(|id| id.0).collect();
    assert_eq!(frames[&("127.0.0.1>127.0.0.1".to_owned(), 7)], sent);
}

/// Waits until the sniffer writes what passes this port; `false` if it ended instead.
fn begun(capture: &Capture, sniffer: &mut Sniffer, port: &str) -> bool {
    let mut head = None;
    loop {
        if sniffer.0.try_wait().unwrap().is_some() {
            return false;
        }
        // It writes the file's head first, and may not capture yet then: connections that say nothing show it.
        let length = std::fs::metadata(capture.path()).map_or(0, |file| file.len());
        if length > 0 {
            if length > *head.get_or_insert(length) {
                return true;
            }
            drop(std::net::TcpStream::connect(format!("127.0.0.1:{port}")).unwrap());
        }
        std::thread::sleep(Duration::from_millis(50));
    }
}
