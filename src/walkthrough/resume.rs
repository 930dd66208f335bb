//! Resumes a killed process's walk: the journal's data beside that of the report.

use std::{
    collections::BTreeSet,
    time::{Duration, SystemTime},
};

use serde::{Deserialize, Serialize};
use trimaran_actors::CullerId;
use trimaran_cull::draw_order;
use trimaran_proto::{DrawableId, FrameNumber, FrameStats, SentBytes, SessionKey};
use trimaran_scene::Scene;
use xxhash_rust::xxh3::Xxh3;

use super::{compose::FrameRecord, path::CameraPath, reporting::Walk};
use crate::report::{ReportError, Run, Writer};

/// The progress of a walk that resumes if its process is killed.
#[derive(Debug)]
pub struct Progress {
    /// Its session, as cullers know it.
    pub session: SessionKey,
    /// When it began, if another process began it: as in the report.
    pub started: Option<String>,
    /// Its frames so far.
    pub records: Vec<FrameRecord>,
    /// Its remarks so far.
    pub notes: Vec<String>,
    /// How long ago the last process stopped, or was killed, if there was one.
    pub gap: Option<Duration>,
}

/// Identifies the walk in the journal's first line.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct WalkState {
    session: SessionKey,
    fingerprint: String,
}

#[derive(Deserialize)]
struct Head {
    run: Run,
    state: WalkState,
}

#[derive(Deserialize)]
struct Line {
    note: Option<String>,
    state: Option<FrameState>,
}

/// A frame's record. Its ids are the differences from the frame before.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct FrameState {
    /// The index of its camera in the path.
    pose: usize,
    culler: Option<usize>,
    /// The first such id, and the differences between consecutive ones.
    changes: Vec<u32>,
    for_loss: u32,
    lacking: u32,
    again: bool,
    picture: Option<u64>,
    published: Duration,
    begun: Duration,
    drawing: Duration,
    shown: Duration,
    on_device: Duration,
    traffic: SentBytes,
    arrivals: Vec<(u32, Duration)>,
    stats: Option<FrameStats>,
}

impl Progress {
    /// A walk that begins.
    #[must_use]
    pub const fn new(session: SessionKey) -> Self {
        Self { session, started: None, records: Vec::new(), notes: Vec::new(), gap: None }
    }

    /// Resumes a killed process's records in the folder of `writer`, which was [opened](Writer::open) for
    /// this. `None` if there are none, or they are of another walk: those stay until this one begins.
    ///
    /// # Errors
    /// If it cannot be read or written to.
    pub fn resume(writer: &mut Writer, walk: Walk<'_>, now: SystemTime) -> Result<Option<Self>, ReportError> {
        let Some(left) = writer.left::<Head, Line>()? else { return Ok(None) };
        let Head { run, state } = &left.head;
        if state.fingerprint != fingerprint(walk) {
            tracing::warn!(
                "the unfinished walk is another one: its scene, path, settings, device or release differ"
            );
            return Ok(None);
        }
        let (mut records, mut notes, mut last) = (Vec::new(), Vec::new(), BTreeSet::new());
        for line in &left.lines {
            match line {
                Line { note: Some(note), .. } => notes.push(note.clone()),
                Line { state: Some(state), .. } => {
                    match state.record(&walk.file.scene, walk.path, records.len(), &mut last) {
                        Some(record) => records.push(record),
                        None => return Ok(None),
                    }
                }
                Line { note: None, state: None } => return Ok(None),
            }
        }
        if records.is_empty() {
            return Ok(None);
        }
        let shown = records.iter().filter(|record| record.picture.is_some());
        writer.go_on(&left, shown.map(|record| record.camera.frame().0))?;
        // The clock may have been set back.
        let gap = now.duration_since(left.stopped).unwrap_or_default();
        let started = Some(run.started.clone());
        Ok(Some(Self { session: state.session, started, records, notes, gap: Some(gap) }))
    }

