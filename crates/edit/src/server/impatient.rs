//! Connections that do not wait for ever for a client that does not read.

use super::PATIENCE;
use hyper::rt::{Read, ReadBufCursor, Write};
use std::future::Future;
use std::io;
use std::pin::Pin;
use std::task::{Context, Poll, ready};
use std::time::Duration;
use tokio::time::{Instant, Sleep, sleep_until};

/// A client that reads fewer bytes a second does not read.
const SLOWEST: u64 = 1 << 14;

/// A connection whose writing fails when what waits to be written has not left in time:
/// [`PATIENCE`], and as long as a slow line takes for what was written meanwhile.
pub(crate) struct Impatient<T> {
    inner: T,
    /// Since when the client has not read all: when that is too long, and how much was written
    /// meanwhile.
    stalled: Option<Stall>,
}

struct Stall {
    since: Instant,
    written: u64,
    end: Pin<Box<Sleep>>,
}

impl<T> Impatient<T> {
    pub(crate) fn new(inner: T) -> Impatient<T> {
        Impatient {
            inner,
            stalled: None,
        }
    }

    /// Counts what was written; where nothing can be written, waits until that is too long.
    fn watch(
        &mut self,
        context: &mut Context<'_>,
        written: Poll<io::Result<usize>>,
    ) -> Poll<io::Result<usize>> {
        if let (Poll::Ready(Ok(bytes)), Some(stall)) = (&written, &mut self.stalled) {
            stall.written += *bytes as u64;
            let line = Duration::from_secs(stall.written / SLOWEST);
            stall.end.as_mut().reset(stall.since + PATIENCE + line);
        }
        if written.is_ready() {
            return written;
        }
        let stall = self.stalled.get_or_insert_with(|| {
            let since = Instant::now();
            let end = Box::pin(sleep_until(since + PATIENCE));
            Stall {
                since,
                written: 0,
                end,
            }
        });
        ready!(stall.end.as_mut().poll(context));
        Poll::Ready(Err(io::ErrorKind::TimedOut.into()))
    }
}

impl<T: Read + Unpin> Read for Impatient<T> {
    fn poll_read(
        self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: ReadBufCursor<'_>,
    ) -> Poll<io::Result<()>> {
        Pin::new(&mut self.get_mut().inner).poll_read(context, buffer)
    }
}

impl<T: Write + Unpin> Write for Impatient<T> {
    fn poll_write(
        self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        let own = self.get_mut();
        let written = Pin::new(&mut own.inner).poll_write(context, bytes);
        own.watch(context, written)
    }

    /// Called when all has been written.
    fn poll_flush(self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        let own = self.get_mut();
        own.stalled = None;
        Pin::new(&mut own.inner).poll_flush(context)
    }

    fn poll_shutdown(self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.get_mut().inner).poll_shutdown(context)
    }
}
