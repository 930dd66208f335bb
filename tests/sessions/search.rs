//! A short search for a frame whose pixels culling changes.

use tokio::runtime::Runtime;
use trimaran::audit::Search;
use trimaran_actors::Stop;
use trimaran_gpu::GpuOptions;

use crate::common::devices;

#[test]
fn a_short_search_finds_nothing() {
    let Some(_) = devices() else { return };
    let runtime = Runtime::new().unwrap();
    let mut search = Search::open(GpuOptions::default(), runtime.handle()).unwrap();
    let (_stopper, stop) = Stop::new();
    for seed in 0..8 {
        let begun = std::time::Instant::now();
        let found = search.trial(seed, &stop).unwrap();
        println!("{seed}: {:?} {:?}", begun.elapsed(), search.counts());
        for (kept, wrong) in found {
            println!("{:?} {:?} {wrong:?}", kept.culling, kept.opening);
            let mut tries = 0;
            let (least, wrong) = search.shrink(kept, wrong, &stop, || tries += 1);
            println!("{wrong}: {tries} tries {}", serde_json::to_string(&least).unwrap());
        }
    }
}
