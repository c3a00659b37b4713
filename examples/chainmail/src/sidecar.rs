//! Starts `linkwatch watch` as a separate process.

use crate::picture;
use linkwatch::{Error, Result};
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::{Child, Command};
use std::time::{Duration, Instant};

/// Time limit of the watcher to write its files after the simulation.
const PATIENCE: Duration = Duration::from_secs(60);

/// A running `linkwatch watch`, which is ended when this is dropped.
pub struct Sidecar {
    process: Child,
    recording: PathBuf,
}

impl Sidecar {
    /// Starts the watcher. Under `cargo run` it is built first.
    pub fn start(service: &str, out: &Path) -> Result<Sidecar> {
        let recording = out.join("chainmail.mcap");
        std::fs::create_dir_all(out)?;
        let program = program()?;
        let mut command = Command::new(&program);
        command.args(["watch", "--service", service, "--wait", "60", "--events"]);
        // These files belong to an earlier run of the example.
        command.arg("--force").arg("--record").arg(&recording);
        let process = command.spawn().map_err(|source| Error::File {
            path: program,
            source,
        })?;
        Ok(Sidecar { process, recording })
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
        self.print_files()?;
        Ok(status.code().and_then(|code| u8::try_from(code).ok()))
    }

    /// Draws the place where the sheet broke, and prints what was written and how to see it.
    fn print_files(&self) -> Result<()> {
        let recording = self.recording.display();
        let picture = self.recording.with_extension("svg");
        println!();
        if picture::draw(&self.recording, &picture)? {
            println!("the place where it broke: {}", picture.display());
        } else {
            // One of an earlier run would contradict this run.
            std::fs::remove_file(&picture).ok();
        }
        println!("all frames and verdicts:  {recording}");
        println!("  verify it again:        linkwatch replay {recording}");
        let rrd = self.recording.with_extension("rrd");
        let rrd = rrd.display();
        println!(
            "  open it in the viewer:  linkwatch replay {recording} --rrd {rrd} && rerun {rrd}"
        );
        Ok(())
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

/// Returns the command `linkwatch`: the one built with this example, or an installed one. Under
/// `cargo run` it is built first.
fn program() -> Result<PathBuf> {
    let name = format!("linkwatch{}", std::env::consts::EXE_SUFFIX);
    let built = std::env::current_exe()?.with_file_name(&name);
    if let Some(cargo) = std::env::var_os("CARGO") {
        build(&cargo, &built)?;
    }
    Ok(if built.exists() { built } else { name.into() })
}

/// Builds the command. `cargo run` builds this package and the library, but not the command.
fn build(cargo: &OsStr, built: &Path) -> Result<()> {
    let profile = built.parent().and_then(Path::file_name);
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
    // Beside this package, with no features of its own, the command takes those that this package
    // selects: all dependencies and the library are already built.
    command.args(["build", "--quiet", "--profile", profile]);
    command.args([
        "-p",
        "chainmail",
        "-p",
        "linkwatch",
        "--no-default-features",
    ]);
    command.args(["--bin", "linkwatch", "--bin", "chainmail"]);
    command.current_dir(env!("CARGO_MANIFEST_DIR"));
    if command.status()?.success() {
        return Ok(());
    }
    Err(Error::Usage(
        "the command linkwatch could not be built: start it separately and use --no-sidecar".into(),
    ))
}
