//! The rules of records. All invariants of later code are checked here, once: when a page of records is first
//! read.
//!
//! A check may request earlier records, and for drawables their nodes. So it never comes back to the page
//! being checked.

mod drawables;
mod nodes;

use thiserror::Error;

use super::geometry::GeometryPlace;
use super::layout::Section;
use super::table::{self, Pages};
use super::{Drawable, NO_NAME, Node, ObjectRecord, Scene};

/// Why records are not a valid scene.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum SceneError {
    /// A record has an invalid reference, or breaks the format's order.
    #[error("{what} {index} is malformed: {why}")]
    Malformed {
        /// The kind of record.
        what: &'static str,
        /// Its index.
        index: usize,
        /// The error.
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

/// A rule of the format: the error of a record, if any.
type Check = Result<(), &'static str>;

/// Names the record that broke a rule.
fn malformed(what: &'static str, index: usize) -> impl FnOnce(&'static str) -> SceneError {
    move |why| SceneError::Malformed { what, index, why }
}

pub(super) fn node_pages(count: usize, paged: bool) -> Pages<Node> {
    Pages::new(Section::Nodes, count, paged, nodes::check, |given, number| given.node(number))
}

pub(super) fn drawable_pages(count: usize, paged: bool) -> Pages<Drawable> {
    Pages::new(Section::Drawables, count, paged, drawables::check, |given, number| given.drawable(number))
}

pub(super) fn place_pages(count: usize, paged: bool) -> Pages<GeometryPlace> {
    let check: table::Check<GeometryPlace> = |scene, first, places| {
        for (index, place) in (first..).zip(places) {
            check_place(scene, place).map_err(malformed("geometry", index))?;
        }
        Ok(())
    };
    Pages::new(Section::Places, count, paged, check, |given, number| given.places.get(&number))
}

pub(super) fn object_pages(count: usize, paged: bool) -> Pages<ObjectRecord> {
    let check: table::Check<ObjectRecord> = |scene, first, objects| {
        for (index, object) in (first..).zip(objects) {
            check_object(scene, object).map_err(malformed("object", index))?;
        }
        Ok(())
    };
    // Drawing needs no objects.
    Pages::new(Section::Objects, count, paged, check, |_, _| None)
}

fn check_place(scene: &Scene, place: &GeometryPlace) -> Check {
    let page = scene.file().geometry_page_length(place.page).map_or(0, u64::from);
    let (min, max) = place.local_box();
    if u64::from(place.offset) + u64::from(place.length) > page {
        Err("it lies outside of the file")
    } else if !(min.is_finite() && max.is_finite() && min.cmple(max).all()) {
        Err("its box is not finite, or inside out")
    } else {
        Ok(())
    }
}

fn check_object(scene: &Scene, object: &ObjectRecord) -> Check {
    if object.source as usize >= scene.sources().len() {
        Err("its source file does not exist")
    } else if u64::from(object.name_start) + u64::from(object.name_length) > scene.file().header().names {
        Err(NO_NAME)
    } else if object.node != Node::NONE && object.node as usize >= scene.nodes().len() {
        Err("its node does not exist")
    } else {
        Ok(())
    }
}
