//! `trimaran stat`: the traffic of a running role's links, second by second.

use std::{
    fmt::Write as _,
    io::{self, IsTerminal, Write as _},
    sync::Arc,
    time::Duration,
};

use serde::de::DeserializeOwned;
use trimaran::{
    http::get_by_address,
    metrics::{Carried, LinkReading, PathReading, StatusReading, TurnedAwayReading},
};
use trimaran_transport::{Net, TokioNet, causes, sleep_until};

use super::{Failure, args::StatArgs, number, printed, terminal::word, walking};

pub(super) fn run(args: &StatArgs) -> Result<(), Failure> {
    let runtime = walking::runtime()?;
    let stop = walking::stop_on_signal(&runtime);
    let net: Arc<dyn Net> = Arc::new(TokioNet::new(runtime.handle().clone()));
    runtime.block_on(stop.unless_requested(watch(args, &net))).unwrap_or(Ok(()))
}

async fn watch(args: &StatArgs, net: &Arc<dyn Net>) -> Result<(), Failure> {
    let interval = Duration::from_secs_f64(args.interval);
    let mut before: Option<(Vec<LinkReading>, StatusReading, trimaran_transport::Instant)> = None;
    for taken in 0.. {
        let at = net.now();
        let mut readings: Vec<LinkReading> = match (read(&args.at, "/links").await, &before) {
            (Ok(readings), _) => readings,
            // It was there before, so the session is over.
            (Err(_), Some(_)) => break,
            (Err(failure), None) => return Err(failure),
        };
        for reading in &mut readings {
            reading.peer = word(&reading.peer).into_owned();
        }
        let status: StatusReading = match (read(&args.at, "/status").await, &before) {
            (Ok(status), _) => status,
            (Err(_), Some(_)) => break,
            (Err(failure), None) => return Err(failure),
        };
        if args.json {
            println!("{}", serde_json::to_string(&readings).map_err(Failure::broken)?);
        } else if let Some((before, earlier, then)) = &before {
            if io::stdout().is_terminal() {
                // To the top of an empty screen: the only control sequence that a terminal is sent.
                printed(io::stdout().write_all(b"\x1b[H\x1b[2J"))?;
            }
            let elapsed = at.since(*then);
            print!(
                "{}{}{}",
                table(before, &readings, elapsed),
                frames(earlier, &status, elapsed),
                warnings(&readings, &status.turned_away)
            );
        }
        before = Some((readings, status, at));
        // Rates take two readings.
        let shown = if args.json { taken + 1 } else { taken };
        if args.count == Some(shown) {
            break;
        }
        sleep_until(&**net, at.after(interval)).await;
    }
    Ok(())
}

/// Reads one page.
async fn read<T: DeserializeOwned>(at: &str, page: &str) -> Result<T, Failure> {
    let unreachable = |cause: &dyn std::fmt::Display| {
        Failure::broken(format!(
            "cannot read the metrics at {at}: {cause}: was the role started with --metrics {at}?"
        ))
    };
    let body = get_by_address(at, page).await.map_err(|e| unreachable(&causes(&e)))?;
    serde_json::from_slice(&body).map_err(|e| unreachable(&e))
}

/// The traffic between two readings, a line per link and direction.
fn table(before: &[LinkReading], now: &[LinkReading], elapsed: Duration) -> String {
    let mut text = String::new();
    let _infallible = writeln!(
        text,
        "{:<10} {:<9} {:>10} {:>12} {:>12} {:>14} {:>14}",
        "peer", "direction", "frames/s", "ids/s", "messages/s", "id bytes/s", "bytes/s"
    );
    for (now, before) in now.iter().zip(before) {
        let ways = [
            (now.peer.as_str(), "sent", &before.sent, &now.sent),
            ("", "received", &before.received, &now.received),
        ];
        for (peer, direction, before, now) in ways {
            let rate = |of: fn(&Carried) -> u64| a_second(of(before), of(now), elapsed);
            let frames = rate(|carried| carried.frames);
            let counts: [fn(&Carried) -> u64; 4] =
                [|of| of.ids, |of| of.messages, |of| of.id_bytes, Carried::total_bytes];
            let [ids, messages, id_bytes, bytes] = counts.map(|of| number(rate(of).round() as u64));
            let _infallible = writeln!(
                text,
                "{peer:<10} {direction:<9} {frames:>10.1} {ids:>12} {messages:>12} {id_bytes:>14} {bytes:>14}"
            );
        }
    }
    text.push_str(&paths(before, now, elapsed));
    text
}

