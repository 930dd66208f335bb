//! The people on a service: each page sends its person's pose, and gets those of the others.

use std::{collections::HashMap, num::ParseIntError, time::Duration};

use parking_lot::Mutex;
use serde::{Deserialize, Serialize};
use thiserror::Error;
use trimaran_net::Instant;

use super::tokens::PersonName;
use crate::http::Asker;

/// The longest pose message of a page, bytes.
pub(super) const LONGEST_MEETING: usize = 4 << 10;
/// The most people at a time.
const MOST: usize = 64;
/// The farthest distance of an eye from the origin, metres.
const FARTHEST: f64 = 1e15;
/// The narrowest vertical field of view of a camera, degrees. A parallel view has 0.057.
const NARROWEST: f64 = 0.001_15;
/// The longest name of a page.
const LONGEST_NAME: usize = 32;
/// A person who is silent for this long has left. Browsers let a page that nobody sees run once a minute.
const LEAVES: Duration = Duration::from_secs(90);
/// How long a call is passed on: also to those whose pages ask late.
const CALLED: Duration = Duration::from_secs(30);
/// The least time between two calls of a person.
const BETWEEN_CALLS: Duration = Duration::from_secs(1);

/// All people, by their pages' names for themselves.
#[derive(Debug, Default)]
pub(super) struct People(Mutex<Inner>);

#[derive(Debug, Default)]
struct Inner {
    people: HashMap<String, Known>,
    /// The number of the last arrival.
    last: u32,
    /// The number of the last call.
    last_call: u32,
}

#[derive(Debug)]
struct Known {
    number: u32,
    asker: Asker,
    name: Option<PersonName>,
    pose: Pose,
    leader: Option<Leader>,
    follows: Option<u32>,
    call: Option<Made>,
    at: Instant,
}

/// A call that was made.
#[derive(Debug, Clone, Copy)]
struct Made {
    number: u32,
    call: Call,
    at: Instant,
}

/// A person's position and view.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "camelCase", deny_unknown_fields)]
pub(super) struct Pose {
    /// Metres in the world.
    eye: [f64; 3],
    /// The viewing direction.
    forward: [f64; 3],
    /// Vertical field of view, degrees.
    vfov_deg: f64,
}

/// A page's message.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Here {
    page: String,
    pose: Pose,
    /// The number by which others follow its display, if it has a link.
    leader: Option<Leader>,
    /// The number of the person whose sets it shows.
    follows: Option<u32>,
    /// Its person's call to all others, once.
    call: Option<Call>,
    /// The page closes.
    #[serde(default)]
    leaves: bool,
}

/// A call of a person to all others.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "camelCase", deny_unknown_fields)]
enum Call {
    /// Come to where I am.
    Here(()),
    /// Look at this object.
    Object(u32),
    /// Look at this group of objects.
    Group(u32),
}

/// The number by which a display is followed, in hexadecimal: numbers in JSON have 53 bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
struct Leader(u64);

impl TryFrom<String> for Leader {
    type Error = ParseIntError;

    fn try_from(hex: String) -> Result<Self, ParseIntError> {
        u64::from_str_radix(&hex, 16).map(Self)
    }
}

impl From<Leader> for String {
    fn from(Leader(number): Leader) -> Self {
        format!("{number:x}")
    }
}

/// The answer to it.
#[derive(Debug, PartialEq, Serialize)]
pub(super) struct Company {
    /// Its own number: people are numbered as they come.
    you: u32,
    /// Whether another one shows its sets.
    #[serde(rename = "isFollowed")]
    is_followed: bool,
    others: Vec<Person>,
}

/// Another person.
#[derive(Debug, PartialEq, Serialize)]
struct Person {
    number: u32,
    #[serde(skip_serializing_if = "Option::is_none")]
    name: Option<PersonName>,
    pose: Pose,
    #[serde(skip_serializing_if = "Option::is_none")]
    leader: Option<Leader>,
    /// The person's newest call, for a while.
    #[serde(skip_serializing_if = "Option::is_none")]
    call: Option<Numbered>,
}

/// A call, by whose number a page knows that it is a new one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
struct Numbered {
    number: u32,
    says: Call,
}

/// A page's message is invalid. The text says why.
#[derive(Debug, PartialEq, Eq, Error)]
pub(super) enum NoPlace {
    #[error("a page calls itself by at most {LONGEST_NAME} bytes")]
    Name,
    #[error("nobody can be there and look so")]
    Pose,
}

