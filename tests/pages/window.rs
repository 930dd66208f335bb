//! The window on a virtual screen: its pictures, and its response to input. All under the validation layer.

use std::{process::ExitStatus, sync::Arc, thread, time::Duration};

use glam::{DVec3, Vec3};
use serde_json::{Value, json};
use trimaran::{
    page::SceneDescription,
    window::navigate::{Drag, Ground, Motion, Navigator, Pose, Solid, Start},
};
use trimaran_cull::{CutRule, LodRule, View, Viewport, draw_order, lod_cut};
use trimaran_gpu::{BACKGROUND, Gpu, GpuOptions, GpuScene, PicturePass};
use trimaran_proto::{Camera, FrameNumber, ObjectSet, Settings, ViewState};
use trimaran_scene::{Scene, heightfield::Heightfield};

use crate::common::house::{RISE, STEPS, house};
use crate::common::page::Service;
use crate::common::program::{Bench, said, signal};
use crate::common::screen::{Compositor, Screen, Window, wait_for};

/// A scene, and a person in it who moves like the window's.
struct Person {
    scene: Arc<Scene>,
    clearance: f64,
    navigator: Navigator,
    ground: Ground,
}

impl Person {
    fn new(bench: &Bench, scene: &str) -> Self {
        let file = bench.path(scene);
        let scene = Arc::new(Scene::open(&file).unwrap());
        let SceneDescription { start, eye_height, has_floors, vfov_deg, clearance, .. } =
            SceneDescription::new(String::new(), &scene).unwrap();
        let (eye, forward) = (start.eye.into(), start.forward.into());
        let navigator = Navigator::new(&Start { eye, forward, eye_height, has_floors, vfov_deg });
        let ground = Ground::new(&scene, eye_height).unwrap();
        Self { scene, clearance, navigator, ground }
    }

    /// Stands after falling.
    fn rests(&mut self) -> Pose {
        let Self { navigator, ground, .. } = self;
        wait_for("the ground", || {
            let Pose { eye, .. } = navigator.pose();
            ground.look_around(eye.x, eye.z);
            // A body stands on the tiles beside that of its eye as well.
            let side = ground.cell() * Heightfield::SIDE as f64;
            let beside = [-side, 0.0, side];
            let mut places = beside.iter().flat_map(|x| beside.map(|z| (eye.x + x, eye.z + z)));
            places.all(|(x, z)| ground.spans(x, z).is_some()).then_some(())
        });
        while navigator.step(Duration::from_millis(20), Motion::default(), false, ground) {}
        navigator.pose()
    }

    /// A view from the present eye in a picture of this size, with pixels as large as those of one of `of`.
    fn view(&self, size: [u32; 2], of: [u32; 2]) -> View {
        let Pose { eye, gaze } = self.navigator.pose();
        let tan = (self.navigator.vfov_deg().to_radians() / 2.0).tan();
        let tan = tan * f64::from(size[1]) / f64::from(of[1]);
        let near = (self.clearance / 2.0) as f32;
        let turn = gaze.orientation().normalize().to_array();
        let camera = Camera::new(eye.to_array(), turn, tan as f32, near, FrameNumber(0)).unwrap();
        View::new(camera, Viewport::new(size[0], size[1]).unwrap())
    }

    /// The expected picture of a window of this size: the mean of four samples per pixel, and nothing at
    /// edges between sky and objects.
    fn picture(&self, gpu: &Arc<Gpu>, size: [u32; 2]) -> Vec<Option<Vec3>> {
        self.picture_with(gpu, size, self.scene.see_through())
    }

