//! Node tables that are read in parts: a table that grows from its top becomes the one that is read
//! whole, and damaged parts are found.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod tree;

use esker_format::footer::FOOTER_BYTES;
use esker_format::{EskerFile, Footer, Forest, ForestFilter, PartSizes, PlaneKind, ReadAt, verify};
use esker_points::filter::Classes;
use esker_points::node::NONE;
use esker_points::task::Silent;
use esker_points::{Filter, Node};
use std::collections::BTreeMap;
use std::io;
use std::ops::Range;
use std::path::Path;
use std::sync::{Arc, Mutex};

const NAME: &str = "a.esker";
const SIZES: PartSizes = PartSizes { from_nodes: 1, part_nodes: 7, top_nodes: 12 };

/// A file with these parts.
fn bytes_of(points: usize, sizes: PartSizes) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(NAME);
    let (schema, classes) = tree::mixed_schema();
    let all = tree::points_of(&schema, &classes, points, 20, 3);
    tree::write_parts(&path, &tree::metadata(schema, classes), (&all, 5), sizes);
    let file = EskerFile::open(&path).unwrap();
    let mut bytes = vec![0; file.footer().file_bytes as usize];
    file.read_exact_at(&mut bytes, 0).unwrap();
    bytes
}

fn whole(bytes: &[u8]) -> EskerFile {
    EskerFile::from_source(Path::new(NAME), Box::new(bytes.to_vec())).unwrap()
}

fn in_parts(bytes: &[u8]) -> EskerFile {
    EskerFile::from_source_in_parts(Path::new(NAME), Box::new(bytes.to_vec())).unwrap()
}

/// Nodes that lack their children.
fn lacking(file: &EskerFile) -> Vec<u32> {
    let nodes = (0u32..).zip(&file.table().nodes);
    nodes.filter(|(_, node)| node.lacks_children()).map(|(index, _)| index).collect()
}

/// Reads children until none is lacking, `at_once` nodes at a time from the end of the table.
fn completed(mut file: EskerFile, at_once: usize) -> Result<EskerFile, esker_format::FormatError> {
    loop {
        let open = lacking(&file);
        if open.is_empty() {
            return Ok(file);
        }
        file.complete(&open[open.len().saturating_sub(at_once)..])?;
        file = file.newer().unwrap();
    }
}

/// Records with links as in the file, and sides, by the indices of the file.
fn records(file: &EskerFile) -> BTreeMap<u32, (Node, [u64; 2])> {
    let table = file.table();
    let in_file = |index: u32| if index == NONE { NONE } else { table.index_in_file(index) };
    let nodes = (0u32..).zip(&table.nodes);
    let of = |(index, node): (u32, &Node)| {
        let first_child = if node.child_count == 0 { 0 } else { in_file(node.first_child) };
        let record = Node { parent: in_file(node.parent), first_child, ..*node };
        (in_file(index), (record, table.sides_of(index)))
    };
    nodes.map(of).collect()
}

#[test]
fn a_table_grows_to_the_one_that_is_read_whole_in_any_order() {
    for (part_nodes, top_nodes) in [(1, 1), (7, 12), (16, 1), (1000, 30), (3, 10_000)] {
        let bytes = bytes_of(900, PartSizes { from_nodes: 1, part_nodes, top_nodes });
        let file = whole(&bytes);
        let count = file.table().nodes.len();
        assert!(count > 150 && !file.is_partial() && file.table().in_file.is_empty());
        verify(&file, &Silent).unwrap();
        for at_once in [1, 3, usize::MAX] {
            let partial = in_parts(&bytes);
            assert!(partial.is_partial() && !partial.is_growing());
            let top = partial.top().unwrap();
            assert_eq!(top.len(), partial.table().nodes.len());
            assert!(top.len() <= top_nodes.max(1) && partial.newer().is_none());
            let below: u64 = top.iter().map(|of| of.points_below).sum();
            let own: usize = partial.table().nodes.iter().map(Node::points).sum();
            assert_eq!(below + own as u64, file.footer().points);
            let grown = completed(partial.clone(), at_once).unwrap();
            assert!(records(&grown) == records(&file), "{part_nodes} {top_nodes} {at_once}");
            // Nodes keep their indices, and their planes are those of the file.
            assert_eq!(grown.table().in_file[..top.len()], partial.table().in_file);
            for (node, &index) in (0u32..).zip(&grown.table().in_file) {
                let kinds = [PlaneKind::Position, PlaneKind::Colour];
                let of = |file: &EskerFile, node| file.read_planes(node, &kinds).unwrap();
                for kind in kinds {
                    assert_eq!(of(&grown, node).get(kind), of(&file, index).get(kind));
                }
            }
            let again = grown.whole().unwrap();
            assert_eq!((again.table(), again.is_partial()), (file.table(), false));
        }
    }
}

