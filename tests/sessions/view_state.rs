//! View states that change during a walk, on real devices: culling changes no pixel under any of them.

use std::sync::Arc;

use glam::{DVec3, Vec3};
use trimaran::{
    report::Frame,
    walkthrough::{
        AuditPictures, Auditor, CameraPath, FrameRecord, PathChoice, Plan, SceneOnDevices, ViewChange,
        ViewStates,
    },
};
use trimaran_actors::Schedule;
use trimaran_audit::cases::{Mesh, Object, build};
use trimaran_cull::{LodRule, Viewport};
use trimaran_gpu::BACKGROUND;
use trimaran_proto::{ObjectSet, OcclusionTestKind, Section, SectionBox, SectionPlane, Sections, ViewState};
use trimaran_scene::{
    Scene,
    path::{Pose, PosePath},
    random::Random,
};

use crate::common::program::{Bench, said};
use crate::common::{
    data::small_plant,
    session::{self, assert_no_validation_messages, culler, walk_in_process},
};

const FRAMES: u32 = 16;

#[test]
fn glass_of_a_file_starts_see_through_and_hides_nothing() {
    let bench = Bench::with_glass(3);
    let walk = ["run", "glass.scene", "--path", "path.json", "--size", "64x64", "--audit-every", "1"];
    let output = bench.trimaran(&[&walk[..], &["--out", "walk"]].concat());
    let ran = output.status.success().then_some(()).ok_or_else(|| said(&output));
    let Some(()) = crate::common::unless_required(ran) else { return };
    let report = bench.report("walk");
    assert_eq!(report["summary"]["cut_mismatch_pixels_total"], 0);
    let [red, _, blue] = middle(&bench.path("walk/frames/00002.png"));
    assert!(red > 80 && blue > 20, "red shines through the blue: {red}, {blue}");
    // A user's states override the model's.
    bench.write("solid.toml", "[[change]]\nframe = 0\nsee_through = []\n");
    bench.done(&[&walk[..], &["--out", "solid", "--state", "solid.toml"]].concat());
    let [red, _, blue] = middle(&bench.path("solid/frames/00002.png"));
    assert!(red < 30 && blue > 80, "the glass is solid: {red}, {blue}");
}

/// The colour in the middle of a picture.
fn middle(picture: &std::path::Path) -> [u8; 3] {
    let file = std::io::BufReader::new(std::fs::File::open(picture).unwrap());
    let mut reader = png::Decoder::new(file).read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut bytes).unwrap();
    let at =
        (info.height as usize / 2) * info.line_size + (info.width as usize / 2) * info.color_type.samples();
    [bytes[at], bytes[at + 1], bytes[at + 2]]
}

fn some_objects(random: &mut Random, scene: &Scene, share: f64) -> ObjectSet {
    let all = 0..u32::try_from(scene.objects().len()).unwrap();
    all.filter(|_| random.chance(share)).collect()
}

/// Cuts through the middle of the scene.
fn some_sections(random: &mut Random, scene: &Scene) -> Sections {
    let (min, max) = scene.nodes().first().unwrap().world_box();
    let section = |random: &mut Random| {
        let (middle, half) = (0.5 * (min + max), 0.5 * (max - min));
        let place = random.point(middle - 0.5 * half, middle + 0.5 * half).to_array();
        if random.chance(0.5) {
            let towards = random.direction().to_array();
            return Section::Plane(SectionPlane::new(place, towards).unwrap());
        }
        let half = half * random.between(0.4, 1.0);
        let (low, high) = (DVec3::from_array(place) - half, DVec3::from_array(place) + half);
        Section::Box(SectionBox::new(low.to_array(), high.to_array()).unwrap())
    };
    let sections: Vec<Section> = (0..random.below(3)).map(|_| section(random)).collect();
    Sections::new(&sections).unwrap()
}

/// Another view state with every frame.
fn random_states(scene: &Scene, plan: &Plan, seed: u64) -> ViewStates {
    let mut random = Random::new(seed);
    let mut state = || {
        let (hidden, see_through) = (random.between(0.0, 0.7), random.between(0.0, 0.3));
        let isolates = random.chance(0.2);
        ViewState {
            viewport: Viewport::new(80 + random.below(60) as u32, 60 + random.below(40) as u32).unwrap(),
            lod: LodRule::new(random.between(0.5, 10.0)).unwrap(),
            occlusion_test: random.pick(OcclusionTestKind::ALL),
            sections: some_sections(&mut random, scene),
            hidden: some_objects(&mut random, scene, hidden),
            isolated: isolates.then(|| some_objects(&mut random, scene, 0.7)),
            see_through: Some(some_objects(&mut random, scene, see_through)),
        }
    };
    let changes = (1..FRAMES).map(|pose| ViewChange { pose, state: Arc::new(state()) }).collect();
    ViewStates::new(plan.settings().into(), changes)
}

