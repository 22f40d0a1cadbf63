//! Shares of a session's memory budgets, computed before any memory is taken: what the session
//! needs at least, and how much of the rest is lent to loaders. `--budget-ram` limits main memory.
//! `--budget-gpu` limits all buffers of a GPU, or, on the CPU, drawing memory.

use crate::draw::method::Method;
use crate::draw::options::{Options, Settings};
use crate::draw::staging::RUN_BYTES;
use crate::io::quantity::readable_bytes;
use crate::light;
use anyhow::{Result, ensure};
use esker_format::{EskerFile, Footer, Forest};
use esker_lod::Surroundings;
use esker_points::{Filter, Node};
use esker_render::gpu::NodePool;
use esker_render::gpu::passes::ewa::BatchCapacity;
use esker_render::gpu::splats::SPLATS_MAX;
use esker_render::picture::margin::MARGIN_PX;

/// Bytes a pixel of the CPU renderer: frame buffer, pyramid with normals, picture, smoothed depth,
/// and what the choice of nodes keeps of the last picture (106 in `bench stream` at four sizes); 20
/// for dots and their radii.
const PIXEL_BYTES: u64 = 126;
/// Bytes a pixel of exposure compensation in either renderer: at most 4 for slots of scans, 8 for
/// sums of cells.
const EXPOSURE_PIXEL_BYTES: u64 = 12;
/// Bytes a pixel of lit pictures beyond those of other ones: samples, guides, the filter's sums.
const LIT_PIXEL_BYTES: u64 = 400;
/// Bytes a pixel in main memory of pictures that a GPU lights: what is read back, as bytes, as
/// planes, and as a picture.
const LIT_HOST_PIXEL_BYTES: u64 = 180;
/// Least memory for the scene of lit pictures: some hundred thousand splats.
const SCENE_BYTES_MIN: u64 = 32 << 20;
/// Splats that a lit scene should have room for before pictures get all of their pixels, and, for
/// small budgets, bytes of the budget for each.
const LIT_SPLATS_WANTED: u64 = 500_000;
const LIT_SPLAT_BYTES: u64 = 800;
/// Scales of the sides of lit pictures that are tried: each is this part of the one before.
const SCALE_STEP: f64 = 0.96;
/// Least side of a lit picture that is tried, pixels.
const LIT_SIDE_MIN: u32 = 16;
/// Bytes a node beside its record: the cache entry, and what the choice keeps of visited nodes.
const NODE_BYTES: u64 = 512;
/// Stacks of threads, channels, the allocator's overhead.
const FIXED_BYTES: u64 = 10 << 20;
/// Fewest runs of staging: one is filled while another one is uploaded, and two are spare.
const RUNS_MIN: u64 = 4;
/// Most runs of staging: what one gigabyte a second brings in 50 ms.
const RUNS_MAX: u64 = 48;

/// Shares of main memory, bytes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shares {
    /// Node table, metadata, statistics, and what choice and cache keep of nodes.
    pub tree_bytes: u64,
    /// The renderer's buffers for the largest picture.
    pub picture_bytes: u64,
    /// Runs that are lent to loaders.
    pub staging_bytes: u64,
    /// Most points of lit pictures, and what is loaded around them, within the memory of their
    /// scene; `None` if pictures are not lit.
    pub lit: Option<(u64, Surroundings)>,
}

impl Shares {
    /// Shares of the budget of a session on `file`.
    ///
    /// # Errors
    /// If the budget is too small; the message has the smallest possible one.
    pub fn of(file: &Forest, options: &Options) -> Result<Self> {
        let is_lit = options.settings.method == Method::Lit;
        let lit_pixel_bytes = is_lit.then_some(PIXEL_BYTES + LIT_PIXEL_BYTES);
        Self::with(file, options, lit_pixel_bytes, if is_lit { SCENE_BYTES_MIN } else { 0 })
    }

