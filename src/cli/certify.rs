//! `linkwatch certify`: computes the certificates of models.

use super::braid_args::BraidArgs;
use super::files::{Content, Files, Overwrite, file_name, write_text};
use super::frames::{FrameArgs, Picked};
use super::kernel::{Kernel, kernel};
use super::number::{not_negative, positive};
use super::output::{self, count, list, millis, percent, plural, plural_of, with_progress};
use super::{Outcome, explain, open};
use linkwatch::kernels::{Device, Method, Offload};
use linkwatch::{
    Braids, Certificate, Certifier, Error, Events, FrameInfo, ImageLink, InvariantKind, Ladder,
    Received, Result, Session, SessionOptions, Stats, picture,
};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Maximum number of links of each of several models that are listed; the rest is counted.
const LINKS: usize = 20;

/// Maximum number of links whose place is marked in a picture.
const PLACES: usize = 12;

/// Compute the linking numbers of all pairs of curves: the certificate of a model's topology
#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(flatten)]
    frames: FrameArgs,
    #[command(flatten)]
    braid_args: BraidArgs,
    /// Write the ends of the braids that were found in this frame (one model only), for the option
    /// --braid of other commands
    #[arg(long, value_name = "FILE", help_heading = super::WRITE, requires = "braid")]
    write_braid: Option<PathBuf>,
    /// Write the certificate to a file (one model only) instead of stdout
    #[arg(short, long, value_name = "CERT", help_heading = super::WRITE)]
    output: Option<PathBuf>,
    /// Draw a picture of each model, with linked curves in red, as `NAME.svg` in a folder, which is
    /// created if it does not exist
    #[arg(long, value_name = "FOLDER", help_heading = super::WRITE)]
    svg: Option<PathBuf>,
    #[command(flatten)]
    overwrite: Overwrite,
    /// Kernel that computes linking numbers: auto, crossings, direct, angle-sum, barnes-hut, fmm or
    /// interval. All give the same numbers: pairs that the error bound of a sum does not decide are
    /// decided by counting crossings
    ///
    /// Settings follow the name: `barnes-hut,beta=B` expands nodes that are further apart than B
    /// times their radii, and `,target=E` sums again if the published estimate of the error is
    /// above E; `fmm,order=P` sets the order of the expansions, 2 to 20. Without them the error
    /// bound decides
    #[arg(
        long, value_name = "KERNEL[,..]", help_heading = super::KERNELS, default_value = "auto",
        value_parser = kernel
    )]
    kernel: Kernel,
    /// Device that runs the kernel: auto, cpu, gpu, or the index or name of an adapter (`linkwatch
    /// devices`)
    #[arg(long, value_name = "DEVICE", help_heading = super::KERNELS, default_value_t)]
    device: Device,
    /// Keep only linking numbers that cannot change if every vertex moves by up to R along each
    /// axis (polylines)
    #[arg(
        long, value_name = "R", help_heading = super::KERNELS,
        conflicts_with_all = ["kernel", "braid"]
    )]
    noise: Option<f64>,
    /// Print the Gauss linking integral of every pair of polylines, open or closed, as
    /// `i,j,integral,bound`: real numbers with a proven bound, never rounded
    #[arg(long, conflicts_with_all = ["kernel", "noise", "output", "svg"])]
    open: bool,
    /// Error bound of --open to reach, if possible
    #[arg(
        long, value_name = "BOUND", default_value_t = 1e-6, value_parser = positive,
        requires = "open"
    )]
    tolerance: f64,
    /// Skip the pairs of --open whose integral is smaller than this in size
    #[arg(
        long, value_name = "SIZE", default_value_t = 0.0, value_parser = not_negative,
        requires = "open"
    )]
    at_least: f64,
    /// Add invariants to the certificate: `self` (v2, v3 and the determinant of each closed curve)
    /// and `triple` (Milnor's triple linking numbers)
    #[arg(
        long, value_name = "self,triple", value_delimiter = ',',
        conflicts_with_all = ["braid", "explain", "noise", "open"]
    )]
    invariants: Vec<InvariantKind>,
    /// Print the decisions of each stage and the predicted cost, not the certificate
    #[arg(
        long, help_heading = super::KERNELS,
        conflicts_with_all = [
            "braid", "kernel", "noise", "open", "output", "svg", "write_braid",
        ]
    )]
    explain: bool,
}

