//! The live client.

use crate::curves::{basis, cell, labels, precision, values};
use crate::error::{
    LW_ERROR, LW_NO_WATCHER, LW_NOTHING, LW_OK, LW_STALE, describe, free, give, given, guard,
    lw_status, string, words,
};
use crate::verdict::lw_verdict;
use linkwatch::{Client, ClientOptions, FrameMemory, Outcome, WaitMode};
use std::ffi::c_char;
use std::ptr;
use std::time::Duration;

/// Simulator's end of the bus. Not thread-safe: use it in one thread at a time.
pub struct lw_client {
    client: Client,
    /// Memory of the frame that was begun and not yet published.
    frame: Option<FrameMemory>,
}

/// Wait without using the CPU. The default.
pub const LW_SLEEP: u32 = 0;
/// Poll without a pause: faster by 10 to 50 microseconds, and keeps one core busy.
pub const LW_SPIN: u32 = 1;

/// Options of lw_open. All zero are the defaults.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct lw_options {
    /// True if the simulator waits for the verdict on every frame. The watcher is informed.
    pub lockstep: bool,
    /// LW_SLEEP or LW_SPIN: how the calls that wait for the watcher do so.
    pub wait_mode: u32,
}

/// Returns a duration of seconds; without a limit if it is infinite.
fn duration(seconds: f64) -> Result<Duration, String> {
    if seconds == f64::INFINITY {
        return Ok(Duration::MAX);
    }
    let duration = Duration::try_from_secs_f64(seconds);
    duration.map_err(|why| format!("a wait of {seconds} seconds: {why}"))
}

/// Writes a verdict to memory of the caller, unless the pointer is null.
///
/// # Safety
///
/// `to` is null or valid.
unsafe fn store(verdict: lw_verdict, to: *mut lw_verdict) {
    // SAFETY: as promised by the caller.
    if let Some(to) = unsafe { to.as_mut() } {
        *to = verdict;
    }
}

/// Opens a service, or creates it if the watcher has not done so yet. `options` may be null.
///
/// Returns null after an error, for example if another living simulator publishes on the same name.
///
/// # Safety
///
/// `service` is a string that ends with a zero byte. `options` is null or valid.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lw_open(
    service: *const c_char,
    options: *const lw_options,
) -> *mut lw_client {
    give(|| {
        // SAFETY: as promised by the caller.
        let service = unsafe { string(service, "the name of the service") }?;
        // SAFETY: as promised by the caller.
        let options = unsafe { options.as_ref() }.copied().unwrap_or_default();
        let mut chosen = ClientOptions::default();
        chosen.lockstep = options.lockstep;
        chosen.wait_mode = match options.wait_mode {
            LW_SLEEP => WaitMode::Sleep,
            LW_SPIN => WaitMode::Spin,
            other => return Err(format!("wait mode {other}: expected LW_SLEEP or LW_SPIN")),
        };
        Ok(lw_client {
            client: Client::open(service, &chosen).map_err(words)?,
            frame: None,
        })
    })
}

/// Declares the curves of every frame: the number of control points of each curve, negative if the
/// curve is closed. Call this once, before the first frame.
///
/// # Safety
///
/// `client` comes from lw_open. `counts` points to `curves` numbers.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lw_describe(
    client: *mut lw_client,
    basis_code: u32,
    precision_code: u32,
    counts: *const i32,
    curves: usize,
) -> lw_status {
    let (names, radii) = (ptr::null(), ptr::null());
    // SAFETY: as promised by the caller.
    unsafe {
        lw_describe_labelled(
            client,
            basis_code,
            precision_code,
            counts,
            curves,
            names,
            radii,
        )
    }
}

