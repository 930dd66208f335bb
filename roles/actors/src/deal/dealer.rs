//! Deals frames to cullers, and says which frame is shown next.

use std::{
    collections::{BTreeMap, BTreeSet, VecDeque},
    time::Duration,
};

use thiserror::Error;
use trimaran_proto::FrameNumber;
use trimaran_transport::Instant;

use super::{culler_id::CullerId, usual::Usual};

/// The frames of a session.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pace {
    /// Every camera is one frame, and every frame is shown: as many as given, counted from 0. Cullers take
    /// them round-robin, so that a run with the same cullers is the same each time.
    Lockstep {
        /// The number of frames; unlimited without.
        frames: Option<u32>,
    },
    /// The newest camera goes to a free culler. Frames older than the shown one are dropped.
    Live,
}

impl Pace {
    /// The least time before a frame counts as late. In lockstep the picture is not urgent.
    const fn least(self) -> Duration {
        match self {
            Self::Lockstep { .. } => Duration::from_secs(1),
            Self::Live => Duration::from_millis(50),
        }
    }
}

/// A culler broke the order of a frame's messages. The display lets it go.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum Disorder {
    /// It began a frame whose camera it was not sent.
    #[error("it began {0}, which it was not dealt")]
    NotDealt(FrameNumber),
    /// It culled a frame from another camera than the one sent for it.
    #[error("it culled {0} from another camera than the display handed out")]
    ForeignCamera(FrameNumber),
    /// It began a frame while another was under way, or sent a part of one that had not begun.
    #[error("it sent {0} where that was not due")]
    Unexpected(&'static str),
}

/// Decides the culler of each frame, and the next frame to show.
#[derive(Debug)]
pub struct Dealer {
    pace: Pace,
    /// Whether cullers get frames round-robin: always in lockstep, and live if each draws the other one's
    /// visible set.
    round_robin: bool,
    cullers: BTreeMap<CullerId, CullerFrames>,
    /// Frames of lost or late cullers, not dealt again yet.
    orphans: BTreeSet<FrameNumber>,
    /// Whole frames that are not shown yet.
    whole: BTreeSet<FrameNumber>,
    /// The first frame that is not shown.
    next: FrameNumber,
    /// The frame after the last one dealt.
    fresh: FrameNumber,
    usual: Usual,
    held: bool,
}

/// The frames dealt to a culler.
#[derive(Debug)]
struct CullerFrames {
    /// Cameras sent to it that it has not begun, in order. Round-robin there is at most one; live, a newer
    /// one replaces the one waiting in its cell.
    cell: VecDeque<FrameNumber>,
    begun: Option<FrameNumber>,
    /// Round-robin: its own next frame.
    own: FrameNumber,
    /// When it began to work at its first frame.
    since: Instant,
    /// It is late, and is dealt nothing until it has answered.
    late: bool,
}

impl CullerFrames {
    fn outstanding(&self) -> impl Iterator<Item = FrameNumber> + '_ {
        self.begun.iter().chain(&self.cell).copied()
    }

    fn is_idle(&self) -> bool {
        self.begun.is_none() && self.cell.is_empty()
    }
}

impl Dealer {
    /// For a session that begins without cullers and with the frame `first`. If `round_robin`, cullers get
    /// frames in that order in a live session as well.
    #[must_use]
    pub fn new(pace: Pace, round_robin: bool, first: FrameNumber) -> Self {
        Self {
            pace,
            round_robin: round_robin || pace != Pace::Live,
            cullers: BTreeMap::new(),
            orphans: BTreeSet::new(),
            whole: BTreeSet::new(),
            next: first,
            fresh: first,
            usual: Usual::default(),
            held: false,
        }
    }

    /// A culler has come: it is dealt frames from now on.
    pub fn join(&mut self, id: CullerId, now: Instant) {
        let culler =
            CullerFrames { cell: VecDeque::new(), begun: None, own: self.fresh, since: now, late: false };
        self.cullers.insert(id, culler);
        self.share_out();
    }

    /// A culler is gone: its frames are dealt to others.
    pub fn leave(&mut self, id: CullerId) {
        if self.cullers.remove(&id).is_some() {
            self.share_out();
        }
    }

