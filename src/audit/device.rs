//! Walks on a Vulkan device, through the roles of a session.

use std::{fmt, sync::Arc};

use thiserror::Error;
use tokio::runtime::Handle;
use trimaran_actors::{Cameras, LocalSession, SessionError, Stop};
use trimaran_audit::cases::Case;
use trimaran_cull::{LodRule, View};
use trimaran_gpu::{Gpu, GpuError, GpuScene, ItemImage};
use trimaran_proto::{
    Camera, DrawableId, FrameNumber, OcclusionTestKind, Settings, ViewState, ViewVersion, Viewport,
};
use trimaran_scene::Scene;

use super::figures::{Figures, outside, toggles};
use crate::{
    comparison::System,
    culling::{Culling, CullingMethod},
    vulkan::VulkanDisplay,
    walkthrough::{AuditError, Auditor, FrameRecord, Recorder, ViewChange, ViewStates},
};

/// How a case is walked.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Way {
    /// The roles, and how they cull.
    pub system: System,
    /// The occlusion test of Trimaran's own method; other methods have theirs.
    pub occlusion_test: OcclusionTestKind,
    /// The rule for levels of detail.
    pub rule: LodRule,
}

impl Way {
    /// Every system that culls exactly, with each occlusion test if it has a choice. Of systems that differ
    /// only in their links there is one. Rays are left out: at edges of triangles they may differ from a
    /// rasterizer. So is the whole model, which has no levels.
    #[must_use]
    pub fn all(rule: LodRule) -> Vec<Self> {
        let is_first = |(place, system): &(usize, System)| {
            System::ALL.iter().position(|other| other.same_work(*system)) == Some(*place)
        };
        let systems = System::ALL.into_iter().enumerate().filter(is_first).map(|(_, system)| system);
        let exact = systems.filter(|system| system.culling().shows_the_cut());
        let tests = |system: System| match system.culling() {
            CullingMethod::Trimaran => OcclusionTestKind::ALL.to_vec(),
            _ => vec![OcclusionTestKind::Hzb],
        };
        exact
            .flat_map(|system| {
                let way = move |occlusion_test| Self { system, occlusion_test, rule };
                tests(system).into_iter().map(way)
            })
            .collect()
    }
}

/// As `switch, query`; a system that has its own occlusion test alone.
impl fmt::Display for Way {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.system.culling() {
            CullingMethod::Trimaran => write!(f, "{}, {}", self.system, self.occlusion_test),
            _ => self.system.fmt(f),
        }
    }
}

/// Why a case was not walked.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum CaseWalkError {
    /// The device cannot draw the case, or failed.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// A role refused the case, or failed.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// The frames cannot be compared.
    #[error(transparent)]
    Audit(#[from] AuditError),
    /// Fewer frames were shown than the case has, or some by other roles than they should have been.
    #[error("of {due} frames {shown} were shown, and {foreign} of them were not culled by a culler")]
    Incomplete {
        /// The frames of the case.
        due: usize,
        /// Those that were shown.
        shown: usize,
        /// Those that the display had to cull for itself.
        foreign: usize,
    },
    /// The case has no view.
    #[error("the case has no view")]
    NoView,
}

/// How often a case is walked until cullers have culled all of its frames.
const TRIES: u32 = 5;

/// A case on a device. The pictures without culling are drawn once for each rule, and all systems are
/// compared with them.
pub struct CaseOnDevice<'c> {
    case: &'c Case,
    drawn: Arc<GpuScene>,
    runtime: Handle,
    truth: Option<(LodRule, Arc<[Truth]>)>,
}

/// A frame without culling.
struct Truth {
    cut: Vec<DrawableId>,
    items: ItemImage,
}

impl<'c> CaseOnDevice<'c> {
    /// Copies the case's scene to the device.
    ///
    /// # Errors
    /// If it has no room there.
    pub fn new(case: &'c Case, gpu: &Arc<Gpu>, runtime: &Handle) -> Result<Self, GpuError> {
        let drawn = GpuScene::new(gpu, &case.scene)?;
        Ok(Self { case, drawn, runtime: runtime.clone(), truth: None })
    }

    /// Walks the case, and compares every frame with the one without culling.
    ///
    /// # Errors
    /// If the device or a role refuses the case: a picture that is too large, say.
    pub fn walk(&mut self, way: &Way) -> Result<Figures, CaseWalkError> {
        let views = view_states(&self.case.views, way).ok_or(CaseWalkError::NoView)?;
        let mut auditor = Auditor::new(&self.case.scene, &self.drawn, views.clone())?;
        let truth = self.truth(way.rule, &views, &mut auditor)?;
        let mut records = self.play(way, &views)?;
        let foreign = |records: &[FrameRecord]| records.iter().filter(|frame| frame.culler.is_none()).count();
        // On a busy machine a culler may be late by seconds, and the display culls its frame.
        let mut tries = 1;
        while way.system.cullers() > 0 && foreign(&records) > 0 {
            if tries == TRIES {
                let (due, shown) = (records.len(), records.len());
                return Err(CaseWalkError::Incomplete { due, shown, foreign: foreign(&records) });
            }
            records = self.play(way, &views)?;
            tries += 1;
        }
        let mut figures = Figures::default();
        for (record, truth) in records.iter().zip(truth.iter()) {
            let difference = auditor.triangle_difference(&truth.items, record)?;
            figures.add(record.camera.frame(), difference.pixels, difference.lost_nodes);
            figures.outside_cut += outside(&record.ids, &truth.cut);
            let is_background = |id: &&u32| **id == ItemImage::BACKGROUND;
            figures.background += truth.items.drawable.iter().filter(is_background).count() as u64;
            figures.drawn += record.ids.len() as u64;
            figures.whole += truth.cut.len() as u64;
        }
        figures.latency_frames = latency_frames(&records);
        // A display that culls for itself now and then tries what costs less: to draw all.
        figures.toggles = (way.system.cullers() > 0).then(|| {
            let frames = self.case.views.iter().zip(records.iter().map(|record| record.ids.as_slice()));
            toggles(frames, 2 * usize::from(way.system.cullers()))
        });
        Ok(figures)
    }

