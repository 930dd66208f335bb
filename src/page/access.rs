//! The people who may see the scene at present, by their tokens. With a token its links end.

use std::{
    io,
    pin::Pin,
    task::{Context, Poll},
    time::SystemTime,
};

use parking_lot::RwLock;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio_util::sync::{CancellationToken, WaitForCancellationFutureOwned};

use super::{
    Token,
    tokens::{May, PersonName, TokenEntry, TokenHash, Tokens},
};

/// A token that is valid now.
#[derive(Debug, Clone)]
pub(super) struct Grant {
    /// Its person's name, if it is one person's.
    pub(super) name: Option<PersonName>,
    /// The rights of its holder.
    pub(super) may: May,
    sha256: TokenHash,
    ends_at: Option<SystemTime>,
    ended: CancellationToken,
}

/// The tokens that are valid now.
#[derive(Debug, Default)]
pub(super) struct Access(RwLock<Vec<Grant>>);

impl Access {
    /// Takes these tokens in place of those before. Links of a token that is among both go on.
    pub(super) fn replace(&self, tokens: &Tokens) {
        let new = |name, sha256, ends_at, may| Grant {
            name,
            may,
            sha256,
            ends_at,
            ended: CancellationToken::new(),
        };
        let mut next: Vec<Grant> = match tokens {
            Tokens::One(token) => vec![new(None, TokenHash::of(token.as_str()), None, May::Write)],
            Tokens::Listed(list) => {
                let grant = |entry: &TokenEntry| {
                    new(Some(entry.name.clone()), entry.sha256.clone(), entry.ends_at(), entry.may)
                };
                list.0.iter().map(grant).collect()
            }
        };
        let mut grants = self.0.write();
        for old in grants.drain(..) {
            match next.iter_mut().find(|new| new.sha256 == old.sha256) {
                Some(same) => same.ended = old.ended,
                None => old.ended.cancel(),
            }
        }
        *grants = next;
    }

    /// Ends the tokens whose time has come.
    pub(super) fn expire(&self, now: SystemTime) {
        self.0.write().retain(|grant| {
            let is_over = grant.ends_at.is_some_and(|end| end <= now);
            if is_over {
                grant.ended.cancel();
            }
            !is_over
        });
    }

    /// The grant of a token. A text that is too short for one opens nothing, though a file may have its hash.
    pub(super) fn grant(&self, token: &str) -> Option<Grant> {
        let token: Token = token.parse().ok()?;
        let sha256 = TokenHash::of(token.as_str());
        self.0.read().iter().find(|grant| grant.sha256.is(&sha256)).cloned()
    }
}

/// A connection of a token's holder: it ends with the token.
pub(super) struct Granted<C> {
    connection: C,
    // Each waits for a task of its own.
    reading: Pin<Box<WaitForCancellationFutureOwned>>,
    writing: Pin<Box<WaitForCancellationFutureOwned>>,
}

impl Grant {
    /// The connection, until this grant ends.
    pub(super) fn over<C>(self, connection: C) -> Granted<C> {
        let [reading, writing] = [(); 2].map(|()| Box::pin(self.ended.clone().cancelled_owned()));
        Granted { connection, reading, writing }
    }
}

fn ended<T>() -> Poll<io::Result<T>> {
    Poll::Ready(Err(io::Error::new(io::ErrorKind::PermissionDenied, "its token has ended")))
}

impl<C: AsyncRead + Unpin> AsyncRead for Granted<C> {
    fn poll_read(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        into: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        if self.reading.as_mut().poll(cx).is_ready() {
            return ended();
        }
        Pin::new(&mut self.connection).poll_read(cx, into)
    }
}

