//! Hard cases: small scenes whose exact answers are known, and on which linking numbers easily go wrong.
//!
//! Every case is named and says what is hard about it and where its answer comes from: a construction, or the exact
//! oracle on integer coordinates. [`all`] lists them; [`runner::complaints`] runs one through any function from curves to a
//! certificate, in both precisions, seen otherwise (the properties 1 to 3 of `src/kernels/mod.rs`) and on several threads.
//! The rule for every kernel: the right integer, or an honest refusal; never a wrong integer, never a panic.
//!
//! A new kernel is a [`runner::Kernel`] and a test of one line.

mod case;
mod integers;
mod links;
mod numbers;
mod runner;
mod splines;
mod touching;

use case::{Case, Expected};
use linkwatch::kernels::oracle;
use runner::{EARLY_EXIT, EVENTS, FULL, GROWTH, INTERVAL, JUMP, Kernel, STILL, SUMS, Views};
use std::collections::BTreeSet;

/// Runs cases, with a number each, through a kernel.
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

/// Steps cost threads and references: one view of each case, and no case of very many near segments.
fn run_quickly(kernel: Kernel) {
    let small = |case: &Case| case.curves.segments() <= 5000;
    run(
        kernel,
        runner::collection().into_iter().filter(small),
        Views::Turn,
    );
}

#[test]
fn a_full_run_is_right() {
    run(FULL, runner::collection().into_iter(), |_| Views::All);
}

/// A wrong integer, and a number for curves that touch, would be taken from the sum and show in the certificate.
#[test]
fn sums_are_right_or_refuse() {
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
fn early_exit_is_right() {
    run_quickly(EARLY_EXIT);
}

#[test]
fn still_frames_are_right() {
    run_quickly(STILL);
}

#[test]
fn a_jump_is_right() {
    run_quickly(JUMP);
}

#[test]
fn growth_is_right() {
    run_quickly(GROWTH);
}

#[test]
fn a_search_for_pull_throughs_is_right() {
    run_quickly(EVENTS);
}

/// Every view of every case through every kernel.
#[test]
#[ignore = "takes minutes"]
fn every_view_is_right() {
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

/// The constructions, by the oracle wherever it can: it knows neither them nor the kernels.
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
