//! Verification finds one flipped bit, a truncated file and another scan. The bytes of a file
//! depend on the input alone, not on the number of threads.

use crate::folder::Folder;
use crate::program::{build, sample, verify};
use crate::trial;
use libtest_mimic::Trial;

pub fn trials(trials: &mut Vec<Trial>) {
    trials.push(trial("proof: one flipped bit anywhere is found", flipped_bits));
    trials.push(trial("proof: a truncated file is found", cut));
    trials.push(trial("proof: another scan is found", another_scan));
    trials.push(trial("proof: threads do not change a byte", threads));
    trials.push(trial("proof: memory does not change the points", memory));
}

fn flipped_bits() {
    let folder = Folder::new();
    let out = folder.file("out.esker");
    build(&[sample()], &out, &[]);
    let whole = std::fs::read(&out).unwrap();
    // Places in header, pages, table, statistics, metadata and footer. Gaps between pages hold
    // zeros, which are checked too.
    let count = 23;
    let last = whole.len() - 1;
    for i in 0..=count {
        let at = (last as u128 * i as u128 / count as u128) as usize;
        let mut bytes = whole.clone();
        bytes[at] ^= 1 << (i % 8);
        std::fs::write(&out, &bytes).unwrap();
        let outcome = verify::<&str>(&out, &[]);
        assert!(outcome.error().contains("out.esker"), "byte {at}: {}", outcome.stderr);
    }
    std::fs::write(&out, &whole).unwrap();
    verify::<&str>(&out, &[]).json();
}

fn cut() {
    let folder = Folder::new();
    let out = folder.file("out.esker");
    build(&[sample()], &out, &[]);
    let whole = std::fs::read(&out).unwrap();
    for bytes in [0, 1, 63, whole.len() / 2, whole.len() - 1] {
        std::fs::write(&out, &whole[..bytes]).unwrap();
        verify::<&str>(&out, &[]).error();
        let picture = folder.file("p.png");
        let words = ["render", out.to_str().unwrap(), "-o", picture.to_str().unwrap()];
        assert!(crate::program::esker(words).error().contains("out.esker"));
    }
    let mut longer = whole;
    longer.push(0);
    std::fs::write(&out, &longer).unwrap();
    verify::<&str>(&out, &[]).error();
}

fn another_scan() {
    let folder = Folder::new();
    let text = "0 0 0 1\n1 2 3 2\n4 5 6 3\n4 5 6 3\n";
    let scan = folder.write("scan.xyz", text);
    let out = folder.file("out.esker");
    build(&[&scan], &out, &[]);
    verify(&out, &[&scan]).json();
    for (name, other) in [
        ("moved.xyz", text.replace("1 2 3", "1 2 4")),
        ("attribute.xyz", text.replace("3 2\n", "3 9\n")),
        ("missing.xyz", text.replace("1 2 3 2\n", "")),
        ("once.xyz", text.replacen("4 5 6 3\n", "", 1)),
        ("more.xyz", format!("{text}9 9 9 9\n")),
        ("order.xyz", text.replace("1 2 3", "2 1 3")),
    ] {
        let other = folder.write(name, &other);
        verify(&out, &[&other]).error();
    }
    // The order of points does not matter.
    let lines: Vec<_> = text.lines().rev().collect();
    let turned = folder.write("turned.xyz", &(lines.join("\n") + "\n"));
    verify(&out, &[&turned]).json();
}

fn threads() {
    let folder = Folder::new();
    let files = ["1", "3"].map(|threads| {
        let out = folder.file(&format!("{threads}.esker"));
        build(&[sample()], &out, &["--threads", threads, "--node-capacity", "4096"]);
        std::fs::read(&out).unwrap()
    });
    assert!(files[0] == files[1], "1 and 3 threads give the same bytes");
}

fn memory() {
    let folder = Folder::new();
    let reports = ["256MiB", "2GiB"].map(|memory| {
        let out = folder.file("out.esker");
        let report = build(&[sample()], &out, &["--memory", memory]);
        verify(&out, &[sample()]).json();
        report
    });
    for same in ["points_out", "multiset_hash", "nodes", "depth"] {
        assert_eq!(reports[0][same], reports[1][same], "{same}");
    }
}