    /// The same with these objects see-through.
    fn picture_with(&self, gpu: &Arc<Gpu>, size: [u32; 2], glass: &ObjectSet) -> Vec<Option<Vec3>> {
        // The culled view is wider by half, with pixels of the same size.
        let asked = self.view(size.map(|side| (3 * side).div_ceil(2)), size);
        let settings = Settings::new(asked.viewport(), LodRule::new(2.0).unwrap());
        let state = ViewState { see_through: Some(glass.clone()), ..settings.into() };
        let rule = CutRule::new(&self.scene, &state);
        let mut cut = lod_cut(&self.scene, &asked, &rule);
        let view = self.view(size, size);
        draw_order(&self.scene, &view, &mut cut);
        let [width, height] = size.map(|side| 2 * side);
        let fine = View::new(*view.camera(), Viewport::new(width, height).unwrap());
        let drawn = GpuScene::new(gpu, &self.scene).unwrap();
        let mut pass = PicturePass::for_window(&drawn, fine.viewport()).unwrap();
        pass.begin(&fine).unwrap();
        let mut through = vec![];
        pass.draw(&rule.divide(&self.scene, &cut, &mut through)).unwrap();
        if !through.is_empty() {
            pass.draw_see_through(&through).unwrap();
        }
        pass.finish().unwrap();
        let pixels = pass.pixels().unwrap();
        let mean = |x: u32, y: u32| {
            let at = |right: u32, down: u32| pixels[((2 * y + down) * width + 2 * x + right) as usize];
            let four = [at(0, 0), at(1, 0), at(0, 1), at(1, 1)];
            match four.iter().filter(|pixel| **pixel == BACKGROUND).count() {
                0 => Some(four.iter().map(colour).sum::<Vec3>() / 4.0),
                4 => Some(sky(&view, x, y) * 255.0),
                _ => None,
            }
        };
        (0..size[1]).flat_map(|y| (0..size[0]).map(move |x| mean(x, y))).collect()
    }
}

fn colour(&[red, green, blue, _]: &[u8; 4]) -> Vec3 {
    Vec3::new(f32::from(red), f32::from(green), f32::from(blue))
}

/// Sky above the horizon and ground below, like the page's.
fn sky(view: &View, x: u32, y: u32) -> Vec3 {
    let size = view.viewport();
    let across = ((f64::from(x) + 0.5) / f64::from(size.width()) * 2.0 - 1.0) * view.tan_half_fov_x();
    let up = (1.0 - (f64::from(y) + 0.5) / f64::from(size.height()) * 2.0) * view.tan_half_fov_y();
    let ray = DVec3::new(across, up, -1.0).normalize();
    let height = (view.to_view().transpose() * ray).y as f32;
    let mix =
        |near: [f32; 3], far: [f32; 3], share: f32| Vec3::from(near).lerp(Vec3::from(far), share.sqrt());
    let sky = mix([0.90, 0.93, 0.95], [0.62, 0.74, 0.86], height.clamp(0.0, 1.0));
    let ground = mix([0.80, 0.81, 0.80], [0.60, 0.61, 0.60], (-height).clamp(0.0, 1.0));
    let edge = ((height + 0.012) / 0.024).clamp(0.0, 1.0);
    ground.lerp(sky, edge * edge * (3.0 - 2.0 * edge))
}

/// Whether a window at the upper left of the screen shows this picture, but for a thousandth of its pixels.
fn is_shown(screen: &Screen, size: [u32; 2], expected: &[Option<Vec3>]) -> bool {
    let shown = screen.picture();
    let places = (0..size[1]).flat_map(|y| (0..size[0]).map(move |x| (x, y)));
    let is_wrong = |&((x, y), expected): &((u32, u32), &Option<Vec3>)| {
        let shown = Vec3::from(shown.at(x, y).map(f32::from));
        expected.is_some_and(|expected| (shown - expected).abs().max_element() > 2.0)
    };
    // One wrong pixel too many ends the count.
    let wrong = places.zip(expected).filter(is_wrong).take(expected.len() / 1000 + 1).count();
    wrong * 1000 < expected.len()
}

fn said_nothing(said: &str) {
    let complaint = said.lines().find(|line| line.contains("Validation") || line.contains("VUID"));
    assert_eq!(complaint, None, "{said}");
}

