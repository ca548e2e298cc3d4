//! The thread that handles requests, one after the other, and the queue before it.

use crate::{Error, Result};
use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError, mpsc};
use std::thread::{self, JoinHandle};
use tokio::sync::oneshot;

/// What handles requests. It need not be `Send`: one thread builds it, calls it and drops it.
pub trait Handler {
    /// Handles a request; a refused one changes nothing.
    fn handle(&mut self, request: &Request) -> std::result::Result<Reply, Refusal>;

    /// Ends the work after the last request, such as by saving it.
    fn finish(self) -> Result<()>
    where
        Self: Sized,
    {
        Ok(())
    }
}

/// What a request is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Route {
    /// What is edited now; the only one that is a GET.
    State,
    /// Pose the figure by pins and drags.
    Solve,
    /// One of the actions.
    Act,
    /// Other poses with the same pins.
    Solutions,
    /// Pose the figure by marks in a photograph.
    Photograph,
    /// The frames between the keys.
    Between,
    /// The bytes of a file.
    Export,
    /// A saved session.
    Open,
}

impl Route {
    /// All routes, with their paths in the address.
    pub(crate) const ALL: [(Route, &'static str); 8] = [
        (Route::State, "/state"),
        (Route::Solve, "/solve"),
        (Route::Act, "/act"),
        (Route::Solutions, "/solutions"),
        (Route::Photograph, "/photograph"),
        (Route::Between, "/between"),
        (Route::Export, "/export"),
        (Route::Open, "/open"),
    ];
}

/// A request that has passed the guard.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Request {
    /// What it is about.
    pub route: Route,
    /// The body, meant to be JSON.
    pub body: Vec<u8>,
}

/// An answer, status 200.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Reply {
    /// Such as `application/json`.
    pub content_type: &'static str,
    /// The bytes.
    pub body: Vec<u8>,
}

impl Reply {
    /// An answer in JSON.
    pub(crate) fn json(body: Vec<u8>) -> Reply {
        Reply {
            content_type: "application/json",
            body,
        }
    }
}

/// A refused request: `{"error":"one sentence"}`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Refusal {
    /// The HTTP status, 400 or above.
    pub status: u16,
    /// Why, in one sentence.
    pub sentence: String,
}

impl Refusal {
    /// A refusal with a status and a sentence.
    pub(crate) fn new(status: u16, sentence: impl Into<String>) -> Refusal {
        Refusal {
            status,
            sentence: sentence.into(),
        }
    }
}

type Handled = std::result::Result<Reply, Refusal>;

/// A request that waits, and where its answer goes.
struct Job {
    request: Request,
    reply: oneshot::Sender<Handled>,
}

/// The requests that wait, in the order of their arrival.
#[derive(Default)]
pub(crate) struct Queue {
    waiting: Mutex<Waiting>,
    changed: Condvar,
}

#[derive(Default)]
struct Waiting {
    jobs: VecDeque<Job>,
    is_closed: bool,
}

impl Queue {
    /// Waits for the answer to a request.
    pub(crate) async fn send(&self, request: Request) -> Handled {
        let answer = self.push(request);
        let stopped = |_| Err(Refusal::new(503, "the program is ending"));
        answer.await.unwrap_or_else(stopped)
    }

    /// Adds a request. A solve replaces the one right before it: the page wants the newest pose
    /// only. One with another request behind it stays, because that request, such as the end of
    /// a gesture, may build on it.
    fn push(&self, request: Request) -> oneshot::Receiver<Handled> {
        let (reply, answer) = oneshot::channel();
        let mut waiting = self.lock();
        let is_solve = request.route == Route::Solve;
        let replaced = is_solve
            && (waiting.jobs.back()).is_some_and(|last| last.request.route == Route::Solve);
        if replaced && let Some(old) = waiting.jobs.pop_back() {
            let refusal = Refusal::new(409, "a newer request has replaced this one");
            // Its client may have gone.
            let _ = old.reply.send(Err(refusal));
        }
        if !waiting.is_closed {
            waiting.jobs.push_back(Job { request, reply });
            self.changed.notify_one();
        }
        answer
    }