/// Same as lw_describe, for curves with names or radii; either may be null.
///
/// If the curves have names, this can be called again between two frames: curves may be added,
/// removed, reordered, or get another number of points. The watcher compares the linking numbers of
/// curves by their names, and expects those of new curves to stay as they are in their first frame.
/// A name belongs to one curve for the whole session. A frame that was begun is discarded.
///
/// # Safety
///
/// `client` comes from lw_open. `counts` points to `curves` numbers, and so does `radii`, which may
/// be null. `names` is null, or points to `curves` strings that end with a zero byte.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lw_describe_labelled(
    client: *mut lw_client,
    basis_code: u32,
    precision_code: u32,
    counts: *const i32,
    curves: usize,
    names: *const *const c_char,
    radii: *const f32,
) -> lw_status {
    guard(LW_ERROR, || {
        // SAFETY: as promised by the caller.
        let (this, counts) =
            unsafe { (given(client, "client")?, values(counts, curves, "counts")?) };
        let (basis, precision) = (basis(basis_code)?, precision(precision_code)?);
        // SAFETY: as promised by the caller.
        let labels = unsafe { labels(names, radii, curves) }?;
        this.frame = None;
        let described = this
            .client
            .describe_labelled(basis, precision, counts, labels);
        described.map(|()| LW_OK).map_err(words)
    })
}

/// Sets the time step of the simulator in seconds, which later frames carry to the recording; 0 (as
/// at first) if it is unknown.
///
/// # Safety
///
/// `client` comes from lw_open.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lw_set_time_step(client: *mut lw_client, seconds: f64) -> lw_status {
    guard(LW_ERROR, || {
        // SAFETY: as promised by the caller.
        let this = unsafe { given(client, "client") }?;
        let set = this.client.set_time_step(seconds);
        set.map(|()| LW_OK).map_err(words)
    })
}

/// Sets the periodic cell of later frames: three vectors, `x y z` one after the other, and a
/// corner, which may be null. A vector of zeros stands for a direction without repetition. If
/// `vectors` is null, as at first, space is open. The cell may differ from frame to frame: set it
/// before lw_publish. All frames of a session repeat along the same vectors, or along none.
///
/// # Safety
///
/// `client` comes from lw_open. `vectors` is null, or points to nine numbers; `corner` is null, or
/// points to three.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lw_set_cell(
    client: *mut lw_client,
    vectors: *const f64,
    corner: *const f64,
) -> lw_status {
    guard(LW_ERROR, || {
        // SAFETY: as promised by the caller.
        let (this, cell) = unsafe { (given(client, "client")?, cell(vectors, corner)?) };
        this.client.set_cell(cell).map(|()| LW_OK).map_err(words)
    })
}

/// Returns shared memory for the positions of the next frame, at `time` seconds of simulation:
/// `x y z x y z ..` curve after curve, 64-byte aligned. Write all of it, then call lw_publish. The
/// watcher reads the same memory; nothing is copied.
///
/// A second call before lw_publish discards the first frame. Returns null after an error, for
/// example if the curves were described as LW_DOUBLE.
///
/// # Safety
///
/// `client` comes from lw_open.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lw_begin_float(client: *mut lw_client, time: f64) -> *mut f32 {
    guard(ptr::null_mut(), || {
        // SAFETY: as promised by the caller.
        unsafe {
            begin(client, time, |frame| {
                Ok(frame.positions_f32()?.as_mut_ptr())
            })
        }
    })
}

/// Same as lw_begin_float, for curves that were described as LW_DOUBLE.
///
/// # Safety
///
/// `client` comes from lw_open.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lw_begin_double(client: *mut lw_client, time: f64) -> *mut f64 {
    guard(ptr::null_mut(), || {
        // SAFETY: as promised by the caller.
        unsafe {
            begin(client, time, |frame| {
                Ok(frame.positions_f64()?.as_mut_ptr())
            })
        }
    })
}

/// Begins a frame, unless its positions have another precision.
///
/// # Safety
///
/// `client` is null, or comes from lw_open.
unsafe fn begin<T>(
    client: *mut lw_client,
    time: f64,
    positions: impl FnOnce(&mut FrameMemory) -> linkwatch::Result<*mut T>,
) -> Result<*mut T, String> {
    // SAFETY: as promised by the caller.
    let this = unsafe { given(client, "client") }?;
    this.frame = None;
    let mut frame = this.client.begin(time).map_err(words)?;
    let start = positions(&mut frame).map_err(words)?;
    this.frame = Some(frame);
    Ok(start)
}

