//! Real models, outside the repository: the folder in the environment variable `TRIMARAN_DATA`.

use std::{
    env, fs,
    path::{Path, PathBuf},
    process::{self, Command, Stdio},
    sync::Arc,
};

use trimaran_cook::{
    CookOptions, Model, cook,
    generate::{PlantOptions, plant},
    import::{ImportOptions, import},
};
use trimaran_scene::Scene;

/// The folder of real models.
pub(crate) struct Data {
    folder: PathBuf,
}

impl Data {
    /// Without the variable a test says that it is skipped, unless `TRIMARAN_REQUIRE_DATA` is 1.
    pub(crate) fn find() -> Option<Self> {
        let folder = env::var_os("TRIMARAN_DATA").map(PathBuf::from);
        if folder.is_none() {
            assert_ne!(env::var("TRIMARAN_REQUIRE_DATA").as_deref(), Ok("1"), "TRIMARAN_DATA is not set");
            println!("skipped: TRIMARAN_DATA is not set");
        }
        Some(Self { folder: folder? })
    }

    /// A file with the ground truth: `MODEL.views.json` or `MODEL.walk.json`.
    pub(crate) fn truth(&self, name: &str) -> PathBuf {
        self.folder.join("truth").join(name)
    }

    /// A small model of a kind supported by other readers.
    pub(crate) fn small(&self, name: &str) -> PathBuf {
        self.folder.join("imports").join(name)
    }

    /// The platform's eight review files.
    pub(crate) fn platform(&self) -> Vec<PathBuf> {
        let entries = fs::read_dir(self.folder.join("huldra")).unwrap();
        let mut files: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
        files.retain(|file| file.extension().is_some_and(|ending| ending == "RVM"));
        files.sort();
        assert_eq!(files.len(), 8, "{} is not the platform", self.folder.display());
        files
    }

    /// Unpacks `name`.xz into the tests' own folder, once.
    pub(crate) fn unpacked(&self, name: &str) -> PathBuf {
        let target = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
        if !target.exists() {
            let partial = target.with_extension(format!("part{}", process::id()));
            let status = Command::new("xz")
                .arg("-dc")
                .arg(self.folder.join(format!("{name}.xz")))
                .stdin(Stdio::null())
                .stdout(fs::File::create(&partial).unwrap())
                .status()
                .unwrap_or_else(|error| panic!("xz unpacks the data, and cannot be run: {error}"));
            assert!(status.success(), "xz could not unpack {name}");
            fs::rename(&partial, &target).unwrap();
        }
        target
    }
}

/// Imports with the program's defaults.
pub(crate) fn imported(files: &[PathBuf]) -> Model {
    import(files, &ImportOptions::default(), &mut |_| {}).unwrap().model
}

/// Cooks like the program.
pub(crate) fn cooked(model: &Model) -> Arc<Scene> {
    Arc::new(cook(model, &CookOptions::default(), &()).unwrap())
}

/// A generated plant that takes little time.
pub(crate) fn small_plant() -> Arc<Scene> {
    cooked(&plant(&PlantOptions { objects: 700, triangles: 70_000, ..PlantOptions::small(3) }))
}
