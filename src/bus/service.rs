//! Names and quality of service of the services, in one place for both sides.
//!
//! | service | pattern | from | to |
//! |---|---|---|---|
//! | `<name>/frames` | publish-subscribe, event | simulator | watcher |
//! | `<name>/verdicts` | publish-subscribe, event | watcher | simulator |
//! | `<name>/simulator`, `<name>/watcher` | request-response, never used | one lock each | |
//!
//! The simulator has two publishers of frames: one keeps the baseline for watchers that start late.
//! A further publisher is allowed on each topic, because a bridge between hosts joins with its own.
//! The locks ensure that there is one simulator and one watcher. A lock is a service that admits
//! one server. Bridges do not relay it, and iceoryx2 frees it together with everything else of a
//! dead process. An observer is a watcher that sends nothing, so it takes no lock. The maximum
//! number of subscribers of the frames limits watcher, observers and bridges together.

use super::ipc::{Ipc, limit_log_level};
use super::remains::{cleanup, remove_unsized};
use super::room;
use super::services::user_of;
use super::wait_mode::WaitMode;
use super::wire::{ALIGNMENT, FrameHeader, VerdictWire};
use crate::error::{Error, Result};
use iceoryx2::identifiers::UniquePublisherId;
use iceoryx2::node::NodeView;
use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::server::Server;
use iceoryx2::port::subscriber::{Subscriber, SubscriberCreateError};
use iceoryx2::prelude::{
    Alignment, CallbackProgression, Config, Node, NodeBuilder, NodeName, NodeState, PortFactory,
    ServiceName, SignalHandlingMode,
};
use iceoryx2::service::port_factory::server::ServerCreateError;
use iceoryx2::service::port_factory::{event, publish_subscribe};
use std::fmt::Debug;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

pub(super) type FrameService = publish_subscribe::PortFactory<Ipc, [u8], FrameHeader>;
pub(super) type VerdictService = publish_subscribe::PortFactory<Ipc, VerdictWire, ()>;
pub(super) type NodeId = iceoryx2::identifiers::UniqueNodeId;

/// Maximum number of frames that wait for a subscriber: the newest, and the end of the session
/// after it.
pub(super) const FRAME_BUFFER: usize = 2;

/// Maximum number of frames that a subscriber may hold: the current one, the newest, one just
/// received, and one of a new session.
pub(super) const FRAME_BORROWS: usize = 4;

/// Number of frames that a watcher that starts late receives: the newest, and the end of the
/// session after it.
pub(super) const FRAME_HISTORY: usize = 2;

/// Maximum number of verdicts that wait for a simulator that polls rarely. Losing older ones is
/// harmless, because each heartbeat repeats the abort signal.
const VERDICT_BUFFER: usize = 64;

/// Time limit for something that another process is creating, removing or leaving.
const TRANSIENT_LIMIT: Duration = Duration::from_millis(1000);

/// Time limit for a living holder of a lock, because a process that was just killed still counts as
/// alive.
const LOCK_LIMIT: Duration = Duration::from_millis(300);

/// Number of polls of a spinning process after which it reads, and discards, the events.
const DRAIN: u32 = 256;

/// End of the services.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Role {
    Simulator,
    Watcher,
    /// A watcher that sends nothing. A service may have several.
    Observer,
}

/// Name of the node of an observer.
pub(super) const OBSERVER: &str = "linkwatch observer";

/// Name of the node of a simulator.
pub(super) const SIMULATOR: &str = "linkwatch simulator";

/// Maximum number of watchers, observers and bridges that receive frames.
pub(super) const FRAME_SUBSCRIBERS: usize = 4;

/// Both services, opened, and the lock that makes this process the only one in its role.
#[derive(Debug)]
pub(super) struct Endpoint {
    role: Role,
    pub frames: FrameService,
    pub verdicts: VerdictService,
    /// Receives the events of frames (watcher, observer) or verdicts (simulator).
    pub listener: Listener<Ipc>,
    /// Sends the events of verdicts (watcher) or frames (simulator).
    notifier: Option<Notifier<Ipc>>,
    wait_mode: WaitMode,
    /// Number of waits so far, if this side spins.
    spins: AtomicU32,
    _lock: Option<Lock>,
    pub node: Arc<Node<Ipc>>,
}

