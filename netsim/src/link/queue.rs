//! The queue before a link: its limits, and its discipline.

use std::collections::VecDeque;
use std::time::Duration;

use serde::Deserialize;
use trimaran_net::Instant;

/// The queue before a link.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct QueueModel {
    /// How many packets may wait, beside the one that is being sent. Default 1000, Linux's `txqueuelen`.
    pub packets: u32,
    /// How many bytes may wait. Default unlimited.
    pub bytes: u64,
    /// The queue discipline.
    pub discipline: Discipline,
}

/// Queue disciplines.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Discipline {
    /// Drops packets that do not fit.
    #[default]
    DropTail,
    /// Drops packets by the time that they have waited.
    #[serde(rename = "codel")]
    CoDel(CoDel),
}

/// Controlled delay (RFC 8289): when packets have waited at least `target` for an `interval`, some are
/// dropped, ever more often.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CoDel {
    /// How long packets may wait. Default 5 ms.
    #[serde(deserialize_with = "crate::text::duration")]
    pub target: Duration,
    /// How long the target may be exceeded. Default 100 ms.
    #[serde(deserialize_with = "crate::text::duration")]
    pub interval: Duration,
    /// Mark packets that can be marked rather than drop them (RFC 3168). Default true.
    pub ecn: bool,
}

impl Default for QueueModel {
    fn default() -> Self {
        Self { packets: 1000, bytes: u64::MAX, discipline: Discipline::default() }
    }
}

impl Default for CoDel {
    fn default() -> Self {
        Self { target: Duration::from_millis(5), interval: Duration::from_millis(100), ecn: true }
    }
}

/// Waiting items: `T` and its bytes.
#[derive(Debug)]
pub(super) struct Queue<T> {
    model: QueueModel,
    waiting: VecDeque<Entry<T>>,
    bytes: u64,
    control: Control,
}

#[derive(Debug)]
struct Entry<T> {
    since: Instant,
    bytes: u32,
    item: T,
}

/// The decision of the queue management on the packet at the head.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Verdict<T> {
    /// Send it.
    Send(T),
    /// Send it, marked.
    Mark(T),
    /// Drop it, and ask again.
    Drop(T),
}

/// The state of controlled delay; the names are those of RFC 8289, section 5.
#[derive(Debug, Default)]
struct Control {
    first_above: Option<Instant>,
    drop_next: Option<Instant>,
    dropping: bool,
    count: u32,
    last_count: u32,
}

impl<T> Queue<T> {
    pub(super) fn new(model: QueueModel) -> Self {
        Self { model, waiting: VecDeque::new(), bytes: 0, control: Control::default() }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.waiting.is_empty()
    }

    /// Appends an item, or gives it back when there is no room.
    pub(super) fn push(&mut self, now: Instant, bytes: u32, item: T) -> Result<(), T> {
        let room = self.model.bytes.saturating_sub(self.bytes);
        let fits = self.waiting.len() < self.model.packets as usize && u64::from(bytes) <= room;
        if !fits {
            return Err(item);
        }
        self.bytes += u64::from(bytes);
        self.waiting.push_back(Entry { since: now, bytes, item });
        Ok(())
    }

    /// Changes the model. Waiting packets stay, even beyond the new limits.
    pub(super) const fn set_model(&mut self, model: QueueModel) {
        self.model = model;
    }

    /// Takes out everything.
    pub(super) fn drain(&mut self) -> impl Iterator<Item = T> {
        self.bytes = 0;
        self.waiting.drain(..).map(|entry| entry.item)
    }

    /// Takes out the packet at the head, with the decision on it. `markable` says which can be marked.
    pub(super) fn next(
        &mut self,
        now: Instant,
        mtu: u32,
        markable: impl Fn(&T) -> bool,
    ) -> Option<Verdict<T>> {
        let entry = self.waiting.pop_front()?;
        self.bytes -= u64::from(entry.bytes);
        let Discipline::CoDel(codel) = self.model.discipline else { return Some(Verdict::Send(entry.item)) };
        let short = self.bytes <= u64::from(mtu);
        if !self.control.wants_drop(&codel, now, now.since(entry.since), short) {
            return Some(Verdict::Send(entry.item));
        }
        Some(if codel.ecn && markable(&entry.item) {
            Verdict::Mark(entry.item)
        } else {
            Verdict::Drop(entry.item)
        })
    }
}

impl Control {
    fn wants_drop(&mut self, codel: &CoDel, now: Instant, waited: Duration, short: bool) -> bool {
        let above = self.above_for_an_interval(codel, now, waited, short);
        if !above {
            self.dropping = false;
            return false;
        }
        if self.dropping {
            match self.drop_next {
                Some(at) if now >= at => {
                    self.count += 1;
                    self.drop_next = Some(self.after(codel, at));
                    true
                }
                _ => false,
            }
        } else {
            self.dropping = true;
            // Soon after the last dropping state: resume at the rate that helped then.
            let recent = self.drop_next.is_some_and(|at| now.since(at) < 16 * codel.interval);
            let delta = self.count - self.last_count;
            self.count = if recent && delta > 1 { delta } else { 1 };
            self.last_count = self.count;
            self.drop_next = Some(self.after(codel, now));
            true
        }
    }