/// Ends the program like a person.
fn quit(window: Window<'_>) {
    window.by_hand(&["key", "ctrl+q"]);
    let (status, said) = window.end();
    assert_eq!(status.code(), Some(0), "{said}");
    said_nothing(&said);
}

/// Drags from the middle of the window, so that the person turns by this many pixels.
fn turn(window: &Window<'_>, person: &mut Person, right: i32, down: i32) {
    let mut left = [right, down];
    while left != [0, 0] {
        let part = left.map(|side| side.clamp(-300, 300));
        let [x, y] = [400 + part[0], 300 + part[1]].map(|side| side.to_string());
        window.by_hand(&["mousemove", "400", "300"]);
        window.by_hand(&["mousedown", "1"]);
        window.by_hand(&["mousemove", &x, &y]);
        window.by_hand(&["mouseup", "1"]);
        left = [left[0] - part[0], left[1] - part[1]];
        let [right, down] = part.map(f64::from);
        person.navigator.drag(Drag { right, down, is_pan: false }, 600.0);
    }
}

#[test]
fn at_rest_the_window_shows_the_whole_cut_whatever_its_size() {
    let Some(screen) = Screen::start() else { return };
    let bench = Bench::with_plant(300);
    let gpu = Gpu::open(&GpuOptions::default()).unwrap();
    let window = screen.open(&bench, "plant.scene", &[]);
    let mut person = Person::new(&bench, "plant.scene");
    person.rests();
    for (size, drag) in
        [([800, 600], [0, 0]), ([333, 777], [150, 40]), ([1200, 401], [-300, -80]), ([90, 70], [0, 0])]
    {
        window.xdotool(&["windowsize", "800", "600"]);
        turn(&window, &mut person, drag[0], drag[1]);
        window.xdotool(&["windowsize", &size[0].to_string(), &size[1].to_string()]);
        let expected = person.picture(&gpu, size);
        let things = expected.iter().filter(|pixel| pixel.is_some()).count();
        assert!(things * 10 > expected.len() * 9);
        // A small window has objects smaller than its pixels, which hide behind others.
        wait_for("the exact picture", || is_shown(&screen, size, &expected).then_some(()));
    }
    quit(window);
}

#[test]
fn on_a_fine_screen_a_window_has_more_pixels_and_a_drag_turns_as_far() {
    let Some(screen) = Screen::start() else { return };
    let bench = Bench::with_plant(300);
    let gpu = Gpu::open(&GpuOptions::default()).unwrap();
    let window = screen.open_scaled(&bench, "plant.scene", &["--size", "600x400"], 1.5);
    let mut person = Person::new(&bench, "plant.scene");
    person.rests();
    window.by_hand(&["mousemove", "400", "300"]);
    window.by_hand(&["mousedown", "1"]);
    window.by_hand(&["mousemove", "550", "330"]);
    window.by_hand(&["mouseup", "1"]);
    person.navigator.drag(Drag { right: 100.0, down: 20.0, is_pan: false }, 400.0);
    let size = [900, 600];
    let expected = person.picture(&gpu, size);
    wait_for("the exact picture", || is_shown(&screen, size, &expected).then_some(()));
    quit(window);
}

#[test]
fn a_window_on_a_service_elsewhere_is_sent_what_it_shows_and_outlives_it() {
    let Some(screen) = Screen::start() else { return };
    let bench = Bench::with_plant(300);
    let Some(service) = Service::start(&bench, "127.0.0.1:0") else { return };
    let gpu = Gpu::open(&GpuOptions::default()).unwrap();
    let window = screen.open_named(&bench, "plant", &service.url(), &["--size", "800x600"], 1.0);
    let mut person = Person::new(&bench, "plant.scene");
    person.rests();
    let exact = |person: &Person| {
        let expected = person.picture(&gpu, [800, 600]);
        wait_for("the exact picture", || is_shown(&screen, [800, 600], &expected).then_some(()));
    };
    exact(&person);
    turn(&window, &mut person, 200, 30);
    exact(&person);
    // The service is killed while a person looks around, and comes back.
    let at = service.at.clone();
    drop(service);
    turn(&window, &mut person, -300, 0);
    let _again = Service::start(&bench, &at).unwrap();
    turn(&window, &mut person, -100, 0);
    exact(&person);
    quit(window);
}

