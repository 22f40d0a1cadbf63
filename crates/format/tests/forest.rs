//! Forests: which files open as one cloud, and which are refused, by name, before anything of them
//! is used.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod tree;

use esker_format::{EskerFile, Forest, Metadata, PlaneKind, TreeRef, verify};
use esker_points::task::Silent;
use esker_points::{AttrType, Attribute, ColourDepth, NodeName, PointClass, Schema};
use std::path::{Path, PathBuf};

fn plain(names: &[&str]) -> Metadata {
    let attributes = names.iter().map(|name| Attribute::new(*name, AttrType::U16));
    let schema = Schema::new(attributes.collect());
    let present = (0..schema.attributes.len() as u16).collect();
    let class = PointClass { present, colour_depth: ColourDepth::Sixteen };
    tree::metadata(schema, vec![class])
}

/// Writes a file of `points` points; returns a reference to it.
fn write_file(path: &Path, points: usize, metadata: &Metadata) -> TreeRef {
    let points = tree::points_of(&metadata.schema, &metadata.classes, points, 20, points as u64);
    tree::write(path, metadata, &points, 15);
    let file = EskerFile::open(path).unwrap();
    verify(&file, &Silent).unwrap();
    TreeRef::new(&path.with_file_name("new.esker"), &file).unwrap()
}

fn naming(forest: Vec<TreeRef>) -> Metadata {
    Metadata { forest, ..plain(&["intensity"]) }
}

#[test]
fn trees_of_several_files_open_as_one() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    std::fs::create_dir(at("old")).unwrap();
    let mut a = write_file(&at("old/a.esker"), 70, &plain(&["a_first", "intensity", "z_last"]));
    a.path = format!("old/{}", a.path);
    let empty = write_file(&at("empty.esker"), 0, &plain(&["z_last"]));
    let b = write_file(&at("b.esker"), 40, &plain(&["z_last"]));
    write_file(&at("new.esker"), 100, &naming(vec![a, empty, b]));

    let forest = Forest::open(&at("new.esker")).unwrap();
    let paths: Vec<PathBuf> = forest.files().map(|file| file.path().into()).collect();
    assert_eq!(paths, ["new.esker", "old/a.esker", "empty.esker", "b.esker"].map(at));
    assert_eq!(forest.points(), 210);
    let names: Vec<_> = forest.schema().attributes.iter().map(|a| a.name.as_str()).collect();
    assert_eq!(names, ["a_first", "intensity", "z_last"]);
    let table = forest.table();
    assert_eq!(table.roots().count(), 3);
    let bounds = forest.bounds().unwrap();
    let mut node = 0u32;
    for (tree, file) in forest.files().enumerate() {
        let own = file.metadata().bounds.unwrap_or(bounds);
        assert!((0..3).all(|i| bounds[0][i] <= own[0][i] && bounds[1][i] >= own[1][i]));
        for (index, record) in file.table().nodes.iter().enumerate() {
            assert_eq!(forest.name_of(node), NodeName { tree: tree as u16, index: index as u32 });
            assert_eq!(table.nodes[node as usize].points(), record.points());
            assert_eq!(forest.file_of(node).path(), file.path());
            // The bytes of its page, by the forest's offset.
            let (mut page, mut own) = (vec![0; record.page_bytes as usize], Vec::new());
            own.clone_from(&page);
            forest.read_exact_at(&mut page, table.nodes[node as usize].page_offset).unwrap();
            file.read_exact_at(&mut own, record.page_offset).unwrap();
            assert_eq!(page, own);
            // The forest's attribute has the values of the file's attribute of that name.
            for (i, attribute) in forest.schema().attributes.iter().enumerate() {
                let named = if attribute.name == "intensity" {
                    PlaneKind::Intensity
                } else {
                    PlaneKind::Attribute(i as u16)
                };
                let planes = forest.read_planes(node, &[PlaneKind::Position, named]).unwrap();
                assert!(planes.get(PlaneKind::Position).is_some());
                let has = file.metadata().schema.find(&attribute.name).is_some();
                assert_eq!(planes.get(named).is_some(), has, "{}", attribute.name);
                assert_eq!(forest.has_plane(node, named), has);
                if has && named != PlaneKind::Intensity {
                    let own = file.metadata().schema.find(&attribute.name).unwrap() as u16;
                    let own = PlaneKind::Attribute(own);
                    let planes_of_file = file.read_planes(index as u32, &[own]).unwrap();
                    assert_eq!(planes.get(named), planes_of_file.get(own));
                }
            }
            node += 1;
        }
    }
    assert_eq!(table.nodes.len(), node as usize);
    // A file by itself has only its own tree.
    assert_eq!(EskerFile::open(&at("new.esker")).unwrap().footer().points, 100);
    let alone = Forest::open(&at("b.esker")).unwrap();
    assert_eq!((alone.files().len(), alone.points()), (1, 40));
}

