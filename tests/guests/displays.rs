//! The effects of one display on the others and on the service: attacks on a real service, with an honest
//! display walking beside.

use std::{
    collections::BTreeSet,
    fs::OpenOptions,
    io::{Read, Write},
    net::TcpStream,
    os::unix::fs::FileExt,
    sync::atomic::{AtomicBool, Ordering},
    thread,
    time::{Duration, Instant},
};

use serde_json::json;
use trimaran_proto::{LodRule, OcclusionTestKind, SessionKey, ViewState, Viewport};

use crate::common::guests::{Guests, TOKEN};
use crate::common::page::Browser;
use crate::common::ports::unused_port;
use crate::common::program::Bench;

/// The whole answer of a server.
fn ask(at: &str, target: &str) -> String {
    let mut stream = TcpStream::connect(at).unwrap();
    write!(stream, "GET {target} HTTP/1.1\r\nHost: {at}\r\nConnection: close\r\n\r\n").unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    answer
}

#[test]
fn displays_that_come_walk_and_go_disturb_nobody() {
    let Some(mut guests) = Guests::start(&[]) else { return };
    guests.beside(|guests| {
        for _ in 0..3 {
            let mut display = guests.display(64, 64).unwrap();
            display.look(1);
            guests.block_on(display.sees(1));
        }
    });
    guests.stops();
}

/// In the hello, and in a later view state.
#[test]
fn a_picture_above_the_limit_is_refused_and_nobody_else_notices() {
    let Some(mut guests) = Guests::start(&["--max-picture", "300x260"]) else { return };
    let sizes = [(65_536, 65_536), (16_385, 1), (1, 65_536), (301, 260), (300, 261)];
    guests.beside(|guests| {
        for (width, height) in sizes {
            let mut display = guests.display(width, height).unwrap();
            display.look(1);
            let told = guests.block_on(display.hears_the_end());
            assert!(told.contains("it failed") && told.contains("up to 300x260"), "{width}x{height}: {told}");

            let mut display = guests.display(300, 260).unwrap();
            display.look(1);
            let told = guests.block_on(async {
                display.sees(1).await;
                display.change(|state| state.viewport = Viewport::new(width, height).unwrap()).await;
                display.look(2);
                display.hears_the_end().await
            });
            assert!(told.contains("up to 300x260"), "{width}x{height}: {told}");
        }
    });
    guests.stops();
}

/// A service may be configured for pictures that its device cannot draw.
#[test]
fn a_picture_that_the_device_cannot_draw_is_refused_as_well() {
    let Some(mut guests) = Guests::start(&["--max-picture", "65536x65536", "--depth-memory", "1TiB"]) else {
        return;
    };
    guests.beside(|guests| {
        let mut display = guests.display(65_536, 1).unwrap();
        display.look(1);
        let told = guests.block_on(display.hears_the_end());
        assert!(told.contains("a picture of 65536x1 pixels; this service takes up to"), "{told}");
    });
    guests.stops();
}

#[test]
fn memory_for_depth_is_bounded_over_all_and_free_once_a_display_leaves() {
    // Enough for the honest one, and one more.
    let Some(mut guests) = Guests::start(&["--depth-memory", "16MiB"]) else { return };
    guests.beside(|guests| {
        let mut first = guests.display(1024, 1024).unwrap();
        first.look(1);
        guests.block_on(first.sees(1));
        let mut second = guests.display(1024, 1024).unwrap();
        let told = guests.block_on(second.hears_the_end());
        assert!(told.contains("a picture of 1024x1024 pixels takes 14680064 bytes"), "{told}");
        drop(first);
        // The service soon notices that it has gone.
        let came = (0..600).any(|_| {
            thread::sleep(Duration::from_millis(50));
            let mut third = guests.display(1024, 1024).unwrap();
            third.look(1);
            guests.block_on(third.sees_or_ends())
        });
        assert!(came, "what the first had is not free: {}", guests.log());
    });
    guests.stops();
}

/// A frame that takes the device for long is done in pieces, and others have it in between.
#[test]
fn a_frame_that_takes_long_keeps_no_picture_from_anybody() {
    let Some(mut guests) = Guests::start(&[]) else { return };
    guests.beside(|guests| {
        let mut display = guests.display(4096, 4096).unwrap();
        guests.block_on(async {
            let all = |state: &mut ViewState| {
                // Each box is drawn over all its pixels, and the whole scene is requested.
                state.occlusion_test = OcclusionTestKind::Query;
                state.lod = LodRule::new(1e-300).unwrap();
            };
            display.change(all).await;
            for frame in 1..3 {
                display.look(frame);
                display.sees(1).await;
            }
        });
    });
    guests.stops();
}

