//! Cooking with progress, and saving: shared by `import`, `generate` and `demo`.

use std::{path::Path, sync::Mutex};

use indicatif::ProgressBar;
use trimaran::page::Preparation;
use trimaran_cook::{CookOptions, Model, Phase, Progress, cook};
use trimaran_scene::Scene;

use super::{Failure, progress};

/// Cooks `model` and writes the scene to `output`. Its progress is in `preparation` as well.
pub(super) fn cook_and_save(
    model: &Model,
    options: &CookOptions,
    output: &Path,
    preparation: &Preparation,
) -> Result<Scene, Failure> {
    let shown = Shown { bar: Mutex::new(None), preparation };
    let scene = cook(model, options, &shown).map_err(Failure::bad_input)?;
    drop(shown);
    preparation.begin("saving", 0);
    scene.save(output).map_err(Failure::broken)?;
    Ok(scene)
}

/// Cooking's progress as a bar for each stage.
struct Shown<'p> {
    bar: Mutex<Option<ProgressBar>>,
    preparation: &'p Preparation,
}

impl Shown<'_> {
    fn bar(&self, change: impl FnOnce(&mut Option<ProgressBar>)) {
        // A poisoned lock means that cooking has panicked: there is no progress to show then.
        if let Ok(mut bar) = self.bar.lock() {
            change(&mut bar);
        }
    }
}

impl Progress for Shown<'_> {
    fn begin(&self, phase: Phase, steps: usize) {
        let what = match phase {
            Phase::Levels => "levels",
            Phase::Tree => "tree",
            Phase::Merging => "merging",
            Phase::Assembling => "assembling",
        };
        self.preparation.begin(what, steps);
        self.bar(|bar| {
            if let Some(done) = bar.replace(progress::bar(what, steps as u64)) {
                done.finish_and_clear();
            }
        });
    }

    fn advance(&self, steps: usize) {
        self.preparation.advance(steps);
        self.bar(|bar| {
            if let Some(bar) = bar {
                bar.inc(steps as u64);
            }
        });
    }
}

impl Drop for Shown<'_> {
    fn drop(&mut self) {
        self.bar(|bar| {
            if let Some(last) = bar.take() {
                last.finish_and_clear();
            }
        });
    }
}
