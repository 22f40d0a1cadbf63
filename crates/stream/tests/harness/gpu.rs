//! A stand-in for a GPU: a ring of upload runs, drawing memory with its own budget, limits that
//! make it slow, and a frame in the order that the streamer requires. In each frame it checks that
//! the drawn planes are the file's bytes, closed under parent, within the budget, and never empty
//! once the root is there.

use crossbeam_channel::{Receiver, Sender, bounded};
use esker_format::{EskerFile, Forest, PlaneKind};
use esker_lod::{OrientedBox, Projection};
use esker_points::node::NONE;
use esker_stream::{Cut, CutNode, Landing, Run, Slot, Streamer, Transfer};
use glam::DVec2;
use std::collections::{BTreeMap, HashMap, HashSet, VecDeque};
use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::SeqCst};
use std::time::Duration;

/// Settings of the stand-in.
#[derive(Clone, Copy, Debug)]
pub struct GpuOptions {
    pub runs: usize,
    pub run_bytes: usize,
    /// Bytes uploaded at most in a frame.
    pub upload_bytes: usize,
    /// Whether uploaded bytes are compared with the file's.
    pub checks_bytes: bool,
}

impl Default for GpuOptions {
    fn default() -> Self {
        Self { runs: 6, run_bytes: 64 << 10, upload_bytes: 1 << 20, checks_bytes: true }
    }
}

pub struct GpuRun(Vec<u8>);

impl Run for GpuRun {
    fn fill<T>(&mut self, range: Range<usize>, write: impl FnOnce(&mut [u8]) -> T) -> Option<T> {
        self.0.get_mut(range).map(write)
    }
}

/// A landed run and its transfers.
type Landed = (GpuRun, Vec<Transfer>);

/// The ring of runs.
pub struct Ring {
    run_bytes: usize,
    free: (Sender<GpuRun>, Receiver<GpuRun>),
    landed: (Sender<Landed>, Receiver<Landed>),
    /// Whether no run is lent.
    pub blocked: AtomicBool,
}

impl Landing for Ring {
    type Run = GpuRun;

    fn run_bytes(&self) -> usize {
        self.run_bytes
    }

    fn lend(&self, patience: Duration) -> Option<GpuRun> {
        if self.blocked.load(SeqCst) {
            std::thread::sleep(patience);
            return None;
        }
        self.free.1.recv_timeout(patience).ok()
    }

    fn land(&self, run: GpuRun, transfers: Vec<Transfer>) {
        self.landed.0.try_send((run, transfers)).expect("only lent runs come back");
    }
}

/// A range of drawing memory and its owner.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Owned {
    slot: Slot,
    node: u32,
    plane: PlaneKind,
    written: u64,
}

pub struct Gpu {
    pub landing: Arc<Ring>,
    gpu_options: GpuOptions,
    bytes: u64,
    forest: Arc<Forest>,
    waiting: VecDeque<(GpuRun, VecDeque<Transfer>)>,
    memory: BTreeMap<u64, Owned>,
    /// Planes whose transfers completed a request, in the order of arrival.
    pub arrived: Vec<(u32, PlaneKind)>,
    roots_seen: HashSet<u32>,
    epoch: u64,
    pub frames: u64,
    pub uploaded_bytes: u64,
    cold: HashMap<(u32, PlaneKind), Vec<u8>>,
}

impl Gpu {
    pub fn new(gpu_options: GpuOptions, bytes: u64, forest: Arc<Forest>) -> Self {
        let free = bounded(gpu_options.runs);
        for _ in 0..gpu_options.runs {
            free.0.send(GpuRun(vec![0xa5; gpu_options.run_bytes])).unwrap();
        }
        let landing = Ring {
            run_bytes: gpu_options.run_bytes,
            free,
            landed: bounded(gpu_options.runs),
            blocked: AtomicBool::new(false),
        };
        Self {
            landing: Arc::new(landing),
            gpu_options,
            bytes,
            forest,
            waiting: VecDeque::new(),
            memory: BTreeMap::new(),
            arrived: Vec::new(),
            roots_seen: HashSet::new(),
            epoch: 0,
            frames: 0,
            uploaded_bytes: 0,
            cold: HashMap::new(),
        }
    }

    /// Drains, takes the cut, uploads, draws.
    pub fn frame(&mut self, streamer: &Streamer) -> Arc<Cut> {
        while let Ok((run, transfers)) = self.landing.landed.1.try_recv() {
            self.waiting.push_back((run, transfers.into()));
        }
        let cut = streamer.cut();
        assert!(cut.epoch >= self.epoch, "cuts only get newer");
        self.epoch = cut.epoch;
        self.upload(streamer, &cut);
        self.draw(&cut);
        let status = streamer.status();
        assert!(status.drawing_bytes <= self.bytes && status.drawing_bytes_peak <= self.bytes);
        self.frames += 1;
        cut
    }

