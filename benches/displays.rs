//! The frames that each of many displays gets of one culler, of one view and of different ones.
//!
//! `cargo bench --bench displays -- X.scene [SECONDS [PROGRAM]]`: 5 s for each number of displays, and the
//! program of this build, if not given. The displays walk an automatic path of 120 poses over tcp, and ask
//! for the next frame once they have one. Of one view they follow the one that is ahead: each asks for the
//! pose after the newest that any of them has. They draw nothing, and share one thread.
#![allow(clippy::disallowed_methods, reason = "a measurement reads the clock")]

use std::{
    cell::{Cell, RefCell},
    error::Error,
    fs,
    net::TcpListener,
    path::Path,
    process::{Child, Command, Stdio},
    sync::Arc,
    time::{Duration, Instant},
};

use tokio::runtime::Builder;
use trimaran_actors::{FrameEvent, Link};
use trimaran_cull::{LodRule, Viewport};
use trimaran_proto::{
    FrameNumber, Identity, Role, RoleMessage, SceneOutline, SessionKey, Settings, Walkthrough,
};
use trimaran_scene::{
    Scene,
    path::{AutoPathOptions, PosePath, auto},
};
use trimaran_transport::{Endpoint, Net, Options, TokioNet, connect};

type Failed = Box<dyn Error + Send + Sync>;

const SIDE: u32 = 512;
const EPSILON_PX: f64 = 2.0;
const POSES: u32 = 120;
/// From the first frame of the last display to the first one that counts.
const EARLY: Duration = Duration::from_secs(5);

/// All displays come from one address, at once.
const LIMITS: &str = "depth_memory = '4GiB'
[limits]
peers = 300
handshakes_per_s = 10_000
handshakes_per_s_per_address = 10_000
";

/// A culler's process, which ends with this.
struct Culler(Child);

impl Drop for Culler {
    fn drop(&mut self) {
        let _ended = self.0.kill();
        let _code = self.0.wait();
    }
}

/// How displays look.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Views {
    One,
    Different,
}

fn main() -> Result<(), Failed> {
    let words: Vec<String> = std::env::args().skip(1).filter(|word| !word.starts_with('-')).collect();
    let [scene, rest @ ..] = words.as_slice() else {
        println!("skipped: give a cooked scene: cargo bench --bench displays -- X.scene [SECONDS [PROGRAM]]");
        return Ok(());
    };
    let time = Duration::from_secs(rest.first().map_or(Ok(5), |word| word.parse())?);
    let program = rest.get(1).map_or(env!("CARGO_BIN_EXE_trimaran"), String::as_str);
    let opened = Scene::open(Path::new(scene))?;
    let path = auto(&opened, &AutoPathOptions { frames: POSES, seed: 1, teleport: false })?.path;
    println!("| displays | views | frames/s, all | each: least | median | most | culls/s | ms |");
    println!("|---|---|---|---|---|---|---|---|");
    for (displays, views) in
        [(1, Views::One), (4, Views::One), (16, Views::One), (64, Views::One), (256, Views::One)]
            .into_iter()
            .chain([4, 16, 64].map(|displays| (displays, Views::Different)))
    {
        let Rates { mut each, culls, median_ms } =
            rates(program, scene, opened.outline(), &path, (displays, views), time)?;
        each.sort_by(f64::total_cmp);
        let all: f64 = each.iter().sum();
        let [least, median, most] = [0, each.len() / 2, each.len() - 1].map(|at| each[at]);
        print!("| {displays} | {views:?} | {all:.0} | {least:.1} | {median:.1} | {most:.1} ");
        println!("| {culls:.0} | {median_ms:.1} |");
    }
    Ok(())
}

/// The rates of one number of displays.
struct Rates {
    /// Frames a second of each display.
    each: Vec<f64>,
    /// Culls a second, in the five seconds before as well, and their median time (OR and HC).
    culls: f64,
    median_ms: f64,
}

