//! Scenes of real models.

use std::{
    fs,
    path::{Path, PathBuf},
    sync::{Arc, Mutex, PoisonError},
};

use trimaran_scene::Scene;

use super::data::{cooked, imported};

/// The file of a model's scene, cooked with the program's defaults: once for each build of the program.
pub(crate) fn scene_file(files: &[PathBuf]) -> PathBuf {
    static COOKING: Mutex<()> = Mutex::new(());
    let _alone = COOKING.lock().unwrap_or_else(PoisonError::into_inner);
    let program = blake3::hash(&fs::read(env!("CARGO_BIN_EXE_trimaran")).unwrap());
    let name = files[0].file_stem().unwrap().display();
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{name}.scenes"));
    let scene = folder.join(format!("{program}.scene"));
    if !scene.exists() {
        fs::create_dir_all(&folder).unwrap();
        let earlier: Vec<_> = fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path()).collect();
        cooked(&imported(files)).save(&scene).unwrap();
        // Those of earlier builds go.
        earlier.into_iter().filter(|path| *path != scene).for_each(|path| drop(fs::remove_file(path)));
    }
    scene
}

/// The scene in it.
pub(crate) fn scene_of(files: &[PathBuf]) -> Arc<Scene> {
    Arc::new(Scene::open(&scene_file(files)).unwrap())
}
