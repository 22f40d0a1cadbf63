//! Where a session's memory goes, before any of it is taken: what cannot be less, and how much of
//! the rest is lent to the loaders. `--budget-ram` bounds main memory; `--budget-gpu` the drawing
//! slots where these lie in main memory, and on a GPU all of its buffers.

use crate::draw::options::Options;
use crate::draw::staging::RUN_BYTES;
use crate::io::quantity::readable_bytes;
use anyhow::{Result, ensure};
use esker_format::{Footer, Forest};
use esker_points::Node;
use esker_render::gpu::NodePool;
use esker_render::gpu::passes::ewa::BatchCapacity;
use esker_render::picture::margin::MARGIN_PX;

/// Bytes a pixel that the renderer holds: frame buffer, pyramid with normals, picture, smoothed
/// depth.
const PIXEL_BYTES: u64 = 90;
/// And of either renderer where exposures are evened out: slots of scans 4 at most, sums of cells
/// 8.
const EXPOSURE_PIXEL_BYTES: u64 = 12;
/// Bytes a node beside its record: the cache's entry, and what a choice that visits it keeps of it.
const NODE_BYTES: u64 = 512;
/// Threads' stacks, channels, allocators' slack.
const FIXED_BYTES: u64 = 12 << 20;
/// Runs of staging at least: one that is read into while another one is uploaded, and room for
/// chance.
const RUNS_MIN: u64 = 4;
/// Runs of staging at most: what a gigabyte a second brings during a frame of a twentieth of one.
const RUNS_MAX: u64 = 48;

/// The shares of main memory, in bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shares {
    /// Node table, metadata, statistics, what the choice and the cache keep a node.
    pub tree_bytes: u64,
    /// The renderer's buffers for the largest picture.
    pub picture_bytes: u64,
    /// Runs that are lent to loaders.
    pub staging_bytes: u64,
}

impl Shares {
    /// Of a session's budget for this file.
    ///
    /// # Errors
    /// Where the budget is too small; the least that works is in the message.
    pub fn of(file: &Forest, options: &Options) -> Result<Self> {
        let Options { budget_ram_bytes: budget_bytes, size, runs, evens_exposure, .. } = *options;
        // Where there are several trees, their records are joined in one more table.
        let tables = 1 + u64::from(file.files().len() > 1);
        let of = |footer: &Footer| {
            footer.nodes * (size_of::<Node>() as u64 * tables + NODE_BYTES)
                + footer.metadata.bytes * 2
                + footer.statistics.bytes * 2
        };
        let tree_bytes = file.files().map(|file| of(file.footer())).sum::<u64>();
        let pixel_bytes = PIXEL_BYTES + if evens_exposure { EXPOSURE_PIXEL_BYTES } else { 0 };
        let picture_bytes = pixels_with_margin(size) * pixel_bytes;
        let run_bytes = RUN_BYTES as u64;
        let fixed = tree_bytes + picture_bytes + FIXED_BYTES;
        let least = fixed + runs.map_or(RUNS_MIN, |r| r as u64) * run_bytes;
        ensure!(
            budget_bytes >= least,
            "{}: a budget of main memory of {} is too small: {} is the least (tree {}, pictures of {}x{} {}); \
             raise --budget-ram, or draw smaller pictures",
            file.path().display(),
            readable_bytes(budget_bytes),
            at_least(least),
            readable_bytes(tree_bytes),
            size[0],
            size[1],
            readable_bytes(picture_bytes),
        );
        let free = (budget_bytes - fixed) / run_bytes;
        let runs = runs.map_or(free.clamp(RUNS_MIN, RUNS_MAX), |r| r as u64);
        Ok(Self { tree_bytes, picture_bytes, staging_bytes: runs * run_bytes })
    }

    /// Runs of staging.
    pub fn runs(&self) -> usize {
        (self.staging_bytes / RUN_BYTES as u64) as usize
    }
}

/// Bytes a pixel of the GPU renderer's buffers and textures: frame buffer 8, pyramid with normals
/// 70, picture with depth 12, targets of point primitives 12, edges and relief 20, averages 48.
const GPU_PIXEL_BYTES: u64 = 176;
/// Bytes a drawn node: its rows in the tables of draws, of chunks and of the octree, which grow by
/// doubling.
const GPU_NODE_BYTES: u64 = 512;
/// Uniforms, colour maps, timestamps, depth tiles on their way back.
const GPU_FIXED_BYTES: u64 = 1 << 20;
/// Node planes at least: the root and what makes it finer.
const POOL_BYTES_MIN: u64 = 1 << 20;
/// What of the budget a batch of splats may take, as one part of so many.
const ROOM_SHARE: u64 = 32;
/// Runs of upload memory at most: two for each of eight loaders.
const GPU_RUNS_MAX: u64 = 16;

/// The shares of GPU memory, in bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GpuShares {
    /// The renderer's buffers for the largest picture and cut.
    pub picture_bytes: u64,
    /// Mapped upload runs that are lent to loaders.
    pub runs: usize,
    /// Room for a batch of splats.
    pub room: BatchCapacity,
    /// What is left for node planes.
    pub pool_bytes: u64,
}

impl GpuShares {
    /// Of a session's budget for this file.
    ///
    /// # Errors
    /// Where the budget is too small; the least that works is in the message.
    pub fn of(file: &Forest, options: &Options) -> Result<Self> {
        let [width, height] = options.size.map(u64::from);
        let nodes = (file.table().nodes.len()).min(options.nodes_max) as u64;
        let pixel_bytes =
            GPU_PIXEL_BYTES + if options.evens_exposure { EXPOSURE_PIXEL_BYTES } else { 0 };
        let picture_bytes = pixels_with_margin(options.size) * pixel_bytes
            + nodes * GPU_NODE_BYTES
            + GPU_FIXED_BYTES;
        let budget_bytes = options.budget_gpu_bytes;
        // Whatever is drawn first: sessions change their method while they run.
        let room = BatchCapacity::within(budget_bytes / ROOM_SHARE);
        let picture_bytes = picture_bytes + room.bytes();
        let run_bytes = RUN_BYTES as u64;
        let runs_min = options.runs.map_or(RUNS_MIN, |r| r as u64);
        let least = picture_bytes + runs_min * run_bytes + POOL_BYTES_MIN;
        ensure!(
            budget_bytes >= least,
            "{}: a budget of GPU memory of {} is too small: {} is the least (pictures of {width}x{height} {}); \
             raise --budget-gpu, or draw smaller pictures",
            file.path().display(),
            readable_bytes(budget_bytes),
            at_least(least),
            readable_bytes(picture_bytes),
        );
        // A sixteenth of what is left goes to the runs.
        let free = budget_bytes - picture_bytes;
        let runs = options
            .runs
            .map_or((free / 16 / run_bytes).clamp(RUNS_MIN, GPU_RUNS_MAX), |r| r as u64);
        let pool_bytes = NodePool::bytes_within(free - runs * run_bytes);
        Ok(Self { picture_bytes, runs: runs as usize, room, pool_bytes })
    }
}

/// Pixels of a picture with its margin.
fn pixels_with_margin(size: [u32; 2]) -> u64 {
    size.map(|side| u64::from(side) + u64::from(2 * MARGIN_PX)).iter().product()
}

/// Whole mebibytes, rounded up: what the user can type.
fn at_least(bytes: u64) -> String {
    format!("{} MiB", bytes.div_ceil(1 << 20))
}
