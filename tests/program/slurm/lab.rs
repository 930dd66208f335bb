//! A Slurm cluster of its own for a test: `lab.sh`, and command lines in it.

use std::{
    env, fs,
    io::{BufRead, BufReader, Write},
    path::Path,
    process::{Child, ChildStdin, ChildStdout, Command, Stdio},
    thread,
    time::{Duration, Instant},
};

use crate::common::program::Bench;

/// The timeout of waits.
const GUARD: Duration = Duration::from_secs(120);

/// A running cluster. It ends on drop, or with this process.
pub(super) struct Lab {
    /// The folder that jobs run in, with a scene.
    pub(super) bench: Bench,
    child: Child,
    /// Open until it must end.
    input: Option<ChildStdin>,
    output: BufReader<ChildStdout>,
}

impl Lab {
    /// `None`, which skips the test, if there can be none here and `TRIMARAN_REQUIRE_SLURM` is not set.
    pub(super) fn start() -> Option<Self> {
        if let Err(missing) = needs() {
            assert_ne!(env::var("TRIMARAN_REQUIRE_SLURM").as_deref(), Ok("1"), "{missing}");
            println!("skipped: {missing}");
            return None;
        }
        let bench = Bench::with_plant(60);
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/program/slurm/lab.sh");
        let folder = bench.path("");
        let mut command = bench.command_of(script.to_str().unwrap(), &[folder.to_str().unwrap()]);
        let program = Path::new(env!("CARGO_BIN_EXE_trimaran")).parent().unwrap();
        let path = format!("{}:/usr/sbin:/usr/bin:/sbin:/bin", program.display());
        command.env("PATH", path).stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = command.spawn().unwrap();
        let (input, output) = (child.stdin.take(), BufReader::new(child.stdout.take().unwrap()));
        let mut lab = Self { bench, child, input, output };
        let (code, said) = lab.answer();
        assert_eq!(code, "0", "{said}");
        Some(lab)
    }

    /// Runs a command line, which must succeed, and returns its output.
    pub(super) fn run(&mut self, line: &str) -> String {
        writeln!(self.input.as_mut().unwrap(), "{line}").unwrap();
        let (code, said) = self.answer();
        assert_eq!(code, "0", "{line}: {said}");
        said.trim_end().to_owned()
    }

    fn answer(&mut self) -> (String, String) {
        let mut said = String::new();
        loop {
            let mut line = String::new();
            assert!(self.output.read_line(&mut line).unwrap() > 0, "it has ended: {said}");
            if let Some(code) = line.strip_prefix("lab: ") {
                return (code.trim_end().to_owned(), said);
            }
            said.push_str(&line);
        }
    }

    /// Submits a script of `examples/slurm` after flags of `sbatch`, and returns the job's number.
    pub(super) fn submit(&mut self, job: &str) -> String {
        let words = job.split_whitespace().map(|word| match word.ends_with(".sbatch") {
            true => format!("{}/examples/slurm/{word}", env!("CARGO_MANIFEST_DIR")),
            false => word.to_owned(),
        });
        self.run(&format!("sbatch --parsable {}", words.collect::<Vec<_>>().join(" ")))
    }

    /// The state of a job, and its exit code.
    pub(super) fn state(&mut self, job: &str) -> String {
        let shown = self.run(&format!("scontrol --oneliner show job {job}"));
        let word = |key: &str| shown.split_whitespace().find_map(|word| word.strip_prefix(key)).unwrap();
        format!("{} {}", word("JobState="), word("ExitCode="))
    }

    /// Waits for a job's end; returns its last state.
    pub(super) fn ended(&mut self, job: &str) -> String {
        let goes_on = ["PENDING", "CONFIGURING", "RUNNING", "COMPLETING", "REQUEUED"];
        self.waits("the job's end", |lab| {
            let state = lab.state(job);
            (!goes_on.iter().any(|word| state.starts_with(word))).then_some(state)
        })
    }

    /// The output of a job and its steps.
    pub(super) fn log(&self, job: &str) -> String {
        let files = fs::read_dir(self.bench.path("")).unwrap().map(|entry| entry.unwrap().path());
        let name = |path: &Path| path.file_name().unwrap().to_string_lossy().into_owned();
        let log = files.filter(|path| name(path).ends_with(&format!("-{job}.log")));
        log.map(|path| fs::read_to_string(path).unwrap()).collect()
    }

    /// How many frames of an unfinished walk are on disk.
    pub(super) fn shown(&self, out: &str) -> usize {
        let journal = self.bench.path(out).join("unfinished/walk.jsonl");
        fs::read_to_string(journal).unwrap_or_default().matches("\n{\"frame\":").count()
    }

    /// Repeats a question until there is an answer.
    pub(super) fn waits<T>(&mut self, what: &str, mut answer: impl FnMut(&mut Self) -> Option<T>) -> T {
        let start = Instant::now();
        loop {
            if let Some(answer) = answer(self) {
                return answer;
            }
            assert!(start.elapsed() < GUARD, "{what} did not come about in {GUARD:?}");
            thread::sleep(Duration::from_millis(50));
        }
    }
}

impl Drop for Lab {
    fn drop(&mut self) {
        if thread::panicking() {
            let logs = ["slurmctld.log", "n0.log", "n1.log", "n2.log"];
            for log in logs.map(|name| self.bench.path("lab").join(name)) {
                eprintln!("{}: {}", log.display(), fs::read_to_string(&log).unwrap_or_default());
            }
        }
        drop(self.input.take());
        let _code = self.child.wait();
    }
}

/// Why there can be no cluster here, if so.
fn needs() -> Result<(), String> {
    if !rustix::process::geteuid().is_root() {
        return Err("a cluster of its own takes root".to_owned());
    }
    for program in ["/usr/sbin/slurmctld", "/usr/sbin/slurmd", "/usr/bin/sbatch", "/usr/bin/unshare"] {
        if !Path::new(program).exists() {
            return Err(format!("there is no {program}: install slurm-wlm"));
        }
    }
    let unshared = Command::new("unshare").args(["--mount", "--pid", "--net", "--fork", "true"]).output();
    match unshared.is_ok_and(|output| output.status.success()) {
        true => Ok(()),
        false => Err("namespaces are not permitted here".to_owned()),
    }
}
