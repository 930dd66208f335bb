//! Searches for clashes that pages ask for: each runs on threads of its own, and its page asks how far it is.

use std::{
    collections::HashMap,
    panic::{AssertUnwindSafe, catch_unwind},
    sync::{
        Arc, OnceLock,
        atomic::{AtomicBool, AtomicUsize, Ordering},
    },
    thread,
    time::Duration,
};

use parking_lot::Mutex;
use serde::{Deserialize, Serialize};
use trimaran_net::{Instant, Net};
use trimaran_proto::ObjectSet;
use trimaran_scene::{
    GroupLevel, ReadError, Scene,
    clearance::{ClashRule, Clashes, ClearanceError, Clearances, Watch},
};
use trimaran_transport::causes;

use super::rows::{ClashRow, rows};
use crate::page::parts::that_fit;

/// The longest request of a page, bytes: its sets may be of a hundred thousand runs.
pub(in crate::page) const LONGEST_REQUEST: usize = 2 << 20;
/// The most searches at a time, and the most processors for one. Culling has the others.
const SEARCHES: usize = 4;
const THREADS: usize = 4;
/// The most triangles of both sets together, and the most clashes.
const TRIANGLES: u64 = 64 << 20;
const CLASHES: usize = 10_000;
/// The most clashes in an answer.
const LISTED: usize = 200;
/// The largest tolerance, metres.
const FARTHEST: f64 = 1000.0;
/// A page that does not ask for this long has gone, and its search ends. Browsers let hidden pages ask once
/// a minute.
const LEAVES: Duration = Duration::from_secs(90);

/// The searches on a scene, by their pages' names for themselves. A page has one at a time.
#[derive(Debug)]
pub(in crate::page) struct ClashJobs {
    scene: Arc<Scene>,
    /// The model's name in links.
    name: String,
    jobs: Mutex<HashMap<String, Arc<Job>>>,
}

/// A page's request.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(in crate::page) struct ClashRequest {
    page: String,
    act: Act,
}

#[derive(Debug, Deserialize)]
#[serde(tag = "do", rename_all = "camelCase", deny_unknown_fields)]
enum Act {
    /// Begins a search, in place of the one before. The tolerance is in metres. Pairs in the same group of
    /// the level `ignore` are only counted.
    Start { between: ObjectSet, and: ObjectSet, tolerance: f64, ignore: Option<GroupLevel> },
    /// Asks for its progress, and for the clashes from this number on.
    Ask { from: usize },
    /// Ends it.
    Cancel,
}

/// The state of a page's search.
#[derive(Debug, Default, PartialEq, Serialize)]
#[serde(rename_all = "camelCase")]
pub(in crate::page) struct ClashAnswer {
    /// How many of all objects of the first set have been compared.
    done: usize,
    of: usize,
    is_over: bool,
    /// How many clashes there are in all, once it is over.
    total: usize,
    /// How many more there are that were to be ignored.
    ignored: usize,
    /// Some of them, from the one asked for.
    clashes: Vec<ClashRow>,
    /// Why there are none, in a sentence.
    #[serde(skip_serializing_if = "Option::is_none")]
    fault: Option<String>,
}

#[derive(Debug)]
struct Job {
    /// When its page last asked.
    asked: Mutex<Instant>,
    is_cancelled: AtomicBool,
    done: AtomicUsize,
    of: AtomicUsize,
    outcome: OnceLock<Result<Found, String>>,
}

/// The result of a search.
#[derive(Debug)]
struct Found {
    rows: Vec<ClashRow>,
    /// How many more there are that were to be ignored.
    ignored: usize,
}

impl ClashJobs {
    /// On this scene, which is called `name` in links.
    pub(in crate::page) fn new(scene: &Arc<Scene>, name: String) -> Self {
        Self { scene: Arc::clone(scene), name, jobs: Mutex::default() }
    }

