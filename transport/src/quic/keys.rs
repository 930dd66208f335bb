//! A peer's key and certificate: made, kept in files, read back.

use std::fmt;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use rcgen::{CertificateParams, KeyPair, PKCS_ED25519};
use rustls::crypto::ring::sign::any_supported_type;
use rustls::pki_types::pem::{self, PemObject};
use rustls::pki_types::{CertificateDer, PrivateKeyDer};
use rustls::sign::CertifiedKey;
use thiserror::Error;

use super::Fingerprint;

/// The file of the private key within a folder of keys.
const KEY_FILE: &str = "key.pem";
/// The file of the certificate within a folder of keys.
const CERTIFICATE_FILE: &str = "cert.pem";
/// The name in the certificate. Nobody relies on it: peers know each other by fingerprint.
const NAME: &str = "trimaran";

/// A private key, and the self-signed certificate that goes with it.
///
/// Ed25519: its signatures have one length, so that a simulated handshake has the same packets every time.
#[derive(Clone)]
pub struct Keys {
    pub(crate) certified: Arc<CertifiedKey>,
    fingerprint: Fingerprint,
}

/// Why there are no keys.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum KeysError {
    /// They could not be made.
    #[error("no keys could be made")]
    Make(#[from] rcgen::Error),
    /// A file could not be written.
    #[error("cannot write {}", .path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// What the system says.
        #[source]
        cause: io::Error,
    },
    /// There are keys already.
    #[error("{} is there already: keys are not overwritten; choose another folder, or remove it", .path.display())]
    Exists {
        /// The file.
        path: PathBuf,
    },
    /// A file could not be read, or is no PEM file.
    #[error("cannot read {}", .path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        #[source]
        cause: pem::Error,
    },
    /// Others may read the private key.
    #[error("others may read {} (mode {mode:03o}): run chmod 600 on it", .path.display())]
    Exposed {
        /// The file.
        path: PathBuf,
        /// Its mode.
        mode: u32,
    },
    /// The key is of no kind that can sign, or not the one of the certificate.
    #[error("the key and the certificate do not go together")]
    Mismatch(#[from] rustls::Error),
}

impl Keys {
    /// New keys that live as long as this process.
    ///
    /// # Errors
    /// When the system gives no randomness.
    pub fn ephemeral() -> Result<Self, KeysError> {
        Pem::new()?.read()
    }

    /// Makes new keys in `folder`, which is created where it is missing: `key.pem`, for its owner's eyes only, and `cert.pem`.
    ///
    /// # Errors
    /// When there are keys already, or a file cannot be written.
    pub fn create(folder: &Path) -> Result<Self, KeysError> {
        let pem = Pem::new()?;
        fs::create_dir_all(folder).map_err(|cause| KeysError::Write { path: folder.to_owned(), cause })?;
        write_new(folder.join(KEY_FILE), &pem.key, 0o600)?;
        write_new(folder.join(CERTIFICATE_FILE), &pem.certificate, 0o644)?;
        pem.read()
    }

    /// Reads what [`Keys::create`] made.
    ///
    /// # Errors
    /// When a file is missing or malformed, or others may read the private key.
    pub fn read(folder: &Path) -> Result<Self, KeysError> {
        let path = folder.join(KEY_FILE);
        check_private(&path)?;
        let key = PrivateKeyDer::from_pem_file(&path).map_err(|cause| KeysError::Read { path, cause })?;
        let path = folder.join(CERTIFICATE_FILE);
        let certificate =
            CertificateDer::from_pem_file(&path).map_err(|cause| KeysError::Read { path, cause })?;
        Self::new(certificate, &key)
    }

    /// What other peers know this one by.
    #[must_use]
    pub const fn fingerprint(&self) -> Fingerprint {
        self.fingerprint
    }

    fn new(certificate: CertificateDer<'static>, key: &PrivateKeyDer<'_>) -> Result<Self, KeysError> {
        let fingerprint = Fingerprint::of(&certificate);
        let certified = CertifiedKey::new(vec![certificate], any_supported_type(key)?);
        certified.keys_match()?;
        Ok(Self { certified: Arc::new(certified), fingerprint })
    }
}

impl fmt::Debug for Keys {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Keys").field("fingerprint", &self.fingerprint).finish_non_exhaustive()
    }
}

