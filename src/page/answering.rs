//! The threads that answer pages' questions. They are few, have a bounded queue, and are separate from
//! threads of links and culling.

use std::{
    collections::VecDeque,
    io,
    panic::{AssertUnwindSafe, catch_unwind},
    sync::Arc,
    thread,
};

use hyper::{Response, StatusCode, header};
use parking_lot::{Condvar, Mutex};
use tokio::sync::oneshot;

use super::{
    questions::{Answers, Question},
    server::{Body, plain},
};
use crate::http::Asker;

/// The most questions that wait. A page asks for nine tiles at once.
const WAITING: usize = 256;
/// The most threads. A machine has one per four processors, so that culling has the others.
const THREADS: usize = 4;

/// Answers questions, until it is dropped.
#[derive(Debug)]
pub(super) struct Answering {
    queue: Arc<Queue>,
}

#[derive(Debug, Default)]
struct Queue {
    waiting: Mutex<Waiting>,
    has_come: Condvar,
}

/// Questions by client: clients are served in turn.
#[derive(Debug, Default)]
struct Waiting {
    askers: VecDeque<(Asker, VecDeque<Job>)>,
    count: usize,
    is_over: bool,
}

#[derive(Debug)]
struct Job {
    question: Question,
    answered: oneshot::Sender<Response<Body>>,
}

impl Answering {
    /// Begins to answer about a scene.
    ///
    /// # Errors
    /// When the system gives no thread.
    pub(super) fn start(answers: &Arc<Answers>) -> io::Result<Self> {
        let answering = Self { queue: Arc::default() };
        let processors = thread::available_parallelism().map_or(1, usize::from);
        for _ in 0..(processors / 4).clamp(1, THREADS) {
            let (queue, answers) = (Arc::clone(&answering.queue), Arc::clone(answers));
            thread::Builder::new().name("answers".to_owned()).spawn(move || queue.answer(&answers))?;
        }
        Ok(answering)
    }

    /// The answer, or that the service is busy if too many questions wait. Dropping it gives the question up.
    pub(super) async fn ask(&self, asker: Asker, question: Question) -> Response<Body> {
        let (answered, answer) = oneshot::channel();
        self.queue.add(asker, Job { question, answered });
        answer.await.unwrap_or_else(|_| plain(StatusCode::INTERNAL_SERVER_ERROR, "there is no answer\n"))
    }
}

impl Drop for Answering {
    fn drop(&mut self) {
        self.queue.waiting.lock().is_over = true;
        self.queue.has_come.notify_all();
    }
}

impl Queue {
    fn add(&self, asker: Asker, job: Job) {
        let too_many = self.waiting.lock().add(asker, job);
        self.has_come.notify_one();
        if let Some(Job { answered, .. }) = too_many {
            let _gone = answered.send(busy());
        }
    }

    /// Answers questions as they come, until it is over.
    fn answer(&self, answers: &Answers) {
        while let Some(Job { question, answered }) = self.next() {
            let is_given_up = || answered.is_closed();
            // A panic in one question does not affect the next.
            let answer = catch_unwind(AssertUnwindSafe(|| answers.answer(&question, &is_given_up)));
            if let Ok(Some(answer)) = answer {
                let _gone = answered.send(answer);
            }
        }
    }

    fn next(&self) -> Option<Job> {
        let mut waiting = self.waiting.lock();
        loop {
            if waiting.is_over {
                return None;
            }
            match waiting.next() {
                Some(job) => return Some(job),
                None => self.has_come.wait(&mut waiting),
            }
        }
    }
}

impl Waiting {
    /// Adds a job. Returns one if there is no room: this one, or the newest of the client with most.
    fn add(&mut self, asker: Asker, job: Job) -> Option<Job> {
        if self.count >= WAITING {
            self.give_up();
        }
        let own = self.askers.iter().find(|(other, _)| *other == asker).map_or(0, |(_, jobs)| jobs.len());
        let mut too_many = None;
        if self.count >= WAITING {
            let most = self.askers.iter_mut().max_by_key(|(_, jobs)| jobs.len());
            let Some((_, jobs)) = most.filter(|(_, jobs)| jobs.len() > own + 1) else { return Some(job) };
            too_many = jobs.pop_back();
            self.count -= 1;
        }
        match self.askers.iter_mut().find(|(other, _)| *other == asker) {
            Some((_, jobs)) => jobs.push_back(job),
            None => self.askers.push_back((asker, VecDeque::from([job]))),
        }
        self.count += 1;
        too_many
    }

