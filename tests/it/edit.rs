//! The command `edit` from outside: its local server lets in the page that it has printed the
//! address of, and nobody else.

use crate::common::edit_program::Server;
use crate::common::{Numbers, bin, fails, run, text};
use serde_json::{Value, json};
use std::io::{Read, Write};
use std::net::TcpStream;
use std::process::Command;
use std::time::Duration;

/// All routes that are POSTs.
const POSTS: [&str; 7] = [
    "/solve",
    "/act",
    "/solutions",
    "/photograph",
    "/between",
    "/export",
    "/open",
];
/// An action that changes nothing where no gesture is under way.
const RELEASE: &str = "{\"do\":\"release\"}";
const JSON: &str = "Content-Type: application/json";

impl Server {
    fn connect(&self) -> TcpStream {
        let stream = TcpStream::connect(("127.0.0.1", self.port)).unwrap();
        // Only so that a failing test ends.
        let hung = Some(Duration::from_secs(120));
        stream.set_read_timeout(hung).unwrap();
        stream
    }

    /// Sends a request with only these headers, and `Connection: close`.
    fn bare(&self, request: &str, headers: &[&str], body: &str) -> Response {
        let mut head = format!("{request} HTTP/1.1\r\nConnection: close\r\n");
        for header in headers {
            head += &format!("{header}\r\n");
        }
        if !body.is_empty() {
            head += &format!("Content-Length: {}\r\n", body.len());
        }
        let mut stream = self.connect();
        // The server may refuse, and close, before it has all.
        let _ = stream.write_all(format!("{head}\r\n{body}").as_bytes());
        Response::read(&mut stream)
    }

    fn host(&self) -> String {
        format!("Host: 127.0.0.1:{}", self.port)
    }

    fn token(&self) -> String {
        format!("X-Posing-Token: {}", self.token)
    }

    /// Sends a request with the right host and token, and more headers.
    fn ask(&self, request: &str, headers: &[&str], body: &str) -> Response {
        let (host, token) = (self.host(), self.token());
        let own = [&*host, &*token];
        self.bare(request, &[&own, headers].concat(), body)
    }
}

#[derive(Debug)]
struct Response {
    status: u16,
    /// Names in lower case.
    headers: Vec<(String, String)>,
    body: String,
}

impl Response {
    /// Reads until the server closes the connection.
    fn read(stream: &mut impl Read) -> Response {
        let mut bytes = Vec::new();
        let read = stream.read_to_end(&mut bytes);
        let text = String::from_utf8(bytes).unwrap();
        let Some((head, body)) = text.split_once("\r\n\r\n") else {
            panic!("no response: {text:?}, {read:?}");
        };
        let mut lines = head.lines();
        let status = lines.next().unwrap().split(' ').nth(1).unwrap();
        let header = |line: &str| {
            let (name, value) = line.split_once(": ").unwrap();
            (name.to_lowercase(), value.to_string())
        };
        Response {
            status: status.parse().unwrap(),
            headers: lines.map(header).collect(),
            body: body.to_string(),
        }
    }

    fn header(&self, name: &str) -> Option<&str> {
        let mut all = self.headers.iter().filter(|(n, _)| n == name);
        let value = all.next().map(|(_, value)| value.as_str());
        assert!(all.next().is_none(), "{name} twice: {self:?}");
        value
    }

    /// A refusal with this status, which is one sentence in JSON.
    #[track_caller]
    fn refused(&self, status: u16) {
        assert_eq!(self.status, status, "{self:?}");
        assert_eq!(self.header("content-type"), Some("application/json"));
        let json: Value = serde_json::from_str(&self.body).unwrap();
        assert_eq!(json.as_object().unwrap().len(), 1, "{self:?}");
        assert!(!json["error"].as_str().unwrap().is_empty(), "{self:?}");
    }

    #[track_caller]
    fn answered(&self) {
        assert_eq!(self.status, 200, "{self:?}");
        assert_eq!(self.header("content-type"), Some("application/json"));
        self.json();
    }

    fn json(&self) -> Value {
        serde_json::from_str(&self.body).unwrap()
    }
}