    /// Shares of the budget of a session on `file` that a GPU draws: scenes of lit pictures lie in
    /// the memory of the GPU.
    ///
    /// # Errors
    /// As for [`Shares::of`].
    pub fn beside_gpu(file: &Forest, options: &Options) -> Result<Self> {
        if options.settings.method != Method::Lit {
            return Self::of(file, options);
        }
        let shares = Self::with(file, options, Some(LIT_HOST_PIXEL_BYTES), 0)?;
        let splats_max = GpuShares::of(file, options)?.splats_max;
        Ok(Self { lit: Some(light::shares(splats_max)), ..shares })
    }

    /// Shares with pictures of `lit_pixel_bytes` a pixel if they are lit, and at least
    /// `lit_least` bytes of their scene.
    fn with(
        file: &Forest,
        options: &Options,
        lit_pixel_bytes: Option<u64>,
        lit_least: u64,
    ) -> Result<Self> {
        let Options { size, runs, .. } = *options;
        let Settings { budget_ram_bytes: budget_bytes, evens_exposure, .. } = options.settings;
        // Records of several trees are joined in one more table.
        let tables = 1 + u64::from(file.files().len() > 1);
        let of = |footer: &Footer| {
            footer.nodes * (size_of::<Node>() as u64 * tables + NODE_BYTES)
                + footer.metadata.bytes * 2
                + footer.statistics.bytes * 2
        };
        let of = |file: &EskerFile| match file.is_partial() {
            true => partial_bytes(file, &options.settings),
            false => of(file.footer()),
        };
        let tree_bytes = file.files().map(of).sum::<u64>();
        let tree_bytes = tree_bytes + growth_bytes(file);
        let unlit = PIXEL_BYTES + if evens_exposure { EXPOSURE_PIXEL_BYTES } else { 0 };
        let pixel_bytes = lit_pixel_bytes.unwrap_or(unlit);
        let picture_bytes = pixels_with_margin(size) * pixel_bytes;
        let run_bytes = RUN_BYTES as u64;
        let fixed = tree_bytes + picture_bytes + FIXED_BYTES + lit_least;
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
        let staging_bytes = runs * run_bytes;
        let scene_bytes = budget_bytes.saturating_sub(fixed + staging_bytes) + lit_least;
        let lit = lit_pixel_bytes.map(|_| light::shares(light::splats_max(scene_bytes)));
        Ok(Self { tree_bytes, picture_bytes, staging_bytes, lit })
    }

    /// Most splats of a lit scene; no bound without light.
    pub(crate) fn splats_max(&self) -> u64 {
        self.lit.map_or(u64::MAX, |(points_max, around)| points_max + around.points_budget)
    }

    /// Runs of staging.
    pub fn runs(&self) -> usize {
        (self.staging_bytes / RUN_BYTES as u64) as usize
    }
}

/// Points of a node, on average, of trees whose nodes are not known yet, and states of their tables
/// that are in memory at a time: of the tree, of the choice, of the cut and of the next one.
const GROWN_NODE_POINTS: u64 = 1 << 14;
const GROWN_TABLES: u64 = 4;

/// Nodes of a partial table that a session has room for, some six thousand million points.
const PARTIAL_NODES: u64 = 1 << 18;

/// Bytes of a file of whose table a part is known. Statistics are read only for filters.
fn partial_bytes(file: &EskerFile, settings: &Settings) -> u64 {
    let footer = file.footer();
    let nodes = footer.nodes.min(PARTIAL_NODES.max(file.table().nodes.len() as u64));
    let is_filtered = settings.filter != Filter::default();
    let statistics = if is_filtered { footer.statistics.bytes * 2 } else { 0 };
    let node_bytes = file.table().bytes_a_node() as u64;
    nodes * (node_bytes * GROWN_TABLES + NODE_BYTES) + footer.metadata.bytes * 2 + statistics
}

