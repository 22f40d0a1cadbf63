//! Plan, takes and cut find what one process finds, however the sources are divided and whatever
//! happens to single jobs; and nothing is taken that is not whole.

#![allow(clippy::disallowed_methods, reason = "reads back whole what the test itself wrote")]

use super::Resources;
use super::cut::cut;
use super::cut_file::Cut;
use super::loading::Loading;
use super::place::{Folder, Listed, Place, Upload};
use super::plan::{PlanHow, plan};
use super::planned::Planned;
use super::status::{remove_leftovers, status};
use super::step::{Record, Step};
use super::take::take;
use crate::attributes::density::Distances;
use crate::attributes::normals::NormalsMode;
use crate::attributes::palette::{Trained, colours, trained};
use crate::budget::memory::Peak;
use crate::calls::build::{new_intake, page_layout};
use crate::calls::metadata::metadata;
use crate::input::attribute_types::join_types;
use crate::input::intake::open_with;
use crate::input::plan::DecodedInputs;
use crate::options::Options;
use crate::rows::borders::distances;
use crate::rows::journal::Journal;
use crate::rows::row::position;
use crate::rows::scratch::Scratch;
use esker_format::{Ranges, SetAside, SourceRecord};
use esker_points::read_at::ReadAt;
use esker_points::task::Silent;
use esker_points::{MultisetHash, PointClass};
use std::fs;
use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// What a build finds in its inputs before it arranges their points.
#[derive(Debug, PartialEq)]
struct Found {
    points: u64,
    hash: MultisetHash,
    ranges: Ranges,
    knows_scanners: bool,
    classes: Vec<PointClass>,
    distances: Option<Distances>,
    palette: Trained,
    sources: Vec<SourceRecord>,
    aside: Vec<SetAside>,
}

fn options() -> Options {
    Options { node_capacity: 1024, compact: true, ..Options::default() }
}

fn resources() -> Resources {
    Resources { memory_bytes: 256 << 20, scratch: None }
}

/// Scans of three formats, of which two can be divided: generated, LAZ, and text with a stray and
/// a line that is no point.
fn inputs(folder: &Path) -> Vec<PathBuf> {
    let text = folder.join("a.xyz");
    let mut lines = String::new();
    for i in 0..3000u64 {
        let (x, y) = (i * 7919 % 100, i * 104_729 % 100);
        lines += &format!("{}.25 {}.5 {}.125 {}\n", 500_000 + x, 5_400_000 + y, i % 13, i % 250);
    }
    lines += "9e9 1 1 1\n";
    fs::write(&text, lines).unwrap();
    let sample = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/sample/creek.laz");
    vec!["synthetic:office:100k:3".into(), sample, text]
}

fn options_for(inputs: &[PathBuf]) -> Options {
    Options { ignore_crs: inputs.len() > 1, ..options() }
}

/// What one process finds.
fn found_alone(inputs: &[PathBuf], options: &Options) -> Found {
    let mut sources = open_with(inputs, &options.open_options(), &Silent).unwrap();
    join_types(&mut sources);
    let mut intake = new_intake(sources, options);
    let folder = tempfile::tempdir().unwrap();
    let mut scratch = Scratch::new(folder.path()).unwrap();
    let mut journal = Journal::none();
    let files = (&mut scratch, &mut journal);
    let (plan, decoded) = intake.decode(files, 1 << 30, &Silent, &Peak::default()).unwrap();
    let DecodedInputs { partition, reports, aside, hash, ranges, knows_scanners } = decoded;
    let buckets = partition.finish(&mut scratch).unwrap();
    let rows = plan.rows();
    let scale = plan.lattice.metric().scale;
    let distances = (plan.computed.is_any() && !buckets.is_empty())
        .then(|| distances(&buckets, rows.bytes(), scale, &mut scratch).unwrap());
    let pages = page_layout(&plan, options, knows_scanners);
    let histogram = colours(&buckets, &rows, &pages, &mut scratch).unwrap();
    let palette =
        histogram.filter(|_| options.compact).and_then(|histogram| trained(&histogram, None));
    let of_file = metadata(&intake, &plan, (&reports, aside), options);
    Found {
        points: reports.iter().map(|r| r.points).sum(),
        hash,
        ranges,
        knows_scanners,
        classes: plan.classes,
        distances,
        palette,
        sources: of_file.sources,
        aside: of_file.set_aside,
    }
}