impl Pose {
    /// Other pages go there when they follow, so it must make a valid camera.
    fn is_possible(&self) -> bool {
        let Self { eye, forward, vfov_deg } = self;
        let length = forward.iter().map(|x| x * x).sum::<f64>().sqrt();
        eye.iter().all(|x| x.abs() <= FARTHEST)
            && (0.5..=2.0).contains(&length)
            && (NARROWEST..180.0).contains(vfov_deg)
    }
}

impl People {
    /// How many there are.
    pub(super) fn count(&self, now: Instant) -> usize {
        self.0.lock().people.values().filter(|known| now.since(known.at) < LEAVES).count()
    }

    /// Registers a person, who meets the others. If they are too many, one of the address with most leaves:
    /// the one silent the longest. So invented names keep nobody else out.
    pub(super) fn meet(
        &self,
        asker: Asker,
        name: Option<PersonName>,
        Here { page, pose, leader, follows, call, leaves }: Here,
        now: Instant,
    ) -> Result<Company, NoPlace> {
        if page.len() > LONGEST_NAME {
            return Err(NoPlace::Name);
        }
        if !pose.is_possible() {
            return Err(NoPlace::Pose);
        }
        let Inner { people, last, last_call } = &mut *self.0.lock();
        people.retain(|_, known| now.since(known.at) < LEAVES);
        if leaves {
            // Nobody reads the answer.
            let you = people.remove(&page).map_or(0, |known| known.number);
            return Ok(Company { you, is_followed: false, others: Vec::new() });
        }
        let before = people.get(&page).and_then(|known| known.call);
        let made = match (call, before) {
            (Some(_), Some(made)) if now.since(made.at) < BETWEEN_CALLS => before,
            (Some(call), _) => {
                *last_call = last_call.wrapping_add(1);
                Some(Made { number: *last_call, call, at: now })
            }
            (None, _) => before.filter(|made| now.since(made.at) < CALLED),
        };
        let you = match people.get(&page) {
            Some(known) => known.number,
            None => {
                if people.len() >= MOST {
                    make_room(people);
                }
                *last = last.wrapping_add(1);
                *last
            }
        };
        people.insert(page, Known { number: you, asker, name, pose, leader, follows, call: made, at: now });
        let others = people.values().filter(|known| known.number != you);
        let person = |known: &Known| {
            let Known { number, leader, call, .. } = *known;
            let call = call.map(|Made { number, call: says, .. }| Numbered { number, says });
            Person { number, name: known.name.clone(), pose: known.pose.clone(), leader, call }
        };
        let mut others: Vec<_> = others.map(person).collect();
        others.sort_unstable_by_key(|person| person.number);
        let is_followed = people.values().any(|known| known.follows == Some(you));
        Ok(Company { you, is_followed, others })
    }
}

