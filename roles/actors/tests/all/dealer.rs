//! A display's dealer with cullers that come, go, stall and answer in random interleavings. Every frame is
//! shown once and in order, and nobody waits for ever.

use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

use proptest::prelude::*;
use trimaran_actors::{CullerId, Dealer, Disorder, Pace};
use trimaran_proto::FrameNumber;
use trimaran_transport::Instant;

const LOCKSTEP: Pace = Pace::Lockstep { frames: None };

fn at(ms: u64) -> Instant {
    Instant::from_nanos(0).after(Duration::from_millis(ms))
}

fn cullers(count: usize) -> Vec<CullerId> {
    CullerId::first(count).collect()
}

fn frames(numbers: &[u32]) -> Vec<FrameNumber> {
    numbers.iter().copied().map(FrameNumber).collect()
}

/// The frames dealt now, by culler.
fn dealt(dealer: &mut Dealer, now: Instant) -> Vec<(usize, u32)> {
    dealer.deal(now).into_iter().map(|(id, frame)| (id.index(), frame.0)).collect()
}

/// A dealer with this many cullers, which have been dealt their first frames.
fn started(count: usize) -> (Dealer, Vec<CullerId>) {
    let (mut dealer, ids) = (Dealer::new(LOCKSTEP, false, FrameNumber(0)), cullers(count));
    ids.iter().for_each(|id| dealer.join(*id, at(0)));
    let first: Vec<_> = (0..count).map(|place| (place, place as u32)).collect();
    assert_eq!(dealt(&mut dealer, at(0)), first);
    (dealer, ids)
}

fn cull(dealer: &mut Dealer, id: CullerId, frame: u32, now: Instant) {
    dealer.began(id, FrameNumber(frame)).unwrap();
    assert_eq!(dealer.ended(id, now).unwrap(), Some(FrameNumber(frame)));
}

#[test]
fn in_lockstep_cullers_cull_round_robin_whoever_is_faster() {
    let (mut dealer, ids) = started(2);
    dealer.began(ids[1], FrameNumber(1)).unwrap();
    assert_eq!(dealt(&mut dealer, at(1)), [(1, 3)], "the next one in its cell while it culls");
    dealer.ended(ids[1], at(2)).unwrap();
    dealer.began(ids[1], FrameNumber(3)).unwrap();
    assert_eq!(dealt(&mut dealer, at(3)), [], "no more than twice the number of cullers ahead");
    assert_eq!(dealer.due(), None, "frame 1 waits for frame 0");
    cull(&mut dealer, ids[0], 0, at(4));
    assert_eq!(dealer.due(), Some(FrameNumber(0)));
    dealer.shown(FrameNumber(0));
    assert_eq!(dealer.due(), Some(FrameNumber(1)));
    dealer.shown(FrameNumber(1));
    assert_eq!(dealt(&mut dealer, at(5)), [(0, 2), (1, 5)]);
}

#[test]
fn what_a_lost_culler_had_is_dealt_again_and_the_frame_that_is_due_culled_by_who_is_free() {
    let (mut dealer, ids) = started(2);
    dealer.began(ids[0], FrameNumber(0)).unwrap();
    dealer.began(ids[1], FrameNumber(1)).unwrap();
    assert_eq!(dealt(&mut dealer, at(1)), [(0, 2), (1, 3)]);
    dealer.leave(ids[0]);
    assert_eq!(dealt(&mut dealer, at(2)), [], "the other one has a frame and a camera");
    assert_eq!(dealer.to_cull_itself(), Some(FrameNumber(0)), "it is due, and nobody is free");
    dealer.culled_itself(FrameNumber(0));
    assert_eq!(dealer.due(), Some(FrameNumber(0)));
    dealer.shown(FrameNumber(0));
    assert_eq!(dealer.to_cull_itself(), None, "frame 1 is under way");
    dealer.ended(ids[1], at(3)).unwrap();
    dealer.shown(FrameNumber(1));
    assert_eq!(dealer.to_cull_itself(), Some(FrameNumber(2)));
    dealer.began(ids[1], FrameNumber(3)).unwrap();
    dealer.ended(ids[1], at(4)).unwrap();
    assert_eq!(dealt(&mut dealer, at(4)), [(1, 2)], "free, so it takes it before the display does");
    assert_eq!(dealer.to_cull_itself(), None);
}

