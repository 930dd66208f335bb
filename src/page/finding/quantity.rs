//! Numbers with units, as attributes have them: `150 mm`.

use std::cmp::Ordering;

/// A number with a unit, as written.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Quantity {
    /// Finite.
    pub(super) value: f64,
    /// In lower case; empty without one.
    pub(super) unit: String,
}

/// Units that are converted: name, what it measures, and how many of the base unit it is.
const UNITS: [(&str, char, f64); 17] = [
    ("mm", 'l', 1e-3),
    ("cm", 'l', 1e-2),
    ("m", 'l', 1.0),
    ("km", 'l', 1e3),
    ("in", 'l', 0.0254),
    ("inch", 'l', 0.0254),
    ("\"", 'l', 0.0254),
    ("ft", 'l', 0.3048),
    ("'", 'l', 0.3048),
    ("g", 'm', 1e-3),
    ("kg", 'm', 1.0),
    ("t", 'm', 1e3),
    ("pa", 'p', 1.0),
    ("kpa", 'p', 1e3),
    ("mpa", 'p', 1e6),
    ("mbar", 'p', 1e2),
    ("bar", 'p', 1e5),
];

/// The most bytes of a unit.
const LONGEST_UNIT: usize = 16;

/// Numbers that differ relatively by less are equal: conversions round.
const ROUNDING: f64 = 1e-9;

impl Quantity {
    /// A number, perhaps with a unit; `None` if the text is anything else.
    pub(super) fn parse(text: &str) -> Option<Self> {
        let text = text.trim();
        let end = number_end(text.as_bytes())?;
        let (number, unit) = text.split_at_checked(end)?;
        let value: f64 = number.parse().ok()?;
        let unit = unit.trim_start();
        (value.is_finite() && is_unit(unit)).then(|| Self { value, unit: unit.to_lowercase() })
    }
}

/// Whether a word is a unit for sure. `in` may be any word.
pub(super) fn is_known_unit(word: &str) -> bool {
    let word = word.to_lowercase();
    word != "in" && UNITS.iter().any(|(name, ..)| *name == word)
}

/// The factor from numbers of one unit to numbers of another; `None` if they cannot be compared. A number
/// without a unit is compared as it stands.
pub(super) fn factor(from: &str, to: &str) -> Option<f64> {
    if from.is_empty() || to.is_empty() || from == to {
        return Some(1.0);
    }
    let of = |unit: &str| UNITS.iter().find(|(name, ..)| *name == unit);
    let ((_, one, from), (_, other, to)) = (of(from)?, of(to)?);
    (one == other).then(|| from / to)
}

/// The order of two numbers, which are equal within the rounding of conversions.
pub(super) fn compare(one: f64, other: f64) -> Ordering {
    if (one - other).abs() <= ROUNDING * one.abs().max(other.abs()) {
        return Ordering::Equal;
    }
    one.total_cmp(&other)
}

/// The end of the decimal number with which a text begins.
fn number_end(text: &[u8]) -> Option<usize> {
    let digits = |from: usize| {
        let rest = text.get(from..).unwrap_or_default();
        from + rest.iter().take_while(|byte| byte.is_ascii_digit()).count()
    };
    let is = |at: usize, any: &[u8]| text.get(at).is_some_and(|byte| any.contains(byte));
    let first = usize::from(is(0, b"+-"));
    let whole = digits(first);
    let point = usize::from(is(whole, b"."));
    let mut end = if point == 1 { digits(whole + 1) } else { whole };
    if end - first - point == 0 {
        return None;
    }
    if is(end, b"eE") {
        let power = end + 1 + usize::from(is(end + 1, b"+-"));
        if digits(power) > power {
            end = digits(power);
        }
    }
    Some(end)
}

