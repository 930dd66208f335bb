//! A short search for a frame whose pixels culling changes, and what longer ones have found.

use std::{fs, path::Path};

use tokio::runtime::Runtime;
use trimaran::audit::{Figures, Judgement, KeptTrial, Opening, Search, TrialCulling, TrialOnDevice, Wrong};
use trimaran_actors::Stop;
use trimaran_audit::search::Trial;
use trimaran_gpu::{Gpu, GpuOptions};

use crate::common::devices;

/// A search with validation, if there is a device.
fn search(runtime: &Runtime) -> Option<Search> {
    devices()?;
    let options = GpuOptions { validation: true, ..GpuOptions::default() };
    Some(Search::open(options, runtime.handle()).unwrap())
}

#[test]
fn a_short_search_finds_nothing() {
    let runtime = Runtime::new().unwrap();
    let Some(mut search) = search(&runtime) else { return };
    let (_stopper, stop) = Stop::new();
    for seed in 0..2 {
        if let Some((kept, wrong)) = search.trial(seed, &stop).unwrap().first() {
            panic!("seed {seed}, {}: {wrong}: {}", kept.culling, serde_json::to_string(&kept).unwrap());
        }
    }
    let counts = search.counts();
    assert_eq!((counts.trials, counts.wrong_pixels, counts.lost_nodes), (2, 0, 0));
    assert!(counts.frames >= 960 && counts.drawn * 10 < counts.whole * 9, "{counts:?}");
}

/// Walks all that is kept in a folder, in every system.
fn walk_kept(folder: &str, check: impl Fn(&str, Figures, Judgement)) {
    let Some([gpu, ..]) = devices() else { return };
    let runtime = Runtime::new().unwrap();
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("lab/audit/tests").join(folder);
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let kept: KeptTrial = serde_json::from_str(&fs::read_to_string(&path).unwrap()).unwrap();
        let Opening { gpu_memory, check_device, .. } = kept.opening;
        let gpu = match (gpu_memory, check_device) {
            (None, false) => gpu.clone(),
            (memory, check_traversals) => {
                Gpu::open(&GpuOptions { validation: true, memory, check_traversals, ..GpuOptions::default() })
                    .unwrap()
            }
        };
        let mut on_device = TrialOnDevice::new(&kept.trial, &gpu, runtime.handle()).unwrap();
        for culling in TrialCulling::all() {
            let (figures, judgement) = on_device.judged(culling).unwrap();
            let at = format!("{}, {culling}: {figures:?}, {judgement:?}", path.display());
            assert_eq!(figures.frames as usize, kept.trial.frames.len(), "{at}");
            check(&at, figures, judgement);
        }
    }
}

#[test]
fn kept_walks_are_exact_in_every_system() {
    walk_kept("kept", |at, figures, _| assert!(figures.is_exact(), "{at}"));
}

/// A driver may draw a face that is seen edge on before what hides it. Culling it then makes the picture
/// right.
#[test]
fn where_a_driver_is_wrong_the_culled_picture_is_not() {
    walk_kept("kept_of_drivers", |at, figures, judgement| {
        let Judgement { driver, culler, neither, blended } = judgement;
        assert_eq!((culler, blended, driver + neither), (0, 0, figures.wrong_pixels), "{at}");
        assert!(driver >= neither, "{at}");
    });
}

/// A device without memory for any drawable fails, and one object and one frame are enough to show it.
#[test]
fn a_walk_that_fails_is_shrunk_on_the_device() {
    let runtime = Runtime::new().unwrap();
    let Some(mut search) = search(&runtime) else { return };
    let (_stopper, stop) = Stop::new();
    let culling = TrialCulling::all()[0];
    let opening = Opening { gpu_memory: Some(64), check_device: false };
    let kept = KeptTrial { culling, opening, trial: Trial::draw(1, 6) };
    let wrong = search.replay(&kept).unwrap().unwrap();
    assert!(matches!(wrong, Wrong::Error(_)), "{wrong}");
    let mut tries = 0;
    let (least, wrong) = search.shrink(kept, wrong, &stop, || tries += 1);
    assert!(wrong.to_string().contains("the budget is 64"), "{wrong}");
    assert_eq!((least.trial.solids.len(), least.trial.frames.len()), (1, 1));
    assert!(tries > 10);
    let text = serde_json::to_string(&least).unwrap();
    assert_eq!(serde_json::from_str::<KeptTrial>(&text).unwrap(), least);
}
