//! A search for a frame whose pixels culling changes, on a Vulkan device.

use std::{collections::BTreeMap, fmt, sync::Arc};

use serde::{Deserialize, Serialize};
use tokio::runtime::Handle;
use trimaran_actors::Stop;
use trimaran_audit::search::{Trial, shrink};
use trimaran_gpu::{Gpu, GpuError, GpuOptions, Optional};
use trimaran_proto::OcclusionTestKind;
use trimaran_scene::random::Random;
use trimaran_transport::causes;

use super::{
    CaseWalkError, Figures,
    trial::{TrialCulling, TrialOnDevice, TrialWalkError},
};
use crate::walkthrough::Judgement;

/// Frames of a trial, and the ways in which it is culled: enough that drawing them without culling, and
/// opening passes, take little of the time.
const FRAMES: usize = 80;
const CULLINGS: usize = 6;

/// Memory for triangles that holds only a part of many trials.
const LITTLE_MEMORY: u64 = 16 << 10;

/// The most trials to walk for a smallest failing one.
const TRIES: u32 = 1500;

/// A trial, and how it is culled.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct KeptTrial {
    /// How it is culled.
    #[serde(flatten)]
    pub culling: TrialCulling,
    /// How the device is opened.
    #[serde(flatten)]
    pub opening: Opening,
    /// The trial.
    pub trial: Trial,
}

/// How a device is opened.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Opening {
    /// Its memory for triangles, bytes, if it is bounded.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gpu_memory: Option<u64>,
    /// Whether it traverses the tree, whatever its kind, and each traversal is compared with the host's.
    #[serde(default)]
    pub check_device: bool,
}

/// The counts of a search.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct SearchCounts {
    /// Scenes with their walks.
    pub trials: u64,
    /// Frames that were culled and compared.
    pub frames: u64,
    /// Pixels of them that culling changed.
    pub wrong_pixels: u64,
    /// Drawables that culling lost.
    pub lost_nodes: u64,
    /// Drawables that were drawn, of all frames.
    pub drawn: u64,
    /// Drawables that would have been drawn without culling.
    pub whole: u64,
}

/// The fault of a walk.
#[derive(Debug, Clone)]
pub enum Wrong {
    /// It has wrong pixels, or lost drawables.
    Pixels(Figures, Judgement),
    /// It ended with an error.
    Error(String),
}

impl Wrong {
    /// Whether both are errors, or both wrong pixels by the fault of the same side.
    fn is_like(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Error(_), Self::Error(_)) => true,
            (Self::Pixels(_, one), Self::Pixels(_, other)) => one.is_of_driver() == other.is_of_driver(),
            _ => false,
        }
    }
}

impl fmt::Display for Wrong {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Error(error) => f.write_str(error),
            Self::Pixels(figures, judgement) => {
                let Figures { wrong_pixels, lost_nodes, outside_cut, .. } = figures;
                write!(f, "{wrong_pixels} wrong pixels, {lost_nodes} lost nodes; {judgement}")?;
                if *outside_cut > 0 {
                    write!(f, "; {outside_cut} drawables are not of the LOD cut")?;
                }
                Ok(())
            }
        }
    }
}

/// Trials of one seed after the other on a device.
pub struct Search {
    options: GpuOptions,
    gpus: BTreeMap<Opening, Arc<Gpu>>,
    runtime: Handle,
    has_float64: bool,
    counts: SearchCounts,
}

impl Search {
    /// Opens the device.
    ///
    /// # Errors
    /// If there is none.
    pub fn open(options: GpuOptions, runtime: &Handle) -> Result<Self, GpuError> {
        let mut search = Self {
            options,
            gpus: BTreeMap::new(),
            runtime: runtime.clone(),
            has_float64: false,
            counts: SearchCounts::default(),
        };
        let lacks = &search.gpu(Opening::default())?.info().lacks;
        search.has_float64 = !lacks.contains(&Optional::Float64);
        Ok(search)
    }

    /// The device's name and its driver.
    ///
    /// # Errors
    /// If the device cannot be opened.
    pub fn driver(&mut self) -> Result<String, GpuError> {
        let info = self.gpu(Opening::default())?.info().clone();
        Ok(format!("{}, {}", info.name, info.driver))
    }

    /// The counts until now.
    #[must_use]
    pub const fn counts(&self) -> &SearchCounts {
        &self.counts
    }

