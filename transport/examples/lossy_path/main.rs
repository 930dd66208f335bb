//! What a frame costs in time where packets are lost: TCP, QUIC and the project's own datagrams, on real kernel sockets.
//!
//! ```sh
//! cargo run --release -p trimaran-transport --example lossy_path -- [SECONDS] [NAME..]
//! ```
//!
//! Two network namespaces, each with a TUN device whose packets this program carries to the other one: 5 ms later, or, where the
//! path loses them, never. A sender in one sends 60 frames of 4,000 ids a second to a receiver in the other. Needs Linux, root and
//! `ip` (iproute2); says what is missing otherwise.

#[cfg(target_os = "linux")]
mod path;
#[cfg(target_os = "linux")]
mod relay;
#[cfg(target_os = "linux")]
mod session;

#[cfg(target_os = "linux")]
fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut args = std::env::args().skip(1).peekable();
    let seconds = args.next_if(|arg| arg.parse::<u32>().is_ok()).map_or(Ok(20), |arg| arg.parse())?;
    let names: Vec<String> = args.collect();
    if let Err(missing) = path::possible() {
        println!("skipped: {missing}");
        return Ok(());
    }
    println!("60 frames of 4,000 ids a second for {seconds} s, 5 ms one way");
    println!(
        "{:<18} {:<22} {:>7} {:>7} {:>8} {:>8} {:>11} {:>8} {:>7}",
        "loss", "link", "p50 ms", "p99 ms", "p99.9 ms", "max ms", "complete %", "kB/frame", "lost %"
    );
    for loss in relay::LOSSES {
        for kind in session::KINDS {
            if !names.is_empty() && !names.iter().any(|name| kind.name.contains(name.as_str())) {
                continue;
            }
            let outcome = session::run(kind, *loss, seconds)?;
            println!("{:<18} {:<22} {outcome}", loss.name, kind.name);
        }
    }
    Ok(())
}

#[cfg(not(target_os = "linux"))]
fn main() {
    println!("skipped: this needs Linux's network namespaces");
}