/// Red walls around a house of glass, on a floor.
fn glasshouse() -> String {
    let mut text = "mtllib plant.mtl\n".to_owned();
    let mut squares = 0;
    let mut square = |name: &str, material: &str, corners: [[i32; 3]; 4]| {
        text += &format!("o {name}\nusemtl {material}\n");
        for [x, y, z] in corners {
            text += &format!("v {x} {y} {z}\n");
        }
        let [a, b, c, d] = [1, 2, 3, 4].map(|corner| 4 * squares + corner);
        text += &format!("f {a} {b} {c} {d}\n");
        squares += 1;
    };
    square("floor", "grey", [[-12, 0, -12], [-12, 0, 12], [12, 0, 12], [12, 0, -12]]);
    for (material, at) in [("red", 9), ("glass", 4)] {
        for (side, [[x, z], [u, w]]) in
            [[[-at, -at], [at, -at]], [[at, -at], [at, at]], [[at, at], [-at, at]], [[-at, at], [-at, -at]]]
                .into_iter()
                .enumerate()
        {
            square(&format!("{material}{side}"), material, [[x, 0, z], [u, 0, w], [u, 3, w], [x, 3, z]]);
        }
    }
    text
}

#[test]
fn what_the_model_has_see_through_is_so_in_the_window_of_a_file_and_of_a_service() {
    let Some(screen) = Screen::start() else { return };
    let bench = Bench::empty();
    bench.write(
        "plant.mtl",
        "newmtl grey\nKd 0.5 0.5 0.5\nnewmtl red\nKd 1 0 0\nnewmtl glass\nKd 0 0 1\nd 0.2\n",
    );
    bench.write("plant.obj", glasshouse());
    bench.done(&["import", "plant.obj", "-o", "plant.scene"]);
    let gpu = Gpu::open(&GpuOptions::default()).unwrap();
    let size = [800, 600];
    let mut person = Person::new(&bench, "plant.scene");
    person.rests();
    let expected = person.picture(&gpu, size);
    let solid = person.picture_with(&gpu, size, &ObjectSet::default());
    let through = expected.iter().zip(&solid).filter(|(a, b)| a.is_some() && b.is_some() && a != b).count();
    assert!(through * 10 > expected.len(), "glass is in the picture: {through} pixels");
    let exact = || {
        wait_for("the exact picture", || is_shown(&screen, size, &expected).then_some(()));
    };
    let window = screen.open(&bench, "plant.scene", &["--size", "800x600"]);
    exact();
    quit(window);
    let Some(service) = Service::start(&bench, "127.0.0.1:0") else { return };
    let window = screen.open_named(&bench, "plant", &service.url(), &["--size", "800x600"], 1.0);
    exact();
    quit(window);
}

#[test]
fn a_service_that_does_not_answer_or_does_not_know_the_token_is_named() {
    let Some(screen) = Screen::start() else { return };
    let bench = Bench::with_plant(100);
    let Some(service) = Service::start(&bench, "127.0.0.1:0") else { return };
    let wrong_token = format!("http://{}/?token=0123456789abcdef0", service.at);
    let nobody = "http://127.0.0.1:9/?token=0123456789abcdef".to_owned();
    for (url, flags, code, word) in [
        (&wrong_token, &["--window"][..], 1, "it answers 403"),
        (&nobody, &["--window"], 1, "nobody answers there"),
        (&service.url(), &["--no-browser"], 2, "or add --window"),
        (&service.url(), &["--window", "--drive", "plant.scene"], 2, "cannot read the path"),
        (&"http://127.0.0.1:9/".to_owned(), &["--window"], 2, "that `trimaran serve` has printed"),
    ] {
        let mut command = bench.command(&[&["view", url.as_str()][..], flags].concat());
        let output = screen.beside(&mut command).output().unwrap();
        assert_eq!(output.status.code(), Some(code), "{url} {flags:?}: {}", said(&output));
        assert!(said(&output).contains(word), "{url} {flags:?}: {}", said(&output));
    }
}

