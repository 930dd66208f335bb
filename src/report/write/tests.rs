use super::*;
use crate::report::{
    sample::{self, AUDIT_EVERY},
    schema::Ended,
};
use trimaran_cull::RgbImage;

/// The sample's pictures: all that RVG showed, and the others of audited frames.
fn pictures(report: &Report) -> Vec<(u32, PictureKind, Image)> {
    let frames = report.frames.iter().map(|f| f.frame);
    frames
        .flat_map(|frame| {
            let mut all = vec![(frame, PictureKind::Shown, sample::picture(frame, 1))];
            if frame.is_multiple_of(AUDIT_EVERY) {
                let mut unculled = sample::picture(frame, 1);
                if frame == 27 {
                    unculled.rgba[20_000..20_164].fill(60);
                }
                all.push((frame, PictureKind::Unculled, unculled));
                all.push((frame, PictureKind::Full, sample::picture(frame, 0)));
            }
            all
        })
        .collect()
}

fn write_sample(dir: &Path, report: Report) -> Result<Paths, ReportError> {
    let pictures = pictures(&report);
    let borrowed = pictures.iter().map(|(frame, kind, picture)| (*frame, *kind, picture));
    write(dir, report, borrowed)
}

fn listing(dir: &Path) -> Vec<String> {
    let mut names: Vec<_> =
        fs::read_dir(dir).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn everything_is_there_and_nothing_else() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("new/folder");
    let paths = write_sample(&out, sample::report()).unwrap();
    assert_eq!(listing(&out), ["frames", "report.html", "report.json"]);
    assert_eq!(listing(&paths.frames).len(), 60 + 2 * 20);

    let report: Report = serde_json::from_slice(&fs::read(&paths.json).unwrap()).unwrap();
    assert_eq!(report.frames[1].pictures.shown.as_deref(), Some("frames/00001.png"));
    assert_eq!(report.frames[1].pictures.full, None);
    assert_eq!(report.frames[3].pictures.unculled.as_deref(), Some("frames/00003.unculled.png"));
    let file = fs::read(out.join("frames/00003.png")).unwrap();
    let expected = sample::picture(3, 1);
    assert_eq!(RgbImage::decode(&file).unwrap(), RgbImage::of(&expected).unwrap());

    let html = fs::read_to_string(&paths.html).unwrap();
    assert_eq!(
        html.matches("src=\"data:image/png;base64,").count(),
        3 * 5,
        "three frames, five pictures each"
    );
    assert!(!html.contains("http"));
}

#[test]
fn a_shorter_report_replaces_a_longer_one_and_spares_other_files() {
    let dir = tempfile::tempdir().unwrap();
    write_sample(dir.path(), sample::report()).unwrap();
    fs::write(dir.path().join("frames/00099.png"), "mine").unwrap();
    let mut shorter = sample::report();
    shorter.frames.truncate(2);
    write_sample(dir.path(), shorter).unwrap();
    assert_eq!(
        listing(&dir.path().join("frames")),
        ["00000.full.png", "00000.png", "00000.unculled.png", "00001.png", "00099.png"]
    );
}

#[test]
fn a_report_that_names_strange_files_removes_none() {
    let dir = tempfile::tempdir().unwrap();
    let victim = dir.path().join("precious.txt");
    fs::write(&victim, "x").unwrap();
    let out = dir.path().join("out");
    fs::create_dir(&out).unwrap();
    fs::write(
        out.join("report.json"),
        r#"{"frames": [{"frame": 0, "pictures": {"shown": "../precious.txt", "unculled": null, "full": null}}]}"#,
    )
    .unwrap();
    write(&out, sample::bare(), []).unwrap();
    assert!(victim.exists());
}

#[test]
fn an_abandoned_writer_leaves_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let mut writer = Writer::create(dir.path()).unwrap();
    writer.picture(0, PictureKind::Shown, &sample::picture(0, 0)).unwrap();
    assert_eq!(listing(dir.path()), ["unfinished"]);
    drop(writer);
    assert!(listing(dir.path()).is_empty(), "no frame was recorded");
}

