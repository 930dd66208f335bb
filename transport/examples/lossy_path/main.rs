//! The latency of frames where packets are lost: TCP, QUIC and the project's own datagrams, on real kernel
//! sockets.
//!
//! ```sh
//! cargo run --release -p trimaran-transport --example lossy_path -- [SECONDS] [LOSS..] [LINK..] [FILE.svg]
//! ```
//!
//! Two network namespaces, each with a TUN device. This program carries packets to the other one 5 ms later,
//! or drops them. A sender in one sends 60 frames of 4,000 points a second to a receiver in the other. Prints
//! a table in Markdown: all rows, or those of the losses and links that are named; draws it, where a file is
//! named. A row takes 60 s, or `SECONDS`; of fewer than 1,000 frames the p99.9 is the slowest. Needs Linux,
//! root and `ip` (iproute2), and says if one is missing.

#[cfg(target_os = "linux")]
mod chart;
#[cfg(target_os = "linux")]
mod path;
#[cfg(target_os = "linux")]
mod relay;
#[cfg(target_os = "linux")]
mod rows;
#[cfg(target_os = "linux")]
mod session;

#[cfg(target_os = "linux")]
fn main() -> Result<(), Box<dyn std::error::Error>> {
    let rows = rows::Rows::parse(std::env::args().skip(1))?;
    if let Err(missing) = path::possible() {
        println!("skipped: {missing}");
        return Ok(());
    }
    println!("60 frames of 4,000 points a second for {} s a row, 5 ms one way.", rows.seconds);
    println!("First: the first frame of a link. More: bytes, against the same link without loss.");
    println!();
    println!(
        "| loss | link | p50 ms | p99 | p99.9 | slowest | first | complete | kB | more | packets lost |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|");
    let (mut plain, mut drawn) = (vec![None; rows.kinds.len()], Vec::new());
    for loss in rows.losses {
        for (kind, plain) in rows.kinds.iter().zip(&mut plain) {
            let outcome = session::run(kind, loss, rows.seconds)?;
            let more = plain.map_or(String::new(), |plain| {
                format!("{:+.1} %", (outcome.kilobytes() / plain - 1.0) * 100.0)
            });
            *plain = plain.or(loss.is_none().then_some(outcome.kilobytes()));
            println!(
                "| {} | {} | {outcome} | {more} | {:.2} % |",
                loss.name,
                kind.name,
                outcome.lost_percent()
            );
            let latencies = [0.5, 0.99, 0.999].map(|share| outcome.milliseconds(share));
            drawn.push(chart::Row { loss: loss.name, link: kind.name, latencies });
        }
    }
    if let Some(file) = rows.chart {
        std::fs::write(&file, chart::svg(&drawn)?).map_err(|e| format!("{}: {e}", file.display()))?;
    }
    Ok(())
}

#[cfg(not(target_os = "linux"))]
fn main() {
    println!("skipped: this needs Linux's network namespaces");
}
