//! A made-up run with every key filled, for tests.

use std::{collections::BTreeSet, sync::LazyLock};

use serde_json::Value;
use trimaran_actors::CullerId;
use trimaran_audit::metrics::{Deviation, ImageRef, image_difference};
use trimaran_cull::Image;

use super::schema::{
    CullingCounts, Ended, FalseCull, FalseCullCause, Frame, HowEnded, Machine, MemoryUse, Mode, Projection,
    Report, Role, RoleInfo, RoundCounts, Run, SceneInfo, SentAhead, SentBytes, Span, SweepPoint,
    ViewStateInfo, VisibleObject,
};
use crate::culling::CullingMethod;

pub(crate) const SIZE: u32 = 96;
const FRAMES: u32 = 60;
pub(crate) const AUDIT_EVERY: u32 = 3;

pub(crate) fn run() -> Run {
    let role = |machine| RoleInfo {
        machine,
        device: "llvmpipe (LLVM 15.0.6, 256 bits)".to_owned(),
        driver: "llvmpipe, Mesa 22.3.6".to_owned(),
    };
    Run {
        version: "0.1.0".to_owned(),
        command_line: ["trimaran", "run", "platform.scene", "--epsilon", "2"].map(str::to_owned).to_vec(),
        started: "2026-03-01T12:34:56Z".to_owned(),
        roles: machines().map(role).to_vec(),
        scene: SceneInfo {
            file: "scenes/<b>platform.scene".to_owned(),
            hash: "0123456789abcdef0123456789abcdef".to_owned(),
            file_bytes: Some(48_111_616),
            objects: 9_720,
            nodes: 12_955,
            drawables: 51_204,
            triangles: 923_118,
            sources: vec!["area.RVM".to_owned(), "</script><script>alert(1)</script>.RVM".to_owned()],
        },
        epsilon_px: 2.0,
        culling: CullingMethod::Trimaran,
        occlusion_test: "raster".to_owned(),
        batch: 1024,
        coding: Some("plain".to_owned()),
        link: "inproc".to_owned(),
        transport: "in one process".to_owned(),
        cullers: 2,
        schedule: "independent".to_owned(),
        mode: Mode::Lockstep,
        alone: true,
        path: "auto".to_owned(),
        seed: Some(7),
        audit_every: Some(AUDIT_EVERY),
        memory: Some(MemoryUse {
            scene_bytes: 8_123_456,
            device_taken_bytes: 67_108_860,
            device_bytes: 3_456_780,
            pieces_brought: 2_345,
            bytes_brought: 4_567_890,
            pieces_dropped: 17,
        }),
        ahead: Some(SentAhead { pieces: 400, bytes: 480_000, used_pieces: 190, used_bytes: 252_000 }),
        view_states: vec![ViewStateInfo {
            version: 1,
            from_frame: 30,
            width: 640,
            height: 480,
            epsilon_px: 4.0,
            occlusion_test: "hzb".to_owned(),
            sections: 1,
            hidden: 12,
            isolated: Some(40),
            see_through: Some(3),
        }],
        notes: vec!["A made-up run.".to_owned()],
    }
}

/// Two cullers and a display.
fn machines() -> [Machine; 3] {
    [0, 1, 2].map(|place| Machine::of(CullerId::of(place).filter(|id| id.index() < 2)))
}

/// A number between 0 and 1 that depends on `frame` and `salt` only.
fn noise(frame: u32, salt: u32) -> f64 {
    let mixed = (frame.wrapping_mul(0x9e37_79b9) ^ salt.wrapping_mul(0x85eb_ca6b)).wrapping_mul(0xc2b2_ae35);
    f64::from(mixed >> 8) / f64::from(1 << 24)
}

/// A frame; every third is audited, and one of those has false culls. Frame 39 is shown before all of it has
/// come, then as 40, and as 41 it is exact at last.
fn frame(number: u32) -> Frame {
    let frame = exact_frame(number);
    let lacking = match number {
        39 => 7,
        40 => 3,
        _ => 0,
    };
    if lacking == 0 && number != 41 {
        return frame;
    }
    Frame {
        lacking,
        again: number > 39,
        loading_pixels: (number == 39).then_some(512),
        cut_mismatch_pixels: None,
        false_culled_nodes: None,
        false_culled_pixels: None,
        false_culled_blob_px: None,
        nodes_exact: None,
        objects_exact: None,
        triangles_exact: None,
        full_detail: None,
        ..if number == 39 { frame } else { shown_again(frame) }
    }
}