impl Args {
    /// Returns the options of a session with this kernel and device.
    fn options(&self) -> SessionOptions {
        SessionOptions {
            kernel: self.kernel.method,
            accuracy: self.kernel.accuracy,
            device: self.device.clone(),
            ..SessionOptions::default()
        }
    }
}

/// Certificate of a frame.
#[derive(Default)]
struct Certified {
    /// Braids with their ends.
    braids: Option<Braids>,
    certificate: Certificate,
    stats: Stats,
    /// Decisions of sums and of counting; `None` with noise, braids, or a periodic cell.
    ladder: Option<Ladder>,
    /// Work done on the GPU.
    offload: Offload,
    took: Duration,
    /// True if a curve lacks a requested invariant.
    incomplete: bool,
}

/// Computes the certificate of a frame.
fn certify(frame: &Picked, args: &Args) -> Result<Certified> {
    let start = Instant::now();
    let braids = args.braid_args.braids()?;
    let (name, set, cell) = (&frame.name, &frame.curves, frame.cell);
    let mut certified = match braids.is_some() || cell.is_some() {
        true => certify_in_session(frame, args, braids)?,
        false => certify_alone(frame, args)?,
    };
    let certificate = &mut certified.certificate;
    for &kind in &args.invariants {
        for defect in certificate.add_invariants(set, kind) {
            tracing::warn!("{name}: {}", defect.sentence_named(set.extent(), &[]));
            certified.incomplete = true;
        }
    }
    if cell.is_some() && !args.invariants.is_empty() {
        tracing::warn!("{name}: --invariants do not consider periodic images");
    }
    if let uncomputed @ 1.. = certificate.uncomputed() {
        let those = plural_of(uncomputed, "curve or triple", "curves or triples");
        tracing::warn!("{name}: invariants of {those} were not computed: too many crossings");
        certified.incomplete = true;
    }
    certified.took = start.elapsed();
    if frame.is_first {
        output::warn_of_open_curves(name, &certified.stats, None);
        output::tell_of_yarns(name, certificate.periods.len(), None);
        args.frames.cell_args.warn_of_segments(name, set, cell);
    }
    if let repeated @ 1.. = certified.stats.repeated_vertices {
        let vertices = plural_of(repeated, "repeated vertex", "repeated vertices");
        tracing::warn!("{name}: {vertices} merged");
    }
    for defect in &certificate.undefined {
        tracing::warn!("{name}: {}", defect.sentence_named(set.extent(), &[]));
    }
    Ok(certified)
}

/// Computes the certificate of a frame with braids or with a periodic cell.
fn certify_in_session(frame: &Picked, args: &Args, braids: Option<Braids>) -> Result<Certified> {
    let (name, set) = (&frame.name, &frame.curves);
    // Curves that run through the cell are worth a certificate even if none is closed.
    let has_closed = set.open_curves() < set.len();
    let search = frame.cell.is_some() && !has_closed;
    let events = if search { Events::Between } else { Events::Off };
    let mut session = Session::new(SessionOptions {
        cell: frame.cell,
        wrapped: args.frames.cell_args.wrapped.filter(|wrapped| !wrapped),
        // The frame has its closed curves already; the session must not close more.
        keep_open: true,
        events,
        braids,
        ..args.options()
    })?;
    let received = Received::new(FrameInfo::default(), Ok(Arc::new(set.clone())));
    let verified = with_progress(name, session.progress(), || session.verify(received))?;
    if let Some(why) = verified.report.rejected {
        return Err(Error::Usage(why));
    }
    let certificate = session.baseline().cloned().unwrap_or_default();
    let braids = session.braids();
    if !has_closed && braids.is_none() && certificate.periods.is_empty() {
        return Err(frame.nothing_closed());
    }
    Ok(Certified {
        braids,
        certificate,
        stats: verified.report.stats,
        offload: verified.offload,
        ..Certified::default()
    })
}

