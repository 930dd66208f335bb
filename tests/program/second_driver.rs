//! The program on two Vulkan drivers: the machine's best one, and SwiftShader, a rasterizer by other people
//! with a coarser sub-pixel grid and fewer features. Culling is exact on each, and both draw the same
//! pictures as far as Vulkan defines them.
//!
//! SwiftShader is found by the path of its ICD file in `TRIMARAN_SWIFTSHADER`, or where Debian's
//! `chromium-common` has it. Without it the test says "skipped", unless `TRIMARAN_REQUIRE_SWIFTSHADER=1`.

use std::{
    env,
    fs::{self, File},
    io::BufReader,
    path::{Path, PathBuf},
};

use serde_json::Value;

use crate::common::program::{Bench, Process, printed};

const INSTALLED: &str = "/usr/lib/chromium/vk_swiftshader_icd.json";
const FRAMES: usize = 8;

fn swiftshader() -> Option<PathBuf> {
    let named = env::var_os("TRIMARAN_SWIFTSHADER").map(PathBuf::from);
    let found = named.or_else(|| Some(PathBuf::from(INSTALLED)).filter(|path| path.exists()));
    if found.is_none() {
        let required = env::var("TRIMARAN_REQUIRE_SWIFTSHADER").is_ok_and(|value| value == "1");
        assert!(!required, "TRIMARAN_SWIFTSHADER is not set, and {INSTALLED} is not there");
        println!("skipped: no SwiftShader");
    }
    found
}

/// A folder with a scene, and the program in it.
struct Walks(Bench);

impl Walks {
    fn new() -> Self {
        Self(Bench::with_plant(300))
    }

    /// The program's output on the machine's driver, or on that of an ICD file.
    fn run(&self, driver: Option<&Path>, args: &[&str]) -> String {
        let mut command = self.0.command(args);
        if let Some(driver) = driver {
            command.env("VK_DRIVER_FILES", driver);
        }
        printed(&command.output().unwrap())
    }

    /// Walks with every frame checked, and returns the report.
    fn walk(&self, driver: Option<&Path>, occlusion_test: &str, out: &str) -> Value {
        let frames = FRAMES.to_string();
        let args = ["run", "plant.scene", "--size", "320x240", "--audit-every", "1", "--frames", &frames];
        self.run(driver, &[&args[..], &["--occlusion-test", occlusion_test, "--out", out]].concat());
        self.0.report(out)
    }

    fn picture(&self, out: &str, frame: usize, kind: &str) -> Picture {
        Picture::read(&self.0.path(&format!("{out}/frames/{frame:05}{kind}.png")))
    }
}

/// A picture of three bytes a pixel.
#[derive(Debug)]
struct Picture {
    width: usize,
    pixels: Vec<[u8; 3]>,
}

impl Picture {
    fn read(path: &Path) -> Self {
        let mut reader = png::Decoder::new(BufReader::new(File::open(path).unwrap())).read_info().unwrap();
        let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut bytes).unwrap();
        assert_eq!((info.color_type, info.bit_depth), (png::ColorType::Rgb, png::BitDepth::Eight));
        Self { width: info.width as usize, pixels: bytes.as_chunks().0.to_vec() }
    }

    /// How many pixels `other` has that this picture does not account for.
    ///
    /// The rule of Vulkan's conformance tests for rasterizers that may differ
    /// (`intThresholdPositionDeviationCompare` of dEQP): a pixel is accounted for if one within a pixel of
    /// its place has its colour. So edges may lie where either sub-pixel grid puts them.
    fn unaccounted(&self, other: &Self) -> usize {
        assert_eq!((self.width, self.pixels.len()), (other.width, other.pixels.len()));
        let (width, height) = (self.width, self.pixels.len() / self.width);
        let near = |at: usize, end: usize| at.saturating_sub(1)..(at + 2).min(end);
        let same = |a: [u8; 3], b: [u8; 3]| a.iter().zip(b).all(|(a, b)| a.abs_diff(b) <= COLOUR);
        let accounted = |&at: &usize| {
            let (x, y) = (at % width, at / width);
            near(y, height)
                .any(|y| near(x, width).any(|x| same(self.pixels[y * width + x], other.pixels[at])))
        };
        self.pixels.len() - (0..other.pixels.len()).filter(accounted).count()
    }

    fn colours(&self) -> usize {
        let mut colours = self.pixels.clone();
        colours.sort();
        colours.dedup();
        colours.len()
    }
}

