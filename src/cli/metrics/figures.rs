//! Figures of the watched service, in the text format of Prometheus (0.0.4).
//!
//! The threads that verify frames and the one that serves a page share the figures
//! behind a lock, which is held for microseconds: never during a check, or while a page is sent.

use linkwatch::{Counters, Report, SinkSummary, Verdict};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Upper bounds of the latencies in seconds: small frames take microseconds, the largest minutes.
const LATENCIES: [f64; 25] = [
    1e-6, 2e-6, 5e-6, 1e-5, 2e-5, 5e-5, 1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2, 2e-2, 5e-2, 0.1,
    0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0,
];

/// Name, type and help of each family.
const FAMILIES: &str = "\
linkwatch_build_info gauge Version of linkwatch.
process_resident_memory_bytes gauge Resident memory of the process in bytes.
linkwatch_frames_verified_total counter Frames that were verified, with any verdict.
linkwatch_frames_skipped_total counter Frames that were not verified, because a newer one \
                                       replaced them.
linkwatch_frames_rejected_total counter Frames that broke their contract (NaN, other curves).
linkwatch_verdicts_total counter Verified and rejected frames by verdict.
linkwatch_aborts_total counter Frames whose verdict asked the simulator to stop.
linkwatch_pull_throughs_total counter Pull-throughs found. Absent if none are searched for.
linkwatch_unresolved_pull_throughs_total counter Pull-throughs left open, because frames are too \
                                                 far apart. Absent if none are searched for.
linkwatch_output_frames_dropped_total counter Frames that a recording or a viewer missed.
linkwatch_sessions_total counter Simulators that connected.
linkwatch_restarts_total counter Times that the watch was started again (--state).
linkwatch_simulator_connected gauge 1 if a simulator is connected, else 0.
linkwatch_verdict gauge 1 for the verdict on the last frame, else 0. Stays when the simulator ends.
linkwatch_changed_links gauge Linking numbers in the last frame that are not the expected ones.
linkwatch_last_frame gauge Number of the last verified frame. Absent before the first one.
linkwatch_verdict_latency_seconds histogram Time from the receipt of a verified frame until its \
                                            verdict was sent.
";

/// A family without the prefix `linkwatch_`, the end of the name of a sample, its labels, and its
/// value.
type Sample = (&'static str, &'static str, String, f64);

/// Returns the resident memory of the process in bytes, on Linux.
fn resident_memory() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let mut lines = status.lines();
    let kib = lines.find_map(|line| line.strip_prefix("VmRSS:"))?;
    let kib: u64 = kib.trim().strip_suffix(" kB")?.parse().ok()?;
    Some(kib << 10)
}

/// Figures of a service.
#[derive(Default)]
struct Service {
    /// Label of its samples.
    label: String,
    frames: Counters,
    /// Number of frames by the code of the verdict.
    verdicts: [u64; Verdict::ALL.len()],
    aborts: u64,
    /// Pull-throughs, and those that are unresolved; `None` if none are searched for.
    pull_throughs: Option<[u64; 2]>,
    /// Frames that an output missed, by its name.
    dropped: BTreeMap<&'static str, u64>,
    sessions: u64,
    restarts: u64,
    connected: bool,
    /// Verdict on the last frame.
    last: Option<Verdict>,
    changed_links: usize,
    last_frame: Option<u64>,
    /// Number of latencies up to each bound and above the one before; the last one of all others.
    latencies: [u64; LATENCIES.len() + 1],
    latency_sum: f64,
}

impl Service {
    /// Returns the samples of the service.
    fn samples(&self) -> Vec<Sample> {
        let version = format!("version=\"{}\"", env!("CARGO_PKG_VERSION"));
        let mut samples = vec![("build_info", "", version, 1.0)];
        let mut add = |family, end, label: &str, value| {
            let separator = if label.is_empty() { "" } else { "," };
            let labels = format!("{}{separator}{label}", self.label);
            samples.push((family, end, labels, value));
        };
        for (family, value) in [
            ("frames_verified_total", self.frames.verified),
            ("frames_skipped_total", self.frames.skipped),
            ("frames_rejected_total", self.frames.rejected),
            ("aborts_total", self.aborts),
            ("sessions_total", self.sessions),
            ("restarts_total", self.restarts),
            ("simulator_connected", self.connected.into()),
            ("changed_links", self.changed_links as u64),
        ] {
            add(family, "", "", value as f64);
        }
        if let Some([found, unresolved]) = self.pull_throughs {
            add("pull_throughs_total", "", "", found as f64);
            add("unresolved_pull_throughs_total", "", "", unresolved as f64);
        }
        if let Some(last) = self.last_frame {
            add("last_frame", "", "", last as f64);
        }
        for (output, n) in &self.dropped {
            let label = format!("output=\"{output}\"");
            add("output_frames_dropped_total", "", &label, *n as f64);
        }
        // Only a simulator can know that a verdict is stale.
        for verdict in Verdict::ALL.into_iter().filter(|v| *v != Verdict::Stale) {
            let label = format!("verdict=\"{verdict}\"");
            let n = self.verdicts[verdict as usize] as f64;
            add("verdicts_total", "", &label, n);
            let is_last = u8::from(self.last == Some(verdict));
            add("verdict", "", &label, is_last.into());
        }
        let latency = "verdict_latency_seconds";
        let mut count = 0;
        let bounds = LATENCIES.map(|bound| bound.to_string()).into_iter();
        let bounds = bounds.chain(["+Inf".to_owned()]);
        for (bound, n) in bounds.zip(self.latencies) {
            count += n;
            add(latency, "_bucket", &format!("le=\"{bound}\""), count as f64);
        }
        add(latency, "_sum", "", self.latency_sum);
        add(latency, "_count", "", count as f64);
        samples
    }
}

