//! List of the services of this machine, read from their files alone. Nothing is opened or created,
//! and nothing of a living process is removed, so running sessions are not disturbed.

use super::ipc::{Ipc, limit_log_level};
use super::remains::remove_unsized;
use super::service::{OBSERVER, SIMULATOR};
use super::wire::{FrameHeader, VerdictWire};
use crate::error::{Error, Result};
use iceoryx2::identifiers::UniqueNodeId;
use iceoryx2::node::NodeView;
use iceoryx2::prelude::{CallbackProgression, Config, NodeState, ServiceName};
use iceoryx2::service::Service as _;
use iceoryx2::service::ServiceDetails;
use iceoryx2::service::static_config::message_type_details::{TypeDetail, TypeVariant};
use iceoryx2::service::static_config::messaging_pattern::MessagingPattern;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt;

/// A process that uses a service.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[non_exhaustive]
pub struct Attached {
    /// Process id.
    pub process: u32,
    /// File name of its program, if it is known.
    pub program: Option<String>,
}

impl fmt::Display for Attached {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "process {}", self.process)?;
        match &self.program {
            Some(program) => write!(f, ", {}", program.escape_debug()),
            None => Ok(()),
        }
    }
}

/// A service of linkwatch that at least one living process uses.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[non_exhaustive]
pub struct ServiceInfo {
    /// Name, as [`Client::open`](crate::Client::open) and `linkwatch watch --service` take it.
    pub service: String,
    /// The simulator that is attached.
    pub simulator: Option<Attached>,
    /// The watcher that is attached, and answers.
    pub watcher: Option<Attached>,
    /// Watchers that send nothing to the simulator (`linkwatch watch --observe`).
    pub observers: Vec<Attached>,
    /// Other processes that are attached, for example a bridge to another host.
    pub others: Vec<Attached>,
    /// True if the service has the layout of this version of linkwatch.
    pub compatible: bool,
}

impl fmt::Display for ServiceInfo {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: ", self.service.escape_debug())?;
        for (role, attached) in [("simulator", &self.simulator), ("watcher", &self.watcher)] {
            match attached {
                Some(process) => write!(f, "{role} ({process})")?,
                None => write!(f, "no {role}")?,
            }
            f.write_str(if role == "simulator" { ", " } else { "" })?;
        }
        for process in &self.observers {
            write!(f, ", observer ({process})")?;
        }
        if let Some(first) = self.others.first() {
            let n = self.others.len();
            write!(f, ", {n} other (a bridge, for example; {first})")?;
        }
        if !self.compatible {
            f.write_str("; of another version of linkwatch")?;
        }
        Ok(())
    }
}

/// Lists the services of this machine that living processes of this user attach to, sorted by name.
///
/// Services of other programs are skipped, and so are the files that killed processes leave behind.
/// Number and size of the curves are not known: only a subscriber to the frames sees them.
///
/// # Errors
///
/// [`Error::Bus`] if the files of iceoryx2 cannot be listed.
pub fn services() -> Result<Vec<ServiceInfo>> {
    let mut found: BTreeMap<String, ServiceParts> = BTreeMap::new();
    list(|details| {
        let name = details.static_details.name().as_str();
        let Some((name, part)) = name.rsplit_once('/') else {
            return;
        };
        let attached = living(&details);
        let service = found.entry(name.to_owned()).or_default();
        match (part, details.static_details.messaging_pattern()) {
            ("frames", MessagingPattern::PublishSubscribe(config)) => {
                let expected = TypeDetail::new::<FrameHeader>(TypeVariant::FixedSize);
                let header = config.message_type_details().user_header;
                if header.type_name() == expected.type_name() {
                    service.frames = Some((attached, header == expected));
                }
            }
            ("verdicts", MessagingPattern::PublishSubscribe(config)) => {
                let expected = TypeDetail::new::<VerdictWire>(TypeVariant::FixedSize);
                service.strange = config.message_type_details().payload != expected;
            }
            ("simulator", MessagingPattern::RequestResponse(_)) => service.simulators = attached,
            ("watcher", MessagingPattern::RequestResponse(_)) => service.watchers = attached,
            _ => {}
        }
    })?;
    let services = found.into_iter().filter_map(|(name, f)| f.info(name));
    Ok(services.collect())
}

/// Returns a living process that uses a service of iceoryx2 of any type.
pub(super) fn user_of(service: &ServiceName) -> Option<Attached> {
    let mut user = None;
    let look = |details: ServiceDetails<Ipc>| {
        if details.static_details.name() == service && user.is_none() {
            let first = living(&details).into_values().next();
            user = first.map(|living| living.process);
        }
    };
    list(look).ok().and(user)
}

/// A living process, and true if it observes, or simulates.
struct Living {
    process: Attached,
    observes: bool,
    simulates: bool,
}

/// Parts of a service that were found.
#[derive(Default)]
struct ServiceParts {
    /// Users of the frames, and true if these have the layout of this version.
    frames: Option<(BTreeMap<UniqueNodeId, Living>, bool)>,
    /// True if the verdicts have another layout.
    strange: bool,
    simulators: BTreeMap<UniqueNodeId, Living>,
    watchers: BTreeMap<UniqueNodeId, Living>,
}

impl ServiceParts {
    /// Returns `None` if this is not a service of linkwatch, or if no process uses it.
    fn info(self, service: String) -> Option<ServiceInfo> {
        let (mut attached, known) = self.frames?;
        // A simulator that has ended may still use the memory of its frames.
        attached.retain(|id, living| !living.simulates || self.simulators.contains_key(id));
        if attached.is_empty() {
            return None;
        }
        // A process whose role is taken is rejected before it opens the frames.
        let mut with_role = |role: BTreeMap<UniqueNodeId, Living>| {
            let nodes: Vec<Living> = role.keys().filter_map(|id| attached.remove(id)).collect();
            nodes.into_iter().next().map(|living| living.process)
        };
        let (simulator, watcher) = (with_role(self.simulators), with_role(self.watchers));
        let (observers, others): (Vec<Living>, Vec<Living>) =
            attached.into_values().partition(|living| living.observes);
        let processes = |all: Vec<Living>| all.into_iter().map(|living| living.process).collect();
        Some(ServiceInfo {
            simulator,
            watcher,
            observers: processes(observers),
            others: processes(others),
            compatible: known && !self.strange,
            service,
        })
    }
}

/// Calls `look` for every service of iceoryx2 on this machine.
fn list(mut look: impl FnMut(ServiceDetails<Ipc>)) -> Result<()> {
    limit_log_level();
    remove_unsized();
    Ipc::list(Config::global_config(), |details| {
        look(details);
        CallbackProgression::Continue
    })
    .map_err(|e| Error::Bus(format!("cannot list the services of this machine ({e:?})")))
}

/// Returns the living processes that use a service. A process counts as alive while it holds a lock
/// on a file, so a killed process does not count.
fn living(details: &ServiceDetails<Ipc>) -> BTreeMap<UniqueNodeId, Living> {
    let nodes = details.dynamic_details.iter().flat_map(|d| &d.nodes);
    let alive = nodes.filter_map(|state| {
        let NodeState::Alive(view) = state else {
            return None;
        };
        let known = view.details().as_ref();
        let process = Attached {
            process: view.id().pid().value() as u32,
            program: known.map(|d| d.executable().to_string()),
        };
        let is = |name| known.is_some_and(|d| *d.name() == name);
        let living = Living {
            process,
            observes: is(OBSERVER),
            simulates: is(SIMULATOR),
        };
        Some((*view.id(), living))
    });
    alive.collect()
}
