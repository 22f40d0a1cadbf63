//! Invalid command lines are refused with an error that says what is wrong, and leave no file
//! behind.

use crate::folder::Folder;
use crate::program::{build, esker, sample};
use crate::trial;
use libtest_mimic::Trial;

pub fn trials(trials: &mut Vec<Trial>) {
    trials.push(trial("arguments: invalid command lines are refused with a clear error", nonsense));
    trials.push(trial("arguments: windows that cannot be drawn are refused", windows));
    trials.push(trial("arguments: an input is never replaced by the output", inputs_stay));
    trials.push(trial("arguments: empty and hostile small texts", small_texts));
}

fn nonsense() {
    let folder = Folder::new();
    let built = folder.file("built.esker");
    let (scan, out) = (sample().display().to_string(), folder.file("out").display().to_string());
    build(&[&scan], &built, &[]);
    let built = built.display().to_string();
    let jpeg = folder.file("out.jpg").display().to_string();
    let nowhere = folder.file("nowhere/out").display().to_string();
    let folder_name = folder.file("").display().to_string();
    // Command line, and a word of the error. `S` is the scan, `B` the built file, `O` a new file,
    // `N` a file in a folder that does not exist, `F` a folder.
    for (typed, word) in [
        ("frobnicate", "frobnicate"),
        ("build", "required"),
        ("build S", "--out"),
        ("build nothere.las -o O", "nothere.las"),
        ("build F -o O", "folder"),
        ("build S -o F", "folder"),
        ("build S -o N", "folder"),
        ("build B -o O", "built.esker"),
        ("build S -o O --memory much", "much"),
        ("build S -o O --memory 1MiB", "at least"),
        ("build S -o O --node-capacity 0", "capacity"),
        ("build S -o O --node-capacity 4000000000", "capacity"),
        ("build S -o O --threads 100000", "threads"),
        ("build S -o O --colour-bits 7", "7"),
        ("build S -o O --scratch N", "nowhere"),
        ("build S -o O --progress loud", "loud"),
        ("info nothere", "nothere"),
        ("info F", "folder"),
        ("verify S", "not an .esker file"),
        ("verify nothere", "nothere"),
        ("verify B --against nothere", "nothere"),
        ("render B", "--out"),
        ("render B -o N", "folder"),
        ("render S B -o O", "not drawn together"),
        ("render B -o O --size 0x9", "1 to 16384"),
        ("render B -o O --size 9", "1024x1024"),
        ("render B -o O --size 99999x9", "1 to 16384"),
        ("render B -o O --method guess", "pull-push"),
        ("render B -o O --backend guess", "guess"),
        ("render B -o O --gpu-path guess", "primitives"),
        ("info --system B", "--system"),
        ("render B -o O --colour nonsense", "has no attribute `nonsense`; it has"),
        ("render B -o O --colour elevation:low..high", "MIN..MAX"),
        ("render B -o O --colour elevation:abc", "`abc` in `elevation:abc` is no range"),
        ("render B -o O --colour elevation:5..5", "no extent"),
        ("render B -o O --colour plain:1..2", "no range"),
        ("render B -o O --classes trees", "no class"),
        ("render B -o O --box 1,2", "six or four"),
        ("render B -o O --max-spacing 0", "no length: it must be above 0"),
        ("render B -o O --max-spacing -1", "no length: it must be above 0"),
        ("export B -o O --max-spacing far", "no length: it must be above 0"),
        ("render B -o O --budget-points some", "some"),
        ("render B -o O --target-spacing nan", "out of range"),
        ("render B -o O --target-spacing -1", "give a number from 0"),
        ("export B -o O --max-spacing -1", "no length: it must be above 0"),
        ("render B -o O --point-size 0", "give `adaptive`, or 1 to 64 pixels"),
        ("render B -o O --eye-dome 99", "no strength"),
        ("render B -o O --eye-dome", "add --method points"),
        ("render B -o O --point-size 3 --method ewa", "add --method points"),
        ("render B -o O.jpg", "out.png"),
        ("render B -o -", "standard output"),
        ("build S -o -", "standard output"),
        ("render B -o O --camera sideways", "sideways"),
        ("render B -o O --camera eye=1,2", "three numbers"),
        ("render B -o O --camera fovy=180", "175"),
        ("render B -o O --camera up=0,0,0", "no direction"),
        ("render B -o O --camera eye=1,2,3;target=1,2,3", "same point"),
        ("bench frobnicate", "frobnicate"),
        ("bench stream", "required"),
        ("bench stream nothere", "nothere"),
        ("bench stream F", "folder"),
        ("bench stream B --path nothere.json", "nothere.json"),
        ("bench stream B --path B", "camera path"),
        ("bench stream B --size 0x9", "1 to 16384"),
        ("bench stream B --budget-gpu much", "much"),
        ("bench stream B --budget-ram 1KiB", "is the least"),
        ("bench stream B --backend guess", "guess"),
        ("bench stream B --capacities 4096", "built already"),
        ("bench stream B --pictures nothere", "nothere"),
    ] {
        let words = typed.split(' ').map(|word| match word {
            "S" => scan.as_str(),
            "B" => built.as_str(),
            "O" => out.as_str(),
            "O.jpg" => jpeg.as_str(),
            "N" => nowhere.as_str(),
            "F" => folder_name.as_str(),
            other => other,
        });
        let outcome = esker(words);
        outcome.error();
        assert!(outcome.stderr.contains(word), "{typed}: {}", outcome.stderr);
        assert_eq!(folder.names(), ["built.esker"], "{typed}");
    }
    // An error does not repeat its cause.
    let outcome = esker(["build", "nothere.las", "-o", &out]);
    assert_eq!(outcome.error().matches("No such file").count().min(2), usize::from(cfg!(unix)));
}

