//! Access to a page: own TLS, tokens of people, and proxies in front.

use std::env;
use std::fs;
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use rcgen::{CertifiedKey, KeyPair, PublicKeyData, generate_simple_self_signed};
use rustls::crypto::ring;
use rustls::{ClientConfig, ClientConnection, RootCertStore, StreamOwned};
use serde_json::{Value, json};
use sha2::{Digest, Sha256};
use trimaran_scene::Scene;

use crate::common::page::{Browser, Difference, Service, TOKEN, difference};
use crate::common::program::{Bench, printed, said, signal};

/// The name under which pages are opened.
const NAME: &str = "plant.example";
/// The longest wait for something that a test waits for.
const TIMEOUT: Duration = Duration::from_secs(60);

/// A certificate for `plant.example`, with its private key.
struct Certificate {
    made: CertifiedKey<KeyPair>,
    /// SHA-256 of its public key: Chromium takes this certificate and no other unknown one.
    key: String,
}

impl Certificate {
    fn new() -> Self {
        let made = generate_simple_self_signed([NAME.to_owned(), "localhost".to_owned()]).unwrap();
        let key = BASE64_STANDARD.encode(Sha256::digest(made.signing_key.subject_public_key_info()));
        Self { made, key }
    }

    /// Writes it to the files `plant.pem` and `plant.key`.
    fn install(&self, bench: &Bench) {
        bench.write("plant.pem", self.made.cert.pem());
        bench.write("plant.key", self.made.signing_key.serialize_pem());
    }

    /// The answer to a request over TLS, or why this certificate was not shown.
    fn ask(&self, port: &str, target: &str, headers: &str, body: &str) -> std::io::Result<String> {
        let mut trusted = RootCertStore::empty();
        trusted.add(self.made.cert.der().clone()).unwrap();
        let config = ClientConfig::builder_with_provider(Arc::new(ring::default_provider()))
            .with_safe_default_protocol_versions()
            .unwrap()
            .with_root_certificates(trusted)
            .with_no_client_auth();
        let client = ClientConnection::new(Arc::new(config), NAME.try_into().unwrap()).unwrap();
        let mut stream = StreamOwned::new(client, TcpStream::connect(format!("127.0.0.1:{port}"))?);
        let method = if body.is_empty() { "GET" } else { "POST" };
        write!(
            stream,
            "{method} {target} HTTP/1.1\r\nHost: {NAME}:{port}\r\nConnection: close\r\n\
             Content-Length: {}\r\n{headers}\r\n{body}",
            body.len()
        )?;
        let mut answer = Vec::new();
        match stream.read_to_end(&mut answer) {
            // It may close without a close of TLS.
            Err(e) if e.kind() != std::io::ErrorKind::UnexpectedEof => Err(e),
            _ => Ok(String::from_utf8_lossy(&answer).into_owned()),
        }
    }
}

/// A browser that finds `plant.example` on this machine, and takes these certificates.
fn browser(known: &[&Certificate]) -> Option<Browser> {
    let keys: Vec<&str> = known.iter().map(|certificate| &*certificate.key).collect();
    let known = format!("--ignore-certificate-errors-spki-list={}", keys.join(","));
    Browser::with_flags(&[&format!("--host-resolver-rules=MAP {NAME} 127.0.0.1"), &known])
}

/// The body of an answer, as JSON.
fn body(answer: &str) -> Value {
    let (head, body) = answer.split_once("\r\n\r\n").unwrap_or_else(|| panic!("{answer}"));
    assert!(head.starts_with("HTTP/1.1 200"), "{answer}");
    serde_json::from_str(body).unwrap_or_else(|e| panic!("{e}: {answer}"))
}

/// The message of a page that calls itself by this name.
fn here(page: &str) -> String {
    json!({ "page": page, "pose": { "eye": [0, 0, 0], "forward": [0, 0, -1], "vfovDeg": 60 } }).to_string()
}

/// A new token of this name, and its entry for a file.
fn new_token(bench: &Bench, name: &str, until: &[&str]) -> (String, String) {
    let output = bench.trimaran(&[&["token", "new", name][..], until].concat());
    let (entry, told) = (printed(&output), said(&output));
    let token = told.trim().rsplit(' ').next().unwrap().to_owned();
    assert!(token.len() == 32 && !entry.contains(&token), "{told} {entry}");
    (token, entry)
}

fn sees_the_scene(browser: &mut Browser, url: &str, scene: &Scene) {
    assert_eq!(browser.done(json!({ "do": "open", "url": url })), 200, "{url}");
    browser.done(json!({ "do": "settle" }));
    let look = browser.done(json!({ "do": "look" }));
    let Difference { drawables, seen, .. } = difference(&look, scene);
    assert!(seen > 5 && drawables.is_empty(), "{url}: {seen} {drawables:?}");
}