#[test]
fn the_page_and_its_requests_are_answered() {
    let server = Server::new();
    let page = server.bare("GET /", &[&server.host()], "");
    assert_eq!(page.status, 200);
    let kind = page.header("content-type");
    assert_eq!(kind, Some("text/html; charset=utf-8"));
    assert!(page.body.to_lowercase().starts_with("<!doctype html>"));
    server.ask("GET /state", &[], "").answered();
    server.ask("POST /solve", &[JSON], "{}").answered();
    server.ask("POST /act", &[JSON], RELEASE).answered();
    server.ask("POST /solutions", &[JSON], "{}").answered();
    // These want more.
    for path in ["/photograph", "/between", "/export", "/open"] {
        let request = format!("POST {path}");
        server.ask(&request, &[JSON], "{}").refused(400);
    }
}

#[test]
fn a_connection_serves_many_requests() {
    let server = Server::new();
    let mut stream = server.connect();
    let (host, token) = (server.host(), server.token());
    // A refused one leaves the connection open, too.
    for (head, status) in [
        ("GET /state", "200"),
        ("GET /nothing", "404"),
        ("GET /state", "200"),
    ] {
        let request = format!("{head} HTTP/1.1\r\n{host}\r\n{token}\r\n\r\n");
        stream.write_all(request.as_bytes()).unwrap();
        let mut answer = String::new();
        let mut byte = [0];
        while !answer.ends_with("\r\n\r\n") {
            stream.read_exact(&mut byte).unwrap();
            answer.push(byte[0].into());
        }
        assert!(
            answer.starts_with(&format!("HTTP/1.1 {status}")),
            "{answer}"
        );
        let length = answer.to_lowercase();
        let length = length.split("content-length: ").nth(1).unwrap();
        let length: usize = length.lines().next().unwrap().parse().unwrap();
        stream.read_exact(&mut vec![0; length]).unwrap();
    }
}

#[test]
fn other_hosts_are_refused_on_every_path() {
    let server = Server::new();
    let (port, token) = (server.port, server.token());
    let local = format!("Host: localhost:{port}");
    assert_eq!(server.bare("GET /", &[&local], "").status, 200);
    server.bare("GET /state", &[&local, &token], "").answered();
    let wrong = [
        format!("evil.example:{port}"),
        "evil.example".into(),
        "127.0.0.1".into(),
        "localhost".into(),
        format!("127.0.0.1:{}", port ^ 1),
        format!("127.0.0.1:{port}.evil.example"),
        format!("localhost.evil.example:{port}"),
        format!("0.0.0.0:{port}"),
        format!("[::1]:{port}"),
        String::new(),
    ];
    let mut paths = vec!["GET /".into(), "GET /state".into(), "GET /nothing".into()];
    paths.extend(POSTS.map(|path| format!("POST {path}")));
    for host in wrong {
        let host = format!("Host: {host}");
        for path in &paths {
            let headers = [host.as_str(), &token, JSON];
            server.bare(path, &headers, "").refused(403);
        }
    }
    server.bare("GET /", &[&token], "").refused(403);
    let two = [&*server.host(), "Host: evil.example"];
    assert!([400, 403].contains(&server.bare("GET /", &two, "").status));
}

#[test]
fn other_origins_are_refused_null_among_them() {
    let server = Server::new();
    let port = server.port;
    for own in ["127.0.0.1", "localhost"] {
        let origin = format!("Origin: http://{own}:{port}");
        let post = server.ask("POST /act", &[JSON, &origin], RELEASE);
        post.answered();
    }
    let wrong = [
        "null".into(),
        "https://evil.example".into(),
        "http://127.0.0.1".into(),
        format!("http://127.0.0.1:{}", port ^ 1),
        format!("https://127.0.0.1:{port}"),
        format!("http://localhost:{port}.evil.example"),
        format!("http://evil.example:{port}"),
        format!("127.0.0.1:{port}"),
        String::new(),
    ];
    for origin in wrong {
        let origin = format!("Origin: {origin}");
        let post = server.ask("POST /act", &[JSON, &origin], RELEASE);
        post.refused(403);
        server.ask("GET /", &[&origin], "").refused(403);
        let own = format!("Origin: http://127.0.0.1:{port}");
        let both = [JSON, &own, &origin];
        server.ask("POST /act", &both, RELEASE).refused(403);
    }
}