    fn upload(&mut self, streamer: &Streamer, cut: &Cut) {
        let drawn: Vec<Slot> =
            cut.lit_nodes().flat_map(|n| n.planes.iter().map(|&(_, slot)| slot)).collect();
        let mut left = self.gpu_options.upload_bytes;
        while let Some((run, transfers)) = self.waiting.front_mut() {
            let Some(&transfer) = transfers.front() else {
                let (mut run, _) = self.waiting.pop_front().unwrap();
                run.0.fill(0xa5);
                let _ = self.landing.free.0.try_send(run);
                continue;
            };
            if left < transfer.bytes {
                break;
            }
            left -= transfer.bytes;
            transfers.pop_front();
            let bytes = run.0[transfer.run_offset..][..transfer.bytes].to_vec();
            assert!(transfer.run_offset.is_multiple_of(Transfer::ALIGNMENT));
            assert!(transfer.slot_offset.is_multiple_of(Transfer::ALIGNMENT as u64));
            let overlaps = |s: &Slot| {
                s.offset < transfer.slot.offset + transfer.slot.bytes
                    && transfer.slot.offset < s.offset + s.bytes
            };
            assert!(!drawn.iter().any(overlaps), "what is drawn is overwritten by {transfer:?}");
            self.check_bytes(&transfer, &bytes);
            self.write(&transfer);
            if let Some(request) = transfer.request {
                self.arrived.push((transfer.node, transfer.plane));
                streamer.uploaded(request);
            }
        }
    }

    fn write(&mut self, transfer: &Transfer) {
        let Transfer { slot, node, plane, .. } = *transfer;
        assert!(slot.offset + slot.bytes <= self.bytes, "{slot:?} is past the budget");
        self.uploaded_bytes += transfer.bytes as u64;
        let is_same = |o: &Owned| o.slot == slot && o.node == node && o.plane == plane;
        self.memory.retain(|_, o| {
            is_same(o)
                || o.slot.offset + o.slot.bytes <= slot.offset
                || slot.offset + slot.bytes <= o.slot.offset
        });
        let fresh = Owned { slot, node, plane, written: 0 };
        let owned = self.memory.entry(slot.offset).or_insert(fresh);
        if transfer.slot_offset == 0 {
            owned.written = 0;
        }
        assert_eq!(owned.written, transfer.slot_offset, "parts come in order");
        owned.written += transfer.bytes as u64;
    }

    fn check_bytes(&mut self, transfer: &Transfer, bytes: &[u8]) {
        if !self.gpu_options.checks_bytes {
            return;
        }
        // Bytes of the node's own file, by the node's name and index there.
        let name = self.forest.name_of(transfer.node);
        let file = self.forest.file_of(transfer.node);
        let file_bytes = &super::forest_bytes()[usize::from(name.tree)];
        let node = file.node(name.index).unwrap();
        let kind = match transfer.plane {
            PlaneKind::Attribute(i) => {
                let attribute = &self.forest.schema().attributes[usize::from(i)].name;
                PlaneKind::Attribute(file.metadata().schema.find(attribute).unwrap() as u16)
            }
            kind => kind,
        };
        let range = file.layout().plane_range(kind, node.points(), node.hot_shift);
        let start = transfer.slot_offset as usize;
        match range {
            Some(range) => {
                let at = (node.page_offset + range.start) as usize + start;
                assert_eq!(bytes, &file_bytes[at..at + bytes.len()]);
            }
            None => {
                let key = (transfer.node, transfer.plane);
                let file = EskerFile::from_source(
                    std::path::Path::new("hills"),
                    Box::new(Vec::clone(file_bytes)),
                );
                let whole = self.cold.entry(key).or_insert_with(|| {
                    let planes = file.unwrap().read_planes(name.index, &[kind]).unwrap();
                    planes.get(kind).unwrap().to_vec()
                });
                assert_eq!(bytes, &whole[start..start + bytes.len()]);
            }
        }
    }

    fn draw(&mut self, cut: &Cut) {
        let table = self.forest.table();
        for node in cut.lit_nodes() {
            for &(kind, slot) in &node.planes {
                let is = self.memory.get(&slot.offset).copied();
                let should = Owned { slot, node: node.node, plane: kind, written: slot.bytes };
                assert_eq!(is, Some(should), "node {} is drawn as it is", node.node);
            }
        }
        let positions = self.memory.values().filter(|o| o.plane == PlaneKind::Position);
        let resident: HashSet<u32> = positions.map(|o| o.node).collect();
        for node in cut.lit_nodes() {
            let parent = table.nodes[node.node as usize].parent;
            assert!(parent == NONE || resident.contains(&parent), "closed under parent");
        }
        let projection = Projection::of(&cut.view);
        for root in table.roots() {
            let contour =
                OrientedBox::of_contour(&table.nodes[root as usize], self.forest.lattice());
            let seen = projection.silhouette(&contour);
            // More than a sliver at the picture's border, which may have no pixel.
            let seen = seen
                .is_some_and(|s| s.clipped(DVec2::ZERO, projection.size_px()).area_px() > 400.0);
            let is_drawn =
                |n: &CutNode| self.forest.name_of(n.node).tree == self.forest.name_of(root).tree;
            if self.roots_seen.contains(&root) && seen {
                let of = (&cut.view, &cut.counters);
                assert!(cut.nodes.iter().any(is_drawn), "never without a tree in view: {of:?}");
            }
        }
        let roots = table.roots().filter(|&root| cut.nodes.iter().any(|n| n.node == root));
        self.roots_seen.extend(roots);
    }
}
