//! Figures of the watched services, in the text format of Prometheus.
//!
//! The threads that verify frames update atomic variables, which the thread that serves a page
//! reads. Locks are held only to find or add a figure: never during a check, or while a page is
//! sent.

use crate::cli::run::FrameCounts;
use linkwatch::{Report, SinkSummary, Verdict};
use prometheus::core::Collector;
use prometheus::{
    Histogram, HistogramOpts, IntCounter, IntCounterVec, IntGauge, IntGaugeVec, Opts, Registry,
    TextEncoder,
};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

/// Upper bounds of the latencies in seconds: small frames take microseconds, the largest minutes.
const LATENCIES: [f64; 25] = [
    1e-6, 2e-6, 5e-6, 1e-5, 2e-5, 5e-5, 1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2, 2e-2, 5e-2, 0.1,
    0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0,
];

/// Names of the figures of a service without the prefix `linkwatch_`, and their help.
const FAMILIES: &str = "\
frames_verified_total: Frames that were verified, with any verdict.
frames_skipped_total: Frames that were not verified, because a newer one replaced them.
frames_rejected_total: Frames that broke their contract (NaN, other curves).
verdicts_total: Verified and rejected frames by verdict.
aborts_total: Frames whose verdict asked the simulator to stop.
pull_throughs_total: Pull-throughs found. Absent if none are searched for.
unresolved_pull_throughs_total: Pull-throughs left open, because frames are too far apart. Absent \
                                if none are searched for.
output_frames_dropped_total: Frames that a recording or a viewer missed.
sessions_total: Simulators that connected.
restarts_total: Times that the watch was started again (--state).
simulator_connected: 1 if a simulator is connected, else 0.
verdict: 1 for the verdict on the last frame, else 0. Stays when the simulator ends.
changed_links: Linking numbers in the last frame that are not the expected ones.
last_frame: Number of the last verified frame. Absent before the first one.
verdict_latency_seconds: Time from the receipt of a verified frame until its verdict was sent.
";

/// Verdicts that a watcher gives. Only a simulator can know that a verdict is stale.
fn verdicts() -> impl Iterator<Item = Verdict> {
    let all = Verdict::ALL.into_iter();
    all.filter(|&verdict| verdict != Verdict::Stale)
}

/// Figures of the process and of all services.
pub struct Figures {
    registry: Registry,
    memory: Option<IntGauge>,
    services: BTreeMap<String, ServiceMetrics>,
}

impl Figures {
    /// Creates the figures of these services, all 0.
    pub fn new(services: &[String]) -> Figures {
        let registry = Registry::new();
        let build = Opts::new("linkwatch_build_info", "Version of linkwatch.")
            .const_label("version", env!("CARGO_PKG_VERSION"));
        registered(&registry, IntGauge::with_opts(build)).set(1);
        let memory = resident_memory().map(|_| {
            let help = "Resident memory of the process in bytes.";
            registered(
                &registry,
                IntGauge::new("process_resident_memory_bytes", help),
            )
        });
        let named = |name: &String| (name.clone(), Arc::new(Service::new(&registry, name)));
        Figures {
            services: services.iter().map(named).collect(),
            registry,
            memory,
        }
    }

    /// Returns the figures of a service, one of those named at first.
    pub fn service(&self, name: &str) -> ServiceMetrics {
        Arc::clone(&self.services[name])
    }

    /// Returns all figures in the text format of Prometheus.
    pub fn page(&self) -> String {
        if let (Some(gauge), Some(bytes)) = (&self.memory, resident_memory()) {
            gauge.set(bytes);
        }
        for service in self.services.values() {
            service.show_verdict();
        }
        let families = self.registry.gather();
        let page = TextEncoder::new().encode_to_string(&families);
        page.expect("the families have names and metrics")
    }
}

/// Returns the resident memory of the process in bytes, on Linux.
fn resident_memory() -> Option<i64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status
        .lines()
        .find_map(|line| line.strip_prefix("VmRSS:"))?;
    let kib: i64 = line.trim().strip_suffix(" kB")?.parse().ok()?;
    Some(kib << 10)
}

/// Adds a metric to the page.
fn registered<M: Collector + Clone + 'static>(
    registry: &Registry,
    metric: prometheus::Result<M>,
) -> M {
    let metric = metric.expect("the names of metrics are valid");
    let added = registry.register(Box::new(metric.clone()));
    added.expect("the names of metrics differ");
    metric
}

/// Figures of a service, shared by its sessions.
pub type ServiceMetrics = Arc<Service>;

/// Figures of a service.
pub struct Service {
    verified: IntCounter,
    skipped: IntCounter,
    rejected: IntCounter,
    verdicts: IntCounterVec,
    aborts: IntCounter,
    /// Pull-throughs, and those that are unresolved. Empty if none are searched for.
    pull_throughs: IntCounterVec,
    unresolved: IntCounterVec,
    /// Frames that an output missed, by its name.
    dropped: IntCounterVec,
    sessions: IntCounter,
    restarts: IntCounter,
    connected: IntGauge,
    /// Verdict on the last frame.
    last: AtomicU32,
    /// The same, as of the last page.
    verdict: IntGaugeVec,
    changed_links: IntGauge,
    /// Number of the last verified frame. Empty before the first one.
    last_frame: IntGaugeVec,
    latency: Histogram,
}

