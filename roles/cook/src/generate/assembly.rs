//! Parts gathered into modules, and modules turned into a model of a wanted size.

use std::collections::HashMap;

use glam::{DAffine3, DMat3, DVec3};

use super::{
    brush::{Brush, Tolerance, Y_TO_X, Y_TO_Z},
    paint::Paint,
    shape::Shape,
};
use crate::{Mesh, Model, Object, Source};

/// One shape, placed and painted, in its module's frame.
#[derive(Debug, Clone)]
pub(super) struct Part {
    shape: Shape,
    paint: Paint,
    place: DAffine3,
    name: String,
}

/// Parts around an origin of their own: a room, a deck section, a tank.
#[derive(Debug, Clone)]
pub(super) struct Module {
    origin: DVec3,
    name: String,
    /// The beginning of the names of the parts to come.
    tag: String,
    parts: Vec<Part>,
}

/// The axis a rod, beam or angle lies along.
#[derive(Debug, Clone, Copy)]
pub(super) enum Axis {
    X,
    Y,
    Z,
}

/// The unit that becomes an object of the model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Grain {
    /// Each part by itself; equal shapes share a mesh.
    Part,
    /// All parts of one trade in a module together; modules with equal parts share the mesh.
    Trade,
}

impl Module {
    pub(super) fn new(origin: DVec3, name: impl Into<String>) -> Self {
        Self { origin, name: name.into(), tag: String::new(), parts: Vec::new() }
    }

    /// A module whose parts' names begin with its own.
    pub(super) fn named_throughout(origin: DVec3, name: &str) -> Self {
        Self { tag: name.to_owned(), ..Self::new(origin, name) }
    }

    /// Begins the names of the parts to come with a tag.
    pub(super) fn tag(&mut self, tag: &str) {
        tag.clone_into(&mut self.tag);
    }

    /// The number of parts.
    pub(super) const fn len(&self) -> usize {
        self.parts.len()
    }

    /// Adds a shape at a place in the module. Without a name, its name is the tag.
    pub(super) fn put(&mut self, paint: Paint, shape: Shape, place: DAffine3, name: impl Into<String>) {
        let name = match (&*self.tag, name.into()) {
            ("", name) => name,
            (tag, name) if name.is_empty() => tag.to_owned(),
            (tag, name) => format!("{tag} {name}"),
        };
        self.parts.push(Part { shape, paint, place, name });
    }

    /// Adds a shape, unturned, at a point.
    pub(super) fn stand(&mut self, paint: Paint, shape: Shape, at: [f64; 3], name: impl Into<String>) {
        self.put(paint, shape, DAffine3::from_translation(DVec3::from_array(at)), name);
    }

    /// Adds a box between two corners.
    pub(super) fn cuboid(&mut self, paint: Paint, min: [f64; 3], max: [f64; 3], name: impl Into<String>) {
        let (min, max) = (DVec3::from_array(min), DVec3::from_array(max));
        let place = DAffine3 { matrix3: DMat3::from_diagonal(max - min), translation: (min + max) / 2.0 };
        self.put(paint, Shape::Box, place, name);
    }

    /// Adds a shape of unit length along an axis, stretched to `length` metres.
    pub(super) fn bar(
        &mut self,
        paint: Paint,
        shape: Shape,
        from: [f64; 3],
        (axis, length): (Axis, f64),
        name: impl Into<String>,
    ) {
        let turn = axis.turn() * DMat3::from_diagonal(DVec3::new(1.0, length, 1.0));
        self.put(paint, shape, DAffine3 { matrix3: turn, translation: DVec3::from_array(from) }, name);
    }

    /// Whether it is one of the rooms, which take small parts.
    pub(super) fn is_room(&self) -> bool {
        self.name.starts_with("room ")
    }

    /// The parts of each trade that has any, in the order of the trades.
    fn trades(&self) -> impl Iterator<Item = (&'static str, Vec<&Part>)> {
        Paint::TRADES.into_iter().filter_map(|trade| {
            let parts: Vec<_> = self.parts.iter().filter(|p| p.paint.trade() == trade).collect();
            (!parts.is_empty()).then_some((trade, parts))
        })
    }
}

impl Axis {
    /// The rotation that lays +y along the axis.
    pub(super) const fn turn(self) -> DMat3 {
        match self {
            Self::X => Y_TO_X,
            Self::Y => DMat3::IDENTITY,
            Self::Z => Y_TO_Z,
        }
    }
}

/// The number of objects that the modules make.
pub(super) fn object_count(modules: &[Module], grain: Grain) -> usize {
    match grain {
        Grain::Part => modules.iter().map(Module::len).sum(),
        Grain::Trade => modules.iter().map(|m| m.trades().count()).sum(),
    }
}

/// Makes a model of the modules, with round parts fine enough to come near `triangles` in total.
pub(super) fn assemble(modules: &[Module], grain: Grain, triangles: usize, source: &str) -> Model {
    let mut uses: HashMap<Shape, usize> = HashMap::new();
    for part in modules.iter().flat_map(|m| &m.parts) {
        *uses.entry(part.shape).or_default() += 1;
    }
    let tolerance = tolerance_for(&uses, triangles);
    let mut model = Model { sources: vec![Source { name: source.to_owned() }], ..Model::default() };
    match grain {
        Grain::Part => place_parts(&mut model, modules, tolerance),
        Grain::Trade => place_trades(&mut model, modules, tolerance),
    }
    model
}

