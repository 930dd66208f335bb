//! Another protocol over `Net`: questions and answers in datagrams, asked again where packets are lost.
//! Neither the client nor the server knows whether its network is simulated.
//!
//! ```sh
//! cargo run -p trimaran-netsim --example a_protocol_of_your_own
//! ```

use std::error::Error;
use std::future::poll_fn;
use std::io::{self, IoSliceMut};
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use trimaran_net::{Net, RecvMeta, Transmit, UdpSocket, UdpSocketOptions, until};
use trimaran_netsim::{Profile, Simulation};

/// How long to wait for an answer before asking again.
const PATIENCE: Duration = Duration::from_millis(20);
/// How many questions are asked, one after the other.
const QUESTIONS: u32 = 2000;

fn main() -> Result<(), Box<dyn Error>> {
    let summary = summary("wifi", 1)?;
    println!(
        "{QUESTIONS} answers on wifi: {:.2} ms in the median, {:.2} at the 99th percentile, {} asked again, {:.1} s in all",
        millis(summary.median),
        millis(summary.p99),
        summary.repeated,
        summary.time.as_secs_f64()
    );
    Ok(())
}

struct Summary {
    median: Duration,
    p99: Duration,
    repeated: u32,
    time: Duration,
}

/// Runs client and server at two hosts of a network.
fn summary(network: &str, seed: u64) -> Result<Summary, Box<dyn Error>> {
    let mut network = Profile::find(network)?.sites();
    let [client, server] = [network.near("client"), network.far("server")];
    let simulation = Simulation::new(&network.topology, seed);
    let [here, there] = [client, server].map(|host| Arc::new(simulation.net(host)) as Arc<dyn Net>);
    let socket = there.bind_udp("0.0.0.0:9000".parse()?, UdpSocketOptions::default())?;
    there.spawn(Box::pin(async move {
        let ended = serve(&*socket).await;
        debug_assert!(ended.is_ok(), "a simulated socket does not fail");
    }));
    let server = SocketAddr::new(server.v4(), 9000);
    let (mut times, repeated) = simulation.run(ask(here, server))??;
    times.sort_unstable();
    let at = |share: f64| times.get((share * times.len() as f64) as usize).copied().unwrap_or_default();
    let time = Duration::from_nanos(simulation.now().as_nanos());
    Ok(Summary { median: at(0.5), p99: at(0.99), repeated, time })
}

fn millis(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}

/// Answers each question with its square.
async fn serve(socket: &dyn UdpSocket) -> io::Result<()> {
    loop {
        let (question, from) = receive(socket).await?;
        send(socket, from, u64::from(question as u32).pow(2))?;
    }
}

/// Asks one question after the other. Returns each one's time, and how many had to be asked again.
async fn ask(net: Arc<dyn Net>, server: SocketAddr) -> io::Result<(Vec<Duration>, u32)> {
    let socket = net.bind_udp("0.0.0.0:0".parse().map_err(io::Error::other)?, UdpSocketOptions::default())?;
    let (mut times, mut repeated) = (Vec::new(), 0);
    for question in 0..QUESTIONS {
        let asked = net.now();
        send(&*socket, server, question.into())?;
        let expected = u64::from(question).pow(2);
        loop {
            match until(&*net, net.now().after(PATIENCE), answer(&*socket, expected)).await {
                Some(answered) => break answered?,
                None => {
                    repeated += 1;
                    send(&*socket, server, question.into())?;
                }
            }
        }
        times.push(net.now().since(asked));
    }
    Ok((times, repeated))
}

/// Waits for this answer, and skips those to questions that were asked twice.
async fn answer(socket: &dyn UdpSocket, expected: u64) -> io::Result<()> {
    while receive(socket).await?.0 != expected {}
    Ok(())
}

fn send(socket: &dyn UdpSocket, destination: SocketAddr, number: u64) -> io::Result<()> {
    let contents = &number.to_le_bytes();
    socket.try_send(&Transmit { destination, ecn: None, contents, segment_size: None, src_ip: None })
}

async fn receive(socket: &dyn UdpSocket) -> io::Result<(u64, SocketAddr)> {
    let (mut number, mut meta) = ([0; 8], [RecvMeta::default()]);
    poll_fn(|cx| socket.poll_recv(cx, &mut [IoSliceMut::new(&mut number)], &mut meta)).await?;
    let [meta] = meta;
    Ok((u64::from_le_bytes(number), meta.addr))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_hops_there_and_two_back_and_one_in_twenty_five_is_asked_again() {
        let wifi = summary("wifi", 1).unwrap();
        // Four hops of a millisecond on average; the heavy tail pulls the mean above the median.
        assert!((3.0..4.2).contains(&millis(wifi.median)), "{:?}", wifi.median);
        // Each of the four loses a hundredth: 3.94 % of 2000 are 79, with a deviation of 9; slow answers are
        // asked for again too.
        assert!((50..150).contains(&wifi.repeated), "{}", wifi.repeated);
        assert!(wifi.p99 >= PATIENCE, "{:?}", wifi.p99);
        // Exactly the path there and back, to the nanosecond: 46 bytes padded to 64, and 20 more, four times,
        // and 4 x 5 us.
        let wired = summary("fast-ethernet", 1).unwrap();
        assert_eq!(
            (wired.median, wired.p99, wired.repeated),
            (Duration::from_nanos(46_880), Duration::from_nanos(46_880), 0)
        );
        assert_eq!(wired.time, Duration::from_nanos(46_880) * QUESTIONS);
    }
}