impl Endpoint {
    pub fn open(name: &str, role: Role, wait_mode: WaitMode) -> Result<Endpoint> {
        let node = open_node(match role {
            Role::Simulator => SIMULATOR,
            Role::Watcher => "linkwatch watcher",
            Role::Observer => OBSERVER,
        })?;
        let lock = match role {
            Role::Observer => None,
            Role::Simulator => Some(lock(&node, &service_name(name, "simulator")?, |who| {
                format!(
                    "service \"{name}\" already has a simulator ({who}). Stop it, or give one of \
                     the two another service name"
                )
            })?),
            Role::Watcher => Some(lock(&node, &service_name(name, "watcher")?, |who| {
                format!(
                    "service \"{name}\" is already watched ({who}). Stop that watcher, watch \
                     another service (option `service`), or pass the option `observe`: an observer \
                     verifies beside the watcher, and sends nothing to the simulator"
                )
            })?),
        };
        let frames_name = service_name(name, "frames")?;
        let verdicts_name = service_name(name, "verdicts")?;
        let alignment = Alignment::new(ALIGNMENT).expect("64 is a power of two");
        let frames = retry_transient(|| {
            node.service_builder(&frames_name)
                .publish_subscribe::<[u8]>()
                .user_header::<FrameHeader>()
                .payload_alignment(alignment)
                .max_publishers(3)
                .max_subscribers(FRAME_SUBSCRIBERS)
                .subscriber_max_buffer_size(FRAME_BUFFER)
                .subscriber_max_borrowed_samples(FRAME_BORROWS)
                .history_size(FRAME_HISTORY)
                .enable_safe_overflow(true)
                .open_or_create()
        })
        .map_err(cannot_open(&frames_name))?;
        let verdicts = retry_transient(|| {
            node.service_builder(&verdicts_name)
                .publish_subscribe::<VerdictWire>()
                .max_publishers(2)
                .max_subscribers(4)
                .subscriber_max_buffer_size(VERDICT_BUFFER)
                .subscriber_max_borrowed_samples(2)
                .history_size(1)
                .enable_safe_overflow(true)
                .open_or_create()
        })
        .map_err(cannot_open(&verdicts_name))?;
        let frame_events = open_events(&node, &frames_name)?;
        let verdict_events = open_events(&node, &verdicts_name)?;
        let (receive, send) = match role {
            Role::Simulator => (verdict_events, Some(frame_events)),
            Role::Watcher => (frame_events, Some(verdict_events)),
            Role::Observer => (frame_events, None),
        };
        let listener = receive.listener_builder().create();
        let notifier = send.map(|events| events.notifier_builder().create());
        Ok(Endpoint {
            role,
            listener: listener.map_err(bus("listener"))?,
            notifier: notifier.transpose().map_err(bus("notifier"))?,
            wait_mode,
            spins: AtomicU32::new(0),
            frames,
            verdicts,
            _lock: lock,
            node: node.into(),
        })
    }

    /// Wakes the other side if it sleeps. Never waits. Ignores failures, because they only delay
    /// the other side until its next timer tick.
    pub fn notify(&self) {
        if let Some(notifier) = &self.notifier {
            let _ = notifier.notify();
        }
    }

    /// Creates the subscriber of the frames of service `name`.
    pub fn subscribe_to_frames(&self, name: &str) -> Result<Subscriber<Ipc, [u8], FrameHeader>> {
        let create = || self.frames.subscriber_builder().create();
        let full = SubscriberCreateError::ExceedsMaxSupportedSubscribers;
        if let Some(subscriber) = create_port(create, full).map_err(bus("subscriber of frames"))? {
            return Ok(subscriber);
        }
        let mut processes = Vec::new();
        self.frames.dynamic_config().list_subscribers(|subscriber| {
            processes.push(subscriber.node_id.pid().value().to_string());
            CallbackProgression::Continue
        });
        processes.sort();
        Err(Error::Bus(format!(
            "service \"{name}\" has the maximum of {FRAME_SUBSCRIBERS} watchers, observers and \
             bridges (processes {}): end one of them",
            processes.join(", ")
        )))
    }