/// The largest difference of a colour, of 255: either driver rounds it once, after arithmetic of its own.
const COLOUR: u8 = 2;

/// One pixel in this many may be unaccounted for: of parts thinner than a pixel one driver's samples may hit
/// and the other's miss.
const PIXELS: usize = 500;

/// This driver places corners on a grid of 16 steps to a pixel, the coarsest that Vulkan allows. It draws the
/// side of a box seen edge on before what hides it, as the other one does on its own grid.
#[test]
fn walks_that_a_search_has_found_are_exact_on_the_second_driver() {
    let Some(swiftshader) = swiftshader() else { return };
    let bench = Bench::empty();
    let said = |folder: &str, name: &str| {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("lab/audit/tests").join(folder).join(name);
        let mut command = bench.command(&["audit", "search", "--replay", file.to_str().unwrap()]);
        let output = command.env("VK_DRIVER_FILES", &swiftshader).output().unwrap();
        let text = [output.stdout, output.stderr].map(|text| String::from_utf8(text).unwrap()).concat();
        assert!(text.contains("SwiftShader"), "{text}");
        (output.status.code(), text)
    };
    let kept = Path::new(env!("CARGO_MANIFEST_DIR")).join("lab/audit/tests/kept");
    let mut count = 0;
    for entry in fs::read_dir(kept).unwrap() {
        let (code, text) = said("kept", entry.unwrap().file_name().to_str().unwrap());
        assert!(code == Some(0) && text.contains("no wrong pixel"), "{text}");
        count += 1;
    }
    assert!(count > 5);
    let (code, text) = said("kept_of_drivers", "side-seen-edge-on-coarse-grid.json");
    assert!(code == Some(1) && text.contains("5 are right with culling, 0 without, 0 are neither"), "{text}");
}

#[test]
fn both_drivers_cull_exactly_and_draw_the_same_pictures_with_every_occlusion_test() {
    let Some(swiftshader) = swiftshader() else { return };
    let walks = Walks::new();
    for occlusion_test in ["query", "raster", "hzb"] {
        let outs = [(None, "best"), (Some(swiftshader.as_path()), "second")];
        let [(best_shows, best), (second_shows, second)] = outs.map(|(driver, name)| {
            let out = format!("{occlusion_test}-{name}");
            let report = walks.walk(driver, occlusion_test, &out);
            let device = report["run"]["roles"][0]["device"].as_str().unwrap();
            assert_eq!(device.contains("SwiftShader"), driver.is_some(), "{device}");
            let frames = report["frames"].as_array().unwrap();
            assert_eq!(frames.len(), FRAMES);
            for frame in frames {
                for exact in ["false_culled_pixels", "false_culled_nodes", "cut_mismatch_pixels"] {
                    assert_eq!(frame[exact], 0, "{out}: {exact} of frame {}", frame["frame"]);
                }
            }
            let shown = frames.iter().map(|frame| frame["triangles_exact_full"].as_u64().unwrap());
            (shown.sum::<u64>(), out)
        });
        // Each distinguishes triangles in its own way.
        let apart = best_shows.abs_diff(second_shows);
        assert!(
            best_shows > 1000 && apart * 50 < best_shows,
            "{best_shows} and {second_shows} triangles show"
        );
        for frame in 0..FRAMES {
            for kind in ["", ".full"] {
                let [a, b] = [&best, &second].map(|out| walks.picture(out, frame, kind));
                assert!(a.colours() > 20, "frame {frame} shows something");
                let off = [a.unaccounted(&b), b.unaccounted(&a)];
                println!("{occlusion_test} {frame}{kind}: {off:?} of {}", a.pixels.len());
                assert!(
                    off.iter().all(|off| off * PIXELS <= a.pixels.len()),
                    "{occlusion_test}, frame {frame}{kind}: {off:?} pixels differ beyond edges"
                );
            }
        }
    }
}

