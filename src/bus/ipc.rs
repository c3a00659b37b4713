//! Variant of iceoryx2 that both sides use, and its log.

use iceoryx2::prelude::{LogLevel, ipc_threadsafe, set_log_level_from_env_or};
use std::sync::Once;

/// Ports that may move to another thread. Compatible with `ipc::Service` in other processes.
pub(super) type Ipc = ipc_threadsafe::Service;

/// Limits the log of iceoryx2 to errors, unless IOX2_LOG_LEVEL is set. Its warnings concern
/// conditions that are handled here (a stopped peer, a missing configuration file).
pub(super) fn limit_log_level() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| set_log_level_from_env_or(LogLevel::Error));
}
