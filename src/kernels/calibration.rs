//! Measured cost of the kernels on an adapter and on the CPU, from which the faster one is chosen.
//!
//! A calibration belongs to an adapter, a driver and a number of threads. It is stored in a file in
//! the user's cache folder. It is measured only on request (`study devices`, in benches/study),
//! never during verification. Without a calibration, the CPU is chosen.
//!
//! An entry of the file that lacks a field was written by an older version, and is ignored. Fields
//! that were renamed are read under both names.

use super::device::DeviceInfo;
use crate::curve::CurveSet;
use crate::error::{Error, Result};
use crate::pairs::Pair;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Cost of the kernels for whole frames, on an adapter and on the CPU.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Calibration {
    /// Name of the adapter.
    pub adapter: String,
    /// Graphics interface of the adapter. The same GPU has other timings under another one.
    pub backend: String,
    /// Driver of the adapter. A calibration is not valid for another driver.
    pub driver: String,
    /// Number of CPU threads.
    pub threads: usize,
    /// Cost of direct sums, per segment pair.
    pub direct: SumCost,
    /// Cost of Barnes-Hut with the proven error bound, per segment, over all pairs of curves.
    pub barnes_hut: SumCost,
    /// Cost of counting crossings.
    pub crossings: CountingCost,
}

/// Cost of a sum as a linear function of its work.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SumCost {
    /// Time of the smallest sum on the adapter, in milliseconds.
    pub round_trip_ms: f64,
    /// Time per unit of work on the adapter, in nanoseconds.
    pub adapter_ns: f64,
    /// Time per unit of work on all CPU threads, in nanoseconds.
    #[serde(alias = "processor_ns")]
    pub cpu_ns: f64,
}

/// Cost of counting the crossings of a frame on an adapter, from vertices in memory to linking
/// numbers, as a linear function of its counts.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CountingCost {
    /// Time of the smallest frame, in milliseconds.
    pub round_trip_ms: f64,
    /// Time per segment of the frame, in nanoseconds.
    pub segment_ns: f64,
    /// Time per potential link, in nanoseconds.
    pub link_ns: f64,
    /// Time per test (a segment pair whose boxes overlap), in nanoseconds.
    pub test_ns: f64,
    /// Typical factor between measured and predicted times; 1 if the prediction is perfect.
    #[serde(alias = "misfit")]
    pub error_factor: f64,
    /// Measured time on all CPU threads, divided by the time that the plan predicts.
    #[serde(alias = "processor_factor")]
    pub cpu_factor: f64,
}

impl SumCost {
    /// Returns true if the adapter is predicted to be faster than the CPU on this work.
    pub fn wins(&self, work: u64) -> bool {
        let millions = work as f64 * 1e-6;
        self.round_trip_ms + self.adapter_ns * millions < self.cpu_ns * millions
    }

    /// Returns the least work on which the adapter is predicted to be faster than the CPU. Returns
    /// `None` if it never is.
    pub fn break_even(&self) -> Option<u64> {
        let gain = self.cpu_ns - self.adapter_ns;
        let work = self.round_trip_ms * 1e6 / gain;
        // Written so that a NaN gives `None` as well.
        (gain > 0.0).then_some((work.ceil() as u64).saturating_add(1))
    }

    fn is_valid(&self) -> bool {
        let all = [self.round_trip_ms, self.adapter_ns, self.cpu_ns];
        all.iter().all(|&x| x > 0.0 && x.is_finite())
    }
}

impl CountingCost {
    /// Returns the predicted time on the adapter, in milliseconds, of a frame with these numbers of
    /// segments, of potential links, and of segment pairs whose boxes overlap.
    pub(crate) fn adapter_ms(&self, segments: usize, links: usize, tests: u64) -> f64 {
        let ns = segments as f64 * self.segment_ns
            + links as f64 * self.link_ns
            + tests as f64 * self.test_ns;
        self.round_trip_ms + 1e-6 * ns
    }

    fn is_valid(&self) -> bool {
        let costs = [self.segment_ns, self.link_ns, self.test_ns];
        let positive = [self.round_trip_ms, self.cpu_factor, self.error_factor];
        positive.iter().all(|&x| x > 0.0 && x.is_finite())
            && self.error_factor >= 1.0
            && costs.iter().all(|&x| x >= 0.0 && x.is_finite())
    }
}

impl Calibration {
    /// Returns true if the calibration was made for this adapter and driver, and for the current
    /// number of threads.
    pub fn is_of(&self, info: &DeviceInfo) -> bool {
        (&self.adapter, &self.backend, &self.driver) == (&info.name, &info.backend, &info.driver)
            && self.threads == rayon::current_num_threads()
    }

    /// Returns the stored calibration of an adapter, if there is a valid one.
    pub fn of(info: &DeviceInfo) -> Option<Calibration> {
        read(&file()?).ok()?.into_iter().find(|c| c.is_of(info))
    }

