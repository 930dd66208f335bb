//! Key files in TOML: a private one that only its owner may read, and a public one.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde::{Deserialize, Serialize, Serializer};
use thiserror::Error;
use zeroize::Zeroizing;

use super::{NoiseSecret, PublicKeys};
use crate::Name;

const PRIVATE_REMARK: &str =
    "# Private keys of a Trimaran peer. Its holder is that peer: it stays on its machine.\n\n";
const PUBLIC_REMARK: &str =
    "# Public keys of a Trimaran peer. Copy this file to the peers that are to know it.\n\n";

/// A key file has less than a kilobyte. At most this many bytes are allocated at once.
const LONGEST: usize = 64 << 10;

/// The paths of a pair of files.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct KeyFiles {
    /// `NAME.key`: for this machine only.
    pub private: PathBuf,
    /// `NAME.pub`: for the peers.
    pub public: PathBuf,
}

/// Why keys cannot be loaded or saved.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum KeysError {
    /// The system gives no random bits.
    #[error("the system gives no randomness for keys")]
    Random(#[source] io::Error),
    /// They could not be made.
    #[error("no keys could be made")]
    Make(#[source] Box<dyn std::error::Error + Send + Sync>),
    /// A file could not be written.
    #[error("cannot write {}", .path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The system's error.
        #[source]
        cause: io::Error,
    },
    /// There are keys already.
    #[error("{} is there already: keys are not overwritten; choose another name or folder, or remove it", .path.display())]
    Exists {
        /// The file.
        path: PathBuf,
    },
    /// A file could not be read.
    #[error("cannot read the keys {}", .path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's error.
        #[source]
        cause: io::Error,
    },
    /// A file is not a key file. Its contents are not repeated: they may be secret.
    #[error("{}, line {line}: {why}; key files are as `Keys::save` writes them", .path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// The line, from 1.
        line: usize,
        /// The problem.
        why: String,
    },
    /// A public file where a private one is needed.
    #[error("{} is public: a peer's own keys are in its private file, NAME.key", .path.display())]
    Public {
        /// The file.
        path: PathBuf,
    },
    /// A private file where a public one is needed.
    #[error("{} is private, and should not have left its machine: peers are known by their public file, NAME.pub", .path.display())]
    Private {
        /// The file.
        path: PathBuf,
    },
    /// Others may read the private file.
    #[error("others may read {0} (mode {mode:03o}): run chmod 600 {0}", .path.display())]
    Exposed {
        /// The file.
        path: PathBuf,
        /// Its mode.
        mode: u32,
    },
    /// The keys in a private file cannot be used.
    #[error("the keys in {} cannot be used", .path.display())]
    Unusable {
        /// The file.
        path: PathBuf,
        /// The cause.
        #[source]
        cause: Box<Self>,
    },
    /// The key cannot sign, or does not belong to the certificate.
    #[error("the key and the certificate do not go together")]
    Mismatch(#[source] Box<dyn std::error::Error + Send + Sync>),
    /// A certificate without its key, or the other way round.
    #[error("`quic_certificate` and `quic_key` go together, and only one of them is there")]
    Half,
}

/// The contents of a private file.
#[derive(Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PrivateFile {
    pub(super) name: Name,
    /// X.509, self-signed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) quic_certificate: Option<Der>,
    /// PKCS #8.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) quic_key: Option<Der>,
    pub(super) udp_key: NoiseSecret,
}

impl PrivateFile {
    /// The certificate and the key for QUIC, if the file has them.
    pub(super) fn quic(&self) -> Result<Option<(&Der, &Der)>, KeysError> {
        match (&self.quic_certificate, &self.quic_key) {
            (Some(certificate), Some(key)) => Ok(Some((certificate, key))),
            (None, None) => Ok(None),
            _ => Err(KeysError::Half),
        }
    }
}

/// Bytes written as base64, wiped from memory when dropped: they may be secret.
#[derive(Clone, PartialEq, Eq, Deserialize)]
#[serde(try_from = "String")]
pub(super) struct Der(Zeroizing<Vec<u8>>);

impl From<Vec<u8>> for Der {
    fn from(bytes: Vec<u8>) -> Self {
        Self(bytes.into())
    }
}

impl AsRef<[u8]> for Der {
    fn as_ref(&self) -> &[u8] {
        &self.0
    }
}

