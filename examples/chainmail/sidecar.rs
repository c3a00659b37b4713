//! Starts `linkwatch watch` as a separate process.

use linkwatch::{Error, Result};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::process::{Child, Command};
use std::time::{Duration, Instant};

/// Time limit of the watcher to write its files after the simulation.
const PATIENCE: Duration = Duration::from_secs(60);

/// A running `linkwatch watch`, which is ended when this is dropped.
pub struct Sidecar {
    process: Child,
    recording: PathBuf,
    rrd: Option<PathBuf>,
}

impl Sidecar {
    /// Starts the watcher. Under `cargo run` it is built first, if it does not exist.
    pub fn start(service: &str, out: &Path, view: bool) -> Result<Sidecar> {
        let recording = out.join("chainmail.mcap");
        let rrd = (!view).then(|| out.join("chainmail.rrd"));
        std::fs::create_dir_all(out)?;
        let program = program()?;
        let mut command = Command::new(&program);
        command.args(["watch", "--service", service, "--wait", "60", "--events"]);
        // These files belong to an earlier run of the example.
        command.arg("--force").arg("--record").arg(&recording);
        match &rrd {
            Some(path) => command.arg("--rrd").arg(path),
            None => command.arg("--view"),
        };
        let process = command.spawn().map_err(|source| Error::File {
            path: program,
            source,
        })?;
        Ok(Sidecar {
            process,
            recording,
            rrd,
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

    /// Waits for the watcher to end. Returns its exit code and prints how to open its files.
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
        println!();
        println!(
            "the recording:   {0}   verify it again with: linkwatch replay {0}",
            self.recording.display()
        );
        if let Some(rrd) = &self.rrd {
            println!(
                "for the viewer:  {0}   open it with: rerun {0}",
                rrd.display()
            );
        }
        Ok(status.code().and_then(|code| u8::try_from(code).ok()))
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

/// Returns the command `linkwatch`: the one built with this example, or an installed one.
fn program() -> Result<PathBuf> {
    let example = std::env::current_exe()?;
    let name = format!("linkwatch{}", std::env::consts::EXE_SUFFIX);
    // target/<profile>/examples/chainmail and target/<profile>/linkwatch
    let built = example
        .parent()
        .and_then(Path::parent)
        .map(|profile| profile.join(&name));
    let Some(built) = built else {
        return Ok(name.into());
    };
    if let Some(cargo) = std::env::var_os("CARGO") {
        build(&cargo, &built)?;
    }
    Ok(if built.exists() { built } else { name.into() })
}

/// Builds the command, because `cargo run --example` builds the example alone.
fn build(cargo: &std::ffi::OsStr, built: &Path) -> Result<()> {
    let profile = built
        .parent()
        .and_then(Path::file_name)
        .and_then(|p| p.to_str());
    let profile = match profile {
        Some("debug") | None => "dev",
        Some(other) => other,
    };
    // With the features of the example, so that all common dependencies are already built.
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
    command.args(["build", "--quiet", "--profile", profile]);
    command.args(["--bin", "linkwatch", "--example", "chainmail"]);
    if !cfg!(all(feature = "mcap", feature = "rerun")) {
        let mut features = vec!["cli", "bus"];
        features.extend(cfg!(feature = "mcap").then_some("mcap"));
        features.extend(cfg!(feature = "rerun").then_some("rerun"));
        command.args(["--no-default-features", "--features", &features.join(",")]);
    }
    if let Some(root) = std::env::var_os("CARGO_MANIFEST_DIR") {
        command.current_dir(root);
    }
    let status = command.status()?;
    if status.success() {
        return Ok(());
    }
    Err(Error::Io(std::io::Error::new(
        ErrorKind::NotFound,
        "the command linkwatch could not be built: start it separately and use --no-sidecar",
    )))
}