#[test]
fn all_but_the_page_needs_the_token() {
    let server = Server::new();
    let (host, token) = (server.host(), &server.token);
    let other = if token.ends_with('0') { '1' } else { '0' };
    let wrong = [
        None,
        Some(String::new()),
        Some("0".repeat(32)),
        Some(token[..31].to_string()),
        Some(format!("{}{other}", &token[..31])),
        Some(format!("{token}0")),
        Some(token.to_uppercase() + "x"),
    ];
    let mut paths = vec!["GET /state".into(), "GET /nothing".into(), "POST /".into()];
    paths.extend(POSTS.map(|path| format!("POST {path}")));
    // Not where others may see it.
    paths.push(format!("GET /state?token={token}"));
    for path in paths {
        for wrong in &wrong {
            let line = wrong.as_ref().map(|t| format!("X-Posing-Token: {t}"));
            let mut headers = vec![&*host, JSON];
            headers.extend(line.as_deref());
            server.bare(&path, &headers, "{}").refused(401);
        }
    }
    let cookie = format!("Cookie: X-Posing-Token={token}");
    server
        .bare("GET /state", &[&host, &cookie], "")
        .refused(401);
}

#[test]
fn a_preflight_is_not_answered_and_no_response_invites_other_origins() {
    let server = Server::new();
    let host = server.host();
    let evil = "Origin: http://evil.example";
    let own = format!("Origin: http://127.0.0.1:{}", server.port);
    let wishes = [
        "Access-Control-Request-Method: POST",
        "Access-Control-Request-Headers: content-type,x-posing-token",
        "Access-Control-Request-Private-Network: true",
    ];
    let preflight = |path: &str, origin| {
        let headers = [&[&*host, origin], &wishes[..]].concat();
        server.bare(&format!("OPTIONS {path}"), &headers, "")
    };
    for path in ["/", "/state", "/solve", "/nothing"] {
        preflight(path, evil).refused(403);
        preflight(path, &own).refused(401);
    }
    let responses = [
        preflight("/solve", evil),
        preflight("/solve", &own),
        server.ask("OPTIONS /solve", &wishes, ""),
        server.bare("GET /", &[&host], ""),
        server.ask("GET /state", &[&own], ""),
        server.ask("POST /act", &[JSON, &own], RELEASE),
        server.ask("POST /act", &[JSON, evil], RELEASE),
    ];
    for response in responses {
        let is_cors = |(name, _): &(String, String)| name.starts_with("access-control-");
        assert!(!response.headers.iter().any(is_cors), "{response:?}");
    }
}

#[test]
fn a_get_never_does_what_a_post_does() {
    let server = Server::new();
    for path in POSTS {
        for method in ["GET", "HEAD", "PUT", "DELETE", "PATCH", "OPTIONS"] {
            let response = server.ask(&format!("{method} {path}"), &[], "");
            match method {
                "HEAD" => assert_eq!(response.status, 405),
                _ => response.refused(405),
            }
            assert_eq!(response.header("allow"), Some("POST"));
        }
    }
    for path in ["/", "/state"] {
        server
            .ask(&format!("POST {path}"), &[JSON], "{}")
            .refused(405);
        server.ask(&format!("DELETE {path}"), &[], "").refused(405);
    }
    for path in ["/nothing", "/state/", "/../state", "/solve/x", "//"] {
        server.ask(&format!("GET {path}"), &[], "").refused(404);
        server
            .ask(&format!("POST {path}"), &[JSON], "{}")
            .refused(404);
    }
}

#[test]
fn a_post_is_json() {
    let server = Server::new();
    let kind = |kind: &str| {
        let header = format!("Content-Type: {kind}");
        server.ask("POST /act", &[&header], RELEASE)
    };
    kind("application/json").answered();
    kind("application/json; charset=utf-8").answered();
    kind("Application/JSON ;charset=UTF-8").answered();
    // The first three are what a form, or a page without a preflight, can send.
    for wrong in [
        "text/plain",
        "application/x-www-form-urlencoded",
        "multipart/form-data; boundary=x",
        "application/jsonp",
        "text/plain; application/json",
        "",
    ] {
        kind(wrong).refused(415);
    }
    server.ask("POST /act", &[], RELEASE).refused(415);
}

