//! Answers HTTP requests, on a thread of its own.
//!
//! The thread never blocks on a client: all connections are non-blocking, each has a time limit,
//! and the oldest one is closed if there are too many. So clients that send nothing, send slowly or
//! do not read cost one of a fixed number of connections for a limited time, and nothing else.

use linkwatch::Result;
use mio::net::{TcpListener, TcpStream};
use mio::{Events, Interest, Poll, Token, Waker};
use std::collections::VecDeque;
use std::io::{self, ErrorKind, Read, Write};
use std::net::Shutdown;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Path of the metrics.
pub const PATH: &str = "/metrics";

/// Maximum number of open connections.
const CONNECTIONS: usize = 64;

/// Maximum number of connections accepted before the open ones are served.
const BATCH: usize = 16;

/// Time limit of a connection, from the first to the last byte: that of a scrape by Prometheus.
pub const LIMIT: Duration = Duration::from_secs(10);

/// Time until the next attempt if no connection can be accepted, for lack of file descriptors for
/// example.
const RETRY: Duration = Duration::from_millis(100);

/// Maximum size of a request, in bytes.
const REQUEST: usize = 8 << 10;

/// Maximum number of bytes read from a connection. What exceeds a request is discarded, because a
/// connection that is closed with unread bytes may lose its answer.
const RECEIVED: usize = 1 << 20;

/// Stops the thread when it is dropped.
pub struct Server {
    stop: Arc<(AtomicBool, Waker)>,
    thread: Option<JoinHandle<()>>,
}

impl Server {
    /// Starts the thread. It calls `page` for each request for [`PATH`], and closes connections
    /// after `limit`.
    pub fn start(
        listener: std::net::TcpListener,
        limit: Duration,
        page: impl Fn() -> String + Send + 'static,
    ) -> Result<Server> {
        listener.set_nonblocking(true)?;
        let mut listener = TcpListener::from_std(listener);
        let poll = Poll::new()?;
        let all = Interest::READABLE | Interest::WRITABLE;
        poll.registry().register(&mut listener, Token(0), all)?;
        let waker = Waker::new(poll.registry(), Token(0))?;
        let stop = Arc::new((AtomicBool::new(false), waker));
        let stopped = Arc::clone(&stop);
        let serve = move || {
            if let Err(e) = serve(&listener, poll, limit, &page, &stopped.0) {
                tracing::error!("metrics are not served any more: {e}");
            }
        };
        let thread = std::thread::Builder::new().name("linkwatch-http".into());
        let thread = Some(thread.spawn(serve)?);
        Ok(Server { stop, thread })
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.stop.0.store(true, Ordering::Relaxed);
        // Without the signal, the process ends without waiting for the thread.
        if self.stop.1.wake().is_ok() {
            // If the thread panicked, the panic was printed.
            self.thread.take().map(JoinHandle::join);
        }
    }
}

/// Serves connections until `stop` is set.
fn serve(
    listener: &TcpListener,
    mut poll: Poll,
    limit: Duration,
    page: &impl Fn() -> String,
    stop: &AtomicBool,
) -> io::Result<()> {
    let mut events = Events::with_capacity(CONNECTIONS);
    // Oldest first.
    let mut connections = VecDeque::new();
    while !stop.load(Ordering::Relaxed) {
        let mut wait = accept(listener, &poll, &mut connections);
        connections.retain_mut(
            |connection: &mut Connection| match connection.advance(page) {
                Ok(Step::Waits) => connection.opened.elapsed() < limit,
                Ok(Step::Advanced) => {
                    wait = Some(Duration::ZERO);
                    connection.opened.elapsed() < limit
                }
                Ok(Step::Ended) | Err(_) => false,
            },
        );
        // An event is reported only once, but here every connection and the listener are blocked.
        let oldest = connections.front();
        let left = oldest.map(|oldest| limit.saturating_sub(oldest.opened.elapsed()));
        match poll.poll(&mut events, wait.into_iter().chain(left).min()) {
            Err(e) if e.kind() != ErrorKind::Interrupted => return Err(e),
            _ => {}
        }
    }
    Ok(())
}

/// Accepts connections. Returns the time after which there may be more of them without an event.
fn accept(
    listener: &TcpListener,
    poll: &Poll,
    connections: &mut VecDeque<Connection>,
) -> Option<Duration> {
    for _ in 0..BATCH {
        let accepted = listener.accept().and_then(|(mut stream, _)| {
            let all = Interest::READABLE | Interest::WRITABLE;
            poll.registry().register(&mut stream, Token(0), all)?;
            Ok(stream)
        });
        match accepted {
            Ok(stream) => {
                if connections.len() == CONNECTIONS {
                    connections.pop_front();
                }
                connections.push_back(Connection {
                    stream,
                    opened: Instant::now(),
                    received: 0,
                    request: Vec::new(),
                    answer: None,
                });
            }
            Err(e) if e.kind() == ErrorKind::WouldBlock => return None,
            Err(_) => return Some(RETRY),
        }
    }
    Some(Duration::ZERO)
}

struct Connection {
    stream: TcpStream,
    opened: Instant,
    /// Number of bytes received.
    received: usize,
    /// The request so far.
    request: Vec<u8>,
    /// Set once the request is complete.
    answer: Option<Answer>,
}

struct Answer {
    bytes: Vec<u8>,
    /// Number of bytes sent.
    sent: usize,
}

enum Step {
    Waits,
    Advanced,
    Ended,
}