/// What the cut of a place has found; checks that its parts have all rows, each in its cell.
fn found_together(place: &dyn Place) -> Found {
    let planned = Planned::read(place).unwrap();
    let cut = Cut::read(place, &planned).unwrap();
    let layout = planned.plan().rows();
    let takes = &cut.rows();
    let loading = Loading { place, takes, stride: layout.bytes(), task: &Silent };
    let (mut hash, mut points) = (MultisetHash::default(), 0);
    for part in 0..cut.parts.len() as u32 {
        for cell in cut.part(place, part).unwrap().cells {
            let mut rows = Vec::new();
            let own = std::slice::from_ref(&cell);
            let mut add = |more: Vec<u8>| {
                rows.extend(more);
                Ok(())
            };
            loading.each_block(own, &mut add).unwrap();
            let mut positions = rows.chunks_exact(layout.bytes()).map(position);
            assert!(positions.all(|p| cell.cell.contains(p)));
            points += (rows.len() / layout.bytes()) as u64;
            layout.hash_all(&rows, &mut Vec::new(), &mut hash);
        }
    }
    assert_eq!((points, hash), (cut.points, cut.hash));
    Found {
        points,
        hash,
        sources: cut.sources(place, &planned).unwrap(),
        ranges: cut.ranges,
        knows_scanners: cut.knows_scanners,
        classes: cut.classes,
        distances: cut.distances,
        palette: cut.palette,
        aside: cut.aside,
    }
}

fn plan_for(place: &dyn Place, inputs: &[PathBuf], options: &Options, jobs: u32) -> u32 {
    let how = PlanHow { jobs: Some(jobs), measures: false };
    plan(inputs, place, options, &how, &Silent).unwrap().takes
}

fn take_all(place: &dyn Place, takes: u32) {
    for index in 0..takes {
        take(place, index, &resources(), &Silent).unwrap();
    }
}

/// Bytes of the objects of a place by the names of their records.
fn objects(place: &Folder, root: &Path) -> Vec<Vec<u8>> {
    let planned = Planned::read(place).unwrap();
    let takes = (0..planned.takes.len() as u32).map(Step::Take);
    let object = |step| {
        let record = Record::of(place, &planned.hash, step).unwrap();
        fs::read(root.join(record.object)).unwrap()
    };
    takes.chain([Step::Cut]).map(object).collect()
}

/// Most rows of a job that builds: its share of all, and a part that belongs to it by half.
fn share(place: &dyn Place, points: u64) -> u64 {
    let planned = Planned::read(place).unwrap();
    points.div_ceil(planned.jobs.into()) + planned.part_rows_max
}

#[test]
fn any_number_of_takes_in_any_order_finds_what_one_process_finds() {
    let folder = tempfile::tempdir().unwrap();
    let inputs = inputs(folder.path());
    let options = options_for(&inputs);
    let alone = found_alone(&inputs, &options);
    assert!(alone.points > 100_000 && alone.palette.is_some() && alone.distances.is_some());
    for jobs in [1, 3, 8] {
        let root = folder.path().join(format!("{jobs}"));
        let place = Folder::new(&root);
        let takes = plan_for(&place, &inputs, &options, jobs);
        assert_eq!(takes, jobs);
        for index in (0..takes).rev().map(|i| (i * 5 + 2) % takes).chain(0..takes) {
            take(&place, index, &resources(), &Silent).unwrap();
        }
        let report = cut(&place, &resources(), &Silent).unwrap();
        assert_eq!(found_together(&place), alone, "{jobs} jobs");
        assert!(report.parts >= jobs && report.builds == jobs, "{report:?}");
        assert!(report.build_rows_max <= share(&place, alone.points), "{report:?}");
        assert!(cut(&place, &resources(), &Silent).unwrap().was_done);
        assert_eq!(status(&place).unwrap().leftovers, []);
    }
}

