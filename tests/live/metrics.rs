//! `watch --metrics`: metrics over HTTP.

use super::exposition::{Page, parse};
use super::sessions::tangle;
use super::*;
use std::io::{ErrorKind, Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::time::Instant;

/// Starts a watch that serves metrics at a free port. Returns the address as well.
fn start(folder: &TempDir, service: &str, args: &[&str]) -> (Watch, String) {
    let args = [&["--metrics", "0"], args].concat();
    let watch = Watch::start(folder.path(), "watch", service, &args);
    let log = stderr_with(&watch, &["/metrics\n", "waiting for a simulator"]);
    let (_, rest) = log.split_once("metrics are at http://").unwrap();
    let (address, _) = rest.split_once("/metrics\n").unwrap();
    let address = address.to_owned();
    (watch, address)
}

fn connect(address: &str) -> TcpStream {
    let stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    stream.set_write_timeout(Some(PATIENCE)).unwrap();
    stream
}

/// Returns what the watch sends until it closes the connection.
fn answer(mut stream: TcpStream) -> String {
    let mut answer = Vec::new();
    match stream.read_to_end(&mut answer) {
        Err(e) if e.kind() != ErrorKind::ConnectionReset => panic!("{e}"),
        _ => String::from_utf8(answer).unwrap(),
    }
}

/// Sends a request. Returns the answer.
fn request(address: &str, request: &str) -> String {
    let mut stream = connect(address);
    stream.write_all(request.as_bytes()).unwrap();
    answer(stream)
}

/// Returns the page of metrics, which must follow the format.
#[track_caller]
pub fn scrape(address: &str) -> Page {
    let answer = request(
        address,
        "GET /metrics HTTP/1.1\r\nHost: linkwatch\r\nUser-Agent: test\r\n\r\n",
    );
    let (head, body) = answer.split_once("\r\n\r\n").expect("a head");
    assert!(head.starts_with("HTTP/1.1 200 OK\r\n"), "{head}");
    assert!(
        head.contains("Content-Type: text/plain; version=0.0.4; charset=utf-8"),
        "{head}"
    );
    assert!(
        head.contains(&format!("Content-Length: {}", body.len())),
        "{head}"
    );
    parse(body).unwrap_or_else(|why| panic!("{why}\n{body}"))
}

/// Returns a figure of a service.
#[track_caller]
pub fn figure(page: &Page, name: &str, service: &str) -> f64 {
    let value = page.get(name, &[("service", service)]);
    value.unwrap_or_else(|| panic!("no {name}: {page:?}"))
}

/// Returns the verdicts whose gauge is 1.
fn verdicts_shown(page: &Page, service: &str) -> Vec<String> {
    let of = page.of("linkwatch_verdict");
    let of = of.filter(|(labels, value)| labels["service"] == service && *value == 1.0);
    of.map(|(labels, _)| labels["verdict"].clone()).collect()
}

/// Asserts that `docs/reference/metrics.md` lists the families of a page, and their types.
fn assert_documented(page: &Page) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/reference/metrics.md");
    let documented = std::fs::read_to_string(path).unwrap();
    let rows = documented.lines().filter_map(|line| {
        let (name, rest) = line.strip_prefix("| `")?.split_once("` | ")?;
        let (kind, _) = rest.split_once(" | ")?;
        Some((name.to_owned(), kind.to_owned()))
    });
    let mut rows: std::collections::BTreeMap<String, String> = rows.collect();
    if cfg!(not(target_os = "linux")) {
        rows.remove("process_resident_memory_bytes");
    }
    assert_eq!(rows, page.types);
}

