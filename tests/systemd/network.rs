//! A network of machines: each has a cable to a bridge, which can be unplugged.

use std::process::{self, Command};
use std::thread;

use trimaran::netem::Namespace;

use crate::machine::Machine;

/// A bridge in a network namespace of its own. It ends with this process, however that ends.
pub(crate) struct Network(Namespace);

impl Network {
    /// Joins these machines, each by its name and address.
    pub(crate) fn join(name: &str, machines: &[(&str, &str, &Machine)]) -> Self {
        let mut namespace = Namespace::find_or_make(&format!("trimaran-{name}-{}", process::id())).unwrap();
        namespace.take_name().unwrap();
        let network = Self(namespace);
        network.ip("link add bridge type bridge");
        network.ip("link set bridge up");
        for (host, address, machine) in machines {
            network.ip(&format!("link add {host} type veth peer name net0 netns {}", machine.init()));
            network.ip(&format!("link set {host} master bridge up"));
            machine.run(&format!("ip address add {address}/24 dev net0; ip link set net0 up"));
            for (host, address, _) in machines {
                machine.run(&format!("echo {address} {host} >> /etc/hosts"));
            }
        }
        network
    }

    /// Unplugs a machine's cable at the bridge, or plugs it in.
    pub(crate) fn set(&self, host: &str, state: &str) {
        self.ip(&format!("link set {host} {state}"));
    }

    fn ip(&self, words: &str) {
        let run = || {
            self.0.enter().unwrap();
            Command::new("ip").args(words.split(' ')).status().unwrap()
        };
        let status = thread::scope(|scope| scope.spawn(run).join().unwrap());
        assert!(status.success(), "ip {words}: {status}");
    }
}
