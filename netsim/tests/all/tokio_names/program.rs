// A program on tokio. The test compiles it twice, once with tokio's own modules and once with those of the
// simulator, and compares its records.

use std::io;

use tokio_real::io::{AsyncBufReadExt, AsyncReadExt, AsyncWriteExt, BufReader};

/// Answers each line with its length, until the peer ends.
async fn serve(listener: net::TcpListener) -> io::Result<()> {
    loop {
        let (stream, peer) = listener.accept().await?;
        assert_eq!(stream.peer_addr()?, peer);
        let _served = task::spawn(async move {
            let (reader, mut writer) = stream.into_split();
            let mut lines = BufReader::new(reader).lines();
            while let Some(line) = lines.next_line().await? {
                writer.write_all(format!("{}\n", line.len()).as_bytes()).await?;
            }
            Ok::<_, io::Error>(()) // the end of the writer is the end of the stream
        });
    }
}

async fn over_tcp(record: &mut Vec<String>) -> io::Result<()> {
    let listener = net::TcpListener::bind("127.0.0.1:0").await?;
    let at = listener.local_addr()?;
    let server = task::spawn(serve(listener));
    let mut stream = net::TcpStream::connect(at).await?;
    stream.set_nodelay(true)?;
    let (mut reader, mut writer) = stream.split();
    writer.write_all(b"a line\nand another one\n").await?;
    writer.shutdown().await?;
    let mut answer = String::new();
    reader.read_to_string(&mut answer).await?;
    record.push(answer);
    let (mut reader, mut writer) = net::TcpStream::connect(at).await?.into_split();
    writer.write_all(b"the last\n").await?;
    drop(writer); // the end of what it says
    let mut answer = String::new();
    reader.read_to_string(&mut answer).await?;
    record.push(answer);
    server.abort();
    record.push(format!("aborted: {}", server.await.is_err_and(|e| e.is_cancelled())));
    let refused = net::TcpStream::connect(("127.0.0.1", at.port())).await.map_err(|e| e.kind());
    record.push(format!("{:?}", refused.err()));
    Ok(())
}

async fn over_udp(record: &mut Vec<String>) -> io::Result<()> {
    let server = net::UdpSocket::bind("127.0.0.1:0").await?;
    let at = server.local_addr()?;
    let serve = task::spawn(async move {
        let mut question = [0; 100];
        let (length, from) = server.recv_from(&mut question).await?;
        server.send_to(&question[..length.min(4)], from).await
    });
    let client = net::UdpSocket::bind("127.0.0.1:0").await?;
    record.push(format!("{:?}", client.send(b"to whom?").await.map_err(|e| e.kind()).is_err()));
    client.connect(at).await?;
    let stranger = net::UdpSocket::bind("127.0.0.1:0").await?;
    stranger.send_to(b"from a stranger", client.local_addr()?).await?;
    record.push(format!("sent {}", client.send(b"question").await?));
    let mut answer = [0; 100];
    let length = client.recv(&mut answer).await?;
    record.push(String::from_utf8_lossy(&answer[..length]).into_owned());
    record.push(format!("answered {:?}", serve.await.map(Result::ok)));
    Ok(())
}

async fn in_time(record: &mut Vec<String>) {
    let begun = time::Instant::now();
    let mut ticks = time::interval(time::Duration::from_millis(10));
    let first = ticks.tick().await;
    record.push(format!("{:?} and {:?} later", ticks.tick().await - first, ticks.tick().await - first));
    let late = time::timeout(time::Duration::from_millis(5), std::future::pending::<()>()).await;
    record.push(format!("late: {}", late.is_err()));
    let early = time::timeout(time::Duration::from_secs(3600), async { 7 }).await;
    record.push(format!("early: {:?}", early.ok()));
    time::sleep(time::Duration::from_millis(1)).await;
    record.push(format!("{}", begun.elapsed() >= time::Duration::from_millis(26)));
}

/// Records what happens.
pub(super) async fn program() -> io::Result<Vec<String>> {
    let mut record = Vec::new();
    over_tcp(&mut record).await?;
    over_udp(&mut record).await?;
    in_time(&mut record).await;
    Ok(record)
}