/// Displays that connect, request a frame and go.
#[test]
fn displays_that_always_come_anew_keep_no_picture_from_anybody() {
    let Some(mut guests) = Guests::start(&[]) else { return };
    guests.beside(|guests| {
        let over = AtomicBool::new(false);
        thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    while !over.load(Ordering::Relaxed) {
                        if let Ok(mut display) = guests.display(64, 64) {
                            display.look(1);
                            // It goes before the frame is there.
                            thread::sleep(Duration::from_millis(10));
                        }
                    }
                });
            }
            thread::sleep(Duration::from_secs(2));
            over.store(true, Ordering::Relaxed);
        });
    });
    guests.stops();
}

/// A session's key allows taking over its display's place. Metrics are shown without a token.
#[test]
fn what_metrics_show_puts_no_display_out() {
    let metrics = format!("127.0.0.1:{}", unused_port());
    let Some(mut guests) = Guests::start(&["--metrics", &metrics]) else { return };
    guests.beside(|guests| {
        let mut display = guests.display(64, 64).unwrap();
        display.look(1);
        guests.block_on(display.sees(1));
        let shown = ["/metrics", "/links"].map(|target| ask(&metrics, target)).concat();
        assert!(shown.matches("HTTP/1.1 200").count() == 2 && shown.contains("display"), "{shown}");
        // Each number in it is tried as a key.
        let of_hex = shown.split(|letter: char| !letter.is_ascii_hexdigit());
        let numbers = of_hex.filter_map(|word| u64::from_str_radix(word, 16).ok());
        let decimals = shown.split(|letter: char| !letter.is_ascii_digit());
        let keys: BTreeSet<u64> = numbers.chain(decimals.filter_map(|word| word.parse().ok())).collect();
        assert!(!keys.contains(&display.key.0), "{shown}");
        for key in keys.into_iter().rev().take(20) {
            drop(guests.display_of(SessionKey(key), 64, 64));
        }
        display.look(2);
        guests.block_on(display.sees(1));
    });
    guests.stops();
}

/// A known key takes the place of only its own display.
#[test]
fn a_display_that_comes_again_takes_its_own_place() {
    let Some(mut guests) = Guests::start(&[]) else { return };
    guests.beside(|guests| {
        let mut first = guests.display(64, 64).unwrap();
        first.look(1);
        guests.block_on(first.sees(1));
        let mut again = guests.display_of(first.key, 64, 64).unwrap();
        guests.block_on(first.hears_the_end());
        again.look(1);
        guests.block_on(again.sees(1));
    });
    guests.stops();
}

#[test]
fn askers_that_go_before_they_are_answered_keep_no_picture_from_anybody() {
    let bench = Bench::empty();
    bench.done(&["generate", "plant", "--objects", "2000", "--triangles", "2000000", "-o", "plant.scene"]);
    let Some(mut guests) = Guests::of(bench, &[]) else { return };
    let mut place = 0;
    guests.beside(|guests| {
        for _ in 0..200 {
            // Another tile each time, not cached yet.
            place += 1;
            let target = format!("/tile?token={TOKEN}&x={}&z={}", place % 15 - 7, place / 15 % 15 - 7);
            let mut stream = TcpStream::connect(&guests.at).unwrap();
            write!(stream, "GET {target} HTTP/1.1\r\nHost: {}\r\n\r\n", guests.at).unwrap();
            thread::sleep(Duration::from_millis(3));
        }
    });
    guests.stops();
}

/// The device is shared by time: a frame of a greedy display takes as long as many of the honest one.
#[test]
fn an_honest_display_beside_fifteen_greedy_ones_keeps_a_twentieth_of_its_frames() {
    let Some(mut guests) = Guests::start(&["--depth-memory", "8GiB"]) else { return };
    let walk = guests.walk();
    walk.sees(10, &guests);
    let rate = |for_at_least: Duration| {
        let (before, begun) = (walk.frames(), Instant::now());
        thread::sleep(for_at_least);
        (walk.frames() - before) as f64 / begun.elapsed().as_secs_f64()
    };
    let alone = rate(Duration::from_secs(3));
    let over = AtomicBool::new(false);
    let greedy: Vec<_> = (0..15).map(|_| guests.display(4096, 4096).unwrap()).collect();
    let (beside, frames) = thread::scope(|scope| {
        let (guests, over) = (&guests, &over);
        let greedy = greedy.into_iter().map(|mut display| {
            scope.spawn(move || guests.block_on(async { display.asks_until(over).await }))
        });
        let greedy: Vec<_> = greedy.collect();
        // At first each opens its session.
        thread::sleep(Duration::from_secs(5));
        let beside = rate(Duration::from_secs(10));
        over.store(true, Ordering::Relaxed);
        (beside, greedy.into_iter().map(|display| display.join().unwrap()).sum::<u32>())
    });
    println!("{alone:.1} frames a second alone, {beside:.1} beside {frames} greedy ones");
    assert!(frames > 0 && beside * 20.0 >= alone, "{alone} frames a second alone, {beside} beside");
    assert!(guests.is_alive());
    walk.ends();
    guests.stops();
}

