//! The simulator against kernels: the same sessions over real TCP, UDP and QUIC, and in virtual time.
//!
//! ```sh
//! cargo run --release --example against_kernels -- [NETWORK..] [tcp|quic|udp..] [--frames N] [--runs N] [--csv] \
//!     [--trace WALK] [--cullers K] [--schedule independent|switch]
//! ```
//!
//! A display and its cullers in network namespaces of their own, whose packets `trimaran::netem` carries by
//! the link models of the simulator, and the same roles in the simulator. Of both, each run with a seed of
//! its own: latency from a camera leaving RVG to its picture, bytes a frame, and frames a second. The roles
//! pause for 5 ms each a frame, or for as long as they computed in a walk that `trimaran run --alone --record
//! WALK` has recorded. Needs Linux, root and `ip` (iproute2); says what is missing otherwise.

#[cfg(target_os = "linux")]
mod clock;
#[cfg(target_os = "linux")]
mod compare;
#[cfg(target_os = "linux")]
mod real;

#[cfg(target_os = "linux")]
fn main() -> Result<(), Box<dyn std::error::Error>> {
    compare::run(std::env::args().skip(1))
}

#[cfg(not(target_os = "linux"))]
fn main() {
    println!("skipped: this needs Linux's network namespaces");
}
