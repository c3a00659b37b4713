//! Status codes, and the description of the last error.

use std::cell::RefCell;
use std::ffi::{CStr, CString, c_char};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::ptr;

/// Result of a function: LW_OK, or another code.
pub type lw_status = i32;

/// The function succeeded.
pub const LW_OK: lw_status = 0;
/// There is no message, or no watcher came in time.
pub const LW_NOTHING: lw_status = 1;
/// No verdict in time, or the watcher skipped the frame. The frame is not known to be intact.
pub const LW_STALE: lw_status = 2;
/// No verdict, and none will come, because the watcher left. The frame is not known to be intact.
/// lw_last_error says how it left.
pub const LW_NO_WATCHER: lw_status = 3;
/// The function failed: see lw_last_error.
pub const LW_ERROR: lw_status = -1;

thread_local! {
    static LAST: RefCell<CString> = RefCell::default();
}

/// Returns a description of the last error of this thread, of LW_STALE or of LW_NO_WATCHER, or an
/// empty string. The description is valid until the next call of a function of this library in this
/// thread.
#[unsafe(no_mangle)]
pub extern "C" fn lw_last_error() -> *const c_char {
    LAST.try_with(|last| last.borrow().as_ptr())
        .unwrap_or(c"".as_ptr())
}

/// Runs a function. After an error or a panic, keeps its description and returns `failed`.
pub(crate) fn guard<T>(failed: T, run: impl FnOnce() -> Result<T, String>) -> T {
    let words = match catch_unwind(AssertUnwindSafe(run)) {
        Ok(Ok(value)) => return value,
        Ok(Err(words)) => words,
        Err(_) => "internal error of linkwatch, described on stderr".into(),
    };
    describe(&words);
    failed
}

/// Keeps a description for [`lw_last_error`].
pub(crate) fn describe(words: &str) {
    let words = CString::new(words.replace('\0', " ")).unwrap_or_default();
    // Fails while the thread ends, where nobody can read it any more.
    let _ = LAST.try_with(|last| *last.borrow_mut() = words);
}

/// Returns the words of an error.
pub(crate) fn words(error: linkwatch::Error) -> String {
    error.to_string()
}

/// Returns the target of a pointer, which must be valid or null.
///
/// # Safety
///
/// The pointer is null, or valid as a mutable reference for the duration of the call.
pub(crate) unsafe fn given<'a, T>(pointer: *mut T, what: &str) -> Result<&'a mut T, String> {
    // SAFETY: as promised by the caller.
    unsafe { pointer.as_mut() }.ok_or_else(|| format!("{what} is null"))
}

/// Returns a string of the caller.
///
/// # Safety
///
/// The pointer is null, or points to a string that ends with a zero byte.
pub(crate) unsafe fn string<'a>(pointer: *const c_char, what: &str) -> Result<&'a str, String> {
    if pointer.is_null() {
        return Err(format!("{what} is null"));
    }
    // SAFETY: as promised by the caller.
    let text = unsafe { CStr::from_ptr(pointer) };
    text.to_str().map_err(|_| format!("{what} is not UTF-8"))
}

/// Frees an object that this library returned. Does nothing if the pointer is null.
///
/// # Safety
///
/// The pointer is null, or comes from `Box::into_raw` and is not used again.
pub(crate) unsafe fn free<T>(pointer: *mut T) {
    if pointer.is_null() {
        return;
    }
    guard((), || {
        // SAFETY: as promised by the caller.
        drop(unsafe { Box::from_raw(pointer) });
        Ok(())
    });
}

/// Passes values to the caller, and writes their number to `count`. Null if there are none.
pub(crate) fn list<T>(values: &[T], count: &mut usize) -> *const T {
    *count = values.len();
    match values.is_empty() {
        true => ptr::null(),
        false => values.as_ptr(),
    }
}

/// Passes an object to the caller.
pub(crate) fn give<T>(made: impl FnOnce() -> Result<T, String>) -> *mut T {
    guard(ptr::null_mut(), || made().map(Box::new).map(Box::into_raw))
}