    /// Returns the stored calibration of the fastest adapter for the current number of threads, if
    /// there is any.
    pub fn fastest() -> Option<Calibration> {
        let mut all = read(&file()?).ok()?;
        all.retain(|c| c.threads == rayon::current_num_threads());
        all.into_iter()
            .min_by(|a, b| a.direct.adapter_ns.total_cmp(&b.direct.adapter_ns))
    }

    /// Stores the calibration. Replaces an older one of the same adapter. Returns the path of the
    /// file.
    ///
    /// # Errors
    ///
    /// [`Error::File`]; [`Error::Device`] if the user has no cache folder, or if a cost is
    /// not a valid number, because a stored calibration must be readable.
    pub fn keep(&self) -> Result<PathBuf> {
        if !self.is_valid() {
            return Err(Error::Device(format!(
                "the measured times of {} fit no costs; repeat the calibration on an idle machine",
                self.adapter
            )));
        }
        let file = file().ok_or_else(|| {
            Error::Device("no cache folder for the calibration; set XDG_CACHE_HOME or HOME".into())
        })?;
        self.keep_in(&file)?;
        Ok(file)
    }

    fn keep_in(&self, file: &Path) -> Result<()> {
        // An unreadable file is replaced.
        let mut all = read(file).unwrap_or_default();
        let key = |c: &Calibration| (c.adapter.clone(), c.backend.clone(), c.threads);
        all.retain(|c| key(c) != key(self));
        all.push(self.clone());
        let folder = file.parent().unwrap_or(Path::new("."));
        std::fs::create_dir_all(folder).map_err(Error::file(folder))?;
        // The file is renamed into place, so that concurrent readers, also after a kill, find
        // either the old or the new contents.
        let whole = file.with_extension(format!("{}.part", std::process::id()));
        let text = format!("{:#}\n", json!(all));
        let moved = std::fs::write(&whole, text).and_then(|()| std::fs::rename(&whole, file));
        moved.map_err(|e| {
            // The write may have failed before the file existed.
            let _ = std::fs::remove_file(&whole);
            Error::file(file)(e)
        })
    }

    /// Returns `None` if a field is missing, as in a file of an older version, or is not a valid
    /// time.
    fn from_json(v: Value) -> Option<Calibration> {
        let c: Calibration = serde_json::from_value(v).ok()?;
        c.is_valid().then_some(c)
    }

    /// Returns true if all times and factors are valid numbers.
    fn is_valid(&self) -> bool {
        self.direct.is_valid() && self.barnes_hut.is_valid() && self.crossings.is_valid()
    }
}

/// Returns the number of segment pairs of some pairs of curves: the work of direct sums.
pub(crate) fn segment_pairs(set: &CurveSet, pairs: &[Pair]) -> u64 {
    let segments = |i: u32| u64::from(set.curve(i as usize).segments);
    pairs.iter().map(|&(i, j)| segments(i) * segments(j)).sum()
}

/// Returns the number of segments of some pairs of curves, counted once for each pair: the work of
/// Barnes-Hut.
pub(crate) fn segments(set: &CurveSet, pairs: &[Pair]) -> u64 {
    let segments = |i: u32| u64::from(set.curve(i as usize).segments);
    pairs.iter().map(|&(i, j)| segments(i) + segments(j)).sum()
}

fn read(file: &Path) -> std::io::Result<Vec<Calibration>> {
    let all: Value = serde_json::from_str(&std::fs::read_to_string(file)?)?;
    let Value::Array(all) = all else {
        return Ok(Vec::new());
    };
    Ok(all.into_iter().filter_map(Calibration::from_json).collect())
}

/// Returns the path of the file that stores the calibrations.
fn file() -> Option<PathBuf> {
    let folder = |name: &str| {
        let folder = std::env::var_os(name).filter(|v| !v.is_empty());
        folder.map(PathBuf::from)
    };
    let cache = folder("XDG_CACHE_HOME")
        .or_else(|| folder("HOME").map(|home| home.join(".cache")))
        .or_else(|| folder("LOCALAPPDATA"))?;
    Some(cache.join("linkwatch").join("devices.json"))
}

