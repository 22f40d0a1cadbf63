//! A server of files with ranges on loopback, which misbehaves on request.
#![allow(dead_code, reason = "each test uses a part")]
#![allow(clippy::disallowed_methods, reason = "threads of a server for tests need no names")]

use std::collections::HashMap;
use std::io::{BufRead, BufReader, Result, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// Bytes that are sent at a time over a throttled line.
const PIECE: usize = 16 << 10;
/// Delay of a thread that the rate of a line makes up for.
const LATE: Duration = Duration::from_millis(20);
/// Longer than the tests' clients wait.
const STALL: Duration = Duration::from_millis(700);

/// What goes wrong.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Faults {
    /// What is odd about each answer.
    pub odd: Odd,
    /// Of so many answers one is an error 500, one is cut, one stalls, one is shorter than stated
    /// by its range; 0 for none.
    pub one_in: u64,
    /// Whether these are at random places, which depend on the number, and not in turn.
    pub seed: Option<u64>,
    /// The tag changes after so many answers.
    pub changes_after: Option<u64>,
    /// Wait before each answer.
    pub latency: Duration,
    /// Bytes a second of all answers together.
    pub bytes_a_second: Option<u64>,
    /// What tells the version.
    pub tag: Tag,
}

/// What is odd about each answer.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Odd {
    #[default]
    Nothing,
    /// `Range` is ignored.
    Whole,
    /// It leads from `/moved/NAME` to `/NAME`.
    Redirects,
    /// It leads to itself.
    Loops,
    /// It says that it is compressed.
    Compressed,
    /// It is of another range than was requested.
    OtherRange,
    /// Its range has no size of the file.
    NoSize,
    /// It says that the file has 2^64 - 1 bytes.
    Huge,
    /// It says that its range ends at 2^64 - 1.
    EndsAtMost,
    /// It has no end.
    Endless,
    /// It comes byte by byte.
    Trickles,
    /// Nothing comes.
    Stalls,
    /// Nothing comes after so many answers.
    StallsAfter(u64),
    /// `HEAD` is refused, and ranges of empty files are.
    NoHead,
    /// It is refused with this status and a text that has a secret.
    Refused(u16),
}

/// What tells the version of a file.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Tag {
    /// A strong tag.
    #[default]
    Strong,
    /// A weak tag, and a time long ago.
    Weak,
    /// A time long ago.
    Time,
    /// The time of the answer.
    Now,
    /// Neither tag nor time.
    None,
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
    /// Bytes of files that were sent.
    sent: AtomicU64,
    /// First lines of all requests.
    lines: Mutex<Vec<String>>,
    is_over: AtomicBool,
    /// When the line is free again.
    line: Mutex<Instant>,
}

impl Server {
    /// Starts a server of no files.
    pub fn start() -> Self {
        Self::start_at("127.0.0.1:0")
    }