#[test]
fn counters_equal_the_summaries_of_all_sessions() {
    let folder = TempDir::new().unwrap();
    let service = service("metrics");
    let recording = folder.path().join("run.mcap");
    let record = [
        "--keep-watching",
        "--events",
        "--record",
        recording.to_str().unwrap(),
    ];
    // Published before a watcher starts, so most of these frames are skipped.
    let mut sim = client(&service);
    for frame in 0..5 {
        sim.publish(frame as f64, Positions::F32(&squares(0.0)))
            .unwrap();
    }
    let (watch, address) = start(&folder, &service, &record);
    assert!(sim.wait_for_watcher(PATIENCE).unwrap());
    assert_eq!(step(&mut sim, 5, 0.0), Verdict::Intact);
    assert_eq!(step(&mut sim, 6, 2.5), Verdict::Changed);
    assert_eq!(step(&mut sim, 7, f32::NAN), Verdict::Rejected);
    // A page may contain the count of a frame, but not yet its verdict.
    let during = until("the last frame", || {
        let page = scrape(&address);
        let counted = figure(&page, "linkwatch_frames_rejected_total", &service) == 1.0;
        (counted && verdicts_shown(&page, &service) == ["rejected"]).then_some(page)
    });
    assert_eq!(
        figure(&during, "linkwatch_simulator_connected", &service),
        1.0
    );
    assert_eq!(figure(&during, "linkwatch_last_frame", &service), 6.0);
    sim.finish_within(PATIENCE).unwrap().expect("a goodbye");

    let mut sim = client(&service);
    assert!(sim.wait_for_watcher(PATIENCE).unwrap());
    for frame in 0..3 {
        assert_eq!(step(&mut sim, frame, 0.0), Verdict::Intact);
    }
    assert_eq!(step(&mut sim, 3, 2.5), Verdict::Changed);
    sim.finish_within(PATIENCE).unwrap().expect("a goodbye");
    let lines = until("two summaries", || {
        let lines = std::fs::read_to_string(&watch.stdout).unwrap();
        (lines.matches("\"summary\":").count() == 2 && lines.ends_with('\n')).then_some(lines)
    });
    let page = scrape(&address);
    watch.signal("TERM");
    let ended = watch.end();
    assert_eq!(ended.code, Some(1), "{}", ended.stderr);
    assert_eq!(ended.summaries().len(), 2, "{lines}");

    let sum = |pointer: &str| {
        let of = |line: &Value| line.pointer(pointer).and_then(Value::as_f64).unwrap();
        ended.summaries().into_iter().map(of).sum::<f64>()
    };
    for count in ["verified", "skipped", "rejected"] {
        let name = format!("linkwatch_frames_{count}_total");
        assert_eq!(
            figure(&page, &name, &service),
            sum(&format!("/summary/{count}")),
            "{count}"
        );
    }
    assert!(sum("/summary/skipped") > 0.0, "{lines}");
    let unresolved = "linkwatch_unresolved_pull_throughs_total";
    let expected = sum("/summary/unresolved/pull_throughs");
    assert_eq!(figure(&page, unresolved, &service), expected);
    let dropped = "linkwatch_output_frames_dropped_total";
    let labels = [("output", "recording"), ("service", service.as_str())];
    assert_eq!(
        page.get(dropped, &labels),
        Some(sum("/summary/sinks/0/dropped"))
    );

    let reports = ended.reports();
    for (labels, counted) in page.of("linkwatch_verdicts_total") {
        let verdict = labels["verdict"].as_str();
        let of = reports.iter().filter(|report| report["verdict"] == verdict);
        assert_eq!(counted, of.count() as f64, "{verdict}");
    }
    let found = |key: &str| {
        let of = reports
            .iter()
            .map(|report| report[key].as_array().map_or(0, Vec::len));
        of.sum::<usize>() as f64
    };
    assert!(found("events") > 0.0, "{lines}");
    assert_eq!(
        figure(&page, "linkwatch_pull_throughs_total", &service),
        found("events")
    );
    let aborts = reports
        .iter()
        .filter(|report| report["abort"] == true)
        .count();
    assert_eq!(
        figure(&page, "linkwatch_aborts_total", &service),
        aborts as f64
    );
    assert_eq!(figure(&page, "linkwatch_changed_links", &service), 1.0);
    assert_eq!(figure(&page, "linkwatch_last_frame", &service), 3.0);
    assert_eq!(verdicts_shown(&page, &service), ["changed"]);
    assert_eq!(figure(&page, "linkwatch_sessions_total", &service), 2.0);
    assert_eq!(
        figure(&page, "linkwatch_simulator_connected", &service),
        0.0
    );

    // The latency covers the stages that the lines of the frames report.
    let verified = ended.lines.iter().filter(|line| {
        line.get("report")
            .is_some_and(|report| report["verdict"] != "rejected")
    });
    let seconds = verified.clone().map(|line| {
        let of = |stage: &str| line["times_ms"][stage].as_f64().unwrap_or(0.0) / 1e3;
        of("ingest") + of("verification") + of("send")
    });
    let (checks, slowest) = (seconds.clone().sum::<f64>(), seconds.fold(0.0, f64::max));
    let latency = |part: &str| format!("linkwatch_verdict_latency_seconds_{part}");
    assert_eq!(
        figure(&page, &latency("count"), &service),
        verified.count() as f64
    );
    assert!(
        figure(&page, &latency("sum"), &service) >= checks * (1.0 - 1e-9),
        "{lines}"
    );
    for (labels, below) in page.of(&latency("bucket")) {
        if labels["le"]
            .parse::<f64>()
            .is_ok_and(|bound| bound < slowest)
        {
            assert!(
                below < figure(&page, &latency("count"), &service),
                "{labels:?}"
            );
        }
    }
    assert_documented(&page);
    let version = [("version", env!("CARGO_PKG_VERSION"))];
    assert_eq!(page.get("linkwatch_build_info", &version), Some(1.0));
    if cfg!(target_os = "linux") {
        let memory = page.get("process_resident_memory_bytes", &[]).unwrap();
        assert!((1e6..1e9).contains(&memory), "{memory}");
    }
}

