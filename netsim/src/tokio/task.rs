//! Tasks on the host of the task that spawns them.

use std::fmt;
use std::future::poll_fn;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, Waker};

use parking_lot::Mutex;
use thiserror::Error;
use trimaran_net::Net;

use crate::net::SimNet;
use crate::net::context::here;

/// Runs `future` beside the caller, on the same host. It ends with a crash of the host, and at once where the
/// caller is on no host.
pub fn spawn<F>(future: F) -> JoinHandle<F::Output>
where
    F: Future + Send + 'static,
    F::Output: Send + 'static,
{
    let (task, handle) = task(future);
    if let Ok(net) = here() {
        net.spawn(Box::pin(task));
    }
    handle
}

/// Runs `future` on a host, which tokio has no name for. It ends with a crash of the host, and at once where
/// the host is down.
pub fn spawn_on<F>(host: &SimNet, future: F) -> JoinHandle<F::Output>
where
    F: Future + Send + 'static,
    F::Output: Send + 'static,
{
    let (task, handle) = task(future);
    host.spawn(Box::pin(task));
    handle
}

fn task<F: Future>(future: F) -> (Task<F>, JoinHandle<F::Output>) {
    let state = State { output: None, is_finished: false, is_aborted: false, task: None, joiner: None };
    let shared = Arc::new(Mutex::new(state));
    (Task { future: Box::pin(future), shared: Arc::clone(&shared) }, JoinHandle { shared })
}

/// Lets other tasks run.
pub async fn yield_now() {
    let mut yielded = false;
    poll_fn(|cx| {
        if std::mem::replace(&mut yielded, true) {
            return Poll::Ready(());
        }
        cx.waker().wake_by_ref();
        Poll::Pending
    })
    .await;
}

/// A spawned task. Dropping it lets the task go on.
pub struct JoinHandle<T> {
    shared: Arc<Mutex<State<T>>>,
}

impl<T> fmt::Debug for JoinHandle<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("JoinHandle").field("finished", &self.is_finished()).finish_non_exhaustive()
    }
}

/// The task was aborted, or its host crashed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("the task was cancelled")]
pub struct JoinError(());

impl JoinError {
    /// Always: a panic of a task ends the simulation.
    #[must_use]
    pub const fn is_cancelled(&self) -> bool {
        true
    }

    /// Never.
    #[must_use]
    pub const fn is_panic(&self) -> bool {
        false
    }
}

struct State<T> {
    output: Option<T>,
    is_finished: bool,
    is_aborted: bool,
    task: Option<Waker>,
    joiner: Option<Waker>,
}

impl<T> JoinHandle<T> {
    /// Ends the task when it would next run.
    pub fn abort(&self) {
        let task = {
            let mut state = self.shared.lock();
            state.is_aborted = true;
            state.task.take()
        };
        task.into_iter().for_each(Waker::wake);
    }

    /// Whether the task has ended.
    #[must_use]
    pub fn is_finished(&self) -> bool {
        self.shared.lock().is_finished
    }
}

impl<T> Future for JoinHandle<T> {
    type Output = Result<T, JoinError>;

    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Self::Output> {
        let mut state = self.shared.lock();
        if state.is_finished {
            return Poll::Ready(state.output.take().ok_or(JoinError(())));
        }
        state.joiner = Some(cx.waker().clone());
        Poll::Pending
    }
}

/// The task itself; when it is dropped, it has finished.
struct Task<F: Future> {
    future: Pin<Box<F>>,
    shared: Arc<Mutex<State<F::Output>>>,
}

impl<F: Future> Future for Task<F> {
    type Output = ();

    fn poll(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<()> {
        if self.shared.lock().is_aborted {
            return Poll::Ready(());
        }
        let output = self.future.as_mut().poll(cx);
        let mut state = self.shared.lock();
        match output {
            Poll::Ready(output) => {
                state.output = Some(output);
                Poll::Ready(())
            }
            Poll::Pending => {
                state.task = Some(cx.waker().clone());
                Poll::Pending
            }
        }
    }
}

impl<F: Future> Drop for Task<F> {
    fn drop(&mut self) {
        let joiner = {
            let mut state = self.shared.lock();
            state.is_finished = true;
            state.joiner.take()
        };
        joiner.into_iter().for_each(Waker::wake);
    }
}
