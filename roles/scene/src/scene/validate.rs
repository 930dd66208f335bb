//! What makes arrays a scene. Everything later code relies on without looking is checked here, once.
//!
//! A scene is checked whenever it is opened and may have millions of records, so each array is read once, in
//! runs that the threads share. What a run cannot decide alone is left to one short pass over all runs in
//! order.

mod geometry;
mod nodes;

use thiserror::Error;

use super::{ObjectRecord, Parts};

/// Why arrays are not a scene.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum SceneError {
    /// A record refers to something that is not there, or breaks the order the format promises.
    #[error("{what} {index} is malformed: {why}")]
    Malformed {
        /// The kind of record.
        what: &'static str,
        /// Its index.
        index: usize,
        /// What is wrong.
        why: &'static str,
    },
    /// The scene has no nodes.
    #[error("the scene has no nodes: there is nothing to draw")]
    Empty,
    /// More records of one kind than a `u32` can number.
    #[error("{count} {what} are more than a scene can number (2^32 - 2)")]
    TooMany {
        /// The kind of record.
        what: &'static str,
        /// How many there are.
        count: usize,
    },
}

/// A rule of the format: what is wrong with a record, if anything.
type Check = Result<(), &'static str>;

/// Checks all rules of the format.
pub(super) fn check(parts: &Parts<'_>) -> Result<(), SceneError> {
    if parts.nodes.is_empty() {
        return Err(SceneError::Empty);
    }
    check_counts(parts)?;
    nodes::check(parts)?;
    geometry::check(parts)?;
    for (index, object) in parts.objects.iter().enumerate() {
        check_object(parts, object).map_err(malformed("object", index))?;
    }
    Ok(())
}

/// Says which record broke a rule.
fn malformed(what: &'static str, index: usize) -> impl FnOnce(&'static str) -> SceneError {
    move |why| SceneError::Malformed { what, index, why }
}

fn check_counts(parts: &Parts<'_>) -> Result<(), SceneError> {
    let counts = [
        ("nodes", parts.nodes.len()),
        ("drawables", parts.drawables.len()),
        ("vertices", parts.vertices.len()),
        ("indices", parts.indices.len()),
        ("objects", parts.objects.len()),
        ("bytes of names", parts.names.len()),
    ];
    match counts.into_iter().find(|&(_, count)| count >= u32::MAX as usize) {
        Some((what, count)) => Err(SceneError::TooMany { what, count }),
        None => Ok(()),
    }
}

fn check_object(parts: &Parts<'_>, object: &ObjectRecord) -> Check {
    if object.source as usize >= parts.sources.len() {
        Err("its source file does not exist")
    } else if parts.name_of(object).is_none() {
        Err("its name is not a range of whole characters of the names")
    } else {
        Ok(())
    }
}
