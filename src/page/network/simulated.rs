//! Networks in virtual time that keeps step with the clock.
//!
//! The page's bytes go through a [`Simulation`] that keeps step with the clock: over TCP, and over the links
//! of a [`Profile`]. So they are delayed, lost and sent again, as in `trimaran sim`.

use std::{
    collections::HashMap,
    io,
    net::SocketAddr,
    sync::{Arc, Weak},
    thread,
};

use parking_lot::Mutex;
use tokio::{
    io::{DuplexStream, copy_bidirectional, duplex, join},
    sync::mpsc,
};
use trimaran_net::{Instant, Listen, Net, Stream, TcpOptions};
use trimaran_netsim::{Profile, SimNet, Simulation};

use super::{Connection, MOST, NetworkError, SimulatedNetwork, Wanted};

/// Buffer between a simulated machine and the real connection, bytes.
const BUFFER: usize = 64 << 10;
/// Selects the lost packets.
const SEED: u64 = 1;

/// The simulated networks of all pages.
#[derive(Debug, Default)]
pub(in crate::page) struct Networks(Mutex<HashMap<Wanted, Weak<Network>>>);

/// The network of one page. Its thread ends with the last connection.
#[derive(Debug)]
pub(in crate::page) struct Network(mpsc::UnboundedSender<Crossing>);

/// A connection to carry through a network.
struct Crossing {
    page: Box<dyn Connection>,
    culler: DuplexStream,
    /// Kept as long as a connection uses it.
    network: Arc<Network>,
}

/// The networks that come with the program.
pub(in crate::page) fn names() -> Vec<SimulatedNetwork> {
    let profiles = Profile::names().filter_map(|name| Profile::find(name).ok());
    profiles.map(|Profile { name, about, .. }| SimulatedNetwork { name, about }).collect()
}

impl Networks {
    /// The network of a page, made for its first connection.
    pub(in crate::page) fn get(
        &self,
        wanted: Wanted,
        net: &Arc<dyn Net>,
    ) -> Result<Arc<Network>, NetworkError> {
        let known = Profile::names().any(|name| name == wanted.network);
        let profile = Profile::find(&wanted.network).ok().filter(|_| known).ok_or(NetworkError::Unknown)?;
        let mut networks = self.0.lock();
        networks.retain(|_, network| network.strong_count() > 0);
        if let Some(network) = networks.get(&wanted).and_then(Weak::upgrade) {
            return Ok(network);
        }
        if networks.len() >= MOST {
            return Err(NetworkError::TooMany);
        }
        let network = Arc::new(Network::begin(profile, Arc::clone(net))?);
        networks.insert(wanted, Arc::downgrade(&network));
        Ok(network)
    }
}

impl Network {
    fn begin(profile: Profile, clock: Arc<dyn Net>) -> io::Result<Self> {
        let (crossings, asked) = mpsc::unbounded_channel();
        thread::Builder::new().name("network".into()).spawn(move || simulate(&profile, &*clock, asked))?;
        Ok(Self(crossings))
    }

    /// The far end of a page's connection, for the culler.
    pub(in crate::page) fn cross(self: Arc<Self>, page: impl Connection + 'static) -> DuplexStream {
        let (culler, far) = duplex(BUFFER);
        let network = Arc::clone(&self);
        let _has_ended = self.0.send(Crossing { page: Box::new(page), culler, network });
        far
    }
}

/// Carries connections through the network, until there are none.
fn simulate(profile: &Profile, clock: &dyn Net, mut asked: mpsc::UnboundedReceiver<Crossing>) {
    let mut network = profile.sites();
    let [host, page] = [network.near("culler"), network.far("page")];
    let simulation = Simulation::new(&network.topology, SEED);
    let [page, culler] = [page, host].map(|host| simulation.net(host));
    let at = SocketAddr::new(host.v4(), 0);
    let begun = clock.now();
    let time = || Instant::from_nanos(0).after(clock.now().since(begun));
    simulation.run_in_step(time, async {
        while let Some(crossing) = asked.recv().await {
            match culler.listen_tcp(at, TcpOptions::default()) {
                Ok((listener, at)) => cross(&page, crossing, (listener, at)),
                Err(e) => tracing::warn!("a page's connection cannot cross its network: {e}"),
            }
        }
    });
}

/// Connects the page's machine to the culler's, which listens.
fn cross(
    page: &SimNet,
    Crossing { page: near, culler: far, network }: Crossing,
    (mut listener, at): (Box<dyn Listen>, SocketAddr),
) {
    let machine = page.clone();
    page.spawn(Box::pin(async move {
        match tokio::try_join!(machine.connect_tcp(at, TcpOptions::default()), listener.accept()) {
            Ok((here, there)) => drop(tokio::join!(carry(near, here), carry(far, there))),
            Err(e) => tracing::warn!("a page's connection cannot cross its network: {e}"),
        }
        drop(network);
    }));
}

/// Carries bytes both ways until both have ended. A connection that breaks ends the other one.
async fn carry(mut real: impl Connection, Stream { reader, writer, .. }: Stream) {
    let _broken = copy_bidirectional(&mut real, &mut join(reader, writer)).await;
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use tokio::io::{AsyncReadExt, AsyncWriteExt};
    use trimaran_net::TokioNet;

    use super::*;

    fn wanted(network: &str, page: usize) -> Wanted {
        Wanted { network: network.to_owned(), page: page.to_string() }
    }

    #[tokio::test]
    async fn a_network_is_one_that_comes_with_the_program() {
        let (networks, net): (_, Arc<dyn Net>) =
            (Networks::default(), Arc::new(TokioNet::current().unwrap()));
        for name in ["", "wan", "netsim/profiles/wifi.toml", "../wifi"] {
            let refused = networks.get(wanted(name, 1), &net);
            assert!(matches!(refused, Err(NetworkError::Unknown)), "{name}: {refused:?}");
        }
    }

    #[tokio::test]
    async fn pages_have_networks_of_their_own_and_there_are_few() {
        let (networks, net): (_, Arc<dyn Net>) =
            (Networks::default(), Arc::new(TokioNet::current().unwrap()));
        let mut kept: Vec<_> =
            (0..MOST).map(|page| networks.get(wanted("wifi", page), &net).unwrap()).collect();
        assert!(
            Arc::ptr_eq(&kept[3], &networks.get(wanted("wifi", 3), &net).unwrap()),
            "a page shares its own"
        );
        assert!(matches!(networks.get(wanted("wifi", MOST), &net), Err(NetworkError::TooMany)));
        kept.pop();
        networks.get(wanted("wifi", MOST), &net).unwrap();
    }

    /// Bytes arrive unchanged, and not before their time. Closing one end reaches the other.
    #[tokio::test]
    async fn bytes_cross_in_their_time_and_an_end_is_heard() {
        let (networks, net): (_, Arc<dyn Net>) =
            (Networks::default(), Arc::new(TokioNet::current().unwrap()));
        let network = networks.get(wanted("wan-80ms", 1), &net).unwrap();
        let (mut page, near) = duplex(BUFFER);
        let mut culler = network.cross(near);
        let begun = net.now();
        page.write_all(b"camera").await.unwrap();
        let mut came = [0; 6];
        culler.read_exact(&mut came).await.unwrap();
        culler.write_all(&came).await.unwrap();
        page.read_exact(&mut came).await.unwrap();
        assert_eq!(&came, b"camera");
        // The connection itself takes another round trip before that.
        let took = net.now().since(begun);
        assert!(took >= Duration::from_millis(150), "{took:?}");
        drop(page);
        assert_eq!(culler.read(&mut came).await.unwrap(), 0);
    }
}
