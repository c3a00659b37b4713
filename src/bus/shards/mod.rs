//! Several watchers that share the pairs of curves of one scene.
//!
//! | service | pattern | from | to |
//! |---|---|---|---|
//! | `<name>/shards/tasks` | publish-subscribe, event | leader | members |
//! | `<name>/shards/states` | publish-subscribe, event | members | leader |
//! | `<name>/shards/leader` | request-response, never used | a lock | |
//!
//! The leader is the watcher that answers the simulator, and verifies shard 1. It passes its
//! checked copy of each frame to the members, in the layout of the simulator's frames, and joins
//! their results with its own. A member verifies one of the other shards. It sends its state at
//! intervals, and repeats its last result in it, so no single message is needed. A member that is
//! silent is lost, and another process may take its place.

mod leader;
mod member;

pub use leader::ShardLeader;
pub use member::{ShardEvent, ShardMember};

use super::ipc::Ipc;
use super::service::{cannot_open, retry_transient, service_name};
use super::wire::{ALIGNMENT, FrameHeader};
use crate::error::{Error, Result};
use crate::incremental::Events;
use crate::pairs::Partition;
use crate::verdict::AbortOn;
use crate::verifier::{Part, Strategy, Verifier, VerifierOptions};
use iceoryx2::prelude::{Alignment, Node};
use iceoryx2::service::port_factory::publish_subscribe;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::time::Duration;

type Topic = publish_subscribe::PortFactory<Ipc, [u8], FrameHeader>;

/// Interval at which a member sends its state.
const HEARTBEAT: Duration = Duration::from_millis(500);

/// Silence after which a member counts as lost.
pub(super) const SILENCE: Duration = Duration::from_secs(3);

/// Maximum time that a sleeping process waits before it polls.
const TICK: Duration = Duration::from_millis(10);

/// Number of messages that wait for a subscriber. The oldest ones are lost: all are repeated, or
/// replaced by newer ones.
pub(super) const BUFFER: usize = 4;

/// Maximum number of bytes of a message or a frame. The leader has checked the size of each frame.
const MAX_BYTES: usize = u32::MAX as usize;

/// Not a frame: the payload is a [`Note`].
const FLAG_NOTE: u32 = 1 << 16;

/// What a member must know before its first frame.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ShardSetup {
    abort_on: AbortOn,
    strategy: Strategy,
    events: Events,
    motion_limit: Option<f64>,
    max_pairs: usize,
    baseline: Option<crate::Certificate>,
    partition: Vec<u8>,
}

impl ShardSetup {
    /// Prepares members for the pairs of a partition. Of `options`, those that decide what is
    /// reported are passed on; each member has a kernel and a device of its own.
    ///
    /// The baseline is that of all pairs, or of those of the member.
    pub fn new(options: &VerifierOptions, partition: &Partition) -> ShardSetup {
        ShardSetup {
            abort_on: options.abort_on,
            strategy: options.strategy,
            events: options.events,
            motion_limit: options.motion_limit,
            max_pairs: options.max_pairs,
            baseline: options.baseline.clone(),
            partition: partition.to_bytes(),
        }
    }

    /// Returns the verifier of one shard, from 0, with the kernel and the device of `options`.
    ///
    /// Errors: those of [`Verifier::new`] and [`Verifier::verify_share`]; [`Error::Format`] if the
    /// message has no such shard.
    pub fn verifier(self, options: VerifierOptions, shard: usize) -> Result<Verifier> {
        let partition = Partition::from_bytes(&self.partition)?;
        if let Some(baseline) = &self.baseline {
            baseline.check()?;
        }
        if shard >= partition.shards() {
            let what = format!("{} shards, expected more than {shard}", partition.shards());
            return Err(Error::format("message of the leader", "partition", what));
        }
        let mut verifier = Verifier::new(VerifierOptions {
            abort_on: self.abort_on,
            strategy: self.strategy,
            events: self.events,
            motion_limit: self.motion_limit,
            max_pairs: self.max_pairs,
            baseline: self.baseline,
            ..options
        })?;
        verifier.verify_share(partition.share(shard))?;
        Ok(verifier)
    }
}