#[test]
fn a_small_file_has_no_parts_and_is_read_whole() {
    let bytes = bytes_of(300, PartSizes::default());
    let file = in_parts(&bytes);
    assert!(!file.is_partial() && file.top().is_none());
    assert_eq!(file.table(), whole(&bytes).table());
}

/// The columns say nothing that is needed, and nothing else of the file depends on them.
#[test]
fn columns_of_parts_are_all_that_differs_in_a_file() {
    let (plain, parts) = (bytes_of(300, PartSizes::default()), bytes_of(300, SIZES));
    let [plain, parts] = [whole(&plain), whole(&parts)];
    assert_eq!(plain.table(), parts.table());
    assert_eq!(plain.statistics().unwrap(), parts.statistics().unwrap());
    assert_eq!(plain.histograms().unwrap(), parts.histograms().unwrap());
    let read = |file: &EskerFile, range: Range<u64>| {
        let mut bytes = vec![0; (range.end - range.start) as usize];
        file.read_exact_at(&mut bytes, range.start).unwrap();
        bytes
    };
    let before = 0..plain.footer().statistics.offset;
    assert_eq!(read(&plain, before.clone()), read(&parts, before));
    let of =
        |file: &EskerFile| file.footer().metadata.offset..file.footer().metadata.end().unwrap();
    assert_eq!(read(&plain, of(&plain)), read(&parts, of(&parts)));
}

#[test]
fn a_filter_knows_the_same_nodes_of_a_table_in_parts() {
    let bytes = bytes_of(900, SIZES);
    let classes = "3-90".parse::<Classes>().unwrap();
    for filter in [
        Filter { classes: Some(classes), ..Filter::default() },
        Filter { max_spacing: Some(0.4), ..Filter::default() },
    ] {
        let of = |file: EskerFile| {
            let forest = Forest::from(file);
            let on_lattice = filter.on(forest.lattice(), forest.schema()).unwrap();
            (ForestFilter::of(&forest, Some(on_lattice), None).unwrap(), forest)
        };
        let (all, _) = of(whole(&bytes));
        let (few, forest) = of(in_parts(&bytes));
        let grown = completed(forest.files().next().unwrap().clone(), 4).unwrap();
        let grown = Forest::from(grown);
        let more = few.grown(&grown).unwrap().unwrap();
        for (node, &index) in (0u32..).zip(&grown.table().in_file) {
            let of = |filter: &ForestFilter, node| {
                (filter.points_max(node), filter.hides_points(node), filter.rejects_subtree(node))
            };
            assert_eq!(of(&more, node), of(&all, index));
            if (node as usize) < forest.table().nodes.len() {
                assert_eq!(of(&few, node), of(&all, index));
            }
        }
        let whole = few.of_other(&forest.whole().unwrap()).unwrap();
        assert!(whole.shows_as(&all));
    }
}

/// Range of the last two columns of the statistics, without and with their entries.
fn columns(bytes: &[u8]) -> [Range<usize>; 2] {
    let place = whole(bytes).footer().statistics;
    let (start, end) = (place.offset as usize, place.end().unwrap() as usize);
    let count = u32::from_le_bytes(bytes[start + 4..start + 8].try_into().unwrap()) as usize;
    let entries = start + 16 + 24 * (count - 2)..start + 16 + 24 * count;
    let first = u64::from_le_bytes(bytes[entries.start + 8..][..8].try_into().unwrap()) as usize;
    [start + first..end, entries]
}

/// The file with the checksum of its statistics made right.
fn resealed(mut bytes: Vec<u8>) -> Vec<u8> {
    let at = bytes.len() - FOOTER_BYTES;
    let mut footer = Footer::decode(bytes[at..].try_into().unwrap()).unwrap();
    let place = footer.statistics;
    footer.statistics.crc =
        crc32fast::hash(&bytes[place.offset as usize..place.end().unwrap() as usize]);
    bytes[at..].copy_from_slice(&footer.encode());
    bytes
}

/// Opens a file in parts, and reads all of it; returns whether it is that of `good`.
fn is_read(bytes: &[u8], good: &EskerFile) -> Result<bool, esker_format::FormatError> {
    let file = EskerFile::from_source_in_parts(Path::new(NAME), Box::new(bytes.to_vec()))?;
    file.histograms()?;
    let grown = completed(file, usize::MAX)?;
    Ok(records(&grown) == records(good))
}

#[test]
fn every_changed_byte_of_the_columns_is_found_by_verify_and_misleads_no_reader() {
    let good = bytes_of(300, SIZES);
    let file = whole(&good);
    let [all, entries] = columns(&good);
    for at in entries.chain(all) {
        let mut bad = good.clone();
        bad[at] ^= 1 << (at % 8);
        let bad = resealed(bad);
        let found = EskerFile::from_source(Path::new(NAME), Box::new(bad.clone()))
            .and_then(|file| verify(&file, &Silent));
        assert!(found.is_err(), "byte {at} was missed");
        match is_read(&bad, &file) {
            Err(error) => assert!(error.to_string().starts_with("a.esker: "), "{error}"),
            Ok(is_same) => assert!(is_same, "byte {at}"),
        }
    }
}