#[test]
fn a_request_has_at_most_a_mebibyte_but_a_session_many() {
    let server = Server::new();
    let post = |size| server.ask("POST /act", &[JSON], &" ".repeat(size));
    // Spaces are no action, but they are read.
    post(1 << 20).refused(400);
    post((1 << 20) + 1).refused(413);
    post(4 << 20).refused(413);
    // A length that is not told.
    let chunks = |count: usize| {
        let chunk = format!("10000\r\n{}\r\n", " ".repeat(1 << 16));
        let (host, token) = (server.host(), server.token());
        let head = format!("POST /act HTTP/1.1\r\nConnection: close\r\n{host}\r\n{token}\r\n");
        let head = format!("{head}{JSON}\r\nTransfer-Encoding: chunked\r\n\r\n");
        let mut stream = server.connect();
        let all = format!("{head}{}0\r\n\r\n", chunk.repeat(count));
        stream.write_all(all.as_bytes()).unwrap();
        Response::read(&mut stream)
    };
    chunks(16).refused(400);
    chunks(17).refused(413);
    // A length that nobody will wait for.
    let long = ["Content-Length: 1000000000000", JSON];
    for path in ["POST /act", "POST /open"] {
        server.ask(path, &long, "").refused(413);
    }
    server.ask("GET /state", &[], "").answered();
    let session = server.ask("POST /open", &[JSON], &" ".repeat(9 << 20));
    session.refused(400);
}

#[test]
fn every_response_carries_the_protecting_headers() {
    let server = Server::new();
    let host = server.host();
    let responses = [
        (200, server.bare("GET /", &[&host], "")),
        (200, server.ask("GET /state", &[], "")),
        (200, server.ask("POST /act", &[JSON], RELEASE)),
        (401, server.bare("GET /state", &[&host], "")),
        (403, server.bare("GET /", &["Host: evil.example"], "")),
        (403, server.ask("GET /", &["Origin: null"], "")),
        (404, server.ask("GET /nothing", &[], "")),
        (405, server.ask("GET /act", &[], "")),
        (413, server.ask("POST /act", &[JSON], &" ".repeat(2 << 20))),
        (415, server.ask("POST /act", &[], RELEASE)),
    ];
    for (status, response) in responses {
        assert_eq!(response.status, status, "{response:?}");
        let policy = response.header("content-security-policy").unwrap();
        assert!(policy.starts_with("default-src 'none'"), "{policy}");
        for part in [
            "connect-src 'self'",
            "frame-ancestors 'none'",
            "base-uri 'none'",
            "form-action 'none'",
        ] {
            assert!(policy.contains(part), "{policy}");
        }
        for wide in ["unsafe", "*", "http:", "https:"] {
            assert!(!policy.contains(wide), "{policy}");
        }
        for (name, value) in [
            ("x-content-type-options", "nosniff"),
            ("referrer-policy", "no-referrer"),
            ("cross-origin-resource-policy", "same-origin"),
            ("cross-origin-opener-policy", "same-origin"),
            ("cache-control", "no-store"),
            ("x-frame-options", "DENY"),
        ] {
            assert_eq!(response.header(name), Some(value), "{response:?}");
        }
    }
}

#[test]
fn slow_clients_keep_nobody_waiting_and_are_cut_off() {
    let server = Server::new();
    let (host, token) = (server.host(), server.token());
    let head = format!("POST /act HTTP/1.1\r\n{host}\r\n{token}\r\n{JSON}\r\n");
    let starts = [
        String::new(),
        "GET /sta".to_string(),
        head.clone(),
        format!("{head}Content-Length: 9\r\n\r\n{{"),
    ];
    let open = |start: &String| {
        let mut stream = server.connect();
        stream.write_all(start.as_bytes()).unwrap();
        stream
    };
    let mut slow: Vec<TcpStream> = starts.iter().map(open).collect();
    // As many as may be open together but one.
    slow.extend((slow.len()..63).map(|_| open(&starts[1])));
    server.ask("GET /state", &[], "").answered();
    // Nothing comes to those that never finish, or a refusal; either way the connection is closed.
    for mut stream in slow {
        let mut text = String::new();
        let _ = stream.read_to_string(&mut text);
        let status = text.split(' ').nth(1);
        assert!(matches!(status, None | Some("408")), "{text}");
    }
    server.ask("GET /state", &[], "").answered();
}