/// Computes the certificate of a frame with neither braids nor a periodic cell.
fn certify_alone(frame: &Picked, args: &Args) -> Result<Certified> {
    let (name, set) = (&frame.name, &frame.curves);
    if set.open_curves() == set.len() {
        return Err(frame.nothing_closed().in_file(name));
    }
    let mut certifier = Certifier::new(&args.options())?;
    let progress = certifier.progress();
    let (certificate, stats) = with_progress(name, progress, || {
        let (certificate, stats) = match args.noise {
            Some(noise) => certifier.certify_noisy(set, noise)?,
            None => certifier.certify(set),
        };
        Ok::<_, Error>((certificate.clone(), stats))
    })?;
    Ok(Certified {
        certificate,
        stats,
        ladder: args.noise.is_none().then(|| certifier.ladder()),
        offload: certifier.offload(),
        ..Certified::default()
    })
}

/// Runs the command.
pub fn run(args: &Args, json: bool) -> Result<Outcome> {
    let models = args.frames.models()?;
    let outputs = [("-o", &args.output), ("--write-braid", &args.write_braid)];
    let all = outputs.into_iter().chain([("--svg", &args.svg)]);
    let mut given = all.filter_map(|(option, file)| file.as_ref().and(Some(option)));
    let single = given.next();
    if let Some(option @ ("-o" | "--write-braid")) = single
        && models.len() > 1
    {
        let given = models.len();
        return Err(usage!("{option} is for one model; {given} were given"));
    }
    let mut files = Files::new(args.overwrite);
    files.reads(args.braid_args.file());
    files.reads(models.iter().flatten());
    files.reads(args.frames.format.bonds(&models.concat()));
    for (option, file) in outputs {
        files.writes(option, file, Content::Text)?;
    }
    if let Some(folder) = &args.svg {
        std::fs::create_dir_all(folder).map_err(Error::file(folder))?;
        let pictures = models
            .iter()
            .flatten()
            .map(|model| picture_of(model, folder));
        files.writes("--svg", pictures, Content::Text)?;
    }
    args.frames.for_each(&models, single, |frame| {
        let is_alone = models.len() == 1 && !frame.several;
        let name = &frame.name;
        if let Some(cell) = frame.cell.filter(|_| args.noise.is_some() || args.open) {
            return Err(usage!(
                "{name}: the frame has a periodic cell ({cell}), but --noise and --open do not \
                 consider periodic images: --cell none ignores it"
            ));
        }
        if args.explain {
            let options = SessionOptions {
                cell: frame.cell,
                ..args.options()
            };
            return explain::print(&frame, &options, json);
        }
        if args.open {
            let (tolerance, least) = (args.tolerance, args.at_least);
            return open::print(&frame, tolerance, least, !is_alone, json);
        }
        let certified = certify(&frame, args)?;
        if !frame.several {
            log_work(name, &certified, args);
        }
        match json {
            true => print_json(&frame, &certified, args),
            false if frame.several => print_line(name, &certified),
            false => print(name, &certified, args, is_alone),
        }
        write(&frame, &certified, args)?;
        let undefined = !certified.certificate.undefined.is_empty();
        Ok(Outcome::undecided_if(certified.incomplete || undefined))
    })
}

/// Prints a certificate.
fn print_json(frame: &Picked, c: &Certified, args: &Args) {
    frame.print_json(serde_json::json!({
        "left_out": frame.left_out,
        "joined_curves": frame.joined,
        "offload": c.offload,
        "basis": frame.curves.basis(),
        "certificate": c.certificate,
        "stats": c.stats,
        "exact_share": c.stats.exact_share(),
        "kernel": args.kernel.method,
        "ladder": c.ladder,
        "ms": output::milliseconds(c.took),
    }));
}