/// Message of the leader to one member.
#[derive(Debug, Serialize, Deserialize)]
enum Note {
    /// The next frames are to be verified.
    Begin(ShardSetup),
    /// The member is not needed, for this reason.
    Refuse(String),
}

/// Message of a member.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct State {
    /// Random number of the process.
    member: u64,
    /// From 1.
    shard: u32,
    shards: u32,
    /// Session of the leader that the member verifies; 0 if there is none.
    session: u64,
    /// Last frame, and the result or the reason why there is none.
    result: Option<(u64, Result<Part, String>)>,
    /// Why the member leaves, if it does.
    leaving: Option<String>,
}

/// Returns a message as bytes, after the version of this build.
fn encode(message: &impl Serialize) -> Vec<u8> {
    let message = (env!("CARGO_PKG_VERSION"), message);
    postcard::to_stdvec(&message).expect("plain data that fits into memory")
}

/// Decodes a message in shared memory, from a copy: another process could change text after it was
/// checked.
///
/// Errors: [`Error::Format`] if the bytes are no message of this build; [`Error::Count`] if there
/// are more than [`MAX_BYTES`].
fn decode<T: DeserializeOwned>(shared: &[u8]) -> Result<T> {
    if shared.len() > MAX_BYTES {
        return Err(Error::Count {
            what: "bytes of a message between shards (more than the limit)",
            promised: shared.len() as u64,
            available: MAX_BYTES as u64,
        });
    }
    let bytes = &shared.to_vec()[..];
    let known = env!("CARGO_PKG_VERSION");
    let bad = |what: String| Error::format("message between shards", "content", what);
    let (version, rest): (&str, _) =
        postcard::take_from_bytes(bytes).map_err(|e| bad(e.to_string()))?;
    if version != known {
        let version: String = version.chars().take(20).collect();
        return Err(bad(format!(
            "version {version:?} of linkwatch, this is {known}: use one version for all shards"
        )));
    }
    postcard::from_bytes(rest).map_err(|e| bad(e.to_string()))
}

fn open_topic(node: &Node<Ipc>, name: &str, part: &str) -> Result<Topic> {
    let name = service_name(name, part)?;
    let alignment = Alignment::new(ALIGNMENT).expect("64 is a power of two");
    retry_transient(|| {
        node.service_builder(&name)
            .publish_subscribe::<[u8]>()
            .user_header::<FrameHeader>()
            .payload_alignment(alignment)
            // Members that were killed count until their remains are removed.
            .max_publishers(2 * Partition::MAX_SHARDS)
            .max_subscribers(2 * Partition::MAX_SHARDS)
            .subscriber_max_buffer_size(BUFFER)
            .subscriber_max_borrowed_samples(2)
            .history_size(0)
            .enable_safe_overflow(true)
            .open_or_create()
    })
    .map_err(cannot_open(&name))
}

/// Names one of several shards, from 1.
fn shard_name(shard: u32, shards: u32) -> String {
    format!("shard {shard} of {shards}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Certificate;
    use crate::verdict::{Change, ImageLink, Link};

    /// The messages have no names of fields: a field that is left out would be read from the bytes
    /// of the next one.
    #[test]
    fn certificates_and_findings_with_and_without_images_are_decoded() {
        let (i, j) = (0, 1);
        for image in [[0; 3], [1, -2, 3]] {
            let change = Change {
                i,
                j,
                image,
                expected: 1,
                found: 0,
                place: None,
            };
            let link = ImageLink {
                i,
                j,
                image,
                lambda: 2,
            };
            let certificate = Certificate {
                curves: 2,
                links: vec![Link { i, j, lambda: -1 }],
                undefined: vec![],
                images: (image != [0; 3]).then(|| vec![link]),
                periods: Vec::new(),
            };
            let message = (change, certificate, "end".to_owned());
            let decoded: (Change, Certificate, String) = decode(&encode(&message)).unwrap();
            assert_eq!(decoded, message);
        }
    }
}