/// Waits until this holds, and returns how long that took.
fn until(what: &str, mut holds: impl FnMut() -> bool) -> Duration {
    let begun = Instant::now();
    while !holds() {
        assert!(begun.elapsed() < TIMEOUT, "{what} does not come about");
        thread::sleep(Duration::from_millis(50));
    }
    begun.elapsed()
}

/// The tokens of people, the certificate, and both anew: a page and a display over TLS.
#[test]
fn people_come_over_tls_with_tokens_of_their_own() {
    let bench = Bench::with_plant(100);
    let (certificate, renewed) = (Certificate::new(), Certificate::new());
    certificate.install(&bench);
    let (ada, entry_of_ada) = new_token(&bench, "Ada", &[]);
    let (bob, entry_of_bob) = new_token(&bench, "Bob", &["--until", "2100-01-01"]);
    bench.write("plant.tokens", [&*entry_of_ada, &entry_of_bob].concat());
    let serve = ["serve", "plant.scene", "--listen", "127.0.0.1:0", "--tokens", "plant.tokens"];
    let tls = ["--tls-cert", "plant.pem", "--tls-key", "plant.key"];
    let Some(service) = Service::by(bench.command(&[&serve[..], &tls].concat())) else { return };
    assert_eq!(service.printed, format!("https://{}/?token=TOKEN", service.at));
    let port = service.at.rsplit(':').next().unwrap();
    let ask = |certificate: &Certificate, token: &str| {
        certificate.ask(port, &format!("/scene?token={token}"), "", "")
    };
    for wrong in ["TOKEN", "", "0123456789abcdef0123456789abcdef"] {
        assert!(ask(&certificate, wrong).unwrap().starts_with("HTTP/1.1 403"), "{wrong}");
    }
    assert!(ask(&certificate, &ada).unwrap().starts_with("HTTP/1.1 200"));

    // A display comes over TLS as well, and checks the certificate.
    bench.done(&["run", "plant.scene", "--frames", "3", "--audit-every", "0", "--out", "whole"]);
    let culler = format!("wss://localhost:{port}/link?token={bob}");
    let display =
        ["role", "display", "--scene", "plant.scene", "--empty-display", "true", "--cullers", &culler];
    let walk = ["--path", "whole/report.json", "--audit-every", "2", "--out", "there"];
    bench.done(&[&display[..], &walk, &["-o", "ws.ca=plant.pem"]].concat());
    assert_eq!(bench.report("there")["summary"]["cut_mismatch_pixels_total"], 0);
    let refused = bench.trimaran(&["ping", &culler, "--timeout", "1"]);
    assert!(!refused.status.success() && said(&refused).contains("certificate"), "{}", said(&refused));

    let Some(mut browser) = browser(&[&certificate, &renewed]) else { return };
    let scene = Scene::open(&bench.path("plant.scene")).unwrap();
    sees_the_scene(&mut browser, &format!("https://{NAME}:{port}/?token={ada}"), &scene);
    // Bob learns who else is there.
    let people = certificate.ask(port, &format!("/people?token={bob}"), "", &here("a")).unwrap();
    assert_eq!(body(&people)["others"][0]["name"], "Ada", "{people}");

    // A broken file changes nothing.
    let hang_up = || signal("HUP", &service.process().to_string());
    renewed.install(&bench);
    bench.write("plant.tokens", "[[token]]\nname = 'Ada'\n");
    hang_up();
    until("the new certificate", || ask(&renewed, &bob).is_ok());
    assert!(ask(&certificate, &bob).is_err());
    assert!(ask(&renewed, &ada).unwrap().starts_with("HTTP/1.1 200"), "the tokens stay as they were");

    // Her token is removed: her page is told, and his goes on.
    bench.write("plant.tokens", &entry_of_bob);
    hang_up();
    let status = |browser: &mut Browser| {
        let status = browser.tell(json!({ "do": "status" }))["answer"].take();
        status.as_str().unwrap_or_default().contains("token")
    };
    let took = until("the end of a removed token", || status(&mut browser));
    println!("the links of a removed token have ended after {took:?}");
    assert!(ask(&renewed, &ada).unwrap().starts_with("HTTP/1.1 403"));
    assert!(ask(&renewed, &bob).unwrap().starts_with("HTTP/1.1 200"));

    // A token ends by itself.
    let seconds = humantime::format_rfc3339_seconds(std::time::SystemTime::now() + Duration::from_secs(2));
    let (eve, entry) = new_token(&bench, "Eve", &["--until", &seconds.to_string()]);
    bench.write("plant.tokens", entry);
    hang_up();
    until("the end of his token", || ask(&renewed, &bob).unwrap().starts_with("HTTP/1.1 403"));
    until("the end of her token", || ask(&renewed, &eve).unwrap().starts_with("HTTP/1.1 403"));
    let told = service.said();
    assert!(told.contains("the tokens stay as they were") && told.contains("plant.tokens"), "{told}");
    assert!(![ada, bob, eve].iter().any(|token| told.contains(&**token)), "{told}");
}

