//! Traces of private keys in this process's memory after they are dropped. Alone in its program, which reads
//! its own memory.
#![cfg(all(target_os = "linux", feature = "quic", feature = "udp"))]
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]

use std::fs::{self, File};
use std::hint::black_box;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use trimaran_transport::keys::{KeyFiles, Keys};
use zeroize::Zeroizing;

/// A secret with all bits flipped, so that the test itself does not hold it.
struct Secret {
    what: &'static str,
    turned: Vec<u8>,
}

impl Secret {
    fn new(what: &'static str, bytes: &[u8]) -> Self {
        Self { what, turned: bytes.iter().map(|byte| !byte).collect() }
    }
}

/// The secrets of a private file, as text and as bytes.
#[inline(never)]
fn secrets_of(file: &Path) -> Vec<Secret> {
    let mut text = Zeroizing::new(String::with_capacity(4096));
    File::open(file).unwrap().read_to_string(&mut text).unwrap();
    let value = |name: &str| {
        let line = text.lines().find_map(|line| line.strip_prefix(name)).unwrap();
        line.trim_start_matches(" = ").trim_matches('"')
    };
    let (udp, quic) = (value("udp_key"), value("quic_key"));
    let mut bytes = Zeroizing::new([0; 32]);
    for (at, byte) in bytes.iter_mut().enumerate() {
        *byte = u8::from_str_radix(&udp[2 * at..2 * at + 2], 16).unwrap();
    }
    let der = Zeroizing::new(STANDARD.decode(quic).unwrap());
    vec![
        Secret::new("the key of udp as text", udp.as_bytes()),
        Secret::new("the key of udp", &*bytes),
        Secret::new("the key of quic as text", quic.as_bytes()),
        // The seed of an Ed25519 key is there in PKCS #8 (RFC 8410, section 7).
        Secret::new("the key of quic", &der[16..48]),
    ]
}

/// How often the writable memory of this process holds each of the secrets.
fn found(secrets: &[Secret]) -> Vec<usize> {
    scribble();
    let mut memory = File::open("/proc/self/mem").unwrap();
    let mut counts = vec![0; secrets.len()];
    let mut region = Zeroizing::new(Vec::new());
    for line in fs::read_to_string("/proc/self/maps").unwrap().lines() {
        let mut fields = line.split_whitespace();
        let (range, access) = (fields.next().unwrap(), fields.next().unwrap());
        let (from, to) = range.split_once('-').unwrap();
        let [from, to] = [from, to].map(|at| u64::from_str_radix(at, 16).unwrap());
        if !access.starts_with("rw") {
            continue;
        }
        region.resize((to - from) as usize, 0);
        memory.seek(SeekFrom::Start(from)).unwrap();
        // Some regions of the kernel cannot be read.
        if memory.read_exact(&mut region).is_err() {
            continue;
        }
        for (count, Secret { turned, .. }) in counts.iter_mut().zip(secrets) {
            let same = |window: &&[u8]| window.iter().zip(turned).all(|(byte, turned)| *byte == !turned);
            *count += region.windows(turned.len()).filter(same).count();
        }
        // The bytes read from there must not count as memory of this process.
        region.fill(0);
    }
    counts
}

/// Overwrites the stack of earlier calls: a moved value leaves a copy there until another call reuses the
/// space.
#[inline(never)]
fn scribble() {
    black_box(&mut [0x55_u8; 512 << 10]);
}

#[inline(never)]
fn made(folder: &Path) -> KeyFiles {
    let keys = Keys::generate("one".parse().unwrap()).unwrap();
    keys.save(folder).unwrap()
}

fn left(secrets: &[Secret]) -> Vec<(&'static str, usize)> {
    let counts = found(secrets).into_iter();
    secrets.iter().map(|secret| secret.what).zip(counts).filter(|(_, count)| *count > 0).collect()
}

#[test]
fn nothing_is_left_of_private_keys_that_were_dropped() {
    let folder = tempfile::tempdir().unwrap();
    let files = made(folder.path());
    let secrets = secrets_of(&files.private);
    let keys = Keys::read(&files.private).unwrap();
    let held = left(&secrets);
    assert_eq!(
        held.len(),
        2,
        "the two keys are there as long as they are used, and their text is not: {held:?}"
    );
    drop(keys);
    assert_eq!(left(&secrets), []);
}