#[test]
fn a_wall_stops_who_walks_and_stairs_lead_up() {
    let Some(screen) = Screen::start() else { return };
    let bench = Bench::empty();
    bench.write("house.obj", house());
    bench.done(&["import", "house.obj", "-o", "house.scene"]);
    let window = screen.open(&bench, "house.scene", &[]);
    let mut person = Person::new(&bench, "house.scene");
    let Pose { eye, gaze } = person.rests();
    let [x, y, z] = window.rests();
    assert!((DVec3::new(x, y, z) - eye).abs().max_element() <= 0.006, "{x} {y} {z} is not {eye}");
    // North, by 3 thousandths of a radian a pixel.
    turn(&window, &mut person, (-gaze.heading / 0.003).round() as i32, 0);
    let go = |key: &str, there: &dyn Fn([f64; 3]) -> bool| {
        window.by_hand(&["keydown", key]);
        let mut last = vec![];
        // As far as expected, or until the eye stops.
        let reached = wait_for("the way", || {
            thread::sleep(Duration::from_millis(200));
            last.push(window.eye());
            let now = window.eye();
            let stands = last.len() > 8 && last.iter().rev().take(8).all(|before| *before == now);
            (there(now) || stands).then(|| there(now))
        });
        window.by_hand(&["keyup", key]);
        (reached, window.rests())
    };
    // Against the wall from the south, or from behind it against the wall of the house.
    let (walls, expected) = if eye.x < 0.0 && eye.z > -4.0 { ("inner", -4.0) } else { ("outer", -12.0) };
    let (_, [_, y, z]) = go("w", &|_| false);
    assert!((expected + 0.1..expected + 0.5).contains(&z) && (y - 1.7).abs() < 0.06, "{walls}: {y} {z}");
    // Around the stairs to their foot, and up.
    let along = |key: &str, there: &dyn Fn([f64; 3]) -> bool| assert!(go(key, there).0, "{:?}", window.eye());
    along("d", &|[x, ..]| x > 8.0);
    along("s", &|[_, _, z]| z > 3.0);
    along("a", &|[x, ..]| x < 5.5);
    along("w", &|[_, y, z]| y > 3.0 && z < 0.0);
    let (_, [_, y, _]) = go("w", &|[_, _, z]| z < -3.5);
    let top = 1.7 + RISE * f64::from(STEPS);
    assert!((y - top).abs() < 0.06, "not up at {top}: {y}");
    quit(window);
}

#[test]
fn a_window_follows_a_hundred_sizes_and_being_minimized_while_somebody_walks() {
    let Some(screen) = Screen::start() else { return };
    let bench = Bench::with_plant(100);
    let gpu = Gpu::open(&GpuOptions::default()).unwrap();
    let window = screen.open(&bench, "plant.scene", &[]);
    let mut person = Person::new(&bench, "plant.scene");
    person.rests();
    window.rests();
    window.by_hand(&["keydown", "Left"]);
    for step in 0..100_u32 {
        let size = [1 + step * 577 % 1300, 1 + step * 389 % 900];
        window.xdotool(&["windowsize", &size[0].to_string(), &size[1].to_string()]);
        if step % 20 == 7 {
            window.xdotool(&["windowunmap"]);
            window.xdotool(&["windowmap"]);
            window.xdotool(&["windowfocus"]);
            window.by_hand(&["keyup", "Left"]);
            window.by_hand(&["keydown", "Left"]);
        }
    }
    window.by_hand(&["keyup", "Left"]);
    window.rests();
    // If the turned angle is unknown, the end of a drag is known: straight down.
    window.xdotool(&["windowsize", "640", "480"]);
    person.navigator.drag(Drag { right: 0.0, down: -1e6, is_pan: false }, 480.0);
    for _ in 0..4 {
        turn(&window, &mut person, 0, -300);
    }
    let floor = person.picture(&gpu, [640, 480])[240 * 640 + 320];
    let shown = || Vec3::from(screen.picture().at(320, 240).map(f32::from));
    let floor = floor.unwrap();
    wait_for("the floor", || ((shown() - floor).abs().max_element() <= 2.0).then_some(()));
    quit(window);
}