/// Some records of a frame occur only the first time it is shown.
fn shown_again(frame: Frame) -> Frame {
    Frame {
        or_ms: None,
        hc_ms: None,
        occluders_device_ms: None,
        pyramid_device_ms: None,
        culling_device_ms: None,
        latency_frames: None,
        latency_ms: None,
        occluders_drawn: None,
        occluder_triangles: None,
        culling: None,
        rounds: None,
        conservatively_visible: Default::default(),
        bytes: None,
        bytes_by_kind: None,
        ..frame
    }
}

fn exact_frame(frame: u32) -> Frame {
    let turn = std::f64::consts::TAU * f64::from(frame) / f64::from(FRAMES);
    let load = 1.0 + 0.5 * (2.0 * turn).sin() + 0.15 * noise(frame, 1);
    let (or, hc, rvg) = (9.0 * load, 14.0 * load + noise(frame, 2), 11.0 * load);
    // The roles take turns, 65 ms a frame; the machine that drew a frame's occluders culls it.
    let start = 65.0 * f64::from(frame);
    let [first, second, _] = machines();
    let machine = if frame.is_multiple_of(2) { first } else { second };
    let span =
        |role, machine, start_ms: f64, ms: f64| Span { role, machine, start_ms, end_ms: start_ms + ms };

    let exact = (420.0 * load) as u64;
    let drawn = if frame == 0 { 5_210 } else { (exact as f64 * (1.22 + 0.1 * noise(frame, 3))) as u64 };
    let audited = frame.is_multiple_of(AUDIT_EVERY);
    let wrong = frame == 27;
    let bytes_by_kind = SentBytes {
        camera: 3 * 72,
        ids: 8 * drawn,
        end: 48,
        begin: 16,
        control: if frame.is_multiple_of(10) { 120 } else { 0 },
        geometry: 0,
        headers: 8 * (7 + 2 * drawn.div_ceil(1024)),
        messages: 7 + 2 * drawn.div_ceil(1024),
    };
    Frame {
        frame,
        eye: [10.0 + turn.cos() / 3.0, 1.7, -4.0 + turn.sin() / 3.0],
        forward: [turn.cos(), 0.0, turn.sin()],
        up: [0.0, 1.0, 0.0],
        view_state: u32::from(frame >= 30),
        or_ms: Some(or),
        hc_ms: Some(hc),
        rvg_ms: Some(rvg),
        occluders_device_ms: Some(0.75 * or),
        pyramid_device_ms: Some(0.05 * hc),
        culling_device_ms: Some(0.5 * hc),
        picture_device_ms: Some(0.875 * rvg),
        frame_ms: (frame > 0).then_some(or + hc + rvg + 3.0 * noise(frame, 4)),
        latency_frames: Some(1),
        latency_ms: Some(or + hc + rvg),
        lacking: 0,
        again: false,
        culled_by: Some(machine),
        timeline: vec![
            span(Role::Or, machine, start, or),
            span(Role::Hc, machine, start + or, hc),
            span(Role::Rvg, Machine::Display, start + or + hc, rvg),
        ],
        nodes_drawn: Some(drawn),
        nodes_exact: audited.then_some(exact),
        objects_drawn: Some(drawn * 2),
        objects_exact: audited.then_some(exact * 2),
        triangles_drawn: Some(drawn * 61),
        triangles_exact: audited.then_some(exact * 13),
        objects_exact_full: audited.then_some(exact + 200),
        triangles_exact_full: audited.then_some(exact * 19),
        occluders_drawn: Some(drawn - 40),
        occluder_triangles: Some((drawn - 40) * 55),
        culling: Some(CullingCounts {
            nodes_visited: 5 * drawn,
            nodes_outside: drawn,
            boxes_tested: 3 * drawn,
            boxes_hidden: 2 * drawn,
            batches: 9,
            stopped_at_few_pixels: 0,
        }),
        rounds: Some(RoundCounts {
            further: u32::from(frame == 0),
            occluder_triangles: if frame == 0 { 30_000 } else { 0 },
            drawing_ms: if frame == 0 { 4.5 } else { 0.0 },
            boxes_tested: if frame == 0 { 2 * drawn } else { 0 },
            nodes_hidden: if frame == 0 { drawn } else { 0 },
        }),
        conservatively_visible: [("near_plane".to_owned(), 4), ("eye_inside".to_owned(), 2)].into(),
        false_culled_nodes: audited.then_some(if wrong { 3 } else { 0 }),
        false_culled_pixels: audited.then_some(if wrong { 41 } else { 0 }),
        false_culled_blob_px: audited.then_some(if wrong { 30 } else { 0 }),
        false_culls: if wrong {
            vec![
                FalseCull { cause: FalseCullCause::MissedSamples, nodes: 2, pixels: 11 },
                FalseCull { cause: FalseCullCause::Unattributed, nodes: 1, pixels: 30 },
            ]
        } else {
            Vec::new()
        },
        cut_mismatch_pixels: audited.then_some(if wrong { 41 } else { 0 }),
        loading_pixels: None,
        full_detail: audited.then(|| {
            let (shown, full) = (picture(frame, 1), picture(frame, 0));
            let silhouette = Deviation { max_px: 1.0 + 0.9 * noise(frame, 5), p95_px: 0.6 };
            let surfaces = Deviation { max_px: silhouette.max_px + 0.05, p95_px: 0.4 };
            image_difference(
                &ImageRef::of(&full).unwrap(),
                &ImageRef::of(&shown).unwrap(),
                silhouette,
                surfaces,
            )
            .unwrap()
        }),
        bytes: Some(bytes_by_kind.total()),
        bytes_by_kind: Some(bytes_by_kind),
        visible: audited.then(|| {
            vec![VisibleObject { name: "/PIPE-1".to_owned(), source: "area.RVM".to_owned(), source_index: 3 }]
        }),
        pictures: Default::default(),
    }
}

