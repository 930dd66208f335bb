//! The baseline of waking a thread: a number in memory, and the system's way to wake a waiting thread.

use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, mpsc};
use std::thread::{self, Thread};

use anyhow::{Context, Result};

use crate::measure::{Arrivals, Far, Near, Subject};

#[derive(Default)]
struct Slot {
    number: AtomicU32,
    reader: Mutex<Option<Thread>>,
}

/// Two threads that park.
pub(crate) struct Parking;

static SLOTS: Mutex<Option<[Arc<Slot>; 2]>> = Mutex::new(None);

pub(crate) struct End {
    to: Arc<Slot>,
    from: Arc<Slot>,
    seen: u32,
}

impl End {
    fn new([to, from]: [Arc<Slot>; 2]) -> Result<Self> {
        *from.reader.lock().map_err(|_| anyhow::anyhow!("poisoned"))? = Some(thread::current());
        Ok(Self { to, from, seen: 0 })
    }

    fn put(&self, number: u32) -> Result<()> {
        self.to.number.store(number, Ordering::Release);
        if let Some(reader) = &*self.to.reader.lock().map_err(|_| anyhow::anyhow!("poisoned"))? {
            reader.unpark();
        }
        Ok(())
    }

    fn take(&mut self) -> u32 {
        loop {
            let number = self.from.number.load(Ordering::Acquire);
            if number != self.seen {
                self.seen = number;
                return number;
            }
            thread::park();
        }
    }
}

impl Subject for Parking {
    type Near = End;
    type Far = End;

    async fn near(&self, whereabouts: mpsc::Sender<String>) -> Result<End> {
        let slots = [Arc::<Slot>::default(), Arc::default()];
        *SLOTS.lock().map_err(|_| anyhow::anyhow!("poisoned"))? = Some(slots.clone());
        let end = End::new(slots)?;
        whereabouts.send(String::new())?;
        Ok(end)
    }

    async fn far(&self, _: &str) -> Result<End> {
        let [a, b] = SLOTS.lock().map_err(|_| anyhow::anyhow!("poisoned"))?.take().context("no slots")?;
        End::new([b, a])
    }
}

impl Near for End {
    async fn pose(&mut self, number: u32) -> Result<()> {
        self.put(number)
    }

    async fn frame(&mut self, number: u32) -> Result<()> {
        self.put(number)
    }

    async fn answer(&mut self) -> Result<u32> {
        Ok(self.take())
    }

    async fn close(self) -> Result<()> {
        self.put(u32::MAX)
    }
}

impl Far for End {
    async fn serve(mut self, arrivals: Arc<Arrivals>) -> Result<()> {
        loop {
            match self.take() {
                u32::MAX => return Ok(()),
                number => {
                    arrivals.mark();
                    self.put(number)?;
                }
            }
        }
    }
}
