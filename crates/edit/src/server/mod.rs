//! The local HTTP server of `edit`: a page, and its requests, which one thread handles in turn.
//!
//! It listens on 127.0.0.1 only. Every request passes the guard. HTTP runs on the calling thread
//! and never computes, so that a slow client or a long computation does not keep others waiting for
//! a connection.

pub mod editor;
pub mod figure;
mod guard;
pub(crate) mod handler;
mod impatient;
pub mod page;
mod session_file;

pub use handler::{Handler, Refusal, Reply, Request, Route};

use crate::edit::LARGEST_SESSION;
use crate::{Error, Place, Result};
use axum::Router;
use axum::body::{Body, HttpBody, to_bytes};
use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::middleware::{Next, from_fn_with_state};
use axum::response::{Html, IntoResponse, Response};
use axum::routing::{get, post};
use guard::Guard;
use handler::{HandlerThread, Queue};
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::server::graceful::GracefulShutdown;
use hyper_util::service::TowerToHyperService;
use impatient::Impatient;
use std::io;
use std::net::Ipv4Addr;
use std::sync::Arc;
use std::time::Duration;
use tokio::net::TcpListener;
use tokio::sync::{Semaphore, oneshot};
use tokio::time::{sleep, timeout};

/// The largest body of a request, bytes; [`Route::Open`] has that of a session.
const LARGEST_BODY: usize = 1 << 20;
/// Bodies that are larger by up to this are read to their end: a connection closed before would
/// hide the refusal.
const LARGEST_EXCESS: usize = 7 << 20;
/// How long the headers, and then the body, of a request may take to arrive, and an answer may
/// stand still. A connection without requests ends too.
const PATIENCE: Duration = Duration::from_secs(10);
/// How long the body of a session may take to arrive.
const PATIENCE_WITH_SESSION: Duration = Duration::from_secs(120);
/// How long the last responses may take to leave.
const FAREWELL: Duration = Duration::from_secs(1);
/// The most connections at a time; more wait.
const CONNECTIONS: usize = 64;

/// The page that `GET /` shows.
#[derive(Debug, Clone)]
pub struct Page {
    /// The document.
    pub html: String,
    /// Its Content-Security-Policy, which begins with `default-src 'none'`.
    pub policy: String,
}

/// What the handlers share.
struct Shared {
    html: String,
    guard: Guard,
    queue: Arc<Queue>,
}

