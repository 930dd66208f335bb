//! A made-up comparison with every key filled, for tests.

use super::{
    paths::Coherence,
    schema::{
        AloneFigures, COMPARISON_VERSION, CoherencePoint, Comparison, ComparisonTable, CurvePoint,
        DrawnFigures, ExactFrame, FrameCost, LagPoint, MeasuredFigures, Popping, SystemFigures, SystemFrame,
    },
    system::System,
};
use crate::report::sample::{SIZE, run};

/// A made-up comparison of four systems at 10 pixels, on two paths.
pub(super) fn comparison() -> Comparison {
    let epsilon_px = 10.0;
    let systems = [System::GigaWalk, System::DistributedGigaWalk, System::Independent2, System::Exact];
    let cost = |at: usize| FrameCost {
        modelled_ms: Some(20.0 - at as f64),
        or_ms: Some(9.0),
        hc_ms: Some(0.5),
        rvg_ms: Some(12.0),
        nodes: Some(900.0),
        triangles: Some(40_000.0 - 1000.0 * at as f64),
    };
    let frames = (0..6).map(|frame| SystemFrame {
        frame,
        modelled_ms: Some(15.0 + f64::from(frame)),
        objects: 700,
        triangles: 30_000,
    });
    let frames: Vec<_> = frames.collect();
    let figures = |(at, &system): (usize, &System)| SystemFigures {
        system,
        alone: AloneFigures {
            or_ms: vec![9.0, 9.0],
            hc_ms: vec![0.5, 0.5],
            rvg_ms: vec![12.0, 12.0],
            model_fps: vec![50.0 + at as f64, 25.0],
            model_fps_at_least: vec![48.0, 24.0],
            model_latency_ms: vec![30.0, 60.0],
        },
        measured: MeasuredFigures {
            processes: system.processes(),
            fps: vec![20.0, 10.0],
            latency_ms: vec![90.0, 180.0],
        },
        drawn: vec![
            DrawnFigures {
                nodes: 900.0,
                objects: 700.0,
                triangles: 30_000.0,
                bytes: 512.0,
                objects_over_exact: Some(1.2),
                triangles_over_exact: Some(4.5),
                objects_over_exact_median: Some(1.1),
                triangles_over_exact_median: Some(4.0),
                audited_frames: 2,
                wrong_pixels: 0,
                right_pixels: 0,
                lost_nodes: 0,
            };
            2
        ],
        frames: frames.clone(),
    };
    let exact = |frame| ExactFrame { path: 0, frame, nodes: 500, objects: 600, triangles: Some(7000) };
    let all = || systems.iter().enumerate();
    Comparison {
        schema_version: COMPARISON_VERSION,
        version: "0.1.0".to_owned(),
        command_line: ["trimaran", "compare", "<b>platform.scene"].map(str::to_owned).to_vec(),
        started: "2026-03-01T12:34:56Z".to_owned(),
        scene: run().scene,
        device: "llvmpipe".to_owned(),
        driver: "Mesa 22.3.6".to_owned(),
        cores: 2,
        width: SIZE,
        height: SIZE,
        path: "auto".to_owned(),
        seed: Some(7),
        paths: 2,
        frames: 6,
        link: "tcp".to_owned(),
        tables: vec![ComparisonTable {
            epsilon_px,
            exact: [0, 3].map(exact).to_vec(),
            systems: all().map(figures).collect(),
        }],
        curve: all()
            .map(|(at, &system)| CurvePoint {
                system,
                epsilon_px,
                path: 0,
                cost: cost(at),
                flip_mean: Some(0.02),
                silhouette_max_px: Some(4.0),
                surface_max_px: Some(9.0),
                wrong_pixels: 0,
            })
            .collect(),
        popping: vec![Popping {
            epsilon_px,
            path: 0,
            frames: 5,
            changed: 0.01,
            changed_p95: 0.04,
            flip_mean: 0.001,
            frames_over_1_px: 0.5,
        }],
        coherence: all()
            .flat_map(|(at, &system)| {
                Coherence::ALL.map(|coherence| CoherencePoint {
                    system,
                    coherence,
                    epsilon_px,
                    step_m: 0.5,
                    turn_deg: 6.0,
                    cost: cost(at),
                    nodes_over_exact: Some(1.3),
                })
            })
            .collect(),
        lag: all()
            .map(|(at, &system)| LagPoint {
                system,
                poses_per_second: 30.0,
                epsilon_px,
                fps: Some(18.0),
                lag_ms: Some(80.0 + at as f64),
                lag_poses: Some(2.0),
                triangles: Some(30_000.0),
                flip_mean: Some(0.05),
            })
            .collect(),
        notes: vec!["ended early: <i>interrupted".to_owned()],
    }
}