    /// The frames without culling.
    fn truth(
        &mut self,
        rule: LodRule,
        views: &ViewStates,
        auditor: &mut Auditor,
    ) -> Result<Arc<[Truth]>, CaseWalkError> {
        if let Some((_, truth)) = self.truth.as_ref().filter(|(of, _)| *of == rule) {
            return Ok(Arc::clone(truth));
        }
        let cameras = cameras(&self.case.views, views);
        let truth = cameras.into_iter().map(|camera| {
            let (cut, items) = auditor.unculled_items(camera)?;
            Ok(Truth { cut, items })
        });
        let truth = truth.collect::<Result<_, GpuError>>()?;
        let (_, truth) = self.truth.insert((rule, truth));
        Ok(Arc::clone(truth))
    }

    /// Plays the roles.
    fn play(&self, way: &Way, views: &ViewStates) -> Result<Vec<FrameRecord>, CaseWalkError> {
        let Self { case, drawn, runtime, .. } = self;
        let first = case.views.first().ok_or(CaseWalkError::NoView)?;
        let settings = settings(way, first.viewport());
        let cameras = cameras(&case.views, views);
        let played = Played { scene: &case.scene, drawn, views, cameras: &cameras };
        played.by(way.system, settings, runtime)
    }
}

/// Frames to be walked.
pub(super) struct Played<'p> {
    pub(super) scene: &'p Arc<Scene>,
    pub(super) drawn: &'p Arc<GpuScene>,
    pub(super) views: &'p ViewStates,
    pub(super) cameras: &'p [Camera],
}

impl Played<'_> {
    /// Plays the roles of a system. The display culls a frame by itself if its culler is late.
    pub(super) fn by(
        &self,
        system: System,
        settings: Settings,
        runtime: &Handle,
    ) -> Result<Vec<FrameRecord>, CaseWalkError> {
        let due = self.cameras.len();
        let session = LocalSession {
            cullers: system.cullers().into(),
            schedule: system.schedule(),
            ..LocalSession::new(self.scene, settings, due as u32)
        };
        let display = VulkanDisplay::new(self.drawn, settings.viewport)?;
        let turns = session.turns.clone();
        let cull = |_, settings: &Settings| {
            Culling::open(system.culling(), self.scene, self.drawn, settings, &turns)
        };
        let mut cameras = CaseCameras { cameras: self.cameras, views: self.views };
        let mut progress = |_| {};
        let mut recorder = Recorder::new(0, &mut progress);
        let (_stopper, stop) = Stop::new();
        session.run_with(cull, display, &mut cameras, &mut recorder, runtime, &stop)?;
        let records = recorder.into_frames();
        if records.len() != due {
            return Err(CaseWalkError::Incomplete { due, shown: records.len(), foreign: 0 });
        }
        Ok(records)
    }
}

/// The most frames that were shown while another one was culled, from its camera on.
fn latency_frames(records: &[FrameRecord]) -> u32 {
    let between = |(frame, record): (usize, &FrameRecord)| {
        let before = records.get(..frame).unwrap_or_default().iter().rev();
        before.take_while(|earlier| earlier.shown > record.published).count() as u32
    };
    records.iter().enumerate().map(between).max().unwrap_or(0)
}

fn settings(way: &Way, size: Viewport) -> Settings {
    Settings { occlusion_test: way.occlusion_test, ..Settings::new(size, way.rule) }
}

/// The view states of a case. `None` without a view.
fn view_states(views: &[View], way: &Way) -> Option<ViewStates> {
    let first = settings(way, views.first()?.viewport());
    let state = |view: &View| ViewState {
        sections: *view.sections(),
        ..ViewState::from(settings(way, view.viewport()))
    };
    Some(changes(first, views.iter().map(state)))
}

/// The view states of frames that follow each other in a session of these settings: one more wherever they
/// change. The roles take the first one from the settings.
pub(super) fn changes(settings: Settings, states: impl IntoIterator<Item = ViewState>) -> ViewStates {
    let first = ViewState::from(settings);
    let mut last = first.clone();
    let mut later = Vec::new();
    for (pose, state) in (0..).zip(states) {
        if state != last {
            last = state.clone();
            later.push(ViewChange { pose, state: state.into() });
        }
    }
    ViewStates::new(first, later)
}

/// A case's cameras, numbered from 0.
fn cameras(views: &[View], states: &ViewStates) -> Vec<Camera> {
    let camera = |(frame, view): (u32, &View)| {
        view.camera().for_frame(FrameNumber(frame)).in_view(states.version_at(frame))
    };
    (0..).zip(views).map(camera).collect()
}

struct CaseCameras<'v> {
    cameras: &'v [Camera],
    views: &'v ViewStates,
}

impl Cameras for CaseCameras<'_> {
    fn camera(&mut self, frame: FrameNumber) -> Camera {
        let known = self.cameras.get(frame.0 as usize).or(self.cameras.last());
        known.map_or(Camera::at_origin(frame), |camera| camera.for_frame(frame))
    }

    fn view_state(&mut self, version: ViewVersion) -> Option<Arc<ViewState>> {
        self.views.get(version).cloned()
    }
}