/// Audits each frame of a walk: returns the pictures as shown.
fn audited(
    devices: &SceneOnDevices,
    plan: &Plan,
    path: &CameraPath,
    walk: &[FrameRecord],
) -> Vec<AuditPictures> {
    let mut auditor = Auditor::new(&devices.scene, &devices.display, path.views().clone()).unwrap();
    let mut machine = culler(devices, plan);
    let audit = |place: usize| {
        let (mut frame, mut pictures) = (Frame::default(), AuditPictures::default());
        auditor.audit(Some(&mut machine), &walk[..=place], false, &mut frame, &mut pictures).unwrap();
        assert_eq!(frame.cut_mismatch_pixels, Some(0), "frame {place}");
        assert_eq!(frame.false_culled_pixels, Some(0), "frame {place}");
        pictures
    };
    (0..walk.len()).map(audit).collect()
}

#[test]
fn random_changes_with_every_frame_cost_no_pixel() {
    let scene = small_plant();
    let Some(all) = session::with_cullers(&scene, 3) else { return };
    let plan = session::plan([96, 80], 2.0, 64, OcclusionTestKind::Hzb);
    for seed in [1, 2, 3] {
        let states = random_states(&scene, &plan, seed);
        let path = CameraPath::find(&PathChoice::Auto { seed }, &scene, states, Some(FRAMES)).unwrap();
        let mut before: Option<Vec<_>> = None;
        for (cullers, schedule) in
            [(3, Schedule::Independent), (0, Schedule::Independent), (2, Schedule::Switch)]
        {
            let devices = SceneOnDevices {
                scene: Arc::clone(&all.scene),
                cullers: all.cullers.iter().take(cullers).map(Arc::clone).collect(),
                display: Arc::clone(&all.display),
            };
            let walk = walk_in_process(&devices, &Plan { schedule, ..plan }, &path);
            let pictures: Vec<_> = walk.iter().map(|record| record.picture.unwrap()).collect();
            match &before {
                None => _ = audited(&devices, &plan, &path, &walk),
                Some(before) => assert_eq!(*before, pictures, "{cullers} {schedule:?}"),
            }
            before = Some(pictures);
        }
    }
    assert_no_validation_messages(&all);
}

/// A wall, a crowd behind it, and a still camera before it.
fn wall_and_crowd(with_wall: bool) -> Arc<Scene> {
    let mut objects = Vec::new();
    for place in 0..100_i16 {
        let at = DVec3::new(f64::from(place % 10) - 4.5, f64::from(place / 10) - 4.5, -8.0);
        let mesh = Mesh::cuboid(Vec3::splat(-0.3), Vec3::splat(0.3), 2);
        objects.push(Object::new(mesh).at(at));
    }
    // Last, so that the others have the same numbers and colours without it.
    if with_wall {
        objects.push(Object::new(Mesh::cuboid(Vec3::new(-9.0, -9.0, -4.1), Vec3::new(9.0, 9.0, -4.0), 1)));
    }
    Arc::new(build(&objects, true).unwrap())
}

fn still() -> tempfile::NamedTempFile {
    let file = tempfile::NamedTempFile::new().unwrap();
    let pose = Pose::new(DVec3::ZERO, DVec3::NEG_Z, DVec3::Y).unwrap();
    let path = PosePath::new(60.0, vec![pose; 12]).unwrap().with_near(0.1).unwrap();
    std::fs::write(file.path(), path.to_json()).unwrap();
    file
}

