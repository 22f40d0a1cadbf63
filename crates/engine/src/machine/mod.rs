//! The machine: graphics devices, backends, threads, caches, processes.

pub mod backend;
pub mod devices;
pub mod pool;
pub mod system;
