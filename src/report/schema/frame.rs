//! One frame of a run.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

pub use trimaran_cull::{FalseCullCause, ImageDifference};
pub use trimaran_proto::SentBytes;

/// One frame: pose, times, what was drawn, what should have been, and what it cost on the wire.
///
/// `None` means "not measured on this frame" and is written as `null`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Frame {
    /// The frame's number, from 0.
    pub frame: u32,
    /// The eye in the world, metres.
    pub eye: [f64; 3],
    /// The view direction, a unit vector in the world.
    pub forward: [f64; 3],
    /// Up in the picture: a world direction, not parallel to `forward`.
    pub up: [f64; 3],

    /// The view state that it is seen in; 0 is the one that the walk began in.
    #[serde(default)]
    pub view_state: u32,

    /// Busy time of OR for this frame: drawing its occluders, waiting not counted. Milliseconds.
    pub or_ms: Option<f64>,
    /// Busy time of HC for this frame: cut, box tests, sending. Milliseconds.
    pub hc_ms: Option<f64>,
    /// Busy time of RVG for this frame: drawing the visible set. Milliseconds.
    pub rvg_ms: Option<f64>,
    /// The device's time for OR's occluders, by its own timestamps, milliseconds. Each of these four is
    /// `None` where nothing was done on the device, or it has no timestamps.
    #[serde(default)]
    pub occluders_device_ms: Option<f64>,
    /// The same for HC's depth pyramid.
    #[serde(default)]
    pub pyramid_device_ms: Option<f64>,
    /// The same for HC's traversal of the tree, or tests of boxes.
    #[serde(default)]
    pub culling_device_ms: Option<f64>,
    /// The same for RVG's picture.
    #[serde(default)]
    pub picture_device_ms: Option<f64>,
    /// Time from the previous picture shown to this one, milliseconds.
    pub frame_ms: Option<f64>,
    /// Frames shown between the camera's publication and its own picture; 0 if its picture was the very
    /// next. `None` for one that is shown again.
    pub latency_frames: Option<u32>,
    /// Time from the camera's publication to its first picture, milliseconds. `None` for one that is shown
    /// again.
    pub latency_ms: Option<f64>,
    /// Drawables that had not come yet, where the display began without the scene: coarser ones were drawn in
    /// their place. 0 where the picture is exact.
    #[serde(default)]
    pub lacking: u64,
    /// Whether it is the frame before, shown again as more of it has come.
    #[serde(default)]
    pub again: bool,
    /// The machine that did OR and HC of this frame: a culler, or the display itself.
    #[serde(default)]
    pub culled_by: Option<super::Machine>,
    /// When each role was busy with this frame.
    #[serde(default)]
    pub timeline: Vec<Span>,

    /// Drawables that RVG drew.
    pub nodes_drawn: Option<u64>,
    /// Drawables exactly visible at the same LOD cut: those that own a pixel of its unculled item buffer.
    pub nodes_exact: Option<u64>,
    /// Objects that what RVG drew shows: all that a merged level stands for, and one for the parts of one.
    #[serde(default)]
    pub objects_drawn: Option<u64>,
    /// The same of the drawables that are exactly visible at the same LOD cut.
    #[serde(default)]
    pub objects_exact: Option<u64>,
    /// Triangles that RVG drew.
    pub triangles_drawn: Option<u64>,
    /// Triangles exactly visible at the same LOD cut: those that own a pixel of its unculled item buffer.
    pub triangles_exact: Option<u64>,
    /// Objects exactly visible at full detail.
    pub objects_exact_full: Option<u64>,
    /// Triangles exactly visible at full detail.
    pub triangles_exact_full: Option<u64>,
    /// Drawables drawn as occluders, in all rounds.
    pub occluders_drawn: Option<u64>,
    /// Triangles drawn as occluders, in all rounds.
    pub occluder_triangles: Option<u64>,
    /// The work of HC's traversal.
    pub culling: Option<CullingCounts>,
    /// The work of further rounds.
    #[serde(default)]
    pub rounds: Option<RoundCounts>,
    /// Nodes drawn because the test could not be decided, by reason.
    #[serde(default)]
    pub conservatively_visible: BTreeMap<String, u64>,

    /// Drawables exactly visible at the same LOD cut that were not drawn.
    pub false_culled_nodes: Option<u64>,
    /// Pixels that those drawables own.
    pub false_culled_pixels: Option<u64>,
    /// Size of the largest 8-connected blob of such pixels.
    pub false_culled_blob_px: Option<u64>,
    /// The false culls by cause; empty if there are none, or if no cause could be looked for.
    #[serde(default)]
    pub false_culls: Vec<FalseCull>,
    /// Pixels whose colour differs from the unculled picture of the same LOD cut. Must be 0.
    pub cut_mismatch_pixels: Option<u64>,
    /// The same of a picture that lacks something: what of it is not exact yet.
    #[serde(default)]
    pub loading_pixels: Option<u64>,
    /// The picture against full detail: the error of the levels.
    pub full_detail: Option<ImageDifference>,

    /// All bytes sent for this frame over all links, headers included. `None` for one that is shown again.
    pub bytes: Option<u64>,
    /// The same by kind: 72 bytes a camera; 4 an id and receiver, where they are not coded.
    pub bytes_by_kind: Option<SentBytes>,

    /// The objects exactly visible at full detail, if the run was asked for them.
    pub visible: Option<Vec<VisibleObject>>,
    /// The PNG files of this frame, relative to the report.
    #[serde(default)]
    pub pictures: FramePictures,
}