/// Logs the work of a certificate that was not usual.
fn log_work(name: &str, c: &Certified, args: &Args) {
    if c.stats.exact > 0 {
        let tests = plural(c.stats.exact, "orientation test");
        let share = percent(c.stats.exact_share());
        tracing::info!(
            "{name}: {tests} decided exactly ({share}), because floating-point numbers were not \
             precise enough: slower, but equally certain"
        );
    }
    let method = args.kernel.method;
    let asked_to_sum = !matches!(method, Method::Auto | Method::Crossings);
    if let Some(l) = c.ladder.as_ref().filter(|l| l.summed > 0 || asked_to_sum) {
        tracing::info!(
            "{name}: {method} decided {} (error at most {:.1e}, proven bound {:.1e}), counting \
             {}; the sums took {}",
            plural(l.summed, "pair"),
            l.largest_error,
            l.largest_bound,
            count(l.counted),
            millis(l.summing),
        );
    }
    if c.offload.tests > 0 {
        let (tests, undecided) = (c.offload.tests, c.offload.undecided);
        let share = percent(undecided as f64 / tests as f64);
        let (tests, undecided) = (plural(tests, "test"), count(undecided));
        tracing::info!(
            "{name}: {tests} on the GPU, {undecided} of them repeated on the CPU ({share})"
        );
    }
}

/// Prints a certificate as in a file, or a summary and the links of one of several models.
fn print(name: &str, c: &Certified, args: &Args, is_alone: bool) {
    if is_alone {
        tracing::info!("{name}: {}", summary(c));
        if args.output.is_none() {
            output::line(c.certificate.to_string().trim_end());
        }
        return;
    }
    out!("{name}: {}", summary(c));
    let links = c.certificate.links.iter();
    let links = links.map(|l| format!("curves {} and {}: linking number {}", l.i, l.j, l.lambda));
    let images = c.certificate.images.iter().flatten();
    let links: Vec<String> = links.chain(images.map(ImageLink::to_string)).collect();
    list("  ", &links, LINKS);
}

/// Prints the summary of one of several frames, and the lines of its certificate, without the first
/// one, which has the number of curves.
fn print_line(name: &str, c: &Certified) {
    let certificate = c.certificate.to_string();
    let links: Vec<&str> = certificate.lines().skip(1).collect();
    let mut listed = links[..links.len().min(LINKS)].join(" ");
    if links.len() > LINKS {
        listed += &format!(" and {} more", links.len() - LINKS);
    }
    let separator = if links.is_empty() { "" } else { ": " };
    out!("{name}: {}{separator}{listed}", summary(c));
}

/// Writes the files of a certificate.
fn write(frame: &Picked, c: &Certified, args: &Args) -> Result<()> {
    let (set, model) = (&frame.curves, &frame.model);
    let write = |file: &Path, text: &str| {
        let written = write_text(file, args.overwrite, text);
        written.inspect(|()| tracing::info!("{}: written", file.display()))
    };
    if let (Some(file), Some(braids)) = (&args.write_braid, &c.braids) {
        write(file, &(braids.to_json() + "\n"))?;
    }
    if let Some(file) = &args.output {
        write(file, &c.certificate.to_string())?;
    }
    if let Some(folder) = &args.svg {
        let linked = picture::links(set, &c.certificate, PLACES);
        let title = model.file_name().unwrap_or(model.as_os_str());
        let svg = picture::draw(set, &title.to_string_lossy(), &summary(c), &linked);
        write(&picture_of(model, folder), &svg)?;
    }
    Ok(())
}

/// Returns the picture of a model. Scenes have characters that some file systems refuse.
fn picture_of(model: &Path, folder: &Path) -> PathBuf {
    let name = model.file_name().unwrap_or(model.as_os_str());
    folder.join(file_name(&name.to_string_lossy()) + ".svg")
}

fn summary(c: &Certified) -> String {
    let (certificate, stats) = (&c.certificate, &c.stats);
    let mut words = format!(
        "{} of {}, {}, {}",
        plural(stats.curves, "curve"),
        plural(stats.segments, "segment"),
        plural(stats.potential_links, "potential link"),
        plural(certificate.links.len(), "link"),
    );
    if let Some(images) = &certificate.images {
        words += &format!(", {} with periodic images", count(images.len()));
    }
    if let n @ 1.. = certificate.undefined.len() {
        let pairs = plural_of(n, "pair or curve", "pairs or curves");
        words += &format!(", {pairs} without a linking number");
    }
    format!("{words} ({})", millis(c.took))
}