fn windows() {
    let folder = Folder::new();
    let (built, out) = (folder.file("built.esker"), folder.file("out").display().to_string());
    build(&[&sample().display().to_string()], &built, &[]);
    let built = built.display().to_string();
    for (window, word) in [
        ("--window 0,0,9", "x, y, width, height"),
        ("--size 9x9 --window 1,0,9,9", "not within the picture of 9x9"),
        ("--size 9x9 --window 1,0,9,9 --method lit", "not within the picture of 9x9"),
    ] {
        let words = ["render", built.as_str(), "-o", out.as_str()];
        let outcome = esker(words.into_iter().chain(window.split(' ')));
        assert!(outcome.error().contains(word), "{window}: {}", outcome.stderr);
        assert_eq!(folder.names(), ["built.esker"], "{window}");
    }
}

fn inputs_stay() {
    let folder = Folder::new();
    let scan = folder.write("scan.xyz", "0 0 0\n1 2 3\n4 5 6\n");
    let built = folder.file("built.esker");
    build(&[&scan], &built, &[]);
    for (command, input) in [("build", &scan), ("render", &scan), ("render", &built)] {
        let before = std::fs::read(input).unwrap();
        let name = input.to_str().unwrap();
        let outcome = esker([command, name, "-o", name]);
        assert!(outcome.error().contains("input and output at once"), "{}", outcome.stderr);
        assert_eq!(std::fs::read(input).unwrap(), before);
    }
}

fn small_texts() {
    let folder = Folder::new();
    let out = folder.file("out.esker");
    for (name, text, points) in [
        ("one.xyz", "1 2 3\n".to_owned(), 1),
        ("twice.xyz", "1.5 2.5 3.5\n".repeat(2), 2),
        ("names.csv", "x,y,z,intensity\n1,2,3,4\n-1,-2,-3,5\n".to_owned(), 2),
        ("large.xyz", "1e7 1e7 1e7\n10000000.001 1e7 -1e7\n".to_owned(), 2),
        ("coincident.xyz", "7 7 7\n".repeat(100_000), 100_000),
    ] {
        let scan = folder.write(name, &text);
        let report = build(&[&scan], &out, &["--node-capacity", "64"]);
        assert_eq!(report["points_out"], points, "{name}");
        assert_eq!(crate::program::verify(&out, &[&scan]).json()["points"], points, "{name}");
        let picture = folder.file("p.png");
        esker(["render", out.to_str().unwrap(), "-o", picture.to_str().unwrap()]).worked();
    }
    for (name, text) in
        [("words.txt", "hello world\n"), ("empty.xyz", ""), ("two.csv", "1,2\n3,4\n")]
    {
        let scan = folder.write(name, text);
        let outcome = esker(["build", scan.to_str().unwrap(), "-o", out.to_str().unwrap()]);
        assert!(outcome.error().contains(name), "{}", outcome.stderr);
    }
}
