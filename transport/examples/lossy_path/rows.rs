//! The requested rows of the table.

use std::error::Error;
use std::path::PathBuf;

use crate::relay::{LOSSES, Loss};
use crate::session::{KINDS, Kind};

/// So many seconds make 3,600 frames, of which three or four are beyond p99.9.
const SECONDS: u32 = 60;

/// Each link over each path.
pub(crate) struct Rows {
    pub(crate) seconds: u32,
    pub(crate) losses: Vec<Loss>,
    pub(crate) kinds: Vec<&'static Kind>,
    /// The file for the chart.
    pub(crate) chart: Option<PathBuf>,
}

impl Rows {
    /// Parses the seconds a row takes, words that name losses and links (none means all), and the file of a
    /// chart.
    pub(crate) fn parse(args: impl Iterator<Item = String>) -> Result<Self, Box<dyn Error>> {
        let (mut seconds, mut names, mut chart) = (SECONDS, Vec::new(), None);
        for arg in args {
            match arg.parse() {
                Ok(number) => seconds = number,
                Err(_) if arg.ends_with(".svg") => chart = Some(arg.into()),
                Err(_) => names.push(arg),
            }
        }
        let words = || LOSSES.iter().map(|loss| loss.word).chain(KINDS.iter().map(|kind| kind.word));
        if let Some(unknown) = names.iter().find(|name| !words().any(|word| word == *name)) {
            let words: Vec<_> = words().collect();
            return Err(format!(
                "there is no {unknown:?}: name seconds, a file that ends in .svg, or any of {}",
                words.join(", ")
            )
            .into());
        }
        let named = |word: &str| names.iter().any(|name| name == word);
        let any_loss = !LOSSES.iter().any(|loss| named(loss.word));
        let any_kind = !KINDS.iter().any(|kind| named(kind.word));
        let losses = LOSSES.iter().filter(|loss| any_loss || named(loss.word)).copied().collect();
        let kinds = KINDS.iter().filter(|kind| any_kind || named(kind.word)).collect();
        Ok(Self { seconds, losses, kinds, chart })
    }
}
