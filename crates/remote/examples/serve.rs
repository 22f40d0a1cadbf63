//! Serves files by ranges on loopback over a line of limited rate and a round trip, to measure how
//! files at addresses stream: `serve FILE MBIT/S MS`. Prints the address, and runs until it is
//! killed.
#![allow(clippy::unwrap_used, reason = "a tool for measurements")]

#[path = "../tests/server/mod.rs"]
mod server;

use server::{Faults, Server};
use std::io::Read;
use std::path::Path;
use std::time::Duration;

fn main() {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let [file, mbit_s, round_trip_ms] = &words[..] else {
        eprintln!("usage: serve FILE MBIT/S ROUND-TRIP-MS");
        return;
    };
    let mut bytes = Vec::new();
    std::fs::File::open(file).unwrap().read_to_end(&mut bytes).unwrap();
    let server = Server::start();
    server.set(Faults {
        latency: Duration::from_secs_f64(round_trip_ms.parse::<f64>().unwrap() / 1e3),
        bytes_a_second: Some((mbit_s.parse::<f64>().unwrap() * 1e6 / 8.0) as u64),
        ..Faults::default()
    });
    let name = Path::new(file).file_name().unwrap().to_str().unwrap();
    println!("{}", server.put(name, bytes));
    loop {
        std::thread::park();
    }
}
