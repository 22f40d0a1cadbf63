//! A server of files with ranges on loopback, which misbehaves on request.

use std::collections::HashMap;
use std::io::{BufRead, BufReader, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// What goes wrong.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Faults {
    /// `Range` is ignored.
    pub ignores_ranges: bool,
    /// Of so many answers one is an error 500, one is cut, one stalls, one is shorter than stated
    /// by its range; 0 for none.
    pub one_in: u64,
    /// The tag changes after so many answers.
    pub changes_after: Option<u64>,
    /// Wait before each answer.
    pub latency: Duration,
    /// Bytes a second of all answers together.
    pub bytes_a_second: Option<u64>,
    /// No tag is sent.
    pub has_no_tag: bool,
}

/// The server.
pub struct Server {
    address: String,
    shared: Arc<Shared>,
}

struct Shared {
    files: Mutex<HashMap<String, Arc<Vec<u8>>>>,
    faults: Mutex<Faults>,
    answers: AtomicU64,
    is_over: AtomicBool,
    /// When the line is free again.
    line: Mutex<std::time::Instant>,
}

impl Server {
    /// Starts a server of no files.
    pub fn start() -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = format!("http://{}", listener.local_addr().unwrap());
        let shared = Arc::new(Shared {
            files: Mutex::new(HashMap::new()),
            faults: Mutex::new(Faults::default()),
            answers: AtomicU64::new(0),
            is_over: AtomicBool::new(false),
            line: Mutex::new(std::time::Instant::now()),
        });
        let served = shared.clone();
        std::thread::spawn(move || {
            for stream in listener.incoming().flatten() {
                if served.is_over.load(Relaxed) {
                    return;
                }
                let shared = served.clone();
                std::thread::spawn(move || {
                    let _ = serve(&stream, &shared);
                });
            }
        });
        Self { address, shared }
    }

    /// Serves bytes under a name; their address.
    pub fn put(&self, name: &str, bytes: Vec<u8>) -> String {
        self.shared.files.lock().unwrap().insert(format!("/{name}"), Arc::new(bytes));
        self.at(name)
    }

    /// Address of a name.
    pub fn at(&self, name: &str) -> String {
        format!("{}/{name}", self.address)
    }

    /// Sets what goes wrong from now on.
    pub fn set(&self, faults: Faults) {
        self.shared.answers.store(0, Relaxed);
        *self.shared.faults.lock().unwrap() = faults;
    }

    /// Answers since the faults were set.
    pub fn answers(&self) -> u64 {
        self.shared.answers.load(Relaxed)
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.shared.is_over.store(true, Relaxed);
        let _ = TcpStream::connect(self.address.trim_start_matches("http://"));
    }
}

/// Answers the requests of a connection.
fn serve(stream: &TcpStream, shared: &Shared) -> std::io::Result<()> {
    stream.set_nodelay(true)?;
    let mut reader = BufReader::new(stream);
    loop {
        let mut line = String::new();
        if reader.read_line(&mut line)? == 0 {
            return Ok(());
        }
        let mut words = line.split_whitespace();
        let (method, path) =
            (words.next().unwrap_or(""), words.next().unwrap_or("").replace("%20", " "));
        let method = method.to_owned();
        let mut range = None;
        loop {
            let mut header = String::new();
            if reader.read_line(&mut header)? == 0 || header.trim().is_empty() {
                break;
            }
            if let Some(value) = header.to_ascii_lowercase().strip_prefix("range: bytes=") {
                let (from, to) = value.trim().split_once('-').unwrap_or(("", ""));
                range = from.parse::<u64>().ok().zip(to.parse::<u64>().ok());
            }
        }
        let number = shared.answers.fetch_add(1, Relaxed) + 1;
        let faults = *shared.faults.lock().unwrap();
        if !answer(stream, shared, faults, number, (&method, &path, range))? {
            return Ok(());
        }
    }
}

/// Sends an answer. Returns whether the connection goes on.
fn answer(
    mut stream: &TcpStream,
    shared: &Shared,
    faults: Faults,
    number: u64,
    (method, path, range): (&str, &str, Option<(u64, u64)>),
) -> std::io::Result<bool> {
    std::thread::sleep(faults.latency);
    let file = shared.files.lock().unwrap().get(path).cloned();
    let Some(file) = file else {
        stream.write_all(b"HTTP/1.1 404 Not Found\r\nContent-Length: 0\r\n\r\n")?;
        return Ok(true);
    };
    let goes_wrong = |remainder: u64| faults.one_in > 0 && number % faults.one_in == remainder;
    if goes_wrong(0) {
        stream.write_all(b"HTTP/1.1 500 Oops\r\nContent-Length: 0\r\n\r\n")?;
        return Ok(true);
    }
    if goes_wrong(1) {
        // Longer than the client waits.
        std::thread::sleep(Duration::from_millis(700));
        return Ok(false);
    }
    let has_changed = faults.changes_after.is_some_and(|after| number > after);
    let tag = if faults.has_no_tag {
        "Last-Modified: Mon, 30 Nov 2026 10:00:00 GMT\r\n".to_owned()
    } else {
        format!("ETag: \"version-{}\"\r\n", u8::from(has_changed))
    };
    let size = file.len() as u64;
    let (head, body) = match range.filter(|_| !faults.ignores_ranges) {
        Some((from, to)) if from < size => {
            let to = to.min(size - 1);
            let part = format!("Content-Range: bytes {from}-{to}/{size}\r\n");
            ("206 Partial Content", (part, &file[from as usize..=to as usize]))
        }
        Some(_) => {
            let head = format!(
                "HTTP/1.1 416 No\r\nContent-Range: bytes */{size}\r\nContent-Length: 0\r\n\r\n"
            );
            stream.write_all(head.as_bytes())?;
            return Ok(true);
        }
        None => ("200 OK", (String::new(), &file[..])),
    };
    let (part, body) = body;
    let is_short = goes_wrong(3) && body.len() > 1;
    let body = if is_short { &body[..body.len() / 2] } else { body };
    let length = body.len();
    let text = format!(
        "HTTP/1.1 {head}\r\n{tag}{part}Content-Length: {length}\r\nAccept-Ranges: bytes\r\n\r\n"
    );
    stream.write_all(text.as_bytes())?;
    if method == "HEAD" {
        return Ok(true);
    }
    if goes_wrong(2) {
        stream.write_all(&body[..body.len() / 2])?;
        return Ok(false);
    }
    for piece in body.chunks(16 << 10) {
        if let Some(rate) = faults.bytes_a_second {
            let took = Duration::from_secs_f64(piece.len() as f64 / rate as f64);
            let until = {
                let mut line = shared.line.lock().unwrap();
                let start = (*line).max(std::time::Instant::now());
                *line = start + took;
                *line
            };
            std::thread::sleep(until.saturating_duration_since(std::time::Instant::now()));
        }
        stream.write_all(piece)?;
    }
    Ok(true)
}