    /// The oldest job of the next client in turn, if the client still waits for it.
    fn next(&mut self) -> Option<Job> {
        while let Some((asker, mut jobs)) = self.askers.pop_front() {
            let job = jobs.pop_front();
            self.count -= usize::from(job.is_some());
            if !jobs.is_empty() {
                self.askers.push_back((asker, jobs));
            }
            if let Some(job) = job.filter(|job| !job.answered.is_closed()) {
                return Some(job);
            }
        }
        None
    }

    /// Removes the jobs whose clients have gone.
    fn give_up(&mut self) {
        for (_, jobs) in &mut self.askers {
            jobs.retain(|job| !job.answered.is_closed());
        }
        self.askers.retain(|(_, jobs)| !jobs.is_empty());
        self.count = self.askers.iter().map(|(_, jobs)| jobs.len()).sum();
    }
}

/// Says that it is too much at once, and when to ask again.
pub(super) fn busy() -> Response<Body> {
    let mut response =
        plain(StatusCode::SERVICE_UNAVAILABLE, "too many ask at once: ask again in a second\n");
    response.headers_mut().insert(header::RETRY_AFTER, header::HeaderValue::from_static("1"));
    response
}

#[cfg(test)]
mod tests {
    use trimaran_net::StreamPeer;

    use super::*;

    type Answer = oneshot::Receiver<Response<Body>>;

    fn asker(number: u8) -> Asker {
        Asker::of(StreamPeer::Tcp(([10, 0, 0, number], 80).into()))
    }

    fn job(x: i32) -> (Job, Answer) {
        let (answered, answer) = oneshot::channel();
        (Job { question: Question::Tile { x, z: 0 }, answered }, answer)
    }

    fn asked(job: &Job) -> i32 {
        let Question::Tile { x, .. } = job.question else { panic!("{job:?}") };
        x
    }

    /// A client with few questions is answered soon, however many another asks.
    #[test]
    fn askers_are_answered_in_turn_and_the_one_with_most_is_turned_away() {
        let mut waiting = Waiting::default();
        let mut answers: Vec<Answer> = Vec::new();
        let mut ask = |waiting: &mut Waiting, who: u8, x: i32| {
            let (job, answer) = job(x);
            answers.push(answer);
            waiting.add(asker(who), job).map(|job| asked(&job))
        };
        for x in 0..WAITING as i32 {
            assert_eq!(ask(&mut waiting, 1, x), None);
        }
        assert_eq!(ask(&mut waiting, 1, 999), Some(999), "there is no room for more of the same");
        assert_eq!(
            ask(&mut waiting, 2, -1),
            Some(WAITING as i32 - 1),
            "another takes the place of the newest"
        );
        assert_eq!(ask(&mut waiting, 2, -2), Some(WAITING as i32 - 2));
        assert_eq!(waiting.count, WAITING);
        let order: Vec<i32> = (0..6).map(|_| asked(&waiting.next().unwrap())).collect();
        assert_eq!(order, [0, -1, 1, -2, 2, 3]);
    }

    #[test]
    fn what_nobody_waits_for_is_left_out() {
        let mut waiting = Waiting::default();
        for x in 0..WAITING as i32 {
            let (job, gone) = job(x);
            assert!(waiting.add(asker(1), job).is_none());
            drop(gone);
        }
        let (one, _waits) = job(7);
        assert!(waiting.add(asker(1), one).is_none(), "those that are gone make room");
        assert_eq!((waiting.count, asked(&waiting.next().unwrap()), waiting.count), (1, 7, 0));
        assert!(waiting.next().is_none() && waiting.count == 0 && waiting.askers.is_empty());
    }

    #[test]
    fn whoever_is_too_many_hears_when_to_ask_again() {
        let busy = busy();
        assert_eq!(busy.status(), StatusCode::SERVICE_UNAVAILABLE);
        assert_eq!(busy.headers()["retry-after"], "1");
    }
}
