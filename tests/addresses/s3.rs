//! S3, as `moto_server` has it (PyPI, `moto[server]`): files are read, drawn and built with the
//! right credentials; wrong ones and missing files are refused without a secret in any output.

use crate::folder::Folder;
use crate::moto::Moto;
use crate::{SECRET, built, bytes, drawn, esker_with, scan, verified};

#[test]
fn files_in_buckets_are_read_with_the_right_credentials_alone() {
    let Some(moto) = Moto::start(3) else { return };
    let folder = Folder::new();
    let file = built(&folder, "town.esker");
    moto.call("PUT", "/scans", "", b"");
    moto.call("PUT", "/scans/a%20b/town.esker", "", &bytes(&file));
    moto.call("PUT", "/scans/creek.laz", "", &bytes(&scan()));
    let [id, secret] = moto.user();
    let (id, secret) = (id.as_str(), secret.as_str());
    let with = |more: &[(&'static str, &str)]| -> Vec<(&'static str, String)> {
        let more = more.iter().map(|(name, value)| (*name, (*value).to_owned()));
        moto.variables().into_iter().chain(more).collect()
    };
    let right = with(&[("AWS_ACCESS_KEY_ID", id), ("AWS_SECRET_ACCESS_KEY", secret)]);
    let right: Vec<(&str, &str)> = right.iter().map(|(name, value)| (*name, &**value)).collect();
    let (address, local) = ("s3://scans/a%20b/town.esker", file.to_str().unwrap());
    let points = |report: serde_json::Value| report["points"].as_u64().unwrap();
    let info = esker_with(&right, ["info", address, "--json"]);
    assert!(!info.stdout.contains(secret));
    assert_eq!(points(info.json()), points(esker_with(&[], ["info", local, "--json"]).json()));
    assert_eq!(drawn(address, &folder, &right), drawn(local, &folder, &[]));
    let out = folder.file("again.esker");
    let out = out.to_str().unwrap();
    let build = ["build", "s3://scans/creek.laz", "-o", out, "--node-capacity", "4096"];
    esker_with(&right, build).worked();
    assert_eq!(verified(out, &[]), verified(local, &[]));
    for missing in ["s3://scans/none.esker", "s3://others/town.esker"] {
        let error = esker_with(&right, ["info", missing]).error().to_owned();
        assert!(error.contains(missing) && error.contains("no such file"), "{error}");
    }
    for (id, secret, token) in
        [(id, SECRET, ""), (SECRET, SECRET, ""), (id, SECRET, SECRET), ("", "", "")]
    {
        let mut more = vec![];
        if !id.is_empty() {
            more.extend([("AWS_ACCESS_KEY_ID", id), ("AWS_SECRET_ACCESS_KEY", secret)]);
        }
        more.extend((!token.is_empty()).then_some(("AWS_SESSION_TOKEN", token)));
        let wrong = with(&more);
        let wrong: Vec<(&str, &str)> = wrong.iter().map(|(n, v)| (*n, &**v)).collect();
        let outcome = esker_with(&wrong, ["info", address]);
        assert!(outcome.error().contains("credentials"), "{}", outcome.stderr);
    }
    // A key without its secret.
    let half = with(&[("AWS_ACCESS_KEY_ID", SECRET)]);
    let half: Vec<(&str, &str)> = half.iter().map(|(name, value)| (*name, &**value)).collect();
    let outcome = esker_with(&half, ["info", address]);
    assert!(outcome.error().contains("cannot be reached"), "{}", outcome.stderr);
}
