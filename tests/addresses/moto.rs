//! S3 as `moto_server` has it (PyPI, `moto[server]`), on loopback, with a user and a key.

use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Calls without a signature that make a user with a policy and a key.
const FREE_CALLS: usize = 3;
/// What a user may do.
const POLICY: &str = "%7B%22Version%22%3A%222012-10-17%22%2C%22Statement%22%3A%5B%7B%22Effect%22%3A\
                      %22Allow%22%2C%22Action%22%3A%22s3%3A%2A%22%2C%22Resource%22%3A%22%2A%22%7D%5D%7D";

/// The server, which ends with the test.
pub struct Moto {
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
    /// Starts the server, if there is one. So many calls need no signature, besides those that make
    /// a user.
    pub fn start(calls: usize) -> Option<Self> {
        let program = std::env::var("ESKER_MOTO").ok().filter(|path| !path.is_empty());
        let Some(program) = program else {
            eprintln!("skipped: ESKER_MOTO names no moto_server (pip install 'moto[server]')");
            return None;
        };
        let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let mut command = Command::new(&program);
        command.args(["-H", "127.0.0.1", "-p", &port.to_string()]);
        command.env("INITIAL_NO_AUTH_ACTION_COUNT", (calls + FREE_CALLS).to_string());
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        let moto = Self { child: command.spawn().unwrap(), port };
        let deadline = Instant::now() + Duration::from_secs(120);
        while TcpStream::connect(("127.0.0.1", port)).is_err() {
            assert!(Instant::now() < deadline, "{program} does not start");
            std::thread::sleep(Duration::from_millis(50));
        }
        Some(moto)
    }

    /// Makes a user who may do all in S3; identifier and secret of the key.
    pub fn user(&self) -> [String; 2] {
        self.iam("Action=CreateUser&UserName=reader");
        self.iam(&format!(
            "Action=PutUserPolicy&UserName=reader&PolicyName=all&PolicyDocument={POLICY}"
        ));
        let key = self.iam("Action=CreateAccessKey&UserName=reader");
        ["AccessKeyId", "SecretAccessKey"].map(|name| element(&key, name).to_owned())
    }

    /// Variables that name the server.
    pub fn variables(&self) -> [(&'static str, String); 3] {
        [
            ("AWS_ENDPOINT_URL", format!("http://127.0.0.1:{}", self.port)),
            ("AWS_ALLOW_HTTP", "true".into()),
            ("AWS_REGION", "us-east-1".into()),
        ]
    }

    /// Makes a call without a signature; the answer.
    pub fn call(&self, method: &str, path: &str, headers: &str, body: &[u8]) -> String {
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