/// Headers count from the addresses of proxies, and from nowhere else.
#[test]
fn headers_of_proxies_count_from_proxies_alone() {
    let bench = Bench::with_plant(60);
    bench.write("token", format!("{TOKEN}\n"));
    let serve = |trusted: &str| {
        let serve = ["serve", "plant.scene", "--listen", "127.0.0.1:0", "--token-file", "token"];
        let proxies = ["--trusted-proxies", trusted, "--proxy-header", "X-Forwarded-User"];
        let mut command = bench.command(&[&serve[..], &proxies].concat());
        command.env("TRIMARAN_LOG", "info");
        Service::by(command)
    };
    let headers = "X-Forwarded-Host: plant.example:8443\r\nX-Forwarded-Proto: https\r\n\
                   X-Forwarded-For: 203.0.113.9\r\nX-Forwarded-User: Ada\r\n";
    let upgrade = "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n\
                   Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nOrigin: https://plant.example:8443\r\n";
    for (trusted, counts) in [("127.0.0.1", true), ("192.0.2.1,10.0.0.0/8", false)] {
        let Some(service) = serve(trusted) else { return };
        assert_eq!(service.printed, format!("http://{}/?token={TOKEN}", service.at));
        let status = |counts| if counts { "HTTP/1.1 200" } else { "HTTP/1.1 403" };
        let page = service.ask_as("plant.example", "/", headers);
        assert!(page.starts_with(status(counts)), "{trusted}: {page}");
        let link = service.status(&format!("/link?token={TOKEN}"), &format!("{upgrade}{headers}"));
        assert!(link.starts_with(if counts { "HTTP/1.1 101" } else { "HTTP/1.1 403" }), "{trusted}: {link}");
        // A name opens nothing.
        for target in ["/scene", "/scene?token=Ada"] {
            assert!(service.ask(target, headers).starts_with("HTTP/1.1 403"), "{target}");
        }
        body(&service.ask(&format!("/scene?token={TOKEN}"), headers));
        let meet = |page: &str, headers: &str| {
            let mut stream = TcpStream::connect(&service.at).unwrap();
            let here = here(page);
            let asked = format!("POST /people?token={TOKEN} HTTP/1.1\r\nHost: {}\r\n", service.at);
            let rest = format!("Connection: close\r\nContent-Length: {}\r\n{headers}\r\n{here}", here.len());
            stream.write_all(format!("{asked}{rest}").as_bytes()).unwrap();
            let mut answer = String::new();
            stream.read_to_string(&mut answer).unwrap();
            body(&answer)
        };
        meet("a", headers);
        let company = meet("b", "");
        let name = company["others"][0].get("name").and_then(Value::as_str);
        assert_eq!(name, counts.then_some("Ada"), "{trusted}: {company}");
        let told = service.said();
        assert!(told.contains("opens the page"), "{told}");
        assert_eq!((told.contains("203.0.113.9"), told.contains("Ada")), (counts, counts), "{told}");
    }
}

/// A proxy that runs until it is dropped.
struct Proxy(Child);

impl Drop for Proxy {
    fn drop(&mut self) {
        let _ended = self.0.kill();
        let _code = self.0.wait();
    }
}

/// The example of a proxy's configuration, for this service and this port.
fn example(name: &str, replaced: &[(&str, &str)]) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("deploy/proxies").join(name);
    let example = fs::read_to_string(path).unwrap();
    replaced.iter().fold(example, |text, (from, to)| {
        assert!(text.contains(from), "{name} has no {from}");
        text.replace(from, to)
    })
}