    /// Does what a page asks for, and says how its search is.
    pub(in crate::page) fn answer(&self, request: ClashRequest, net: &Arc<dyn Net>) -> ClashAnswer {
        let ClashRequest { page, act } = request;
        let (mut jobs, now) = (self.jobs.lock(), net.now());
        jobs.retain(|_, job| !job.is_abandoned(now));
        match act {
            Act::Start { tolerance, .. } if !(0.0..=FARTHEST).contains(&tolerance) => {
                ClashAnswer::fault(format!("The tolerance must be from 0 to {FARTHEST} m."))
            }
            Act::Start { between, and, tolerance, ignore } => {
                if let Some(before) = jobs.remove(&page) {
                    before.is_cancelled.store(true, Ordering::Relaxed);
                }
                if jobs.values().filter(|job| job.outcome.get().is_none()).count() >= SEARCHES {
                    let why = "This service searches for clashes of other people. Try again in a minute.";
                    return ClashAnswer::fault(why.to_owned());
                }
                let job = Arc::new(Job::new(now));
                jobs.insert(page, Arc::clone(&job));
                self.start(&job, [between, and], tolerance, ignore, net);
                job.answer(0)
            }
            Act::Ask { from } => match jobs.get(&page) {
                Some(job) => {
                    *job.asked.lock() = now;
                    job.answer(from)
                }
                None => ClashAnswer::fault("The service has ended this search. Run it again.".to_owned()),
            },
            Act::Cancel => {
                if let Some(job) = jobs.remove(&page) {
                    job.is_cancelled.store(true, Ordering::Relaxed);
                }
                ClashAnswer { is_over: true, ..ClashAnswer::default() }
            }
        }
    }

    fn start(
        &self,
        job: &Arc<Job>,
        sets: [ObjectSet; 2],
        tolerance: f64,
        ignore: Option<GroupLevel>,
        net: &Arc<dyn Net>,
    ) {
        let (scene, name) = (Arc::clone(&self.scene), self.name.clone());
        let watched = Watched { job: Arc::clone(job), net: Arc::clone(net) };
        let work = move || {
            let [between, and] = &sets;
            let rule = ClashRule { between, and, tolerance, groups: &[], most: CLASHES };
            // A panic in one search does not affect the others.
            let found = catch_unwind(AssertUnwindSafe(|| search(&scene, &name, &rule, ignore, &watched)));
            let _once = watched.job.outcome.set(match found {
                Ok(found) => found.map_err(|fault| fault.told()),
                Err(_) => Err("The search failed.".to_owned()),
            });
        };
        if thread::Builder::new().name("clashes".to_owned()).spawn(work).is_err() {
            let _once = job.outcome.set(Err("The service has no thread for a search.".to_owned()));
        }
    }
}

impl Drop for ClashJobs {
    fn drop(&mut self) {
        for job in self.jobs.lock().values() {
            job.is_cancelled.store(true, Ordering::Relaxed);
        }
    }
}

impl Job {
    fn new(now: Instant) -> Self {
        Self {
            asked: Mutex::new(now),
            is_cancelled: AtomicBool::new(false),
            done: AtomicUsize::new(0),
            of: AtomicUsize::new(0),
            outcome: OnceLock::new(),
        }
    }

    fn is_abandoned(&self, now: Instant) -> bool {
        now.since(*self.asked.lock()) > LEAVES
    }

    fn answer(&self, from: usize) -> ClashAnswer {
        let progress = ClashAnswer {
            done: self.done.load(Ordering::Relaxed),
            of: self.of.load(Ordering::Relaxed),
            ..ClashAnswer::default()
        };
        match self.outcome.get() {
            None => progress,
            Some(Err(fault)) => ClashAnswer::fault(fault.clone()),
            Some(Ok(found)) => ClashAnswer {
                is_over: true,
                total: found.rows.len(),
                ignored: found.ignored,
                clashes: that_fit(found.rows.iter().skip(from).take(LISTED).cloned()),
                ..progress
            },
        }
    }
}

impl ClashAnswer {
    fn fault(why: String) -> Self {
        Self { is_over: true, fault: Some(why), ..Self::default() }
    }
}

/// Tells a job how far its search is, and ends it when the page has gone.
struct Watched {
    job: Arc<Job>,
    net: Arc<dyn Net>,
}

impl Watch for Watched {
    fn advance(&self, done: usize, of: usize) {
        self.job.done.fetch_max(done, Ordering::Relaxed);
        self.job.of.store(of, Ordering::Relaxed);
    }

    fn is_stopped(&self) -> bool {
        self.job.is_cancelled.load(Ordering::Relaxed) || self.job.is_abandoned(self.net.now())
    }
}

/// Why a search has found nothing.
enum Fault {
    Search(ClearanceError),
    Triangles(u64),
    Threads(rayon::ThreadPoolBuildError),
}

impl From<ReadError> for Fault {
    fn from(error: ReadError) -> Self {
        Self::Search(error.into())
    }
}

