//! `trimaran view`: opens the files of a model as a page in a browser, without further choices.

use std::{
    cell::LazyCell,
    fmt::Display,
    fs,
    io::Write as _,
    path::{Path, PathBuf},
};

use bytesize::ByteSize;
use tempfile::TempDir;
use trimaran::{
    config::options,
    notes::NotesFolder,
    page::{DriveReport, LongTasks, Preparation, Proxies, WrongPixels, model_name},
    scene_cache::{CacheError, CachedScene},
};
use trimaran_scene::{Scene, path::PosePath};

use super::{
    Failure,
    access::TokenSource,
    address::Address,
    args::ViewArgs,
    browser, cooking,
    import::{print_report, read},
    log::SAID,
    preparing::{Opened, Preparing},
    print_json, printed,
    serve::Service,
    terminal::stdout,
};

pub(super) fn run(args: &ViewArgs) -> Result<(), Failure> {
    let drive = args.drive.as_deref().map(path).transpose()?;
    #[cfg(feature = "window")]
    if args.window {
        return match service(&args.files) {
            Some(_) if drive.is_some() => Err(Failure::bad_input(
                "--drive holds pictures against the whole scene: give its file in the service's place",
            )),
            Some(url) => super::window::run_service(args, url),
            None => super::window::run(args, &scene(args, Preparation::default)?.path(), drive),
        };
    }
    #[cfg(not(feature = "window"))]
    if args.window {
        return Err(Failure::bad_input(NO_WINDOWS));
    }
    if let Some(url) = service(&args.files) {
        return Err(Failure::bad_input(format!("open {url} in a browser, or add --window")));
    }
    let drive = drive.map(|path| path.to_json().into_bytes());
    let address = Address::of(&args.files);
    let options = options(&[], toml::Table::new()).map_err(Failure::bad_input)?;
    let mut preparing = None;
    let shown = scene(args, || {
        // A walk's times are those of a page that has its model.
        if args.drive.is_none() {
            let ancestors = &args.embedding.frame_ancestors;
            preparing = Preparing::begin(&address, &options.ws, ancestors, !args.no_browser);
        }
        preparing.as_ref().map(Preparing::preparation).unwrap_or_default()
    });
    if let (Err(why), Some(preparing)) = (&shown, &preparing) {
        preparing.fail(why);
    }
    let shown = shown?;
    let scene = shown.path();
    let (listen, tokens, mut opened) = match preparing.map(Preparing::end) {
        Some(Opened { listen, token, redirect }) => (listen, TokenSource::Given(token), redirect),
        None => (address.listen(), TokenSource::KeptFor(&address), None),
    };
    let service = Service {
        scene: &scene,
        name: model_name(&args.files),
        listen,
        tokens,
        tls: None,
        proxies: Proxies::default(),
        // Beside the model: a scene in the cache may be removed.
        notes: NotesFolder::new(NotesFolder::beside(args.files.first().unwrap_or(&scene)), true),
        frame_ancestors: args.embedding.frame_ancestors.clone(),
        metrics: None,
        device: &args.device,
        guests: args.guests,
        options,
        drive,
    };
    let is_driven = args.drive.is_some();
    let report = service.run(|url| {
        #[cfg(feature = "lab")]
        let network = args.network.as_deref();
        #[cfg(not(feature = "lab"))]
        let network = None::<&str>;
        let url = match (is_driven, network) {
            (false, _) => url.to_owned(),
            (true, None) => format!("{url}#drive"),
            (true, Some(network)) => format!("{url}#drive={network}"),
        };
        // With `--json`, standard output holds only JSON.
        if args.json {
            eprintln!("{url}");
        } else {
            printed(writeln!(stdout(), "{url}"))?;
        }
        if !args.no_browser && opened.is_none() {
            match browser::open(&url) {
                // The file stays: a browser may take its time to read it.
                Ok(file) => opened = Some(file),
                Err(_) => {
                    tracing::warn!(target: SAID, "found no browser to open: open the address above in one");
                }
            }
        }
        Ok(())
    })?;
    drop(opened);
    match report {
        Some(report) if args.json => print_json(&report),
        Some(report) => print_report_of(&report),
        None if is_driven => Err(Failure::stopped("stopped before the page had walked to the end")),
        None => Ok(()),
    }
}

#[cfg(not(feature = "window"))]
const NO_WINDOWS: &str = "this program was built without windows: build it with `cargo build --release --features \
    window`, or leave --window out to walk in a browser";

/// The address of a service to view, if there is one.
fn service(files: &[PathBuf]) -> Option<&str> {
    let [url] = files else { return None };
    url.to_str().filter(|url| url.starts_with("http://") || url.starts_with("https://"))
}

fn path(file: &Path) -> Result<PosePath, Failure> {
    let unread =
        |error: &dyn Display| Failure::bad_input(format!("cannot read the path {}: {error}", file.display()));
    let text = fs::read_to_string(file).map_err(|error| unread(&error))?;
    PosePath::from_json(&text).map_err(|error| unread(&error))
}

