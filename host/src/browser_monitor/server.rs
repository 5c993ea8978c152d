//! Serves the page of the browser view over HTTP, and sends the latest rows of values to each of up
//! to 16 browsers over a WebSocket; a new one gets the last minute. Requests of other sites are
//! refused.

use std::collections::VecDeque;
use std::io::{self, Read, Write};
use std::net::{IpAddr, SocketAddr, TcpListener, TcpStream};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use loadtwin_report::{UPLOT_CSS, UPLOT_JS};
use tungstenite::protocol::Message;

/// Rows that a browser gets when it connects: a minute.
const ROWS: usize = 600;

/// Browsers at once; one that is gone is noticed at the next row.
const CONNECTIONS: usize = 16;

/// Longest head of a request (bytes).
const REQUEST: usize = 8 << 10;

/// Time that a browser has for its request, and to take a row.
const PATIENCE: Duration = Duration::from_secs(5);

/// Nothing is loaded from elsewhere.
const POLICY: &str = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; \
     img-src data:; connect-src 'self'";

/// Rows on their way to browsers.
#[derive(Debug)]
pub(super) struct Channel {
    state: Mutex<State>,
    news: Condvar,
    start: Instant,
}

#[derive(Debug, Default)]
struct State {
    head: String,
    heads: u64,
    rows: VecDeque<String>,
    /// Rows that came before `rows`.
    before: u64,
    connections: usize,
}

impl Default for Channel {
    fn default() -> Self {
        Self {
            state: Mutex::default(),
            news: Condvar::new(),
            start: Instant::now(),
        }
    }
}

impl Channel {
    /// The state holds whole rows at any time, also after a panic elsewhere.
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn elapsed_s(&self) -> f64 {
        self.start.elapsed().as_secs_f64()
    }

    pub(super) fn set_head(&self, head: &str) {
        let mut state = self.state();
        head.clone_into(&mut state.head);
        state.heads += 1;
    }

    pub(super) fn push(&self, row: String) {
        let mut state = self.state();
        state.rows.push_back(row);
        if state.rows.len() > ROWS {
            state.rows.pop_front();
            state.before += 1;
        }
        self.news.notify_all();
    }

    /// What a browser does not have yet; waits for it. `seen`: heads and rows that it has.
    fn next(&self, seen: &mut (u64, u64)) -> Vec<String> {
        let state = self.state();
        let has_news = |state: &mut State| state.before + state.rows.len() as u64 > seen.1;
        let (state, _) = self
            .news
            .wait_timeout_while(state, PATIENCE, |state| !has_news(state))
            .unwrap_or_else(PoisonError::into_inner);
        let mut news = Vec::new();
        if state.heads > seen.0 {
            news.push(state.head.clone());
            seen.0 = state.heads;
        }
        // One that is behind goes on with the oldest row that is there.
        let skipped = seen.1.saturating_sub(state.before) as usize;
        news.extend(state.rows.iter().skip(skipped).cloned());
        seen.1 = state.before + state.rows.len() as u64;
        news
    }
}

/// Listens at `address` on a thread of its own; returns the address with its port.
pub(super) fn listen(address: SocketAddr, channel: &Arc<Channel>) -> io::Result<SocketAddr> {
    let listener = TcpListener::bind(address)?;
    let address = listener.local_addr()?;
    let channel = Arc::clone(channel);
    thread::Builder::new().name("web".into()).spawn(move || {
        for stream in listener.incoming().flatten() {
            let mut state = channel.state();
            if state.connections >= CONNECTIONS {
                continue;
            }
            state.connections += 1;
            drop(state);
            let shared = Arc::clone(&channel);
            thread::spawn(move || {
                // A browser that goes away is no error of the bus.
                let _ = serve(stream, &shared);
                shared.state().connections -= 1;
            });
        }
    })?;
    Ok(address)
}

fn serve(stream: TcpStream, channel: &Channel) -> io::Result<()> {
    stream.set_read_timeout(Some(PATIENCE))?;
    stream.set_write_timeout(Some(PATIENCE))?;
    let head = request(&stream)?;
    match answer_to(&head) {
        Answer::Page => respond(stream, "200 OK", "text/html; charset=utf-8", &page()),
        Answer::Refused => respond(stream, "403 Forbidden", "text/plain", "another site\n"),
        Answer::Nothing => respond(stream, "404 Not Found", "text/plain", "not found\n"),
        Answer::Socket => {
            let failed = |error: String| io::Error::other(error);
            let mut socket = tungstenite::accept(stream).map_err(|e| failed(e.to_string()))?;
            let mut seen = (0, 0);
            loop {
                let news = channel.next(&mut seen);
                let sent = if news.is_empty() {
                    socket.send(Message::Ping(Vec::new().into()))
                } else {
                    news.into_iter()
                        .try_for_each(|row| socket.send(Message::text(row)))
                };
                sent.map_err(|error| failed(error.to_string()))?;
            }
        }
    }
}

