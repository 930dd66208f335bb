//! A scene and a walk through it, as plain data.

use std::sync::Arc;

use glam::{DQuat, DVec3, Mat3, Vec3};
use serde::{Deserialize, Serialize};
use thiserror::Error;
use trimaran_cull::{LodRule, View, Viewport};
use trimaran_proto::{
    Camera, CameraError, ObjectSet, OcclusionTestKind, Section, SectionError, Sections, ViewState,
};
use trimaran_scene::{Scene, SceneError};

use crate::WalkthroughError;
use crate::cases::{Mesh, Object, build, looking_past};

/// A scene, and the frames of a walk through it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Trial {
    /// Whether each interior node has a level: its box.
    #[serde(default, skip_serializing_if = "is_default")]
    pub merged: bool,
    /// The objects, by number.
    pub solids: Vec<Solid>,
    /// The frames, in order.
    pub frames: Vec<TrialFrame>,
}

/// An object.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Solid {
    /// The finest level.
    pub shape: Shape,
    /// Coarser levels, finer first, each with its error in the local frame, metres.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub coarser: Vec<(f32, Shape)>,
    /// Where the local frame's origin is, metres.
    pub origin: [f64; 3],
    /// The local frame's axes in the world, one after the other.
    #[serde(default = "upright", skip_serializing_if = "is_upright")]
    pub linear: [f32; 9],
    /// The most triangles of a piece of a level, if it has pieces.
    #[serde(default, skip_serializing_if = "is_default")]
    pub most: Option<u16>,
}

/// Triangles in a local frame, metres.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Shape {
    /// A box about the origin.
    Box {
        /// Half its edges.
        half: [f32; 3],
        /// Squares along each edge.
        cuts: u8,
    },
    /// A parallelogram about the origin.
    Rectangle {
        /// Half of one edge.
        a: [f32; 3],
        /// Half of the other one.
        b: [f32; 3],
        /// Squares along each edge.
        cuts: u8,
    },
    /// A closed cylinder about the origin, along x.
    Cylinder {
        /// Of its ends.
        radius: f32,
        /// Half its length.
        half_length: f32,
        /// Around it.
        sides: u8,
    },
    /// Any triangles.
    Triangles(Vec<[[f32; 3]; 3]>),
}

/// A camera and its view state.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrialFrame {
    /// The eye, metres, world.
    pub eye: [f64; 3],
    /// A point that the eye looks at.
    pub target: [f64; 3],
    /// How far the camera rolls, degrees.
    #[serde(default, skip_serializing_if = "is_default")]
    pub roll: f64,
    /// The vertical field of view, degrees.
    pub fov: f64,
    /// The near distance, metres.
    pub near: f32,
    /// The picture's size.
    pub size: Viewport,
    /// The bound on errors, pixels.
    pub epsilon: f64,
    /// The sections.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub sections: Vec<Section>,
    /// Objects that are not drawn.
    #[serde(default, skip_serializing_if = "ObjectSet::is_empty")]
    pub hidden: ObjectSet,
    /// If set, only these objects are drawn.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub isolated: Option<ObjectSet>,
    /// Objects drawn see-through.
    #[serde(default, skip_serializing_if = "ObjectSet::is_empty")]
    pub see_through: ObjectSet,
}

/// Why a trial cannot be walked.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum TrialError {
    /// The scene is malformed.
    #[error("the trial's scene is malformed")]
    Scene(#[from] SceneError),
    /// A camera is out of range.
    #[error("a camera of the trial is out of range")]
    Camera(#[from] CameraError),
    /// There are too many sections.
    #[error("the sections of a frame are invalid")]
    Sections(#[from] SectionError),
    /// The error bound is invalid.
    #[error("the error bound of a frame is invalid")]
    Bound(#[from] trimaran_cull::LodRuleError),
    /// The reference stopped.
    #[error("the reference walkthrough stopped")]
    Walkthrough(#[from] WalkthroughError),
}

impl Trial {
    /// Its scene.
    ///
    /// # Errors
    /// If it is malformed: without objects, say.
    pub fn scene(&self) -> Result<Arc<Scene>, TrialError> {
        let objects: Vec<Object> = self.solids.iter().map(Solid::object).collect();
        Ok(Arc::new(build(&objects, self.merged)?))
    }
}

impl TrialFrame {
    /// Its view state, with this occlusion test.
    ///
    /// # Errors
    /// If it is invalid.
    pub fn view_state(&self, occlusion_test: OcclusionTestKind) -> Result<ViewState, TrialError> {
        Ok(ViewState {
            viewport: self.size,
            lod: LodRule::new(self.epsilon)?,
            occlusion_test,
            sections: Sections::new(&self.sections)?,
            hidden: self.hidden.clone(),
            isolated: self.isolated.clone(),
            see_through: (!self.see_through.is_empty()).then(|| self.see_through.clone()),
        })
    }

    /// Its camera, as that of the frame with this number.
    ///
    /// # Errors
    /// If it is out of range: eye and target the same, say.
    pub fn camera(&self, number: u32) -> Result<Camera, CameraError> {
        let [eye, target] = [self.eye, self.target].map(DVec3::from_array);
        let level = *looking_past(self.near, eye, target, self.fov, self.size, number)?.camera();
        let roll = DQuat::from_rotation_z(self.roll.to_radians());
        let orientation = (DQuat::from_array(level.orientation()) * roll).normalize();
        Camera::new(self.eye, orientation.to_array(), level.tan_half_fov_y(), self.near, level.frame())
    }

    /// Its camera with its sections.
    ///
    /// # Errors
    /// If either is invalid.
    pub fn view(&self, number: u32) -> Result<View, TrialError> {
        Ok(View::new(self.camera(number)?, self.size).with_sections(Sections::new(&self.sections)?))
    }
}

impl Solid {
    fn object(&self) -> Object {
        Object {
            mesh: self.shape.mesh(),
            coarser: self.coarser.iter().map(|(error, shape)| (*error, shape.mesh())).collect(),
            origin: DVec3::from_array(self.origin),
            linear: Mat3::from_cols_array(&self.linear),
            most: self.most.map_or(usize::MAX, usize::from),
        }
    }
}

impl Shape {
    fn mesh(&self) -> Mesh {
        match self {
            Self::Box { half, cuts } => {
                let half = Vec3::from_array(*half);
                Mesh::cuboid(-half, half, u32::from(*cuts).max(1))
            }
            Self::Rectangle { a, b, cuts } => {
                let [a, b] = [a, b].map(|edge| Vec3::from_array(*edge));
                Mesh::rectangle(Vec3::ZERO, a, b, u32::from(*cuts).max(1))
            }
            Self::Cylinder { radius, half_length, sides } => {
                Mesh::cylinder(*radius, *half_length, u16::from(*sides).max(3))
            }
            Self::Triangles(triangles) => Mesh {
                positions: triangles.iter().flatten().copied().map(Vec3::from_array).collect(),
                indices: (0..triangles.len() as u32 * 3).collect(),
            },
        }
    }
}

pub(super) const fn upright() -> [f32; 9] {
    Mat3::IDENTITY.to_cols_array()
}

fn is_upright(linear: &[f32; 9]) -> bool {
    *linear == upright()
}

fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}