#[test]
fn steps_that_run_twice_at_the_same_time_write_one_output_of_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let inputs = inputs(folder.path());
    let options = options_for(&inputs);
    let run = |name: &str, times: usize, memory_bytes: u64| {
        let root = folder.path().join(name);
        let place = Folder::new(&root);
        let takes = plan_for(&place, &inputs, &options, 2);
        let resources = Resources { memory_bytes, ..resources() };
        std::thread::scope(|scope| {
            for index in (0..takes).flat_map(|take| vec![take; times]) {
                let (place, resources) = (&place, &resources);
                scope.spawn(move || take(place, index, resources, &Silent).unwrap());
            }
        });
        std::thread::scope(|scope| {
            for _ in 0..times {
                scope.spawn(|| cut(&place, &resources, &Silent).unwrap());
            }
        });
        assert_eq!(status(&place).unwrap().leftovers, []);
        objects(&place, &root)
    };
    let once = run("once", 1, 256 << 20);
    let twice = run("twice", 2, 1 << 30);
    // The record of the cut names objects, whose names are random.
    assert_eq!(once[..2], twice[..2]);
    assert_eq!(once[2].len(), twice[2].len());
}

#[test]
fn a_cut_names_missing_and_damaged_takes_and_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("place");
    let place = Folder::new(&root);
    let inputs: Vec<PathBuf> = vec!["synthetic:office:100k:3".into()];
    assert_eq!(plan_for(&place, &inputs, &options(), 3), 3);
    let cut_error = || cut(&place, &resources(), &Silent).unwrap_err().to_string();
    let record = |index| {
        let planned = Planned::read(&place).unwrap();
        Record::of(&place, &planned.hash, Step::Take(index)).unwrap()
    };
    assert!(cut_error().contains("take/00000: and 2 more takes are missing"), "{}", cut_error());
    take(&place, 0, &resources(), &Silent).unwrap();
    take(&place, 2, &resources(), &Silent).unwrap();
    assert!(cut_error().contains("take/00001: is missing"), "{}", cut_error());
    assert!(cut_error().contains("esker job take --job 1"), "{}", cut_error());
    assert_eq!(status(&place).unwrap().takes.missing, [1]);
    take(&place, 1, &resources(), &Silent).unwrap();

    // Cut short, changed, removed.
    let object = root.join(&record(1).object);
    let bytes = fs::read(&object).unwrap();
    fs::write(&object, &bytes[..bytes.len() - 1]).unwrap();
    assert!(cut_error().contains(&record(1).object), "{}", cut_error());
    assert_eq!(status(&place).unwrap().takes.damaged.len(), 1);
    let error = take(&place, 1, &resources(), &Silent).unwrap_err().to_string();
    assert!(error.contains("remove the record take/00001"), "{error}");
    let mut wrong = bytes.clone();
    *wrong.last_mut().unwrap() ^= 1;
    fs::write(&object, &wrong).unwrap();
    assert!(cut_error().contains("is damaged; remove the record take/00001"), "{}", cut_error());
    fs::remove_file(&object).unwrap();
    assert!(cut_error().contains("is missing, although its step is finished"), "{}", cut_error());

    // As the error says.
    place.remove("take/00001").unwrap();
    take(&place, 1, &resources(), &Silent).unwrap();
    cut(&place, &resources(), &Silent).unwrap();
    assert_eq!(found_together(&place), found_alone(&inputs, &options()));

    // Damaged rows are found by those who read them.
    let object = root.join(&record(1).object);
    let mut bytes = fs::read(&object).unwrap();
    bytes[1] ^= 1;
    fs::write(&object, &bytes).unwrap();
    assert!(std::panic::catch_unwind(|| found_together(&Folder::new(&root))).is_err());
}

