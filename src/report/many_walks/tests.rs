use std::{collections::BTreeSet, fs, path::Path};

use super::*;
use crate::report::{
    Report,
    sample::{self, keys},
    schema::{HowEnded, SCHEMA_VERSION, SweepPoint},
};

/// A walk that finished, with this frame rate.
fn walked(fps: f64) -> Report {
    let mut report = sample::report();
    report.run.alone = false;
    report.sweep.clear();
    report.summary.measured_fps = Some(fps);
    report.summary.ended = Ended::finished(Some(60));
    report
}

fn put(folder: PathBuf, report: &Report) -> PathBuf {
    fs::create_dir_all(&folder).unwrap();
    fs::write(folder.join("report.json"), serde_json::to_vec(report).unwrap()).unwrap();
    fs::write(folder.join("report.html"), "").unwrap();
    folder
}

/// Three walks of one kind and one of another, one that was interrupted, and three folders without a report.
fn example(at: &Path) -> ManyWalks {
    let mut folders: Vec<_> = [(10, 30.0), (2, 20.0), (1, 10.0)]
        .map(|(number, fps)| put(at.join(format!("walk-{number}")), &walked(fps)))
        .to_vec();
    let mut coarse = walked(90.0);
    coarse.run.epsilon_px = 8.0;
    folders.push(put(at.join("<coarse> #1"), &coarse));
    let mut interrupted = walked(1000.0);
    let ended = Ended {
        how: HowEnded::Interrupted,
        why: Some("it was asked to stop".to_owned()),
        frames_due: Some(90),
    };
    interrupted.summary.ended = ended;
    folders.push(put(at.join("walk-3"), &interrupted));
    let [nothing, killed, other] = ["walk-4", "walk-5", "walk-6"].map(|name| at.join(name));
    fs::create_dir_all(killed.join("unfinished")).unwrap();
    put(other.clone(), &walked(1.0));
    let version = format!(r#"{{"schema_version":{}}}"#, SCHEMA_VERSION + 1);
    fs::write(other.join("report.json"), version).unwrap();
    folders.extend([nothing, killed, other]);
    ManyWalks::read(&folders)
}

fn names(walks: &ManyWalks) -> Vec<&str> {
    walks.walks.iter().map(|walk| walk.folder.rsplit('/').next().unwrap()).collect()
}

#[test]
fn walks_are_sorted_by_kind_and_number_and_medians_are_over_the_finished_ones() {
    let dir = tempfile::tempdir().unwrap();
    let walks = example(dir.path());
    assert_eq!(names(&walks), ["walk-1", "walk-2", "walk-3", "walk-10", "<coarse> #1"]);
    let [fine, coarse] = &walks.kinds[..] else { panic!("{:?}", walks.kinds) };
    assert_eq!((fine.kind.epsilon_px, fine.figures.walks, fine.figures.whole), (2.0, 4, 3));
    assert_eq!((coarse.kind.epsilon_px, coarse.figures.walks, coarse.figures.whole), (8.0, 1, 1));
    // Of 10, 20 and 30: the interrupted walk's 1000 does not count.
    assert_eq!(fine.figures.fps, Some(OverWalks { walks: 3, median: 20.0, low: 10.0, high: 30.0 }));
    assert_eq!(walks.all.fps.unwrap().median, 20.0);
    assert_eq!((walks.all.walks, walks.all.whole, walks.all.frames), (5, 4, 300));
    // Its errors do count.
    let once = sample::report().summary;
    assert_eq!(walks.all.wrong_pixels, Some(5 * once.cut_mismatch_pixels_total.unwrap()));
    assert_eq!(walks.all.audited_frames, 5 * u64::from(once.audited_frames));
    assert_eq!(walks.walks[0].latency_p95_ms, Some(once.metrics["latency_ms"].p95));
    assert!(walks.text().contains("20 (10 to 30)"), "{}", walks.text());
}

#[test]
fn what_is_missing_is_named_with_its_reason() {
    let dir = tempfile::tempdir().unwrap();
    let walks = example(dir.path());
    let why: Vec<_> = walks.without_report.iter().map(|of| of.why.as_str()).collect();
    let version = format!("report.json has schema version {}, and this program reads", SCHEMA_VERSION + 1);
    for (why, said) in why.iter().zip(["there is no such folder", "no report yet", version.as_str()]) {
        assert!(why.starts_with(said), "{why}");
    }
    let gaps = walks.gaps().unwrap();
    assert!(gaps.starts_with("1 walk is incomplete, 3 folders have no report: "), "{gaps}");
    assert!(["walk-3", "walk-4", "walk-5", "walk-6"].iter().all(|name| gaps.contains(name)), "{gaps}");
    // A report that lacks checks is a gap as well.
    let folder = put(dir.path().join("whole"), &walked(5.0));
    assert_eq!(ManyWalks::read(std::slice::from_ref(&folder)).gaps(), None);
    fs::write(folder.join(UNCHECKED), "{}").unwrap();
    let lacking = ManyWalks::read(&[folder]);
    assert!(lacking.gaps().unwrap().starts_with("1 walk is incomplete: "));
    assert_eq!(lacking.all.fps.unwrap().walks, 1, "its frame rate is that of a whole walk");
}

#[test]
fn a_sweep_stands_for_its_walks_and_no_walk_counts_twice() {
    let dir = tempfile::tempdir().unwrap();
    let sweep = dir.path().join("sweep");
    for epsilon in [1, 20, 5] {
        let mut walk = walked(f64::from(epsilon));
        walk.run.epsilon_px = f64::from(epsilon);
        put(sweep.join(format!("epsilon-{epsilon}")), &walk);
    }
    fs::create_dir(sweep.join("frames")).unwrap();
    let last = walked(20.0);
    let point = SweepPoint::of(&last);
    put(sweep.clone(), &last.with_sweep(vec![point]));
    let walks = ManyWalks::read(&[sweep.clone(), sweep.join("epsilon-5"), sweep.join("../sweep")]);
    assert_eq!(names(&walks), ["epsilon-1", "epsilon-5", "epsilon-20"]);
    assert_eq!(walks.gaps(), None);
}

/// The systems of a comparison on two paths.
fn compared(notes: &[&str]) -> String {
    let system = |system: &str, fps: [f64; 2], audited: u32| {
        let drawn =
            [0, 1].map(|_| serde_json::json!({ "audited_frames": audited, "wrong_pixels": 2 * audited }));
        serde_json::json!({
            "system": system,
            "alone": { "model_fps": fps, "or_ms": [1.0, 1.0] },
            "measured": { "processes": 3, "fps": [fps[0] / 2.0, fps[1] / 2.0] },
            "drawn": drawn,
        })
    };
    let systems = [system("independent-2", [40.0, 60.0], 3), system("frustum", [20.0, 20.0], 0)];
    let tables = [1.0, 8.0].map(|epsilon| serde_json::json!({ "epsilon_px": epsilon, "systems": systems }));
    let (scene, device) = (sample::run().scene, "llvmpipe");
    let version = crate::report::schema::COMPARISON_VERSION;
    serde_json::json!({
        "schema_version": version, "scene": scene, "device": device, "tables": tables, "notes": notes,
    })
    .to_string()
}

#[test]
fn comparisons_have_a_row_a_system_and_error_bound() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("compared");
    fs::create_dir(&folder).unwrap();
    fs::write(folder.join("compare.json"), compared(&[])).unwrap();
    fs::write(folder.join("compare.html"), "").unwrap();
    let walks = ManyWalks::read(std::slice::from_ref(&folder));
    let rows: Vec<_> = walks.comparisons.iter().map(|of| (of.epsilon_px, of.system.as_str())).collect();
    assert_eq!(rows, [(1.0, "independent-2"), (1.0, "frustum"), (8.0, "independent-2"), (8.0, "frustum")]);
    let [first, second, ..] = &walks.comparisons[..] else { panic!("{rows:?}") };
    let model = first.model_fps.unwrap();
    assert_eq!((model.mean, model.low, model.high), (50.0, 40.0, 60.0));
    assert_eq!(first.measured_fps.unwrap().mean, 25.0);
    assert_eq!((first.audited_frames, first.wrong_pixels), (6, Some(12)));
    assert_eq!((second.audited_frames, second.wrong_pixels), (0, None));
    assert_eq!((walks.gaps(), walks.all.walks), (None, 0));
    let page = walks.page(&dir.path().join("page.html"));
    assert!(page.contains(r#"<a href="compared/compare.html">"#) && page.contains("50 (40 to 60)"), "{page}");
    assert!(walks.text().contains("independent-2"), "{}", walks.text());

    fs::write(folder.join("compare.json"), compared(&["ended early: the disk is full"])).unwrap();
    let gaps = ManyWalks::read(&[folder]).gaps().unwrap();
    assert!(gaps.starts_with("1 comparison is incomplete: "), "{gaps}");
}

#[test]
fn a_rate_that_is_modelled_stands_with_its_kind_only() {
    let dir = tempfile::tempdir().unwrap();
    let mut modelled = walked(7.0);
    modelled.run.alone = true;
    let folders = [put(dir.path().join("a"), &walked(50.0)), put(dir.path().join("b"), &modelled)];
    let walks = ManyWalks::read(&folders);
    assert_eq!(walks.kinds.len(), 2);
    let model = modelled.summary.model.unwrap();
    let row = walks.walks.iter().find(|walk| walk.kind.alone).unwrap();
    assert_eq!((row.fps, row.latency_median_ms), (Some(model.fps), Some(model.latency_ms)));
    assert_eq!(row.latency_p95_ms, None);
}

#[test]
fn the_page_links_to_each_walk_from_where_it_is_and_names_stay_in_their_place() {
    let dir = tempfile::tempdir().unwrap();
    let walks = example(dir.path());
    let beside = walks.page(&dir.path().join("page.html"));
    assert!(beside.contains(r#"href="walk-10/report.html""#), "{beside}");
    assert!(beside.contains(r#"href="%3Ccoarse%3E%20%231/report.html""#), "{beside}");
    let below = walks.page(&dir.path().join("walk-4.pages/page.html"));
    assert!(!below.contains("href"), "a page that has no folder has no links");
    fs::create_dir(dir.path().join("pages")).unwrap();
    assert!(walks.page(&dir.path().join("pages/page.html")).contains(r#"href="../walk-1/report.html""#));
    assert!(!beside.contains("<b>platform") && !beside.contains("<coarse>"));
    for outside in ["http", "//cdn", "url(", "@import", "<link", "src="] {
        assert!(!beside.contains(outside), "{outside}");
    }
    assert!(beside.contains("ended early, after 60 of 90 frames: it was asked to stop"));
    assert_eq!(beside.matches("<tr>").count(), 3 + 2 + 5 + 3, "heads, kinds, walks, missing");
    assert!(!beside.contains("NaN") && !beside.contains("inf\""));
}

#[test]
fn without_any_walk_there_is_a_page_that_says_so() {
    let walks = ManyWalks::read(&["no-such-folder".into()]);
    let page = walks.page(Path::new("page.html"));
    assert!(page.contains("0 walks") && page.contains("there is no such folder"), "{page}");
    assert!(walks.gaps().is_some() && walks.text() == "no walks\n");
    assert_eq!((walks.all.fps, walks.all.wrong_pixels), (None, None));
}

#[test]
fn the_documentation_names_every_key() {
    let dir = tempfile::tempdir().unwrap();
    let mut found = BTreeSet::new();
    keys(&serde_json::to_value(example(dir.path())).unwrap(), &mut found);
    fs::write(dir.path().join("compare.json"), compared(&[])).unwrap();
    keys(&serde_json::to_value(ManyWalks::read(&[dir.path().into()])).unwrap(), &mut found);
    let docs = include_str!("../../../docs/report.md");
    let docs = docs.split_once("# Many walks on one page").unwrap().1;
    let missing: Vec<_> = found.iter().filter(|key| !docs.contains(&format!("`{key}`"))).collect();
    assert!(found.len() > 30 && missing.is_empty(), "docs/report.md does not name {missing:?}");
}

#[test]
fn numbers_in_names_are_sorted_as_numbers() {
    let mut names = ["b10", "b9", "a", "b", "b9-2", "b9-10", "10", "9", "b99999999999999999999999"];
    names.sort_by_key(|name| natural(name));
    assert_eq!(names, ["9", "10", "a", "b", "b9", "b9-2", "b9-10", "b10", "b99999999999999999999999"]);
}