/// Walks with so many displays.
fn rates(
    program: &str,
    scene: &str,
    outline: SceneOutline,
    path: &PosePath,
    (displays, views): (u32, Views),
    time: Duration,
) -> Result<Rates, Failed> {
    let port = TcpListener::bind("127.0.0.1:0")?.local_addr()?.port();
    let at: Endpoint = format!("tcp://127.0.0.1:{port}").parse()?;
    let config = tempfile::NamedTempFile::new()?;
    fs::write(config.path(), LIMITS)?;
    let mut command = Command::new(program);
    command.args(["role", "culler", "--listen", &at.to_string(), "--scene", scene, "--config"]);
    command.arg(config.path());
    let _culler = Culler(command.stdout(Stdio::null()).stderr(Stdio::null()).spawn()?);
    let runtime = Builder::new_current_thread().enable_all().build()?;
    runtime.block_on(async {
        let net: Arc<dyn Net> = Arc::new(TokioNet::current()?);
        let settings = Settings::new(Viewport::new(SIDE, SIDE)?, LodRule::new(EPSILON_PX)?);
        let mut links = Vec::new();
        for key in 0..displays {
            let session = Some((SessionKey(key.into()), settings));
            let identity = Identity { role: Role::Display, scene: Some(outline), session };
            let deadline = net.now().after(Duration::from_secs(60));
            links.push(connect::<Walkthrough>(&net, &at, identity, &Options::default(), deadline).await?);
        }
        let count =
            Count { without: Cell::new(displays), begins: Cell::new(None), time, culls: RefCell::default() };
        let lead = Cell::new(0);
        let near = path.near().ok_or("the path names no near distance")?;
        let walks = (0..).zip(links).map(|(number, link)| match views {
            Views::One => walk(link, path, near, Next::Lead(&lead), &count),
            // A near distance of its own keeps its view apart from those of others on the same path.
            Views::Different => {
                let near = near * (1.0 + number as f32 * 1e-4);
                walk(link, path, near, Next::Own(number * POSES / displays), &count)
            }
        });
        let frames = futures_util::future::try_join_all(walks).await?;
        let each = frames.into_iter().map(|frames| f64::from(frames) / time.as_secs_f64()).collect();
        let mut culls = count.culls.into_inner();
        culls.sort_unstable();
        let median_ms = culls.get(culls.len() / 2).map_or(0.0, |ns| *ns as f64 / 1e6);
        Ok(Rates { each, culls: culls.len() as f64 / (EARLY + time).as_secs_f64(), median_ms })
    })
}

/// When frames count: from five seconds after each display has its first one.
struct Count {
    /// The displays without a frame.
    without: Cell<u32>,
    begins: Cell<Option<Instant>>,
    time: Duration,
    /// The culls' times, in nanoseconds.
    culls: RefCell<Vec<u64>>,
}

/// The next pose of a display.
#[derive(Debug, Clone, Copy)]
enum Next<'l> {
    /// Its own, from this one on.
    Own(u32),
    /// The one after the newest that any display has.
    Lead(&'l Cell<u32>),
}

/// Walks; returns the number of frames that count.
async fn walk(
    mut link: Link,
    path: &PosePath,
    near: f32,
    mut next: Next<'_>,
    count: &Count,
) -> Result<u32, Failed> {
    let mut frames = 0;
    for frame in 0.. {
        let at = match &next {
            Next::Own(at) => *at,
            Next::Lead(lead) => lead.get(),
        };
        let pose = path.frames().get((at % POSES) as usize).ok_or("a short path")?;
        link.latest_tx.publish(pose.camera(path.vfov_deg(), near, FrameNumber(frame))?)?;
        loop {
            tokio::select! {
                biased;
                event = link.frames_rx.recv() => if let FrameEvent::End(_) = event? { break },
                message = link.messages_rx.recv() => if let RoleMessage::Stats(stats) = message? {
                    let took = stats.hc_end_ns.saturating_sub(stats.or_start_ns);
                    if took > 0 && count.begins.get().is_some() {
                        count.culls.borrow_mut().push(took);
                    }
                },
            }
        }
        match &mut next {
            Next::Own(at) => *at += 1,
            Next::Lead(lead) => lead.set(lead.get().max(at + 1)),
        }
        if frame == 0 {
            count.without.set(count.without.get() - 1);
        }
        if count.without.get() == 0 && count.begins.get().is_none() {
            count.begins.set(Some(Instant::now() + EARLY));
        }
        if let Some(since) =
            count.begins.get().and_then(|begins| Instant::now().checked_duration_since(begins))
        {
            if since >= count.time {
                break;
            }
            frames += 1;
        }
    }
    Ok(frames)
}
