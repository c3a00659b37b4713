//! What kernels were measured to take on an adapter, beside the processor: the ground on which one of them is chosen.
//!
//! A calibration is kept per adapter, driver and number of threads, in a file of the user's cache. It is made when it is
//! asked for ([`crate::plan::calibrate`]), never on the way; without one, the processor is chosen.

use super::device::DeviceInfo;
use crate::curve::CurveSet;
use crate::error::{Error, Result};
use crate::pairs::Pair;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// How long the kernels take on an adapter, whole frames, and on the processor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Calibration {
    /// The adapter's name.
    pub adapter: String,
    /// Backend of the adapter: the same GPU has other timings under another backend.
    pub backend: String,
    /// Its driver: another one is another adapter.
    pub driver: String,
    /// Threads of the processor.
    pub threads: usize,
    /// Direct sums, by pairs of segments.
    pub direct: SumCost,
    /// Barnes-Hut by the bound, by segments of all pairs of curves.
    pub barnes_hut: SumCost,
    /// Counting crossings.
    pub crossings: CountingCost,
}

/// What a sum takes, by the size of its work.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SumCost {
    /// The smallest sum on the adapter, in milliseconds.
    pub round_trip_ms: f64,
    /// A unit of the work there, in nanoseconds.
    pub adapter_ns: f64,
    /// The same on all threads of the processor.
    pub processor_ns: f64,
}

/// What counting the crossings of a frame takes on an adapter, from vertices in memory to linking numbers, by its counts.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CountingCost {
    /// The smallest frame, in milliseconds.
    pub round_trip_ms: f64,
    /// A segment of the frame, in nanoseconds.
    pub segment_ns: f64,
    /// A potential link.
    pub link_ns: f64,
    /// A test: a pair of segments whose boxes overlap.
    pub test_ns: f64,
    /// By what factor times differ from these, typically: 1 where the counts tell everything.
    pub misfit: f64,
    /// What counting takes on all threads of the processor, by what its plan predicts.
    pub processor_factor: f64,
}

/// Counts of a frame whose crossings are counted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct CountingWork {
    /// Segments of all curves.
    pub segments: u64,
    /// Potential links.
    pub links: u64,
    /// Pairs of segments whose boxes overlap.
    pub tests: u64,
}

impl SumCost {
    /// Whether so much work is predicted to take less than on the processor.
    pub fn wins(&self, work: u64) -> bool {
        let millions = work as f64 * 1e-6;
        self.round_trip_ms + self.adapter_ns * millions < self.processor_ns * millions
    }

    /// The work from which on the adapter is predicted to take less than the processor; none where it never does.
    pub fn break_even(&self) -> Option<u64> {
        let gain = self.processor_ns - self.adapter_ns;
        let work = self.round_trip_ms * 1e6 / gain;
        // Not where it is NaN either.
        (gain > 0.0).then_some((work.ceil() as u64).saturating_add(1))
    }

    fn is_valid(&self) -> bool {
        let positive = |x: f64| x > 0.0 && x.is_finite();
        positive(self.round_trip_ms) && positive(self.adapter_ns) && positive(self.processor_ns)
    }
}

impl CountingCost {
    /// What a frame is predicted to take on the adapter, in milliseconds.
    pub(crate) fn adapter_ms(&self, work: CountingWork) -> f64 {
        let CountingWork {
            segments,
            links,
            tests,
        } = work;
        let ns = segments as f64 * self.segment_ns
            + links as f64 * self.link_ns
            + tests as f64 * self.test_ns;
        self.round_trip_ms + 1e-6 * ns
    }

    fn is_valid(&self) -> bool {
        let costs = [self.segment_ns, self.link_ns, self.test_ns];
        let positive = |x: f64| x > 0.0 && x.is_finite();
        positive(self.round_trip_ms)
            && positive(self.processor_factor)
            && self.misfit >= 1.0
            && self.misfit.is_finite()
            && costs.iter().all(|&x| x >= 0.0 && x.is_finite())
    }
}

impl Calibration {
    /// Whether it is of this adapter, as it is now, and of the threads there are.
    pub fn is_of(&self, info: &DeviceInfo) -> bool {
        (&self.adapter, &self.backend, &self.driver) == (&info.name, &info.backend, &info.driver)
            && self.threads == rayon::current_num_threads()
    }

    /// That of an adapter, if it was measured as it is now.
    pub fn of(info: &DeviceInfo) -> Option<Calibration> {
        read(&file()?).ok()?.into_iter().find(|c| c.is_of(info))
    }

    /// The one of the fastest adapter for as many threads as there are, if any was measured.
    pub fn fastest() -> Option<Calibration> {
        let mut all = read(&file()?).ok()?;
        all.retain(|c| c.threads == rayon::current_num_threads());
        all.into_iter()
            .min_by(|a, b| a.direct.adapter_ns.total_cmp(&b.direct.adapter_ns))
    }

