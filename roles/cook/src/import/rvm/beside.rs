//! The attribute files of an RVM file: beside it under its name, or else in a folder of its name. Case is
//! ignored: models come from Windows.

use std::fs::{self, File};
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use super::attributes::{Attributes, OddLines, is_attributes};
use super::encoding::Encoding;
use crate::import::budget::{Budget, OverBudget};
use crate::import::neighbours::Neighbours;
use crate::import::report::{ImportReport, WarningKind};

/// The endings of attribute files. Names with exactly this case come first.
const ENDINGS: [&str; 4] = ["att", "ATT", "txt", "TXT"];

/// How many first bytes identify an attribute file.
const START: u64 = 256;

/// The attributes of the groups of the file at `path`, whose names are in `encoding`; none without attribute
/// files.
pub(super) fn attributes_of(
    path: &Path,
    encoding: Encoding,
    budget: &Budget,
    report: &mut ImportReport,
) -> Result<Option<Attributes>, OverBudget> {
    let mut all = Attributes::default();
    let mut neighbours = Neighbours::of(Some(path), budget);
    let mut in_any_case = |path: &Path| neighbours.in_any_case(Path::new(path.file_name()?));
    let named = ENDINGS.map(|ending| path.with_extension(ending));
    let mut files = named.to_vec();
    files.extend(named.iter().filter_map(|path| in_any_case(path)).filter(|path| !named.contains(path)));
    files.dedup();
    for file in files {
        if add(&mut all, &file, encoding, budget, report)? {
            return Ok(Some(all));
        }
    }
    let folder = path.with_extension("");
    // For a file without an ending this would be the file itself.
    if folder == path {
        return Ok(None);
    }
    let folder = if folder.is_dir() { folder } else { in_any_case(&folder).unwrap_or(folder) };
    let mut any = false;
    for file in files_of(&folder, budget) {
        any |= add(&mut all, &file, encoding, budget, report)?;
    }
    Ok(any.then_some(all))
}

/// The files with such an ending in a folder, in order.
fn files_of(folder: &Path, budget: &Budget) -> Vec<PathBuf> {
    budget.look_for(folder);
    let files = fs::read_dir(folder).into_iter().flatten().filter_map(|file| Some(file.ok()?.path()));
    let is_named_so = |file: &PathBuf| {
        let of_file = file.extension().unwrap_or_default();
        ENDINGS.iter().any(|ending| of_file.eq_ignore_ascii_case(ending))
    };
    let mut files: Vec<PathBuf> = files.filter(is_named_so).collect();
    files.sort();
    files
}

/// Adds the content of a file, if it is an attribute file. Each of its bytes counts.
fn add(
    all: &mut Attributes,
    path: &Path,
    encoding: Encoding,
    budget: &Budget,
    report: &mut ImportReport,
) -> Result<bool, OverBudget> {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let mut unread =
        |why: &str| report.warn_about(WarningKind::AttributesUnread, &format!("{name}: {why}"), 1);
    let (file, mut bytes) = match started(path, budget) {
        Ok(started) => started,
        Err(error) => {
            if error.kind() != io::ErrorKind::NotFound {
                unread(&error.to_string());
            }
            return Ok(false);
        }
    };
    if !is_attributes(&encoding.decode_file(&bytes)) {
        // A text beside a model may be anything.
        if path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("att")) {
            unread("it does not begin as an attribute file does");
        }
        return Ok(false);
    }
    let length = file.metadata().map_or(0, |file| file.len());
    budget.attributes(length, || format!("the attribute file {name:?}"))?;
    if let Err(error) = file.take(length).read_to_end(&mut bytes) {
        unread(&error.to_string());
        return Ok(false);
    }
    if let Some(OddLines { count, first, text }) = all.add(&encoding.decode_file(&bytes)) {
        let detail = format!("{name}, first at line {first}: {text:?}");
        report.warn_about(WarningKind::AttributeLineLeftOut, &detail, count);
    }
    Ok(true)
}

/// A file and its first bytes.
fn started(path: &Path, budget: &Budget) -> io::Result<(File, Vec<u8>)> {
    let file = budget.open(path)?;
    let mut start = Vec::new();
    (&file).take(START).read_to_end(&mut start)?;
    Ok((file, start))
}
