//! `trimaran clash`: pairs of objects that touch, intersect or are too near each other.

use std::{
    borrow::Cow,
    io::{self, Write},
    process::ExitCode,
    sync::Arc,
};

use indicatif::ProgressBar;
use serde_json::json;
use trimaran::{
    page::{CLASH_COLUMNS, CLASH_GROUP_COLUMNS, ClashGroup, ClashNames, ClashRow, ignored_csv},
    report::write_whole_by,
};
use trimaran_actors::Stop;
use trimaran_proto::ObjectSet;
use trimaran_scene::{
    Scene,
    clearance::{ClashRule, Clashes, Clearance, ClearanceError, Clearances, Watch},
};

use super::{
    Failure, args::ClashArgs, log::SAID, number, output, plural, printed, progress, terminal, walking,
};

/// The exit codes besides 0.
const FOUND: u8 = 1;
const NOT_SEARCHED: u8 = 2;
/// As shells report a program that Ctrl-C has ended.
const INTERRUPTED: u8 = 130;

/// Rows that are made at a time.
const AT_ONCE: usize = 4096;

pub(super) fn run(args: &ClashArgs) -> ExitCode {
    match find(args) {
        Ok(0) => ExitCode::SUCCESS,
        Ok(_) => ExitCode::from(FOUND),
        Err(failure) => {
            tracing::error!(target: SAID, "{failure}");
            ExitCode::from(if failure.is_stop() { INTERRUPTED } else { NOT_SEARCHED })
        }
    }
}

/// Finds the clashes and writes them. Returns how many there are.
fn find(args: &ClashArgs) -> Result<usize, Failure> {
    if let Some(out) = &args.out {
        output::check(out, &output::CLASHES, std::slice::from_ref(&args.scene))
            .map_err(Failure::bad_input)?;
    }
    let runtime = walking::runtime()?;
    let stop = walking::stop_on_signal(&runtime);
    tracing::info!(scene = %args.scene.display(), "searches for clashes");
    let scene = Arc::new(Scene::open(&args.scene).map_err(Failure::bad_input)?);
    let names = ClashNames::new(&scene).map_err(Failure::bad_input)?;
    let all = 0..scene.objects().len() as u32;
    let named = |flag: &str, text: &str| {
        let found = scene.reading(|| names.objects(text)).map_err(Failure::bad_input)?;
        let found = found.map_err(|error| Failure::bad_input(format!("{flag}: {error}")))?;
        if found.is_empty() {
            let (scene, text) = (args.scene.display(), terminal::word(text));
            return Err(Failure::bad_input(format!("{flag} {text:?} finds no object in {scene}")));
        }
        Ok(found)
    };
    let between = match &args.between {
        Some(text) => named("--between", text)?,
        None => all.clone().collect(),
    };
    let and: ObjectSet = match (&args.and, &args.between) {
        (Some(text), _) => named("--and", text)?,
        (None, Some(_)) => all.filter(|object| !between.contains(*object)).collect(),
        (None, None) => between.clone(),
    };
    let groups = args.ignore.map(|level| names.groups_at(level)).unwrap_or_default();
    let (tolerance, most) = (args.tolerance, args.most);
    let rule = ClashRule { between: &between, and: &and, tolerance, groups: &groups, most };
    let watched = Watched { bar: progress::bar("comparing", between.len() as u64), stop: stop.clone() };
    let found = Clearances::new(&scene).clashes(&rule, &watched);
    watched.bar.finish_and_clear();
    let Clashes { found, ignored } = found.map_err(|error| match error {
        ClearanceError::Stopped => stopped(),
        ClearanceError::TooMany { most } => Failure::bad_input(format!(
            "more than {} found, and nothing was written: choose smaller sets or a smaller tolerance, leave \
             some out with --ignore, or raise --most",
            plural(most as u64, "clash was", "clashes were")
        )),
        error => Failure::bad_input(error),
    })?;
    let list = List { names: &names, args, found: &found, ignored, stop: &stop };
    if let Some(out) = &args.out {
        let written = write_whole_by(out, |file| list.write_csv(file));
        written.map_err(|error| list.failure(error, &format!("cannot write {}", out.display())))?;
    }
    let mut stdout = io::BufWriter::new(terminal::stdout());
    let printing = match (args.json, &args.out) {
        (true, _) => list.write_json(&mut stdout, [&between, &and]),
        (false, None) => list.write_csv(&mut stdout),
        (false, Some(_)) => Ok(()),
    };
    printed(printing.and_then(|()| stdout.flush()))
        .map_err(|e| if stop.requested() { stopped() } else { e })?;
    let left_out = args.ignore.map_or_else(String::new, |level| {
        format!("; ignored: {} in the same {}", number(ignored as u64), level.as_str())
    });
    tracing::info!(
        target: SAID,
        "{}, {} of them hard, between {} and {}{left_out}",
        plural(found.len() as u64, "clash", "clashes"),
        number(list.hard() as u64),
        plural(between.len() as u64, "object", "objects"),
        number(and.len() as u64),
    );
    Ok(found.len())
}