/// A shade beside a pale ground; `shift` moves the edge between them, as a coarser level would.
pub(crate) fn picture(frame: u32, shift: u32) -> Image {
    let pixel = |x: u32, y: u32| {
        let shaded = (x + frame + shift) % SIZE < SIZE / 2;
        if shaded { [(2 * x) as u8, (2 * y) as u8, 90, 255] } else { [226, 232, 238, 255] }
    };
    let rgba = (0..SIZE).flat_map(|y| (0..SIZE).flat_map(move |x| pixel(x, y))).collect();
    Image { width: SIZE, height: SIZE, rgba }
}

/// The whole made-up run. Its errors are measured once: that takes a second.
pub(crate) fn report() -> Report {
    static REPORT: LazyLock<Report> = LazyLock::new(make_report);
    REPORT.clone()
}

fn make_report() -> Report {
    let frames: Vec<Frame> = (0..FRAMES).map(frame).collect();
    let projection = Projection { width: SIZE, height: SIZE, vfov_deg: 60.0, near: 0.05 };
    let ended = Ended {
        how: HowEnded::Interrupted,
        why: Some("it was asked to stop <twice>".to_owned()),
        frames_due: Some(2 * FRAMES),
    };
    let wall_ms = frames.iter().filter_map(|f| f.frame_ms).sum();
    let report = Report::new(run(), projection, frames, Some(wall_ms), ended);
    let sweep = [0.5, 1.0, 2.0, 5.0, 10.0, 20.0].map(|epsilon: f64| {
        let point = SweepPoint::of(&report);
        let gain = epsilon.sqrt();
        SweepPoint {
            epsilon_px: epsilon,
            measured_fps: point.measured_fps.map(|v| v * gain / 1.4),
            modelled_fps: point.modelled_fps.map(|v| v * gain / 1.4),
            flip_mean: Some(0.004 * epsilon),
            silhouette_max_px: Some(0.7 * epsilon),
            ..point
        }
    });
    report.with_sweep(sweep.to_vec())
}

/// A report of a run in which nothing could be measured.
pub(crate) fn bare() -> Report {
    let projection = Projection { width: 1, height: 1, vfov_deg: 60.0, near: 0.05 };
    let run = Run { alone: false, ..run() };
    Report::new(run, projection, vec![Frame::default()], None, Ended::finished(Some(1)))
}

/// All keys of objects, and the names of enum values; the keys of maps whose keys are data are left out.
pub(crate) fn keys(value: &Value, found: &mut BTreeSet<String>) {
    match value {
        Value::Object(map) => {
            for (key, value) in map {
                found.insert(key.clone());
                if key != "conservatively_visible" {
                    keys(value, found);
                }
            }
        }
        Value::Array(values) => values.iter().for_each(|v| keys(v, found)),
        _ => {}
    }
}