#[test]
fn a_service_that_is_full_says_so_and_takes_others_once_somebody_leaves() {
    let Some(guests) = Guests::start(&["--people", "2"]) else { return };
    let walk = guests.walk();
    walk.sees(3, &guests);
    let second = guests.display(64, 64).unwrap();
    let error = guests.display(64, 64).err().unwrap();
    let told = trimaran_transport::causes(&error);
    assert!(told.contains("busy") || told.contains("too many"), "{told}");
    drop(second);
    let mut third = guests.display(64, 64).unwrap();
    third.look(1);
    guests.block_on(third.sees(1));
    walk.ends();
    guests.stops();
}

#[test]
fn a_page_says_that_the_service_is_full_and_shows_the_scene_once_there_is_room() {
    let Some(guests) = Guests::start(&["--people", "1"]) else { return };
    let Some(mut browser) = Browser::start(300, 200) else { return };
    let walk = guests.walk();
    walk.sees(3, &guests);
    // A refused link is no fault of the page.
    browser.tell(json!({ "do": "open", "url": guests.url() }));
    let mut says = |words: &str, expected: bool| {
        for _ in 0..600 {
            let said = browser.tell(json!({ "do": "status" }))["answer"].to_string();
            if said.contains(words) == expected {
                return;
            }
            thread::sleep(Duration::from_millis(100));
        }
        panic!("{words:?} is not said, or is for ever");
    };
    says("The service is full", true);
    says("--people", true);
    walk.ends();
    says("The service is full", false);
    browser.tell(json!({ "do": "settle" }));
    guests.stops();
}

#[test]
fn sixty_four_people_are_taken_by_default() {
    let Some(guests) = Guests::start(&[]) else { return };
    let people: Vec<_> = (0..64).map(|_| guests.display(32, 32).unwrap()).collect();
    assert!(guests.display(32, 32).is_err());
    drop(people);
    guests.stops();
}

/// An unreadable part of a scene ends the sessions that request it. The file is overwritten meanwhile.
#[test]
fn a_page_of_the_scene_that_cannot_be_read_ends_the_sessions_that_need_it() {
    let Some(mut guests) = Guests::start(&[]) else { return };
    // From there the whole plant is one drawable, which is on the device once it has been shown.
    let walk = guests.walk_at([0.0, 1e6, 0.0]);
    walk.sees(30, &guests);
    let file = OpenOptions::new().write(true).open(guests.bench.path("plant.scene")).unwrap();
    let length = file.metadata().unwrap().len();
    file.write_all_at(&vec![0xa5; length as usize - 4096], 4096).unwrap();
    for _ in 0..3 {
        let mut display = guests.display(256, 256).unwrap();
        display.look(1);
        let told = guests.block_on(display.hears_the_end());
        assert!(told.contains("it failed") && told.contains("plant.scene"), "{told}");
        walk.sees(10, &guests);
    }
    assert!(guests.is_alive());
    walk.ends();
    guests.stops();
}

/// Displays that request much and read nothing.
#[test]
fn a_service_ends_in_time_though_displays_are_stuck() {
    let Some(guests) = Guests::start(&[]) else { return };
    let mut stuck: Vec<_> = (0..6).map(|_| guests.display(512, 512).unwrap()).collect();
    for frame in 0..40 {
        stuck.iter_mut().for_each(|display| display.look(frame));
        thread::sleep(Duration::from_millis(20));
    }
    guests.stops();
    drop(stuck);
}

#[test]
fn a_culler_refuses_what_is_above_its_limit_and_ends_in_time() {
    let bench = Bench::with_plant(60);
    let at = format!("tcp://127.0.0.1:{}", unused_port());
    let limits = ["--max-picture", "100x100", "--scene", "plant.scene"];
    let mut culler = bench.start(&[&["role", "culler", "--listen", &at][..], &limits].concat());
    culler.says("the culler listens on");
    let display = ["role", "display", "--scene", "plant.scene", "--cullers", &at, "--frames", "3"];
    let display = [&display[..], &["--audit-every", "0", "--width", "101", "--out", "wide"]].concat();
    let display = bench.start(&display);
    culler.says_all(&["is gone", "up to 100x100"]);
    culler.signal("TERM");
    culler.ends(0);
    display.kill();
}
