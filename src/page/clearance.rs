//! The shortest distance between two parts that a page asks for.

use std::ops::Range;

use serde::Serialize;
use trimaran_proto::ObjectSet;
use trimaran_scene::{
    ReadError, Scene,
    clearance::{ClearanceError, Clearances},
};

/// The most triangles of both parts together.
const MOST: u64 = 64 << 20;
/// Objects between two checks whether the client still waits.
const BETWEEN_LOOKS: usize = 256;

/// Two runs of objects.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Between([Range<u32>; 2]);

/// The answer.
#[derive(Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub(super) enum Shortest {
    Found(Found),
    /// Why there is none, in a sentence.
    None {
        fault: &'static str,
    },
}

#[derive(Debug, PartialEq, Serialize)]
pub(super) struct Found {
    /// Metres; 0 where surfaces touch or intersect.
    distance: f64,
    /// Whether they do so, but for rounding.
    #[serde(rename = "isHard")]
    is_hard: bool,
    /// Its error due to rounded coordinates, metres.
    error: f64,
    /// A closest point of each part: metres in the world.
    points: [[f64; 3]; 2],
    /// The objects that have them.
    objects: [u32; 2],
}

impl Between {
    /// Parses a query: `first=1-5&second=7-8`, each from an object's number to before another one. `None` if
    /// it is not valid.
    pub(super) fn parse<'v>(value: impl Fn(&str) -> Option<&'v str>) -> Option<Self> {
        let run = |name| {
            let (start, end) = value(name)?.split_once('-')?;
            let run = start.parse().ok()?..end.parse().ok()?;
            (!run.is_empty()).then_some(run)
        };
        Some(Self([run("first")?, run("second")?]))
    }

    /// The shortest distance. `None` soon after `is_given_up` says that the client has gone.
    pub(super) fn shortest(
        &self,
        scene: &Scene,
        is_given_up: &dyn Fn() -> bool,
    ) -> Option<Result<Shortest, ReadError>> {
        let count = scene.objects().len() as u32;
        let objects = || self.0.iter().flat_map(|run| run.start..run.end.min(count));
        let mut triangles = 0;
        for (object, number) in objects().zip((0..BETWEEN_LOOKS).cycle()) {
            triangles += scene.extent(object).triangles;
            if number == 0 && is_given_up() {
                return None;
            }
        }
        if triangles > MOST {
            return Some(Ok(Shortest::None { fault: "These parts are too large to be measured." }));
        }
        let pair = |run: &Range<u32>| ObjectSet::try_from(vec![(run.start, run.end - run.start - 1)]);
        let [first, second] = self.0.each_ref().map(|run| pair(run).unwrap_or_default());
        Some(match Clearances::new(scene).shortest(&first, &second, is_given_up) {
            Ok(None) => Ok(Shortest::None { fault: "Nothing of these parts can be drawn, or they are one." }),
            Ok(Some(shortest)) => Ok(Shortest::Found(Found {
                distance: shortest.distance,
                is_hard: shortest.is_hard(),
                error: shortest.rounding,
                points: shortest.points.map(|point| point.to_array()),
                objects: shortest.objects,
            })),
            Err(ClearanceError::Read(fault)) => Err(fault),
            // It was given up.
            Err(_) => return None,
        })
    }
}

#[cfg(test)]
mod tests {
    use glam::{DVec3, Vec3};
    use trimaran_audit::cases::{Mesh, Object, build};

    use super::*;

    fn parse(query: &str) -> Option<Between> {
        let pairs: Vec<_> = form_urlencoded::parse(query.as_bytes()).collect();
        Between::parse(|name| pairs.iter().find(|(known, _)| known == name).map(|(_, value)| &**value))
    }

    #[test]
    fn two_runs_of_objects_are_a_question() {
        assert_eq!(parse("first=1-5&second=7-8"), Some(Between([1..5, 7..8])));
        for wrong in ["", "first=1-5", "first=5-1&second=7-8", "first=1-1&second=7-8", "first=-1&second=7-8"]
        {
            assert_eq!(parse(wrong), None, "{wrong}");
        }
        assert_eq!(parse("first=1-4294967296&second=7-8"), None);
    }

    #[test]
    fn the_shortest_distance_has_its_points_and_its_objects() {
        let cube =
            |at: f64| Object::new(Mesh::cuboid(Vec3::splat(-0.5), Vec3::splat(0.5), 1)).at(DVec3::X * at);
        let scene = build(&[cube(0.0), cube(-9.0), cube(2.25), cube(6.0)], true).unwrap();
        let ask = |query| parse(query).unwrap().shortest(&scene, &|| false).unwrap().unwrap();
        let Shortest::Found(found) = ask("first=0-2&second=2-4") else { panic!("nothing is found") };
        assert_eq!((found.distance, found.objects, found.is_hard), (1.25, [0, 2], false));
        assert_eq!([found.points[0][0], found.points[1][0]], [0.5, 1.75]);
        assert!(found.error > 0.0 && found.error < 1e-6);
        for nothing in ["first=1-2&second=1-2", "first=1-2&second=9-4294967295"] {
            assert!(matches!(ask(nothing), Shortest::None { .. }), "{nothing}");
        }
        assert!(parse("first=0-2&second=2-4").unwrap().shortest(&scene, &|| true).is_none());
    }
}