impl Fault {
    /// In a sentence for a page.
    fn told(&self) -> String {
        match self {
            Self::Search(ClearanceError::Stopped) => "The search was cancelled.".to_owned(),
            Self::Search(ClearanceError::TooMany { most }) => format!(
                "There are more than {most} clashes. Ignore those of the same part or equipment, or \
                 choose smaller sets or a smaller tolerance; the command trimaran clash lists more."
            ),
            Self::Search(error) => {
                tracing::warn!("{}", causes(error));
                "The scene's file cannot be read.".to_owned()
            }
            Self::Triangles(count) => format!(
                "Both sets together have {count} triangles, and the service compares at most {TRIANGLES}. \
                 Choose smaller sets; the command trimaran clash has no such limit."
            ),
            Self::Threads(error) => {
                tracing::warn!("{}", causes(error));
                "The service has no thread for a search.".to_owned()
            }
        }
    }
}

fn search(
    scene: &Scene,
    name: &str,
    rule: &ClashRule<'_>,
    ignore: Option<GroupLevel>,
    watched: &Watched,
) -> Result<Found, Fault> {
    // The records that it reads are not to stay in memory.
    let scene = scene.opened_again()?;
    let count = scene.objects().len() as u32;
    let mut triangles: u64 = 0;
    for run in [rule.between, rule.and].into_iter().flat_map(ObjectSet::runs) {
        for object in run.start..run.end.min(count) {
            triangles += scene.extent(object).triangles;
            if watched.is_stopped() {
                return Err(Fault::Search(ClearanceError::Stopped));
            }
        }
    }
    if triangles > TRIANGLES {
        return Err(Fault::Triangles(triangles));
    }
    let processors = thread::available_parallelism().map_or(1, usize::from);
    let threads = (processors / 4).clamp(1, THREADS);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().map_err(Fault::Threads)?;
    let hierarchy = scene.hierarchy()?;
    let groups = ignore.map(|level| hierarchy.groups_at(level, count)).unwrap_or_default();
    let rule = ClashRule { groups: &groups, ..*rule };
    let found = pool.install(|| Clearances::new(&scene).clashes(&rule, watched));
    let Clashes { found, ignored } = found.map_err(Fault::Search)?;
    let rows = rows(&scene, &hierarchy, name, &found)?;
    Ok(Found { rows: rows.into_iter().map(ClashRow::cut).collect(), ignored })
}

#[cfg(test)]
mod tests {
    use serde_json::json;
    use tokio::runtime::{Builder, Runtime};
    use trimaran_cook::{
        CookOptions, cook,
        generate::{PlantOptions, plant},
    };
    use trimaran_net::TokioNet;
    use trimaran_scene::{Extent, Group};

    use super::*;

    fn jobs() -> (ClashJobs, Arc<dyn Net>, Runtime) {
        let mut model = plant(&PlantOptions::small(7));
        let group = |name: &str, parent| Group {
            name: name.into(),
            parent,
            objects: 0..model.objects.len() as u32,
            attributes: Vec::new(),
            extent: Extent::default(),
        };
        model.hierarchy.groups = vec![group("plant.RVM", None), group("/ZONE", Some(0))];
        let scene = Arc::new(cook(&model, &CookOptions::default(), &()).unwrap());
        let runtime = Builder::new_current_thread().enable_all().build().unwrap();
        let net: Arc<dyn Net> = Arc::new(TokioNet::new(runtime.handle().clone()));
        (ClashJobs::new(&scene, "plant".to_owned()), net, runtime)
    }

    fn request(page: &str, act: serde_json::Value) -> ClashRequest {
        serde_json::from_value(json!({ "page": page, "act": act })).unwrap()
    }

    fn start(tolerance: f64) -> serde_json::Value {
        json!({ "do": "start", "between": [[0, 999_999]], "and": [[0, 999_999]], "tolerance": tolerance })
    }

    fn ended(jobs: &ClashJobs, net: &Arc<dyn Net>, page: &str, from: usize) -> ClashAnswer {
        loop {
            let answer = jobs.answer(request(page, json!({ "do": "ask", "from": from })), net);
            if answer.is_over {
                return answer;
            }
            thread::sleep(Duration::from_millis(5));
        }
    }

