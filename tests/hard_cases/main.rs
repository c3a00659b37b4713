//! Hard cases: small scenes with known exact answers, on which linking numbers easily go wrong.
//!
//! Every case has a name, a description of its difficulty, and the origin of its answer: a
//! construction, or the exact oracle on integer coordinates. [`all`] lists them.
//! [`runner::complaints`] runs one through any function from curves to a certificate, in both
//! precisions, in other views (the properties 1 to 3 of `src/kernels/mod.rs`) and on several
//! threads. The rule for every kernel is: the right integer, or no answer; never a wrong integer,
//! never a panic.
//!
//! A new kernel needs a [`runner::Kernel`] and a test of one line.

mod case;
mod integers;
mod links;
mod numbers;
mod runner;
mod splines;
#[path = "../support/mod.rs"]
mod support;
mod touching;

use crate::support::oracle;
use case::{Case, Expected};
use runner::{EARLY_EXIT, EVENTS, FULL, GROWTH, INTERVAL, JUMP, Kernel, STILL, SUMS, Views};
use std::collections::BTreeSet;

/// Runs numbered cases through a kernel.
fn run(kernel: Kernel, cases: impl Iterator<Item = Case>, views: fn(usize) -> Views) {
    let panics = runner::count_panics();
    let pools = runner::pools();
    let complaints: Vec<String> = cases
        .enumerate()
        .flat_map(|(k, case)| runner::complaints(&case, kernel, views(k), &pools))
        .collect();
    assert_eq!(runner::count_panics(), panics, "a thread panicked");
    let count = complaints.len();
    assert!(
        count == 0,
        "{count} wrong answers:\n{}",
        complaints.join("\n")
    );
}

/// Runs one view of each case. Skips cases with very many near segments, because these kernels use
/// several threads and reference frames.
fn run_quickly(kernel: Kernel) {
    let small = |case: &Case| case.curves.segments() <= 5000;
    run(
        kernel,
        runner::collection().into_iter().filter(small),
        Views::Turn,
    );
}

#[test]
fn full_runs_are_correct() {
    run(FULL, runner::collection().into_iter(), |_| Views::All);
}

/// If a sum gave a wrong integer, or a number for curves that touch, it would appear in the
/// certificate.
#[test]
fn sums_are_correct_or_undecided() {
    for kernel in SUMS {
        let most = if kernel.name == INTERVAL.name {
            200
        } else {
            3000
        };
        let small = move |case: &Case| case.curves.segments() <= most;
        run(
            kernel,
            runner::collection().into_iter().filter(small),
            Views::Turn,
        );
    }
}

#[test]
fn early_exit_is_correct() {
    run_quickly(EARLY_EXIT);
}

#[test]
fn unchanged_frames_are_correct() {
    run_quickly(STILL);
}

#[test]
fn a_jump_is_correct() {
    run_quickly(JUMP);
}

#[test]
fn growth_is_correct() {
    run_quickly(GROWTH);
}

#[test]
fn the_search_for_pull_throughs_is_correct() {
    run_quickly(EVENTS);
}

/// Runs every view of every case through every kernel.
#[test]
#[ignore = "takes minutes"]
fn every_view_is_correct() {
    for kernel in [FULL, EARLY_EXIT, STILL, JUMP, GROWTH, EVENTS] {
        run(kernel, runner::collection().into_iter(), |_| Views::All);
    }
}

#[test]
fn names_are_unique() {
    let cases = runner::collection();
    let names: BTreeSet<&str> = cases.iter().map(|c| &c.name[..]).collect();
    assert_eq!(names.len(), cases.len());
    println!("{} cases", cases.len());
}

/// Checks the constructions with the oracle where possible. The oracle depends neither on the
/// constructions nor on the kernels.
#[test]
fn the_oracle_agrees_with_the_constructions() {
    let mut checked = 0;
    for case in runner::collection() {
        if case.curves.segments() > 2000 {
            continue;
        }
        let Some(polygons) = case.as_integers() else {
            continue;
        };
        checked += 1;
        let Expected { degenerate, .. } = Expected::of_integers(&polygons);
        assert_eq!(degenerate, case.expected.degenerate, "{}", case.name);
        for j in 0..polygons.len() {
            for i in 0..j {
                if degenerate.contains(&i) || degenerate.contains(&j) {
                    continue;
                }
                let expected = match case.expected.of(i, j) {
                    case::Answer::Number(lambda) => Some(lambda),
                    _ => None,
                };
                let found = oracle::linking_number(&polygons[i], &polygons[j]);
                assert_eq!(found, expected, "{}, ({i}, {j})", case.name);
            }
        }
    }
    println!("{checked} checked");
    assert!(checked > 100);
}
