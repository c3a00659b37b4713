//! The way in which a process waits for the other side.

vocabulary! {
    /// Waiting strategy of a client or a watcher for the next message. Both sides choose
    /// independently.
    #[derive(Default)]
    pub enum WaitMode {
        /// Sleeps until the other side wakes it. Waking takes the system 10 to 50 microseconds. An
        /// idle watcher uses 0.2 % of a core.
        #[default]
        Sleep = "sleep",
        /// Polls without a pause: receives a message within about a microsecond, but keeps one core
        /// busy while it waits. If no core is free for it, it delays the other side.
        Spin = "spin",
    }
}