#[test]
fn a_source_that_changed_since_the_plan_is_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let place = Folder::new(&folder.path().join("place"));
    let scan = folder.path().join("a.xyz");
    fs::write(&scan, "1.5 2.5 3.5\n4.5 5.5 6.5\n").unwrap();
    plan_for(&place, std::slice::from_ref(&scan), &options(), 1);
    fs::write(&scan, "1.5 2.5 3.5\n4.5 5.5 6.5\n7.5 8.5 9.5\n").unwrap();
    let error = take(&place, 0, &resources(), &Silent).unwrap_err().to_string();
    assert!(error.contains("a.xyz: has changed since the build was planned"), "{error}");
    assert_eq!(status(&place).unwrap().takes.missing, [0]);
}

#[test]
fn a_place_has_one_plan() {
    let folder = tempfile::tempdir().unwrap();
    let place = Folder::new(&folder.path().join("place"));
    let inputs: Vec<PathBuf> = vec!["synthetic:office:20k:3".into()];
    let how = PlanHow { jobs: Some(2), measures: false };
    let planned = plan(&inputs, &place, &options(), &how, &Silent).unwrap();
    let again = plan(&inputs, &place, &options(), &how, &Silent).unwrap();
    assert!(!planned.was_there && again.was_there && planned.hash == again.hash);
    let with = |node_capacity| Options { node_capacity, ..options() };
    let error = plan(&inputs, &place, &with(2048), &how, &Silent).unwrap_err().to_string();
    assert!(error.contains("plan.json: is there already"), "{error}");
    // Both threads plan at once: one wins, and the other is refused.
    let place = Folder::new(&folder.path().join("contested"));
    let plan_at_once =
        |node_capacity| plan(&inputs, &place, &with(node_capacity), &how, &Silent).is_ok();
    let plans = std::thread::scope(|scope| {
        let both = [512, 2048].map(|n| scope.spawn(move || plan_at_once(n)));
        both.map(|one| u32::from(one.join().unwrap()))
    });
    assert_eq!(plans.iter().sum::<u32>(), 1);
    // A record of another plan is no record of this one.
    fs::create_dir(folder.path().join("contested/take")).unwrap();
    take(&Folder::new(&folder.path().join("place")), 0, &resources(), &Silent).unwrap();
    let record = fs::read(folder.path().join("place/take/00000")).unwrap();
    fs::write(folder.path().join("contested/take/00000"), record).unwrap();
    let error = take(&place, 0, &resources(), &Silent).unwrap_err().to_string();
    assert!(error.contains("take/00000: is of another plan"), "{error}");
}

/// A place that is full after so many bytes.
struct Full {
    place: Folder,
    room: Arc<AtomicU64>,
}

struct FullUpload(Box<dyn Upload>, Arc<AtomicU64>);

impl Write for FullUpload {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let room = self.1.load(Relaxed).min(bytes.len() as u64);
        if room == 0 {
            return Err(ErrorKind::StorageFull.into());
        }
        self.1.fetch_sub(room, Relaxed);
        self.0.write(&bytes[..room as usize])
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.flush()
    }
}

impl Upload for FullUpload {
    fn finish(self: Box<Self>) -> io::Result<()> {
        self.0.finish()
    }
}

impl Place for Full {
    fn create(&self, name: &str, bytes: &[u8]) -> io::Result<bool> {
        if self.room.load(Relaxed) < bytes.len() as u64 {
            return Err(ErrorKind::StorageFull.into());
        }
        self.place.create(name, bytes)
    }

    fn read(&self, name: &str, bytes_max: u64) -> io::Result<Option<Vec<u8>>> {
        self.place.read(name, bytes_max)
    }