    /// The next frame.
    #[must_use]
    pub fn first(&self) -> FrameNumber {
        FrameNumber(u32::try_from(self.records.len()).unwrap_or(u32::MAX))
    }

    /// How long it has been walked, without the gaps: until its last picture was shown.
    #[must_use]
    pub fn walked(&self) -> Duration {
        self.records.last().map_or(Duration::ZERO, |record| record.shown)
    }

    /// A remark that the walk was resumed, if it was.
    #[must_use]
    pub fn went_on(&self) -> Option<String> {
        let gap = Duration::from_secs(self.gap?.as_secs());
        let gap = humantime::format_duration(gap);
        Some(format!("the display stopped before {} and went on after {gap}", self.first()))
    }

    pub(super) fn state(&self, walk: Walk<'_>) -> WalkState {
        WalkState { session: self.session, fingerprint: fingerprint(walk) }
    }
}

/// The release since which pictures are drawn and recorded alike. A walk goes on in another release that
/// names the same one, so a display can be upgraded during its walk. A change of either names its own.
const DRAWN_SINCE: &str = "0.1.0";

/// The settings that decide the pictures of a walk, so that one is not resumed with those of another.
fn fingerprint(Walk { file, drawn, plan, path }: Walk<'_>) -> String {
    let info = drawn.gpu().info();
    let mut hash = Xxh3::new();
    let (scene, views) = (file.scene.hash(), path.views());
    hash.update(format!("{DRAWN_SINCE} {scene} {} {} {plan:?} {views:?}", info.name, info.driver).as_bytes());
    for camera in path.all() {
        hash.update(&camera.to_bytes());
    }
    format!("{:032x}", hash.digest128())
}

/// Makes the data of each frame needed to resume.
#[derive(Debug)]
pub(super) struct Keeper {
    path: CameraPath,
    /// The ids of the frame before.
    last: BTreeSet<DrawableId>,
}

impl Keeper {
    /// Continues after these frames.
    pub(super) fn after(records: &[FrameRecord], path: &CameraPath) -> Self {
        let last = records.last().map(|record| record.ids.iter().copied().collect());
        Self { path: path.clone(), last: last.unwrap_or_default() }
    }

    /// The next frame.
    pub(super) fn keep(&mut self, record: &FrameRecord) -> FrameState {
        let FrameRecord { camera, culler, ids, for_loss, lacking, again, picture, .. } = record;
        let FrameRecord { published, begun, drawing, shown, on_device, traffic, arrivals, stats, .. } =
            record;
        let ids: BTreeSet<_> = ids.iter().copied().collect();
        let mut below = 0;
        let gap = |id: &DrawableId| id.0 - std::mem::replace(&mut below, id.0);
        let changes = ids.symmetric_difference(&self.last).map(gap).collect();
        self.last = ids;
        FrameState {
            pose: self.path.index_of(camera).unwrap_or(usize::MAX),
            culler: culler.map(CullerId::index),
            changes,
            for_loss: *for_loss,
            lacking: *lacking,
            again: *again,
            picture: *picture,
            published: *published,
            begun: *begun,
            drawing: *drawing,
            shown: *shown,
            on_device: *on_device,
            traffic: *traffic,
            arrivals: arrivals.clone(),
            stats: *stats,
        }
    }
}

impl FrameState {
    /// The kept record of this frame of the walk, after one with the ids `last`; none if it is invalid.
    pub(super) fn record(
        &self,
        scene: &Scene,
        path: &CameraPath,
        number: usize,
        last: &mut BTreeSet<DrawableId>,
    ) -> Option<FrameRecord> {
        let number = FrameNumber(u32::try_from(number).ok()?);
        let camera = path.all().get(self.pose)?.for_frame(number);
        let mut id = 0_u32;
        for gap in &self.changes {
            id = id.checked_add(*gap)?;
            let changed = DrawableId(id);
            scene.drawables().get(changed.index())?;
            if !last.remove(&changed) {
                last.insert(changed);
            }
        }
        let mut ids: Vec<_> = last.iter().copied().collect();
        // In the display's drawing order.
        draw_order(scene, &path.views().view(camera), &mut ids);
        Some(FrameRecord {
            camera,
            culler: self.culler.and_then(CullerId::of),
            ids,
            for_loss: self.for_loss,
            lacking: self.lacking,
            again: self.again,
            picture: self.picture,
            published: self.published,
            begun: self.begun,
            drawing: self.drawing,
            shown: self.shown,
            on_device: self.on_device,
            traffic: self.traffic,
            arrivals: self.arrivals.clone(),
            stats: self.stats,
        })
    }
}