/// Not only the checksums tell.
#[test]
fn columns_that_are_not_those_of_the_table_are_found_whatever_their_checksums() {
    let good = bytes_of(300, SIZES);
    let [all, entries] = columns(&good);
    let lengths = [0, 24].map(|entry| {
        let at = entries.start + entry + 16;
        u64::from_le_bytes(good[at..at + 8].try_into().unwrap()) as usize
    });
    let places = [all.start..all.start + lengths[0], all.end - lengths[1]..all.end];
    let mut misled = 0;
    for place in places {
        for at in place.start..place.end - 8 {
            let mut bad = good.clone();
            bad[at] ^= 1 << (at % 8);
            let crc = u64::from(crc32fast::hash(&bad[place.start..place.end - 8]));
            bad[place.end - 8..place.end].copy_from_slice(&crc.to_le_bytes());
            let bad = resealed(bad);
            let found = EskerFile::from_source(Path::new(NAME), Box::new(bad.clone()))
                .and_then(|file| verify(&file, &Silent));
            assert!(found.is_err(), "byte {at} was missed");
            // A reader in parts believes the column, but neither panics nor goes on for ever.
            misled += usize::from(is_read(&bad, &whole(&good)).is_ok());
        }
    }
    assert!(misled > 0, "some numbers cannot be checked without the table");
}

#[test]
fn a_damaged_part_is_an_error_that_names_the_file() {
    let good = bytes_of(300, SIZES);
    let file = in_parts(&good);
    let table = file.footer().table;
    let known = &file.table().in_file;
    let unknown = (0..file.footer().nodes as u32).find(|index| !known.contains(index)).unwrap();
    let mut bad = good.clone();
    bad[table.offset as usize + unknown as usize * size_of::<Node>() + 100] ^= 4;
    let error = is_read(&bad, &whole(&good)).unwrap_err().to_string();
    assert!(
        error.starts_with("a.esker: the node table is damaged: the checksum of part"),
        "{error}"
    );
    // What was known stays usable.
    let partial = in_parts(&bad);
    let before = partial.table().clone();
    assert!(partial.complete(&lacking(&partial)).is_err());
    let now = partial.newer().unwrap_or(partial);
    assert_eq!(now.table().in_file[..before.in_file.len()], before.in_file);
}

/// A file that notes what is read of it, and fails on request.
struct Noted {
    bytes: Vec<u8>,
    reads: Mutex<Vec<Range<u64>>>,
    fails: Mutex<bool>,
}

struct Source(Arc<Noted>);

impl ReadAt for Source {
    fn read_exact_at(&self, buf: &mut [u8], offset: u64) -> io::Result<()> {
        if *self.0.fails.lock().unwrap() {
            return Err(io::Error::other("the line is cut"));
        }
        self.0.reads.lock().unwrap().push(offset..offset + buf.len() as u64);
        self.0.bytes.read_exact_at(buf, offset)
    }

    fn bytes(&self) -> io::Result<u64> {
        self.0.bytes.bytes()
    }
}

#[test]
fn nothing_of_the_table_is_read_on_opening_and_errors_of_parts_pass() {
    let bytes = bytes_of(900, SIZES);
    let noted = Noted { bytes, reads: Mutex::default(), fails: Mutex::default() };
    let noted = Arc::new(noted);
    let source = Box::new(Source(Arc::clone(&noted)));
    let file = EskerFile::from_source_in_parts(Path::new(NAME), source).unwrap();
    let (table, statistics) = (file.footer().table, file.footer().statistics);
    let read = |section: esker_format::footer::Section| {
        let reads = noted.reads.lock().unwrap();
        let all = section.offset..section.end().unwrap();
        reads.iter().map(|r| r.end.min(all.end).saturating_sub(r.start.max(all.start))).sum::<u64>()
    };
    assert_eq!(read(table), 0);
    let [columns, _] = columns(&noted.bytes);
    let directory = 16
        + 24 * u64::from(u32::from_le_bytes(
            noted.bytes[statistics.offset as usize + 4..][..4].try_into().unwrap(),
        ));
    assert!(read(statistics) <= directory + columns.len() as u64);
    *noted.fails.lock().unwrap() = true;
    let error = file.complete(&lacking(&file)).unwrap_err().to_string();
    assert!(error.contains("a.esker: cannot read its table: the line is cut"), "{error}");
    assert!(file.newer().is_none());
    *noted.fails.lock().unwrap() = false;
    // One node: the part that has its children, and its sides.
    file.complete(&lacking(&file)[..1]).unwrap();
    let parts = read(table) / (u64::from(SIZES.part_nodes) * size_of::<Node>() as u64);
    assert!((1..=2).contains(&parts), "{parts} parts");
    completed(file.newer().unwrap(), 1).unwrap();
}