/// All devices that the loader shows are columns of one table.
#[test]
fn hard_cases_hold_on_both_drivers_in_one_table() {
    let Some(swiftshader) = swiftshader() else { return };
    let bench = Bench::empty();
    let mut command = bench.command(&["audit", "hard", "--only", "3", "--json"]);
    let output = command.env("VK_ADD_DRIVER_FILES", swiftshader).output().unwrap();
    let found: Value = serde_json::from_str(&printed(&output)).unwrap();
    assert_eq!(found["holds"], true);
    let drivers = found["hard"]["drivers"].as_array().unwrap();
    let about = |driver: &Value| driver["about"].as_str().unwrap().to_owned();
    assert!(drivers.len() >= 3, "{drivers:?}");
    assert!(drivers.iter().any(|driver| about(driver).contains("SwiftShader")), "{drivers:?}");
    for row in found["hard"]["rows"].as_array().unwrap() {
        let cells = row["cells"].as_array().unwrap();
        assert!(cells.len() == drivers.len() && cells.iter().all(|cell| cell["holds"] == true), "{row}");
    }
}

#[test]
fn what_the_second_driver_lacks_is_said_by_doctor() {
    let Some(swiftshader) = swiftshader() else { return };
    let walks = Walks::new();
    let said = walks.run(Some(&swiftshader), &["doctor"]);
    assert!(said.contains("SwiftShader") && said.contains("lacks geometryShader: audits fetch"), "{said}");
    let json: Value = serde_json::from_str(&walks.run(Some(&swiftshader), &["doctor", "--json"])).unwrap();
    assert_eq!(json["works"], true);
    let lacks = json["findings"][0]["lacks"][0].as_str().unwrap();
    assert!(lacks.starts_with("geometryShader: "), "{lacks}");
}

#[test]
fn two_cullers_of_one_machine_open_two_devices() {
    let Some(swiftshader) = swiftshader() else { return };
    let bench = Bench::with_plant(60);
    let with_both = |args: &[&str]| {
        let mut command = bench.command(args);
        command.env("VK_ADD_DRIVER_FILES", &swiftshader).env("TRIMARAN_LOG", "info");
        command
    };
    let json: Value =
        serde_json::from_str(&printed(&with_both(&["doctor", "--json"]).output().unwrap())).unwrap();
    let listed = json["findings"].as_array().unwrap().iter().filter(|finding| finding["what"] == "gpu");
    let listed: Vec<_> = listed.map(|finding| finding["detail"].as_str().unwrap()).collect();
    let uuids = listed.iter().map(|detail| detail.split_once("UUID ").unwrap().1.split(',').next().unwrap());
    let uuids: Vec<_> = uuids.collect();
    assert!(uuids.len() >= 2 && uuids[0] != uuids[1], "{listed:?}");
    let culler = ["role", "culler", "--scene", "plant.scene", "--listen", "tcp://127.0.0.1:0", "--device"];
    for (device, uuid) in [("#0", uuids[0]), ("#1", uuids[1]), (uuids[0], uuids[0]), (uuids[1], uuids[1])] {
        let mut culler = Process::start(&mut with_both(&[&culler[..], &[device]].concat()));
        culler.says_all(&["opens the graphics device", uuid]);
        culler.says("the culler listens on");
    }
}

#[test]
fn a_shifted_edge_is_accounted_for_and_a_missing_wall_is_not() {
    let picture = |colour: fn(usize, usize) -> u8| Picture {
        width: 16,
        pixels: (0..256).map(|at| [colour(at % 16, at / 16); 3]).collect(),
    };
    let wall = picture(|x, _| if x < 8 { 200 } else { 50 });
    assert_eq!(wall.unaccounted(&picture(|x, _| if x < 9 { 201 } else { 48 })), 0);
    assert_eq!(wall.unaccounted(&picture(|x, _| if x < 8 { 203 } else { 50 })), 128);
    assert_eq!(wall.unaccounted(&picture(|x, y| if x < 8 && y < 15 { 200 } else { 50 })), 7);
    assert_eq!(wall.unaccounted(&picture(|_, _| 200)), 16 * 7);
}