    fn begin(&self, name: &str) -> io::Result<Box<dyn Upload>> {
        Ok(Box::new(FullUpload(self.place.begin(name)?, self.room.clone())))
    }

    fn open(&self, name: &str) -> io::Result<Arc<dyn ReadAt>> {
        self.place.open(name)
    }

    fn list(&self, prefix: &str) -> io::Result<Vec<Listed>> {
        self.place.list(prefix)
    }

    fn remove(&self, name: &str) -> io::Result<()> {
        self.place.remove(name)
    }

    fn shown(&self) -> String {
        self.place.shown()
    }
}

#[test]
fn a_full_place_is_an_error_and_leaves_no_output() {
    let folder = tempfile::tempdir().unwrap();
    let room = Arc::new(AtomicU64::new(u64::MAX));
    let place = Full { place: Folder::new(folder.path()), room: room.clone() };
    let inputs: Vec<PathBuf> = vec!["synthetic:office:20k:3".into()];
    plan_for(&place, &inputs, &options(), 1);
    let whole = {
        let other = tempfile::tempdir().unwrap();
        let place = Folder::new(other.path());
        plan_for(&place, &inputs, &options(), 1);
        take(&place, 0, &resources(), &Silent).unwrap().bytes
    };
    // Full in the first row, in the tail, and for the record.
    for bytes in [0, 100_000, whole - 1, whole] {
        room.store(bytes, Relaxed);
        let error = take(&place, 0, &resources(), &Silent).unwrap_err().to_string();
        assert!(error.contains("cannot be written") || error.contains("cannot be created"));
        let state = status(&place).unwrap();
        assert_eq!(state.takes.missing, [0]);
        // Whether the record was created is not known, so its object stays until it is removed.
        assert_eq!(state.leftovers.len(), usize::from(bytes == whole));
        remove_leftovers(&place, &state).unwrap();
    }
    room.store(u64::MAX, Relaxed);
    take(&place, 0, &resources(), &Silent).unwrap();
    cut(&place, &resources(), &Silent).unwrap();
    assert_eq!(found_together(&place), found_alone(&inputs, &options()));
}

#[test]
fn what_killed_jobs_leave_is_listed_and_can_be_removed() {
    let folder = tempfile::tempdir().unwrap();
    let place = Folder::new(folder.path());
    let inputs: Vec<PathBuf> = vec!["synthetic:office:20k:3".into()];
    plan_for(&place, &inputs, &options(), 1);
    let mut upload = place.begin("take/00000-0123456789abcdef.rows").unwrap();
    upload.write_all(b"half").unwrap();
    upload.flush().unwrap();
    // A killed process drops nothing.
    std::mem::forget(upload);
    take(&place, 0, &resources(), &Silent).unwrap();
    cut(&place, &resources(), &Silent).unwrap();
    let state = status(&place).unwrap();
    let left = Listed { name: "take/00000-0123456789abcdef.rows".into(), bytes: 4 };
    assert_eq!(state.leftovers, [left]);
    assert!(state.takes.is_done() && state.cut.is_done() && !state.builds.is_done());
    remove_leftovers(&place, &state).unwrap();
    assert_eq!(status(&place).unwrap().leftovers, []);
    assert_eq!(found_together(&place).points, 20_000);
}

/// A LAS 1.2 file of point format 2: header, and records of positions and colours.
fn las(scale: f64, bounds: [[f64; 3]; 2], points: &[([i32; 3], u16)]) -> Vec<u8> {
    let mut file = vec![0; 227];
    file[..4].copy_from_slice(b"LASF");
    (file[24], file[25]) = (1, 2);
    file[94..96].copy_from_slice(&227u16.to_le_bytes());
    file[96..100].copy_from_slice(&227u32.to_le_bytes());
    file[104] = 2;
    file[105..107].copy_from_slice(&26u16.to_le_bytes());
    file[107..111].copy_from_slice(&(points.len() as u32).to_le_bytes());
    for axis in 0..3 {
        file[131 + axis * 8..][..8].copy_from_slice(&scale.to_le_bytes());
        let [low, high] = bounds.map(|corner| corner[axis].to_le_bytes());
        file[179 + axis * 16..][..8].copy_from_slice(&high);
        file[187 + axis * 16..][..8].copy_from_slice(&low);
    }
    for (position, colour) in points {
        position.iter().for_each(|c| file.extend(c.to_le_bytes()));
        file.extend([0; 8]);
        (0..3).for_each(|_| file.extend(colour.to_le_bytes()));
    }
    file
}

