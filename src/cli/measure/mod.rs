//! `linkwatch measure`: thickness and writhe of curves.

pub mod thickness;
pub mod writhe;

use super::Outcome;
use linkwatch::Result;

/// Measure curves: thickness and ropelength, or writhe and twist
#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(subcommand)]
    quantity: Quantity,
}

#[derive(Debug, clap::Subcommand)]
enum Quantity {
    Thickness(thickness::Args),
    Writhe(writhe::Args),
}

/// Runs the command.
pub fn run(args: &Args, json: bool) -> Result<Outcome> {
    match &args.quantity {
        Quantity::Thickness(args) => thickness::run(args, json),
        Quantity::Writhe(args) => writhe::run(args, json),
    }
}