    /// Keeps it, in the place of an older one.
    ///
    /// Errors: [`Error::File`]; [`Error::Device`] where the user has no folder for such things.
    pub fn keep(&self) -> Result<PathBuf> {
        let file =
            file().ok_or_else(|| Error::Device("no folder to keep a calibration in".into()))?;
        self.keep_in(&file)?;
        Ok(file)
    }

    fn keep_in(&self, file: &Path) -> Result<()> {
        // What cannot be read is of no use.
        let mut all = read(file).unwrap_or_default();
        let key = |c: &Calibration| (c.adapter.clone(), c.backend.clone(), c.threads);
        all.retain(|c| key(c) != key(self));
        all.push(self.clone());
        let folder = file.parent().unwrap_or(Path::new("."));
        std::fs::create_dir_all(folder).map_err(Error::file(folder))?;
        // Moved to its place as a whole: who reads it meanwhile, or after a kill, finds what it was before.
        let whole = file.with_extension(format!("{}.part", std::process::id()));
        let text = format!("{:#}\n", json!(all));
        let moved = std::fs::write(&whole, text).and_then(|()| std::fs::rename(&whole, file));
        moved.map_err(|e| {
            // It may not be there at all.
            let _ = std::fs::remove_file(&whole);
            Error::file(file)(e)
        })
    }

    /// None where something is missing, as from what an older version has kept, or is no time.
    fn from_json(v: Value) -> Option<Calibration> {
        let c: Calibration = serde_json::from_value(v).ok()?;
        c.is_valid().then_some(c)
    }

    /// Whether all of it are times, and what else they come from.
    pub(crate) fn is_valid(&self) -> bool {
        self.direct.is_valid() && self.barnes_hut.is_valid() && self.crossings.is_valid()
    }
}

/// Pairs of segments of some pairs of curves: what direct sums go by.
pub(crate) fn segment_pairs(set: &CurveSet, pairs: &[Pair]) -> u64 {
    let segments = |i: u32| u64::from(set.curve(i as usize).segments);
    pairs.iter().map(|&(i, j)| segments(i) * segments(j)).sum()
}

/// Segments of some pairs of curves: what Barnes-Hut goes by.
#[cfg(feature = "gpu")]
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

/// An adapter that was never measured, for tests.
#[cfg(test)]
impl Calibration {
    /// Its frames take `round_trip_ms`, and what its work takes is to the processor's as 1 to `speed`.
    pub(crate) fn made_up(round_trip_ms: f64, speed: f64) -> Calibration {
        let sum = |processor_ns: f64| SumCost {
            round_trip_ms,
            adapter_ns: processor_ns / speed,
            processor_ns,
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
                misfit: 1.0,
                processor_factor: 1.0,
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn large_sums_win_where_the_adapter_is_faster() {
        let mut sum = SumCost {
            round_trip_ms: 1.0,
            adapter_ns: 0.01,
            processor_ns: 1.01,
        };
        assert!(sum.wins(1_000_001) && !sum.wins(999_999) && !sum.wins(0));
        let from = sum.break_even().unwrap();
        assert!((1_000_000..1_000_010).contains(&from) && sum.wins(from));
        sum.adapter_ns = 2.0;
        assert!(!sum.wins(u64::MAX));
        assert_eq!(sum.break_even(), None);
    }

    /// It came back to 0, which is all of them.
    #[test]
    fn a_break_even_beyond_all_numbers_is_no_small_one() {
        let sum = SumCost {
            round_trip_ms: 1e300,
            adapter_ns: 1e-300,
            processor_ns: 1e-299,
        };
        assert_eq!(sum.break_even(), Some(u64::MAX));
    }

    #[test]
    fn what_is_kept_comes_back_and_nonsense_does_not() {
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
            assert_eq!(with(&|c| c.crossings.processor_factor = x), None);
            assert_eq!(with(&|c| c.crossings.misfit = x), None);
        }
        // A fit may find that a segment costs nothing.
        assert!(with(&|c| c.crossings.segment_ns = 0.0).is_some());
        assert_eq!(with(&|c| c.crossings.processor_factor = 0.0), None);
        // A version that measured direct sums only.
        let old = json!({
            "adapter": "A", "driver": "1", "threads": 8,
            "round_trip_ms": 1.0, "pair_ns": 0.01, "processor_pair_ns": 1.0,
        });
        assert_eq!(Calibration::from_json(old), None);
    }

    #[test]
    fn a_file_is_replaced_as_a_whole() {
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
        // The same adapter under another backend has its own timings.
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
        // Nothing else is left there.
        assert_eq!(file.parent().unwrap().read_dir().unwrap().count(), 1);
        let blocked = folder.path().join("blocked");
        std::fs::create_dir_all(blocked.join("devices.json").join("x")).unwrap();
        let good = Calibration::made_up(0.5, 10.0);
        assert!(good.keep_in(&blocked.join("devices.json")).is_err());
        assert_eq!(blocked.read_dir().unwrap().count(), 1);
    }

    #[test]
    fn a_file_is_read_as_far_as_it_makes_sense() {
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