#[cfg(test)]
mod tests {
    use trimaran_cook::{
        CookOptions, cook,
        generate::{PlantOptions, plant},
    };
    use trimaran_cull::{LodRule, View, Viewport, lod_cut};
    use trimaran_proto::Settings;

    use super::*;
    use crate::walkthrough::PathChoice;

    #[test]
    fn a_frame_is_kept_to_the_last_bit_and_takes_few_bytes() {
        let model = plant(&PlantOptions { objects: 300, triangles: 60_000, ..PlantOptions::small(5) });
        let scene = cook(&model, &CookOptions::default(), &()).unwrap();
        let size = Viewport::new(200, 100).unwrap();
        let views = Settings::new(size, LodRule::new(2.0).unwrap()).into();
        let path = CameraPath::find(&PathChoice::Auto { seed: 1 }, &scene, views, Some(30)).unwrap();
        let frame = |number: usize| {
            // A live walk skips some poses, and shows others twice.
            let camera = path.all()[number * 3 / 2].for_frame(FrameNumber(number as u32));
            let view = View::new(camera, size);
            let mut ids = lod_cut(&scene, &view, LodRule::new(2.0).unwrap());
            draw_order(&scene, &view, &mut ids);
            FrameRecord {
                camera,
                culler: CullerId::of(number % 2),
                ids,
                for_loss: 3,
                lacking: number as u32 % 3,
                again: number % 4 == 2,
                picture: Some(u64::MAX - 5),
                published: Duration::from_nanos(1_000_000_007),
                begun: Duration::from_nanos(2),
                drawing: Duration::from_nanos(3),
                shown: Duration::from_nanos(4),
                on_device: Duration::from_nanos(5),
                traffic: SentBytes { ids: 12, ..SentBytes::default() },
                arrivals: vec![(5, Duration::from_nanos(6))],
                stats: (number > 0).then(FrameStats::default),
            }
        };
        let frames: Vec<_> = (0..20).map(frame).collect();
        let (before, after) = frames.split_at(10);
        let (mut first, mut second) = (Keeper::after(&[], &path), Keeper::after(before, &path));
        let kept = before.iter().map(|record| first.keep(record)).collect::<Vec<_>>();
        let kept = kept.into_iter().chain(after.iter().map(|record| second.keep(record)));
        let mut last = BTreeSet::new();
        let (mut bytes, mut ids) = (0, 0);
        for (number, state) in kept.enumerate() {
            let line = serde_json::to_string(&state).unwrap();
            (bytes, ids) = (bytes + line.len(), ids + frames[number].ids.len());
            let state: FrameState = serde_json::from_str(&line).unwrap();
            let back = state.record(&scene, &path, number, &mut last).unwrap();
            assert_eq!(format!("{back:?}"), format!("{:?}", frames[number]));
        }
        let ids_alone = ids * 4 / frames.len();
        println!("{} bytes a frame, where the ids alone would take {ids_alone}", bytes / frames.len());
        let nobody = FrameState { changes: vec![u32::MAX], ..Keeper::after(&[], &path).keep(&frames[0]) };
        assert!(nobody.record(&scene, &path, 0, &mut BTreeSet::new()).is_none(), "no such id");
        let nowhere = FrameState { pose: 30, ..Keeper::after(&[], &path).keep(&frames[0]) };
        assert!(nowhere.record(&scene, &path, 0, &mut BTreeSet::new()).is_none(), "no such camera");
    }
}