/// The work of a machine at a moment.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Role {
    /// Occlusion representation: draws the next frame's occluders.
    Or,
    /// Hardware cull: tests boxes against the occluders.
    Hc,
    /// Render visible geometry: makes the picture.
    Rvg,
}

/// A time in which a role was busy with a frame, on the one clock of the run (0: its start).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Span {
    /// The role.
    pub role: Role,
    /// The machine that played it.
    pub machine: super::Machine,
    /// Begin, milliseconds.
    pub start_ms: f64,
    /// End, milliseconds.
    pub end_ms: f64,
}

/// The work of HC's traversal of the tree.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct CullingCounts {
    /// Nodes looked at.
    pub nodes_visited: u64,
    /// Nodes outside the frustum.
    pub nodes_outside: u64,
    /// Boxes tested against the occluders.
    pub boxes_tested: u64,
    /// Boxes found hidden.
    pub boxes_hidden: u64,
    /// Batches of box tests, one a level of the tree.
    pub batches: u64,
    /// Nodes drawn too coarsely because they show at few pixels: the paper's section 4.5.2, if it is on.
    #[serde(default)]
    pub stopped_at_few_pixels: u64,
}

/// HC's work in further rounds: it drew some of what it had found as occluders, and tested again.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct RoundCounts {
    /// Further rounds after the first one.
    pub further: u32,
    /// Triangles of the occluders that were drawn in them.
    pub occluder_triangles: u64,
    /// The time in which these were drawn, part of `hc_ms`.
    pub drawing_ms: f64,
    /// Boxes tested again.
    pub boxes_tested: u64,
    /// Drawables found hidden.
    pub nodes_hidden: u64,
}

/// Drawables falsely culled for one cause.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct FalseCull {
    /// The cause.
    pub cause: FalseCullCause,
    /// Drawables.
    pub nodes: u64,
    /// Pixels they own.
    pub pixels: u64,
}

/// An object, named as in its source file.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct VisibleObject {
    /// Its name; may be empty.
    pub name: String,
    /// The file it came from.
    pub source: String,
    /// Its index in that file: the node of a glTF file, else the object's place in reading order.
    pub source_index: u32,
}

/// The PNG files of a frame, relative to `report.json`.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct FramePictures {
    /// The picture that RVG showed.
    pub shown: Option<String>,
    /// The same LOD cut without culling.
    pub unculled: Option<String>,
    /// Full detail without culling.
    pub full: Option<String>,
}
