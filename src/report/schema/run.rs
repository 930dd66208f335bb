//! A run: its scene, machines and settings.

use std::{fmt, time::SystemTime};

use serde::{Deserialize, Serialize};
use trimaran_actors::{AheadUse, CullerId, Schedule};

use crate::culling::CullingMethod;

/// One of the machines, or of the actors that stand for them: `display`, `culler 1` and so on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(into = "String", try_from = "String")]
pub enum Machine {
    /// A culler.
    Culler(CullerId),
    /// The display.
    Display,
}

impl Machine {
    /// The machine of a culler, or without one the display.
    #[must_use]
    pub fn of(culler: Option<CullerId>) -> Self {
        culler.map_or(Self::Display, Self::Culler)
    }
}

impl fmt::Display for Machine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Culler(id) => id.fmt(f),
            Self::Display => f.write_str("display"),
        }
    }
}

impl From<Machine> for String {
    fn from(machine: Machine) -> Self {
        machine.to_string()
    }
}

impl TryFrom<String> for Machine {
    type Error = String;

    fn try_from(name: String) -> Result<Self, String> {
        let mut all = CullerId::first(CullerId::MOST).map(Self::Culler).chain([Self::Display]);
        all.find(|machine| machine.to_string() == name)
            .ok_or_else(|| format!("no machine is called {name:?}"))
    }
}

/// A run: its scene, machines and settings.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Run {
    /// The program's version.
    pub version: String,
    /// The command line, one argument an entry, the program first.
    pub command_line: Vec<String>,
    /// When the run began: RFC 3339, UTC, as [`timestamp`] writes it.
    pub started: String,
    /// The machines' share: who drew on what.
    pub roles: Vec<RoleInfo>,
    /// The scene walked through.
    pub scene: SceneInfo,
    /// The bound on the picture's level-of-detail error, pixels.
    pub epsilon_px: f64,
    /// How what is visible was found, in walks of this machine.
    #[serde(default)]
    pub culling: CullingMethod,
    /// The occlusion test: `query`, `raster` or `hzb`.
    pub occlusion_test: String,
    /// The most node ids in one message.
    pub batch: u32,
    /// How ids travelled: `plain` or `changes`. In one process they are not coded.
    #[serde(default)]
    pub coding: Option<String>,
    /// How the roles are joined: `inproc` (threads of one process), `unix`, `tcp`, `ws`, `quic` or `udp`
    /// (processes).
    pub link: String,
    /// The transport below the link, in words, with the options that matter.
    pub transport: String,
    /// How many cullers the walk was to have.
    pub cullers: u32,
    /// Which visible set cullers drew their occluders from: `independent` or `switch`.
    pub schedule: String,
    /// Whether every camera of the path became a frame, or the newest camera won.
    pub mode: Mode,
    /// Whether the roles computed one after another. Then no busy time contains another role's work, and the
    /// frames' rate is not that of a walk.
    #[serde(default)]
    pub alone: bool,
    /// Where the cameras came from: `auto`, or the path file.
    pub path: String,
    /// The seed of an `auto` path and of whatever else is drawn by lot.
    pub seed: Option<u64>,
    /// Frames 0, n, 2n and on were audited against the unculled pictures; `null` if none was.
    pub audit_every: Option<u32>,
    /// The view states that followed the one that the walk began in.
    #[serde(default)]
    pub view_states: Vec<ViewStateInfo>,
    /// The parts of the scene that the display's process held when the walk ended.
    #[serde(default)]
    pub memory: Option<MemoryUse>,
    /// Where the display began without the scene: geometry that came before a frame needed it.
    #[serde(default)]
    pub ahead: Option<SentAhead>,
    /// Remarks that belong beside every figure, such as why an automatic path circles the scene.
    #[serde(default)]
    pub notes: Vec<String>,
}

/// The parts of the scene that a process held, in its memory and on its device.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct MemoryUse {
    /// Bytes of the scene's records in memory: what of its tree was asked for.
    pub scene_bytes: u64,
    /// Bytes of the device's memory that are taken for triangles.
    pub device_taken_bytes: u64,
    /// Bytes of triangles that are there.
    pub device_bytes: u64,
    /// Pieces of geometry that were brought to the device.
    pub pieces_brought: u64,
    /// Their bytes.
    pub bytes_brought: u64,
    /// Pieces that were dropped to make room.
    pub pieces_dropped: u64,
}

/// Geometry that cullers sent to a display before a frame needed it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct SentAhead {
    /// Pieces that came.
    pub pieces: u64,
    /// Their bytes.
    pub bytes: u64,
    /// Pieces of these that a frame has used.
    pub used_pieces: u64,
    /// Their bytes.
    pub used_bytes: u64,
}

impl From<AheadUse> for SentAhead {
    fn from(AheadUse { pieces, bytes, used_pieces, used_bytes }: AheadUse) -> Self {
        Self { pieces, bytes, used_pieces, used_bytes }
    }
}

impl Run {
    /// How many receivers the ids of a frame have.
    #[must_use]
    pub fn receivers(&self) -> u8 {
        match self.cullers {
            0 => 0,
            _ if self.schedule == Schedule::Switch.name() => 2,
            _ => 1,
        }
    }
}

/// The parts of the scene that are seen, from a place of the path on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ViewStateInfo {
    /// By which frames name it, from 1.
    pub version: u32,
    /// The first pose of the path that is seen in it. In lockstep that is the frame.
    pub from_frame: u32,
    /// Width of the pictures, pixels.
    pub width: u32,
    /// Height of the pictures, pixels.
    pub height: u32,
    /// The bound on the picture's level-of-detail error, pixels.
    pub epsilon_px: f64,
    /// The occlusion test.
    pub occlusion_test: String,
    /// How many sections cut the scene.
    pub sections: u64,
    /// How many objects are hidden.
    pub hidden: u64,
    /// How many objects are isolated; `null` if all are shown but those hidden.
    pub isolated: Option<u64>,
    /// How many objects are seen through; `null` if those that the model has so.
    pub see_through: Option<u64>,
}

/// Whether every camera became a frame.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Mode {
    /// Every camera of the path is one frame; the run is deterministic.
    #[default]
    Lockstep,
    /// OR takes the latest camera; cameras that came too early are skipped.
    Live,
}

/// One of the machines.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct RoleInfo {
    /// Which.
    pub machine: Machine,
    /// The Vulkan device's name.
    pub device: String,
    /// The driver's name and version.
    pub driver: String,
}

/// The scene walked through.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SceneInfo {
    /// The cooked file.
    pub file: String,
    /// Its fingerprint, 32 hexadecimal digits.
    pub hash: String,
    /// Size of the cooked file in bytes.
    pub file_bytes: Option<u64>,
    /// Objects of the model, instances counted each.
    pub objects: u64,
    /// Nodes of the tree.
    pub nodes: u64,
    /// Nodes times their levels of detail.
    pub drawables: u64,
    /// Triangles at full detail, instances counted each.
    pub triangles: u64,
    /// The files the scene was cooked from.
    pub sources: Vec<String>,
}

/// A moment as the report writes it: RFC 3339 in UTC, whole seconds (`2026-03-01T12:34:56Z`).
#[must_use]
pub fn timestamp(time: SystemTime) -> String {
    humantime::format_rfc3339_seconds(time).to_string()
}