    /// The next request, as soon as there is one; `None` when the queue is closed and empty.
    fn next(&self) -> Option<Job> {
        let mut waiting = self.lock();
        loop {
            if let Some(job) = waiting.jobs.pop_front() {
                return Some(job);
            }
            if waiting.is_closed {
                return None;
            }
            let changed = self.changed.wait(waiting);
            waiting = changed.unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Takes no more requests; those that wait are still handled.
    pub(crate) fn close(&self) {
        self.lock().is_closed = true;
        self.changed.notify_one();
    }

    fn lock(&self) -> MutexGuard<'_, Waiting> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The thread of a handler that is ready.
pub(crate) struct HandlerThread {
    thread: JoinHandle<Result<()>>,
    /// Resolves when the thread has nothing more to do.
    ended: oneshot::Receiver<()>,
}

/// The stack of the thread: that of a main thread.
const STACK: usize = 8 << 20;

impl HandlerThread {
    /// Starts the thread and waits until `make` has built the handler there.
    pub(crate) fn start<A: Handler>(
        queue: Arc<Queue>,
        make: impl FnOnce() -> Result<A> + Send + 'static,
    ) -> Result<HandlerThread> {
        let (ready, built) = mpsc::channel();
        let (end, ended) = oneshot::channel();
        let work = move || {
            // Dropped at the end, also by a panic.
            let _end = end;
            let mut handler = make()?;
            // Nobody listens only if the starting thread has gone.
            let _ = ready.send(());
            drop(ready);
            while let Some(Job { request, reply }) = queue.next() {
                let _ = reply.send(handle(&mut handler, &request));
            }
            handler.finish()
        };
        let builder = thread::Builder::new().name("session".into());
        let thread = builder.stack_size(STACK).spawn(work);
        let thread = thread.map_err(|e| Error::io("thread", e))?;
        let started = HandlerThread { thread, ended };
        match built.recv() {
            Ok(()) => Ok(started),
            // The sender went before it was used: `make` has failed.
            Err(_) => Err(started.join().expect_err("it was not built")),
        }
    }

    /// Waits until the queue, which has to be closed, is empty and the handler has finished.
    pub(crate) async fn ended(mut self) -> Result<()> {
        // The other end is dropped, never used.
        let _ = (&mut self.ended).await;
        self.join()
    }

    fn join(self) -> Result<()> {
        self.thread.join().unwrap_or_else(|e| resume_unwind(e))
    }
}

/// The answer to one request. A panic is a bug, but no reason to lose the whole session.
fn handle(handler: &mut impl Handler, request: &Request) -> Handled {
    let answered = catch_unwind(AssertUnwindSafe(|| handler.handle(request)));
    let failed = "the program failed at this request, which is a bug: save your work and restart";
    answered.unwrap_or_else(|_| Err(Refusal::new(500, failed)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::rc::Rc;

    fn request(route: Route, body: &str) -> Request {
        Request {
            route,
            body: body.into(),
        }
    }

    /// Replies with all bodies so far; panics at "panic". An `Rc` shows that it need not be `Send`.
    struct Echo {
        seen: Rc<Vec<u8>>,
        finished: mpsc::Sender<Vec<u8>>,
    }

    impl Handler for Echo {
        fn handle(&mut self, request: &Request) -> Handled {
            assert_ne!(request.body, b"panic");
            Rc::make_mut(&mut self.seen).extend(&request.body);
            Ok(Reply::json(self.seen.to_vec()))
        }
        fn finish(self) -> Result<()> {
            let _ = self.finished.send(self.seen.to_vec());
            Err(Error::usage("finished"))
        }
    }

    /// The answers to requests that all wait before the thread starts, and what the handler had
    /// seen at its end.
    fn replies(requests: &[Request]) -> (Vec<Handled>, Vec<u8>) {
        let queue = Arc::new(Queue::default());
        let replies: Vec<_> = requests.iter().map(|r| queue.push(r.clone())).collect();
        let (finished, seen) = mpsc::channel();
        let make = move || {
            let seen = Rc::default();
            Ok(Echo { seen, finished })
        };
        let started = HandlerThread::start(Arc::clone(&queue), make).unwrap();
        queue.close();
        assert_eq!(started.join().unwrap_err().to_string(), "finished");
        let replies = replies.into_iter().map(|a| a.blocking_recv().unwrap());
        (replies.collect(), seen.recv().unwrap())
    }

    fn json(body: &str) -> Handled {
        Ok(Reply::json(body.into()))
    }

    #[test]
    fn of_solves_in_a_row_the_newest_is_handled_and_all_else_keeps_its_order() {
        use Route::{Act, Solve};
        let requests = [
            request(Solve, "a"),
            request(Solve, "b"),
            request(Act, "c"),
            request(Act, "d"),
            request(Solve, "e"),
            request(Solve, "f"),
            request(Solve, "g"),
        ];
        let (found, seen) = replies(&requests);
        let replaced = || Err(Refusal::new(409, "a newer request has replaced this one"));
        let expected = [
            replaced(),
            json("b"),
            json("bc"),
            json("bcd"),
            replaced(),
            replaced(),
            json("bcdg"),
        ];
        assert_eq!(found, expected);
        assert_eq!(seen, b"bcdg");
    }

    #[test]
    fn a_panic_is_a_500_and_the_next_request_is_handled() {
        let act = |body| request(Route::Act, body);
        let (found, _) = replies(&[act("a"), act("panic"), act("b")]);
        assert_eq!(found[0], json("a"));
        assert_eq!(found[1].as_ref().unwrap_err().status, 500);
        assert_eq!(found[2], json("ab"));
    }

    #[test]
    fn a_handler_that_cannot_be_built_says_why() {
        let make = || Err::<Echo, _>(Error::usage("no model"));
        let started = HandlerThread::start(Arc::default(), make);
        assert_eq!(started.err().unwrap().to_string(), "no model");
    }

    #[test]
    fn a_closed_queue_takes_nothing() {
        let queue = Queue::default();
        queue.close();
        let reply = queue.push(request(Route::State, ""));
        assert!(reply.blocking_recv().is_err());
        assert!(queue.next().is_none());
    }
}
