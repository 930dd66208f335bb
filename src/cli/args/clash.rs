//! Finding clashes.

use std::path::PathBuf;

use clap::{
    Args,
    builder::{PossibleValuesParser, TypedValueParser},
};
use trimaran_scene::GroupLevel;

#[derive(Debug, Args)]
#[command(
    after_help = "Exit codes: 0 no clash, 1 clashes found, 2 not searched, because a flag or a file cannot \
                        be used, 130 interrupted."
)]
pub(crate) struct ClashArgs {
    /// The scene.
    #[arg(value_name = "X.scene")]
    pub(crate) scene: PathBuf,
    /// One object of each pair is among those that this text finds, as in the page's search: by names and
    /// attributes [default: all objects].
    #[arg(long, value_name = "TEXT")]
    pub(crate) between: Option<String>,
    /// The other object is among those that this text finds [default: all others].
    #[arg(long, value_name = "TEXT", requires = "between")]
    pub(crate) and: Option<String>,
    /// Objects clash if they are this near, a length in mm, cm, m, in or ft. At 0mm they touch or intersect.
    #[arg(
        long,
        value_name = "LENGTH",
        default_value = "0mm",
        value_parser = length,
        allow_hyphen_values = true
    )]
    pub(crate) tolerance: f64,
    /// Leaves out pairs within the same group, and says how many there are: the part is the innermost named
    /// group around an object, the equipment the next one, the system the one after that.
    #[arg(long, value_name = "RULE", value_parser = levels(["same-part", "same-equipment", "same-system"]))]
    pub(crate) ignore: Option<GroupLevel>,
    /// Lists pairs of such groups: how many clashes each pair has, and the nearest one.
    #[arg(long, value_name = "LEVEL", value_parser = levels(["part", "equipment", "system"]))]
    pub(crate) group: Option<GroupLevel>,
    /// Where to write the clashes, as comma-separated values [default: standard output].
    #[arg(short, long, value_name = "X.csv")]
    pub(crate) out: Option<PathBuf>,
    /// Print them as JSON.
    #[arg(long)]
    pub(crate) json: bool,
    /// The most clashes, without those that are left out: beyond it nothing is written. They are kept in
    /// memory.
    #[arg(long, value_name = "N", default_value_t = 1_000_000)]
    pub(crate) most: usize,
}

/// Levels of groups by their names, which may stand behind `same-`.
fn levels(names: [&'static str; 3]) -> impl TypedValueParser<Value = GroupLevel> {
    PossibleValuesParser::new(names).try_map(|name| name.trim_start_matches("same-").parse::<GroupLevel>())
}

/// Units by name, in metres. The longer names first.
const UNITS: [(&str, f64); 5] = [("mm", 1e-3), ("cm", 1e-2), ("in", 0.0254), ("ft", 0.3048), ("m", 1.0)];
/// The longest length, metres.
const LONGEST: f64 = 1000.0;

/// A length in metres.
fn length(text: &str) -> Result<f64, String> {
    let with_unit = UNITS.iter().find_map(|(unit, metres)| Some((text.strip_suffix(unit)?, metres)));
    let metres = with_unit.and_then(|(number, metres)| Some(number.trim().parse::<f64>().ok()? * metres));
    match metres {
        Some(metres) if (0.0..=LONGEST).contains(&metres) => Ok(metres),
        Some(_) => Err(format!("a tolerance is from 0 to {LONGEST} m")),
        None => Err("give a number and its unit: 5mm, 1.5cm, 0.2m, 1in, 2ft".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_stand_behind_same_or_alone() {
        #[derive(Debug, clap::Parser)]
        struct Line {
            #[command(flatten)]
            args: ClashArgs,
        }
        let read = |more: &[&str]| {
            let line = <Line as clap::Parser>::try_parse_from([&["clash", "x.scene"], more].concat());
            line.map(|line| (line.args.ignore, line.args.group)).map_err(|error| error.to_string())
        };
        assert_eq!(read(&[]), Ok((None, None)));
        let both = read(&["--ignore", "same-equipment", "--group", "system"]);
        assert_eq!(both, Ok((Some(GroupLevel::Equipment), Some(GroupLevel::System))));
        for wrong in [&["--ignore", "equipment"], &["--group", "same-part"], &["--group", "zone"]] {
            assert!(read(wrong).unwrap_err().contains("possible values"), "{wrong:?}");
        }
    }

    #[test]
    fn a_length_has_a_unit() {
        for (text, metres) in
            [("5mm", 0.005), ("1.5 cm", 0.015), ("0.2m", 0.2), ("1in", 0.0254), ("2ft", 0.6096)]
        {
            assert!((length(text).unwrap() - metres).abs() < 1e-15, "{text}");
        }
        assert_eq!((length("0mm"), length("1000m")), (Ok(0.0), Ok(1000.0)));
        for wrong in ["5", "mm", "", "-1mm", "NaNm", "infm", "1000.1m", "5 parsec", "1,5mm"] {
            assert!(length(wrong).is_err(), "{wrong}");
        }
    }
}