    /// Waits until the other side may have sent something, at most for `time`. Returns false if a
    /// signal arrived.
    pub fn wait(&self, time: Duration) -> bool {
        if self.wait_mode == WaitMode::Spin {
            let spins = self.spins.fetch_add(1, Ordering::Relaxed);
            if spins.is_multiple_of(DRAIN) {
                // Events that nobody reads would fill the buffer of the socket.
                let _ = self.listener.try_wait_all(|_| {});
            }
            std::hint::spin_loop();
            return true;
        }
        // The socket below rounds less than a microsecond to zero, which means no time limit.
        let time = time.max(Duration::from_millis(1));
        self.listener.timed_wait_all(|_| {}, time).is_ok()
    }

    /// Returns true if the node, which once published to this endpoint, died or left. Removes its
    /// remains.
    ///
    /// A node lives as long as its process holds a lock on a file, even if the process is stopped
    /// or busy.
    pub fn node_is_gone(&self, id: NodeId) -> bool {
        match self.role {
            Role::Simulator => is_gone(&self.verdicts, id),
            Role::Watcher | Role::Observer => is_gone(&self.frames, id),
        }
    }
}

/// Creates the node of this process. Also removes the files that killed processes left behind.
pub(super) fn open_node(name: &str) -> Result<Node<Ipc>> {
    limit_log_level();
    room::ensure_service()?;
    remove_unsized();
    let name = NodeName::new(name).map_err(bus("node name"))?;
    let mut config = Config::global_config().clone();
    // It may wait without limit: see `remove_unsized`.
    config.global.node.cleanup_dead_nodes_on_destruction = false;
    // Signals stay with the program that owns this process.
    let builder = NodeBuilder::new()
        .config(&config)
        .name(&name)
        .signal_handling_mode(SignalHandlingMode::Disabled);
    builder.create::<Ipc>().map_err(|e| {
        Error::Bus(format!(
            "cannot open shared memory ({e:?}): simulator and watcher must run as the same user, \
             who must be able to write to /dev/shm and /tmp/iceoryx2"
        ))
    })
}

/// Opens the event service of this name.
pub(super) fn open_events(node: &Node<Ipc>, name: &ServiceName) -> Result<event::PortFactory<Ipc>> {
    retry_transient(|| node.service_builder(name).event().open_or_create())
        .map_err(cannot_open(name))
}

/// Returns true if a node that opened this service died or left. Removes its remains.
pub(super) fn is_gone(service: &impl PortFactory<Service = Ipc>, id: NodeId) -> bool {
    let mut gone = true;
    let listed = service.nodes(|state: NodeState<Ipc>| {
        if *state.node_id() == id {
            gone = matches!(state, NodeState::Dead(_));
            return CallbackProgression::Stop;
        }
        CallbackProgression::Continue
    });
    let gone = gone && listed.is_ok();
    if gone {
        cleanup();
    }
    gone
}

/// Returns the node of a publisher of this service; `None` if it has closed already.
pub(super) fn node_of(service: &FrameService, origin: UniquePublisherId) -> Option<NodeId> {
    let mut node = None;
    service.dynamic_config().list_publishers(|publisher| {
        if publisher.publisher_id == origin {
            node = Some(publisher.node_id);
            return CallbackProgression::Stop;
        }
        CallbackProgression::Continue
    });
    node
}

pub(super) fn service_name(name: &str, part: &str) -> Result<ServiceName> {
    if name.is_empty() {
        return Err(Error::Bus("the service name is empty".into()));
    }
    ServiceName::new(&format!("{name}/{part}")).map_err(|e| {
        let n = ServiceName::max_len();
        Error::Bus(format!(
            "service name \"{name}\": {e:?} (at most {n} bytes with \"/{part}\", and not a name \
             reserved by iceoryx2)"
        ))
    })
}

/// Service whose only server is a lock.
pub(super) type Lock = Server<Ipc, u64, (), u64, ()>;

