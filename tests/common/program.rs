//! The program in a folder of its own, and its processes with their output.

use std::{
    fs,
    io::{BufRead, BufReader, Read},
    path::PathBuf,
    process::{Child, ChildStderr, Command, Output, Stdio},
};

use serde_json::Value;
use tempfile::TempDir;

/// A folder that the program runs in.
pub(crate) struct Bench(TempDir);

impl Bench {
    pub(crate) fn empty() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    /// With a cooked plant of this many objects, `plant.scene`.
    pub(crate) fn with_plant(objects: u32) -> Self {
        let bench = Self::empty();
        bench.done(&["generate", "plant", "--objects", &objects.to_string(), "-o", "plant.scene"]);
        bench
    }

    /// With a small red square behind a large one of blue glass, `glass.scene`, and this many poses before
    /// the middle of both, `path.json`.
    pub(crate) fn with_glass(poses: usize) -> Self {
        let bench = Self::empty();
        bench.write("glass.mtl", "newmtl red\nKd 1 0 0\nnewmtl glass\nKd 0 0 1\nd 0.2\n");
        let square = |first: u32, material: &str, half: f64, z: f64| {
            let corners = [[-half, -half], [half, -half], [half, half], [-half, half]];
            let corners = corners.map(|[x, y]| format!("v {x} {y} {z}\n")).concat();
            let rest = format!("{} {} {}", first + 1, first + 2, first + 3);
            format!("o {material}\nusemtl {material}\n{corners}f {first} {rest}\n")
        };
        let squares = [square(1, "red", 1.0, 0.0), square(5, "glass", 3.0, 2.0)].concat();
        bench.write("glass.obj", format!("mtllib glass.mtl\n{squares}"));
        bench.done(&["import", "glass.obj", "-o", "glass.scene"]);
        let poses = vec![r#"{"eye":[0,0,8],"forward":[0,0,-1],"up":[0,1,0]}"#; poses].join(",");
        bench.write("path.json", format!(r#"{{"vfov_deg":50,"near":0.1,"frames":[{poses}]}}"#));
        bench
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub(crate) fn write(&self, name: &str, contents: impl AsRef<[u8]>) {
        fs::write(self.path(name), contents).unwrap();
    }

    pub(crate) fn command(&self, args: &[&str]) -> Command {
        self.command_of(env!("CARGO_BIN_EXE_trimaran"), args)
    }

    /// A command of another program in the same folder.
    pub(crate) fn command_of(&self, program: &str, args: &[&str]) -> Command {
        let mut command = Command::new(program);
        command.args(args).current_dir(self.0.path());
        command
    }

    pub(crate) fn trimaran(&self, args: &[&str]) -> Output {
        self.command(args).output().unwrap()
    }

    /// Runs the program, which must succeed; returns its output.
    pub(crate) fn done(&self, args: &[&str]) -> String {
        printed(&self.trimaran(args))
    }

    pub(crate) fn start(&self, args: &[&str]) -> Process {
        Process::start(&mut self.command(args))
    }

    /// The report in the folder `out`.
    pub(crate) fn report(&self, out: &str) -> Value {
        serde_json::from_slice(&fs::read(self.path(out).join("report.json")).unwrap()).unwrap()
    }
}

/// The output of a program that must have succeeded.
pub(crate) fn printed(output: &Output) -> String {
    assert!(output.status.success(), "{}", said(output));
    String::from_utf8(output.stdout.clone()).unwrap()
}

/// A program's output on standard error.
pub(crate) fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// A running program with its output. It is killed on drop.
pub(crate) struct Process {
    child: Child,
    stderr: BufReader<ChildStderr>,
    said: String,
}

impl Process {
    pub(crate) fn start(command: &mut Command) -> Self {
        let mut child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
        let stderr = BufReader::new(child.stderr.take().unwrap());
        Self { child, stderr, said: String::new() }
    }

    pub(crate) fn id(&self) -> u32 {
        self.child.id()
    }

    /// Reads its output up to a line with `words`.
    pub(crate) fn says(&mut self, words: &str) -> String {
        self.says_all(&[words])
    }

    /// The same for a line with all of `words`.
    pub(crate) fn says_all(&mut self, words: &[&str]) -> String {
        loop {
            let mut line = String::new();
            assert!(self.stderr.read_line(&mut line).unwrap() > 0, "{words:?} is not in: {}", self.said);
            self.said.push_str(&line);
            if words.iter().all(|word| line.contains(word)) {
                return line;
            }
        }
    }

    pub(crate) fn signal(&self, name: &str) {
        signal(name, &self.id().to_string());
    }

    pub(crate) fn kill(self) {}

    /// Waits for its end with this exit code; returns all its output.
    pub(crate) fn ends(self, code: i32) -> String {
        let (ended, said) = self.ended();
        assert_eq!(ended, Some(code), "{said}");
        said
    }

    /// Waits for its end; returns its exit code, and all its output.
    pub(crate) fn ended(mut self) -> (Option<i32>, String) {
        self.stderr.read_to_string(&mut self.said).unwrap();
        (self.child.wait().unwrap().code(), std::mem::take(&mut self.said))
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        // It may have ended already.
        let _ended = self.child.kill();
        let _ended = self.child.wait();
    }
}

/// By the shell's own `kill`: some machines lack the program of that name.
pub(crate) fn signal(name: &str, process: &str) {
    let kill = format!("kill -{name} {process}");
    assert!(Command::new("sh").args(["-c", &kill]).status().unwrap().success());
}