    /// Draws the trial of a seed, walks it in some ways, and returns those that fail. Ends early if `stop` is
    /// requested.
    ///
    /// # Errors
    /// If the device cannot be opened.
    pub fn trial(&mut self, seed: u64, stop: &Stop) -> Result<Vec<(KeptTrial, Wrong)>, GpuError> {
        let trial = Trial::draw(seed, FRAMES);
        let mut random = Random::stream(seed, 0x7761_7973, 0);
        let opening = self.opening(&mut random);
        let gpu = Arc::clone(self.gpu(opening)?);
        self.counts.trials += 1;
        let mut on_device = TrialOnDevice::new(&trial, &gpu, &self.runtime);
        let mut wrong = Vec::new();
        for culling in cullings(&mut random, opening) {
            if stop.requested() {
                break;
            }
            let walked = match &mut on_device {
                Ok(on_device) => on_device.judged(culling).map_err(|error| causes(&error)),
                Err(error) => Err(causes(error)),
            };
            self.count(walked.as_ref().ok().map(|(figures, _)| figures));
            let fault = match walked {
                Ok((figures, _)) if figures.is_exact() => continue,
                Ok((figures, judgement)) => Wrong::Pixels(figures, judgement),
                Err(error) => Wrong::Error(error),
            };
            wrong.push((KeptTrial { culling, opening, trial: trial.clone() }, fault));
        }
        Ok(wrong)
    }

    /// Walks a trial; `None` if nothing is wrong.
    ///
    /// # Errors
    /// If the device cannot be opened.
    pub fn replay(&mut self, kept: &KeptTrial) -> Result<Option<Wrong>, GpuError> {
        let walked = self.walk(kept)?;
        self.counts.trials += 1;
        self.count(walked.as_ref().ok().map(|(figures, _)| figures));
        Ok(match walked {
            Ok((figures, _)) if figures.is_exact() => None,
            Ok((figures, judgement)) => Some(Wrong::Pixels(figures, judgement)),
            Err(error) => Some(Wrong::Error(causes(&error))),
        })
    }

    /// The smallest trial that fails as this one does, and its fault. Calls `progress` after each try. Ends
    /// early if `stop` is requested.
    pub fn shrink(
        &mut self,
        kept: KeptTrial,
        mut wrong: Wrong,
        stop: &Stop,
        mut progress: impl FnMut(),
    ) -> (KeptTrial, Wrong) {
        let KeptTrial { culling, opening, trial } = kept;
        let fails = |trial: &Trial| {
            if stop.requested() {
                return false;
            }
            progress();
            let kept = KeptTrial { culling, opening, trial: trial.clone() };
            let now = match self.walk(&kept) {
                Ok(Ok((figures, judgement))) if !figures.is_exact() => Wrong::Pixels(figures, judgement),
                Ok(Err(TrialWalkError::Walk(error))) if !matches!(error, CaseWalkError::NoView) => {
                    Wrong::Error(causes(&error))
                }
                _ => return false,
            };
            let is_alike = wrong.is_like(&now);
            if is_alike {
                wrong = now;
            }
            is_alike
        };
        let trial = shrink(trial, TRIES, fails);
        (KeptTrial { culling, opening, trial }, wrong)
    }

    fn walk(&mut self, kept: &KeptTrial) -> Result<Result<(Figures, Judgement), TrialWalkError>, GpuError> {
        let gpu = Arc::clone(self.gpu(kept.opening)?);
        let on_device = TrialOnDevice::new(&kept.trial, &gpu, &self.runtime);
        Ok(on_device.and_then(|mut on_device| on_device.judged(kept.culling)))
    }

    fn opening(&self, random: &mut Random) -> Opening {
        match random.below(4) {
            0 => Opening { gpu_memory: Some(LITTLE_MEMORY), check_device: false },
            1 if self.has_float64 => Opening { gpu_memory: None, check_device: true },
            _ => Opening::default(),
        }
    }

    fn gpu(&mut self, opening: Opening) -> Result<&Arc<Gpu>, GpuError> {
        if !self.gpus.contains_key(&opening) {
            let Opening { gpu_memory, check_device } = opening;
            let memory = gpu_memory.or(self.options.memory);
            let check_traversals = check_device || self.options.check_traversals;
            let gpu = Gpu::open(&GpuOptions { memory, check_traversals, ..self.options.clone() })?;
            self.gpus.insert(opening, gpu);
        }
        self.gpus.get(&opening).ok_or(GpuError::NotBegun("the device"))
    }

    fn count(&mut self, figures: Option<&Figures>) {
        let Some(figures) = figures else { return };
        self.counts.frames += u64::from(figures.frames);
        self.counts.wrong_pixels += figures.wrong_pixels;
        self.counts.lost_nodes += figures.lost_nodes;
        self.counts.drawn += figures.drawn;
        self.counts.whole += figures.whole;
    }
}

/// Some of the ways to cull. A device that traverses the tree does so for one occlusion test.
fn cullings(random: &mut Random, opening: Opening) -> Vec<TrialCulling> {
    let mut all = TrialCulling::all();
    all.retain(|culling| !opening.check_device || culling.occlusion_test == OcclusionTestKind::Hzb);
    while all.len() > CULLINGS {
        all.swap_remove(random.below(all.len()));
    }
    all
}