/// Invented calibrations for tests.
#[cfg(test)]
impl Calibration {
    /// Returns a calibration whose frames take `round_trip_ms` at least and whose adapter is
    /// `speed` times as fast as the CPU per unit of work.
    pub(crate) fn made_up(round_trip_ms: f64, speed: f64) -> Calibration {
        let sum = |cpu_ns: f64| SumCost {
            round_trip_ms,
            adapter_ns: cpu_ns / speed,
            cpu_ns,
        };
        Calibration {
            adapter: "made up".into(),
            backend: "Vulkan".into(),
            driver: "1".into(),
            threads: rayon::current_num_threads(),
            direct: sum(1.0),
            barnes_hut: sum(1000.0),
            crossings: CountingCost {
                round_trip_ms,
                segment_ns: 10.0 / speed,
                link_ns: 200.0 / speed,
                test_ns: 50.0 / speed,
                error_factor: 1.0,
                cpu_factor: 1.0,
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn large_sums_win_if_the_adapter_is_faster() {
        let mut sum = SumCost {
            round_trip_ms: 1.0,
            adapter_ns: 0.01,
            cpu_ns: 1.01,
        };
        assert!(sum.wins(1_000_001) && !sum.wins(999_999) && !sum.wins(0));
        let from = sum.break_even().unwrap();
        assert!((1_000_000..1_000_010).contains(&from) && sum.wins(from));
        sum.adapter_ns = 2.0;
        assert!(!sum.wins(u64::MAX));
        assert_eq!(sum.break_even(), None);
    }

    /// Regression test: the conversion wrapped to 0, which means that the adapter always wins.
    #[test]
    fn break_even_saturates() {
        let sum = SumCost {
            round_trip_ms: 1e300,
            adapter_ns: 1e-300,
            cpu_ns: 1e-299,
        };
        assert_eq!(sum.break_even(), Some(u64::MAX));
    }

    #[test]
    fn valid_calibrations_survive_a_round_trip_and_invalid_ones_are_rejected() {
        let good = Calibration::made_up(0.5, 10.0);
        assert_eq!(Calibration::from_json(json!(good)), Some(good.clone()));
        let with = |change: &dyn Fn(&mut Calibration)| {
            let mut c = good.clone();
            change(&mut c);
            Calibration::from_json(json!(c))
        };
        for x in [f64::NAN, -1.0, f64::INFINITY] {
            assert_eq!(with(&|c| c.direct.adapter_ns = x), None);
            assert_eq!(with(&|c| c.barnes_hut.round_trip_ms = x), None);
            assert_eq!(with(&|c| c.crossings.test_ns = x), None);
            assert_eq!(with(&|c| c.crossings.cpu_factor = x), None);
            assert_eq!(with(&|c| c.crossings.error_factor = x), None);
        }
        // A least-squares fit may find that a segment costs nothing.
        assert!(with(&|c| c.crossings.segment_ns = 0.0).is_some());
        assert_eq!(with(&|c| c.crossings.cpu_factor = 0.0), None);
        // Earlier names of some fields.
        let text = json!(good).to_string();
        let renamed = [
            ("cpu_ns", "processor_ns"),
            ("error_factor", "misfit"),
            ("cpu_factor", "processor_factor"),
        ];
        let earlier = renamed.iter().fold(text, |text, (now, before)| {
            assert!(text.contains(now));
            text.replace(now, before)
        });
        let earlier = serde_json::from_str(&earlier).unwrap();
        assert_eq!(Calibration::from_json(earlier), Some(good.clone()));
        // Format of a version that measured direct sums only.
        let old = json!({
            "adapter": "A", "driver": "1", "threads": 8,
            "round_trip_ms": 1.0, "pair_ns": 0.01, "processor_pair_ns": 1.0,
        });
        assert_eq!(Calibration::from_json(old), None);
    }

    #[test]
    fn a_calibration_that_cannot_be_read_again_is_not_stored() {
        let mut c = Calibration::made_up(0.5, 10.0);
        c.crossings.error_factor = f64::INFINITY;
        let e = c.keep().unwrap_err().to_string();
        assert!(
            e.contains("the measured times of made up fit no costs"),
            "{e}"
        );
    }

    #[test]
    fn storing_replaces_the_file_atomically() {
        use std::io::Read;
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("new").join("devices.json");
        let first = Calibration::made_up(0.5, 10.0);
        first.keep_in(&file).unwrap();
        let mut reader = std::fs::File::open(&file).unwrap();
        let second = Calibration {
            adapter: "another".into(),
            ..first.clone()
        };
        second.keep_in(&file).unwrap();
        // The same adapter under another graphics interface has its own timings.
        let third = Calibration {
            backend: "Dx12".into(),
            ..first.clone()
        };
        third.keep_in(&file).unwrap();
        assert_eq!(read(&file).unwrap(), [first.clone(), second, third]);
        let mut text = String::new();
        if cfg!(unix) {
            reader.read_to_string(&mut text).unwrap();
            let before: Vec<Calibration> = serde_json::from_str(&text).unwrap();
            assert_eq!(before, [first]);
        }
        // No temporary file is left.
        assert_eq!(file.parent().unwrap().read_dir().unwrap().count(), 1);
        let blocked = folder.path().join("blocked");
        std::fs::create_dir_all(blocked.join("devices.json").join("x")).unwrap();
        let good = Calibration::made_up(0.5, 10.0);
        assert!(good.keep_in(&blocked.join("devices.json")).is_err());
        assert_eq!(blocked.read_dir().unwrap().count(), 1);
    }

    #[test]
    fn reading_skips_invalid_entries() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("devices.json");
        assert!(read(&file).is_err());
        let good = Calibration::made_up(0.5, 10.0);
        for (text, want) in [
            ("nonsense".to_owned(), None),
            ("{}".to_owned(), Some(0)),
            (json!([{}, 3, good]).to_string(), Some(1)),
        ] {
            std::fs::write(&file, text).unwrap();
            assert_eq!(read(&file).ok().map(|all| all.len()), want);
        }
    }
}