/// Acquires a lock: a service that admits one server. `taken` returns the error text if a process
/// holds it.
pub(super) fn lock(
    node: &Node<Ipc>,
    name: &ServiceName,
    taken: impl FnOnce(&str) -> String,
) -> Result<Lock> {
    let service = retry_transient(|| {
        node.service_builder(name)
            .request_response::<u64, u64>()
            .max_servers(1)
            .max_clients(1)
            .open_or_create()
    })
    .map_err(cannot_open(name))?;
    let create = || service.server_builder().create();
    let full = ServerCreateError::ExceedsMaxSupportedServers;
    if let Some(server) = create_port(create, full).map_err(bus("lock"))? {
        return Ok(server);
    }
    let mut holder = None;
    service.dynamic_config().list_servers(|server| {
        holder = Some(server.node_id);
        CallbackProgression::Stop
    });
    let mut executable = None;
    let _ = service.nodes(|state| {
        if let (NodeState::Alive(view), Some(holder)) = (&state, holder)
            && *view.id() == holder
        {
            executable = view.details().as_ref().map(|d| d.executable().to_string());
        }
        CallbackProgression::Continue
    });
    let who = match (holder, executable) {
        (Some(id), Some(file)) => format!("process {}, {file}", id.pid().value()),
        (Some(id), None) => format!("process {}", id.pid().value()),
        (None, _) => "a process that is starting".into(),
    };
    Err(Error::Bus(taken(&who)))
}

/// Creates a port of a service. `None` if the service is `full`: living processes have all of its
/// ports.
fn create_port<T, E: PartialEq>(
    create: impl Fn() -> Result<T, E>,
    full: E,
) -> Result<Option<T>, E> {
    let start = Instant::now();
    loop {
        match create() {
            Err(e) if e == full => {}
            created => return created.map(Some),
        }
        // A killed process counts until its remains are removed.
        cleanup();
        if start.elapsed() > LOCK_LIMIT {
            return Ok(None);
        }
        std::thread::sleep(Duration::from_millis(10));
    }
}

/// Opens or creates something that another process may be creating or removing at the same time.
pub(super) fn retry_transient<T, E: Debug>(mut open: impl FnMut() -> Result<T, E>) -> Result<T, E> {
    // Matched by their Debug form, because each messaging pattern has its own enum for the same
    // errors.
    const TRANSIENT: [&str; 7] = [
        "SystemInFlux",
        // Also of a service that another process has created in part.
        "ServiceInCorruptedState",
        "IsMarkedForDestruction",
        "DoesNotExist",
        "AlreadyExists",
        "IsBeingCreatedByAnotherInstance",
        "HangsInCreation",
    ];
    remove_unsized();
    let start = Instant::now();
    loop {
        match open() {
            Err(e) if start.elapsed() < TRANSIENT_LIMIT => {
                let words = format!("{e:?}");
                if !TRANSIENT.iter().any(|t| words.contains(t)) {
                    return Err(e);
                }
                cleanup();
                std::thread::sleep(Duration::from_millis(5));
            }
            result => return result,
        }
    }
}

pub(super) fn cannot_open<E: Debug>(name: &ServiceName) -> impl FnOnce(E) -> Error {
    let name = *name;
    move |e| {
        let words = format!("{e:?}");
        let why = if words.contains("Incompatible") {
            let who = user_of(&name).map_or(String::new(), |user| format!(" ({user})"));
            format!(
                " It exists with another layout: another program uses the name, or another version \
                 of linkwatch{who}. Choose another service name, or use one version on both sides"
            )
        } else if words.contains("Corrupted") {
            " It was created by another version of iceoryx2 (this is 0.9.3), or by a process that \
             was killed meanwhile: stop all processes that use it, and remove its files in \
             /tmp/iceoryx2"
                .into()
        } else if words.contains("Permission") {
            " Simulator and watcher must run as the same user".into()
        } else if words.contains("ExceedsMaxNumberOfNodes") {
            " Too many processes use it".into()
        } else {
            String::new()
        };
        Error::Bus(format!("cannot open service \"{name}\" ({words}).{why}"))
    }
}

/// Returns a function that describes a failure of iceoryx2 by the operation that failed.
pub(super) fn bus<E: Debug>(what: &'static str) -> impl FnOnce(E) -> Error {
    move |e| Error::Bus(format!("{what}: {e:?}"))
}