#[test]
fn metrics_escape_the_name_of_the_service() {
    let folder = TempDir::new().unwrap();
    let service = service("metrics-\"two\\n");
    let (watch, address) = start(&folder, &service, &["--events=off"]);
    let mut sim = client(&service);
    assert!(sim.wait_for_watcher(PATIENCE).unwrap());
    assert_eq!(step(&mut sim, 0, 0.0), Verdict::Intact);
    assert_eq!(step(&mut sim, 1, 2.5), Verdict::Changed);
    until("all frames", || {
        let page = scrape(&address);
        let verified = figure(&page, "linkwatch_frames_verified_total", &service);
        // With --events=off, no count of pull-throughs claims that there were none.
        assert!(
            !page.types.contains_key("linkwatch_pull_throughs_total"),
            "{page:?}"
        );
        (verified == 2.0 && verdicts_shown(&page, &service) == ["changed"]).then_some(())
    });
    sim.finish().unwrap();
    assert_eq!(watch.end().code, Some(1));
}

#[test]
fn bad_addresses_of_metrics_are_refused_before_anything_starts() {
    let folder = TempDir::new().unwrap();
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = taken.local_addr().unwrap().port().to_string();
    let recording = folder.path().join("run.mcap");
    let in_use = format!("--metrics 127.0.0.1:{port}: ");
    for (address, expected) in [
        (port.as_str(), &[in_use.as_str(), "give another port"][..]),
        // An address that is reserved for documentation.
        (
            "192.0.2.1:0",
            &["--metrics 192.0.2.1:0: ", "give an address of this machine"],
        ),
        (":9464", &["expected PORT or HOST:PORT"]),
        ("0:9464", &["expected PORT or HOST:PORT"]),
        ("99999", &["expected PORT or HOST:PORT"]),
        ("http://localhost", &["expected PORT or HOST:PORT"]),
    ] {
        let args = [
            "--metrics",
            address,
            "--record",
            recording.to_str().unwrap(),
        ];
        let ended = Watch::start(folder.path(), "watch", &service("refused"), &args).end();
        assert_eq!(ended.code, Some(2), "{address}: {}", ended.stderr);
        for words in expected {
            assert!(ended.stderr.contains(words), "{address}: {}", ended.stderr);
        }
        assert!(
            !ended.stderr.contains("waiting for a simulator"),
            "{}",
            ended.stderr
        );
        assert!(!recording.exists());
    }
}

#[test]
fn an_address_of_the_network_is_reported_and_one_of_the_loopback_interface_is_not() {
    let folder = TempDir::new().unwrap();
    let warning = "anybody on the network can read the metrics";
    for (address, warned) in [("0.0.0.0:0", true), ("localhost:0", false)] {
        let args = ["--metrics", address];
        let watch = Watch::start(folder.path(), "watch", &service("network"), &args);
        stderr_with(&watch, &["waiting for a simulator"]);
        watch.signal("TERM");
        let stderr = watch.end().stderr;
        assert_eq!(
            stderr.matches(warning).count(),
            usize::from(warned),
            "{stderr}"
        );
    }
}

#[test]
fn silent_slow_and_half_open_clients_delay_neither_verdicts_nor_metrics_nor_the_end() {
    let folder = TempDir::new().unwrap();
    let service = service("silent-http");
    let (watch, address) = start(&folder, &service, &[]);
    let mut sim = client(&service);
    assert!(sim.wait_for_watcher(PATIENCE).unwrap());
    let begin = |text: &str| {
        let mut stream = connect(&address);
        stream.write_all(text.as_bytes()).unwrap();
        stream
    };
    let start = Instant::now();
    // More connections than the server could handle one after another: each may stay open for 10 s,
    // and 64 at a time.
    let mut clients: Vec<TcpStream> = (0..300).map(|_| begin("")).collect();
    clients.extend((0..20).map(|_| begin("GET /metrics HT")));
    for _ in 0..20 {
        let stream = begin("GET /met");
        stream.shutdown(Shutdown::Write).unwrap();
        clients.push(stream);
    }
    // These ask for the metrics, and do not read them.
    clients.extend((0..20).map(|_| begin("GET /metrics HTTP/1.1\r\n\r\n")));
    // A client that has nothing more to say gets its answer.
    let half_open = begin("GET /metrics HTTP/1.1\r\n\r\n");
    half_open.shutdown(Shutdown::Write).unwrap();
    assert!(answer(half_open).starts_with("HTTP/1.1 200 OK\r\n"));
    assert_eq!(
        answer(clients.swap_remove(0)),
        "",
        "the oldest client had to make room"
    );
    for frame in 0..5 {
        assert_eq!(step(&mut sim, frame, 0.0), Verdict::Intact);
        let page = scrape(&address);
        assert_eq!(
            figure(&page, "linkwatch_simulator_connected", &service),
            1.0
        );
    }
    assert!(
        start.elapsed() < PATIENCE,
        "the clients had to wait for one another"
    );
    watch.signal("TERM");
    let ended = watch.end();
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    drop(clients);
}