/// Publishes the frame that was begun last. Writes its sequence number to `seq`, which may be null.
/// Never waits.
///
/// # Safety
///
/// `client` comes from lw_open. `seq` is null or valid.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lw_publish(client: *mut lw_client, seq: *mut u64) -> lw_status {
    guard(LW_ERROR, || {
        // SAFETY: as promised by the caller.
        let this = unsafe { given(client, "client") }?;
        let frame = this.frame.take();
        let frame = frame.ok_or("no frame was begun: call lw_begin_float or lw_begin_double")?;
        let number = this.client.send(frame).map_err(words)?;
        // SAFETY: as promised by the caller.
        if let Some(seq) = unsafe { seq.as_mut() } {
            *seq = number;
        }
        Ok(LW_OK)
    })
}

/// Reads the next verdict, in the order of the frames. Returns LW_NOTHING if there is none. Never
/// waits. Call this about once a step: 64 verdicts are kept, then the oldest are dropped. An abort
/// is not lost. `verdict` may be null.
///
/// # Safety
///
/// `client` comes from lw_open. `verdict` is null or valid.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lw_poll(client: *mut lw_client, verdict: *mut lw_verdict) -> lw_status {
    // SAFETY: as promised by the caller.
    unsafe { store(lw_verdict::NONE, verdict) };
    guard(LW_ERROR, || {
        // SAFETY: as promised by the caller.
        let this = unsafe { given(client, "client") }?;
        Ok(match this.client.poll().map_err(words)? {
            Some(message) => {
                // SAFETY: as promised by the caller.
                unsafe { store((&message).into(), verdict) };
                LW_OK
            }
            None => LW_NOTHING,
        })
    })
}

/// Waits for the verdict on a frame, at most for `seconds`. Verdicts on earlier frames are read
/// meanwhile, and their aborts are kept. `verdict` may be null.
///
/// Returns LW_OK, LW_STALE (no verdict in time, or the frame was skipped) or LW_NO_WATCHER (the
/// watcher left or died: at once, or within a second).
///
/// # Safety
///
/// `client` comes from lw_open. `verdict` is null or valid.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lw_wait(
    client: *mut lw_client,
    seq: u64,
    seconds: f64,
    verdict: *mut lw_verdict,
) -> lw_status {
    // SAFETY: as promised by the caller.
    unsafe { store(lw_verdict::NONE, verdict) };
    guard(LW_ERROR, || {
        // SAFETY: as promised by the caller.
        let this = unsafe { given(client, "client") }?;
        let outcome = this.client.wait(seq, duration(seconds)?);
        Ok(match outcome.map_err(words)? {
            Outcome::Verdict(message) => {
                // SAFETY: as promised by the caller.
                unsafe { store((&*message).into(), verdict) };
                LW_OK
            }
            Outcome::Stale => {
                describe(&format!(
                    "no verdict on frame {seq} within {seconds} seconds, or the watcher skipped it"
                ));
                LW_STALE
            }
            Outcome::NoWatcher(how) => {
                describe(&format!("no verdict on frame {seq}: {how}"));
                LW_NO_WATCHER
            }
        })
    })
}

/// Waits until a watcher has seen this session, at most for `seconds`. Returns LW_OK, or LW_NOTHING
/// if none came in time. Needed only if no frame must be missed: a watcher that starts later
/// receives the first frame, which the client keeps, and then the newest one.
///
/// # Safety
///
/// `client` comes from lw_open.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lw_wait_for_watcher(client: *mut lw_client, seconds: f64) -> lw_status {
    guard(LW_ERROR, || {
        // SAFETY: as promised by the caller.
        let this = unsafe { given(client, "client") }?;
        let came = this.client.wait_for_watcher(duration(seconds)?);
        Ok(if came.map_err(words)? {
            LW_OK
        } else {
            LW_NOTHING
        })
    })
}