/// Figures of a service, shared by its sessions.
#[derive(Clone, Default)]
pub struct ServiceMetrics(Arc<Mutex<Service>>);

impl ServiceMetrics {
    /// Creates the figures of a service, all 0.
    pub fn new(name: &str) -> ServiceMetrics {
        let escapes = [("\\", "\\\\"), ("\"", "\\\""), ("\n", "\\n")];
        let escape = |name: String, (from, to)| name.replace(from, to);
        let name = escapes.into_iter().fold(name.to_owned(), escape);
        let label = format!("service=\"{name}\"");
        let service = Service {
            label,
            ..Service::default()
        };
        ServiceMetrics(Arc::new(Mutex::new(service)))
    }

    /// Returns all figures in the text format of Prometheus.
    pub fn page(&self) -> String {
        let samples = self.lock().samples();
        let mut page = String::new();
        for row in FAMILIES.lines() {
            let (family, about) = row.split_once(' ').unwrap_or_default();
            let (kind, help) = about.split_once(' ').unwrap_or_default();
            let mut lines = String::new();
            match family.strip_prefix("linkwatch_") {
                None => lines.extend(resident_memory().map(|n| format!("{family} {n}\n"))),
                Some(name) => {
                    for (_, end, labels, value) in samples.iter().filter(|s| s.0 == name) {
                        writeln!(lines, "{family}{end}{{{labels}}} {value}").ok();
                    }
                }
            }
            if !lines.is_empty() {
                page += &format!("# HELP {family} {help}\n# TYPE {family} {kind}\n{lines}");
            }
        }
        page
    }

    /// Locks the figures, which are valid at every step.
    fn lock(&self) -> MutexGuard<'_, Service> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Prepares a session. `events` is true if it searches for pull-throughs.
    pub fn session(&self, events: bool) -> SessionMetrics {
        if events {
            self.lock().pull_throughs.get_or_insert_default();
        }
        SessionMetrics {
            service: self.clone(),
            frames: Counters::default(),
            dropped: BTreeMap::new(),
        }
    }

    /// Counts a simulator that connected.
    pub fn connected(&self) {
        let mut service = self.lock();
        service.sessions += 1;
        service.connected = true;
    }

    /// Adds the times that the watch was started again before this process began.
    pub fn restarted(&self, times: u64) {
        self.lock().restarts += times;
    }

    /// Records that the simulator is not watched any more.
    pub fn disconnected(&self) {
        self.lock().connected = false;
    }
}

/// Adds the metrics of one session to those of its service.
pub struct SessionMetrics {
    service: ServiceMetrics,
    /// Counts of this session that were added.
    frames: Counters,
    dropped: BTreeMap<&'static str, u64>,
}

impl SessionMetrics {
    /// Adds the verdict on a frame, and the time from the receipt of the frame until it was sent.
    pub fn add(&self, report: &Report, latency: Option<Duration>) {
        let mut service = self.service.lock();
        service.verdicts[report.verdict as usize] += 1;
        service.last = Some(report.verdict);
        service.aborts += u64::from(report.abort);
        service.changed_links = report.changes.len();
        if let Some([found, unresolved]) = &mut service.pull_throughs {
            *found += report.events.len() as u64;
            *unresolved += report.unresolved.len() as u64;
        }
        if report.verdict == Verdict::Rejected {
            return;
        }
        service.last_frame = Some(report.seq);
        if let Some(seconds) = latency.map(|latency| latency.as_secs_f64()) {
            let bucket = LATENCIES.partition_point(|bound| *bound < seconds);
            service.latencies[bucket] += 1;
            service.latency_sum += seconds;
        }
    }

    /// Updates the counts of this session. A count that decreases, because the simulator numbered
    /// its frames wrongly at first, has no effect until it exceeds its maximum.
    pub fn count(&mut self, frames: Counters, outputs: impl Iterator<Item = SinkSummary>) {
        let mut service = self.service.lock();
        let add = |counter: &mut u64, added: &mut u64, now: u64| {
            *counter += now.saturating_sub(*added);
            *added = now.max(*added);
        };
        let (all, own) = (&mut service.frames, &mut self.frames);
        add(&mut all.verified, &mut own.verified, frames.verified);
        add(&mut all.skipped, &mut own.skipped, frames.skipped);
        add(&mut all.rejected, &mut own.rejected, frames.rejected);
        for output in outputs {
            let counter = service.dropped.entry(output.name).or_default();
            let added = self.dropped.entry(output.name).or_default();
            add(counter, added, output.dropped);
        }
    }
}