/// The head of the request, left in the stream for who answers it.
fn request(stream: &TcpStream) -> io::Result<String> {
    let deadline = Instant::now() + PATIENCE;
    let mut head = vec![0; REQUEST];
    while Instant::now() < deadline {
        let count = stream.peek(&mut head)?;
        let found = head.get(..count).unwrap_or_default();
        if count == 0 || count == REQUEST {
            break;
        }
        if memchr::memmem::find(found, b"\r\n\r\n").is_some() {
            return Ok(String::from_utf8_lossy(found).into_owned());
        }
        thread::sleep(Duration::from_millis(5));
    }
    Err(io::ErrorKind::InvalidData.into())
}

#[derive(Debug, PartialEq, Eq)]
enum Answer {
    Page,
    Socket,
    /// The page of another site asks.
    Refused,
    Nothing,
}

fn answer_to(head: &str) -> Answer {
    let field = |name: &str| {
        let lines = head.lines().filter_map(|line| line.split_once(':'));
        let mut found = lines.filter(|(key, _)| key.trim().eq_ignore_ascii_case(name));
        found.next().map(|(_, value)| value.trim())
    };
    let host = field("host").unwrap_or_default();
    let is_origin = field("origin").is_none_or(|origin| origin == format!("http://{host}"));
    // A name that another site resolves to this machine is no address of it.
    if !is_origin || !is_address(host) {
        return Answer::Refused;
    }
    let path = head.split_whitespace().nth(1).unwrap_or_default();
    match (head.starts_with("GET "), path) {
        (true, "/socket") => Answer::Socket,
        (true, "/") => Answer::Page,
        _ => Answer::Nothing,
    }
}

/// Whether a host is an address or this machine's own name for itself.
fn is_address(host: &str) -> bool {
    let name = match host.rsplit_once(':') {
        Some((name, port)) if port.bytes().all(|b| b.is_ascii_digit()) => name,
        _ => host,
    };
    let name = name.trim_start_matches('[').trim_end_matches(']');
    name.eq_ignore_ascii_case("localhost") || name.parse::<IpAddr>().is_ok()
}

fn respond(mut stream: TcpStream, status: &str, kind: &str, body: &str) -> io::Result<()> {
    write!(
        stream,
        "HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {}\r\nCache-Control: no-store\r\n\
         Content-Security-Policy: {POLICY}\r\nX-Content-Type-Options: nosniff\r\nConnection: close\r\n\r\n{body}",
        body.len()
    )?;
    stream.flush()?;
    stream.shutdown(std::net::Shutdown::Write)?;
    // The request was left in the stream; closed with bytes in it, the answer may be lost.
    io::copy(&mut stream.take(REQUEST as u64), &mut io::sink())?;
    Ok(())
}

fn page() -> String {
    include_str!("page.html")
        .replace("/*UPLOT.CSS*/", UPLOT_CSS)
        .replace("/*PAGE.CSS*/", include_str!("page.css"))
        .replace("/*UPLOT.JS*/", UPLOT_JS)
        .replace("/*PAGE.JS*/", include_str!("page.js"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_own_page_is_answered() {
        let ask = |path: &str, host: &str, origin: &str| {
            let origin = if origin.is_empty() {
                String::new()
            } else {
                format!("Origin: {origin}\r\n")
            };
            answer_to(&format!(
                "GET {path} HTTP/1.1\r\nHost: {host}\r\n{origin}\r\n"
            ))
        };
        assert_eq!(ask("/", "127.0.0.1:8080", ""), Answer::Page);
        assert_eq!(ask("/", "[::1]:8080", ""), Answer::Page);
        assert_eq!(
            ask("/socket", "localhost:8080", "http://localhost:8080"),
            Answer::Socket
        );
        assert_eq!(
            ask("/socket", "127.0.0.1:8080", "http://elsewhere.example"),
            Answer::Refused
        );
        assert_eq!(ask("/", "elsewhere.example:8080", ""), Answer::Refused);
        assert_eq!(ask("/other", "127.0.0.1", ""), Answer::Nothing);
        assert_eq!(
            answer_to("POST / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"),
            Answer::Nothing
        );
    }

    #[test]
    fn one_that_is_behind_gets_the_last_minute() {
        let channel = Channel::default();
        channel.set_head("head");
        for row in 0..3 * ROWS {
            channel.push(row.to_string());
        }
        let mut seen = (0, 0);
        let news = channel.next(&mut seen);
        assert_eq!(news.len(), 1 + ROWS);
        assert_eq!((news[0].as_str(), news[1].as_str()), ("head", "1200"));
        channel.push("new".into());
        assert_eq!(channel.next(&mut seen), ["new"]);
    }
}