impl Connection {
    /// Reads or writes once, without blocking.
    fn advance(&mut self, page: &impl Fn() -> String) -> io::Result<Step> {
        let step = match &mut self.answer {
            Some(Answer { bytes, sent }) if *sent < bytes.len() => {
                self.stream.write(&bytes[*sent..]).and_then(|n| {
                    *sent += n;
                    if *sent == bytes.len() {
                        self.stream.shutdown(Shutdown::Write)?;
                    }
                    Ok(Step::Advanced)
                })
            }
            _ => self.read(page),
        };
        match step {
            Err(e) if e.kind() == ErrorKind::WouldBlock => Ok(Step::Waits),
            Err(e) if e.kind() == ErrorKind::Interrupted => Ok(Step::Advanced),
            step => step,
        }
    }

    fn read(&mut self, page: &impl Fn() -> String) -> io::Result<Step> {
        let mut bytes = [0; 4 << 10];
        let n = self.stream.read(&mut bytes)?;
        self.received += n;
        if n == 0 || self.received > RECEIVED {
            return Ok(Step::Ended);
        }
        if self.answer.is_none() {
            self.request.extend_from_slice(&bytes[..n]);
            let answer = answer(&self.request, page);
            self.answer = answer.map(|bytes| Answer { bytes, sent: 0 });
        }
        Ok(Step::Advanced)
    }
}

/// Returns the answer to a request, or `None` if the request is not complete.
fn answer(request: &[u8], page: &impl Fn() -> String) -> Option<Vec<u8>> {
    let mut headers = [httparse::EMPTY_HEADER; 64];
    let mut parsed = httparse::Request::new(&mut headers);
    let complete = parsed.parse(request);
    let (method, path) = (parsed.method, parsed.path.unwrap_or_default());
    let path = path.split_once('?').map_or(path, |(path, _)| path);
    let text = "Content-Type: text/plain; charset=utf-8";
    let (status, header, body) = match complete {
        Ok(httparse::Status::Partial) if request.len() <= REQUEST => return None,
        Ok(httparse::Status::Partial) | Err(httparse::Error::TooManyHeaders) => {
            let why = "the request is too large\n".to_owned();
            ("431 Request Header Fields Too Large", text, why)
        }
        Err(e) => (
            "400 Bad Request",
            text,
            format!("not an HTTP request: {e}\n"),
        ),
        Ok(_) if path != PATH => {
            let why = format!("the metrics of linkwatch are at {PATH}\n");
            ("404 Not Found", text, why)
        }
        Ok(_) if !matches!(method, Some("GET" | "HEAD")) => {
            let allowed = "Content-Type: text/plain; charset=utf-8\r\nAllow: GET, HEAD";
            (
                "405 Method Not Allowed",
                allowed,
                "only GET and HEAD are supported\n".into(),
            )
        }
        Ok(_) => (
            "200 OK",
            "Content-Type: text/plain; version=0.0.4; charset=utf-8",
            page(),
        ),
    };
    let length = body.len();
    let mut answer = format!(
        "HTTP/1.1 {status}\r\n{header}\r\nContent-Length: {length}\r\nConnection: close\r\n\r\n"
    );
    if method != Some("HEAD") {
        answer += &body;
    }
    Some(answer.into_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::{SocketAddr, TcpListener, TcpStream};

    const PATIENCE: Duration = Duration::from_secs(30);

    /// Size of a page that is larger than the buffers of the system.
    const PAGE: usize = 64 << 20;

    fn start(limit: Duration) -> (Server, SocketAddr) {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let page = || "x".repeat(PAGE);
        (Server::start(listener, limit, page).unwrap(), address)
    }

    fn connect(address: SocketAddr) -> TcpStream {
        let stream = TcpStream::connect(address).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        stream
    }

    /// Reads until the connection is closed. Panics if it stays open.
    fn read(mut stream: TcpStream) -> usize {
        let mut bytes = Vec::new();
        match stream.read_to_end(&mut bytes) {
            Err(e) if e.kind() != ErrorKind::ConnectionReset => panic!("{e}"),
            _ => bytes.len(),
        }
    }

    #[test]
    fn a_page_larger_than_the_buffers_of_the_system_arrives_in_full() {
        let (_server, address) = start(PATIENCE);
        let mut stream = connect(address);
        stream.write_all(b"GET /metrics HTTP/1.1\r\n\r\n").unwrap();
        stream.shutdown(Shutdown::Write).unwrap();
        assert!(read(stream) > PAGE);
    }

    #[test]
    fn a_connection_ends_at_its_time_limit_whatever_the_client_does() {
        let (_server, address) = start(Duration::from_millis(200));
        let mut reads_nothing = connect(address);
        reads_nothing
            .write_all(b"GET /metrics HTTP/1.1\r\n\r\n")
            .unwrap();
        let silent = connect(address);
        let mut slow = connect(address);
        let start = Instant::now();
        while slow.write_all(b"G").is_ok() {
            assert!(
                start.elapsed() < PATIENCE,
                "a slow client is served without limit"
            );
            std::thread::sleep(Duration::from_millis(5));
        }
        assert_eq!(read(silent), 0);
        assert!(read(reads_nothing) < PAGE);
    }

    #[test]
    fn the_thread_ends_when_the_server_is_dropped() {
        let (server, address) = start(PATIENCE);
        let silent = connect(address);
        drop(server);
        assert_eq!(read(silent), 0);
        TcpListener::bind(address).expect("the port is free again");
    }
}