impl Service {
    /// Creates the figures of a service and adds them to the page.
    fn new(registry: &Registry, service: &str) -> Service {
        let opts = |name: &str| {
            let mut rows = FAMILIES.lines().filter_map(|row| row.split_once(": "));
            let (_, help) = rows.find(|(family, _)| *family == name).unwrap_or_default();
            Opts::new(format!("linkwatch_{name}"), help).const_label("service", service)
        };
        let counter = |name: &str| registered(registry, IntCounter::with_opts(opts(name)));
        let counters = |name: &str, labels: &[&str]| {
            registered(registry, IntCounterVec::new(opts(name), labels))
        };
        let gauge = |name: &str| registered(registry, IntGauge::with_opts(opts(name)));
        let gauges = |name: &str, labels: &[&str]| {
            registered(registry, IntGaugeVec::new(opts(name), labels))
        };
        let latency = HistogramOpts::from(opts("verdict_latency_seconds"));
        let latency = Histogram::with_opts(latency.buckets(LATENCIES.to_vec()));
        let figures = Service {
            verified: counter("frames_verified_total"),
            skipped: counter("frames_skipped_total"),
            rejected: counter("frames_rejected_total"),
            verdicts: counters("verdicts_total", &["verdict"]),
            aborts: counter("aborts_total"),
            pull_throughs: counters("pull_throughs_total", &[]),
            unresolved: counters("unresolved_pull_throughs_total", &[]),
            dropped: counters("output_frames_dropped_total", &["output"]),
            sessions: counter("sessions_total"),
            restarts: counter("restarts_total"),
            connected: gauge("simulator_connected"),
            last: AtomicU32::new(u32::MAX),
            verdict: gauges("verdict", &["verdict"]),
            changed_links: gauge("changed_links"),
            last_frame: gauges("last_frame", &[]),
            latency: registered(registry, latency),
        };
        for verdict in verdicts() {
            figures.verdicts.with_label_values(&[verdict.word()]);
        }
        figures
    }

    /// Prepares a session. `events` is true if it searches for pull-throughs.
    pub fn session(self: &Arc<Service>, events: bool) -> SessionMetrics {
        if events {
            self.pull_throughs.with_label_values::<&str>(&[]);
            self.unresolved.with_label_values::<&str>(&[]);
        }
        SessionMetrics {
            service: Arc::clone(self),
            frames: FrameCounts::default(),
            dropped: BTreeMap::new(),
        }
    }

    /// Counts a simulator that connected.
    pub fn connected(&self) {
        self.sessions.inc();
        self.connected.set(1);
    }

    /// Adds the times that the watch was started again before this process began.
    pub fn restarted(&self, times: u64) {
        self.restarts.inc_by(times);
    }

    /// Records that the simulator is not watched any more.
    pub fn disconnected(&self) {
        self.connected.set(0);
    }

    /// Updates the gauges of the verdict.
    fn show_verdict(&self) {
        let last = Verdict::from_code(self.last.load(Ordering::Relaxed));
        for verdict in verdicts() {
            let gauge = self.verdict.with_label_values(&[verdict.word()]);
            gauge.set((last == Some(verdict)).into());
        }
    }
}

/// Adds the figures of one session to those of its service.
pub struct SessionMetrics {
    service: ServiceMetrics,
    /// Counts of this session that were added.
    frames: FrameCounts,
    dropped: BTreeMap<&'static str, u64>,
}

impl SessionMetrics {
    /// Adds the verdict on a frame, and the time from the receipt of the frame until it was sent.
    pub fn add(&self, report: &Report, latency: Option<Duration>) {
        let (service, verdict) = (&self.service, report.verdict);
        service.verdicts.with_label_values(&[verdict.word()]).inc();
        service.last.store(verdict as u32, Ordering::Relaxed);
        service.aborts.inc_by(report.abort.into());
        service.changed_links.set(report.changes.len() as i64);
        for (found, family) in [
            (&report.events, &service.pull_throughs),
            (&report.unresolved, &service.unresolved),
        ] {
            if !found.is_empty() {
                let counter = family.with_label_values::<&str>(&[]);
                counter.inc_by(found.len() as u64);
            }
        }
        if verdict == Verdict::Rejected {
            return;
        }
        let last = service.last_frame.with_label_values::<&str>(&[]);
        // The bus rejects numbers that do not fit.
        last.set(report.seq as i64);
        if let Some(latency) = latency {
            service.latency.observe(latency.as_secs_f64());
        }
    }

    /// Updates the counts of this session. A count that decreases, because the simulator numbered
    /// its frames wrongly at first, has no effect until it exceeds its maximum.
    pub fn count(&mut self, frames: FrameCounts, outputs: impl Iterator<Item = SinkSummary>) {
        let service = &self.service;
        let add = |counter: &IntCounter, added: &mut u64, now: u64| {
            counter.inc_by(now.saturating_sub(*added));
            *added = now.max(*added);
        };
        let added = &mut self.frames;
        add(&service.verified, &mut added.verified, frames.verified);
        add(&service.skipped, &mut added.skipped, frames.skipped);
        add(&service.rejected, &mut added.rejected, frames.rejected);
        for output in outputs {
            let counter = service.dropped.with_label_values(&[output.name]);
            let added = self.dropped.entry(output.name).or_default();
            add(&counter, added, output.dropped);
        }
    }
}