#[test]
fn clients_that_do_not_read_are_cut_off() {
    let server = Server::new();
    let get = format!("GET / HTTP/1.1\r\n{}\r\n\r\n", server.host()).repeat(200);
    let deaf: Vec<TcpStream> = (0..64)
        .map(|_| {
            let mut stream = server.connect();
            stream.write_all(get.as_bytes()).unwrap();
            stream
        })
        .collect();
    // They have all the places there are, until they lose them.
    server.ask("GET /state", &[], "").answered();
    drop(deaf);
}

#[test]
fn the_server_is_on_loopback_only() {
    let server = Server::new();
    // A server on all interfaces would answer at each address of this machine; 127.0.0.2 is one on
    // Linux.
    assert!(TcpStream::connect(("127.0.0.2", server.port)).is_err());
    let port = format!(":{:04X} ", server.port);
    for table in ["/proc/net/tcp", "/proc/net/tcp6"] {
        let Ok(table) = std::fs::read_to_string(table) else {
            continue;
        };
        // State 0A: listening.
        let listening = |line: &&str| line.split_whitespace().nth(3) == Some("0A");
        for line in table.lines().filter(listening) {
            assert!(!line.contains(&port) || line.contains(&format!("0100007F{port}")));
        }
    }
}

#[test]
fn each_run_has_a_token_of_its_own() {
    let (a, b) = (Server::new(), Server::new());
    for token in [&a.token, &b.token] {
        assert_eq!(token.len(), 32);
        assert!(token.bytes().all(|b| b.is_ascii_hexdigit()));
    }
    assert_ne!(a.token, b.token);
    let (host, token) = (a.host(), b.token());
    a.bare("GET /state", &[&host, &token], "").refused(401);
}

#[cfg(target_os = "linux")]
#[test]
fn the_browser_gets_the_token_by_a_private_file_not_by_arguments() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    let said = folder.path().join("said");
    let opener = folder.path().join("xdg-open");
    let path = |p: &std::path::Path| p.to_str().unwrap().to_string();
    // A browser that notes what it is told, then takes a while.
    let script = format!(
        "#!/bin/sh\necho \"$@\" > '{0}.new'; mv '{0}.new' '{0}'; exec sleep 100\n",
        path(&said)
    );
    std::fs::write(&opener, script).unwrap();
    std::fs::set_permissions(&opener, PermissionsExt::from_mode(0o700)).unwrap();
    let paths = format!("{}:{}", path(folder.path()), std::env::var("PATH").unwrap());
    let mut command = Command::new(bin().join("edit"));
    let command = command.env("PATH", &paths).env("DISPLAY", ":0");
    let server = Server::start(command.env("TMPDIR", folder.path()));
    while !said.exists() {
        std::thread::sleep(Duration::from_millis(10));
    }
    let told = std::fs::read_to_string(&said).unwrap();
    let page = std::path::Path::new(told.trim());
    assert!(page.starts_with(folder.path()), "{told}");
    assert_eq!(page.metadata().unwrap().permissions().mode() & 0o777, 0o600);
    let text = std::fs::read_to_string(page).unwrap();
    let address = format!("http://127.0.0.1:{}/#token={}", server.port, server.token);
    assert!(text.contains(&format!("url={address}\"")), "{text}");
    // Neither the program nor the opener shows the token in the list of processes.
    let mut seen = 0;
    for entry in std::fs::read_dir("/proc").unwrap() {
        let arguments = std::fs::read(entry.unwrap().path().join("cmdline"));
        let arguments = arguments.unwrap_or_default();
        seen += usize::from(arguments.ends_with(b"edit\0"));
        let token = server.token.as_bytes();
        assert!(!arguments.windows(token.len()).any(|w| w == token));
    }
    assert!(seen > 0);
    assert_eq!(server.stop(), Some(0));
    assert!(!page.exists());
}

