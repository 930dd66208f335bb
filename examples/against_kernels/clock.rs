//! Microsecond timers: tokio's timers have a grain of a millisecond, and the roles' computing times do not.
#![allow(clippy::disallowed_methods, reason = "real packets keep real time")]

use std::collections::BTreeMap;
use std::io;
use std::net::SocketAddr;
use std::num::NonZeroU64;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::task::{Context, Poll, Waker};
use std::thread;
use std::time::Duration;

use rustix::thread::set_current_timer_slack;
use trimaran_net::{BoxFuture, Listen, Stream, Timer, UdpSocket};
use trimaran_transport::{Instant, Net, TcpOptions, TokioNet, UdpSocketOptions};

/// How often, at least, an alarm checks whether it is still needed.
const GLANCE: Duration = Duration::from_millis(100);

/// A network with exact timers, whose time starts at a moment shared by several of them.
#[derive(Debug)]
pub(crate) struct Clock {
    start: std::time::Instant,
    net: TokioNet,
    alarm: Arc<Alarm>,
}

impl Clock {
    pub(crate) fn new(start: std::time::Instant, net: TokioNet) -> Self {
        let (waiting, changed, next) = (Mutex::default(), Condvar::new(), AtomicU64::new(0));
        let alarm = Arc::new(Alarm { waiting, changed, next });
        thread::spawn({
            let alarm = Arc::clone(&alarm);
            move || alarm.ring(start)
        });
        Self { start, net, alarm }
    }
}

impl Net for Clock {
    fn now(&self) -> Instant {
        Instant::from_nanos(0).after(self.start.elapsed())
    }

    fn timer(&self) -> Box<dyn Timer> {
        Box::new(AlarmTimer { start: self.start, alarm: Arc::clone(&self.alarm), due: None })
    }

    fn spawn(&self, task: BoxFuture<'static, ()>) {
        self.net.spawn(task);
    }

    fn random(&self) -> io::Result<u64> {
        self.net.random()
    }

    fn resolve<'a>(&'a self, address: &'a str) -> BoxFuture<'a, io::Result<Vec<SocketAddr>>> {
        self.net.resolve(address)
    }

    fn connect_tcp(&self, to: SocketAddr, options: TcpOptions) -> BoxFuture<'_, io::Result<Stream>> {
        self.net.connect_tcp(to, options)
    }

    fn listen_tcp(&self, at: SocketAddr, options: TcpOptions) -> io::Result<(Box<dyn Listen>, SocketAddr)> {
        self.net.listen_tcp(at, options)
    }

    fn bind_udp(&self, at: SocketAddr, options: UdpSocketOptions) -> io::Result<Arc<dyn UdpSocket>> {
        self.net.bind_udp(at, options)
    }
}

/// Wakes waiting tasks on time and not a millisecond later, by a thread that sleeps until then.
#[derive(Debug)]
struct Alarm {
    waiting: Mutex<BTreeMap<(Duration, u64), Waker>>,
    changed: Condvar,
    /// Numbers waits, to distinguish those for the same moment.
    next: AtomicU64,
}

impl Alarm {
    fn set(&self, at: Duration, waker: Waker) {
        let number = self.next.fetch_add(1, Ordering::Relaxed);
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner).insert((at, number), waker);
        self.changed.notify_one();
    }

    /// Wakes tasks until the clock, its other owner, is gone.
    fn ring(self: &Arc<Self>, start: std::time::Instant) {
        // Without the privilege timers are 50 us late.
        let _slack = set_current_timer_slack(NonZeroU64::new(1));
        let mut waiting = self.waiting.lock().unwrap_or_else(PoisonError::into_inner);
        while Arc::strong_count(self) > 1 {
            let now = start.elapsed();
            while let Some(entry) = waiting.first_entry().filter(|entry| entry.key().0 <= now) {
                entry.remove().wake();
            }
            let next =
                waiting.first_key_value().map_or(GLANCE, |((at, _), _)| at.saturating_sub(now).min(GLANCE));
            (waiting, _) = self.changed.wait_timeout(waiting, next).unwrap_or_else(PoisonError::into_inner);
        }
    }
}

struct AlarmTimer {
    start: std::time::Instant,
    alarm: Arc<Alarm>,
    due: Option<Duration>,
}

impl Timer for AlarmTimer {
    fn reset(&mut self, at: Instant) {
        self.due = Some(Duration::from_nanos(at.as_nanos()));
    }

    fn poll(&mut self, cx: &mut Context<'_>) -> Poll<()> {
        let Some(due) = self.due else { return Poll::Pending };
        if due <= self.start.elapsed() {
            return Poll::Ready(());
        }
        self.alarm.set(due, cx.waker().clone());
        Poll::Pending
    }
}