    #[test]
    fn a_page_gets_all_clashes_answer_by_answer() {
        let (jobs, net, _runtime) = jobs();
        assert_eq!(jobs.answer(request("a", start(0.05)), &net).fault, None);
        let first = ended(&jobs, &net, "a", 0);
        assert!(first.fault.is_none() && first.total > 0 && first.done == first.of, "{first:?}");
        let mut all = first.clashes;
        while all.len() < first.total {
            let more = ended(&jobs, &net, "a", all.len()).clashes;
            assert!(!more.is_empty() && more.len() <= LISTED);
            all.extend(more);
        }
        let whole: ObjectSet = (0..jobs.scene.objects().len() as u32).collect();
        let rule = ClashRule { between: &whole, and: &whole, tolerance: 0.05, groups: &[], most: CLASHES };
        let expected = Clearances::new(&jobs.scene).clashes(&rule, &()).unwrap().found;
        assert_eq!(first.ignored, 0);
        assert_eq!(all, rows(&jobs.scene, &jobs.scene.hierarchy().unwrap(), "plant", &expected).unwrap());
        assert!(ended(&jobs, &net, "a", usize::MAX).clashes.is_empty());
        // All of them are in one zone.
        let mut within = start(0.05);
        within["ignore"] = json!("part");
        jobs.answer(request("a", within), &net);
        let none = ended(&jobs, &net, "a", 0);
        assert_eq!((none.total, none.ignored, none.fault), (0, first.total, None));
    }

    #[test]
    fn a_search_ends_when_it_is_cancelled_replaced_or_left() {
        let (jobs, net, _runtime) = jobs();
        jobs.answer(request("a", start(0.1)), &net);
        let before = Arc::clone(&jobs.jobs.lock()["a"]);
        jobs.answer(request("a", start(0.2)), &net);
        assert!(before.is_cancelled.load(Ordering::Relaxed));
        let now = Arc::clone(&jobs.jobs.lock()["a"]);
        assert!(jobs.answer(request("a", json!({ "do": "cancel" })), &net).is_over);
        assert!(now.is_cancelled.load(Ordering::Relaxed));
        let gone = jobs.answer(request("a", json!({ "do": "ask", "from": 0 })), &net);
        assert!(gone.is_over && gone.fault.unwrap().contains("Run it again"));
        // A page that asks no more.
        let left = Job::new(Instant::from_nanos(0));
        let at = |seconds: u64| Instant::from_nanos(seconds * 1_000_000_000);
        assert!(!left.is_abandoned(at(89)) && left.is_abandoned(at(91)));
    }

    #[test]
    fn only_some_search_at_a_time_and_each_gets_its_own() {
        let (jobs, net, _runtime) = jobs();
        // Searches that never end.
        for page in 0..SEARCHES {
            jobs.jobs.lock().insert(page.to_string(), Arc::new(Job::new(net.now())));
        }
        let refused = jobs.answer(request("late", start(0.1)), &net).fault.unwrap();
        assert!(refused.contains("Try again"), "{refused}");
        jobs.answer(request("0", json!({ "do": "cancel" })), &net);
        assert_eq!(jobs.answer(request("late", start(0.0)), &net).fault, None);
        assert_eq!(ended(&jobs, &net, "late", 0).fault, None);
    }

    #[test]
    fn a_request_without_sense_is_refused() {
        let (jobs, net, _runtime) = jobs();
        for tolerance in [-0.1, 1e9] {
            let fault = jobs.answer(request("a", start(tolerance)), &net).fault.unwrap();
            assert!(fault.contains("tolerance"), "{fault}");
        }
        let set = json!([[0, 3]]);
        for act in [
            json!({ "do": "start", "between": set, "and": set }),
            json!({ "do": "start", "between": [[0, 4_294_967_295_u32]], "and": set, "tolerance": 0 }),
            json!({ "do": "start", "between": [[-1, 0]], "and": set, "tolerance": 0 }),
            json!({ "do": "start", "between": set, "and": set, "tolerance": null }),
            json!({ "do": "start", "between": set, "and": set, "tolerance": 0, "ignore": "zone" }),
            json!({ "do": "ask", "from": -1 }),
            json!({ "do": "else" }),
        ] {
            let request = json!({ "page": "a", "act": act });
            assert!(serde_json::from_value::<ClashRequest>(request).is_err(), "{act}");
        }
        // More clashes than a page gets.
        let far = jobs.answer(request("a", start(900.0)), &net);
        assert_eq!(far.fault, None);
        let count = jobs.scene.objects().len();
        let answer = ended(&jobs, &net, "a", 0);
        match count * (count - 1) / 2 > CLASHES {
            true => assert!(answer.fault.unwrap().contains("more than 10000")),
            false => assert_eq!(answer.total, count * (count - 1) / 2),
        }
    }
}
