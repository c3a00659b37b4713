//! The hard cases on a GPU, and the device as offered by the library.
//!
//! Without an adapter these tests are shown as ignored, never as passed. Software Vulkan (lavapipe)
//! counts as an adapter.

#[path = "../hard_cases/case.rs"]
#[allow(dead_code, reason = "shared with the hard cases on the CPU")]
mod case;
#[path = "../hard_cases/integers.rs"]
mod integers;
#[path = "../hard_cases/links.rs"]
mod links;
#[path = "../hard_cases/numbers.rs"]
mod numbers;
#[path = "../hard_cases/runner.rs"]
#[allow(dead_code, reason = "shared with the hard cases on the CPU")]
mod runner;
#[path = "../hard_cases/splines.rs"]
mod splines;
#[path = "../support/mod.rs"]
mod support;
#[path = "../hard_cases/touching.rs"]
mod touching;

use libtest_mimic::{Arguments, Failed};
use linkwatch::kernels::{Device, Method, devices};
use linkwatch::scenes::Scene;
use linkwatch::{Certifier, Error, Session, SessionOptions, Verdict};
use runner::{Kernel, ON_DEVICE, Views};
use support::session::Step;
use support::trial::trial;

/// Runs each case in one of its views, chosen in turn. With `LINKWATCH_LARGE_CASES`, also runs the
/// large cases, and the small cases in all views.
fn hard_cases(kernel: Kernel) -> Result<(), Failed> {
    let panics = runner::count_panics();
    let pools = runner::pools();
    // They take minutes on a software renderer.
    let all = std::env::var_os("LINKWATCH_LARGE_CASES").is_some();
    let complaints: Vec<String> = (runner::collection().iter().enumerate())
        .filter(|(_, case)| all || case.curves.segments() <= 800)
        .flat_map(|(k, case)| {
            let views = match case.curves.segments() {
                0..=200 if all => Views::All,
                _ => Views::Turn(k),
            };
            runner::complaints(case, kernel, views, &pools)
        })
        .collect();
    if runner::count_panics() > panics {
        return Err("a thread panicked".into());
    }
    match complaints.len() {
        0 => Ok(()),
        n => Err(format!("{n} wrong answers:\n{}", complaints.join("\n")).into()),
    }
}

const SCENES: [&str; 7] = [
    "ribbon:segments=20000,lambda=50",
    "torus_link:segments=4000,toroidal=30,poloidal=20",
    "woundball:segments=20001,crossings=100",
    "chainmail:rows=12,columns=12,crumple=0.5",
    "knit:rows=6,stitches=20,segments=1200",
    "square_link:loops=60,segments=6000",
    "rubber_bands:bands=60",
];

fn options(device: Device, kernel: Method) -> SessionOptions {
    SessionOptions {
        kernel,
        device,
        ..SessionOptions::default()
    }
}

/// The certificates of scenes equal those of their constructions, for every kernel and in both
/// precisions.
fn scenes() -> Result<(), Failed> {
    for text in SCENES {
        let built = text.parse::<Scene>()?.build()?;
        for method in [Method::Crossings, Method::Direct, Method::BarnesHut] {
            let mut certifier = Certifier::new(&options(Device::Gpu, method))?;
            let (found, stats) = certifier.certify(&built.curves);
            if *found != built.certificate {
                return Err(format!("{text}, {method}: {found:?}").into());
            }
            println!(
                "{text}, {method}: {} potential links; {:?}; {:?}",
                stats.potential_links,
                certifier.ladder(),
                certifier.offload()
            );
        }
    }
    Ok(())
}

/// Successive frames give the same reports on the GPU and on the CPU.
fn frames() -> Result<(), Failed> {
    let built = "chainmail:rows=8,columns=9".parse::<Scene>()?.build()?;
    let broken = runner::changed(&built.curves, |coordinates| {
        let points = 3 * built.curves.curve(40).points as usize;
        let moved = &mut coordinates[40 * points..41 * points];
        moved.iter_mut().for_each(|x| *x += 100.0);
    });
    let reports = |device| -> Result<_, Failed> {
        let mut session = Session::new(options(device, Method::Auto))?;
        let frames = [&built.curves, &broken, &built.curves];
        let step = |(k, set)| session.step(k, set).report;
        Ok((0..).zip(frames).map(step).collect::<Vec<_>>())
    };
    let [device, cpu] = [reports(Device::Gpu)?, reports(Device::Cpu)?];
    for (a, b) in device.iter().zip(&cpu) {
        if (a.verdict, &a.changes, &a.defects) != (b.verdict, &b.changes, &b.defects) {
            return Err(format!("{a:?}\n{b:?}").into());
        }
    }
    match device[2].verdict {
        Verdict::Intact => Ok(()),
        other => Err(format!("{other}").into()),
    }
}

/// The error of an unknown name lists the adapters.
fn names() -> Result<(), Failed> {
    let unknown = Session::new(options(Device::Named("none such".into()), Method::Auto));
    let Err(Error::Device(words)) = unknown else {
        return Err("found".into());
    };
    let all = devices();
    match all.iter().all(|d| words.contains(&d.name)) && !all.is_empty() {
        true => Ok(()),
        false => Err(words.into()),
    }
}

fn main() {
    let arguments = Arguments::from_args();
    // Kept open, because opening the adapter again would take long.
    let opened = Session::new(options(Device::Gpu, Method::Auto));
    if let Err(e) = &opened {
        println!("no adapter: {e}");
    }
    let present = opened.is_ok();
    let cases = ON_DEVICE.into_iter().map(|kernel| {
        let name = format!("hard_cases::{}", kernel.name.replace(' ', "_"));
        trial(name, present, move || hard_cases(kernel))
    });
    let others = [
        trial(
            "scenes_have_the_numbers_of_their_constructions",
            present,
            scenes,
        ),
        trial("frames_get_the_same_reports_as_on_the_cpu", present, frames),
        trial("an_unknown_name_lists_the_adapters", present, names),
    ];
    libtest_mimic::run(&arguments, cases.chain(others).collect()).exit();
}