#[test]
fn what_was_recorded_stays_where_no_report_comes_of_it() {
    let dir = tempfile::tempdir().unwrap();
    let lines = |folder: &str| -> Vec<serde_json::Value> {
        let text = fs::read_to_string(dir.path().join(folder).join("walk.jsonl")).unwrap();
        text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
    };
    let report = sample::report();
    for (killed, frames) in [3, 5].into_iter().enumerate() {
        let mut writer = Writer::create(dir.path()).unwrap();
        writer.begin(&report, None::<&()>).unwrap();
        for frame in &report.frames[..frames] {
            writer.frame(frame, None::<&()>).unwrap();
        }
        drop(writer);
        let left = lines("unfinished");
        assert_eq!(left.len(), 1 + frames);
        assert_eq!(left[0]["run"]["seed"], 7);
        assert_eq!(serde_json::from_value::<Frame>(left[frames].clone()).unwrap(), report.frames[frames - 1]);
        assert_eq!(listing(&dir.path().join("unfinished")), ["frames", "walk.jsonl"], "no reserve");
        if killed > 0 {
            assert_eq!(lines("unfinished.before").len(), 4, "that of the walk before");
        }
    }
    write_sample(dir.path(), sample::report()).unwrap();
    assert_eq!(listing(dir.path()), ["frames", "report.html", "report.json", "unfinished.before"]);
    assert_eq!(lines("unfinished.before").len(), 6, "the last one, and none older");
}

#[derive(Debug, PartialEq, serde::Deserialize)]
struct Said {
    note: Option<String>,
    state: Option<u32>,
}

#[derive(Debug, PartialEq, serde::Deserialize)]
struct Head {
    state: String,
}

/// Frames and remarks of a process that is killed, and the next process's view of them.
#[test]
fn a_journal_is_taken_up_without_the_line_that_was_being_written() {
    let dir = tempfile::tempdir().unwrap();
    let report = sample::report();
    let picture = sample::picture(0, 0);
    let mut writer = Writer::create(dir.path()).unwrap();
    writer.begin(&report, Some(&"mine")).unwrap();
    for frame in [0, 1] {
        writer.picture(frame, PictureKind::Shown, &picture).unwrap();
        writer.frame(&report.frames[frame as usize], Some(&frame)).unwrap();
    }
    drop(writer);
    let folder = dir.path().join("unfinished");
    let half = fs::read(folder.join("frames/00001.png")).unwrap();
    fs::write(folder.join("frames/00001.png"), &half[..half.len() - 1]).unwrap();
    let journal = folder.join("walk.jsonl");
    let whole = fs::read(&journal).unwrap();
    for torn in ["{\"frame\":2,\"ey", "{\"note\":\"\"}", "\0\0\0\0", ""] {
        fs::write(&journal, [&whole, torn.as_bytes()].concat()).unwrap();
        let mut writer = Writer::open(dir.path()).unwrap();
        let left = writer.left::<Head, Said>().unwrap().unwrap();
        assert_eq!(left.head, Head { state: "mine".to_owned() });
        let said = |frame| Said { note: None, state: Some(frame) };
        assert_eq!(left.lines, [said(0), said(1)], "{torn:?}");
        writer.go_on(&left, [0, 1, 2]).unwrap();
        assert!(writer.has(0, PictureKind::Shown));
        assert!(!writer.has(1, PictureKind::Shown) && !writer.has(2, PictureKind::Shown), "half, and none");
        writer.note("went on").unwrap();
        drop(writer);
        let now = fs::read(&journal).unwrap();
        assert_eq!(now, [&whole[..], b"{\"note\":\"went on\"}\n"].concat(), "{torn:?}");
    }
    // An invalid or foreign journal is not resumed; it is moved aside, and not lost.
    fs::write(&journal, [&whole[..], b"?\n"].concat()).unwrap();
    let mut writer = Writer::open(dir.path()).unwrap();
    assert!(writer.left::<Head, Said>().unwrap().is_none());
    assert!(writer.left::<u32, Said>().unwrap().is_none());
    writer.begin(&report, None::<&()>).unwrap();
    drop(writer);
    assert_eq!(listing(dir.path()), ["unfinished.before"]);
    assert!(fs::read(dir.path().join("unfinished.before/walk.jsonl")).unwrap().starts_with(&whole));
}

