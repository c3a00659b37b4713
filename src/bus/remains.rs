//! Removal of what killed processes left behind in shared memory.

use super::ipc::Ipc;
use iceoryx2::prelude::{Config, Node};
use std::time::Duration;

/// Time after which shared memory without a size counts as left behind. A living process sets the
/// size at once after it has created the memory.
#[cfg(target_os = "linux")]
const UNSIZED_LIMIT: Duration = Duration::from_secs(1);

/// Removes the files of dead processes from shared memory.
pub(super) fn cleanup() {
    remove_unsized();
    Node::<Ipc>::try_cleanup_dead_nodes(Config::global_config());
}

/// Removes shared memory that a process created, and did not live to give a size. iceoryx2 0.9.3
/// would wait without limit for the size, when it opens or lists services or removes dead nodes.
#[cfg(target_os = "linux")]
pub(super) fn remove_unsized() {
    use std::os::unix::fs::MetadataExt;
    use std::time::Instant;

    let prefix = Config::global_config().global.prefix.to_string();
    let list = || {
        let user = std::fs::metadata("/proc/self").ok()?.uid();
        let files = std::fs::read_dir("/dev/shm").ok()?.flatten();
        let unsized_files = files.filter_map(|file| {
            let name = file.file_name();
            let is_named = name.as_encoded_bytes().starts_with(prefix.as_bytes());
            let data = is_named.then(|| file.metadata().ok()).flatten()?;
            let is_unsized = data.size() == 0 && data.uid() == user;
            is_unsized.then(|| (file.path(), data.ino()))
        });
        Some(unsized_files.collect::<Vec<_>>())
    };
    let start = Instant::now();
    let mut left = list().unwrap_or_default();
    while !left.is_empty() && start.elapsed() < UNSIZED_LIMIT {
        std::thread::sleep(Duration::from_millis(5));
        let now = list().unwrap_or_default();
        left.retain(|file| now.contains(file));
    }
    for (path, _) in left {
        let removed = std::fs::remove_file(&path);
        tracing::debug!(
            "{}: left by a killed process; removed: {removed:?}",
            path.display()
        );
    }
}

#[cfg(not(target_os = "linux"))]
pub(super) fn remove_unsized() {}