#[test]
fn without_a_display_or_an_opener_the_address_is_only_printed() {
    let empty = tempfile::tempdir().unwrap();
    let mut command = Command::new(bin().join("edit"));
    command.env_remove("DISPLAY").env_remove("WAYLAND_DISPLAY");
    let server = Server::start(command.env("TMPDIR", empty.path()));
    server.ask("GET /state", &[], "").answered();
    assert_eq!(server.stop(), Some(0));
    let mut command = Command::new(bin().join("edit"));
    command.env("DISPLAY", ":0").env("PATH", empty.path());
    let server = Server::start(command.env("TMPDIR", empty.path()));
    server.ask("GET /state", &[], "").answered();
    assert_eq!(std::fs::read_dir(empty.path()).unwrap().count(), 0);
}

#[test]
fn a_port_that_is_taken_is_told_in_one_line() {
    let server = Server::new();
    let port = server.port.to_string();
    let said = fails("edit", &["--no-open", "--port", &port], b"", 1);
    assert!(said.contains(&format!("port {port}")), "{said}");
    assert!(said.contains("in use") && said.contains("--port"), "{said}");
    assert_eq!(server.stop(), Some(0));
    // Free again at once.
    let mut command = Command::new(bin().join("edit"));
    let server = Server::start(command.args(["--no-open", "--port", &port]));
    assert_eq!(server.port.to_string(), port);
    fails("edit", &["--port", "65536"], b"", 2);
}

#[test]
fn a_signal_ends_the_program_with_success_also_amid_requests() {
    let server = Server::new();
    let mut idle = server.connect();
    let mut half = server.connect();
    half.write_all(b"GET /state HTTP/1.1\r\n").unwrap();
    let head = format!("GET / HTTP/1.1\r\n{}\r\n\r\n", server.host());
    idle.write_all(head.as_bytes()).unwrap();
    assert_eq!(idle.read(&mut [0; 8]).unwrap(), 8);
    assert_eq!(server.stop(), Some(0));
}

// ---- the session ----

impl Server {
    fn post(&self, path: &str, body: &Value) -> Response {
        self.ask(&format!("POST {path}"), &[JSON], &body.to_string())
    }

    fn state(&self) -> Value {
        self.ask("GET /state", &[], "").json()
    }
}

fn place(state: &Value, joint: &str) -> [f64; 3] {
    [0, 1, 2].map(|c| state["pose"][joint][c].as_f64().unwrap())
}

fn apart(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|c| (a[c] - b[c]).powi(2)).sum::<f64>().sqrt()
}

fn example(file: &str) -> String {
    format!("{}/testdata/cmu/07/{file}", env!("CARGO_MANIFEST_DIR"))
}

#[test]
fn bvh_files_have_the_axes_that_are_asked_for() {
    let exported = |flags: &[&str]| {
        let server = Server::with(flags);
        server.post("/solve", &json!({}));
        let file = server.post("/export", &json!({ "format": "bvh" })).body;
        Numbers::read(&run("bvh2xyz", &[&["-q"], flags].concat(), &file))
    };
    let wanted = exported(&[]);
    for flags in [
        &["--up", "z"][..],
        &["--up", "-y", "--units", "m"],
        &["--up", "x", "--left-handed"],
    ] {
        assert!(exported(flags).far(&wanted).0 < 1e-3, "{flags:?}");
    }
}