/// The coarsest tolerance at which the parts have at least `triangles`, or the bound of the sensible range.
fn tolerance_for(uses: &HashMap<Shape, usize>, triangles: usize) -> Tolerance {
    let total = |tolerance| -> usize {
        let count = |shape: Shape| {
            let mut brush = Brush::count(tolerance);
            shape.paint(&mut brush);
            brush.triangles()
        };
        uses.iter().map(|(&shape, &uses)| uses * count(shape)).sum()
    };
    // From a tenth of a micrometre to ten metres, by halving the ratio.
    let (mut fine, mut coarse) = (1e-7_f64, 10.0_f64);
    for _ in 0..40 {
        let middle = (fine * coarse).sqrt();
        if total(Tolerance(middle)) >= triangles {
            fine = middle;
        } else {
            coarse = middle;
        }
    }
    Tolerance(fine)
}

fn place_parts(model: &mut Model, modules: &[Module], tolerance: Tolerance) {
    let mut meshes: HashMap<(Shape, Paint), u32> = HashMap::new();
    for module in modules {
        for part in &module.parts {
            let mesh = *meshes.entry((part.shape, part.paint)).or_insert_with(|| {
                let mut mesh = Mesh::default();
                let colour = part.paint.colour();
                part.shape.paint(&mut Brush::draw(&mut mesh, DAffine3::IDENTITY, colour, tolerance));
                push_mesh(model, mesh)
            });
            let to_world = DAffine3::from_translation(module.origin) * part.place;
            push_object(model, mesh, to_world, part.name.clone());
        }
    }
}

fn place_trades(model: &mut Model, modules: &[Module], tolerance: Tolerance) {
    let mut meshes: HashMap<Vec<u64>, u32> = HashMap::new();
    for module in modules {
        for (trade, parts) in module.trades() {
            let mesh = *meshes.entry(fingerprint(&parts)).or_insert_with(|| {
                let mut mesh = Mesh::default();
                for part in &parts {
                    part.shape.paint(&mut Brush::draw(&mut mesh, part.place, part.paint.colour(), tolerance));
                }
                push_mesh(model, mesh)
            });
            let to_world = DAffine3::from_translation(module.origin);
            push_object(model, mesh, to_world, format!("{} {trade}", module.name));
        }
    }
}

/// A fingerprint of everything that determines the merged mesh of some parts.
fn fingerprint(parts: &[&Part]) -> Vec<u64> {
    let mut words = Vec::with_capacity(parts.len() * 14);
    for part in parts {
        // Shapes have no natural order: their debug text is exact and short.
        words.push(xxhash_rust::xxh3::xxh3_64(format!("{:?} {:?}", part.shape, part.paint).as_bytes()));
        words.extend(part.place.to_cols_array().map(f64::to_bits));
    }
    words
}

fn push_object(model: &mut Model, mesh: u32, to_world: DAffine3, name: String) {
    let source_index = model.objects.len() as u32;
    model.objects.push(Object { mesh, to_world, name, source: 0, source_index });
}

fn push_mesh(model: &mut Model, mesh: Mesh) -> u32 {
    model.meshes.push(mesh);
    (model.meshes.len() - 1) as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    fn two_rooms() -> Vec<Module> {
        [0.0, 10.0]
            .map(|x| {
                let mut module = Module::new(DVec3::new(x, 0.0, 0.0), "room");
                module.cuboid(Paint::Floor, [0.0, -0.2, 0.0], [8.0, 0.0, 8.0], "floor");
                for (z, name) in [(1.0, "pipe 1"), (2.0, "pipe 2")] {
                    let pipe = Shape::Rod { radius: 100 };
                    module.bar(Paint::Water, pipe, [0.0, 3.0, z], (Axis::X, 8.0), name);
                }
                module
            })
            .into()
    }

    #[test]
    fn parts_share_meshes_by_shape() {
        let model = assemble(&two_rooms(), Grain::Part, 1000, "t");
        assert_eq!((model.objects.len(), model.meshes.len()), (6, 2));
        model.check().unwrap();
        let end = model.objects[4].to_world.transform_point3(DVec3::Y);
        assert!(end.distance(DVec3::new(18.0, 3.0, 1.0)) < 1e-12, "{end}");
    }

    #[test]
    fn trades_share_meshes_between_equal_modules() {
        let model = assemble(&two_rooms(), Grain::Trade, 1000, "t");
        assert_eq!((model.objects.len(), model.meshes.len()), (4, 2));
        assert_eq!(model.objects[1].name, "room piping");
    }

    #[test]
    fn the_tolerance_meets_the_triangles_asked_for() {
        for grain in [Grain::Part, Grain::Trade] {
            for target in [1000, 30_000] {
                let got = assemble(&two_rooms(), grain, target, "t").triangle_count();
                assert!(got.abs_diff(target) <= target / 20, "{got} for {target}");
            }
        }
    }
}