/// Bytes that a tree which grows takes beside its present table: the pages that it keeps, and the
/// tables to come. Zero for files.
fn growth_bytes(file: &Forest) -> u64 {
    let of = |file: &EskerFile| {
        let nodes = (file.footer().points / GROWN_NODE_POINTS).max(file.footer().nodes);
        let node_bytes = file.table().bytes_a_node() as u64;
        file.kept_bytes_max().map_or(0, |kept| kept + nodes * node_bytes * GROWN_TABLES)
    };
    file.files().map(of).sum()
}

/// Bytes a pixel of the buffers and textures of the GPU renderer: frame buffer 8, pyramid with
/// normals 70, picture with depth 12, targets of point primitives 12, edges and smoothed depth 20,
/// averages 48, dots and their radii 20.
const GPU_PIXEL_BYTES: u64 = 196;
/// Bytes a pixel of pictures that a GPU lights: places 48, sums 112, halves 32, guides and light
/// 48, the picture 32, light of the last picture 16; and while it is filtered, nested windows with
/// their energies 72, cleaned guides 16 and agreement of halves 32.
const GPU_LIT_PIXEL_BYTES: u64 = 420;
/// Bytes a pixel of a band of the guided filter, and rows of a band with those around it: moments
/// along rows and of windows, and coefficients.
const GPU_BAND_PIXEL_BYTES: u64 = 328;
const GPU_BAND_ROWS: u64 = 160;
/// Bytes a splat of a lit scene while it is built: the splat 32, its disc 32, keys 16, its share of
/// the tree.
const GPU_SPLAT_BYTES: u64 = 88;
/// Words of a batch of points that are made to splats.
const GPU_SPLATS_BATCH_BYTES: u64 = 11 << 20;
/// Part of the memory left by pictures and runs that scenes of lit pictures take; the rest holds
/// the planes of nodes, with some 24 bytes a point.
const GPU_SCENE_SHARE: f64 = 0.75;
/// Least memory for the scene of lit pictures on a GPU.
const GPU_SCENE_BYTES_MIN: u64 = 8 << 20;
/// Bytes a drawn node: rows in the tables of draws, chunks and the octree, which grow by doubling.
const GPU_NODE_BYTES: u64 = 512;
/// Uniforms, colour maps, timestamps, depth tiles that are read back.
const GPU_FIXED_BYTES: u64 = 1 << 20;
/// Least memory for planes of nodes: the root and some nodes below it.
const POOL_BYTES_MIN: u64 = 1 << 20;
/// A batch of splats takes at most this fraction of the budget: one in 32.
const BATCH_SHARE: u64 = 32;
/// Most runs of upload memory: two for each of eight loaders.
const GPU_RUNS_MAX: u64 = 16;

/// Shares of GPU memory, bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GpuShares {
    /// The renderer's buffers for the largest picture and cut.
    pub picture_bytes: u64,
    /// Mapped runs that are lent to loaders.
    pub runs: usize,
    /// Capacity of a batch of splats.
    pub batch: BatchCapacity,
    /// Most splats of a lit scene; 0 without light.
    pub splats_max: u64,
    /// What is left for planes of nodes.
    pub pool_bytes: u64,
}

