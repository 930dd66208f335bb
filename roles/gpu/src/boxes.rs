//! Boxes as the occlusion tests draw them: only their visible faces.

use glam::{DVec3, Vec3};
use trimaran_cull::{TestBox, View};

/// `Box` of boxes.wgsl.
#[derive(Debug, Clone, Copy, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(crate) struct BoxRecord {
    pub(crate) centre: [f32; 3],
    /// Bit i: the face at the end of axis i faces the eye.
    pub(crate) faces: u32,
    pub(crate) axes: [[f32; 3]; 3],
}

/// Vertices per box: three faces of two triangles.
pub(crate) const VERTICES: u32 = 18;

impl BoxRecord {
    /// A box, its axes turned so that visible faces lie on positive ends. `None` if no test can decide: a
    /// coordinate is not finite, a corner is not beyond the near plane, or no face is visible, as from
    /// inside. Such a box counts as visible.
    ///
    /// At most one of two opposite faces is visible: the eye's coordinate along the axis, in half-edges, is
    /// beyond 1 or below -1, or else neither is. Drawing only these faces covers each pixel of the box once,
    /// with its front, for any handedness of the axes. The count needs no culling by winding, which rounding
    /// could flip for a thin box.
    pub(crate) fn new(shape: &TestBox, near: f64) -> Option<Self> {
        let centre = shape.centre.as_dvec3();
        let axes = shape.axes.map(Vec3::as_dvec3);
        let nearest = -centre.z - axes.iter().map(|axis| axis.z.abs()).sum::<f64>();
        // Also false for NaN and infinity.
        if !(nearest > near && centre.is_finite() && axes.iter().all(|axis| axis.is_finite())) {
            return None;
        }
        let mut record = Self { centre: shape.centre.to_array(), faces: 0, axes: [[0.0; 3]; 3] };
        for (i, slot) in record.axes.iter_mut().enumerate() {
            let axis = axes[i];
            let normal = axes[(i + 1) % 3].cross(axes[(i + 2) % 3]);
            let eye = eye_along(axis, normal, centre);
            // A flat box has NaN or infinity here, and its face is drawn.
            let shows = eye.abs() > 1.0 || eye.is_nan();
            record.faces |= u32::from(shows) << i;
            let towards_eye = if eye < 0.0 { -shape.axes[i] } else { shape.axes[i] };
            *slot = towards_eye.to_array();
        }
        (record.faces != 0).then_some(record)
    }
}

/// The eye's coordinate along `axis`, in half-edges from the centre; the eye is the origin. `normal` is
/// perpendicular to the other two axes.
fn eye_along(axis: DVec3, normal: DVec3, centre: DVec3) -> f64 {
    -normal.dot(centre) / normal.dot(axis)
}

/// Prepares a batch: a record for each box that needs testing, with its index. All others are set visible in
/// `visible`, which is filled with one entry per box.
pub(crate) fn prepare(
    view: &View,
    boxes: &[TestBox],
    visible: &mut Vec<u32>,
    records: &mut Vec<BoxRecord>,
    owners: &mut Vec<u32>,
) {
    let near = f64::from(view.camera().near());
    visible.clear();
    visible.resize(boxes.len(), 0);
    records.clear();
    owners.clear();
    for ((index, shape), visible) in (0..).zip(boxes).zip(visible) {
        match BoxRecord::new(shape, near) {
            Some(record) => {
                records.push(record);
                owners.push(index);
            }
            None => *visible = 1,
        }
    }
}

/// The most boxes tested at once: some megabytes of records, and fewer workgroups than any device's limit per
/// dispatch.
pub(crate) const BATCH: usize = 32_768;

/// The capacity to allocate for a batch of `count` boxes: enough that the next ones seldom need more.
pub(crate) fn room_for(count: usize) -> usize {
    count.next_power_of_two().max(1024)
}

/// Records and their owners in parts that fit a dispatch.
pub(crate) fn batches<'a, R>(
    records: &'a [R],
    owners: &'a [u32],
) -> impl Iterator<Item = (&'a [R], &'a [u32])> {
    records.chunks(BATCH).zip(owners.chunks(BATCH))
}

/// Assigns each count to the box that owns it.
pub(crate) fn hand_out(counts: &[u32], owners: &[u32], visible: &mut [u32]) {
    for (&count, &owner) in counts.iter().zip(owners) {
        if let Some(visible) = visible.get_mut(owner as usize) {
            *visible = count;
        }
    }
}