impl TryFrom<String> for Der {
    type Error = &'static str;

    fn try_from(text: String) -> Result<Self, &'static str> {
        let text = Zeroizing::new(text);
        STANDARD.decode(&*text).map(Self::from).map_err(|_| "this is not base64")
    }
}

impl Der {
    /// The base64 text.
    fn to_text(&self) -> Zeroizing<String> {
        STANDARD.encode(&*self.0).into()
    }
}

impl Serialize for Der {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(&self.to_text())
    }
}

/// Writes both files, or none.
pub(super) fn save(private: &PrivateFile, public: &PublicKeys, folder: &Path) -> Result<KeyFiles, KeysError> {
    fs::create_dir_all(folder).map_err(|cause| KeysError::Write { path: folder.to_owned(), cause })?;
    let at = |ending| folder.join(format!("{}.{ending}", public.name));
    let files = KeyFiles { private: at("key"), public: at("pub") };
    write_new(&files.private, PRIVATE_REMARK, private, 0o600)?;
    write_new(&files.public, PUBLIC_REMARK, public, 0o644).inspect_err(|_| {
        // Without the public file: removes the private one, as if nothing had been made.
        let _ = fs::remove_file(&files.private);
    })?;
    Ok(files)
}

/// Writes a new file, with its mode from the first moment on.
fn write_new(path: &Path, remark: &str, content: &impl Serialize, mode: u32) -> Result<(), KeysError> {
    let failed = |cause: io::Error| match cause.kind() {
        io::ErrorKind::AlreadyExists => KeysError::Exists { path: path.to_owned() },
        _ => KeysError::Write { path: path.to_owned(), cause },
    };
    let text = Zeroizing::new(toml::to_string(content).map_err(|e| failed(io::Error::other(e)))?);
    let mut options = OpenOptions::new();
    options.write(true).create_new(true);
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::mode(&mut options, mode);
    #[cfg(not(unix))]
    let _ = mode;
    let mut file = options.open(path).map_err(failed)?;
    let written = [remark.as_bytes(), text.as_bytes()].into_iter().try_for_each(|part| file.write_all(part));
    let written = written.and_then(|()| file.sync_all());
    written.map_err(|e| {
        let _ = fs::remove_file(path);
        failed(e)
    })
}

/// Reads a private file that only its owner may read.
pub(super) fn read_private(path: &Path) -> Result<PrivateFile, KeysError> {
    let (text, mode) = read(path)?;
    let parsed = toml::from_str(&text);
    if parsed.is_err() && toml::from_str::<PublicKeys>(&text).is_ok() {
        return Err(KeysError::Public { path: path.to_owned() });
    }
    let others = if is_credential(path) { 0o007 } else { 0o077 };
    if let Some(mode) = mode.filter(|mode| mode & others != 0) {
        return Err(KeysError::Exposed { path: path.to_owned(), mode });
    }
    parsed.map_err(|e| malformed(path, &text, &e))
}

/// Whether systemd hands this file to this service. Since version 254 root owns such a file, and an access
/// control list lets only the service read it. The list's mask shows as a mode for the group.
fn is_credential(path: &Path) -> bool {
    let folder = std::env::var_os("CREDENTIALS_DIRECTORY").map(PathBuf::from);
    folder.is_some_and(|folder| folder.is_absolute() && path.starts_with(folder))
}

/// Reads a public file.
pub(super) fn read_public(path: &Path) -> Result<PublicKeys, KeysError> {
    let (text, _) = read(path)?;
    toml::from_str(&text).map_err(|e| match toml::from_str::<PrivateFile>(&text) {
        Ok(_) => KeysError::Private { path: path.to_owned() },
        Err(_) => malformed(path, &text, &e),
    })
}

/// The text of a file and its mode, where files have one. Both are of the same file, even if it is renamed
/// meanwhile.
fn read(path: &Path) -> Result<(Zeroizing<String>, Option<u32>), KeysError> {
    let failed = |cause| KeysError::Read { path: path.to_owned(), cause };
    let mut file = File::open(path).map_err(failed)?;
    let mode = mode(&file).map_err(failed)?;
    // Allocates room for all of it: text that grows leaves copies behind.
    let length = file.metadata().map_err(failed)?.len();
    let room = usize::try_from(length).unwrap_or(0).min(LONGEST);
    let mut text = Zeroizing::new(String::with_capacity(room + 1));
    file.read_to_string(&mut text).map_err(failed)?;
    Ok((text, mode))
}

