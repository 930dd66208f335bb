//! The order of what a query finds: names that have the text as it was typed come before those in which only
//! the letters and digits are the same.

use std::mem;

use memchr::memmem::Finder;

use super::{
    index::Index,
    query::{Condition, Field, Query, Test},
    search::Found,
};

/// How a part fits the text of a query, the best first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Fit {
    /// Its name begins with the text, but for separators before it.
    Begins,
    /// Its name has the text at the start of a word.
    BeginsWord,
    /// Its name has the text elsewhere.
    Within,
    /// Its name has the text without its separators, or an attribute has it.
    Bare,
    /// It has the words of the text apart from each other.
    Apart,
}

/// For each fit the names that people gave and those that a program made up, and of both the text as whole
/// words and as a part of one.
const RANKS: usize = 4 * (Fit::Apart as usize + 1);

impl Index {
    /// Sorts the parts that a query has found. Of equal ones the order stays. A query with signs, or with
    /// `and`, `or` and `not`, has no text to sort by. `name_of` names a part by its number.
    pub fn rank<'n>(&self, query: &Query, found: &mut Found, name_of: impl Fn(u32) -> &'n str) {
        let Some(text) = &query.typed else { return };
        let side_by_side = query.phrase.as_ref().map(|phrase| {
            self.having(&Condition { field: Field::Any, test: Test::Contains(phrase.clone()) })
        });
        let (mut typed, mut name) = (String::new(), String::new());
        lower_case(text, &mut typed);
        let finder = Finder::new(&typed);
        let mut ranks: [Vec<u32>; RANKS] = Default::default();
        for part in mem::take(&mut found.parts) {
            lower_case(name_of(part), &mut name);
            let (fit, is_piece) = best_fit(&finder, &name).unwrap_or_else(|| {
                let is_apart = side_by_side.as_ref().is_some_and(|these| !these.contains(part as usize));
                (if is_apart { Fit::Apart } else { Fit::Bare }, false)
            });
            let rank = 4 * fit as usize + 2 * usize::from(is_made_up(&name)) + usize::from(is_piece);
            if let Some(rank) = ranks.get_mut(rank) {
                rank.push(part);
            }
        }
        found.parts = ranks.concat();
    }
}

/// Writes a text in lower case over another one. Most names are ASCII, which is much faster.
fn lower_case(text: &str, lower: &mut String) {
    lower.clear();
    if text.is_ascii() {
        lower.push_str(text);
        lower.make_ascii_lowercase();
    } else {
        lower.extend(text.chars().flat_map(char::to_lowercase));
    }
}

/// The best fit of a name that has the text, and whether the text ends within a word there.
fn best_fit(typed: &Finder<'_>, name: &str) -> Option<(Fit, bool)> {
    let at = |start: usize| {
        let end = start + typed.needle().len();
        let (before, text) = (name.get(..start)?, name.get(start..end)?);
        let fit = if !before.contains(char::is_alphanumeric) {
            Fit::Begins
        } else if is_edge(before.chars().next_back(), text.chars().next()) {
            Fit::BeginsWord
        } else {
            Fit::Within
        };
        Some((fit, !is_edge(text.chars().next_back(), name.get(end..)?.chars().next())))
    };
    typed.find_iter(name.as_bytes()).filter_map(at).min()
}

/// Whether a word begins or ends between two letters.
fn is_edge(before: Option<char>, after: Option<char>) -> bool {
    let (Some(before), Some(after)) = (before, after) else { return true };
    let are_alike = before.is_numeric() == after.is_numeric();
    !(before.is_alphanumeric() && after.is_alphanumeric() && are_alike)
}

/// Whether a program made up this name, in lower case, for a part without one: `box 1 of equipment /20-ce50`.
fn is_made_up(name: &str) -> bool {
    let number = name.trim_start_matches(|letter: char| letter.is_ascii_alphabetic());
    let Some(digits) = number.strip_prefix(' ').filter(|_| number.len() < name.len()) else { return false };
    let of = digits.trim_start_matches(|letter: char| letter.is_ascii_digit());
    of.len() < digits.len() && of.starts_with(" of ")
}

#[cfg(test)]
mod tests {
    use trimaran_scene::{Attribute, Hierarchy, ObjectAttributes};

    use super::*;