impl<C: AsyncWrite + Unpin> AsyncWrite for Granted<C> {
    fn poll_write(mut self: Pin<&mut Self>, cx: &mut Context<'_>, from: &[u8]) -> Poll<io::Result<usize>> {
        if self.writing.as_mut().poll(cx).is_ready() {
            return ended();
        }
        Pin::new(&mut self.connection).poll_write(cx, from)
    }

    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        if self.writing.as_mut().poll(cx).is_ready() {
            return ended();
        }
        Pin::new(&mut self.connection).poll_flush(cx)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.connection).poll_shutdown(cx)
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use tokio::io::{AsyncReadExt, AsyncWriteExt, duplex};

    use super::*;
    use crate::page::tokens::TokenList;

    const ADA: &str = "0123456789abcdef";
    const BOB: &str = "0123456789abcdeg";

    fn listed(entries: &[(&str, &str, Option<&str>)]) -> Tokens {
        let entry = |(name, token, until): &(&str, &str, Option<&str>)| TokenEntry {
            name: name.parse().unwrap(),
            sha256: TokenHash::of(token),
            until: until.map(|until| until.parse().unwrap()),
            may: May::default(),
        };
        Tokens::Listed(TokenList(entries.iter().map(entry).collect()))
    }

    fn access(tokens: &Tokens) -> Access {
        let access = Access::default();
        access.replace(tokens);
        access
    }

    #[test]
    fn a_token_is_its_holders_until_it_is_removed() {
        let access = access(&listed(&[("ada", ADA, None), ("bob", BOB, None), ("short", "abc", None)]));
        let name = |token| access.grant(token).and_then(|grant| Some(grant.name?.as_str().to_owned()));
        assert_eq!((name(ADA).as_deref(), name(BOB).as_deref()), (Some("ada"), Some("bob")));
        for wrong in ["", "abc", "0123456789abcde", "0123456789abcdef0", "0123456789abcdeh"] {
            assert_eq!(name(wrong), None, "{wrong}");
        }
        let hash = TokenHash::of(ADA).to_string();
        assert_eq!(name(&hash), None, "the hash opens nothing");
        let [ada, bob] = [ADA, BOB].map(|token| access.grant(token).unwrap());
        access.replace(&listed(&[("ada l.", ADA, None)]));
        assert!(!ada.ended.is_cancelled() && bob.ended.is_cancelled());
        assert_eq!((name(ADA).as_deref(), name(BOB)), (Some("ada l."), None));
        access.replace(&listed(&[]));
        assert!(ada.ended.is_cancelled(), "it was handed on");
        assert!(access.grant(ADA).is_none());
    }

    #[test]
    fn a_token_ends_when_its_time_has_come_and_not_before() {
        let access = access(&listed(&[("ada", ADA, Some("2030-12-31T18:00:00Z")), ("bob", BOB, None)]));
        let end = humantime::parse_rfc3339("2030-12-31T18:00:00Z").unwrap();
        let ada = access.grant(ADA).unwrap();
        access.expire(end - Duration::from_secs(1));
        assert!(access.grant(ADA).is_some() && !ada.ended.is_cancelled());
        access.expire(end);
        assert!(access.grant(ADA).is_none() && ada.ended.is_cancelled());
        assert!(access.grant(BOB).is_some());
    }

    /// A token that may only look stays one: its links go on when that changes.
    #[test]
    fn what_a_holder_may_do_is_as_the_file_says_now() {
        let may = |may| {
            let Tokens::Listed(TokenList(mut entries)) = listed(&[("ada", ADA, None)]) else { panic!() };
            entries[0].may = may;
            Tokens::Listed(TokenList(entries))
        };
        let access = access(&may(May::Look));
        let ada = access.grant(ADA).unwrap();
        assert_eq!(ada.may, May::Look);
        access.replace(&may(May::Write));
        assert_eq!((access.grant(ADA).unwrap().may, ada.ended.is_cancelled()), (May::Write, false));
        access.replace(&Tokens::One(ADA.parse().unwrap()));
        assert_eq!(access.grant(ADA).unwrap().may, May::Write);
    }

    #[test]
    fn a_longer_time_keeps_links_and_a_shorter_one_ends_them() {
        let access = access(&listed(&[("ada", ADA, Some("2030-01-01"))]));
        let ada = access.grant(ADA).unwrap();
        access.replace(&listed(&[("ada", ADA, Some("2031-01-01"))]));
        let between = humantime::parse_rfc3339("2030-06-01T00:00:00Z").unwrap();
        access.expire(between);
        assert!(!ada.ended.is_cancelled());
        access.replace(&listed(&[("ada", ADA, Some("2030-02-01"))]));
        access.expire(between);
        assert!(ada.ended.is_cancelled());
    }

    /// A task that waits for bytes, and one that waits for room, both hear the end.
    #[tokio::test]
    async fn a_connection_ends_with_its_token() {
        let access = access(&Tokens::One(ADA.parse().unwrap()));
        let (near, mut far) = duplex(8);
        let (mut reader, mut writer) = tokio::io::split(access.grant(ADA).unwrap().over(near));
        far.write_all(b"hello").await.unwrap();
        let mut came = [0; 5];
        reader.read_exact(&mut came).await.unwrap();
        assert_eq!(&came, b"hello");
        writer.write_all(b"hi").await.unwrap();
        let (read, written, ()) = tokio::join!(reader.read_u8(), writer.write_all(&[0; 100]), async {
            tokio::task::yield_now().await;
            access.replace(&Tokens::One(BOB.parse().unwrap()));
        });
        assert_eq!(read.unwrap_err().kind(), io::ErrorKind::PermissionDenied);
        assert_eq!(written.unwrap_err().kind(), io::ErrorKind::PermissionDenied);
        assert_eq!(reader.read_u8().await.unwrap_err().kind(), io::ErrorKind::PermissionDenied);
        drop((reader, writer));
        let mut rest = Vec::new();
        far.read_to_end(&mut rest).await.unwrap();
        assert_eq!(&rest[..2], b"hi");
    }
}
