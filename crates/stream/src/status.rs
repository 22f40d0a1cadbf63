//! What streaming is at: sizes against budgets, bytes read, and what went wrong. A copy of plain numbers
//! that anyone may ask for at any time.

/// A snapshot.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Status {
    /// Bytes of drawing memory in slots, those of requests on their way included.
    pub drawing_bytes: u64,
    /// The most that there were.
    pub drawing_bytes_peak: u64,
    /// Nodes whose planes are resident.
    pub nodes_resident: usize,
    /// Requests that wait for a loader.
    pub requests_waiting: usize,
    /// Requests that loaders have taken and the render thread has not uploaded yet.
    pub requests_in_flight: usize,
    /// Bytes read from the file.
    pub read_bytes: u64,
    /// Bytes of those that were planes asked for.
    pub useful_bytes: u64,
    /// Calls that read.
    pub reads: u64,
    /// Nodes loaded.
    pub nodes_loaded: u64,
    /// Nodes whose slots were given to others.
    pub nodes_evicted: u64,
    /// Requests that were out of view when their turn came.
    pub requests_dropped: u64,
    /// Choices made by the LOD thread.
    pub passes: u64,
    /// Nodes that could not be read.
    pub nodes_failed: u64,
    /// The last fault: file, what is wrong, what to do.
    pub fault: Option<String>,
}
