//! Starts `linkwatch watch` as a separate process, for the simulators in Rust.
//!
//! A simulator calls [`SidecarArgs::start`], publishes its frames, and calls [`Sidecar::join`]. The
//! watcher verifies every frame and records it.

mod picture;
mod roll_back;

pub use roll_back::{Scene, Work, publish, step_safely};

use linkwatch::{Client, Error, Result};
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitCode};
use std::time::{Duration, Instant};

/// Time limit of the verdict on a frame, and of the watcher's goodbye.
pub const DEADLINE: Duration = Duration::from_secs(10);

/// Time limit of the watcher to write its files after the simulation.
const PATIENCE: Duration = Duration::from_secs(60);

/// Options of every simulator about its watcher.
#[derive(Debug, clap::Args)]
pub struct SidecarArgs {
    /// Do not start `linkwatch watch`; use one that already runs or starts later
    #[arg(long)]
    no_sidecar: bool,
    /// Name of the service
    #[arg(long, default_value = "linkwatch")]
    pub service: String,
    /// Folder for the recording and the picture
    #[arg(long, default_value = ".", value_name = "FOLDER")]
    out: PathBuf,
}

impl SidecarArgs {
    /// Starts a watcher that writes a recording of this name, unless the user starts one.
    pub fn start(&self, recording: &str) -> Result<Option<Sidecar>> {
        match self.no_sidecar {
            true => Ok(None),
            false => Sidecar::start(&self.service, &self.out.join(recording)).map(Some),
        }
    }
}

/// Returns the exit code of a simulator, and prints its error.
pub fn exit_code(result: Result<ExitCode>) -> ExitCode {
    result.unwrap_or_else(|e| {
        eprintln!("simulator: {e}");
        ExitCode::from(2)
    })
}

/// A running `linkwatch watch`, which is ended when this is dropped.
pub struct Sidecar {
    process: Child,
    recording: PathBuf,
}

impl Sidecar {
    /// Starts a watcher on this service that writes this recording. Under `cargo run` the command
    /// is built first.
    fn start(service: &str, recording: &Path) -> Result<Sidecar> {
        if let Some(folder) = recording.parent() {
            std::fs::create_dir_all(folder)?;
        }
        let program = program()?;
        let mut command = Command::new(&program);
        command.args(["watch", "--service", service, "--wait", "60"]);
        // The file belongs to an earlier run of the example.
        command.arg("--force").arg("--record").arg(recording);
        let process = command.spawn().map_err(|source| Error::File {
            path: program,
            source,
        })?;
        Ok(Sidecar {
            process,
            recording: recording.to_owned(),
        })
    }

    /// Fails if the watcher has ended already. The watcher has printed the reason.
    pub fn check_running(&mut self) -> Result<()> {
        match self.process.try_wait()? {
            None => Ok(()),
            Some(status) => Err(Error::Usage(format!(
                "the watcher ended before the simulation began ({status})"
            ))),
        }
    }

    /// Waits for the watcher to end. Returns its exit code and prints how to see its files.
    pub fn join(mut self) -> Result<Option<u8>> {
        let start = Instant::now();
        let status = loop {
            match self.process.try_wait()? {
                Some(status) => break status,
                None if start.elapsed() > PATIENCE => {
                    println!("simulator: the watcher does not end; stopping it");
                    return Ok(None);
                }
                None => std::thread::sleep(Duration::from_millis(20)),
            }
        };
        self.print_files();
        Ok(status.code().and_then(|code| u8::try_from(code).ok()))
    }

    /// Same as [`Sidecar::join`], and draws the first violation beside the recording.
    pub fn join_and_draw(self) -> Result<Option<u8>> {
        let recording = self.recording.clone();
        let code = self.join()?;
        let picture = recording.with_extension("svg");
        if picture::draw(&recording, &picture)? {
            println!("the place where it broke: {}", picture.display());
        }
        Ok(code)
    }

    /// Prints what was written and how to see it.
    fn print_files(&self) {
        let recording = self.recording.display();
        let rrd = self.recording.with_extension("rrd");
        let rrd = rrd.display();
        println!();
        println!("all frames and verdicts:  {recording}");
        println!("  verify it again:        linkwatch replay {recording}");
        println!(
            "  open it in the viewer:  linkwatch replay {recording} --show {rrd} && rerun {rrd}"
        );
    }
}

impl Drop for Sidecar {
    fn drop(&mut self) {
        // It has ended already, unless an error occurred.
        if matches!(self.process.try_wait(), Ok(None)) {
            let _ = self.process.kill();
            let _ = self.process.wait();
        }
    }
}

/// Waits for a watcher, so that it does not miss the first frame: the one that was started, or one
/// that the user starts. Returns false if none connected in time.
pub fn wait_for_watcher(
    client: &mut Client,
    mut sidecar: Option<&mut Sidecar>,
    service: &str,
    limit: Duration,
) -> Result<bool> {
    const LOOK: Duration = Duration::from_millis(300);
    let start = Instant::now();
    let mut announced = false;
    while !client.wait_for_watcher(LOOK)? {
        if let Some(sidecar) = &mut sidecar {
            sidecar.check_running()?;
        } else if !announced {
            let command = format!("linkwatch watch --service {service}");
            println!("simulator: waiting for a watcher; start one with: {command}");
            announced = true;
        }
        if start.elapsed() > limit {
            return Ok(false);
        }
    }
    Ok(true)
}

/// Returns the command `linkwatch`: the one built with the simulator, or an installed one. Under
/// `cargo run` it is built first.
fn program() -> Result<PathBuf> {
    let name = format!("linkwatch{}", std::env::consts::EXE_SUFFIX);
    let simulator = std::env::current_exe()?;
    let built = simulator.with_file_name(&name);
    if let Some(cargo) = std::env::var_os("CARGO") {
        build(&cargo, &simulator)?;
    }
    Ok(if built.exists() { built } else { name.into() })
}

/// Builds the command. `cargo run` builds the simulator and the library, but not the command.
fn build(cargo: &OsStr, simulator: &Path) -> Result<()> {
    // The program of a simulator has the name of its package.
    let package = simulator.file_stem().and_then(OsStr::to_str);
    let Some(package) = package else {
        let what = format!("{}: the name is not UTF-8", simulator.display());
        return Err(Error::Usage(what));
    };
    let profile = simulator.parent().and_then(Path::file_name);
    let profile = match profile.and_then(OsStr::to_str) {
        Some("debug") | None => "dev",
        Some(other) => other,
    };
    let mut command = Command::new(cargo);
    // The variables that `cargo run` sets for this package would look like a change to build
    // scripts that depend on them, and half of all dependencies would be built again.
    for (name, _) in std::env::vars_os() {
        let text = name.to_string_lossy();
        if text.starts_with("CARGO_PKG_") || text.starts_with("CARGO_MANIFEST_") || text == "CARGO"
        {
            command.env_remove(&name);
        }
    }
    // Beside the simulator, with no features of its own, the command takes those that this package
    // selects: all dependencies and the library are already built.
    command.args(["build", "--quiet", "--profile", profile]);
    command.args(["-p", package, "-p", "linkwatch", "--no-default-features"]);
    command.args(["--bin", "linkwatch", "--bin", package]);
    command.current_dir(env!("CARGO_MANIFEST_DIR"));
    if command.status()?.success() {
        return Ok(());
    }
    Err(Error::Usage(
        "the command linkwatch could not be built: start it separately and use --no-sidecar".into(),
    ))
}