fn make_room(people: &mut HashMap<String, Known>) {
    let mut counts: HashMap<Asker, usize> = HashMap::new();
    for known in people.values() {
        *counts.entry(known.asker).or_default() += 1;
    }
    let most = counts.values().max().copied();
    let of_most = people.iter().filter(|(_, known)| counts.get(&known.asker).copied() == most);
    let silent = of_most.min_by_key(|(_, known)| (known.at, known.number));
    if let Some(page) = silent.map(|(page, _)| page.clone()) {
        people.remove(&page);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn here(page: &str, x: f64) -> Here {
        let pose = Pose { eye: [x, 0.0, 0.0], forward: [0.0, 0.0, -1.0], vfov_deg: 60.0 };
        Here { page: page.to_owned(), pose, leader: None, follows: None, call: None, leaves: false }
    }

    fn asker(number: u8) -> Asker {
        Asker::of(trimaran_net::StreamPeer::Tcp(([10, 0, 0, number], 80).into()))
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
        let alone = people.meet(asker(1), None, here("a", 1.0), at(0)).unwrap();
        assert_eq!((alone.you, places(&alone)), (1, vec![]));
        let second = people.meet(asker(1), None, here("b", 2.0), at(1)).unwrap();
        assert_eq!((second.you, places(&second)), (2, vec![(1, 1.0)]));
        people.meet(asker(1), None, here("c", 3.0), at(2)).unwrap();
        let moved = people.meet(asker(1), None, here("a", 9.0), at(89)).unwrap();
        assert_eq!((moved.you, places(&moved)), (1, vec![(2, 2.0), (3, 3.0)]));
        let later = people.meet(asker(1), None, here("a", 9.0), at(91)).unwrap();
        assert_eq!(places(&later), [(3, 3.0)], "the second has left");
        assert_eq!(
            people.meet(asker(1), None, here("b", 2.0), at(91)).unwrap().you,
            4,
            "a number is given once"
        );
    }

    #[test]
    fn a_page_that_closes_leaves_at_once() {
        let people = People::default();
        people.meet(asker(1), None, here("a", 1.0), at(0)).unwrap();
        people.meet(asker(1), None, here("b", 2.0), at(0)).unwrap();
        people.meet(asker(1), None, Here { leaves: true, ..here("a", 1.0) }, at(1)).unwrap();
        assert_eq!(places(&people.meet(asker(1), None, here("b", 2.0), at(1)).unwrap()), []);
        assert_eq!(people.count(at(1)), 1);
        // A page that was never there takes no number and nobody's place.
        for page in 0..2 * MOST {
            people
                .meet(asker(1), None, Here { leaves: true, ..here(&page.to_string(), 3.0) }, at(1))
                .unwrap();
        }
        let next = people.meet(asker(1), None, here("c", 3.0), at(1)).unwrap();
        assert_eq!((next.you, places(&next)), (3, vec![(2, 2.0)]));
    }

    #[test]
    fn invented_names_shut_out_nobody_else() {
        let people = People::default();
        let you = people.meet(asker(2), None, here("honest", 7.0), at(0)).unwrap().you;
        let meet = |name: usize, seconds| {
            people.meet(asker(1), None, here(&name.to_string(), 0.0), at(seconds)).unwrap()
        };
        for name in 0..3 * MOST {
            let company = meet(name, 1);
            assert!(company.others.len() < MOST && places(&company).contains(&(you, 7.0)), "{name}");
        }
        // A person from another address comes as well, and both stay.
        people.meet(asker(3), None, here("other", 8.0), at(2)).unwrap();
        let company = meet(4 * MOST, 3);
        assert!([7.0, 8.0].iter().all(|x| company.others.iter().any(|person| person.pose.eye[0] == *x)));
        assert_eq!(people.meet(asker(2), None, here("honest", 7.0), at(3)).unwrap().you, you);
        // A newcomer of the same address is let in, too.
        assert!(people.meet(asker(1), None, here("of the same address", 9.0), at(3)).is_ok());
    }

    #[test]
    fn a_pose_that_no_camera_can_have_is_refused() {
        let people = People::default();
        let meet = |eye, forward, vfov_deg| {
            let pose = Pose { eye, forward, vfov_deg };
            people.meet(asker(1), None, Here { pose, ..here("a", 0.0) }, at(0)).map(|company| company.you)
        };
        let ahead = [0.0, 0.0, -1.0];
        assert_eq!(meet([1e9, -1e9, 0.0], ahead, 60.0), Ok(1));
        assert_eq!(meet([0.0, 0.0, 1e6], ahead, 0.0573), Ok(1), "a parallel view");
        for (eye, forward, vfov_deg) in [
            ([1e308, -1e308, 1e308], ahead, 60.0),
            ([0.0; 3], [0.0; 3], 60.0),
            ([0.0; 3], [1e200, 0.0, 0.0], 60.0),
            ([0.0; 3], ahead, -1e308),
            ([0.0; 3], ahead, 180.0),
            ([0.0; 3], ahead, 0.001),
            ([f64::NAN, 0.0, 0.0], ahead, 60.0),
        ] {
            assert_eq!(meet(eye, forward, vfov_deg), Err(NoPlace::Pose), "{eye:?} {forward:?} {vfov_deg}");
        }
    }

    #[test]
    fn a_display_is_followed_by_its_number() {
        let read = |leader: &str| {
            let pose = r#"{"eye":[0,0,0],"forward":[0,0,-1],"vfovDeg":60}"#;
            serde_json::from_str(&format!(r#"{{"page":"a","pose":{pose}{leader}}}"#))
        };
        let people = People::default();
        let here: Here = read(r#","leader":"ffffffffffffffff""#).unwrap();
        people.meet(asker(1), None, here, at(0)).unwrap();
        let company =
            people.meet(asker(1), None, Here { page: "b".to_owned(), ..read("").unwrap() }, at(0)).unwrap();
        let told = serde_json::to_value(&company).unwrap();
        assert_eq!(told["others"][0]["leader"], "ffffffffffffffff");
        assert_eq!(told["isFollowed"], false);
        people
            .meet(asker(1), None, Here { page: "b".to_owned(), ..read(r#","follows":1"#).unwrap() }, at(0))
            .unwrap();
        let company =
            people.meet(asker(1), None, Here { page: "a".to_owned(), ..read("").unwrap() }, at(0)).unwrap();
        assert!(company.is_followed);
        for wrong in [r#","leader":"x""#, r#","leader":7"#, r#","leader":"10000000000000000""#] {
            assert!(read(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn others_learn_the_name_that_the_service_knows() {
        let people = People::default();
        let name = |text: &str| Some(text.parse().unwrap());
        people.meet(asker(1), name("Ada L."), here("a", 1.0), at(0)).unwrap();
        people.meet(asker(1), None, here("b", 2.0), at(0)).unwrap();
        let company = people.meet(asker(1), name("Bob"), here("c", 3.0), at(0)).unwrap();
        let told = serde_json::to_value(&company).unwrap();
        assert_eq!(told["others"][0]["name"], "Ada L.");
        assert_eq!(told["others"][1].get("name"), None);
        people.meet(asker(1), None, here("a", 1.0), at(1)).unwrap();
        let company = people.meet(asker(1), None, here("c", 3.0), at(1)).unwrap();
        assert_eq!(company.others[0].name, None, "a person without a name any more");
    }

    #[test]
    fn a_call_reaches_each_of_the_others_for_a_while() {
        let people = People::default();
        let told = |page: &str, call, seconds| {
            let company = people.meet(asker(1), None, Here { call, ..here(page, 1.0) }, at(seconds)).unwrap();
            company.others.iter().map(|person| person.call.map(|call| (call.number, call.says))).collect()
        };
        let nothing: Vec<Option<(u32, Call)>> = told("a", None, 0);
        assert_eq!(nothing, []);
        assert_eq!(told("b", Some(Call::Group(7)), 1), [None]);
        assert_eq!(told("a", None, 1), [Some((1, Call::Group(7)))]);
        // It stays while its person says nothing else, and is numbered once.
        assert_eq!(told("b", None, 8), [None]);
        assert_eq!(told("c", None, 9), [None, Some((1, Call::Group(7)))], "a newcomer hears it, too");
        assert_eq!(told("b", Some(Call::Here(())), 10), [None, None]);
        assert_eq!(told("a", None, 10), [Some((2, Call::Here(()))), None]);
        // Another one at once is not passed on, and nothing is passed on without an end.
        told("b", Some(Call::Object(3)), 10);
        assert_eq!(told("a", None, 10), [Some((2, Call::Here(()))), None]);
        for seconds in [18, 39] {
            told("b", None, seconds);
        }
        assert_eq!(told("a", None, 39), [Some((2, Call::Here(()))), None]);
        told("b", None, 40);
        assert_eq!(told("a", None, 40), [None, None]);
    }

    #[test]
    fn a_call_is_of_a_known_kind() {
        let read = |call: &str| {
            let pose = r#"{"eye":[0,0,0],"forward":[0,0,-1],"vfovDeg":60}"#;
            serde_json::from_str::<Here>(&format!(r#"{{"page":"a","pose":{pose},"call":{call}}}"#))
        };
        assert_eq!(read(r#"{"here":null}"#).unwrap().call, Some(Call::Here(())));
        assert_eq!(read(r#"{"group":4294967295}"#).unwrap().call, Some(Call::Group(u32::MAX)));
        assert_eq!(read("null").unwrap().call, None);
        for wrong in [
            r#""here""#,
            r#"{"here":1}"#,
            r#"{"object":-1}"#,
            r#"{"object":4294967296}"#,
            r#"{"object":1,"group":2}"#,
            r#"{"text":"<b>"}"#,
            "{}",
            "[]",
        ] {
            assert!(read(wrong).is_err(), "{wrong}");
        }
        let said = serde_json::to_value(Numbered { number: 5, says: Call::Object(3) }).unwrap();
        assert_eq!(said, serde_json::json!({ "number": 5, "says": { "object": 3 } }));
    }

    #[test]
    fn names_are_short() {
        let long = People::default().meet(asker(1), None, here(&"x".repeat(LONGEST_NAME + 1), 0.0), at(20));
        assert!(matches!(long, Err(NoPlace::Name)));
    }
}