#[test]
fn a_late_culler_is_passed_over_until_it_answers_and_the_first_whole_answer_counts() {
    let (mut dealer, ids) = started(2);
    for round in 0..4 {
        for (place, id) in ids.iter().enumerate() {
            let frame = 2 * round + place as u32;
            cull(&mut dealer, *id, frame, at(u64::from(10 * (round + 1))));
            dealer.shown(FrameNumber(frame));
        }
        dealer.deal(at(u64::from(10 * (round + 1))));
    }
    let (late, when) = dealer.late().unwrap();
    assert_eq!((late, when), (ids[0], at(1040)), "three times 10 ms, but in lockstep a second at least");
    dealer.pass_over(ids[0]);
    assert_eq!(dealer.available().collect::<Vec<_>>(), [ids[1]]);
    assert_eq!(dealer.to_cull_itself(), Some(FrameNumber(8)));
    dealer.culled_itself(FrameNumber(8));
    dealer.shown(FrameNumber(8));
    dealer.began(ids[0], FrameNumber(8)).unwrap();
    assert_eq!(dealer.ended(ids[0], at(2000)).unwrap(), None, "it has been shown");
    assert_eq!(dealer.available().collect::<Vec<_>>(), ids, "it is dealt frames again");
}

#[test]
fn without_cullers_the_display_culls_each_frame() {
    let mut dealer = Dealer::new(Pace::Lockstep { frames: Some(3) }, false, FrameNumber(1));
    for frame in frames(&[1, 2]) {
        assert_eq!((dealer.due(), dealer.to_cull_itself()), (None, Some(frame)));
        dealer.culled_itself(frame);
        assert_eq!(dealer.due(), Some(frame));
        dealer.shown(frame);
    }
    assert!(dealer.is_done());
    assert_eq!(dealer.to_cull_itself(), None);
}

#[test]
fn live_the_newest_camera_goes_to_who_is_free_and_what_is_older_than_the_picture_is_not_shown() {
    let (mut dealer, ids) = (Dealer::new(Pace::Live, false, FrameNumber(0)), cullers(2));
    ids.iter().for_each(|id| dealer.join(*id, at(0)));
    assert_eq!(dealer.wants_camera(true), Some(ids[0]));
    assert_eq!(dealer.hand_out(ids[0], at(0)), FrameNumber(0));
    assert_eq!(dealer.wants_camera(false), None, "the same pose is of no use to the other one");
    assert_eq!(dealer.wants_camera(true), Some(ids[1]));
    assert_eq!(dealer.hand_out(ids[1], at(5)), FrameNumber(1));
    assert_eq!(dealer.wants_camera(true), None, "both have one, and nobody has begun");
    dealer.began(ids[0], FrameNumber(0)).unwrap();
    assert_eq!(dealer.wants_camera(true), Some(ids[0]), "it waits in the cell of who is free next");
    assert_eq!(dealer.hand_out(ids[0], at(6)), FrameNumber(2));
    assert_eq!(dealer.wants_camera(true), Some(ids[0]), "and a newer one takes its place");
    assert_eq!(dealer.hand_out(ids[0], at(7)), FrameNumber(3));
    cull(&mut dealer, ids[1], 1, at(8));
    assert_eq!(dealer.due(), Some(FrameNumber(1)));
    dealer.shown(FrameNumber(1));
    assert_eq!(dealer.ended(ids[0], at(9)).unwrap(), None, "a newer one has been shown");
    dealer.began(ids[0], FrameNumber(3)).unwrap();
    assert_eq!(dealer.began(ids[0], FrameNumber(2)), Err(Disorder::Unexpected("the begin of a frame")));
}

