//! The frames that each of many displays gets of one culler: of one view, of a followed display, and of
//! different views.
//!
//! `cargo bench --bench displays -- X.scene [SECONDS [PROGRAM]]`: 5 s for each number of displays, and the
//! program of this build, if not given. The displays walk an automatic path of 120 poses over tcp, and ask
//! for the next frame once they have one. Of one view each asks for the pose after the newest that any of
//! them has. In the rows `Followed` one display leads, and the others follow it (*Follow*). They draw
//! nothing, and share one thread.
#![allow(clippy::disallowed_methods, reason = "a measurement reads the clock")]

mod common;

use std::{
    cell::{Cell, RefCell},
    sync::Arc,
    time::{Duration, Instant},
};

use tokio::runtime::Builder;
use trimaran_actors::{FrameEvent, Link};
use trimaran_proto::{LeaderKey, RoleMessage};
use trimaran_transport::{Net, TokioNet};

use common::{Failed, POSES, Walk};

/// From the first frame of the last display to the first one that counts.
const EARLY: Duration = Duration::from_secs(5);
const LEADER: LeaderKey = LeaderKey(1);
const FOLLOW: RoleMessage = RoleMessage::Follow { leader: LEADER };

/// How displays look.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Views {
    One,
    /// The first one leads, and the others get its frames.
    Followed,
    Different,
}

fn main() -> Result<(), Failed> {
    let Some(walk) = Walk::of_args("displays", 5)? else { return Ok(()) };
    println!("| displays | views | frames/s, all | each: least | median | most | culls/s | ms |");
    println!("|---|---|---|---|---|---|---|---|");
    let rows = [1, 4, 16, 64, 256].map(|displays| (displays, Views::One)).into_iter();
    let rows = rows.chain([9, 64].map(|displays| (displays, Views::Followed)));
    for (displays, views) in rows.chain([4, 16, 64].map(|displays| (displays, Views::Different))) {
        let Rates { mut each, culls, median_ms } = rates(&walk, displays, views)?;
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
fn rates(path: &Walk, displays: u32, views: Views) -> Result<Rates, Failed> {
    let (_culler, at) = path.culler()?;
    let time = Duration::from_secs(path.seconds.into());
    let runtime = Builder::new_current_thread().enable_all().build()?;
    runtime.block_on(async {
        let net: Arc<dyn Net> = Arc::new(TokioNet::current()?);
        let mut links = Vec::new();
        for key in 0..displays {
            let mut link = path.join(&net, &at, Some(key.into())).await?;
            if views == Views::Followed {
                let role = if key == 0 { RoleMessage::Lead { leader: LEADER } } else { FOLLOW };
                link.messages_tx.send(&role).await?;
            }
            links.push(link);
        }
        let count =
            Count { without: Cell::new(displays), begins: Cell::new(None), time, culls: RefCell::default() };
        let lead = Cell::new(0);
        let walks = (0..).zip(links).map(|(number, link)| {
            let next = match views {
                Views::One => Next::Ahead(&lead),
                Views::Followed if number == 0 => Next::Own(0),
                Views::Followed => Next::Leaders,
                Views::Different => Next::Own(number * POSES / displays),
            };
            // A near distance of its own keeps its view apart from those of others on the same path.
            let near = if views == Views::Different { 1.0 + number as f32 * 1e-4 } else { 1.0 };
            walk(link, path, near, next, &count)
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
    Ahead(&'l Cell<u32>),
    /// That of the display it follows.
    Leaders,
}

/// Walks; returns the number of frames that count.
async fn walk(
    mut link: Link,
    path: &Walk,
    near: f32,
    mut next: Next<'_>,
    count: &Count,
) -> Result<u32, Failed> {
    let mut frames = 0;
    for frame in 0.. {
        let at = match &next {
            Next::Own(at) => *at,
            Next::Ahead(newest) => newest.get(),
            Next::Leaders => 0,
        };
        if !matches!(next, Next::Leaders) {
            link.latest_tx.publish(path.camera(at, near, frame)?)?;
        }
        loop {
            tokio::select! {
                biased;
                event = link.frames_rx.recv() => if let FrameEvent::End(_) = event? { break },
                message = link.messages_rx.recv() => match message? {
                    RoleMessage::Stats(stats) => {
                        let took = stats.hc_end_ns.saturating_sub(stats.or_start_ns);
                        if took > 0 && count.begins.get().is_some() {
                            count.culls.borrow_mut().push(took);
                        }
                    }
                    // The leader is done, or has not begun.
                    RoleMessage::Unfollowed { .. } if frame > 0 => return Ok(frames),
                    RoleMessage::Unfollowed { .. } => link.messages_tx.send(&FOLLOW).await?,
                    _ => {}
                },
            }
        }
        match &mut next {
            Next::Own(at) => *at += 1,
            Next::Ahead(newest) => newest.set(newest.get().max(at + 1)),
            Next::Leaders => {}
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
