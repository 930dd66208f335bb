//! Drawables: each is a piece of a level of its node, its triangles exist, and errors never fall towards the
//! root.

use super::super::{Drawable, Node, Scene};
use super::{Check, SceneError, malformed};

/// Checks the drawables of a page, the first of which has index `first`.
pub(super) fn check(scene: &Scene, first: usize, drawables: &[Drawable]) -> Result<(), SceneError> {
    // In this page, or in an earlier one.
    let find = |index: usize| match index.checked_sub(first) {
        Some(within) => drawables.get(within),
        None => scene.drawables().get(index),
    };
    for (index, drawable) in (first..).zip(drawables) {
        check_one(scene, index, drawable).map_err(malformed("drawable", index))?;
        check_piece(scene, index, drawable, find).map_err(malformed("drawable", index))?;
        check_errors(scene, index, drawable, find)?;
    }
    Ok(())
}

fn check_one(scene: &Scene, index: usize, drawable: &Drawable) -> Check {
    let node = scene.nodes().get(drawable.node as usize);
    let Some(node) = node.filter(|node| levels(node).contains(&index)) else {
        return Err("its node does not have it among its levels");
    };
    let triangles = scene.places().get(drawable.geometry as usize).map(|place| place.triangles);
    if !(drawable.error.is_finite() && drawable.error >= 0.0) {
        Err("its error is no distance")
    } else if node.is_leaf()
        && levels(node).start + usize::from(drawable.piece) == index
        && drawable.error != 0.0
    {
        Err("it is the finest level of a leaf and has an error")
    } else if triangles.is_none() {
        Err("its geometry does not exist")
    } else if triangles != Some(drawable.triangles) || drawable.triangles == 0 {
        Err("its number of triangles is not that of its geometry")
    } else if !drawable.sides.is_known() {
        Err("which sides of its triangles show is more than six faces")
    } else {
        Ok(())
    }
}

/// The pieces of a level are numbered from 0, and have one error.
fn check_piece<'d>(
    scene: &Scene,
    index: usize,
    drawable: &Drawable,
    find: impl Fn(usize) -> Option<&'d Drawable>,
) -> Check {
    let Some(node) = scene.nodes().get(drawable.node as usize) else { return Ok(()) };
    let is_last = |drawable: &Drawable| drawable.piece.checked_add(1) == Some(drawable.pieces);
    let before = index.checked_sub(1).filter(|before| levels(node).contains(before)).and_then(find);
    let follows = match before {
        Some(before) if !is_last(before) => {
            let next = Drawable { piece: before.piece.saturating_add(1), ..*before };
            (drawable.piece, drawable.pieces, drawable.error) == (next.piece, next.pieces, next.error)
        }
        _ => drawable.piece == 0,
    };
    if !follows || drawable.piece >= drawable.pieces {
        Err("it is not the next piece of its level")
    } else if index + 1 == levels(node).end && !is_last(drawable) {
        Err("its level lacks pieces")
    } else {
        Ok(())
    }
}

/// Errors never fall from a level to the next coarser one, nor from a node to its first ancestor with levels.
/// Ancestors stand before their descendants, and so do their levels.
fn check_errors<'d>(
    scene: &Scene,
    index: usize,
    drawable: &Drawable,
    find: impl Fn(usize) -> Option<&'d Drawable>,
) -> Result<(), SceneError> {
    const WHY: &str = "its error is below that of a finer level, or of a node below its own";
    let nodes = scene.nodes();
    let Some(node) = nodes.get(drawable.node as usize) else { return Ok(()) };
    let levels = levels(node);
    if index > levels.start && find(index - 1).is_some_and(|finer| drawable.error < finer.error) {
        return Err(malformed("drawable", index)(WHY));
    }
    if index + 1 < levels.end || drawable.error == 0.0 {
        return Ok(()); // only the coarsest level can be worse than what is above
    }
    let above =
        std::iter::successors(nodes.get(node.parent as usize), |node| nodes.get(node.parent as usize));
    let Some(above) = above.into_iter().find(|node| node.drawable_count > 0) else { return Ok(()) };
    let finest = above.first_drawable as usize;
    match find(finest) {
        Some(level) if level.error < drawable.error => Err(malformed("drawable", finest)(WHY)),
        _ => Ok(()),
    }
}

fn levels(node: &Node) -> std::ops::Range<usize> {
    let first = node.first_drawable as usize;
    first..first.saturating_add(node.drawable_count as usize)
}