fn stopped() -> Failure {
    Failure::stopped("interrupted, and nothing was written")
}

/// A search with a progress bar, which Ctrl-C stops.
struct Watched {
    bar: ProgressBar,
    stop: Stop,
}

impl Watch for Watched {
    fn advance(&self, done: usize, of: usize) {
        self.bar.set_length(of as u64);
        self.bar.set_position(done as u64);
    }

    fn is_stopped(&self) -> bool {
        self.stop.requested()
    }
}

/// The clashes to write: their rows are made as they are written.
struct List<'l> {
    names: &'l ClashNames,
    args: &'l ClashArgs,
    found: &'l [Clearance],
    /// How many more there are that were to be ignored.
    ignored: usize,
    stop: &'l Stop,
}

impl List<'_> {
    fn hard(&self) -> usize {
        self.found.iter().filter(|clash| clash.is_hard()).count()
    }

    fn write_csv(&self, to: &mut dyn Write) -> io::Result<()> {
        let of_groups = if self.args.group.is_some() { CLASH_GROUP_COLUMNS } else { "" };
        write!(to, "{of_groups}{CLASH_COLUMNS}")?;
        match self.groups()? {
            Some(groups) => groups.iter().try_for_each(|group| to.write_all(group.to_csv().as_bytes()))?,
            None => self.each_row(|row| to.write_all(row.to_csv().as_bytes()))?,
        }
        let Some(level) = self.args.ignore else { return Ok(()) };
        let no_groups = ",".repeat(of_groups.matches(',').count());
        write!(to, "{no_groups}{}", ignored_csv(self.ignored, level))
    }

    fn write_json(&self, to: &mut dyn Write, sets: [&ObjectSet; 2]) -> io::Result<()> {
        let ClashArgs { scene, between, and, tolerance, ignore, group, .. } = self.args;
        let [first, second] = sets.map(|set| json!(set.len()));
        write!(
            to,
            "{{\n\"scene\": {},\n\"between\": {},\n\"and\": {},\n\"objects\": {},\n\"tolerance\": {},\n\
             \"hard\": {},\n\"ignore\": {},\n\"ignored\": {},\n\"group\": {},\n\"{}\": [",
            json!(scene.display().to_string()),
            json!(between),
            json!(and),
            json!([first, second]),
            json!(tolerance),
            json!(self.hard()),
            json!(ignore.map(|level| format!("same-{}", level.as_str()))),
            json!(self.ignored),
            json!(group),
            if group.is_some() { "groups" } else { "clashes" },
        )?;
        let mut before = "\n";
        let mut write = |text: serde_json::Result<String>| -> io::Result<()> {
            write!(to, "{before}{}", text?)?;
            before = ",\n";
            Ok(())
        };
        match self.groups()? {
            Some(groups) => groups.iter().try_for_each(|group| write(serde_json::to_string(group)))?,
            None => self.each_row(|row| write(serde_json::to_string(row)))?,
        }
        to.write_all(b"\n]\n}\n")
    }

    /// The pairs of groups, if they were asked for.
    fn groups(&self) -> io::Result<Option<Vec<ClashGroup>>> {
        let groups = |level| {
            self.go_on()?;
            self.names.groups(&self.name(), level, self.found).map_err(io::Error::other)
        };
        self.args.group.map(groups).transpose()
    }

    /// Makes the rows, unless it is stopped.
    fn each_row(&self, mut write: impl FnMut(&ClashRow) -> io::Result<()>) -> io::Result<()> {
        for clashes in self.found.chunks(AT_ONCE) {
            self.go_on()?;
            let rows = self.names.rows(&self.name(), clashes).map_err(io::Error::other)?;
            rows.iter().try_for_each(&mut write)?;
        }
        Ok(())
    }

    /// An error if it is to stop.
    fn go_on(&self) -> io::Result<()> {
        if self.stop.requested() { Err(io::ErrorKind::Interrupted.into()) } else { Ok(()) }
    }

    /// The model's name in links.
    fn name(&self) -> Cow<'_, str> {
        self.args.scene.file_stem().unwrap_or_default().to_string_lossy()
    }

    /// Why nothing was written.
    fn failure(&self, error: io::Error, what: &str) -> Failure {
        if self.stop.requested() { stopped() } else { Failure::broken(format!("{what}: {error}")) }
    }
}
