//! Kinds of pull-throughs that a stream is searched for.

vocabulary! {
    /// Kinds of pull-throughs that are searched for between frames.
    ///
    /// The search also finds pull-throughs that linking numbers do not show: two that cancel, those
    /// of a curve through itself, and those of open curves.
    #[derive(Default)]
    pub enum Events {
        /// No search.
        #[default]
        Off = "off",
        /// Pull-throughs between two different curves, closed or open.
        Between = "between",
        /// All pull-throughs, including those of a curve through itself.
        All = "all",
    }
}