    fn above_for_an_interval(&mut self, codel: &CoDel, now: Instant, waited: Duration, short: bool) -> bool {
        if waited < codel.target || short {
            self.first_above = None;
            return false;
        }
        match self.first_above {
            None => {
                self.first_above = Some(now.after(codel.interval));
                false
            }
            Some(at) => now >= at,
        }
    }

    fn after(&self, codel: &CoDel, at: Instant) -> Instant {
        let nanos = codel.interval.as_nanos() as f64 / libm::sqrt(f64::from(self.count));
        at.after(Duration::from_nanos(nanos as u64))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(millis: u64) -> Instant {
        Instant::from_nanos(millis * 1_000_000)
    }

    #[test]
    fn what_does_not_fit_comes_back() {
        let mut queue = Queue::new(QueueModel { packets: 2, ..QueueModel::default() });
        assert_eq!(queue.push(at(0), 100, 'a'), Ok(()));
        assert_eq!(queue.push(at(0), 100, 'b'), Ok(()));
        assert_eq!(queue.push(at(0), 100, 'c'), Err('c'));
        assert_eq!(queue.next(at(1), 1500, |_| true), Some(Verdict::Send('a')));
        assert_eq!(queue.push(at(1), 100, 'c'), Ok(()));

        queue.set_model(QueueModel { packets: 3, ..QueueModel::default() });
        assert_eq!((queue.push(at(1), 100, 'd'), queue.push(at(1), 100, 'e')), (Ok(()), Err('e')));

        let mut queue = Queue::new(QueueModel { bytes: 250, ..QueueModel::default() });
        assert_eq!(queue.push(at(0), 200, 'a'), Ok(()));
        assert_eq!(queue.push(at(0), 51, 'b'), Err('b'));
        assert_eq!(queue.push(at(0), 50, 'c'), Ok(()));
        assert_eq!(queue.next(at(1), 1500, |_| true), Some(Verdict::Send('a')));
        assert_eq!(queue.push(at(1), 201, 'd'), Err('d'));
        assert_eq!(queue.push(at(1), 200, 'd'), Ok(()), "whoever leaves makes room for as many bytes");
    }

    /// The times of drops when each packet has waited `waited` and one comes each millisecond.
    fn drops(waited: u64, until: u64) -> Vec<u64> {
        let discipline = Discipline::CoDel(CoDel::default());
        let mut queue = Queue::new(QueueModel { discipline, ..QueueModel::default() });
        (waited..until)
            .filter(|now| {
                // The second one makes the queue longer than a packet.
                queue.push(at(now - waited), 1500, ()).unwrap();
                queue.push(at(now - waited), 1500, ()).unwrap();
                let verdict = queue.next(at(*now), 1000, |()| false).unwrap();
                queue.waiting.clear();
                queue.bytes = 0;
                verdict == Verdict::Drop(())
            })
            .collect()
    }

    #[test]
    fn short_waits_are_left_alone_and_long_ones_only_for_an_interval() {
        assert!(drops(4, 2000).is_empty());
        let times = drops(20, 600);
        assert!((times[0] as i64 - 120).abs() <= 1, "{times:?}");
        assert!(times.len() > 4);
        let gaps: Vec<u64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
        assert!(gaps.windows(2).all(|pair| pair[1] <= pair[0] + 1), "ever faster: {gaps:?}");
        // The interval over the root of the count.
        assert!((99..=102).contains(&gaps[0]) && (70..=73).contains(&gaps[1]), "{gaps:?}");
    }

    /// RFC 8289, section 5: a wait of the target is not below it, and drops resume at the rate that helped.
    #[test]
    fn drops_resume_at_their_rate_only_soon_after_the_last() {
        assert!(!drops(5, 200).is_empty());
        let codel = CoDel::default();
        let count_after = |calm: u32, drops: u64| {
            let (mut control, waited) = (Control::default(), Duration::from_millis(20));
            for now in 0..=100 * drops {
                control.wants_drop(&codel, at(now), waited, false);
            }
            assert!(!control.wants_drop(&codel, at(100 * drops), Duration::ZERO, false));
            let again = control.drop_next.unwrap().after(calm * codel.interval);
            control.first_above = Some(again);
            assert!(control.wants_drop(&codel, again, waited, false));
            control.count
        };
        assert_eq!([1, 15, 16, 30].map(|calm| count_after(calm, 4)), [4, 4, 1, 1]);
        assert_eq!(count_after(1, 1), 1, "after a single drop there is no rate to resume");
    }

    #[test]
    fn what_can_be_marked_is_not_dropped() {
        for (ecn, markable) in [(true, true), (true, false), (false, true)] {
            let discipline = Discipline::CoDel(CoDel { ecn, ..CoDel::default() });
            let mut queue = Queue::new(QueueModel { discipline, ..QueueModel::default() });
            let mut first = None;
            for now in 50..400 {
                for _ in 0..2 {
                    queue.push(at(now - 50), 1500, ()).unwrap();
                }
                let verdict = queue.next(at(now), 100, |()| markable);
                first = first.or(verdict.filter(|v| *v != Verdict::Send(())));
            }
            let expected = if ecn && markable { Verdict::Mark(()) } else { Verdict::Drop(()) };
            assert_eq!(first, Some(expected));
        }
    }
}