fn nginx(bench: &Bench, service: &str, port: &str) -> Command {
    let [certificate, key, log, folder] =
        ["plant.pem", "plant.key", "nginx.log", ""].map(|name| bench.path(name).display().to_string());
    let server = example(
        "nginx.conf",
        &[
            ("listen 443 ssl;", &format!("listen 127.0.0.1:{port} ssl;")),
            ("/etc/ssl/certs/plant.pem", &certificate),
            ("/etc/ssl/private/plant.key", &key),
            ("/var/log/nginx/trimaran.log", &log),
            ("proxy_pass http://127.0.0.1:7480", &format!("proxy_pass http://{service}")),
        ],
    );
    let kept = ["client_body", "proxy", "fastcgi", "uwsgi", "scgi"]
        .map(|kind| format!("{kind}_temp_path {folder}/{kind};\n"))
        .concat();
    // One process: workers would outlive a master that is killed.
    let main = format!(
        "daemon off;\nmaster_process off;\npid {folder}/nginx.pid;\nerror_log stderr;\nevents {{}}\n\
         http {{\n{kept}{server}}}\n"
    );
    bench.write("nginx.conf", main);
    let config = bench.path("nginx.conf").display().to_string();
    bench.command_of("nginx", &["-e", "stderr", "-p", &folder, "-c", &config])
}

fn caddy(bench: &Bench, service: &str, port: &str) -> Command {
    let [certificate, key] = ["plant.pem", "plant.key"].map(|name| bench.path(name).display().to_string());
    let site = example(
        "Caddyfile",
        &[
            ("plant.example {", &format!("plant.example:{port} {{")),
            (
                "# tls /etc/ssl/certs/plant.pem /etc/ssl/private/plant.key",
                &format!("tls {certificate} {key}"),
            ),
            ("reverse_proxy 127.0.0.1:7480", &format!("reverse_proxy {service}")),
        ],
    );
    bench.write("Caddyfile", format!("{{\nadmin off\nauto_https disable_redirects\n}}\n{site}"));
    let mut command = bench.command_of("caddy", &["run", "--config", "Caddyfile", "--adapter", "caddyfile"]);
    // It keeps its state there.
    command
        .env("HOME", bench.path(""))
        .env("XDG_DATA_HOME", bench.path(""))
        .env("XDG_CONFIG_HOME", bench.path(""));
    command
}

/// A port that is free, or 443 if that is.
fn port(wanted: u16) -> Option<String> {
    let free = TcpListener::bind(("127.0.0.1", wanted)).ok()?;
    Some(free.local_addr().unwrap().port().to_string())
}

/// Chromium walks through the examples of `deploy/proxies`, at 443 and at another port.
#[test]
fn a_browser_comes_through_proxies() {
    let bench = Bench::with_plant(100);
    let certificate = Certificate::new();
    certificate.install(&bench);
    let mut serve = bench.command(&["serve", "plant.scene", "--listen", "127.0.0.1:0", "--token", TOKEN]);
    serve.args(["--trusted-proxies", "127.0.0.1", "--proxy-header", "X-Forwarded-User"]);
    let Some(service) = Service::by(serve) else { return };
    let Some(mut browser) = browser(&[&certificate]) else { return };
    let scene = Scene::open(&bench.path("plant.scene")).unwrap();
    let (mut walked, mut skipped) = (0, Vec::new());
    type Start = fn(&Bench, &str, &str) -> Command;
    for (name, start) in [("nginx", nginx as Start), ("caddy", caddy as Start)] {
        for wanted in [443, 0] {
            let Some(port) = port(wanted) else {
                skipped.push(format!("{name} at {wanted}: the port is not free here"));
                continue;
            };
            let mut command = start(&bench, &service.at, &port);
            let spawned = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn();
            let Ok(child) = spawned else {
                skipped.push(format!("{name} is not installed"));
                continue;
            };
            let _proxy = Proxy(child);
            let scene_of = format!("/scene?token={TOKEN}");
            until(name, || certificate.ask(&port, &scene_of, "", "").is_ok());
            let host = if port == "443" { NAME.to_owned() } else { format!("{NAME}:{port}") };
            sees_the_scene(&mut browser, &format!("https://{host}/?token={TOKEN}"), &scene);
            // A client cannot give itself a name.
            let people = format!("/people?token={TOKEN}");
            let claimed = "X-Forwarded-User: Mallory\r\n";
            certificate.ask(&port, &people, claimed, &here("mallory")).unwrap();
            let company = body(&certificate.ask(&port, &people, "", &here("b")).unwrap());
            assert!(!company.to_string().contains("\"name\""), "{name}: {company}");
            // A page whose proxy goes away would complain.
            browser.done(json!({ "do": "open", "url": "about:blank" }));
            walked += 1;
        }
    }
    let log = fs::read_to_string(bench.path("nginx.log")).unwrap_or_default();
    assert!(!log.contains(TOKEN), "{log}");
    println!("through {walked} proxies; skipped: {skipped:?}");
    assert!(
        skipped.is_empty() || env::var_os("TRIMARAN_REQUIRE_PROXIES").is_none(),
        "{skipped:?}: install nginx and caddy"
    );
}