/// Plans with all points read first, takes and cuts.
fn found_measured(folder: &Path, inputs: &[PathBuf], options: &Options) -> Found {
    let place = Folder::new(folder);
    let how = PlanHow { jobs: Some(2), measures: true };
    let takes = plan(inputs, &place, options, &how, &Silent).unwrap().takes;
    take_all(&place, takes);
    cut(&place, &resources(), &Silent).unwrap();
    found_together(&place)
}

#[test]
fn a_header_of_wrong_bounds_is_an_error_with_a_remedy_that_works() {
    let folder = tempfile::tempdir().unwrap();
    let scan = |name: &str, scale: f64, bounds: [f64; 2], points: [i32; 2]| {
        let path = folder.path().join(name);
        let points: Vec<_> = (points[0]..points[1]).map(|i| ([i, i, 0], 400)).collect();
        fs::write(&path, las(scale, bounds.map(|c| [c, c, 0.0]), &points)).unwrap();
        path
    };
    let right = scan("a.las", 0.01, [-3e6, -2_999_990.0], [-300_000_000, -299_998_999]);
    // Its points are farther from those than a lattice of millimetres reaches.
    let wrong = scan("b.las", 0.001, [0.0, 1.0], [2_000_000_000, 2_000_000_100]);
    let options = Options { normals: NormalsMode::None, ..options() };
    let (inputs, place) = ([right, wrong], Folder::new(&folder.path().join("place")));
    let takes = plan_for(&place, &inputs, &options, 2);
    let errors: Vec<String> = (0..takes)
        .filter_map(|i| take(&place, i, &resources(), &Silent).err())
        .map(|error| error.to_string())
        .collect();
    assert!(errors.len() == 1 && errors[0].contains("b.las: points lie outside"), "{errors:?}");
    assert!(errors[0].contains("--measure"));
    let alone = found_alone(&inputs, &options);
    let measured = found_measured(&folder.path().join("measured"), &inputs, &options);
    assert_eq!((measured.points, measured.hash), (alone.points, alone.hash));
    assert_eq!(measured, alone);
}

#[test]
fn colours_of_another_depth_than_the_first_points_show_are_corrected() {
    let folder = tempfile::tempdir().unwrap();
    let scan = |name: &str, late: u16| {
        let path = folder.path().join(name);
        let colour = move |i: i32| if i < 66_000 { (i % 200) as u16 } else { late };
        let points: Vec<_> = (0..70_000).map(|i| ([i % 300, i / 300, 0], colour(i))).collect();
        let high = [299.0, 233.0, 0.0].map(|raw| raw * 0.01);
        fs::write(&path, las(0.01, [[0.0; 3], high], &points)).unwrap();
        path
    };
    let run = |name: &str, inputs: &[PathBuf], options: &Options| {
        let place = Folder::new(&folder.path().join(name));
        let takes = plan_for(&place, inputs, options, 2);
        take_all(&place, takes);
        cut(&place, &resources(), &Silent).map(|_| found_together(&place))
    };
    let (deep, dark) = (scan("a.las", 60_000), scan("b.las", 255));
    let plain = Options { compact: false, ..options() };
    let one = std::slice::from_ref(&deep);
    assert_eq!(run("one", one, &plain).unwrap(), found_alone(one, &plain));
    // Palettes count other bits of the colours, and one class would be two.
    let both = [deep.clone(), dark];
    for (name, inputs, options) in [("compact", one, options()), ("both", &both[..], plain)] {
        let error = run(name, inputs, &options).unwrap_err().to_string();
        assert!(error.contains("16-bit colours of some inputs have another depth"), "{error}");
        let measured =
            found_measured(&folder.path().join(format!("{name} again")), inputs, &options);
        assert_eq!(measured, found_alone(inputs, &options));
    }
}