    /// Starts a server of no files at an address of this machine.
    pub fn start_at(at: &str) -> Self {
        let listener = TcpListener::bind(at).unwrap();
        let address = format!("http://{}", listener.local_addr().unwrap());
        let shared = Arc::new(Shared {
            files: Mutex::new(HashMap::new()),
            faults: Mutex::new(Faults::default()),
            answers: AtomicU64::new(0),
            sent: AtomicU64::new(0),
            lines: Mutex::new(Vec::new()),
            is_over: AtomicBool::new(false),
            line: Mutex::new(Instant::now()),
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
                    let _ = stream.shutdown(Shutdown::Both);
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

    /// Bytes of files that were sent until now.
    pub fn sent(&self) -> u64 {
        self.shared.sent.load(Relaxed)
    }

    /// First lines of all requests until now.
    pub fn lines(&self) -> Vec<String> {
        self.shared.lines.lock().unwrap().clone()
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.shared.is_over.store(true, Relaxed);
        let _ = TcpStream::connect(self.address.trim_start_matches("http://"));
    }
}

/// A request.
struct Request {
    /// Number of the answer.
    number: u64,
    method: String,
    /// As it was sent.
    target: String,
    path: String,
    range: Option<(u64, u64)>,
}

/// Answers the requests of a connection.
fn serve(stream: &TcpStream, shared: &Shared) -> Result<()> {
    stream.set_nodelay(true)?;
    let mut reader = BufReader::new(stream);
    loop {
        let mut line = String::new();
        if reader.read_line(&mut line)? == 0 {
            return Ok(());
        }
        let mut words = line.split_whitespace();
        let method = words.next().unwrap_or("").to_owned();
        let target = words.next().unwrap_or("").to_owned();
        // Proxies get whole addresses.
        let path = target
            .strip_prefix("http://")
            .map_or(&*target, |rest| rest.find('/').map_or("/", |start| &rest[start..]));
        let path = decoded(path.split('?').next().unwrap_or(""));
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
        shared.lines.lock().unwrap().push(line.trim().to_owned());
        let number = shared.answers.fetch_add(1, Relaxed) + 1;
        let faults = *shared.faults.lock().unwrap();
        if !answer(stream, shared, faults, &Request { number, method, target, path, range })? {
            return Ok(());
        }
    }
}

/// Letters of codes as `%20`.
fn decoded(path: &str) -> String {
    let mut bytes = Vec::new();
    let mut rest = path.as_bytes();
    while let Some((&first, after)) = rest.split_first() {
        let code = (first == b'%').then(|| std::str::from_utf8(after.get(..2)?).ok()).flatten();
        match code.and_then(|code| u8::from_str_radix(code, 16).ok()) {
            Some(byte) => (bytes.push(byte), rest = &after[2..]).1,
            None => (bytes.push(first), rest = after).1,
        }
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

/// One of the faults that come now and then.
#[derive(Clone, Copy, PartialEq)]
enum Fault {
    Error,
    Stall,
    Cut,
    Short,
}

impl Faults {
    /// The fault of an answer.
    fn of(&self, number: u64) -> Option<Fault> {
        let all = [Fault::Error, Fault::Stall, Fault::Cut, Fault::Short];
        if self.one_in == 0 {
            return None;
        }
        let place = match self.seed {
            Some(seed) => {
                let mixed = (number ^ seed).wrapping_mul(0x9E37_79B9_7F4A_7C15);
                (mixed ^ (mixed >> 29)).wrapping_mul(0xBF58_476D_1CE4_E5B9) >> 32
            }
            None => number,
        };
        all.get((place % self.one_in) as usize).copied()
    }
}

/// Sends an answer. Returns whether the connection goes on.
fn answer(
    mut stream: &TcpStream,
    shared: &Shared,
    faults: Faults,
    request: &Request,
) -> Result<bool> {
    std::thread::sleep(faults.latency);
    let plain = |status: &str, headers: &str, body: &str| -> Result<bool> {
        let length = body.len();
        let text = format!("HTTP/1.1 {status}\r\n{headers}Content-Length: {length}\r\n\r\n{body}");
        (&mut &*stream).write_all(text.as_bytes())?;
        Ok(true)
    };
    match faults.odd {
        Odd::Redirects => {
            if let Some(name) = request.target.strip_prefix("/moved") {
                return plain("302 Found", &format!("Location: {name}\r\n"), "");
            }
        }
        Odd::Loops => return plain("302 Found", &format!("Location: {}\r\n", request.target), ""),
        Odd::Stalls => return stall(shared, faults.odd),
        Odd::StallsAfter(number) if request.number > number => return stall(shared, faults.odd),
        Odd::Refused(status) => {
            return plain(
                &format!("{status} No"),
                "",
                "<Error>the token top-secret is no good</Error>",
            );
        }
        _ => {}
    }
    let file = shared.files.lock().unwrap().get(&request.path).cloned();
    let Some(file) = file else { return plain("404 Not Found", "", "") };
    if request.method == "HEAD" && faults.odd == Odd::NoHead {
        return plain("405 Not Allowed", "", "");
    }
    let fault = faults.of(request.number);
    match fault {
        Some(Fault::Error) => return plain("500 Oops", "", ""),
        Some(Fault::Stall) => {
            std::thread::sleep(STALL);
            return Ok(false);
        }
        _ => {}
    }
    let size = file.len() as u64;
    let (head, body) = match request.range.filter(|_| faults.odd != Odd::Whole) {
        Some((from, to)) if from < size => {
            let to = to.min(size - 1);
            let part = content_range(faults.odd, from, to, size);
            (format!("206 Partial Content\r\n{part}"), &file[from as usize..=to as usize])
        }
        Some(_) => {
            let range = format!("Content-Range: bytes */{size}\r\n");
            return plain("416 No", &range, "");
        }
        None => ("200 OK\r\n".into(), &file[..]),
    };
    let is_short = fault == Some(Fault::Short) && body.len() > 1;
    let body = if is_short { &body[..body.len() / 2] } else { body };
    let encoding = if faults.odd == Odd::Compressed { "Content-Encoding: gzip\r\n" } else { "" };
    let length = match faults.odd {
        Odd::Endless => format!("Content-Length: {}", 1u64 << 40),
        _ => format!("Content-Length: {}", body.len()),
    };
    let tag = faults.tag(request.number);
    let text = format!("HTTP/1.1 {head}{tag}{encoding}{length}\r\nAccept-Ranges: bytes\r\n\r\n");
    stream.write_all(text.as_bytes())?;
    if request.method == "HEAD" {
        return Ok(true);
    }
    shared.sent.fetch_add(body.len() as u64, Relaxed);
    if fault == Some(Fault::Cut) {
        stream.write_all(&body[..body.len() / 2])?;
        return Ok(false);
    }
    match faults.odd {
        Odd::Endless => loop {
            stream.write_all(&[7; 0x10000])?;
        },
        Odd::Trickles => {
            for byte in body.chunks(1) {
                stream.write_all(byte)?;
                std::thread::sleep(Duration::from_millis(20));
            }
            Ok(true)
        }
        _ => send(stream, shared, faults, body),
    }
}

/// Waits until the server ends, or does something else.
fn stall(shared: &Shared, odd: Odd) -> Result<bool> {
    while !shared.is_over.load(Relaxed) && shared.faults.lock().unwrap().odd == odd {
        std::thread::sleep(Duration::from_millis(10));
    }
    Ok(false)
}

/// The header of a range, which may be odd.
fn content_range(odd: Odd, from: u64, to: u64, size: u64) -> String {
    let range = match odd {
        Odd::OtherRange => format!("{}-{}/{size}", from + 1, to + 1),
        Odd::NoSize => format!("{from}-{to}/*"),
        Odd::Huge => format!("{from}-{to}/{}", u64::MAX),
        Odd::EndsAtMost => format!("{from}-{}/{size}", u64::MAX),
        _ => format!("{from}-{to}/{size}"),
    };
    format!("Content-Range: bytes {range}\r\n")
}

impl Faults {
    /// The headers that tell the version.
    fn tag(&self, number: u64) -> String {
        let has_changed = self.changes_after.is_some_and(|after| number > after);
        let version = u8::from(has_changed);
        let time = format!("Last-Modified: Mon, 30 Nov 2020 10:00:0{version} GMT\r\n");
        match self.tag {
            Tag::Strong => format!("ETag: \"version-{version}\"\r\n"),
            Tag::Weak => format!("ETag: W/\"version\"\r\n{time}"),
            Tag::Time => time,
            Tag::Now => format!("Last-Modified: {}\r\n", now()),
            Tag::None => String::new(),
        }
    }
}

/// The time of this second, as servers write it.
fn now() -> String {
    let since = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap();
    let (days, second) = (since.as_secs() / 86_400, since.as_secs() % 86_400);
    let (mut year, mut left) = (1970, days);
    let length = |year: u64| {
        365 + u64::from(
            year.is_multiple_of(4) && !year.is_multiple_of(100) || year.is_multiple_of(400),
        )
    };
    while left >= length(year) {
        left -= length(year);
        year += 1;
    }
    let leap = length(year) - 365;
    let months = [31, 28 + leap, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31];
    let names =
        ["Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec"];
    let mut month = 0;
    while left >= months[month] {
        left -= months[month];
        month += 1;
    }
    let weekday = ["Thu", "Fri", "Sat", "Sun", "Mon", "Tue", "Wed"][(days % 7) as usize];
    let (hour, minute) = (second / 3600, second / 60 % 60);
    let (day, name, second) = (left + 1, names[month], second % 60);
    format!("{weekday}, {day:02} {name} {year} {hour:02}:{minute:02}:{second:02} GMT")
}

/// Sends a body at the rate of the line, which all connections share.
fn send(mut stream: &TcpStream, shared: &Shared, faults: Faults, body: &[u8]) -> Result<bool> {
    let Some(rate) = faults.bytes_a_second else {
        stream.write_all(body)?;
        return Ok(true);
    };
    for piece in body.chunks(PIECE) {
        let took = Duration::from_secs_f64(piece.len() as f64 / rate as f64);
        let until = {
            let mut line = shared.line.lock().unwrap();
            // Threads wake up late; the line does not wait for them.
            *line = (*line).max(Instant::now() - LATE) + took;
            *line
        };
        std::thread::sleep(until.saturating_duration_since(Instant::now()));
        stream.write_all(piece)?;
    }
    Ok(true)
}
