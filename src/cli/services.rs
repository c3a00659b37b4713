//! `linkwatch services`: the live services of this machine.

use super::{Outcome, output};
use linkwatch::{Result, ServiceInfo, services};

/// Runs the command.
pub fn run(json: bool) -> Result<Outcome> {
    let services = services()?;
    for service in &services {
        match json {
            true => output::json(&serde_json::json!(service)),
            false => output::line(service),
        }
    }
    if services.is_empty() && !json {
        output::line("no live services of this user on this machine");
    }
    Ok(Outcome::Fine)
}

/// Returns true if a simulator may still use a service: it is live, or a bridge to another host is.
pub fn may_have_simulator(service: &str) -> Result<bool> {
    let all = services()?;
    let own = all.iter().find(|s| s.service == service);
    Ok(own.is_some_and(|s| s.simulator.is_some() || !s.others.is_empty()))
}

/// Logs the live services if no simulator came.
pub fn hint(service: &str, waited: &str) {
    let all = match services() {
        Ok(all) => all,
        Err(e) => return tracing::warn!("{e}"),
    };
    let (own, others): (Vec<_>, Vec<_>) = all.into_iter().partition(|s| s.service == service);
    let none_came = format!("no simulator connected to service '{service}' within {waited}");
    if let Some(simulator) = own.iter().find_map(|s| s.simulator.as_ref()) {
        tracing::info!(
            "the simulator on service '{service}' ({simulator}) has not sent anything yet"
        );
    } else if others.is_empty() {
        tracing::info!(
            "{none_came}, and no other service is live on this machine: start the simulator with \
             this service name, as the same user"
        );
    } else {
        tracing::warn!("{none_came}; live services on this machine (`linkwatch services`):");
        others.iter().for_each(|s| tracing::warn!("  {s}"));
    }
    let free = |s: &&ServiceInfo| s.simulator.is_some() && s.watcher.is_none();
    if own.iter().all(|s| s.simulator.is_none())
        && let Some(free) = others.iter().find(free)
    {
        tracing::warn!("to watch one of them: --service '{}'", free.service);
    }
}