#[cfg(unix)]
fn mode(file: &File) -> io::Result<Option<u32>> {
    use std::os::unix::fs::PermissionsExt;
    Ok(Some(file.metadata()?.permissions().mode() & 0o777))
}

#[cfg(not(unix))]
fn mode(_file: &File) -> io::Result<Option<u32>> {
    Ok(None)
}

/// The place and the problem; the error's own text would repeat the line.
fn malformed(path: &Path, text: &str, error: &toml::de::Error) -> KeysError {
    let before = error.span().and_then(|span| text.get(..span.start)).unwrap_or_default();
    let line = before.matches('\n').count() + 1;
    KeysError::Malformed { path: path.to_owned(), line, why: error.message().to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::keys::Keys;

    fn keys(name: &str) -> Keys {
        Keys::generate(name.parse().unwrap()).unwrap()
    }

    /// A folder with the files of a peer.
    fn saved(name: &str) -> (tempfile::TempDir, Keys, KeyFiles) {
        let folder = tempfile::tempdir().unwrap();
        let keys = keys(name);
        let files = keys.save(folder.path()).unwrap();
        (folder, keys, files)
    }

    #[test]
    fn what_was_saved_is_read_back() {
        let folder = tempfile::tempdir().unwrap();
        let made = keys("one");
        let files = made.save(&folder.path().join("deeper")).unwrap();
        assert_eq!(files.private, folder.path().join("deeper/one.key"));
        assert_eq!(files.public, folder.path().join("deeper/one.pub"));
        assert_eq!(Keys::read(&files.private).unwrap(), made);
        assert_eq!(PublicKeys::read(&files.public).unwrap(), *made.public());
        assert_ne!(keys("one"), made, "every key is another");
    }

    #[test]
    fn keys_are_not_overwritten() {
        let (folder, made, files) = saved("one");
        let again = keys("one").save(folder.path()).unwrap_err();
        assert!(matches!(&again, KeysError::Exists { path } if *path == files.private), "{again}");
        fs::remove_file(&files.private).unwrap();
        let again = keys("one").save(folder.path()).unwrap_err();
        assert!(matches!(&again, KeysError::Exists { path } if *path == files.public), "{again}");
        assert!(!files.private.exists(), "half a pair was left behind");
        assert_eq!(PublicKeys::read(&files.public).unwrap(), *made.public());
    }

    #[cfg(unix)]
    #[test]
    fn the_private_file_is_for_its_owner_only() {
        use std::os::unix::fs::PermissionsExt;
        let (_folder, _, files) = saved("one");
        let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode() & 0o777;
        assert_eq!(mode(&files.private), 0o600);
        for open in [0o640, 0o604, 0o610] {
            fs::set_permissions(&files.private, fs::Permissions::from_mode(open)).unwrap();
            let error = Keys::read(&files.private).unwrap_err();
            assert!(matches!(error, KeysError::Exposed { mode, .. } if mode == open), "{error}");
            assert!(error.to_string().contains("chmod 600"), "{error}");
        }
        fs::set_permissions(&files.private, fs::Permissions::from_mode(0o400)).unwrap();
        assert!(Keys::read(&files.private).is_ok());
    }

    #[test]
    fn the_two_files_are_not_taken_for_each_other() {
        let (_folder, _, files) = saved("one");
        let error = Keys::read(&files.public).unwrap_err();
        assert!(matches!(error, KeysError::Public { .. }), "{error}");
        let error = PublicKeys::read(&files.private).unwrap_err();
        assert!(matches!(error, KeysError::Private { .. }), "{error}");
    }

    #[test]
    fn the_public_file_holds_no_secret() {
        let (_folder, keys, files) = saved("one");
        let public = fs::read_to_string(files.public).unwrap();
        let quic = keys.file.quic_key.as_ref().map(Der::to_text);
        assert_eq!(quic.is_some(), cfg!(feature = "quic"));
        for secret in [Some(keys.noise().to_text()), quic].into_iter().flatten() {
            assert!(fs::read_to_string(&files.private).unwrap().contains(&*secret));
            assert!(!public.contains(&*secret), "{public}");
        }
        assert!(!format!("{keys:?}").contains(&*keys.noise().to_text()));
    }

    #[test]
    fn a_malformed_file_is_named_with_its_line_but_not_repeated() {
        let (_folder, keys, files) = saved("one");
        let secret = keys.noise().to_text();
        let text = fs::read_to_string(&files.private).unwrap();
        let line = text.lines().position(|line| line.starts_with("udp_key")).unwrap() + 1;
        for bad in ["udp_key = \"0", "udp_key = ", "other = \"", "udp_key = [\""] {
            fs::write(&files.private, text.replace("udp_key = \"", bad)).unwrap();
            let error = Keys::read(&files.private).unwrap_err();
            let KeysError::Malformed { line: said, .. } = &error else { panic!("{error}") };
            assert_eq!(*said, line, "{bad}: {error}");
            assert!(error.to_string().contains("one.key"), "{error}");
            assert!(!format!("{error:?} {error}").contains(&secret[..32]), "{error} gives the secret away");
        }
        fs::write(&files.public, "name = \"one\"\nquic = \"12\"\n").unwrap();
        let error = PublicKeys::read(&files.public).unwrap_err().to_string();
        assert!(error.contains("one.pub, line 2") && error.contains("64 hexadecimal digits"), "{error}");
    }

    /// A file as programs with the feature `quic` write it, without its remark.
    const BOTH: &str = include_str!("both.key");

    #[test]
    fn keys_for_quic_are_kept_by_a_program_without_it_too() {
        let (folder, _, files) = saved("one");
        fs::write(&files.private, BOTH).unwrap();
        let keys = Keys::read(&files.private).unwrap();
        let (quic, udp) = (keys.public().quic.unwrap().to_string(), keys.public().udp.to_string());
        assert_eq!(quic, "c15e91654c3007a82b1a4e66b4c4766d70b7fb1237363ad45e2ff525628d76fe");
        assert_eq!(udp, "5d5f5ddb6c2adc61b7e0234f802f0232ddf52f06cae65ec2df83c7f491a19524");
        let again = keys.save(&folder.path().join("again")).unwrap();
        assert_eq!(fs::read_to_string(again.private).unwrap().split_once("\n\n").unwrap().1, BOTH);
        assert_eq!(PublicKeys::read(&again.public).unwrap(), *keys.public());
    }

    #[test]
    fn keys_for_datagrams_alone_are_read() {
        let (folder, _, files) = saved("one");
        let line = |name| BOTH.lines().find(|line| line.starts_with(name)).unwrap();
        let text = [line("name"), line("udp_key")].join("\n");
        fs::write(&files.private, &text).unwrap();
        let keys = Keys::read(&files.private).unwrap();
        assert_eq!(keys.public().quic, None);
        let again = keys.save(&folder.path().join("again")).unwrap();
        assert!(!fs::read_to_string(&again.public).unwrap().contains("quic"));
        assert_eq!(PublicKeys::read(&again.public).unwrap(), *keys.public());
        for half in ["quic_key", "quic_certificate"] {
            fs::write(&files.private, format!("{text}\n{}", line(half))).unwrap();
            let error = Keys::read(&files.private).unwrap_err();
            let KeysError::Unusable { cause, .. } = &error else { panic!("{error}") };
            assert!(matches!(**cause, KeysError::Half), "{cause}");
        }
    }

    #[cfg(feature = "quic")]
    #[test]
    fn keys_that_do_not_go_together_are_refused() {
        let (_folder, _, files) = saved("one");
        let mut file = read_private(&files.private).unwrap();
        file.quic_key = keys("two").file.quic_key.clone();
        fs::write(&files.private, toml::to_string(&file).unwrap()).unwrap();
        let error = Keys::read(&files.private).unwrap_err();
        let KeysError::Unusable { cause, .. } = &error else { panic!("{error}") };
        assert!(matches!(**cause, KeysError::Mismatch(_)), "{cause}");
    }

    #[test]
    fn a_missing_file_is_named() {
        let error = Keys::read(Path::new("nowhere/one.key")).unwrap_err();
        assert!(error.to_string().contains("nowhere/one.key"), "{error}");
    }
}