#[test]
fn a_forest_opens_wherever_its_files_are_moved_together() {
    let folder = tempfile::tempdir().unwrap();
    let before = folder.path().join("before");
    std::fs::create_dir_all(before.join("deep")).unwrap();
    write_file(&before.join("a.esker"), 30, &plain(&["intensity"]));
    let file = EskerFile::open(&before.join("a.esker")).unwrap();
    let a = TreeRef::new(&before.join("deep/new.esker"), &file).unwrap();
    assert_eq!(a.path, "../a.esker");
    write_file(&before.join("deep/new.esker"), 20, &naming(vec![a]));
    std::fs::rename(&before, folder.path().join("after")).unwrap();
    let forest = Forest::open(&folder.path().join("after/deep/new.esker")).unwrap();
    assert_eq!(forest.points(), 50);
}

#[test]
fn files_that_do_not_belong_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let a = write_file(&at("a.esker"), 30, &plain(&["intensity"]));
    let refused = |named: TreeRef| {
        write_file(&at("new.esker"), 20, &naming(vec![named]));
        let error = Forest::open(&at("new.esker")).unwrap_err().to_string();
        assert!(error.starts_with(&at("new.esker").display().to_string()), "{error}");
        error
    };
    // Gone.
    let error = refused(TreeRef { path: "gone.esker".into(), ..a.clone() });
    assert!(error.contains("gone.esker") && error.contains("does not open"), "{error}");
    // Another file of this name; this includes the forest itself, so that no file can belong to
    // itself.
    let other = write_file(&at("b.esker"), 31, &plain(&["intensity"]));
    for path in ["b.esker", "new.esker"] {
        let error = refused(TreeRef { path: path.into(), ..a.clone() });
        assert!(error.contains(path) && error.contains("not the file that was named"), "{error}");
    }
    // Not a file.
    let error = refused(TreeRef { path: ".".into(), ..a.clone() });
    assert!(error.contains("is not a file"), "{error}");
    // Damaged.
    let mut bytes = Vec::new();
    std::io::Read::read_to_end(&mut std::fs::File::open(at("b.esker")).unwrap(), &mut bytes)
        .unwrap();
    bytes.truncate(bytes.len() - 1);
    std::fs::write(at("b.esker"), bytes).unwrap();
    let error = refused(other);
    assert!(error.contains("b.esker") && error.contains("cut short"), "{error}");
    // On another lattice.
    let mut metadata = plain(&["intensity"]);
    metadata.lattice.shift[2] += 1;
    let error = refused(write_file(&at("c.esker"), 30, &metadata));
    assert!(error.contains("c.esker") && error.contains("another lattice"), "{error}");
}

#[test]
fn impossible_lists_of_files_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let a = write_file(&folder.path().join("a.esker"), 30, &plain(&["intensity"]));
    let schema = plain(&["intensity"]).schema;
    let many = |n: u128| {
        (0..n).map(|i| TreeRef { path: format!("{i}.esker"), footer_hash: i }).collect::<Vec<_>>()
    };
    for (forest, what) in [
        (vec![a.clone(), a.clone()], "names a file twice"),
        (vec![TreeRef { path: String::new(), ..a.clone() }], "not relative"),
        (vec![TreeRef { path: "/etc/a.esker".into(), ..a.clone() }], "not relative"),
        (many(esker_format::TREES_MAX as u128), "more files than a forest can have"),
    ] {
        let points = tree::points_of(&schema, &naming(vec![]).classes, 10, 20, 1);
        let writes = std::panic::catch_unwind(|| {
            tree::write(&folder.path().join("new.esker"), &naming(forest), &points, 15);
        });
        let error = *writes.unwrap_err().downcast::<String>().unwrap();
        assert!(error.contains(what), "{error}");
    }
}
