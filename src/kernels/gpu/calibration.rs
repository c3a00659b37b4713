//! What an adapter was measured to take, beside the processor: the ground on which one of them is chosen.
//!
//! A calibration is kept per adapter, driver and number of threads, in a file of the user's cache. It is made when it is
//! asked for, never on the way; without one, the processor is chosen.

use crate::error::{Error, Result};
use crate::kernels::device::DeviceInfo;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// How long a direct sum takes on an adapter and on the processor.
#[derive(Clone, Debug, PartialEq)]
pub struct Calibration {
    /// The adapter's name.
    pub adapter: String,
    /// Its driver: another one is another adapter.
    pub driver: String,
    /// Threads of the processor.
    pub threads: usize,
    /// Of the smallest sum, in milliseconds.
    pub round_trip_ms: f64,
    /// Of a pair of segments, in nanoseconds.
    pub pair_ns: f64,
    /// The same on all threads of the processor.
    pub processor_pair_ns: f64,
}

impl Calibration {
    /// Whether a sum over so many pairs of segments is predicted to take less than on the processor.
    pub fn wins(&self, pairs: u64) -> bool {
        let pairs = pairs as f64 * 1e-6;
        self.round_trip_ms + self.pair_ns * pairs < self.processor_pair_ns * pairs
    }

    /// Pairs of segments from which on a sum is predicted to take less than on the processor; none where it never does.
    pub fn break_even(&self) -> Option<u64> {
        let gain = self.processor_pair_ns - self.pair_ns;
        let pairs = self.round_trip_ms * 1e6 / gain;
        // Not where it is NaN either.
        (gain > 0.0).then_some(pairs.ceil() as u64 + 1)
    }

    /// Whether it is of this adapter, as it is now, and of the threads there are.
    pub fn is_of(&self, info: &DeviceInfo) -> bool {
        (&self.adapter, &self.driver) == (&info.name, &info.driver)
            && self.threads == rayon::current_num_threads()
    }

    /// The one of the fastest adapter for as many threads as there are, if any was measured.
    pub fn fastest() -> Option<Calibration> {
        let mut all = read(&file()?).ok()?;
        // One that never wins is not worth being opened.
        all.retain(|c| c.threads == rayon::current_num_threads() && c.wins(u64::MAX));
        all.into_iter()
            .min_by(|a, b| a.pair_ns.total_cmp(&b.pair_ns))
    }

    /// Keeps it, in the place of an older one.
    ///
    /// Errors: [`Error::File`]; [`Error::Device`] where the user has no folder for such things.
    pub fn keep(&self) -> Result<PathBuf> {
        let file =
            file().ok_or_else(|| Error::Device("no folder to keep a calibration in".into()))?;
        // What cannot be read is of no use.
        let mut all = read(&file).unwrap_or_default();
        all.retain(|c| (&c.adapter, c.threads) != (&self.adapter, self.threads));
        all.push(self.clone());
        let text = Value::from(all.iter().map(Calibration::to_json).collect::<Vec<_>>());
        let folder = file.parent().unwrap_or(Path::new("."));
        std::fs::create_dir_all(folder).map_err(Error::file(folder))?;
        std::fs::write(&file, format!("{text:#}\n")).map_err(Error::file(&file))?;
        Ok(file)
    }

    fn to_json(&self) -> Value {
        json!({
            "adapter": self.adapter,
            "driver": self.driver,
            "threads": self.threads,
            "round_trip_ms": self.round_trip_ms,
            "pair_ns": self.pair_ns,
            "processor_pair_ns": self.processor_pair_ns,
        })
    }

    fn from_json(v: &Value) -> Option<Calibration> {
        let positive = |name: &str| v[name].as_f64().filter(|x| *x > 0.0 && x.is_finite());
        Some(Calibration {
            adapter: v["adapter"].as_str()?.into(),
            driver: v["driver"].as_str()?.into(),
            threads: v["threads"].as_u64()? as usize,
            round_trip_ms: positive("round_trip_ms")?,
            pair_ns: positive("pair_ns")?,
            processor_pair_ns: positive("processor_pair_ns")?,
        })
    }
}

fn read(file: &Path) -> std::io::Result<Vec<Calibration>> {
    let all: Value = serde_json::from_str(&std::fs::read_to_string(file)?)?;
    let each = all.as_array().into_iter().flatten();
    Ok(each.filter_map(Calibration::from_json).collect())
}

/// Where calibrations are kept.
fn file() -> Option<PathBuf> {
    let folder = |name: &str| {
        std::env::var_os(name)
            .filter(|v| !v.is_empty())
            .map(PathBuf::from)
    };
    let cache = folder("XDG_CACHE_HOME")
        .or_else(|| folder("HOME").map(|home| home.join(".cache")))
        .or_else(|| folder("LOCALAPPDATA"))?;
    Some(cache.join("linkwatch").join("devices.json"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn large_sums_win_where_the_adapter_is_faster() {
        let mut c = Calibration {
            adapter: "A".into(),
            driver: "1".into(),
            threads: 8,
            round_trip_ms: 1.0,
            pair_ns: 0.01,
            processor_pair_ns: 1.01,
        };
        assert!(c.wins(1_000_001) && !c.wins(999_999) && !c.wins(0));
        let from = c.break_even().unwrap();
        assert!((1_000_000..1_000_010).contains(&from) && c.wins(from));
        assert_eq!(Calibration::from_json(&c.to_json()), Some(c.clone()));
        c.pair_ns = 2.0;
        assert!(!c.wins(u64::MAX));
        assert_eq!(c.break_even(), None);
        c.pair_ns = f64::NAN;
        assert_eq!(Calibration::from_json(&c.to_json()), None);
    }
}
