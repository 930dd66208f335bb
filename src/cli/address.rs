//! The address at which `view` shows a model. It stays the same, so links and the browser's cache stay good.

use std::{
    fs, io,
    net::{Ipv4Addr, SocketAddr, TcpListener},
    path::{Path, PathBuf},
};

use blake3::Hasher;
use trimaran::{page::Token, scene_cache::private_folder};
use trimaran_transport::Net;

/// Ports of models: below the ephemeral ports of systems.
const PORTS: std::ops::Range<u16> = 20_000..32_000;
/// How many ports are tried. Other models may have the first ones.
const TRIES: u16 = 16;

/// The address of a model.
#[derive(Debug)]
pub(super) struct Address {
    /// BLAKE3 of the files' paths.
    key: [u8; 32],
}

impl Address {
    /// The address of a model's files, independent of the working directory.
    pub(super) fn of(files: &[PathBuf]) -> Self {
        let mut hasher = Hasher::new();
        for file in files {
            let file = fs::canonicalize(file).unwrap_or_else(|_| file.clone());
            let name = file.as_os_str().as_encoded_bytes();
            hasher.update(&(name.len() as u64).to_le_bytes()).update(name);
        }
        Self { key: hasher.finalize().into() }
    }

    /// Where to listen, on loopback: at the model's own port, or at one of the next. Port 0 is any.
    pub(super) fn listen(&self) -> SocketAddr {
        let at = |port| SocketAddr::from((Ipv4Addr::LOCALHOST, port));
        let is_free = |port: &u16| TcpListener::bind(at(*port)).is_ok();
        at(self.ports().find(is_free).unwrap_or(0))
    }

    fn ports(&self) -> impl Iterator<Item = u16> + use<> {
        let [first, second, ..] = self.key;
        let first = u16::from_le_bytes([first, second]) % PORTS.len() as u16;
        (first..first + TRIES).map(|port| PORTS.start + port % PORTS.len() as u16)
    }

    /// Its token, kept in the user's cache; a new one each time if it cannot be kept.
    pub(super) fn token(&self, net: &dyn Net) -> io::Result<Token> {
        let kept = private_folder().and_then(|folder| Token::kept(&self.token_in(&folder), net));
        kept.or_else(|error| {
            tracing::warn!("the page's address cannot be kept, and is a new one: {error}");
            Token::random(net)
        })
    }

    fn token_in(&self, folder: &Path) -> PathBuf {
        let digits: String = self.key.iter().skip(2).take(8).map(|byte| format!("{byte:02x}")).collect();
        folder.join(format!("view-{digits}.token"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(files: &[&str]) -> Address {
        Address::of(&files.iter().map(PathBuf::from).collect::<Vec<_>>())
    }

    #[test]
    fn a_model_has_one_address_and_others_have_others() {
        let folder = tempfile::tempdir().unwrap();
        let [a, link] = ["a.rvm", "link.rvm"].map(|name| folder.path().join(name));
        fs::write(&a, "HEAD").unwrap();
        #[cfg(unix)]
        std::os::unix::fs::symlink(&a, &link).unwrap();
        let [by_name, by_link] = [&a, &link].map(|file| Address::of(std::slice::from_ref(file)));
        #[cfg(unix)]
        assert_eq!(by_name.key, by_link.key);
        let others =
            [of(&["/b.rvm"]), of(&["/a.rvm", "/b.rvm"]), of(&["/b.rvm", "/a.rvm"]), of(&["/a.rvm/b.rvm"])];
        for (index, other) in others.iter().enumerate() {
            assert_ne!(other.key, by_name.key);
            assert!(others[..index].iter().all(|before| before.key != other.key));
            assert_ne!(other.token_in(&a), by_name.token_in(&a));
        }
    }

    #[test]
    fn the_next_port_is_taken_where_one_is_in_use() {
        let address = of(&["/some.rvm"]);
        let first = address.listen();
        assert!(PORTS.contains(&first.port()) && first.ip().is_loopback(), "{first}");
        assert_eq!(address.listen(), first, "it is the same each time");
        let _taken = TcpListener::bind(first).unwrap();
        let next = address.listen();
        assert!(next != first && address.ports().any(|port| port == next.port()), "{next}");
    }

    #[test]
    fn ports_stay_within_their_range() {
        let address = Address { key: [0xff; 32] };
        assert!(address.ports().all(|port| PORTS.contains(&port)) && address.ports().count() == 16);
        let mut key = [0; 32];
        key[..2].copy_from_slice(&11_999_u16.to_le_bytes());
        let last = Address { key };
        assert_eq!(last.ports().take(2).collect::<Vec<_>>(), [31_999, 20_000]);
    }
}