fn print_report_of(report: &DriveReport) -> Result<(), Failure> {
    let DriveReport { device, width, height, pictures, walk_s, wrong, .. } = report;
    let a_second = f64::from(*pictures) / walk_s;
    let lines = [
        format!("drawn by        {device}, {width} x {height}"),
        format!(
            "first picture   {:.2} s, exact after {:.2} s",
            report.first_picture_s, report.exact_picture_s
        ),
        format!("pictures        {pictures} in {walk_s:.1} s: {a_second:.1} a second"),
        format!("between two     {:.1} ms, p95 {:.1} ms", report.picture_ms, report.picture_p95_ms),
        format!("sets are old    {:.0} ms, p95 {:.0} ms", report.set_age_ms, report.set_age_p95_ms),
        format!("at rest         exact after {:.0} ms", report.rest_ms),
        long(report.long_tasks.as_ref()),
        format!("a pick takes    {:.1} ms, at most {:.1} ms", report.pick_ms, report.longest_pick_ms),
        right(wrong),
        lasting(wrong),
        format!(
            "received        {}, geometry held {}",
            ByteSize(report.received_bytes),
            ByteSize(report.geometry_bytes)
        ),
    ];
    let moments = report.moments.iter().map(|moment| {
        let unknown = || "unknown".to_owned();
        let scripts = moment.script_bytes.map_or_else(unknown, |bytes| ByteSize(bytes).to_string());
        format!(
            "after {:>5.0} s   cameras {}, ids {}, geometry {}; held {}, scripts {scripts}",
            moment.seconds,
            ByteSize(moment.camera_bytes),
            ByteSize(moment.id_bytes),
            ByteSize(moment.piece_bytes),
            ByteSize(moment.held_bytes),
        )
    });
    let lines: Vec<String> = lines.into_iter().chain(moments).collect();
    printed(writeln!(stdout(), "{}", lines.join("\n")))
}

/// The page's long tasks, in words.
fn long(tasks: Option<&LongTasks>) -> String {
    let told = match tasks {
        None => "unknown to this browser".to_owned(),
        Some(LongTasks { count: 0, .. }) => "none above 50 ms".to_owned(),
        Some(LongTasks { count, longest_ms }) => {
            format!("{count} above 50 ms, the longest {longest_ms:.0} ms")
        }
    };
    format!("long tasks      {told}")
}

/// The wrong pixels of a walk, in words.
pub(super) fn right(wrong: &WrongPixels) -> String {
    format!(
        "wrong pixels    median {:.3} %, p95 {:.3} %, mean {:.3} %, at most {:.1} %; none in {} of {} pictures",
        wrong.median_percent,
        wrong.p95_percent,
        wrong.mean_percent,
        wrong.most_percent,
        wrong.right,
        wrong.pictures
    )
}

/// How long pixels were wrong.
pub(super) fn lasting(wrong: &WrongPixels) -> String {
    let WrongPixels { longest_ms, jump_ms, .. } = wrong;
    format!("for so long     above 0.1 % for {longest_ms:.0} ms; after a jump for {jump_ms:.0} ms")
}

/// The scene to show: the one given, or that of the files, cooked if necessary. `begin` is called before.
fn scene(args: &ViewArgs, begin: impl FnOnce() -> Preparation) -> Result<Shown, Failure> {
    if let [scene] = &args.files[..]
        && is_cooked(scene)
    {
        return Ok(Shown::Given(scene.clone()));
    }
    if let Some(scene) = args.files.iter().find(|file| is_cooked(file)) {
        let why = format!("{} is a cooked scene: it is viewed alone, without other files", scene.display());
        return Err(Failure::bad_input(why));
    }
    Shown::cooked(args, begin)
}

/// The scene to show.
pub(super) enum Shown {
    /// One that was given.
    Given(PathBuf),
    /// A scene in the cache.
    Cached(CachedScene),
    /// A scene that is removed afterwards, since the cache cannot be used.
    Once(TempDir),
}

impl Shown {
    fn cooked(args: &ViewArgs, begin: impl FnOnce() -> Preparation) -> Result<Self, Failure> {
        let preparation = LazyCell::new(begin);
        let cook = |path: &Path| {
            let imported = read(&args.files, &args.reading, &preparation)?;
            print_report(&imported.report);
            cooking::cook_and_save(&imported.model, &args.reading.cook_options(), path, &preparation)?;
            Ok::<_, Failure>(imported.report.looked_for)
        };
        let once = |why: &dyn Display| {
            tracing::warn!(target: SAID, "the cooked scene is not kept for another time: {why}");
            let folder = tempfile::tempdir().map_err(Failure::broken)?;
            cook(&folder.path().join(ONCE))?;
            Ok(Self::Once(folder))
        };
        let cached = match CachedScene::of(&args.files, &format!("{:?}", args.reading)) {
            Ok(cached) => cached,
            Err(CacheError::Folder(why)) => return once(&why),
            Err(error) => return Err(Failure::bad_input(error)),
        };
        if cached.is_current() && Scene::open(cached.path()).is_ok() {
            return Ok(Self::Cached(cached));
        }
        match cook(cached.path()) {
            Ok(looked_for) => {
                if let Err(why) = cached.keep(&looked_for) {
                    tracing::warn!(target: SAID, "the cooked scene may be cooked again another time: {why}");
                }
                Ok(Self::Cached(cached))
            }
            // The disk failed, not the model.
            Err(failure) if failure.may_pass() => once(&failure),
            Err(failure) => Err(failure),
        }
    }

    /// Its path.
    pub(super) fn path(&self) -> PathBuf {
        match self {
            Self::Given(path) => path.clone(),
            Self::Cached(cached) => cached.path().to_owned(),
            Self::Once(folder) => folder.path().join(ONCE),
        }
    }
}

/// The name of a scene that is not kept.
const ONCE: &str = "model.scene";

fn is_cooked(file: &Path) -> bool {
    file.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("scene"))
}