#[test]
fn a_drag_is_solved_exported_and_read_back() {
    let server = Server::start(Command::new(bin().join("edit")).args([
        "--no-open",
        "--skeleton",
        &example("07.asf"),
    ]));
    let first = server.state();
    let pins = json!({ "lfoot": place(&first, "lfoot"), "rfoot": place(&first, "rfoot") });
    let mut target = place(&first, "lwrist");
    let mut last = Value::Null;
    for _ in 0..20 {
        target[1] += 1.0;
        let drags = json!({ "lwrist": { "xyz": target, "sd": 0.5 } });
        last = server
            .post("/solve", &json!({ "pins": pins, "drags": drags }))
            .json();
    }
    assert!(apart(place(&last, "lwrist"), target) < 0.5);
    assert!(apart(place(&last, "lfoot"), place(&first, "lfoot")) < 0.001);
    let folder = tempfile::tempdir().unwrap();
    for (format, reader) in [("bvh", "bvh2xyz"), ("amc", "amc2xyz"), ("csv", "plot")] {
        let file = server.post("/export", &json!({ "format": format }));
        assert_eq!(file.status, 200, "{file:?}");
        let path = folder.path().join(format!("pose.{format}"));
        std::fs::write(&path, &file.body).unwrap();
        let path = text(&path);
        let table = match format {
            "bvh" => run(reader, &["--ends", path], ""),
            "amc" => run(
                reader,
                &["--asf", &example("07.asf"), "--fps", "30", path],
                "",
            ),
            _ => file.body.clone(),
        };
        let numbers = Numbers::read(&table);
        let wrist = numbers.points.iter().position(|p| p == "lwrist").unwrap();
        let at = [0, 1, 2].map(|c| numbers.rows[0][3 * wrist + c]);
        assert!(apart(at, place(&last, "lwrist")) < 0.01, "{format}: {at:?}");
    }
    let csv = server.post("/export", &json!({ "format": "csv" })).body;
    let lines: Vec<Vec<&str>> = csv.lines().map(|l| l.split(',').collect()).collect();
    let wrist = lines[0].iter().position(|n| *n == "lwrist.z").unwrap();
    assert_eq!(
        lines[0][wrist + 1..wrist + 3],
        ["lwrist.status", "lwrist.sd"]
    );
    for (name, status) in lines[0].iter().zip(&lines[1]) {
        if let Some(joint) = name.strip_suffix(".status") {
            let is_pinned = pins.get(joint).is_some();
            assert_eq!(*status, if is_pinned { "observed" } else { "inferred" });
        }
    }
}

#[test]
fn a_refused_request_changes_nothing() {
    let server = Server::new();
    let before = server.state();
    for (path, body) in [
        (
            "/solve",
            json!({ "drags": { "nose": { "xyz": [0, 0, 0] } } }),
        ),
        (
            "/solve",
            json!({ "drags": { "lwrist": { "xyz": [0, 0, 1e308] } } }),
        ),
        (
            "/solve",
            json!({ "drags": { "lwrist": { "xyz": [0, 0, 0], "sd": -1 } } }),
        ),
        ("/solve", json!({ "pins": { "lwrist": [0, 0] } })),
        ("/solve", json!({ "rest": 0 })),
        ("/solve", json!({ "wrong": 1 })),
        ("/act", json!({ "do": "fly" })),
        ("/act", json!({ "do": "start", "start": 1000 })),
        ("/act", json!({ "do": "row", "row": 0 })),
        ("/act", json!({ "do": "take", "solution": 0 })),
        ("/act", json!({ "do": "key", "time": -1 })),
        ("/act", json!({ "do": "key-open", "key": 0 })),
        (
            "/act",
            json!({ "do": "pin-here", "joints": ["lwrist"], "axes": "q" }),
        ),
        ("/act", json!({ "do": "rate", "fps": 0 })),
        (
            "/photograph",
            json!({ "marks": { "head": [1, 2] }, "size": [0, 9] }),
        ),
        ("/export", json!({ "format": "amc" })),
        ("/export", json!({ "format": "../x" })),
        ("/export", json!({ "format": "bvh", "keys": true })),
        ("/open", json!({ "format": "posing session 1" })),
    ] {
        server.post(path, &body).refused(400);
    }
    assert_eq!(server.state(), before);
}

#[test]
fn a_session_file_goes_on_where_it_ended() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("pose.json");
    let start = || {
        Server::start(Command::new(bin().join("edit")).args([
            "--no-open",
            "--session",
            text(&file),
        ]))
    };
    let server = start();
    let head = place(&server.state(), "head");
    let drags = json!({ "head": { "xyz": [head[0] + 9.0, head[1] - 4.0, head[2]] } });
    server
        .post(
            "/act",
            &json!({ "do": "pin-here", "joints": ["lfoot", "rfoot"], "axes": "xz" }),
        )
        .answered();
    let pins = server.state()["pins"].clone();
    server
        .post("/solve", &json!({ "drags": drags, "pins": pins }))
        .answered();
    server
        .post("/act", &json!({ "do": "key", "time": 0.5 }))
        .answered();
    // A drag that is not released is kept, too.
    let wrist = place(&server.state(), "rwrist");
    let drags = json!({ "rwrist": { "xyz": [wrist[0], wrist[1] + 5.0, wrist[2]] } });
    server
        .post("/solve", &json!({ "drags": drags, "pins": pins }))
        .answered();
    let last = server.state();
    assert_eq!(server.stop(), Some(0));
    let again = start().state();
    for what in [
        "pose", "pins", "sd", "missed", "keys", "rest", "floor", "rate",
    ] {
        assert_eq!(again[what], last[what], "{what}");
    }
    assert_eq!(again["session"], json!("pose.json"));
    std::fs::write(&file, "{}").unwrap();
    let message = fails("edit", &["--no-open", "--session", text(&file)], b"", 1);
    assert!(message.contains("pose.json: is no session"), "{message}");
}

