//! The people on a service: each page tells where its person is, and is told where the others are.

use std::{collections::HashMap, time::Duration};

use parking_lot::Mutex;
use serde::{Deserialize, Serialize};
use thiserror::Error;
use trimaran_net::Instant;

/// The most bytes in which a page tells where it is.
pub(super) const LONGEST_MEETING: usize = 4 << 10;
/// The most people at a time.
const MOST: usize = 64;
/// The longest name of a page.
const LONGEST_NAME: usize = 32;
/// Who has told nothing for so long has left.
const LEAVES: Duration = Duration::from_secs(10);

/// Everybody, by what their pages call themselves.
#[derive(Debug, Default)]
pub(super) struct People(Mutex<Inner>);

#[derive(Debug, Default)]
struct Inner {
    people: HashMap<String, Known>,
    /// The number of who came last.
    last: u32,
}

#[derive(Debug)]
struct Known {
    number: u32,
    pose: Pose,
    at: Instant,
}

/// Where a person is, and what they see.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "camelCase", deny_unknown_fields)]
pub(super) struct Pose {
    /// Metres in the world.
    eye: [f64; 3],
    /// Which way they look.
    forward: [f64; 3],
    /// Vertical field of view, degrees.
    vfov_deg: f64,
}

/// What a page tells.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Here {
    page: String,
    pose: Pose,
}

/// What it is told.
#[derive(Debug, PartialEq, Serialize)]
pub(super) struct Company {
    /// Its own number: people are numbered as they come.
    you: u32,
    others: Vec<Person>,
}

/// Somebody else.
#[derive(Debug, PartialEq, Serialize)]
struct Person {
    number: u32,
    pose: Pose,
}

/// Why nobody is met.
#[derive(Debug, Error)]
pub(super) enum MeetError {
    /// The page's name for itself is too long.
    #[error("a page calls itself by at most {LONGEST_NAME} bytes")]
    Name,
    /// There are as many as there may be.
    #[error("there are {MOST} people already")]
    TooMany,
}

impl People {
    /// Somebody is here, and meets the others.
    pub(super) fn meet(&self, Here { page, pose }: Here, now: Instant) -> Result<Company, MeetError> {
        if page.len() > LONGEST_NAME {
            return Err(MeetError::Name);
        }
        let Inner { people, last } = &mut *self.0.lock();
        people.retain(|_, known| now.since(known.at) < LEAVES);
        let you = match people.get(&page) {
            Some(known) => known.number,
            None if people.len() >= MOST => return Err(MeetError::TooMany),
            None => {
                *last += 1;
                *last
            }
        };
        people.insert(page, Known { number: you, pose, at: now });
        let others = people.values().filter(|known| known.number != you);
        let mut others: Vec<_> =
            others.map(|known| Person { number: known.number, pose: known.pose.clone() }).collect();
        others.sort_unstable_by_key(|person| person.number);
        Ok(Company { you, others })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn here(page: &str, x: f64) -> Here {
        let pose = Pose { eye: [x, 0.0, 0.0], forward: [0.0, 0.0, -1.0], vfov_deg: 60.0 };
        Here { page: page.to_owned(), pose }
    }

    fn at(seconds: u64) -> Instant {
        Instant::from_nanos(seconds * 1_000_000_000)
    }

    fn places(company: &Company) -> Vec<(u32, f64)> {
        company.others.iter().map(|person| (person.number, person.pose.eye[0])).collect()
    }

    #[test]
    fn each_is_told_where_the_others_are_until_they_leave() {
        let people = People::default();
        let alone = people.meet(here("a", 1.0), at(0)).unwrap();
        assert_eq!((alone.you, places(&alone)), (1, vec![]));
        let second = people.meet(here("b", 2.0), at(1)).unwrap();
        assert_eq!((second.you, places(&second)), (2, vec![(1, 1.0)]));
        people.meet(here("c", 3.0), at(2)).unwrap();
        let moved = people.meet(here("a", 9.0), at(9)).unwrap();
        assert_eq!((moved.you, places(&moved)), (1, vec![(2, 2.0), (3, 3.0)]));
        let later = people.meet(here("a", 9.0), at(11)).unwrap();
        assert_eq!(places(&later), [(3, 3.0)], "the second has left");
        assert_eq!(people.meet(here("b", 2.0), at(11)).unwrap().you, 4, "a number is given once");
    }

    #[test]
    fn there_is_room_for_some_people_with_short_names() {
        let people = People::default();
        for page in 0..MOST {
            people.meet(here(&page.to_string(), 0.0), at(0)).unwrap();
        }
        assert!(matches!(people.meet(here("more", 0.0), at(1)), Err(MeetError::TooMany)));
        assert_eq!(people.meet(here("7", 0.0), at(1)).unwrap().you, 8, "who is here stays");
        people.meet(here("more", 0.0), at(20)).unwrap();
        let long = people.meet(here(&"x".repeat(LONGEST_NAME + 1), 0.0), at(20));
        assert!(matches!(long, Err(MeetError::Name)));
    }
}
