//! Hostile and broken input. A seeded generator applies named mutations to valid input. An oracle,
//! written from `docs/reference/bus.md`, predicts the reaction.
//!
//! | target | input |
//! |---|---|
//! | `header`, `layout`, `payload`, `all_parts` | frames, through the bus ([`frames`]) |
//! | `values_that_change_after_they_were_sent` | the same, with a writer beside it ([`frames`]) |
//! | `messages_of_a_watcher` | messages to the client of the crate ([`messages`]) |
//! | `recordings` | MCAP files ([`recordings`]) |
//! | `model_files_and_certificates` | files ([`models`]) |
//! | `every_curve_of_a_file_is_read_or_counted` | files of known curves ([`left_out`]) |
//!
//! A target runs units. A unit depends on its seed alone; the message of a failure has the seed and
//! the command that repeats it. The numbers of units are those of a check in seconds;
//! `ten_million_frames` is ignored and takes half an hour, and `ten_thousand_files_of_each_format`
//! some minutes.

mod bytes;
mod frame;
mod frames;
mod left_out;
mod memory;
mod messages;
mod models;
mod mutations;
mod oracle;
mod recordings;
#[path = "../support/mod.rs"]
mod support;

use std::sync::atomic::{AtomicU32, Ordering};
use support::random::Random;

/// Returns the name of a service that no other test uses.
fn service() -> String {
    static COUNT: AtomicU32 = AtomicU32::new(0);
    let n = COUNT.fetch_add(1, Ordering::Relaxed);
    format!("linkwatch fuzz {}.{n}", std::process::id())
}

/// Runs units 0 to `count - 1` of a target, or the one that `LINKWATCH_FUZZ_SEED` names.
fn units(target: &'static str, count: u64, mut run: impl FnMut(&mut Random)) {
    let given = std::env::var("LINKWATCH_FUZZ_SEED").ok();
    let given = given.map(|seed| seed.parse().expect("LINKWATCH_FUZZ_SEED is a number"));
    let seeds = match given {
        Some(seed) => seed..seed + 1,
        None => 0..count,
    };
    for seed in seeds {
        let replay = Replay { target, seed };
        let name = target.bytes().map(u64::from).sum();
        run(&mut Random::from_key([name, seed]));
        drop(replay);
    }
}

/// Prints the command that repeats a unit if the unit fails.
struct Replay {
    target: &'static str,
    seed: u64,
}

impl Drop for Replay {
    fn drop(&mut self) {
        if std::thread::panicking() {
            let Replay { target, seed } = self;
            eprintln!(
                "to repeat it: LINKWATCH_FUZZ_SEED={seed} cargo test --release --test fuzz \
                 {target} -- --exact --include-ignored"
            );
        }
    }
}