fn is_unit(text: &str) -> bool {
    let is_part = |(at, letter): (usize, char)| {
        letter.is_alphabetic() || "°%\"'/²³·".contains(letter) || (at > 0 && "23".contains(letter))
    };
    // `1/2` is no number of halves.
    text.len() <= LONGEST_UNIT && !text.starts_with('/') && text.char_indices().all(is_part)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_quantity_is_a_number_and_perhaps_a_unit() {
        for (text, value, unit) in [
            ("150", 150.0, ""),
            (" -1.5e3 MM ", -1500.0, "mm"),
            ("+.5bar", 0.5, "bar"),
            ("7.", 7.0, ""),
            ("12 kg/m3", 12.0, "kg/m3"),
            ("3EA", 3.0, "ea"),
            ("60°C", 60.0, "°c"),
            ("1\"", 1.0, "\""),
            ("2e-3 m", 0.002, "m"),
            ("2e+3", 2000.0, ""),
            ("1 m2", 1.0, "m2"),
        ] {
            assert_eq!(Quantity::parse(text), Some(Quantity { value, unit: unit.into() }), "{text}");
        }
        for text in
            ["", "-", ".", "mm", "20-CE50", "20CE50", "1 2", "1,5", "1e999", "nan", "inf", "5 m m", "1/2"]
        {
            assert_eq!(Quantity::parse(text), None, "{text}");
        }
        assert_eq!(Quantity::parse(&format!("1 {}", "m".repeat(LONGEST_UNIT + 1))), None);
        assert!(Quantity::parse(&format!("1 {}", "m".repeat(LONGEST_UNIT))).is_some());
        assert_eq!(Quantity::parse(&"9".repeat(5000)), None, "beyond all numbers");
    }

    #[test]
    fn units_of_one_kind_are_compared_and_others_are_not() {
        assert_eq!(factor("mm", "m"), Some(1e-3));
        assert_eq!(compare(0.1, 100.0 * factor("mm", "m").unwrap()), Ordering::Equal);
        for (from, to, times) in [
            ("cm", "m", 0.01),
            ("km", "m", 1000.0),
            ("in", "m", 0.0254),
            ("inch", "m", 0.0254),
            ("\"", "m", 0.0254),
            ("ft", "m", 0.3048),
            ("'", "m", 0.3048),
            ("g", "kg", 0.001),
            ("t", "kg", 1000.0),
            ("kpa", "pa", 1000.0),
            ("mpa", "pa", 1e6),
            ("mbar", "pa", 100.0),
            ("bar", "pa", 1e5),
        ] {
            assert_eq!(factor(from, to), Some(times), "{from}");
        }
        assert_eq!((factor("bar", "m"), factor("kg", "pa"), factor("kg", "m")), (None, None, None));
        assert_eq!((factor("", "m"), factor("m", ""), factor("ea", "ea")), (Some(1.0), Some(1.0), Some(1.0)));
        assert_eq!(factor("ea", "m"), None);
        assert!(is_known_unit("MM") && !is_known_unit("in") && !is_known_unit("valve"));
    }

    #[test]
    fn numbers_are_equal_within_rounding() {
        assert_eq!(compare(0.1 + 0.2, 0.3), Ordering::Equal);
        assert_eq!(compare(1.0, 1.0 + 5e-10), Ordering::Equal);
        assert_eq!(compare(1.0, 1.0 + 2e-9), Ordering::Less);
        assert_eq!(compare(-1e6, -1e6 - 2e-3), Ordering::Greater);
        assert_eq!(compare(0.0, -0.0), Ordering::Equal);
        assert_eq!(compare(1.0, 1.000_001), Ordering::Less);
        assert_eq!(compare(-1.0, 1.0), Ordering::Less);
        assert_eq!(compare(1e300, -1e300), Ordering::Greater);
    }

    proptest! {
        #[test]
        fn any_text_is_a_finite_quantity_or_none(text in any::<String>()) {
            if let Some(Quantity { value, .. }) = Quantity::parse(&text) {
                prop_assert!(value.is_finite());
            }
        }

        #[test]
        fn a_written_number_is_read_back(value in -1e15..1e15_f64, unit in "(|mm|bar)") {
            let read = Quantity::parse(&format!("{value} {unit}"));
            prop_assert_eq!(read, Some(Quantity { value, unit }));
        }
    }
}
