//! Splits the box tests of a time-shared device into pieces, so that no frame keeps it for long.

use std::{rc::Rc, time::Duration};

use trimaran_cull::{Answer, CutRule, OcclusionTest, Outline, TestBox, View, WholeTraversal};

use crate::{clock::Stopwatch, device::CullerDevice, turn::Turn};

/// Boxes of the first piece of a session. A test may draw each of them over the whole picture.
const FIRST: usize = 16;
/// A piece below this time is followed by a longer one, and one above it by a shorter one.
const SHORT: Duration = Duration::from_millis(5);
const LONG: Duration = Duration::from_millis(20);

/// How many boxes the next piece has. The result does not depend on it: each box is tested by itself.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pieces(usize);

impl Default for Pieces {
    fn default() -> Self {
        Self(FIRST)
    }
}

impl Pieces {
    fn took(&mut self, time: Duration) {
        self.0 = match time {
            time if time < SHORT => self.0.saturating_mul(2),
            time if time > LONG => (self.0 / 2).max(1),
            _ => self.0,
        };
    }
}

/// The device of a role, with the role's turn.
pub(super) struct InPieces<'d, D> {
    pub(super) device: &'d mut D,
    pub(super) pieces: &'d mut Pieces,
    pub(super) clock: Stopwatch,
    /// Without one all boxes are one piece.
    pub(super) turn: Option<Rc<Turn>>,
}

impl<D: CullerDevice> OcclusionTest for InPieces<'_, D> {
    type Error = D::Error;

    fn test(&mut self, view: &View, boxes: &[TestBox], visible: &mut Vec<u32>) -> Result<(), D::Error> {
        let Some(turn) = &self.turn else { return self.device.test(view, boxes, visible) };
        visible.clear();
        let (mut rest, mut of_piece) = (boxes, Vec::new());
        while !rest.is_empty() {
            turn.rest();
            let (piece, later) = rest.split_at(self.pieces.0.min(rest.len()));
            let begun = self.clock.elapsed();
            self.device.test(view, piece, &mut of_piece)?;
            if piece.len() == self.pieces.0 {
                self.pieces.took(self.clock.elapsed().saturating_sub(begun));
            }
            visible.append(&mut of_piece);
            rest = later;
        }
        Ok(())
    }

    fn traverse(&mut self, view: &View, rule: &CutRule) -> Result<Option<WholeTraversal>, D::Error> {
        if let Some(turn) = &self.turn {
            turn.rest();
        }
        self.device.traverse(view, rule)
    }

    fn is_checked(&self) -> bool {
        self.device.is_checked()
    }

    fn outline(&self) -> Outline {
        self.device.outline()
    }

    fn answer(&self) -> Answer {
        self.device.answer()
    }
}