impl GpuShares {
    /// Shares of the budget of a session on `file`.
    ///
    /// # Errors
    /// If the budget is too small; the message has the smallest possible one.
    pub fn of(file: &Forest, options: &Options) -> Result<Self> {
        let [width, height] = options.size.map(u64::from);
        let is_lit = options.settings.method == Method::Lit;
        let known = if file.is_growing() { usize::MAX } else { file.nodes() as usize };
        let nodes = known.min(options.nodes_max) as u64;
        let pixel_bytes = GPU_PIXEL_BYTES
            + if options.settings.evens_exposure { EXPOSURE_PIXEL_BYTES } else { 0 };
        let pixels_bytes = if is_lit {
            let band = width * height.min(GPU_BAND_ROWS) * GPU_BAND_PIXEL_BYTES;
            width * height * GPU_LIT_PIXEL_BYTES + band + light::gpu_bytes(&options.settings.light)
        } else {
            pixels_with_margin(options.size) * pixel_bytes
        };
        let picture_bytes = pixels_bytes + nodes * GPU_NODE_BYTES + GPU_FIXED_BYTES;
        let budget_bytes = options.settings.budget_gpu_bytes;
        // Reserved for every method but light: sessions change their method while they run.
        let batch = BatchCapacity::within(budget_bytes / BATCH_SHARE);
        let (batch_bytes, scene_least) = match is_lit {
            true => (GPU_SPLATS_BATCH_BYTES, GPU_SCENE_BYTES_MIN),
            false => (batch.bytes(), 0),
        };
        let picture_bytes = picture_bytes + batch_bytes;
        let run_bytes = RUN_BYTES as u64;
        let runs_min = options.runs.map_or(RUNS_MIN, |r| r as u64);
        let least = picture_bytes + runs_min * run_bytes + POOL_BYTES_MIN + scene_least;
        ensure!(
            budget_bytes >= least,
            "{}: a budget of GPU memory of {} is too small: {} is the least (pictures of {width}x{height} {}); \
             raise --budget-gpu, or draw smaller pictures",
            file.path().display(),
            readable_bytes(budget_bytes),
            at_least(least),
            readable_bytes(picture_bytes),
        );
        // A sixteenth of the rest goes to the runs.
        let free = budget_bytes - picture_bytes;
        let runs = options
            .runs
            .map_or((free / 16 / run_bytes).clamp(RUNS_MIN, GPU_RUNS_MAX), |r| r as u64);
        let rest = free - runs * run_bytes;
        let scene_bytes = if is_lit { (rest as f64 * GPU_SCENE_SHARE) as u64 } else { 0 };
        let splats_max = (scene_bytes / GPU_SPLAT_BYTES).min(SPLATS_MAX);
        // What no scene can take goes to the planes.
        let pool_bytes = NodePool::bytes_within(rest - splats_max * GPU_SPLAT_BYTES);
        Ok(Self { picture_bytes, runs: runs as usize, batch, splats_max, pool_bytes })
    }
}

impl GpuShares {
    /// Bytes of a lit scene.
    pub(crate) fn splats_bytes(&self) -> u64 {
        self.splats_max * GPU_SPLAT_BYTES
    }
}

/// Size of the largest lit picture, pixels: that of `options`, or less with the same aspect ratio
/// where the budgets do not hold it beside the splats that are wanted. If no size helps, that of
/// `options`.
pub(crate) fn lit_size(file: &Forest, options: &Options, is_on_gpu: bool) -> [u32; 2] {
    let Settings { budget_gpu_bytes, budget_ram_bytes, .. } = options.settings;
    let budget_bytes = if is_on_gpu { budget_gpu_bytes } else { budget_ram_bytes };
    let wanted = LIT_SPLATS_WANTED.min(file.points()).min(budget_bytes / LIT_SPLAT_BYTES);
    let fits = |&size: &[u32; 2]| {
        let options = Options { size, ..options.clone() };
        let shares = match is_on_gpu {
            true => Shares::beside_gpu(file, &options),
            false => Shares::of(file, &options),
        };
        shares.is_ok_and(|shares| shares.splats_max() >= wanted)
    };
    let scaled = |scale| options.size.map(|side| (f64::from(side) * scale) as u32);
    let sizes = (0..).map(|i| scaled(SCALE_STEP.powi(i)));
    let mut sizes = sizes.take_while(|size| size.iter().all(|&side| side >= LIT_SIDE_MIN));
    sizes.find(fits).unwrap_or(options.size)
}

/// Pixels of a picture with its margin.
fn pixels_with_margin(size: [u32; 2]) -> u64 {
    size.map(|side| u64::from(side) + u64::from(2 * MARGIN_PX)).iter().product()
}

/// Whole mebibytes, rounded up, as the user can type them.
fn at_least(bytes: u64) -> String {
    format!("{} MiB", bytes.div_ceil(1 << 20))
}