#[test]
fn who_begins_what_it_was_not_dealt_breaks_the_order() {
    let (mut dealer, ids) = started(1);
    assert_eq!(dealer.began(ids[0], FrameNumber(1)), Err(Disorder::NotDealt(FrameNumber(1))));
    assert_eq!(dealer.ended(ids[0], at(1)), Err(Disorder::Unexpected("the end of a frame")));
}

/// A step of a random session.
#[derive(Debug, Clone)]
enum Move {
    Begin(usize),
    End(usize),
    Show,
    Join(usize),
    Leave(usize),
    PassOver(usize),
}

/// A culler at the other end of a link: its cameras and its begun frame.
#[derive(Debug, Default)]
struct Far {
    /// Cameras published; the newest one is in the cell.
    cell: VecDeque<FrameNumber>,
    begun: Option<FrameNumber>,
}

fn moves() -> impl Strategy<Value = Vec<Move>> {
    let culler = || 0_usize..4;
    let one = prop_oneof![
        8 => culler().prop_map(Move::Begin),
        8 => culler().prop_map(Move::End),
        8 => Just(Move::Show),
        1 => culler().prop_map(Move::Join),
        1 => culler().prop_map(Move::Leave),
        1 => culler().prop_map(Move::PassOver),
    ];
    prop::collection::vec(one, 0..300)
}

proptest! {
    #[test]
    fn every_frame_is_shown_once_and_in_order(first in 0_u32..5, count in 1_u32..30, moves in moves()) {
        let end = first + count;
        let mut dealer = Dealer::new(Pace::Lockstep { frames: Some(end) }, false, FrameNumber(first));
        let (ids, mut far) = (cullers(4), BTreeMap::<CullerId, Far>::new());
        let mut shown = Vec::new();
        // After the random steps, each culler does all that it can.
        let orderly = (0..4).flat_map(|id| [Move::Begin(id), Move::End(id), Move::Show]);
        let all = moves.into_iter().chain(orderly.collect::<Vec<_>>().into_iter().cycle().take(8000));
        for (step, next) in all.enumerate() {
            let now = at(step as u64);
            match next {
                Move::Join(id) if !far.contains_key(&ids[id]) => {
                    far.insert(ids[id], Far::default());
                    dealer.join(ids[id], now);
                }
                Move::Leave(id) if far.remove(&ids[id]).is_some() => dealer.leave(ids[id]),
                Move::PassOver(id) => dealer.pass_over(ids[id]),
                Move::Begin(id) => {
                    // It takes the newest camera from the cell.
                    if let Some(far) = far.get_mut(&ids[id]).filter(|far| far.begun.is_none())
                        && let Some(newest) = far.cell.pop_back()
                    {
                        far.cell.clear();
                        far.begun = Some(newest);
                        dealer.began(ids[id], newest).unwrap();
                    }
                }
                Move::End(id) => {
                    if let Some(far) = far.get_mut(&ids[id]) && far.begun.take().is_some() {
                        dealer.ended(ids[id], now).unwrap();
                    }
                }
                Move::Show => {
                    if dealer.due().is_none() && let Some(frame) = dealer.to_cull_itself() {
                        dealer.culled_itself(frame);
                    }
                    if let Some(frame) = dealer.due() {
                        dealer.shown(frame);
                        shown.push(frame);
                    }
                }
                _ => {}
            }
            for (id, frame) in dealer.deal(now) {
                far.get_mut(&id).unwrap().cell.push_back(frame);
            }
        }
        prop_assert_eq!(shown, (first..end).map(FrameNumber).collect::<Vec<_>>());
        prop_assert!(dealer.is_done());
    }
}