/// Points on a line of text each.
fn write_points(path: &Path, points: impl Iterator<Item = [u32; 3]>) {
    let line = |[x, y, z]: [u32; 3]| format!("{x}.125 {y}.25 {z}.5\n");
    fs::write(path, points.map(line).collect::<String>()).unwrap();
}

#[test]
fn cells_that_only_some_takes_split_are_divided_too() {
    let folder = tempfile::tempdir().unwrap();
    // An outlier makes cells so large that one has nearly all points. Takes of few points leave it
    // whole, others split it.
    let scan = |name: &str, count: u32, step: u32| {
        let path = folder.path().join(name);
        let spread = move |i: u32| [i * step % 997, i * step * 31 % 991, i % 7];
        let outlier = [9_000_000, 9_000_000, 0];
        write_points(&path, (1..count).map(spread).chain([outlier]));
        path
    };
    let inputs = [scan("a.xyz", 60_000, 1), scan("b.xyz", 500, 7), scan("c.xyz", 30_000, 11)];
    for jobs in [3, 16] {
        let place = Folder::new(&folder.path().join(format!("{jobs}")));
        let options = Options { compact: false, ..options() };
        let takes = plan_for(&place, &inputs, &options, jobs);
        take_all(&place, takes);
        let report = cut(&place, &resources(), &Silent).unwrap();
        assert_eq!(found_together(&place), found_alone(&inputs, &options));
        // Rows of the second take were sorted once more, with the cut.
        let planned = Planned::read(&place).unwrap();
        assert!(report.build_rows_max <= share(&place, report.points), "{report:?}");
        let cut = Cut::read(&place, &planned).unwrap();
        let parts = (0..cut.parts.len() as u32).map(|part| cut.part(&place, part).unwrap());
        let of_cut = parts.flat_map(|part| part.cells).flat_map(|cell| cell.rows);
        assert!(of_cut.filter(|rows| rows.take == takes).count() > 0);
    }
}

#[test]
fn coincident_points_are_one_part_whatever_their_number() {
    let folder = tempfile::tempdir().unwrap();
    let scan = folder.path().join("a.xyz");
    let stack = (0..40_000).map(|i| if i % 10 == 0 { [i, 1, 1] } else { [7, 7, 7] });
    write_points(&scan, stack);
    let place = Folder::new(&folder.path().join("place"));
    let options = Options { compact: false, ..options() };
    let inputs = [scan];
    for index in 0..plan_for(&place, &inputs, &options, 9) {
        take(&place, index, &resources(), &Silent).unwrap();
    }
    let report = cut(&place, &resources(), &Silent).unwrap();
    assert!((36_000..40_000).contains(&report.build_rows_max), "{report:?}");
    assert!(report.parts > 1);
    assert_eq!(found_together(&place), found_alone(&inputs, &options));
}

#[test]
fn nothing_is_built_of_no_points() {
    let folder = tempfile::tempdir().unwrap();
    let place = Folder::new(folder.path());
    let inputs: Vec<PathBuf> = vec!["synthetic:office:0".into()];
    for index in 0..plan_for(&place, &inputs, &options(), 4) {
        take(&place, index, &resources(), &Silent).unwrap();
    }
    let report = cut(&place, &resources(), &Silent).unwrap();
    assert_eq!((report.points, report.parts, report.builds), (0, 0, 4));
    assert_eq!(found_together(&place), found_alone(&inputs, &options()));
}
