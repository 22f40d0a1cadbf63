//! What the machine has: devices, backends, threads, caches.

pub mod backend;
pub mod devices;
pub mod pool;
pub mod system;
