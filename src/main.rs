//! The command `linkwatch`: see `src/cli`.

fn main() -> std::process::ExitCode {
    linkwatch::run_command(std::env::args_os(), None).into()
}
