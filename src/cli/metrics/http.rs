//! Answers HTTP requests in separate threads.
//!
//! One thread accepts connections, and each connection has a thread. All connections have a time
//! limit, and the oldest one is closed if there are too many. So clients that send nothing, send
//! slowly or do not read cost one of a fixed number of connections for a limited time, and nothing
//! else.

use linkwatch::Result;
use std::collections::VecDeque;
use std::io::{self, BufRead, BufReader, Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Weak};
use std::thread::{Builder, JoinHandle};
use std::time::{Duration, Instant};

/// Path of the metrics.
pub const PATH: &str = "/metrics";

/// Maximum number of open connections.
const CONNECTIONS: usize = 64;

/// Time limit of a connection, from the first to the last byte: that of a scrape by Prometheus.
pub const LIMIT: Duration = Duration::from_secs(10);

/// Interval at which connections are accepted.
const RETRY: Duration = Duration::from_millis(20);

/// Maximum size of a request, in bytes, and maximum number of its lines.
const REQUEST: u64 = 8 << 10;
const LINES: usize = 64;

/// Maximum number of bytes read after a request. They are discarded, because a connection that is
/// closed with unread bytes may lose its answer.
const REST: u64 = 1 << 20;

/// Returns the page that is served.
pub type Page = dyn Fn() -> String + Send + Sync;

/// Stops the thread when it is dropped.
pub struct Server {
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Server {
    /// Starts the thread. It calls `page` for each request for [`PATH`], and closes connections
    /// after `limit`.
    pub fn start(listener: TcpListener, limit: Duration, page: Arc<Page>) -> Result<Server> {
        listener.set_nonblocking(true)?;
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = Arc::clone(&stop);
        let serve = move || accept(&listener, limit, &page, &stopped);
        let thread = Some(thread().spawn(serve)?);
        Ok(Server { stop, thread })
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        // If the thread panicked, the panic was printed.
        self.thread.take().map(JoinHandle::join);
    }
}

fn thread() -> Builder {
    Builder::new().name("linkwatch-http".into())
}

/// Accepts connections until `stop` is set.
fn accept(listener: &TcpListener, limit: Duration, page: &Arc<Page>, stop: &AtomicBool) {
    // Their ends, oldest first. The thread of a connection owns it.
    let mut open: VecDeque<(Instant, Weak<TcpStream>)> = VecDeque::new();
    let close = |(_, stream): (Instant, Weak<TcpStream>)| {
        if let Some(stream) = stream.upgrade() {
            // An error means that the client has closed the connection already.
            let _ = stream.shutdown(Shutdown::Both);
        }
    };
    while !stop.load(Ordering::Relaxed) {
        open.retain(|(_, stream)| stream.strong_count() > 0);
        let now = Instant::now();
        while let Some(late) = open.pop_front_if(|(end, _)| *end < now) {
            close(late);
        }
        let accepted = listener.accept().and_then(|(stream, _)| {
            stream.set_nonblocking(false)?;
            Ok(stream)
        });
        let Ok(stream) = accepted else {
            std::thread::sleep(RETRY);
            continue;
        };
        if open.len() == CONNECTIONS {
            open.drain(..1).for_each(close);
        }
        let stream = Arc::new(stream);
        open.push_back((now + limit, Arc::downgrade(&stream)));
        let page = Arc::clone(page);
        // An error ends the connection; without a thread there is no answer.
        let _ = thread().spawn(move || answer(&stream, &*page));
    }
    open.into_iter().for_each(close);
}

/// Reads a request, answers it, and waits until the client closes the connection.
fn answer(mut connection: &TcpStream, page: &Page) -> io::Result<()> {
    let mut request = BufReader::new(connection.take(REQUEST));
    let mut head = Vec::new();
    let ends = |head: &[u8]| head.ends_with(b"\n\r\n") || head.ends_with(b"\n\n");
    while !ends(&head) && request.read_until(b'\n', &mut head)? > 0 {}
    let is_large = head.iter().filter(|byte| **byte == b'\n').count() > LINES;
    if !ends(&head) && request.get_ref().limit() > 0 {
        // The client ended the request before its end.
        return Ok(());
    }
    let is_complete = ends(&head) && !is_large;
    let head = String::from_utf8_lossy(&head);
    let line = head.lines().next().unwrap_or_default();
    let words: Vec<&str> = line.split_ascii_whitespace().collect();
    let (status, body) = match words[..] {
        _ if !is_complete => (
            "431 Request Header Fields Too Large",
            "the request is too large\n".into(),
        ),
        [method, path, "HTTP/1.0" | "HTTP/1.1"] => match (method, path.split('?').next()) {
            ("GET" | "HEAD", Some(PATH)) => ("200 OK", page()),
            (_, Some(PATH)) => (
                "405 Method Not Allowed\r\nAllow: GET, HEAD",
                "only GET and HEAD are supported\n".into(),
            ),
            _ => ("404 Not Found", format!("the metrics are at {PATH}\n")),
        },
        _ => ("400 Bad Request", "not an HTTP request\n".into()),
    };
    // The version of the format of Prometheus.
    let version = match status {
        "200 OK" => "; version=0.0.4",
        _ => "",
    };
    let length = body.len();
    write!(
        connection,
        "HTTP/1.1 {status}\r\nContent-Type: text/plain{version}; charset=utf-8\r\n\
         Content-Length: {length}\r\nConnection: close\r\n\r\n"
    )?;
    if words.first() != Some(&"HEAD") {
        connection.write_all(body.as_bytes())?;
    }
    connection.shutdown(Shutdown::Write)?;
    io::copy(&mut connection.take(REST), &mut io::sink())?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::ErrorKind;
    use std::net::SocketAddr;

    const PATIENCE: Duration = Duration::from_secs(30);

    /// Size of a page that is larger than the buffers of the system.
    const PAGE: usize = 64 << 20;

    fn start(limit: Duration) -> (Server, SocketAddr) {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let page = Arc::new(|| "x".repeat(PAGE));
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