#[test]
fn hostile_requests_are_refused_and_cost_no_memory() {
    let folder = TempDir::new().unwrap();
    let service = service("hostile-http");
    let (watch, address) = start(&folder, &service, &[]);
    let headers = "X-Header: 1\r\n".repeat(100);
    for (text, expected) in [
        ("GET / HTTP/1.1\r\n\r\n", "404 Not Found"),
        ("GET /metrics/ HTTP/1.1\r\n\r\n", "404 Not Found"),
        (
            "POST /metrics HTTP/1.1\r\nContent-Length: 1\r\n\r\nx",
            "405 Method Not Allowed",
        ),
        ("DELETE /metrics HTTP/1.1\r\n\r\n", "405 Method Not Allowed"),
        ("GET /metrics HTTP/9.9\r\n\r\n", "400 Bad Request"),
        ("\u{0}\u{1}\u{2}\r\n\r\n", "400 Bad Request"),
        (&format!("GET /metrics HTTP/1.1\r\n{headers}\r\n"), "431 "),
        ("HEAD /metrics HTTP/1.0\r\n\r\n", "200 OK"),
        ("GET /metrics?a=b HTTP/1.0\r\n\r\n", "200 OK"),
    ] {
        let answer = request(&address, text);
        let status = format!("HTTP/1.1 {expected}");
        assert!(answer.starts_with(&status), "{text:?}: {answer:?}");
        assert_eq!(
            answer.contains("# HELP"),
            text.starts_with("GET") && expected == "200 OK"
        );
    }
    let memory = || scrape(&address).get("process_resident_memory_bytes", &[]);
    let before = memory();
    std::thread::scope(|scope| {
        for _ in 0..10 {
            scope.spawn(|| {
                let mut stream = connect(&address);
                let line = [b"GET /".to_vec(), vec![b'x'; 10 << 20]].concat();
                // The watch closes the connection before it has read all of it.
                let _ = stream.write_all(&line);
                let answer = answer(stream);
                assert!(
                    answer.is_empty() || answer.starts_with("HTTP/1.1 431 "),
                    "{answer}"
                );
            });
        }
    });
    if let (Some(before), Some(after)) = (before, memory()) {
        assert!(after < before + 20e6, "{before} {after}");
    }
    let mut sim = client(&service);
    assert!(sim.wait_for_watcher(PATIENCE).unwrap());
    assert_eq!(step(&mut sim, 0, 0.0), Verdict::Intact);
    sim.finish().unwrap();
    assert_eq!(watch.end().code, Some(0));
}

#[test]
fn metrics_are_served_during_a_long_check() {
    const CURVES: usize = 400;
    const SEGMENTS: usize = 1000;
    let folder = TempDir::new().unwrap();
    let service = service("busy-http");
    let (watch, address) = start(&folder, &service, &[]);
    let mut sim = Client::open(&service, &ClientOptions::lockstep()).unwrap();
    let counts = [-(SEGMENTS as i32); CURVES];
    sim.describe(Basis::Polyline, Precision::F32, &counts)
        .unwrap();
    assert!(sim.wait_for_watcher(PATIENCE).unwrap());
    sim.publish(0.0, Positions::F32(&tangle(CURVES, SEGMENTS)))
        .unwrap();
    until("the session", || {
        let page = scrape(&address);
        (figure(&page, "linkwatch_simulator_connected", &service) == 1.0).then_some(())
    });
    for _ in 0..20 {
        let page = scrape(&address);
        assert_eq!(
            figure(&page, "linkwatch_frames_verified_total", &service),
            0.0
        );
        assert_eq!(verdicts_shown(&page, &service), [""; 0]);
        assert_eq!(
            page.get("linkwatch_last_frame", &[("service", &service)]),
            None
        );
    }
    watch.signal("TERM");
    let ended = watch.end();
    let cancelled = "the check of frame 0 was cancelled";
    assert!(ended.stderr.contains(cancelled), "{}", ended.stderr);
}
