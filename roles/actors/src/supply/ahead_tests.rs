use std::collections::BTreeSet;

use trimaran_cull::lod_cut;
use trimaran_proto::{FrameNumber, LodRule};

use super::super::testing::{PLANT, view_at};
use super::*;

/// Time between frames.
const STEP: Duration = Duration::from_millis(50);

fn rule() -> CutRule {
    LodRule::new(0.3).unwrap().into()
}

fn at(frame: u32) -> Instant {
    Instant::from_nanos(0).after(STEP * frame)
}

/// A view from this distance to the middle, turned to the left by this many radians.
fn view(frame: u32, distance: f64, turn: f64) -> View {
    view_at(distance, turn, frame, 512)
}

fn cut(view: &View) -> Vec<DrawableId> {
    lod_cut(&PLANT, view, rule())
}

/// Passes through the views, and returns all drawables to send ahead then.
fn after(ahead: &mut Ahead, views: &[View]) -> Vec<DrawableId> {
    for (frame, view) in (0..).zip(views) {
        ahead.found(&PLANT, view, &cut(view), at(frame));
    }
    let now = at(views.len() as u32 - 1);
    std::iter::from_fn(|| ahead.pop(&PLANT, &rule(), now)).collect()
}

#[test]
fn where_the_eye_goes_on_to_the_levels_due_there_are_sent() {
    let views: Vec<_> = (0..4).map(|frame| view(frame, 40.0 - f64::from(frame), 0.0)).collect();
    let sent = after(&mut Ahead::new(1 << 20), &views);
    // Half a second is ten steps.
    let there: BTreeSet<_> = cut(&view(0, 27.0, 0.0)).into_iter().collect();
    let here: BTreeSet<_> = cut(&views[3]).into_iter().collect();
    let news: BTreeSet<_> = there.difference(&here).collect();
    let hits = sent.iter().filter(|id| news.contains(id)).count();
    assert!(news.len() > 20, "{} are new there", news.len());
    assert!(hits * 10 > news.len() * 9, "{hits} of {}", news.len());
    assert!(sent.iter().all(|id| there.contains(id)), "nothing else");
}

#[test]
fn where_the_eye_turns_what_looks_large_there_is_sent() {
    let views: Vec<_> = (0..4).map(|frame| view(frame, 0.0, 0.02 * f64::from(frame))).collect();
    let sent = after(&mut Ahead::new(1 << 20), &views);
    let there: BTreeSet<_> = cut(&view(0, 0.0, 0.06 + 0.2)).into_iter().collect();
    let here: BTreeSet<_> = cut(&views[3]).into_iter().collect();
    assert!(sent.iter().any(|id| there.contains(id) && !here.contains(id)));
    let beyond = view(0, 0.0, 0.06 + 0.5);
    assert!(cut(&beyond).iter().any(|id| !there.contains(id) && !sent.contains(id)), "no further");
}

#[test]
fn frames_of_the_same_pose_change_nothing_until_the_eye_rests() {
    let walk = |still: u32| {
        let mut ahead = Ahead::new(1 << 20);
        let mut frame = 0;
        for pose in 0..4 {
            let view = view(pose, 40.0 - f64::from(pose), 0.0);
            for _ in 0..if pose == 3 { still } else { 2 } {
                let again = View::new(view.camera().for_frame(FrameNumber(frame)), view.viewport());
                ahead.found(&PLANT, &again, &cut(&again), at(frame));
                frame += 1;
            }
        }
        std::iter::from_fn(|| ahead.pop(&PLANT, &rule(), at(frame))).count()
    };
    assert!(walk(1) > 20);
    assert_eq!(walk(2), walk(1));
    assert_eq!(walk(12), 0, "it has stood still for more than half a second");
}

#[test]
fn nothing_is_sent_ahead_of_an_eye_that_stays_or_jumps_or_without_a_budget() {
    let walk = |distances: [f64; 4], budget| {
        let views: Vec<_> =
            (0..).zip(distances).map(|(frame, distance)| view(frame, distance, 0.0)).collect();
        after(&mut Ahead::new(budget), &views).len()
    };
    assert_eq!(walk([40.0; 4], 1 << 20), 0);
    assert_eq!(walk([40.0, 39.9, 39.8, 20.0], 1 << 20), 0);
    assert_eq!(walk([40.0, 39.0, 38.0, 37.0], 0), 0);
    assert!(walk([20.0, 40.0, 39.0, 38.0], 1 << 20) > 0, "the jump was before");
}

#[test]
fn what_was_sent_counts_until_it_is_used_or_dropped_or_ten_seconds_old() {
    let mut ahead = Ahead::new(1000);
    let views: Vec<_> = (0..4).map(|frame| view(frame, 40.0 - f64::from(frame), 0.0)).collect();
    assert!(after(&mut ahead, &views).len() > 3);
    let pop = |ahead: &mut Ahead, seconds| {
        ahead.due = vec![DrawableId(1)];
        ahead.pop(&PLANT, &rule(), at(0).after(Duration::from_secs(seconds)))
    };
    let used = PLANT.drawables()[cut(&views[3])[0].index()].geometry;
    for number in [used, u32::MAX - 1, u32::MAX] {
        ahead.sent(number, 400, at(0));
    }
    assert_eq!(pop(&mut ahead, 1), None, "1,200 bytes are out");
    ahead.count_off(u32::MAX);
    assert!(pop(&mut ahead, 1).is_some(), "the display has thrown it away");
    ahead.sent(u32::MAX - 2, 400, at(0));
    assert_eq!(pop(&mut ahead, 1), None);
    ahead.found(&PLANT, &views[3], &cut(&views[3])[..1], at(4));
    assert!(pop(&mut ahead, 1).is_some(), "a frame uses it");
    ahead.sent(u32::MAX - 3, 400, at(0));
    assert_eq!(pop(&mut ahead, 10), None);
    assert!(pop(&mut ahead, 11).is_some());
    assert_eq!(ahead.unused_bytes, 0);
}
