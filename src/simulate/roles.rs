//! The roles in virtual time: their state machines and their links, with pauses where they would compute.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use trimaran_actors::{
    DisplayMachine, DisplayStep, FrameEvent, FrameStart, Joined, Link, Seat, SwitchMachine, SwitchStep,
};
use trimaran_proto::{CloseCode, DrawableId, FrameNumber, FrameStats};
use trimaran_transport::{FrameOutcome, Instant, Net, StatsHandle, sleep_until};

use super::session::RoleFailure;
use super::{FrameTimes, Workload};

/// What all roles of a session have in common.
#[derive(Debug, Clone)]
pub(super) struct Stage {
    pub(super) workload: Arc<Workload>,
    pub(super) frames: u32,
    /// Whether frames may arrive with gaps.
    pub(super) gaps: bool,
    log: Arc<Mutex<Log>>,
}

/// What the roles note.
#[derive(Debug, Default)]
pub(super) struct Log {
    /// By frame.
    pub(super) times: Vec<FrameTimes>,
    /// What came of each frame that came with gaps.
    pub(super) remains: BTreeMap<u32, Vec<DrawableId>>,
    /// The counters of every end of every link.
    pub(super) stats: Vec<StatsHandle>,
}

impl Stage {
    pub(super) fn new(workload: Arc<Workload>, frames: u32, gaps: bool) -> Self {
        let times = (0..frames).map(|frame| FrameTimes::of(workload.of(frame).nodes)).collect();
        Self { workload, frames, gaps, log: Arc::new(Mutex::new(Log { times, ..Log::default() })) }
    }

    /// The log, to be written or read.
    pub(super) fn log<T>(&self, act: impl FnOnce(&mut Log) -> T) -> T {
        act(&mut self.log.lock().unwrap_or_else(PoisonError::into_inner))
    }

    fn note(&self, frame: FrameNumber, act: impl FnOnce(&mut FrameTimes)) {
        self.log(|log| {
            if let Some(times) = log.times.get_mut(frame.0 as usize) {
                act(times);
            }
        });
    }
}

async fn compute(net: &Arc<dyn Net>, time: Duration) {
    sleep_until(&**net, net.now().after(time)).await;
}

/// The display: hands out cameras, gathers each frame, draws it, shows it (paper, algorithm 4.3).
pub(super) async fn display(
    net: &Arc<dyn Net>,
    stage: &Stage,
    links: &mut [Link; 2],
    shown: impl Fn(),
) -> Result<(), RoleFailure> {
    let mut machine = DisplayMachine::new(FrameNumber(0), Some(stage.frames));
    for frame in machine.first_cameras() {
        hand_out(net, stage, &mut machine, links, frame)?;
    }
    let mut ids = Vec::new();
    while let DisplayStep::Await { from, frame } = machine.step() {
        match of(links, from).frames_rx.recv().await? {
            FrameEvent::Begin(start) => {
                if let Some(next) = machine.began(start.header, true)? {
                    hand_out(net, stage, &mut machine, links, next)?;
                }
            }
            FrameEvent::Batch(batch) if stage.gaps => ids.extend(batch.iter()),
            FrameEvent::Batch(_) | FrameEvent::Note(_) => {}
            FrameEvent::End(outcome) => {
                machine.ended()?;
                let arrived = net.now();
                let came = std::mem::take(&mut ids);
                if let FrameOutcome::Incomplete { expected, received, .. } = outcome {
                    if !stage.gaps {
                        return Err(RoleFailure::Incomplete { frame });
                    }
                    stage.note(frame, |times| times.missing = expected.saturating_sub(received));
                    stage.log(|log| log.remains.insert(frame.0, came));
                }
                compute(net, stage.workload.of(frame.0).rvg).await;
                stage.note(frame, |times| (times.arrived, times.shown) = (arrived, net.now()));
                shown();
            }
        }
    }
    Ok(())
}

fn hand_out(
    net: &Arc<dyn Net>,
    stage: &Stage,
    machine: &mut DisplayMachine,
    links: &mut [Link; 2],
    frame: FrameNumber,
) -> Result<(), RoleFailure> {
    let camera = stage.workload.camera(frame);
    machine.hand_out(camera);
    stage.note(frame, |times| times.published = net.now());
    Ok(of(links, Seat::of(frame)).latest_tx.publish(camera)?)
}

const fn of(links: &mut [Link; 2], seat: Seat) -> &mut Link {
    let [first, second] = links;
    match seat {
        Seat::First => first,
        Seat::Second => second,
    }
}

/// One machine of the pair: OR for a frame, then HC for the same frame (paper, algorithm 4.2).
pub(super) async fn switch(
    net: &Arc<dyn Net>,
    stage: &Stage,
    seat: Seat,
    joined: &mut Joined,
) -> Result<(), RoleFailure> {
    let Joined { display, other, settings } = joined;
    let mut machine = SwitchMachine::new(seat, FrameNumber(0), Some(stage.frames));
    loop {
        match machine.step() {
            SwitchStep::AwaitCamera { .. } => {
                let asked = net.now();
                let camera = display.latest_rx.latest().await?;
                stage.note(camera.frame(), |times| (times.asked, times.taken) = (asked, net.now()));
                machine.camera(camera)?;
            }
            SwitchStep::Occlude { .. } => match other.frames_rx.recv().await? {
                FrameEvent::Begin(start) => machine.occluders_began(start.frame)?,
                FrameEvent::Batch(_) | FrameEvent::Note(_) => {}
                FrameEvent::End(_) => machine.occluders_ended()?,
            },
            SwitchStep::Cull { camera, feeds_other } => {
                let frame = camera.frame();
                let load = stage.workload.of(frame.0);
                stage.note(frame, |times| times.fed = net.now());
                compute(net, load.or).await;
                stage.note(frame, |times| times.occluded = net.now());
                let start = FrameStart { frame, header: camera };
                let mut receivers: Vec<_> =
                    [feeds_other.then_some(&mut other.frames_tx), Some(&mut display.frames_tx)]
                        .into_iter()
                        .flatten()
                        .collect();
                for sender in &mut receivers {
                    sender.begin(start).await?;
                }
                let ids = stage.workload.ids(frame.0);
                let began = net.now();
                let mut done = 0;
                for (count, at) in stage.workload.finds(frame.0, settings.batch) {
                    sleep_until(&**net, began.after(at)).await;
                    let found = ids.get(done..count).unwrap_or_default();
                    for sender in &mut receivers {
                        sender.push(found).await?;
                    }
                    done = count;
                }
                sleep_until(&**net, began.after(load.hc)).await;
                stage.note(frame, |times| times.culled = net.now());
                for sender in &mut receivers {
                    sender.finish().await?;
                }
                display.frames_tx.note(&FrameStats { frame, ..FrameStats::default() }).await?;
                machine.culled()?;
            }
            SwitchStep::Done => return Ok(()),
        }
    }
}

/// Leaves both links in good order.
pub(super) async fn leave(links: [Link; 2]) {
    for link in links {
        // A peer that is gone already does not hear it, and need not.
        let _heard = link.close(CloseCode::Finished.reason()).await;
    }
}

impl FrameTimes {
    const fn of(nodes: u32) -> Self {
        let start = Instant::from_nanos(0);
        Self {
            nodes,
            missing: 0,
            published: start,
            asked: start,
            taken: start,
            fed: start,
            occluded: start,
            culled: start,
            arrived: start,
            shown: start,
        }
    }
}