    /// A culler is late: its frames are dealt to others as well, and it gets no more until it answers.
    pub fn pass_over(&mut self, id: CullerId) {
        if let Some(culler) = self.cullers.get_mut(&id) {
            culler.late = true;
            self.share_out();
        }
    }

    /// Pauses or resumes dealing.
    pub const fn hold(&mut self, held: bool) {
        self.held = held;
    }

    /// The first frame that is not shown.
    #[must_use]
    pub const fn next(&self) -> FrameNumber {
        self.next
    }

    /// The next frame to deal.
    #[must_use]
    pub const fn fresh(&self) -> FrameNumber {
        self.fresh
    }

    /// The cullers that are dealt frames.
    pub fn available(&self) -> impl Iterator<Item = CullerId> + '_ {
        self.cullers.iter().filter(|(_, culler)| !culler.late).map(|(id, _)| *id)
    }

    /// Round-robin: deals frames to cullers now. The camera of each must be sent at once.
    pub fn deal(&mut self, now: Instant) -> Vec<(CullerId, FrameNumber)> {
        let mut dealt = Vec::new();
        if !self.round_robin || self.held {
            return dealt;
        }
        let ids: Vec<_> = self.available().collect();
        let window = self.next.0.saturating_add(2 * ids.len() as u32);
        for id in &ids {
            let Some(culler) = self.cullers.get_mut(id).filter(|culler| culler.cell.is_empty()) else {
                continue;
            };
            // A busy culler takes no frame that is waited for.
            let orphan = self.orphans.iter().copied().find(|frame| culler.is_idle() || *frame > self.next);
            let frame = match orphan {
                Some(orphan) => {
                    self.orphans.remove(&orphan);
                    orphan
                }
                None if culler.own.0 < window && in_session(self.pace, culler.own) => {
                    let own = culler.own;
                    culler.own = FrameNumber(own.0.saturating_add(ids.len() as u32));
                    own
                }
                None => continue,
            };
            if culler.is_idle() {
                culler.since = now;
            }
            culler.cell.push_back(frame);
            self.fresh = self.fresh.max(FrameNumber(frame.0.saturating_add(1)));
            dealt.push((*id, frame));
        }
        dealt
    }

    /// Live: the culler for the newest camera, if any. A camera that no culler has yet (`news`) goes to a
    /// free culler. If none is free, it waits in the cell of the one busy longest.
    #[must_use]
    pub fn wants_camera(&self, news: bool) -> Option<CullerId> {
        let all_idle = self.cullers.values().all(|culler| culler.late || culler.is_idle());
        if self.round_robin || self.held || !(news || all_idle) {
            return None;
        }
        let cullers = || self.cullers.iter().filter(|(_, culler)| !culler.late);
        let idle = cullers().filter(|(_, culler)| culler.is_idle()).min_by_key(|(_, culler)| culler.since);
        let waiting = || cullers().find(|(_, culler)| culler.begun.is_some() && !culler.cell.is_empty());
        let longest =
            || cullers().filter(|(_, culler)| culler.begun.is_some()).min_by_key(|(_, culler)| culler.since);
        idle.or_else(waiting).or_else(longest).map(|(id, _)| *id)
    }

    /// Live: sends `id` a camera, replacing one in its cell; returns the frame's number.
    pub fn hand_out(&mut self, id: CullerId, now: Instant) -> FrameNumber {
        let frame = self.fresh;
        self.fresh = FrameNumber(frame.0.saturating_add(1));
        if let Some(culler) = self.cullers.get_mut(&id) {
            if culler.is_idle() {
                culler.since = now;
            }
            culler.cell.push_back(frame);
        }
        frame
    }

    /// Round-robin and live: frames whose cameras wait in a cell, and may be replaced by a newer pose.
    pub fn refreshable(&self) -> impl Iterator<Item = (CullerId, FrameNumber)> + '_ {
        let live = self.round_robin && self.pace == Pace::Live;
        self.cullers.iter().filter(move |_| live).filter_map(|(id, culler)| Some((*id, *culler.cell.back()?)))
    }

    /// A culler began to send a frame. Live, its earlier cameras have been replaced in its cell.
    ///
    /// # Errors
    /// If it was not dealt the frame, or has begun another one.
    pub fn began(&mut self, id: CullerId, frame: FrameNumber) -> Result<(), Disorder> {
        let culler = self.cullers.get_mut(&id).ok_or(Disorder::NotDealt(frame))?;
        if culler.begun.is_some() {
            return Err(Disorder::Unexpected("the begin of a frame"));
        }
        let place = culler.cell.iter().position(|dealt| *dealt == frame).ok_or(Disorder::NotDealt(frame))?;
        culler.cell.drain(..=place);
        culler.begun = Some(frame);
        Ok(())
    }

    /// A culler sent the end of its frame. Returns the frame's number if it is still to be shown.
    ///
    /// # Errors
    /// If none had begun.
    pub fn ended(&mut self, id: CullerId, now: Instant) -> Result<Option<FrameNumber>, Disorder> {
        let unexpected = Disorder::Unexpected("the end of a frame");
        let culler = self.cullers.get_mut(&id).ok_or(unexpected)?;
        let frame = culler.begun.take().ok_or(unexpected)?;
        if !culler.late {
            self.usual.note(now.since(culler.since));
        }
        culler.since = now;
        if std::mem::take(&mut culler.late) {
            self.share_out();
        }
        self.orphans.remove(&frame);
        Ok((frame >= self.next && self.whole.insert(frame)).then_some(frame))
    }

    /// The display has culled a frame itself.
    pub fn culled_itself(&mut self, frame: FrameNumber) {
        self.orphans.remove(&frame);
        self.whole.insert(frame);
        self.fresh = self.fresh.max(FrameNumber(frame.0.saturating_add(1)));
    }

    /// The frame to show now, if one is there: in lockstep the next one, live the newest.
    #[must_use]
    pub fn due(&self) -> Option<FrameNumber> {
        match self.pace {
            Pace::Lockstep { .. } => self.whole.contains(&self.next).then_some(self.next),
            Pace::Live => self.whole.last().copied(),
        }
    }

    /// The frame that the display must cull itself: there is no culler, or the frame's culler is gone and the
    /// others are busy.
    #[must_use]
    pub fn to_cull_itself(&self) -> Option<FrameNumber> {
        let frame = match self.pace {
            Pace::Live if !self.round_robin => self.fresh,
            _ => self.next,
        };
        let nobody = self.available().next().is_none();
        (in_session(self.pace, frame) && !self.whole.contains(&frame))
            .then_some(frame)
            .filter(|frame| nobody || self.orphans.contains(frame))
    }

    /// A frame is shown; older ones are dropped. Returns the dropped ones that had arrived.
    pub fn shown(&mut self, frame: FrameNumber) -> BTreeSet<FrameNumber> {
        self.next = FrameNumber(frame.0.saturating_add(1));
        let later = self.whole.split_off(&self.next);
        self.orphans = self.orphans.split_off(&self.next);
        let mut older = std::mem::replace(&mut self.whole, later);
        older.remove(&frame);
        older
    }

    /// Whether every frame has been shown.
    #[must_use]
    pub const fn is_done(&self) -> bool {
        !in_session(self.pace, self.next)
    }

    /// The first culler to be late, and when: the one with the oldest awaited frame.
    #[must_use]
    pub fn late(&self) -> Option<(CullerId, Instant)> {
        let cullers = self.cullers.iter().filter(|(_, culler)| !culler.late);
        let oldest = cullers.filter_map(|(id, culler)| Some((culler.outstanding().min()?, id, culler.since)));
        let (_, id, since) = oldest.min()?;
        Some((*id, since.after(self.usual.late(self.pace.least()))))
    }

    /// Deals the frames of missing cullers again, and distributes those to come.
    fn share_out(&mut self) {
        let cullers = self.cullers.values().filter(|culler| !culler.late);
        let under_way: BTreeSet<_> =
            cullers.flat_map(CullerFrames::outstanding).chain(self.whole.iter().copied()).collect();
        if self.round_robin {
            let dealt = (self.next.0..self.fresh.0).map(FrameNumber);
            self.orphans.extend(dealt.filter(|frame| !under_way.contains(frame)));
        }
        for (place, culler) in self.cullers.values_mut().filter(|culler| !culler.late).enumerate() {
            culler.own = FrameNumber(self.fresh.0.saturating_add(place as u32));
        }
    }
}

const fn in_session(pace: Pace, frame: FrameNumber) -> bool {
    match pace {
        Pace::Lockstep { frames: Some(frames) } => frame.0 < frames,
        Pace::Lockstep { frames: None } | Pace::Live => true,
    }
}
