//! S3, as `moto_server` has it (PyPI, `moto[server]`): files are read, drawn and built with the
//! right credentials; wrong ones and missing files are refused without a secret in any output.

use crate::folder::Folder;
use crate::{SECRET, built, bytes, drawn, esker_with, scan, verified};
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Calls that need no signature: a bucket, two files, and a user with a policy and a key.
const FREE_CALLS: &str = "6";
/// What a user may do.
const POLICY: &str = "%7B%22Version%22%3A%222012-10-17%22%2C%22Statement%22%3A%5B%7B%22Effect%22%3A\
                      %22Allow%22%2C%22Action%22%3A%22s3%3A%2A%22%2C%22Resource%22%3A%22%2A%22%7D%5D%7D";

/// The server, which ends with the test.
struct Moto {
    child: Child,
    port: u16,
}

impl Drop for Moto {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Moto {
    fn start(program: &str) -> Self {
        let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let mut command = Command::new(program);
        command.args(["-H", "127.0.0.1", "-p", &port.to_string()]);
        command.env("INITIAL_NO_AUTH_ACTION_COUNT", FREE_CALLS);
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        let moto = Self { child: command.spawn().unwrap(), port };
        let deadline = Instant::now() + Duration::from_secs(120);
        while TcpStream::connect(("127.0.0.1", port)).is_err() {
            assert!(Instant::now() < deadline, "{program} does not start");
            std::thread::sleep(Duration::from_millis(50));
        }
        moto
    }

    fn call(&self, method: &str, path: &str, headers: &str, body: &[u8]) -> String {
        let mut stream = TcpStream::connect(("127.0.0.1", self.port)).unwrap();
        let length = body.len();
        let head = format!(
            "{method} {path} HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n{headers}\
             Content-Length: {length}\r\n\r\n"
        );
        stream.write_all(head.as_bytes()).unwrap();
        stream.write_all(body).unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        assert!(answer.starts_with("HTTP/1.1 200"), "{method} {path}: {answer}");
        answer
    }

    /// Calls the service of users.
    fn iam(&self, body: &str) -> String {
        let headers = "Content-Type: application/x-www-form-urlencoded\r\n\
                       Authorization: AWS4-HMAC-SHA256 Credential=A/20260101/us-east-1/iam/aws4_request, \
                       SignedHeaders=host, Signature=0\r\n";
        self.call("POST", "/", headers, format!("{body}&Version=2010-05-08").as_bytes())
    }
}

/// The text of an element.
fn element<'a>(answer: &'a str, name: &str) -> &'a str {
    let rest = answer.split_once(&format!("<{name}>")).unwrap().1;
    rest.split_once('<').unwrap().0
}

#[test]
fn files_in_buckets_are_read_with_the_right_credentials_alone() {
    let Some(program) = std::env::var("ESKER_MOTO").ok().filter(|path| !path.is_empty()) else {
        eprintln!("skipped: ESKER_MOTO names no moto_server (pip install 'moto[server]')");
        return;
    };
    let (folder, moto) = (Folder::new(), Moto::start(&program));
    let file = built(&folder, "town.esker");
    moto.call("PUT", "/scans", "", b"");
    moto.call("PUT", "/scans/a%20b/town.esker", "", &bytes(&file));
    moto.call("PUT", "/scans/creek.laz", "", &bytes(&scan()));
    moto.iam("Action=CreateUser&UserName=reader");
    moto.iam(&format!(
        "Action=PutUserPolicy&UserName=reader&PolicyName=all&PolicyDocument={POLICY}"
    ));
    let key = moto.iam("Action=CreateAccessKey&UserName=reader");
    let (id, secret) = (element(&key, "AccessKeyId"), element(&key, "SecretAccessKey"));
    let endpoint = format!("http://127.0.0.1:{}", moto.port);
    let place =
        [("AWS_ENDPOINT_URL", &*endpoint), ("AWS_ALLOW_HTTP", "true"), ("AWS_REGION", "us-east-1")];
    let with = |more: &[(&'static str, &str)]| -> Vec<(&'static str, String)> {
        let all = place.iter().chain(more);
        all.map(|(name, value)| (*name, (*value).to_owned())).collect()
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
