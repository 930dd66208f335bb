//! Colours of binary STL. The format has none, so two programs put them into spare bytes, each its own way.

use crate::import::assemble::grey;
use trimaran_scene::Rgba8;

/// The bit of a facet that says which colour counts.
const FLAG: u16 = 1 << 15;

/// How the facets of a file are coloured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Colours {
    /// As VisCAM does: a facet with the flag has a colour, blue in its lowest bits.
    Flagged,
    /// As Materialise Magics does: the header has a colour, which a facet without the flag replaces by its
    /// own, red in its lowest bits.
    Header(Rgba8),
    /// The header has a colour, and the facets have none.
    Plain(Rgba8),
}

impl Colours {
    /// The colours of a file with this header and these attributes of facets.
    pub(super) fn of(header: &[u8; 80], mut attributes: impl Iterator<Item = u16>) -> Self {
        const WORD: &[u8] = b"COLOR=";
        let word = header.windows(WORD.len()).position(|window| window == WORD);
        let colour = word.and_then(|at| header.get(at + WORD.len()..)?.first_chunk::<4>());
        let Some(&[r, g, b, alpha]) = colour else { return Self::Flagged };
        // Some programs leave the last byte 0, and nothing of such a part would be seen.
        let colour = Rgba8([r, g, b, if alpha == 0 { u8::MAX } else { alpha }]);
        // A file whose facets are all 0 has no colours: they would all be black.
        if attributes.any(|attribute| attribute != 0) { Self::Header(colour) } else { Self::Plain(colour) }
    }

    /// The colour of a facet.
    pub(super) fn of_facet(self, attribute: u16) -> Rgba8 {
        let [low, middle, high] = [0, 5, 10].map(|shift| part(attribute >> shift));
        match (self, attribute & FLAG != 0) {
            (Self::Flagged, true) => Rgba8([high, middle, low, u8::MAX]),
            (Self::Flagged, false) => grey(),
            (Self::Header(_), false) => Rgba8([low, middle, high, u8::MAX]),
            (Self::Header(colour), true) | (Self::Plain(colour), _) => colour,
        }
    }
}

/// The lowest five bits as a part of a colour.
const fn part(bits: u16) -> u8 {
    (((bits & 31) * 255 + 15) / 31) as u8
}
