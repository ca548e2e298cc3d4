//! Work behind a command's back: while it reads and computes the next batch, a thread of its own deals with those before.

use crate::Result;
use std::sync::mpsc::{Receiver, Sender, SyncSender, channel, sync_channel};
use std::thread::JoinHandle;

/// Does something with batches that wait, in their order.
type Work<B, T> = Box<dyn FnMut(&mut T, &[B]) -> Result<()> + Send>;

/// Work with batches `B` on a target `T`: one batch alone needs no thread.
pub struct Behind<B: Send + 'static, T: Send + 'static> {
    /// Taken out when all is done, or it broke.
    stage: Option<Stage<B, T>>,
    /// How many batches wait at most.
    waiting: usize,
}

enum Stage<B, T> {
    Here(T, Work<B, T>),
    There(Helper<B, T>),
}

/// The thread.
struct Helper<B, T> {
    batches: SyncSender<B>,
    spent: Receiver<B>,
    thread: JoinHandle<(T, Result<()>)>,
}

impl<B: Default + Send + 'static, T: Send + 'static> Behind<B, T> {
    /// Nothing to do yet. `work` is given up to `waiting` batches at a time: as soon as one is there what came meanwhile.
    pub fn new(
        target: T,
        waiting: usize,
        work: impl FnMut(&mut T, &[B]) -> Result<()> + Send + 'static,
    ) -> Behind<B, T> {
        Behind {
            stage: Some(Stage::Here(target, Box::new(work))),
            waiting,
        }
    }

    /// Gives a batch to the thread; gives memory for the next one, as it was when it was spent. An error may be that of a
    /// batch before.
    pub fn give(&mut self, batch: B) -> Result<B> {
        let helper = match self.stage.take() {
            Some(Stage::Here(target, work)) => Helper::start(target, work, self.waiting),
            Some(Stage::There(helper)) => helper,
            None => return Ok(batch),
        };
        let next = helper.spent.try_recv().unwrap_or_default();
        if helper.batches.send(batch).is_err() {
            // It ended before its time: it could not go on.
            return helper.end().1.map(|()| next);
        }
        self.stage = Some(Stage::There(helper));
        Ok(next)
    }

    /// Deals with the last batch and waits until all is done; the target, unless it broke before.
    pub fn end(&mut self, last: B) -> Result<Option<T>> {
        if let Some(Stage::Here(mut target, mut work)) =
            self.stage.take_if(|s| matches!(s, Stage::Here(..)))
        {
            return work(&mut target, &[last]).map(|()| Some(target));
        }
        self.give(last)?;
        match self.stage.take() {
            Some(Stage::There(helper)) => {
                let (target, done) = helper.end();
                done.map(|()| Some(target))
            }
            _ => Ok(None),
        }
    }
}

impl<B: Send + 'static, T: Send + 'static> Drop for Behind<B, T> {
    fn drop(&mut self) {
        // After an error elsewhere, which is the one to be told: the thread lets go of its files before the process ends.
        if let Some(Stage::There(helper)) = self.stage.take() {
            let _ = helper.end();
        }
    }
}

impl<B: Send + 'static, T: Send + 'static> Helper<B, T> {
    fn start(mut target: T, mut work: Work<B, T>, most: usize) -> Helper<B, T> {
        let (batches, waiting) = sync_channel(most);
        let (used, spent) = channel();
        let all = move || {
            let done = in_order(&mut target, &mut work, most, &waiting, &used);
            (target, done)
        };
        Helper {
            batches,
            spent,
            thread: std::thread::spawn(all),
        }
    }

    /// Waits until all is done; what became of it.
    fn end(self) -> (T, Result<()>) {
        drop(self.batches);
        match self.thread.join() {
            Ok(done) => done,
            Err(panic) => std::panic::resume_unwind(panic),
        }
    }
}

fn in_order<B, T>(
    target: &mut T,
    work: &mut Work<B, T>,
    most: usize,
    waiting: &Receiver<B>,
    used: &Sender<B>,
) -> Result<()> {
    while let Ok(first) = waiting.recv() {
        let more = waiting.try_iter().take(most.saturating_sub(1));
        let batches: Vec<B> = std::iter::once(first).chain(more).collect();
        work(target, &batches)?;
        for batch in batches {
            // Nobody wants it any more at the end.
            let _ = used.send(batch);
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Error;

    #[test]
    fn batches_are_dealt_with_in_order_and_none_is_lost() {
        for count in [0, 1, 2, 100] {
            let work = |all: &mut Vec<u32>, batches: &[Vec<u32>]| {
                assert!(batches.len() <= 3);
                all.extend(batches.iter().flatten());
                Ok(())
            };
            let mut behind = Behind::new(Vec::new(), 3, work);
            for i in 0..count {
                let mut next = behind.give(vec![i, i]).unwrap();
                next.clear();
            }
            let all = behind.end(vec![count, count]).unwrap().unwrap();
            let want: Vec<u32> = (0..=count).flat_map(|i| [i, i]).collect();
            assert_eq!(all, want);
            assert_eq!(behind.end(Vec::new()).unwrap(), None);
        }
    }

    #[test]
    fn an_error_is_told_once_and_ends_the_work() {
        let work = |met: &mut u32, batches: &[Vec<u32>]| {
            *met += batches.len() as u32;
            Err(Error::usage("broken"))
        };
        let mut behind = Behind::new(0, 2, work);
        let told = (0..100)
            .map(|_| behind.give(vec![1]))
            .filter(|r| r.is_err());
        assert_eq!(told.count(), 1);
        assert!(behind.end(Vec::new()).unwrap().is_none());
        let mut at_once = Behind::new(0, 2, work);
        assert!(at_once.end(vec![1]).is_err());
    }
}
