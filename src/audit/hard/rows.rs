//! The hard cases by number, and what shows each.

use super::measures::Measure;

/// A numerical difficulty of culling.
pub(super) struct Difficulty {
    pub(super) number: u8,
    pub(super) name: &'static str,
    /// The cases that have it.
    pub(super) cases: &'static [&'static str],
    /// Its figures besides walks.
    pub(super) measures: &'static [Measure],
    /// The tests that show it as well, or alone.
    pub(super) tests: &'static [&'static str],
}

const fn difficulty(number: u8, name: &'static str, cases: &'static [&'static str]) -> Difficulty {
    Difficulty { number, name, cases, measures: &[], tests: &[] }
}

impl Difficulty {
    const fn measured(self, measures: &'static [Measure]) -> Self {
        Self { measures, ..self }
    }

    const fn tested(self, tests: &'static [&'static str]) -> Self {
        Self { tests, ..self }
    }
}

/// All of them.
pub(super) const DIFFICULTIES: [Difficulty; 23] = [
    difficulty(
        1,
        "a box across the near plane; the eye in or on a box",
        &["box across the near plane", "eye inside a box", "eye on a box"],
    ),
    difficulty(2, "boxes smaller than a pixel", &["sub-pixel boxes and slivers past a one-pixel gap"]),
    difficulty(3, "boxes without volume", &["flat, line and point boxes"]),
    difficulty(
        4,
        "a box level with its own surface, or with the wall that holds it",
        &[
            "wall against its own surface, 200 still frames",
            "plates flush with a wall, 60 still frames",
            "plates flush with a wall at 1e6, 60 still frames",
        ],
    ),
    difficulty(
        5,
        "depth bias that is too small near the eye, or too large far away",
        &["plates before and behind walls at 2 m to 20 km"],
    )
    .measured(&[Measure::CulledGap]),
    difficulty(6, "reversed depth in f32 without a far plane", &["depth from 0.1 m to 1e7 m"])
        .measured(&[Measure::ResolvedGap]),
    difficulty(
        7,
        "formats of depth, with the near plane at a millimetre",
        &["near plane at 1 mm, pairs up to 100 km away"],
    )
    .measured(&[Measure::WrongOrder]),
    difficulty(8, "far from the origin", &["origin at 0", "origin at 1e6", "origin at 1e7", "origin at 1e8"])
        .measured(&[Measure::UnlikeAtOrigin]),
    difficulty(
        9,
        "a wall 0.1 mm thick, and objects that touch it",
        &[
            "thin wall with a crate touching it from behind",
            "plates before and behind a thin wall, from 0 to 1 cm",
        ],
    ),
    difficulty(
        10,
        "gaps of a pixel, and edges outside of the picture",
        &["a keyhole of one pixel", "a grating finer than a pixel", "a wall's edge outside of the picture"],
    ),
    difficulty(11, "pictures of odd sizes", &["1 x 1", "1 x 97", "97 x 1", "333 x 777", "1023 x 33"]),
    difficulty(12, "extreme and invalid cameras", &["fov 0.01", "fov 1", "fov 179"])
        .measured(&[Measure::InvalidCameras])
        .tested(&["roles/gpu/tests/gpu/walks.rs"]),
    difficulty(13, "NaN and infinity in vertices, boxes, cameras and errors", &[])
        .measured(&[Measure::NotFinite])
        .tested(&[
            "roles/cull/tests/all/boxes.rs a_box_that_is_not_finite_is_visible",
            "roles/cull/tests/all/lod_cut.rs a_box_that_is_not_finite_is_refined",
            "roles/cook/tests/all/import_hostile.rs",
        ]),
    difficulty(
        14,
        "the eye in a bounding volume; a node without volume",
        &["eye inside a box", "flat, line and point boxes"],
    )
    .tested(&["roles/cull/tests/all/lod_cut.rs the_error_is_infinite_at_the_near_plane_and_around_the_eye"]),
    difficulty(
        15,
        "scales of 1e-3 to 1e3, mirrored and sheared",
        &["scaled by 1e-3 to 1e3, mirrored, sheared"],
    )
    .measured(&[Measure::Deviation("scaled by 1e-3 to 1e3, mirrored, sheared")]),
    difficulty(16, "wide fields of view", &["fov 120", "fov 179"])
        .measured(&[Measure::Deviation("fov 120"), Measure::Deviation("fov 179")]),
    difficulty(
        17,
        "a level of detail that occludes more than its mesh",
        &["a level that occludes more than its mesh"],
    ),
    difficulty(18, "cracks between levels of detail", &["patches of a dome, each at a level of its own"])
        .measured(&[Measure::Background("patches of a dome, each at a level of its own")])
        .tested(&["roles/cook/tests/all/cook_giant.rs"]),
    difficulty(
        19,
        "teleports, quarter turns and shakes",
        &["teleport every frame", "a turn by 90 degrees every frame", "a shake by one pixel"],
    ),
    difficulty(20, "the delay of a picture", &["a steady turn by 8 pixels a frame"])
        .measured(&[Measure::Latency("a steady turn by 8 pixels a frame")]),
    difficulty(
        21,
        "a frame's end that is lost, late or doubled; a peer that dies; an empty frame",
        &["nothing visible, and back"],
    )
    .tested(&[
        "roles/actors/tests/all/faults.rs",
        "transport/tests/all",
        "roles/actors/tests/all/dealer.rs",
    ]),
    difficulty(22, "roles that choose different levels of detail", &[])
        .measured(&[Measure::OutsideCut])
        .tested(&["roles/gpu/tests/gpu/traversal.rs hard_cases_are_culled_as_on_the_host"]),
    difficulty(23, "an error that equals the bound; errors that grow towards the leaves", &[])
        .measured(&[Measure::EqualBounds])
        .tested(&["roles/cull/tests/all/properties.rs"]),
];