/// Returns true if the watcher asked the simulator to stop, and writes the first verdict that did
/// so to `verdict`, which may be null. Also returns true if `client` is null, because then nothing
/// is known to be intact. Only verdicts that lw_poll or lw_wait has read count.
///
/// # Safety
///
/// `client` comes from lw_open. `verdict` is null or valid.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lw_aborted(client: *mut lw_client, verdict: *mut lw_verdict) -> bool {
    // SAFETY: as promised by the caller.
    unsafe { store(lw_verdict::NONE, verdict) };
    guard(true, || {
        // SAFETY: as promised by the caller.
        let this = unsafe { given(client, "client") }?;
        let abort = this.client.aborted();
        if let Some(message) = abort {
            // SAFETY: as promised by the caller.
            unsafe { store(message.into(), verdict) };
        }
        Ok(abort.is_some())
    })
}

/// Clears the abort after a roll back: the next frame does not continue the last one.
///
/// # Safety
///
/// `client` comes from lw_open.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lw_resume(client: *mut lw_client) -> lw_status {
    guard(LW_ERROR, || {
        // SAFETY: as promised by the caller.
        unsafe { given(client, "client") }?.client.resume();
        Ok(LW_OK)
    })
}

/// Accepts the present state as the new baseline: the watcher expects the linking numbers of the
/// next frame from then on. Clears the abort, as lw_resume does.
///
/// # Safety
///
/// `client` comes from lw_open.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lw_accept(client: *mut lw_client) -> lw_status {
    guard(LW_ERROR, || {
        // SAFETY: as promised by the caller.
        unsafe { given(client, "client") }?.client.accept();
        Ok(LW_OK)
    })
}

/// Marks the next frame as not continuing the previous one, for example after a jump. Pull-throughs
/// between the two frames are not searched for.
///
/// # Safety
///
/// `client` comes from lw_open.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lw_cut(client: *mut lw_client) -> lw_status {
    guard(LW_ERROR, || {
        // SAFETY: as promised by the caller.
        unsafe { given(client, "client") }?.client.cut();
        Ok(LW_OK)
    })
}

/// Returns the seconds since the last message of the watcher, or a negative number if it never sent
/// one, or left. The watcher sends a message about once a second. The simulator decides what a
/// longer silence means.
///
/// # Safety
///
/// `client` comes from lw_open.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lw_silent_for(client: *mut lw_client) -> f64 {
    guard(-1.0, || {
        // SAFETY: as promised by the caller.
        let this = unsafe { given(client, "client") }?;
        Ok(this.client.silent_for().map_or(-1.0, |t| t.as_secs_f64()))
    })
}

/// Ends the session, waits at most for `seconds` until the watcher has verified its remaining
/// frames, and frees the client in any case. Writes the last message of the watcher to `last`,
/// which may be null; it counts all frames and repeats the last abort.
///
/// Returns LW_OK, or LW_NOTHING if the watcher sent nothing in time, left before the end, or died
/// (lw_last_error says which).
///
/// # Safety
///
/// `client` comes from lw_open, and is not used afterwards. `last` is null or valid.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lw_finish(
    client: *mut lw_client,
    seconds: f64,
    last: *mut lw_verdict,
) -> lw_status {
    // SAFETY: as promised by the caller.
    unsafe { store(lw_verdict::NONE, last) };
    guard(LW_ERROR, || {
        if client.is_null() {
            return Err("client is null".into());
        }
        // SAFETY: as promised by the caller.
        let this = unsafe { Box::from_raw(client) };
        let lw_client { mut client, frame } = *this;
        drop(frame);
        while client.poll().map_err(words)?.is_some() {}
        let left = client.departure().map(ToString::to_string);
        let goodbye = client.finish_within(duration(seconds)?).map_err(words)?;
        Ok(match goodbye {
            Some(message) => {
                // SAFETY: as promised by the caller.
                unsafe { store((&message).into(), last) };
                LW_OK
            }
            None => {
                let silent = || format!("the watcher sent nothing within {seconds} seconds");
                describe(&left.unwrap_or_else(silent));
                LW_NOTHING
            }
        })
    })
}

/// Frees the client without a regular end: the watcher is informed that the session ended early.
/// Does nothing if the pointer is null.
///
/// # Safety
///
/// `client` is null, or comes from lw_open and is not used afterwards.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lw_close(client: *mut lw_client) {
    // SAFETY: as promised by the caller.
    unsafe { free(client) }
}
