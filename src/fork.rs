//! Processes that were forked from one that used the library.
//!
//! A fork copies the memory of a process. In the child, ports and samples of shared memory are
//! still those of the parent, so that dropping them would release them under it.

use crate::error::{Error, Result};
use std::ops::{Deref, DerefMut};
use std::process;

/// A value that only the process that made it uses and drops. A forked child forgets it.
#[derive(Debug)]
pub(crate) struct Owned<T> {
    /// Is `None` only while it is dropped.
    value: Option<T>,
    process: u32,
}

impl<T> Owned<T> {
    pub fn new(value: T) -> Self {
        Owned {
            value: Some(value),
            process: process::id(),
        }
    }

    /// Returns an error in a child of the process that made the value.
    pub fn check(&self) -> Result<()> {
        match self.process == process::id() {
            true => Ok(()),
            false => Err(Error::Forked {
                parent: self.process,
            }),
        }
    }

    /// Returns the value, or an error in a child of the process that made it.
    pub fn into_inner(mut self) -> Result<T> {
        self.check()?;
        Ok(self.value.take().expect("only taken here and by drop"))
    }
}

impl<T> Deref for Owned<T> {
    type Target = T;

    fn deref(&self) -> &T {
        self.value.as_ref().expect("present until it is dropped")
    }
}

impl<T> DerefMut for Owned<T> {
    fn deref_mut(&mut self) -> &mut T {
        self.value.as_mut().expect("present until it is dropped")
    }
}

impl<T> Drop for Owned<T> {
    fn drop(&mut self) {
        if self.check().is_err() {
            std::mem::forget(self.value.take());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;

    #[test]
    fn a_value_of_another_process_is_refused_and_forgotten() {
        let value = Arc::new(());
        let mut owned = Owned::new(Arc::clone(&value));
        assert!(owned.check().is_ok());
        drop(Owned::new(Arc::clone(&value)));
        assert_eq!(Arc::strong_count(&value), 2);
        owned.process = process::id() + 1;
        assert!(matches!(owned.check(), Err(Error::Forked { .. })));
        assert!(owned.into_inner().is_err());
        assert_eq!(Arc::strong_count(&value), 2);
    }
}