/// A scheduler stops a job and starts it again, or somebody frees room on a full disk.
#[test]
fn the_records_of_a_stopped_walk_stay_beside_its_report_if_it_is_resumable() {
    let dir = tempfile::tempdir().unwrap();
    let mut report = sample::report();
    for (how, is_resumable) in [
        (HowEnded::Failed, true),
        (HowEnded::NotRecorded, false),
        (HowEnded::NotRecorded, true),
        (HowEnded::Interrupted, false),
        (HowEnded::Interrupted, true),
    ] {
        report.summary.ended.how = how;
        let writer = Writer::open(dir.path()).unwrap();
        let mut writer = if is_resumable { writer.resumable() } else { writer };
        writer.begin(&report, Some(&"mine")).unwrap();
        writer.picture(0, PictureKind::Shown, &sample::picture(0, 0)).unwrap();
        writer.frame(&report.frames[0], Some(&0)).unwrap();
        let paths = writer.finish(report.clone()).unwrap();
        assert!(paths.json.exists() && paths.frames.join("00000.png").exists());
        let stays = is_resumable && how != HowEnded::Failed;
        assert_eq!(dir.path().join("unfinished").exists(), stays, "{how:?}");
    }
    // The next process has the records, draws the pictures again, and leaves nothing but its report.
    let mut writer = Writer::open(dir.path()).unwrap().resumable();
    let left = writer.left::<Head, Said>().unwrap().unwrap();
    assert_eq!((left.head.state.as_str(), left.lines.len()), ("mine", 1));
    writer.go_on(&left, [0]).unwrap();
    assert!(!writer.has(0, PictureKind::Shown));
    writer.picture(0, PictureKind::Shown, &sample::picture(0, 0)).unwrap();
    report.summary.ended = Ended::finished(Some(60));
    writer.finish(report).unwrap();
    // Walks before it had begun anew.
    assert_eq!(listing(dir.path()), ["frames", "report.html", "report.json", "unfinished.before"]);
}

/// Processes killed before they record a frame do not damage earlier records.
#[test]
fn what_was_recorded_stays_until_something_else_is_recorded() {
    let dir = tempfile::tempdir().unwrap();
    let report = sample::report();
    let mut writer = Writer::create(dir.path()).unwrap();
    writer.begin(&report, None::<&()>).unwrap();
    writer.frame(&report.frames[0], None::<&()>).unwrap();
    drop(writer);
    for _ in 0..3 {
        drop(Writer::open(dir.path()).unwrap());
        assert_eq!(listing(&dir.path().join("unfinished")), ["frames", "walk.jsonl"]);
    }
    drop(Writer::create(dir.path()).unwrap());
    for _ in 0..3 {
        // As if killed after the head: nothing removes the folder.
        fs::create_dir(dir.path().join("unfinished")).unwrap();
        fs::write(dir.path().join("unfinished/walk.jsonl"), "{}\n").unwrap();
        drop(Writer::create(dir.path()).unwrap());
        assert_eq!(listing(dir.path()), ["unfinished.before"]);
    }
}

#[test]
fn one_walk_at_a_time_writes_into_a_folder() {
    let dir = tempfile::tempdir().unwrap();
    let writer = Writer::create(dir.path()).unwrap();
    let error = Writer::create(dir.path()).unwrap_err();
    assert!(matches!(error, ReportError::Busy { .. }) && error.may_pass(), "{error}");
    drop(writer);
    assert!(Writer::create(dir.path()).is_ok());
}

#[test]
fn a_file_in_the_way_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("taken");
    fs::write(&file, "x").unwrap();
    let error = write(&file, sample::bare(), []).unwrap_err();
    let text = error.to_string();
    assert!(text.contains("taken") && text.contains("--out"), "{text}");
    assert!(std::error::Error::source(&error).is_some());
}

#[test]
fn a_failed_write_leaves_the_older_report_whole() {
    let dir = tempfile::tempdir().unwrap();
    let paths = write(dir.path(), sample::bare(), []).unwrap();
    let before = fs::read(&paths.json).unwrap();
    let writer = Writer::create(dir.path()).unwrap();
    // Acts like a full disk: the page's file cannot be created.
    fs::create_dir(writer.unfinished.path().join("report.html")).unwrap();
    let error = writer.finish(sample::report()).unwrap_err();
    assert!(error.to_string().contains("report.html"), "{error}");
    assert_eq!(fs::read(&paths.json).unwrap(), before);
    assert_eq!(listing(dir.path()), ["frames", "report.html", "report.json"]);
}
