//! Unix stream sockets of tokio.

use std::fs::{self, File, TryLockError};
use std::io;
use std::os::unix::fs::{FileTypeExt, MetadataExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::time::Duration;

use socket2::{Domain, SockAddr, Socket, Type};
use tokio::net::{UnixListener, UnixStream};

use crate::{BoxFuture, Credentials, Listen, Stream, StreamPeer, UnixSocketOptions};

/// How often a listener tries to lock the folder of its socket, and the pause between tries.
const TURNS: u32 = 200;
const PAUSE: Duration = Duration::from_millis(5);

/// Connects to the socket at `path`.
pub(super) async fn connect(path: &Path) -> io::Result<Stream> {
    stream(UnixStream::connect(path).await?)
}

/// Listens at `path`. The file of a dead listener is replaced, any other left alone.
pub(super) async fn listen(path: &Path, options: &UnixSocketOptions) -> io::Result<Box<dyn Listen>> {
    let folder = lock_folder(path).await?;
    remove_stale(path)?;
    let socket = Socket::new(Domain::UNIX, Type::STREAM, None)?;
    socket.set_nonblocking(true)?;
    socket.bind(&SockAddr::unix(path)?)?;
    // Connections come only after `listen`: the file has its permissions by then.
    fs::set_permissions(path, fs::Permissions::from_mode(options.mode))?;
    let file = SocketFile::at(path)?;
    socket.listen(options.backlog)?;
    drop(folder);
    let listener = UnixListener::from_std(std::os::fd::OwnedFd::from(socket).into())?;
    Ok(Box::new(TokioUnixListener { _file: file, listener }))
}

/// Two listeners that start at once must not take each other's new file for a stale one. The lock keeps the
/// folder to one of them meanwhile.
async fn lock_folder(path: &Path) -> io::Result<File> {
    let folder = File::open(path.parent().unwrap_or(Path::new("/")))?;
    for _ in 0..TURNS {
        match folder.try_lock() {
            Ok(()) => return Ok(folder),
            Err(TryLockError::WouldBlock) => tokio::time::sleep(PAUSE).await,
            Err(TryLockError::Error(e)) => return Err(e),
        }
    }
    Err(io::Error::new(io::ErrorKind::TimedOut, "another program keeps the folder of the socket locked"))
}

/// Removes the file of a socket on which nobody listens.
fn remove_stale(path: &Path) -> io::Result<()> {
    match fs::symlink_metadata(path) {
        Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(()),
        Err(e) => return Err(e),
        Ok(found) if !found.file_type().is_socket() => {
            return Err(io::Error::new(io::ErrorKind::AlreadyExists, "there is a file that is no socket"));
        }
        Ok(_) => {}
    }
    let probe = Socket::new(Domain::UNIX, Type::STREAM, None)?;
    probe.set_nonblocking(true)?;
    match probe.connect(&SockAddr::unix(path)?) {
        // A listener that leaves may remove its file meanwhile.
        Err(e) if e.kind() == io::ErrorKind::ConnectionRefused => match fs::remove_file(path) {
            Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(()),
            removed => removed,
        },
        Err(e) if e.kind() == io::ErrorKind::PermissionDenied => Err(e),
        // Taken, or the backlog is full: somebody listens.
        Ok(()) | Err(_) => Err(io::ErrorKind::AddrInUse.into()),
    }
}

/// The file of a listener's socket, removed with it unless replaced.
#[derive(Debug)]
struct SocketFile {
    path: PathBuf,
    id: (u64, u64),
}

impl SocketFile {
    fn at(path: &Path) -> io::Result<Self> {
        Ok(Self { path: path.to_owned(), id: id(path)? })
    }
}

fn id(path: &Path) -> io::Result<(u64, u64)> {
    let file = fs::symlink_metadata(path)?;
    Ok((file.dev(), file.ino()))
}

impl Drop for SocketFile {
    fn drop(&mut self) {
        if id(&self.path).is_ok_and(|there| there == self.id) {
            let _gone_already = fs::remove_file(&self.path);
        }
    }
}

#[derive(Debug)]
struct TokioUnixListener {
    // Declared before the socket, and so dropped first: once nobody listens, another may replace the file,
    // and the new one may have the same number.
    _file: SocketFile,
    listener: UnixListener,
}

impl Listen for TokioUnixListener {
    fn accept(&mut self) -> BoxFuture<'_, io::Result<Stream>> {
        Box::pin(async move { stream(self.listener.accept().await?.0) })
    }
}

fn stream(socket: UnixStream) -> io::Result<Stream> {
    let peer = socket.peer_cred()?;
    let peer = Credentials { uid: peer.uid(), gid: peer.gid(), pid: peer.pid() };
    let (reader, writer) = socket.into_split();
    Ok(Stream { reader: Box::new(reader), writer: Box::new(writer), peer: StreamPeer::Unix(peer) })
}

#[cfg(test)]
mod tests {
    use std::thread;

    use super::*;
    use crate::{Net, TokioNet};

    /// The next listener's file may have the same number as the last one's.
    #[tokio::test]
    async fn who_listens_next_keeps_its_file() {
        let path = std::env::temp_dir().join(format!("trimaran-net-{}.sock", std::process::id()));
        let (net, options) = (TokioNet::current().unwrap(), UnixSocketOptions::default());
        let mut last = net.listen_unix(&path, &options).await.unwrap();
        for turn in 0..400 {
            let leaves = thread::spawn({
                let runtime = tokio::runtime::Handle::current();
                move || {
                    let _within = runtime.enter();
                    drop(last);
                }
            });
            last = loop {
                match net.listen_unix(&path, &options).await {
                    Ok(next) => break next,
                    Err(e) => assert_eq!(e.kind(), io::ErrorKind::AddrInUse, "{e}"),
                }
            };
            leaves.join().unwrap();
            assert!(path.exists(), "turn {turn}: the file of the next listener was removed");
        }
    }
}
