//! Shared memory through iceoryx2: the reader polls, or waits for an event.

use std::future::ready;
use std::sync::{Arc, mpsc};

use anyhow::Result;
use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::*;

use super::{POSE, pose, frame, number};
use crate::measure::{Arrivals, Far, Near, Subject};

/// Two services in shared memory, one for each direction.
pub(crate) struct SharedMemory {
    events: bool,
}

impl SharedMemory {
    pub(crate) fn polled() -> Self {
        Self { events: false }
    }

    pub(crate) fn events() -> Self {
        Self { events: true }
    }
}

pub(crate) struct End {
    _node: Node<ipc::Service>,
    out: Publisher<ipc::Service, [u8], ()>,
    into: Subscriber<ipc::Service, [u8], ()>,
    events: Option<(Notifier<ipc::Service>, Listener<ipc::Service>)>,
    frame: Vec<u8>,
}

impl End {
    fn open(sends: &str, receives: &str, events: bool) -> Result<Self> {
        let node = NodeBuilder::new().create::<ipc::Service>()?;
        let name =
            |direction: &str, kind: &str| format!("trimaran-peers/{}/{direction}/{kind}", std::process::id());
        let service = |direction: &str| {
            node.service_builder(&name(direction, "data").as_str().try_into()?)
                .publish_subscribe::<[u8]>()
                .subscriber_max_buffer_size(16)
                .enable_safe_overflow(false)
                .open_or_create()
                .map_err(anyhow::Error::from)
        };
        let event = |direction: &str| {
            node.service_builder(&name(direction, "event").as_str().try_into()?)
                .event()
                .open_or_create()
                .map_err(anyhow::Error::from)
        };
        let frame = frame(0);
        let out = service(sends)?.publisher_builder().initial_max_slice_len(frame.len()).create()?;
        let into = service(receives)?.subscriber_builder().buffer_size(16).create()?;
        let events = events
            .then(|| {
                anyhow::Ok((
                    event(sends)?.notifier_builder().create()?,
                    event(receives)?.listener_builder().create()?,
                ))
            })
            .transpose()?;
        Ok(Self { _node: node, out, into, events, frame })
    }

    fn send(&self, bytes: &[u8]) -> Result<()> {
        let sample = self.out.loan_slice_uninit(bytes.len())?;
        sample.write_from_slice(bytes).send()?;
        if let Some((notifier, _)) = &self.events {
            notifier.notify()?;
        }
        Ok(())
    }

    fn receive<R>(&mut self, read: impl Fn(&[u8]) -> R) -> Result<R> {
        loop {
            if let Some(sample) = self.into.receive()? {
                return Ok(read(sample.payload()));
            }
            match &mut self.events {
                Some((_, listener)) => {
                    listener.blocking_wait(|_| {})?;
                }
                None => std::hint::spin_loop(),
            }
        }
    }

    fn answer_all(&mut self, arrivals: &Arrivals) -> Result<()> {
        loop {
            let (number, is_frame) = self.receive(|bytes| (number(bytes), bytes.len() > POSE))?;
            let number = number?;
            if number == u32::MAX {
                return Ok(());
            }
            if is_frame {
                arrivals.mark();
            }
            self.send(&pose(number))?;
        }
    }
}

impl Subject for SharedMemory {
    type Near = End;
    type Far = End;

    async fn near(&self, whereabouts: mpsc::Sender<String>) -> Result<End> {
        set_log_level(LogLevel::Error);
        let mut end = End::open("near", "far", self.events)?;
        whereabouts.send(String::new())?;
        end.receive(|_| ())?;
        Ok(end)
    }

    async fn far(&self, _: &str) -> Result<End> {
        let end = End::open("far", "near", self.events)?;
        end.send(&pose(0))?;
        Ok(end)
    }
}

/// All work is done at once, on the calling thread.
impl Near for End {
    fn pose(&mut self, number: u32) -> impl Future<Output = Result<()>> + Send {
        ready(self.send(&pose(number)))
    }

    fn frame(&mut self, number: u32) -> impl Future<Output = Result<()>> + Send {
        self.frame[..4].copy_from_slice(&number.to_le_bytes());
        ready(self.send(&self.frame))
    }

    fn answer(&mut self) -> impl Future<Output = Result<u32>> + Send {
        ready(self.receive(number).flatten())
    }

    fn close(self) -> impl Future<Output = Result<()>> + Send {
        ready(self.send(&pose(u32::MAX)))
    }
}

impl Far for End {
    fn serve(mut self, arrivals: Arc<Arrivals>) -> impl Future<Output = Result<()>> + Send {
        ready(self.answer_all(&arrivals))
    }
}
