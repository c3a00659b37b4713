//! Safe fractions of random steps, judged by the ledger and by the linking numbers.

use super::*;
use crate::curve::Precision;

/// Counts of steps that were shortened to their safe fractions.
#[derive(Debug, Default)]
struct Tally {
    steps: u32,
    /// Steps with a safe fraction between 0 and 1.
    shortened: u32,
    /// Steps of which no part is proven to be safe.
    none: u32,
    /// Number of shortened steps in double precision with a passage, and number of those that have
    /// it again after another millionth of the step.
    lengthened: [u32; 2],
}

/// Shortens random steps to their safe fractions. Fails if a pull-through is left.
fn shorten(seeds: std::ops::Range<u64>, basis: Basis) -> Tally {
    let [mut ledger, mut judge] = [(); 2].map(|()| Ledger::new(MOTION_LIMIT, ALL));
    let mut tally = Tally::default();
    for seed in seeds {
        let [before, after] = random_step(&mut Random::new(seed), basis);
        let (contacts, _) = ledger.first_frame(&before);
        let outcome = ledger.step([&before, &after], &contacts, None);
        let fraction = ledger.safe_fraction([&before, &after], &contacts, &outcome);
        tally.steps += 1;
        tally.none += u32::from(fraction == 0.0);
        if fraction == 0.0 {
            continue;
        }
        let mut step_to = |fraction: f64| {
            let mut at = None;
            before.toward(&after, fraction, &mut at).unwrap();
            let at = at.unwrap();
            let outcome = judge.first_step(&before, &at, ALL, None);
            (at, outcome)
        };
        let (at, shortened) = step_to(fraction);
        let found = (
            &shortened.events,
            &shortened.unresolved,
            &shortened.undecided,
        );
        assert_eq!(found, (&vec![], &vec![], &vec![]), "{basis:?} {seed}");
        // Curves that touch in the first frame have no linking number there.
        let linking = [&before, &at].map(certificate);
        if contacts.pairs().is_empty() && linking[0].undefined.is_empty() {
            assert_eq!(linking[0].links, linking[1].links, "{basis:?} {seed}");
        }
        if fraction == 1.0 {
            continue;
        }
        tally.shortened += 1;
        let passes = |o: &Outcome| !o.events.is_empty() || !o.unresolved.is_empty();
        if before.precision() == Precision::F64 && passes(&outcome) {
            let (_, lengthened) = step_to((fraction + 1e-6).min(1.0));
            let passed = passes(&lengthened);
            tally.lengthened[0] += 1;
            tally.lengthened[1] += u32::from(passed);
        }
    }
    tally
}

#[test]
fn a_step_to_the_safe_fraction_pulls_nothing_through() {
    for basis in Basis::ALL {
        let tally = shorten(0..40, basis);
        assert!(tally.shortened > 5, "{basis:?}: {tally:?}");
        let [with_passage, again] = tally.lengthened;
        assert!(again * 100 >= with_passage * 95, "{basis:?}: {tally:?}");
    }
}

/// Run with `cargo test --release --lib safe_fraction -- --ignored --nocapture`.
#[test]
#[ignore = "a minute or more"]
fn a_hundred_thousand_steps_are_shortened() {
    for basis in Basis::ALL {
        let tally = shorten(1000..26_000, basis);
        println!("{basis:?}: {tally:?}");
        let [with_passage, again] = tally.lengthened;
        assert!(again * 100 >= with_passage * 99, "{basis:?}: {tally:?}");
    }
}