/// A server that runs until this is dropped.
pub struct Running(#[allow(dead_code)] oneshot::Sender<()>);

/// Serves a page. `make` builds what handles its requests, on the thread where that stays;
/// `on_ready` gets the address, token included, once requests are handled.
///
/// # Errors
/// The port is taken, or `make`, `on_ready` or `Handler::finish` fails.
pub fn serve<A: Handler>(
    port: u16,
    page: Page,
    make: impl FnOnce() -> Result<A> + Send + 'static,
    on_ready: impl FnOnce(&str, Running) -> Result<()>,
) -> Result<()> {
    let mut runtime = tokio::runtime::Builder::new_current_thread();
    let runtime = runtime.enable_all().build().map_err(failed)?;
    let _context = runtime.enter();
    let listener = bind(port)?;
    let port = listener.local_addr().map_err(failed)?.port();
    let queue = Arc::new(Queue::default());
    let shared = Arc::new(Shared {
        html: page.html,
        guard: Guard::new(port, &page.policy)?,
        queue: Arc::clone(&queue),
    });
    let thread = HandlerThread::start(Arc::clone(&queue), make)?;
    let (stop, stopped) = oneshot::channel::<()>();
    runtime.block_on(async {
        let ready = on_ready(&shared.guard.address(), Running(stop));
        let connections = Arc::new(GracefulShutdown::new());
        let accepting = accept(listener, router(&shared), Arc::clone(&connections));
        let accepting = tokio::spawn(accepting);
        if ready.is_ok() {
            // The other end is dropped, never used.
            let _ = stopped.await;
        }
        accepting.abort();
        let _ = accepting.await;
        queue.close();
        let finished = thread.ended().await;
        // A client that does not read its answer is left.
        if let Some(connections) = Arc::into_inner(connections) {
            let _ = timeout(FAREWELL, connections.shutdown()).await;
        }
        ready.and(finished)
    })
}

fn failed(error: io::Error) -> Error {
    Error::io("the local server", error)
}

/// Listens on a port of this machine alone; 0: any that is free. Within a runtime only.
fn bind(port: u16) -> Result<TcpListener> {
    let address = (Ipv4Addr::LOCALHOST, port);
    let listener = std::net::TcpListener::bind(address).map_err(|e| match e.kind() {
        io::ErrorKind::AddrInUse => {
            let what = "is in use by another program; give another with the option `port`, or \
                        leave it out";
            Error::data(Place::file(format!("port {port}")), what)
        }
        _ => Error::io(format!("port {port}"), e),
    })?;
    listener.set_nonblocking(true).map_err(failed)?;
    TcpListener::from_std(listener).map_err(failed)
}

/// Serves each connection in a task of its own.
async fn accept(listener: TcpListener, router: Router, connections: Arc<GracefulShutdown>) {
    let free = Arc::new(Semaphore::new(CONNECTIONS));
    // The semaphore is never closed.
    while let Ok(permit) = Arc::clone(&free).acquire_owned().await {
        let Ok((stream, _)) = listener.accept().await else {
            // Such as too many open files: others may be closed in a while.
            sleep(Duration::from_millis(100)).await;
            continue;
        };
        // Costs nothing but a delay.
        let _ = stream.set_nodelay(true);
        let mut http = http1::Builder::new();
        http.timer(TokioTimer::new()).header_read_timeout(PATIENCE);
        let service = TowerToHyperService::new(router.clone());
        let connection = http.serve_connection(Impatient::new(TokioIo::new(stream)), service);
        let connection = connections.watch(connection);
        tokio::spawn(async move {
            // A connection that breaks is the client's affair.
            let _ = connection.await;
            drop(permit);
        });
    }
}

fn router(shared: &Arc<Shared>) -> Router {
    let mut router = Router::new().route("/", get(page));
    for (route, path) in Route::ALL {
        let send = move |State(shared): State<Arc<Shared>>, body: Body| async move {
            send(&shared, route, body).await
        };
        let handler = match route {
            Route::State => get(send),
            _ => post(send),
        };
        router = router.route(path, handler);
    }
    router
        .fallback(async || Refusal::new(404, "there is nothing at this path"))
        .method_not_allowed_fallback(async || Refusal::new(405, "this path has another method"))
        .layer(from_fn_with_state(Arc::clone(shared), guarded))
        .with_state(Arc::clone(shared))
}

/// Lets a request through the guard, or not, and marks the response.
async fn guarded(
    State(shared): State<Arc<Shared>>,
    request: axum::extract::Request,
    next: Next,
) -> Response {
    let checked = shared
        .guard
        .check(request.method(), request.uri(), request.headers());
    let mut response = match checked {
        Ok(()) => next.run(request).await,
        Err(refusal) => {
            // A body that is not read would end the connection under the client's hands.
            let _ = timeout(PATIENCE, to_bytes(request.into_body(), LARGEST_BODY)).await;
            refusal.into_response()
        }
    };
    shared.guard.mark(response.headers_mut());
    response
}

async fn page(State(shared): State<Arc<Shared>>) -> Html<String> {
    Html(shared.html.clone())
}

async fn send(
    shared: &Shared,
    route: Route,
    body: Body,
) -> std::result::Result<impl IntoResponse + use<>, Refusal> {
    let (largest, patience) = match route {
        Route::Open => (LARGEST_SESSION, PATIENCE_WITH_SESSION),
        _ => (LARGEST_BODY, PATIENCE),
    };
    let large = || {
        let what = format!("a request to this path has at most {} MiB", largest >> 20);
        Refusal::new(413, what)
    };
    let late = |_| Refusal::new(408, "the request took too long to arrive");
    let read = largest + LARGEST_EXCESS;
    if body.size_hint().lower() > read as u64 {
        return Err(large());
    }
    let body = timeout(patience, to_bytes(body, read)).await;
    let body = body.map_err(late)?.ok();
    let body = body.filter(|b| b.len() <= largest).ok_or_else(large)?;
    let body = body.into();
    let reply = shared.queue.send(Request { route, body }).await?;
    Ok(([(header::CONTENT_TYPE, reply.content_type)], reply.body))
}

impl IntoResponse for Refusal {
    fn into_response(self) -> Response {
        let status = StatusCode::from_u16(self.status);
        let status = status.unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
        let text = serde_json::json!({ "error": self.sentence }).to_string();
        let kind = [(header::CONTENT_TYPE, "application/json")];
        (status, kind, text).into_response()
    }
}