#[test]
fn a_session_file_is_open_in_one_program_at_a_time() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("pose.json");
    let flags = ["--no-open", "--session", text(&file)];
    let first = Server::with(&flags[1..]);
    let message = fails("edit", &flags, b"", 1);
    assert!(
        message.contains("pose.json: is open in another posing edit"),
        "{message}"
    );
    // Killed: it cannot tidy up.
    drop(first);
    let again = Server::with(&flags[1..]);
    again
        .post("/act", &json!({ "do": "key", "time": 0 }))
        .answered();
    assert_eq!(again.stop(), Some(0));
    let left: Vec<_> = std::fs::read_dir(folder.path()).unwrap().collect();
    assert_eq!(left.len(), 1, "{left:?}");
}

#[test]
fn a_session_that_cannot_be_kept_is_refused_at_the_start() {
    let folder = tempfile::tempdir().unwrap();
    let nowhere = folder.path().join("none/pose.json");
    let message = fails("edit", &["--no-open", "--session", text(&nowhere)], b"", 1);
    assert!(message.contains("none/pose.json: "), "{message}");
    let message = fails(
        "edit",
        &["--no-open", "--session", text(folder.path())],
        b"",
        1,
    );
    assert!(message.contains("is no file"), "{message}");
}

#[test]
fn rows_of_a_table_and_joints_of_a_map_are_posed() {
    let folder = tempfile::tempdir().unwrap();
    let table = run(
        "amc2xyz",
        &[
            "--asf",
            &example("07.asf"),
            "--fps",
            "120",
            &example("07_01.amc"),
        ],
        "",
    );
    let walk = folder.path().join("walk.csv");
    std::fs::write(&walk, &table).unwrap();
    let server = Server::start(Command::new(bin().join("edit")).args(["--no-open", text(&walk)]));
    let numbers = Numbers::read(&table);
    assert_eq!(server.state()["rows"], json!(numbers.rows.len()));
    let state = server
        .post("/act", &json!({ "do": "row", "row": 100 }))
        .json();
    let head = numbers.points.iter().position(|p| p == "head").unwrap();
    let at = [0, 1, 2].map(|c| numbers.rows[100][3 * head + c]);
    assert!(apart(place(&state, "head"), at) < 0.5);
    drop(server);

    // A rig of other names: joints stand at the starts of bones, so that a wrist is where the hand
    // starts.
    let bvh = run("xyz2bvh", &[text(&walk)], "")
        .replace("lwrist", "LeftHand")
        .replace("rwrist", "RightHand");
    let rig = folder.path().join("rig.bvh");
    std::fs::write(&rig, bvh).unwrap();
    let map = folder.path().join("map.toml");
    std::fs::write(&map, "lradius = \"LeftHand\"\nrradius = \"RightHand\"\nltibia = \"lfoot\"\nrtibia = \"rfoot\"\nroot = \"root\"\nhead = \"head_end\"\n").unwrap();
    let flags = ["--no-open", "--skeleton", text(&rig), "--map", text(&map)];
    let server = Server::start(Command::new(bin().join("edit")).args(flags));
    let hand = place(&server.state(), "LeftHand");
    let drags = json!({ "LeftHand": { "xyz": [hand[0], hand[1] + 6.0, hand[2]] } });
    let moved = server.post("/solve", &json!({ "drags": drags })).json();
    assert!((place(&moved, "LeftHand")[1] - hand[1] - 6.0).abs() < 0.5);
    drop(server);
    std::fs::write(&map, "root = \"Hips\"\n").unwrap();
    let message = fails("edit", &flags, b"", 2);
    assert!(message.contains("joint \"Hips\""), "{message}");
}
