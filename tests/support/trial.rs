//! Tests that need what a machine may lack: a program, a GPU adapter, a file. Without it they are
//! shown as ignored, never as passed.

use libtest_mimic::{Failed, Trial};

/// Creates a test that is ignored unless what it needs is present.
pub fn trial(
    name: impl Into<String>,
    present: bool,
    run: impl FnOnce() -> Result<(), Failed> + Send + 'static,
) -> Trial {
    Trial::test(name, run).with_ignored_flag(!present)
}