#[test]
fn a_wall_that_is_hidden_seen_through_or_cut_away_no_longer_hides() {
    let (scene, bare) = (wall_and_crowd(true), wall_and_crowd(false));
    let (Some(devices), Some(without)) = (session::with_cullers(&scene, 1), session::with_cullers(&bare, 1))
    else {
        return;
    };
    let plan = session::plan([96, 96], 0.5, 64, OcclusionTestKind::Hzb);
    let first = ViewState::from(plan.settings());
    let wall: ObjectSet = [100].into_iter().collect();
    let plane = SectionPlane::new([0.0, 0.0, -6.0], [0.0, 0.0, 1.0]).unwrap();
    let states = [
        (3, ViewState { hidden: wall.clone(), ..first.clone() }),
        (5, first.clone()),
        (7, ViewState { see_through: Some(wall.clone()), ..first.clone() }),
        (9, ViewState { sections: Sections::new(&[Section::Plane(plane)]).unwrap(), ..first.clone() }),
        (11, ViewState { isolated: Some(wall), ..first.clone() }),
    ];
    let changes = states.map(|(pose, state)| ViewChange { pose, state: Arc::new(state) });
    let file = still();
    let choice = PathChoice::File(file.path().to_owned());
    let states = ViewStates::new(first, changes.into());
    let path = CameraPath::find(&choice, &scene, states, None).unwrap();
    let walk = walk_in_process(&devices, &plan, &path);
    let drawn: Vec<usize> = walk.iter().map(|record| record.ids.len()).collect();
    // When the wall comes back, the previous set does not have it yet.
    assert_eq!(drawn, [1, 1, 1, 100, 100, 101, 1, 101, 101, 100, 100, 1]);
    let shown: Vec<_> =
        audited(&devices, &plan, &path, &walk).into_iter().map(|pictures| pictures.shown.rgba).collect();

    let path = CameraPath::find(&choice, &bare, plan.settings().into(), Some(1)).unwrap();
    let bare_walk = walk_in_process(&without, &plan, &path);
    let crowd = audited(&without, &plan, &path, &bare_walk).remove(0).shown.rgba;
    // Colours depend on the place in the tree, which differs without the wall.
    let is_crowd = |picture: &[u8]| {
        let outline = |picture: &[u8]| picture.chunks(4).map(|p| p == BACKGROUND).collect::<Vec<_>>();
        outline(picture) == outline(&crowd)
    };
    let (wall, through) = (&shown[1], &shown[7]);
    assert!(is_crowd(&shown[3]) && shown[4] == shown[3], "hidden");
    assert!(shown[9] == shown[3] && shown[10] == shown[3], "cut away");
    assert!([2, 5, 6, 11].iter().all(|&frame| shown[frame] == *wall), "as it is");
    assert!(!is_crowd(wall) && through != wall && *through != shown[3] && shown[8] == *through);
    assert_no_validation_messages(&devices);
}

#[test]
fn a_file_of_view_states_is_walked_over_links_and_reported() {
    let bench = Bench::with_plant(300);
    bench.write(
        "states.toml",
        "[[change]]
        frame = 2
        size = [100, 70]
        hidden = [0, 1, 2]
        [[change]]
        frame = 4
        epsilon = 6.0
        occlusion_test = \"raster\"
        see_through = [5, 6]
        sections = [{ point = [5, 1, 5], cut_towards = [0, 1, 0] }]",
    );
    let walk = |out: &str, more: &[&str]| {
        let args = ["run", "plant.scene", "--state", "states.toml", "--out", out, "--frames", "6"];
        bench.done(&[&args[..], &["--size", "96x80", "--audit-every", "1"], more].concat());
        let report = bench.report(out);
        let frames = report["frames"].as_array().unwrap().clone();
        let of = |key: &str| frames.iter().map(|f| f[key].as_u64().unwrap()).collect::<Vec<_>>();
        assert_eq!(of("view_state"), [0, 0, 1, 1, 2, 2], "{out}");
        assert_eq!(of("cut_mismatch_pixels"), [0; 6], "{out}");
        let states = &report["run"]["view_states"];
        assert_eq!((&states[0]["hidden"], &states[0]["width"]), (&3.into(), &100.into()));
        assert_eq!((&states[1]["see_through"], &states[1]["sections"]), (&2.into(), &1.into()));
        assert_eq!(states[1]["hidden"], 3, "what a change does not name stays");
        let picture = |n: u32| std::fs::read(bench.path(out).join(format!("frames/{n:05}.png"))).unwrap();
        (0..6).map(picture).collect::<Vec<_>>()
    };
    let here = walk("inproc", &[]);
    for (out, more) in [
        ("tcp", &["--link", "tcp", "--cullers", "3"][..]),
        ("udp", &["--link", "udp", "--schedule", "switch"]),
        ("none", &["--cullers", "0"]),
    ] {
        assert!(walk(out, more) == here, "{out}");
    }

    bench.write("bad.toml", "[[change]]\nframe = 1\nhidden = [\"no such\"]");
    let refused = |args: &[&str], words: &str| {
        let output = bench.trimaran(&[&["run", "plant.scene", "--out", "refused"], args].concat());
        assert_eq!(output.status.code(), Some(2), "{}", said(&output));
        assert!(said(&output).contains(words), "{}", said(&output));
        assert!(!bench.path("refused").exists(), "nothing is half-written");
    };
    refused(&["--state", "bad.toml"], "change 1 of bad.toml (frame 1) cannot be");
    refused(&["--state", "missing.toml"], "missing.toml");
    refused(&["--state", "states.toml", "--record", "x.trace"], "leave --state or --record out");
}