#[test]
fn a_window_ends_with_the_program_and_the_program_with_its_window() {
    let Some(screen) = Screen::start() else { return };
    let bench = Bench::with_plant(100);
    for end in ["closed", "TERM", "INT"] {
        let window = screen.open(&bench, "plant.scene", &["--present-mode", "fifo"]);
        window.rests();
        match end {
            "closed" => drop(window.xdotool(&["windowclose"])),
            name => signal(name, &window.id().to_string()),
        }
        let (status, said) = window.end();
        assert_eq!(status.code(), Some(0), "{end}: {said}");
        if end != "closed" {
            // A window closed by another program ends without notice.
            said_nothing(&said);
        }
    }
}

#[test]
fn who_has_no_screen_is_told_what_to_do() {
    let bench = Bench::with_plant(100);
    let mut command = bench.command(&["view", "--window", "plant.scene"]);
    command.env_remove("DISPLAY").env_remove("WAYLAND_DISPLAY").env_remove("WAYLAND_SOCKET");
    let output = command.output().unwrap();
    assert_eq!(output.status.code(), Some(2), "{}", said(&output));
    assert!(said(&output).contains("no screen to open a window on; set DISPLAY"), "{}", said(&output));
}

/// A plant, and a walk of two seconds in it.
fn plant_and_walk() -> Bench {
    let bench = Bench::with_plant(100);
    let size = ["--size", "64x64", "--audit-every", "0"];
    bench.done(&[&["run", "plant.scene", "--frames", "60", "--out", "walk"], &size[..]].concat());
    bench
}

/// A window's report of a repeated walk.
fn told((status, said): (ExitStatus, String)) -> Value {
    assert_eq!(status.code(), Some(0), "{said}");
    said_nothing(&said);
    let json = said.get(said.find('{').unwrap()..=said.rfind('}').unwrap()).unwrap();
    let report: Value = serde_json::from_str(json).unwrap_or_else(|error| panic!("{error}: {said}"));
    assert_eq!((&report["width"], &report["height"]), (&json!(320), &json!(240)));
    assert!(report["walkS"].as_f64().unwrap() >= 2.0, "60 poses of 30 a second: {report}");
    report
}

const DRIVE: [&str; 5] = ["--drive", "walk/report.json", "--json", "--size", "320x240"];

#[test]
fn a_window_repeats_a_walk_and_says_how_it_went() {
    let Some(screen) = Screen::start() else { return };
    let report = told(screen.open(&plant_and_walk(), "plant.scene", &DRIVE).end());
    let wrong = &report["wrong"];
    assert!(wrong["pictures"].as_u64().unwrap() > 3, "{report}");
    assert!(wrong["medianPercent"].as_f64().unwrap() < 5.0, "{report}");
    assert!(report["pictures"].as_u64() >= wrong["pictures"].as_u64(), "{report}");
}

#[test]
fn a_window_is_shown_on_wayland_as_well() {
    let Some(compositor) = Compositor::start() else { return };
    let bench = plant_and_walk();
    for mode in ["fifo", "mailbox"] {
        let flags = [&DRIVE[..], &["--present-mode", mode]].concat();
        assert_eq!(told(compositor.run(&bench, "plant.scene", &flags))["presentMode"], mode);
    }
}
