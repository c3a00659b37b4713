//! `linkwatch study` in a build without studies: says how to get them.

use super::Outcome;
use linkwatch::{Error, Result};

/// Measure the cost of verification (not in this build: it needs the feature `lab`)
#[derive(Debug, clap::Args)]
pub struct Args {
    #[arg(hide = true, num_args = 0.., allow_hyphen_values = true, trailing_var_arg = true)]
    any: Vec<String>,
}

/// Returns the error for any study.
pub fn run(_: &Args, _: bool) -> Result<Outcome> {
    Err(Error::Usage(
        "this build has no studies; build with the feature `lab`".into(),
    ))
}
