//! The next turn among roles that share a device: each gets the same time, whatever its frames cost.
//!
//! Fair queueing by virtual time (Goyal, Vin and Cheng, 1996). A piece of work starts at the start of the
//! running piece when it is requested, or at the end of the role's previous work, whichever is later. The
//! next piece is the one with the earliest expected end, if it takes as long as the last of its role. So a
//! role that uses less than its share waits for one piece of another. Of two busy roles neither gets ahead by
//! more than a piece of each. If several may have the device at once, so that one computes on the host while
//! the device works for another one, each free turn goes to the next one by the same rule (SFQ(D); Jin, Chase
//! and Kaur, 2004). A new role begins behind all present ones: otherwise displays that come and go
//! would always be first.

use std::{collections::BTreeMap, time::Duration};

/// A role that shares the device.
pub(crate) type Number = u64;

/// The turns of all roles.
#[derive(Debug)]
pub(crate) struct Shares {
    /// Otherwise the one that waits longest is next.
    by_time: bool,
    accounts: BTreeMap<Number, Account>,
    joined: Number,
    /// Virtual time: the start of the running piece, or of the last one.
    now: Duration,
    /// How many may have the device at once, and how many have it.
    most: usize,
    holders: usize,
    /// In the order of their requests.
    waiting: Vec<Number>,
}

/// A role's use of the device.
#[derive(Debug, Clone, Copy, Default)]
struct Account {
    /// The start of its next or present piece, and the end of the last one: virtual time.
    start: Duration,
    end: Duration,
    /// The time of the last piece.
    took: Duration,
}

impl Shares {
    pub(crate) fn new(by_time: bool, most: usize) -> Self {
        let (accounts, waiting) = (BTreeMap::new(), Vec::new());
        Self { by_time, accounts, joined: 0, now: Duration::ZERO, most, holders: 0, waiting }
    }

    /// One more role.
    pub(crate) fn join(&mut self) -> Number {
        // Reconnecting gains nothing: the first piece may be as long as any, and others have had theirs.
        let took = self.accounts.values().map(|account| account.took).max().unwrap_or_default();
        let end = self.accounts.values().map(|account| account.end).max().unwrap_or_default().max(self.now);
        self.joined += 1;
        self.accounts.insert(self.joined, Account { took, end, ..Account::default() });
        self.joined
    }

    /// Removes a role.
    pub(crate) fn leave(&mut self, role: Number) {
        self.accounts.remove(&role);
        self.withdraw(role);
    }

    /// A role waits for its turn.
    pub(crate) fn ask(&mut self, role: Number) {
        if let Some(account) = self.accounts.get_mut(&role) {
            account.start = account.end.max(self.now);
            self.withdraw(role);
            self.waiting.push(role);
        }
    }

    /// A role waits no longer. Its place counts from its next request.
    pub(crate) fn withdraw(&mut self, role: Number) {
        self.waiting.retain(|waiting| *waiting != role);
    }

    /// Whether roles share by time.
    pub(crate) const fn is_by_time(&self) -> bool {
        self.by_time
    }

    /// Whether they do, and one waits.
    pub(crate) fn is_awaited(&self) -> bool {
        self.by_time && !self.waiting.is_empty()
    }

    /// Gives a free turn to the next role.
    pub(crate) fn next(&mut self) -> Option<Number> {
        if self.holders >= self.most {
            return None;
        }
        let account = |role: &Number| self.accounts.get(role).copied().unwrap_or_default();
        let end = |role: &Number| account(role).start + account(role).took;
        let places = 0..self.waiting.len();
        let place = match self.by_time {
            // Of equals the first is found, which waits longest.
            true => places.min_by_key(|place| self.waiting.get(*place).map(end))?,
            false => places.min()?,
        };
        let role = self.waiting.remove(place);
        self.now = self.now.max(self.accounts.get(&role).map_or(self.now, |account| account.start));
        self.holders += 1;
        Some(role)
    }