/// A line about the role's own frames, if it has any.
fn frames(before: &StatusReading, now: &StatusReading, elapsed: Duration) -> String {
    type Count = fn(&StatusReading) -> u64;
    let stages: [(&str, Count); 3] = [
        ("culled", |status| status.frames_culled),
        ("shared", |status| status.frames_shared),
        ("shown", |status| status.frames_shown),
    ];
    let mut words: Vec<String> = stages
        .into_iter()
        .filter(|(_, of)| of(now) > 0)
        .map(|(stage, of)| format!("{stage} {:.1}/s", a_second(of(before), of(now), elapsed)))
        .collect();
    if let Some(mean) = now.latency.mean_ms_since(&before.latency) {
        words.push(format!("camera to picture {mean:.1} ms"));
    }
    if now.late > 0 {
        words.push(format!("cullers late {}", number(now.late)));
    }
    if words.is_empty() { String::new() } else { format!("\nframes: {}\n", words.join(", ")) }
}

/// A line for each link whose transport counts packets.
fn paths(before: &[LinkReading], now: &[LinkReading], elapsed: Duration) -> String {
    let mut text = String::new();
    for (now, before) in now.iter().zip(before) {
        let (Some(path), before) = (now.path, before.path.unwrap_or_default()) else { continue };
        if text.is_empty() {
            let _infallible = writeln!(
                text,
                "\n{:<10} {:>10} {:>10} {:>8} {:>8} {:>8} {:>9} {:>8} {:>7} {:>9} {:>9} {:>10}",
                "path to",
                "sent/s",
                "received/s",
                "lost",
                "repeated",
                "repair",
                "repaired",
                "given up",
                "probes",
                "datagram",
                "RTT ms",
                "window"
            );
        }
        let PathReading { packets_lost, parts_repeated, repair_sent, frames_repaired, .. } = path;
        let PathReading { frames_given_up, probes, path_mtu, round_trip_ms, .. } = path;
        let [sent, received] =
            [(before.packets_sent, path.packets_sent), (before.packets_received, path.packets_received)]
                .map(|(before, now)| number(a_second(before, now, elapsed).round() as u64));
        let _infallible = writeln!(
            text,
            "{:<10} {sent:>10} {received:>10} {packets_lost:>8} {parts_repeated:>8} {repair_sent:>8} {frames_repaired:>9} \
             {frames_given_up:>8} {probes:>7} {path_mtu:>9} {round_trip_ms:>9.2} {:>10}",
            now.peer,
            number(path.window_bytes)
        );
    }
    text
}

/// Warnings beside the figures, usually none.
fn warnings(links: &[LinkReading], turned_away: &TurnedAwayReading) -> String {
    let mut text = limits(links, turned_away);
    for link in links.iter().filter(|link| link.path.is_some_and(|path| path.deadline_too_short)) {
        let _infallible = writeln!(
            text,
            "\nthe way to {} takes as long as a frame may, or longer: hardly any comes whole; take a longer deadline, or a link without one",
            link.peer
        );
    }
    text
}

/// A line for the limits that were reached, if any.
fn limits(links: &[LinkReading], turned_away: &TurnedAwayReading) -> String {
    let floods = links.iter().map(|link| link.floods).sum();
    let reached = turned_away.by_limit().into_iter().chain([("messages_per_s", floods)]);
    let reached: Vec<String> = reached
        .filter(|(_, count)| *count > 0)
        .map(|(limit, count)| format!("{limit} {}", number(count)))
        .collect();
    if reached.is_empty() {
        String::new()
    } else {
        format!("\nturned away, by limit: {}\n", reached.join(", "))
    }
}

