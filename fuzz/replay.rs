//! Replays the corpus of fuzz targets. Ordinary tests include this file by its path, with a table of targets.

use std::fs;
use std::path::Path;

use proptest::prelude::*;
use proptest::sample::Index;

/// A target: its name, how many inputs its corpus has at least, and what must hold for any bytes.
pub type Target = (&'static str, usize, fn(&[u8]));

/// The names and inputs of a target's corpus.
pub fn corpus(target: &str) -> Vec<(String, Vec<u8>)> {
    let packages = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors();
    let mut folders = packages.map(|package| package.join("fuzz/corpus").join(target));
    let files = fs::read_dir(folders.find(|folder| folder.is_dir()).unwrap()).unwrap();
    let mut paths: Vec<_> = files.map(|file| file.unwrap().path()).collect();
    paths.sort();
    let name = |path: &Path| path.file_name().unwrap().to_str().unwrap().to_owned();
    paths.iter().map(|path| (name(path), fs::read(path).unwrap())).collect()
}

/// Checks every input as it is.
pub fn replay(targets: &[Target]) {
    for (target, least, check) in targets {
        let inputs = corpus(target);
        assert!(inputs.len() >= *least, "only {} inputs of {target}: is the corpus there?", inputs.len());
        inputs.iter().for_each(|(_, input)| check(input));
    }
}

/// Checks `cases` inputs of each target with up to three bytes broken. Each is `joined` inputs of the corpus,
/// one behind the other.
pub fn replay_broken(targets: &[Target], cases: u32, joined: usize) {
    let corpora: Vec<_> = targets.iter().map(|(target, ..)| corpus(target)).collect();
    proptest!(ProptestConfig { cases, ..ProptestConfig::default() }, |(
        which in prop::collection::vec(any::<Index>(), joined),
        broken in prop::collection::vec((any::<Index>(), any::<u8>()), 0..4),
    )| {
        for ((_, _, check), inputs) in targets.iter().zip(&corpora) {
            let mut input: Vec<u8> = which.iter().flat_map(|which| which.get(inputs).1.clone()).collect();
            for (at, byte) in &broken {
                if !input.is_empty() {
                    let at = at.index(input.len());
                    input[at] = *byte;
                }
            }
            check(&input);
        }
    });
}
