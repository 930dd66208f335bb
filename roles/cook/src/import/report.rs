//! What an import met, for people to judge it by.

use std::fmt;

/// Counts of an import, and what was left out.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ImportReport {
    /// Files read.
    pub files: u64,
    /// Objects placed.
    pub objects: u64,
    /// Distinct meshes.
    pub meshes: u64,
    /// Triangles as drawn: each object counts its mesh's.
    pub triangles: u64,
    /// Triangles as stored: each mesh once.
    pub unique_triangles: u64,
    /// RVM primitives whose tessellation differs by more than 5 % from the box that the file stores with
    /// them. A few are right: writers store loose boxes for sheared snouts and eccentric pyramids.
    pub box_mismatches: u64,
    /// What was left out or repaired, each kind once, with how often.
    pub warnings: Vec<(Warning, u64)>,
}

/// Something an import left out or repaired.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[non_exhaustive]
pub enum Warning {
    /// glTF primitives and OBJ elements of points or lines: they have no surface.
    PointsOrLines,
    /// glTF and OBJ materials whose colour comes from a texture: drawn in their base colour.
    TexturedMaterial,
    /// OBJ material libraries that cannot be read: what uses them is drawn grey.
    MaterialsMissing,
    /// glTF nodes with a skin: drawn as modelled, without it.
    SkinnedNode,
    /// RVM insulation and obstruction volumes: they are room kept free, not things, and would hide what is in
    /// them.
    VolumeLeftOut,
    /// Objects whose matrix flattens them: their mesh was flattened instead.
    FlattenedObject,
    /// Objects without a single triangle: left out.
    EmptyObject,
    /// Polygons of so many corners that cutting them well could take for ever: their holes are filled, and a
    /// contour that is as large by itself is drawn as a fan.
    LargePolygon,
}

impl ImportReport {
    /// Notes that something happened `count` more times.
    pub(super) fn warn(&mut self, warning: Warning, count: u64) {
        if count == 0 {
            return;
        }
        match self.warnings.iter_mut().find(|(known, _)| *known == warning) {
            Some((_, total)) => *total += count,
            None => self.warnings.push((warning, count)),
        }
    }

    /// Adds what the import of another file met; what its model has is counted in the whole.
    pub(super) fn absorb(&mut self, other: &Self) {
        self.box_mismatches += other.box_mismatches;
        for &(warning, count) in &other.warnings {
            self.warn(warning, count);
        }
    }
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::PointsOrLines => "primitives of points or lines left out: they have no surface",
            Self::TexturedMaterial => "textured materials drawn in their base colour",
            Self::MaterialsMissing => "material libraries that cannot be read: drawn grey",
            Self::SkinnedNode => "skinned nodes drawn as modelled",
            Self::VolumeLeftOut => "insulation and obstruction volumes left out",
            Self::FlattenedObject => "objects that their matrix flattens",
            Self::EmptyObject => "objects without a triangle left out",
            Self::LargePolygon => "polygons of more than 8,192 corners drawn without their holes",
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reports_add_up() {
        let mut all = ImportReport::default();
        let mut one = ImportReport { box_mismatches: 3, ..Default::default() };
        one.warn(Warning::EmptyObject, 4);
        one.warn(Warning::SkinnedNode, 0);
        all.absorb(&one);
        all.absorb(&one);
        assert_eq!(all.box_mismatches, 6);
        assert_eq!(all.warnings, [(Warning::EmptyObject, 8)]);
    }
}