/// The increase per second.
fn a_second(before: u64, now: u64, elapsed: Duration) -> f64 {
    now.saturating_sub(before) as f64 / elapsed.as_secs_f64().max(f64::MIN_POSITIVE)
}

#[cfg(test)]
mod tests {
    use trimaran::metrics::LatencyReading;

    use super::*;

    #[test]
    fn a_line_tells_what_was_carried_a_second() {
        let carried = |frames, ids, id_bytes| Carried {
            frames,
            ids,
            id_bytes,
            messages: 3 * frames,
            ..Carried::default()
        };
        let link = |sent| LinkReading { peer: "display".to_owned(), sent, ..LinkReading::default() };
        let (before, now) = (link(carried(10, 4_000, 900)), link(carried(25, 10_000, 1_500)));
        let text = table(&[before], &[now], Duration::from_millis(500));
        let lines: Vec<Vec<&str>> = text.lines().map(|line| line.split_whitespace().collect()).collect();
        assert_eq!(lines[1], ["display", "sent", "30.0", "12,000", "90", "1,200", "1,200"]);
        assert_eq!(lines[2], ["received", "0.0", "0", "0", "0", "0"]);
    }

    #[test]
    fn frames_have_a_line_with_their_latency_and_a_role_without_frames_has_none() {
        let latency = |frames, seconds| LatencyReading { frames, seconds };
        let before =
            StatusReading { frames_shown: 10, latency: latency(10, 0.2), ..StatusReading::default() };
        let now = StatusReading {
            frames_shown: 40,
            latency: latency(40, 0.95),
            late: 2,
            ..StatusReading::default()
        };
        let line = frames(&before, &now, Duration::from_millis(500));
        assert_eq!(line, "\nframes: shown 60.0/s, camera to picture 25.0 ms, cullers late 2\n");
        let none = StatusReading::default();
        assert_eq!(frames(&none, &none, Duration::from_secs(1)), "");
    }

    #[test]
    fn a_path_has_a_line_of_its_own() {
        let link = |packets_sent| LinkReading {
            peer: "display".to_owned(),
            path: Some(PathReading {
                packets_sent,
                packets_lost: 3,
                path_mtu: 1452,
                round_trip_ms: 10.126,
                window_bytes: 14_520,
                ..PathReading::default()
            }),
            ..LinkReading::default()
        };
        let text = table(&[link(100)], &[link(600)], Duration::from_millis(500));
        let words: Vec<&str> = text.lines().last().unwrap().split_whitespace().collect();
        let expected = ["display", "1,000", "0", "3", "0", "0", "0", "0", "0", "1452", "10.13", "14,520"];
        assert_eq!(words, expected, "{text}");
    }

    #[test]
    fn a_limit_that_was_reached_is_named_and_no_other() {
        let link = |floods| LinkReading { floods, ..LinkReading::default() };
        assert_eq!(limits(&[link(0)], &TurnedAwayReading::default()), "");
        let turned_away =
            TurnedAwayReading { handshakes_per_s: 1_200, peers: 2, ..TurnedAwayReading::default() };
        let expected = "\nturned away, by limit: handshakes_per_s 1,200, peers 2, messages_per_s 3\n";
        assert_eq!(limits(&[link(1), link(2)], &turned_away), expected);
    }

    #[test]
    fn a_deadline_that_nothing_can_meet_is_told_and_no_other() {
        let link = |deadline_too_short| LinkReading {
            peer: "display".to_owned(),
            path: Some(PathReading { deadline_too_short, ..PathReading::default() }),
            ..LinkReading::default()
        };
        let nobody = TurnedAwayReading::default();
        assert_eq!(warnings(&[link(false)], &nobody), "");
        let said = warnings(&[link(false), link(true)], &nobody);
        assert_eq!(said.matches("the way to display takes as long").count(), 1, "{said}");
    }

    #[test]
    fn a_role_that_was_started_anew_has_no_rates_below_zero() {
        assert_eq!(a_second(10, 0, Duration::from_secs(1)), 0.0);
    }
}