    /// The names that a query finds among these, in their order.
    fn ranked<'n>(query: &str, names: &[&'n str], hierarchy: &Hierarchy) -> Vec<&'n str> {
        let index = Index::new(hierarchy, names.iter()).unwrap();
        let query = Query::parse(query).unwrap();
        let mut found = index.find(&query, &|| false).unwrap().unwrap();
        index.rank(&query, &mut found, |part| names[part as usize]);
        found.parts.iter().map(|part| names[*part as usize]).collect()
    }

    #[track_caller]
    fn ranks(query: &str, names: &[&str], expected: &[&str]) {
        assert_eq!(ranked(query, names, &Hierarchy::default()), expected, "{query}");
    }

    #[test]
    fn a_name_that_begins_with_the_text_as_typed_comes_first() {
        let names = ["/77-TSH2020", "/64-PCV2020", "/A20-2051", "/63-20-2055", "/20-2051PL", "20-2071PL"];
        // In `A20` a word begins at the digit.
        let expected = ["/20-2051PL", "20-2071PL", "/A20-2051", "/63-20-2055", "/77-TSH2020", "/64-PCV2020"];
        for query in ["20-20", "\"20-20\"", "name:20-20"] {
            ranks(query, &names, &expected);
        }
        // A query with other signs or words keeps the order of the model.
        ranks("20-20 and 20", &names, &names);
    }

    #[test]
    fn separators_are_forgiven_last() {
        let names = ["/2\"-DS-562004-AS200-B1", "/120-CE1", "/20-2051PL", "/20_1", "/P-20-X"];
        ranks("20-", &names, &["/20-2051PL", "/P-20-X", "/120-CE1", "/2\"-DS-562004-AS200-B1", "/20_1"]);
        ranks("/20-", &names, &["/20-2051PL", "/2\"-DS-562004-AS200-B1", "/120-CE1", "/20_1", "/P-20-X"]);
    }

    #[test]
    fn names_of_people_come_before_those_that_a_program_made_up() {
        let made_up = "BOX 1 of EQUIPMENT 2 of /20-2071PL";
        ranks("2071", &[made_up, "/20-2071PL"], &["/20-2071PL", made_up]);
        // Only within a rank.
        ranks("2071", &["/12071", made_up, "/2-0-7-1"], &[made_up, "/12071", "/2-0-7-1"]);
        for (name, expected) in [
            ("CYLINDER 12 of /X", true),
            ("BOX 1 of", false),
            ("BOX 1", false),
            (" 1 of X", false),
            ("BOX  of X", false),
            ("BOX1 of X", false),
            ("1 of X", false),
            ("/BOX 1 of X", false),
            ("", false),
        ] {
            assert_eq!(is_made_up(&name.to_lowercase()), expected, "{name}");
        }
    }

    #[test]
    fn whole_words_come_before_pieces_of_words() {
        let names = ["HA-HVAC.RVM", "/63-HV2067", "/XHV", "HVAC", "BOX 1 of /63-HV2067", "HV-1"];
        ranks("HV", &names, &["HV-1", "HVAC", "/63-HV2067", "HA-HVAC.RVM", "BOX 1 of /63-HV2067", "/XHV"]);
        ranks("hv 2067", &names, &["/63-HV2067", "BOX 1 of /63-HV2067"]);
        // The best place in a name counts.
        ranks("ab", &["xab-abc", "xab", "xab-ab"], &["xab-ab", "xab-abc", "xab"]);
    }

    #[test]
    fn words_side_by_side_come_before_words_apart_whatever_their_case() {
        let names = ["CE-50/20", "20-CE50", "x20 ce50", "20 CE50"];
        ranks("20 ce50", &names, &["20 CE50", "x20 ce50", "20-CE50", "CE-50/20"]);
        ranks("größe", &["xgröße", "GRÖSSE", "GRÖßE-1"], &["GRÖßE-1", "xgröße"]);
        let valve = Attribute { name: "Type".into(), value: "ball valve".into() };
        let attributes = vec![ObjectAttributes { object: 0, attributes: vec![valve] }];
        let hierarchy = Hierarchy { groups: Vec::new(), attributes };
        assert_eq!(ranked("valve", &["HV-1", "VALVE-2"], &hierarchy), ["VALVE-2", "HV-1"]);
    }
}