impl PartialEq for Keys {
    fn eq(&self, other: &Self) -> bool {
        self.fingerprint == other.fingerprint
    }
}

/// Both as texts.
struct Pem {
    key: String,
    certificate: String,
}

impl Pem {
    fn new() -> Result<Self, KeysError> {
        let key = KeyPair::generate_for(&PKCS_ED25519)?;
        let certificate = CertificateParams::new(vec![NAME.to_owned()])?.self_signed(&key)?;
        Ok(Self { key: key.serialize_pem(), certificate: certificate.pem() })
    }

    fn read(&self) -> Result<Keys, KeysError> {
        let malformed = |name: &str| {
            let path = PathBuf::from(name);
            |cause| KeysError::Read { path, cause }
        };
        let key = PrivateKeyDer::from_pem_slice(self.key.as_bytes()).map_err(malformed(KEY_FILE))?;
        let certificate = CertificateDer::from_pem_slice(self.certificate.as_bytes())
            .map_err(malformed(CERTIFICATE_FILE))?;
        Keys::new(certificate, &key)
    }
}

/// Writes a file that must not be there, with its mode from the first moment on.
fn write_new(path: PathBuf, text: &str, mode: u32) -> Result<(), KeysError> {
    let mut options = OpenOptions::new();
    options.write(true).create_new(true);
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::mode(&mut options, mode);
    #[cfg(not(unix))]
    let _ = mode;
    let write = |mut file: File| file.write_all(text.as_bytes()).and_then(|()| file.sync_all());
    match options.open(&path).and_then(write) {
        Ok(()) => Ok(()),
        Err(e) if e.kind() == io::ErrorKind::AlreadyExists => Err(KeysError::Exists { path }),
        Err(cause) => Err(KeysError::Write { path, cause }),
    }
}

#[cfg(unix)]
fn check_private(path: &Path) -> Result<(), KeysError> {
    use std::os::unix::fs::PermissionsExt;
    let read = |cause| KeysError::Read { path: path.to_owned(), cause: pem::Error::Io(cause) };
    let mode = fs::metadata(path).map_err(read)?.permissions().mode() & 0o777;
    if mode & 0o077 == 0 { Ok(()) } else { Err(KeysError::Exposed { path: path.to_owned(), mode }) }
}

#[cfg(not(unix))]
fn check_private(_path: &Path) -> Result<(), KeysError> {
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_made_is_read_back() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path().join("deeper");
        let made = Keys::create(&folder).unwrap();
        let read = Keys::read(&folder).unwrap();
        assert_eq!(made, read);
        assert_ne!(made, Keys::ephemeral().unwrap(), "every key is another");
        let again = Keys::create(&folder).unwrap_err();
        assert!(matches!(again, KeysError::Exists { .. }), "{again}");
        assert_eq!(Keys::read(&folder).unwrap(), made, "and left alone");
    }

    #[cfg(unix)]
    #[test]
    fn the_private_key_is_for_its_owner_only() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        Keys::create(folder.path()).unwrap();
        let path = folder.path().join(KEY_FILE);
        assert_eq!(fs::metadata(&path).unwrap().permissions().mode() & 0o777, 0o600);
        fs::set_permissions(&path, fs::Permissions::from_mode(0o640)).unwrap();
        let error = Keys::read(folder.path()).unwrap_err();
        assert!(matches!(error, KeysError::Exposed { mode: 0o640, .. }), "{error}");
        assert!(error.to_string().contains("chmod 600"), "{error}");
    }

    #[test]
    fn another_certificate_does_not_go_with_the_key() {
        let (a, b) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        Keys::create(a.path()).unwrap();
        Keys::create(b.path()).unwrap();
        fs::copy(a.path().join(CERTIFICATE_FILE), b.path().join(CERTIFICATE_FILE)).unwrap();
        assert!(matches!(Keys::read(b.path()).unwrap_err(), KeysError::Mismatch(_)));
    }

    #[test]
    fn a_missing_or_malformed_file_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let error = Keys::read(folder.path()).unwrap_err();
        assert!(error.to_string().contains(KEY_FILE), "{error}");
        Keys::create(folder.path()).unwrap();
        fs::write(folder.path().join(CERTIFICATE_FILE), "no certificate").unwrap();
        let error = Keys::read(folder.path()).unwrap_err();
        assert!(error.to_string().contains(CERTIFICATE_FILE), "{error}");
    }
}
