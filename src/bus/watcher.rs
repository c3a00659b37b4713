//! The watcher, as far as the client knows it from its messages and its process.

use super::message::{MessageKind, VerdictMessage};
use super::service::{Endpoint, NodeId};
use iceoryx2::identifiers::UniquePublisherId;
use std::fmt;
use std::time::{Duration, Instant};

/// Silence after which a waiting client checks that the process of the watcher exists, and the
/// interval of these checks. Each check takes a few dozen system calls.
const LIVENESS: Duration = Duration::from_millis(250);

/// Reason why the watcher left.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Departure {
    /// The watcher said goodbye: it was asked to end, or another simulator took over.
    Goodbye,
    /// The watcher cannot verify the frames of this session, for this reason.
    Refused(String),
    /// The process of the watcher ended without a goodbye: it crashed or was killed.
    Crashed,
}

impl fmt::Display for Departure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Departure::Goodbye => f.write_str("the watcher said goodbye"),
            Departure::Refused(why) => write!(f, "the watcher left: {why}"),
            Departure::Crashed => f.write_str("the watcher died without a goodbye"),
        }
    }
}

/// Knowledge about the watcher.
#[derive(Debug)]
pub(super) struct Watcher {
    state: State,
    /// When the process of the watcher was last checked.
    checked: Instant,
}

/// State of the watcher.
#[derive(Clone, Debug)]
enum State {
    /// No watcher has sent a message.
    Unknown,
    Here {
        port: UniquePublisherId,
        node: NodeId,
        heard: Instant,
        /// True if the watcher sent a message about this session, not only about its existence.
        met: bool,
    },
    Left {
        port: UniquePublisherId,
        how: Departure,
    },
}

impl Watcher {
    /// Returns the state before the first message.
    pub fn unknown() -> Watcher {
        Watcher {
            state: State::Unknown,
            checked: Instant::now(),
        }
    }

    /// Returns the reason why the watcher left, if it did.
    pub fn departure(&self) -> Option<&Departure> {
        match &self.state {
            State::Left { how, .. } => Some(how),
            _ => None,
        }
    }

    /// Returns the time since the watcher's last message, if it is here and sent one about this
    /// session.
    pub fn silent_for(&self) -> Option<Duration> {
        match self.state {
            State::Here {
                heard, met: true, ..
            } => Some(heard.elapsed()),
            _ => None,
        }
    }

    /// Records the sender of a message. Returns false if the message is not about `session`.
    pub fn record_sender(
        &mut self,
        endpoint: &Endpoint,
        session: u64,
        message: &VerdictMessage,
        from: UniquePublisherId,
        node: NodeId,
    ) -> bool {
        let mine = message.session == session;
        // Session 0: a watcher without a session announces itself or leaves.
        if !mine && message.session != 0 {
            return false;
        }
        let goodbye = message.kind == MessageKind::Goodbye;
        // True if the sender is the current watcher from now on; true if it verifies this session.
        let (believed, met) = match self.state {
            State::Unknown => (mine || !goodbye, mine),
            State::Here { port, met, .. } if port == from => (true, met || mine),
            // The messages of an earlier watcher arrive before those of a later one.
            State::Here { .. } if goodbye => (false, false),
            State::Here { node, .. } => (mine || endpoint.node_is_gone(node), mine),
            // A watcher that has left this session may stay for the next one.
            State::Left { port, .. } => (mine || !goodbye && port != from, mine),
        };
        if believed {
            self.state = match goodbye {
                true => State::Left {
                    port: from,
                    how: match (&message.reason, message.abort) {
                        (Some(why), false) => Departure::Refused(why.clone()),
                        // The reason given with the frame applies.
                        _ => Departure::Goodbye,
                    },
                },
                false => State::Here {
                    port: from,
                    node,
                    heard: Instant::now(),
                    met,
                },
            };
        }
        mine
    }

    /// Checks whether a watcher that has been silent for a while still exists. Returns true if this
    /// call found it dead; its last messages may still be unread.
    pub fn has_crashed(&mut self, endpoint: &Endpoint) -> bool {
        let State::Here { heard, .. } = self.state else {
            return false;
        };
        heard.elapsed().min(self.checked.elapsed()) >= LIVENESS && self.find_dead(endpoint)
    }

    /// Like [`Watcher::has_crashed`], but also checks a watcher that sent a message a moment
    /// ago.
    pub fn find_dead(&mut self, endpoint: &Endpoint) -> bool {
        let State::Here { port, node, .. } = self.state else {
            return false;
        };
        self.checked = Instant::now();
        let crashed = endpoint.node_is_gone(node);
        if crashed {
            self.state = State::Left {
                port,
                how: Departure::Crashed,
            };
        }
        crashed
    }
}