    /// The role gives its turn back after this time.
    pub(crate) fn give_back(&mut self, role: Number, took: Duration) {
        self.holders = self.holders.saturating_sub(1);
        if let Some(account) = self.accounts.get_mut(&role) {
            (account.end, account.took) = (account.start + took, took);
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const MS: Duration = Duration::from_millis(1);

    /// A display: the time of its frame, and its pause after one.
    #[derive(Debug, Clone, Copy)]
    struct Display {
        frame: Duration,
        pause: Duration,
    }

    /// Lets displays share a device for this long. Returns the frames, the time and the longest wait of each.
    /// The last frames end at most one frame of each after that.
    fn share(by_time: bool, displays: &[Display], long: Duration) -> Vec<(u32, Duration, Duration)> {
        let mut shares = Shares::new(by_time, 1);
        let roles: Vec<_> = displays.iter().map(|_| shares.join()).collect();
        let mut had = vec![(0, Duration::ZERO, Duration::ZERO); displays.len()];
        // When each requests next; none while it waits.
        let mut asks: Vec<_> = displays.iter().map(|_| Some(Duration::ZERO)).collect();
        let mut asked = vec![Duration::ZERO; displays.len()];
        let mut now = Duration::ZERO;
        while now < long {
            for (place, ask) in asks.iter_mut().enumerate() {
                if let Some(at) = ask.take_if(|at| *at <= now) {
                    asked[place] = at;
                    shares.ask(roles[place]);
                }
            }
            let Some(role) = shares.next() else {
                now = asks.iter().flatten().min().copied().unwrap();
                continue;
            };
            assert_eq!(shares.next(), None, "one at a time");
            let place = roles.iter().position(|known| *known == role).unwrap();
            let Display { frame, pause } = displays[place];
            let (frames, time, longest) = &mut had[place];
            *longest = (*longest).max(now - asked[place]);
            now += frame;
            (*frames, *time) = (*frames + 1, *time + frame);
            shares.give_back(role, frame);
            asks[place] = Some(now + pause);
        }
        had
    }

    #[test]
    fn an_honest_display_beside_fifteen_greedy_ones_keeps_a_twentieth_and_more() {
        let minute = Duration::from_secs(60);
        for (frame, pause) in [(10, 0), (10, 10), (10, 40), (30, 30), (100, 20), (150, 0)] {
            let honest = Display { frame: frame * MS, pause: pause * MS };
            let alone = share(true, &[honest], minute)[0].0;
            let greedy = Display { frame: 150 * MS, pause: Duration::ZERO };
            let all = [&[honest][..], &[greedy; 15]].concat();
            let (frames, _, longest) = share(true, &all, minute)[0];
            assert!(frames * 20 >= alone, "{honest:?}: {alone} frames alone, {frames} beside");
            // At first all are equal.
            assert!(longest <= 16 * greedy.frame, "{honest:?}: {longest:?}");
        }
        // A frame each in turn was the old rule; it is not a twentieth of the time.
        let honest = Display { frame: 10 * MS, pause: 20 * MS };
        let greedy = Display { frame: 150 * MS, pause: Duration::ZERO };
        let all = [&[honest][..], &[greedy; 15]].concat();
        let frames = |by_time| share(by_time, &all, minute)[0].0;
        assert!(frames(false) * 20 < share(true, &[honest], minute)[0].0);
        assert!(frames(true) > 10 * frames(false), "{} and {}", frames(true), frames(false));
    }

    /// Like displays that connect, request a frame and go.
    #[test]
    fn roles_that_always_come_anew_have_no_more_than_those_that_stay() {
        for (rivals, piece) in [(1, 1), (1, 30), (8, 3), (8, 30)] {
            let mut shares = Shares::new(true, 1);
            let honest = shares.join();
            let mut had = Duration::ZERO;
            let mut total = Duration::ZERO;
            let mut others: Vec<_> = (0..rivals).map(|_| shares.join()).collect();
            others.iter().for_each(|role| shares.ask(*role));
            shares.ask(honest);
            while total < Duration::from_secs(60) {
                let role = shares.next().unwrap();
                let took = if role == honest { 20 } else { piece } * MS;
                total += took;
                shares.give_back(role, took);
                if role == honest {
                    had += took;
                    shares.ask(honest);
                } else {
                    shares.leave(role);
                    let place = others.iter().position(|other| *other == role).unwrap();
                    others[place] = shares.join();
                    shares.ask(others[place]);
                }
            }
            assert!(had * (rivals + 1) * 2 >= total, "{rivals} of {piece} ms leave {had:?} of {total:?}");
        }
    }

    #[test]
    fn a_role_that_leaves_while_it_waits_is_not_given_the_turn() {
        let mut shares = Shares::new(true, 1);
        let [first, second, third] = [(); 3].map(|()| shares.join());
        for role in [first, second, third] {
            shares.ask(role);
        }
        assert_eq!(shares.next(), Some(first));
        shares.leave(second);
        shares.leave(first);
        shares.give_back(first, MS);
        assert_eq!((shares.next(), shares.next()), (Some(third), None));
        shares.give_back(third, MS);
        shares.ask(second);
        assert_eq!(shares.next(), None);
    }

    #[test]
    fn as_many_as_may_have_the_device_at_once_and_no_more() {
        let mut shares = Shares::new(true, 2);
        let [first, second, third] = [(); 3].map(|()| shares.join());
        for role in [first, second, third] {
            shares.ask(role);
        }
        assert_eq!([(); 3].map(|()| shares.next()), [Some(first), Some(second), None]);
        shares.give_back(second, MS);
        assert_eq!([(); 2].map(|()| shares.next()), [Some(third), None]);
        // Those that have it may leave.
        shares.leave(first);
        shares.give_back(first, MS);
        shares.ask(second);
        assert_eq!([(); 2].map(|()| shares.next()), [Some(second), None]);
    }

    proptest! {
        /// Of busy roles none gets ahead of another by more than a frame of each: the bound of start-time
        /// fair queueing.
        #[test]
        fn who_always_asks_has_the_same_time(frames in prop::collection::vec(1_u32..200, 2..20)) {
            let displays: Vec<_> =
                frames.iter().map(|frame| Display { frame: *frame * MS, pause: Duration::ZERO }).collect();
            let had = share(true, &displays, Duration::from_secs(100));
            for (one, (_, time, _)) in displays.iter().zip(&had) {
                for (other, (_, others, _)) in displays.iter().zip(&had) {
                    prop_assert!(*time <= *others + one.frame + other.frame, "{:?}: {:?}", frames, had);
                }
            }
        }
    }
}
