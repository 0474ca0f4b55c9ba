//! The navigators of `uwcoop-core` behind a C header, `include/uwcoop.h`.
//!
//! Every function gives a code of [`uwcoop_code`], 0 being success; [`uwcoop_last_error`] has the text of the last failure
//! in this thread. A panic of the core is caught and becomes a code; the navigator is then good for nothing but
//! `uwcoop_destroy`. A navigator may move between threads, but not be used by two at a time.

#![allow(non_camel_case_types)]
// C has one space of names for all constants.
#![allow(clippy::enum_variant_names)]
// A C interface is made of raw pointers: each function states what it asks of them.
#![allow(unsafe_code)]
#![allow(clippy::missing_safety_doc)]

mod arguments;
mod events;

use std::cell::RefCell;
use std::ffi::{c_char, CString};
use std::panic::{catch_unwind, AssertUnwindSafe};
use std::sync::Arc;

use uwcoop_core::link::Authenticator;
use uwcoop_core::navigator::authenticated::authenticated;
use uwcoop_core::navigator::packaged::{make_navigator, Options};
use uwcoop_core::navigator::settings::Context;
use uwcoop_core::navigator::{Navigator, Outcome, Status};

use arguments::{chart_of, slice_of, text_of, Failure};

/// What a call came to.
#[repr(i32)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum uwcoop_code {
    /// It worked.
    UWCOOP_OK = 0,
    /// A null pointer, a text that is not UTF-8, an unknown kind, a wrong number of values.
    UWCOOP_BAD_ARGUMENT = 1,
    /// The navigator refused it; its state is as it was.
    UWCOOP_REFUSED = 2,
    /// The buffer is too small; the length that is needed was written.
    UWCOOP_BUFFER_TOO_SMALL = 3,
    /// A defect of the library: the navigator is to be destroyed.
    UWCOOP_INTERNAL = 4,
}

/// What became of an event.
#[repr(i32)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum uwcoop_outcome {
    /// It changed the estimate.
    UWCOOP_FUSED = 0,
    /// It only advanced the time, or this navigator does not use it.
    UWCOOP_NOTED = 1,
    /// It contradicts the belief; counted, the estimate is as it was.
    UWCOOP_GATED = 2,
    /// A packet that does not decode, is a copy, or is too old; counted, the estimate is as it was.
    UWCOOP_REJECTED = 3,
}

/// Whether a vehicle has started, and whether it is over its chart.
#[repr(i32)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum uwcoop_status {
    /// No position fix yet: the mean is NaN, the covariance infinite.
    UWCOOP_NOT_STARTED = 0,
    /// Navigating normally.
    UWCOOP_NAVIGATING = 1,
    /// Off the chart or over a hole: dead reckoning until the chart is back.
    UWCOOP_OFF_CHART = 2,
    /// The whole region where the vehicle may be is searched.
    UWCOOP_ACQUIRING = 3,
}

/// A depth grid: float32, row by row from the south-west corner, positive down, NaN for holes. It is copied.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct uwcoop_chart {
    /// rows · cols depths, m.
    pub depth_m: *const f32,
    /// Rows, from south to north.
    pub rows: usize,
    /// Columns, from west to east.
    pub cols: usize,
    /// East of the first node, m.
    pub east0_m: f64,
    /// North of the first node, m.
    pub north0_m: f64,
    /// Distance between nodes, m.
    pub cell_m: f64,
    /// Standard deviation of the chart's error, m.
    pub sigma_map_m: f64,
    /// Length over which the error is correlated, m.
    pub correlation_length_m: f64,
}

/// Belief of the vehicle about its own position.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct uwcoop_estimate {
    /// Time it holds for, ns since the mission's epoch.
    pub t_ns: i64,
    /// East and north, m.
    pub mean_m: [f64; 2],
    /// East-east, east-north, north-north, m².
    pub covariance_m2: [f64; 3],
    /// Counter-clockwise from east, rad; NaN where it is not estimated.
    pub yaw_rad: f64,
    /// Effective sample size; NaN for navigators without particles.
    pub ess: f64,
    /// Measurements gated and packets rejected so far.
    pub rejected: u64,
    /// Whether the chart helps now.
    pub status: uwcoop_status,
}

/// One vehicle's navigator.
pub struct uwcoop_navigator {
    inner: Option<Box<dyn Navigator>>,
    vehicle: u16,
    vehicles: usize,
}

thread_local! {
    static LAST_ERROR: RefCell<CString> = RefCell::new(CString::default());
}

fn fail(code: uwcoop_code, text: &str) -> uwcoop_code {
    let text: Vec<u8> = text.bytes().filter(|byte| *byte != 0).collect();
    LAST_ERROR.with(|last| *last.borrow_mut() = CString::new(text).unwrap_or_default());
    code
}

/// Runs a call's body; what goes wrong becomes a code and a text, a panic included.
fn guarded(body: impl FnOnce() -> Result<(), Failure>) -> uwcoop_code {
    match catch_unwind(AssertUnwindSafe(body)) {
        Ok(Ok(())) => uwcoop_code::UWCOOP_OK,
        Ok(Err(failure)) => fail(failure.code(), &failure.to_string()),
        Err(_) => fail(uwcoop_code::UWCOOP_INTERNAL, "the library failed: the navigator is to be destroyed"),
    }
}

/// As [`guarded`], with the navigator, which a panic leaves empty.
///
/// # Safety
/// `navigator` is null or one that `uwcoop_create` gave, used by no other thread.
unsafe fn with(
    navigator: *mut uwcoop_navigator,
    body: impl FnOnce(&mut dyn Navigator, u16) -> Result<(), Failure>,
) -> uwcoop_code {
    // SAFETY: the caller's word.
    let Some(held) = (unsafe { navigator.as_mut() }) else {
        return fail(uwcoop_code::UWCOOP_BAD_ARGUMENT, "navigator is null");
    };
    let Some(mut inner) = held.inner.take() else {
        return fail(uwcoop_code::UWCOOP_INTERNAL, "the navigator failed before: it is to be destroyed");
    };
    let vehicle = held.vehicle;
    let mut back = None;
    let code = guarded(|| {
        let result = body(inner.as_mut(), vehicle);
        back = Some(inner);
        result
    });
    held.inner = back;
    code
}

/// Text of the last failure in this thread; never null, valid until the next call in this thread.
#[no_mangle]
pub extern "C" fn uwcoop_last_error() -> *const c_char {
    LAST_ERROR.with(|last| last.borrow().as_ptr())
}

/// Make the navigator of one vehicle of a team.
///
/// `name`: e.g. "team". `options_json`: the options that are stated, as in a scenario's table `[navigator.NAME]`, e.g.
/// "{\"particles\": 1500}"; null: the defaults. `chart`: null: no chart on board. All vehicles of a team take the same
/// `vehicles`, `sound_speed_mps` and options. `created` is written on success; `uwcoop_destroy` ends it.
///
/// Texts end in 0; `created` must be valid for writing.
#[no_mangle]
pub unsafe extern "C" fn uwcoop_create(
    name: *const c_char,
    vehicle: u16,
    vehicles: usize,
    sound_speed_mps: f64,
    seed: u64,
    options_json: *const c_char,
    chart: *const uwcoop_chart,
    created: *mut *mut uwcoop_navigator,
) -> uwcoop_code {
    guarded(|| {
        if created.is_null() {
            return Err(Failure::Argument("created is null".into()));
        }
        // SAFETY: texts that end in 0, as the caller must give them.
        let name = unsafe { text_of("name", name) }?;
        let options: Options = if options_json.is_null() {
            Options::new()
        } else {
            // SAFETY: as above.
            let text = unsafe { text_of("options_json", options_json) }?;
            serde_json::from_str(text)
                .map_err(|error| Failure::Argument(format!("options_json is no JSON object: {error}")))?
        };
        // SAFETY: null or a chart whose depths are rows · cols.
        let chart = unsafe { chart.as_ref() }.map(|chart| unsafe { chart_of(chart) }).transpose()?;
        let context = Context { vehicle, vehicles, sound_speed_mps, seed, ranging: &[] };
        let inner = make_navigator(name, &context, &options, chart.map(Arc::new))?;
        let held = Box::new(uwcoop_navigator { inner: Some(inner), vehicle, vehicles });
        // SAFETY: valid for writing, as the caller must give it.
        unsafe { created.write(Box::into_raw(held)) };
        Ok(())
    })
}

/// End a navigator; null is nothing.
#[no_mangle]
pub unsafe extern "C" fn uwcoop_destroy(navigator: *mut uwcoop_navigator) {
    if !navigator.is_null() {
        // SAFETY: it came from `Box::into_raw` in `uwcoop_create`, and the caller gives it up.
        let held = unsafe { Box::from_raw(navigator) };
        let _ = guarded(|| {
            drop(held);
            Ok(())
        });
    }
}

/// Tag the packets of this navigator and check those of the others; once, before the first event.
///
/// `key`: the team's, 16 to 64 bytes. `tag_bytes`: 1 to 16. `mission`: another number for each mission with this key.
#[no_mangle]
pub unsafe extern "C" fn uwcoop_authenticate(
    navigator: *mut uwcoop_navigator,
    key: *const u8,
    key_bytes: usize,
    tag_bytes: usize,
    mission: u64,
) -> uwcoop_code {
    // SAFETY: the caller's word on `navigator`.
    let Some(held) = (unsafe { navigator.as_mut() }) else {
        return fail(uwcoop_code::UWCOOP_BAD_ARGUMENT, "navigator is null");
    };
    guarded(|| {
        // SAFETY: `key` is valid for `key_bytes`.
        let key = unsafe { slice_of("key", key, key_bytes) }?;
        let authenticator =
            Authenticator::new(key, tag_bytes, mission).map_err(uwcoop_core::error::Error::from)?;
        let inner = held.inner.take().ok_or(Failure::Broken)?;
        held.inner = Some(authenticated(inner, held.vehicle, held.vehicles, authenticator));
        Ok(())
    })
}

/// The packet for the slot at `tol_ns`.
///
/// `packet` is a buffer of `capacity_bytes`, what the slot holds; `packet_bytes` is written: 0 is silence.
#[no_mangle]
pub unsafe extern "C" fn uwcoop_transmit(
    navigator: *mut uwcoop_navigator,
    tol_ns: i64,
    packet: *mut u8,
    capacity_bytes: usize,
    packet_bytes: *mut usize,
) -> uwcoop_code {
    // SAFETY: the caller's word; a packet is never longer than `capacity_bytes`, and is checked to be so.
    unsafe {
        with(navigator, |inner, _| {
            if packet.is_null() || packet_bytes.is_null() {
                return Err(Failure::Argument("packet or packet_bytes is null".into()));
            }
            let made = inner.transmit(tol_ns, capacity_bytes)?;
            copy_out(made.as_deref().unwrap_or(&[]), packet, capacity_bytes, packet_bytes)
        })
    }
}

/// The belief predicted to `t_ns`; changes nothing.
#[no_mangle]
pub unsafe extern "C" fn uwcoop_get_estimate(
    navigator: *mut uwcoop_navigator,
    t_ns: i64,
    estimate: *mut uwcoop_estimate,
) -> uwcoop_code {
    // SAFETY: the caller's word; `estimate` is valid for writing.
    unsafe {
        with(navigator, |inner, _| {
            if estimate.is_null() {
                return Err(Failure::Argument("estimate is null".into()));
            }
            let found = inner.estimate(t_ns);
            estimate.write(uwcoop_estimate {
                t_ns: found.t_ns,
                mean_m: found.mean_m,
                covariance_m2: found.covariance_m2,
                yaw_rad: found.yaw.map_or(f64::NAN, |yaw| yaw.0),
                ess: found.ess.unwrap_or(f64::NAN),
                rejected: found.rejected,
                status: match found.status {
                    Status::NotStarted => uwcoop_status::UWCOOP_NOT_STARTED,
                    Status::Navigating => uwcoop_status::UWCOOP_NAVIGATING,
                    Status::OffChart => uwcoop_status::UWCOOP_OFF_CHART,
                    Status::Acquiring => uwcoop_status::UWCOOP_ACQUIRING,
                },
            });
            Ok(())
        })
    }
}

/// Everything that determines what comes next, counters against replayed packets included; never the key.
///
/// `state` is a buffer of `capacity_bytes`, or null to learn the length; `state_bytes` is written in both cases.
#[no_mangle]
pub unsafe extern "C" fn uwcoop_snapshot(
    navigator: *mut uwcoop_navigator,
    state: *mut u8,
    capacity_bytes: usize,
    state_bytes: *mut usize,
) -> uwcoop_code {
    // SAFETY: the caller's word; `state` is null or valid for `capacity_bytes`.
    unsafe {
        with(navigator, |inner, _| {
            if state_bytes.is_null() {
                return Err(Failure::Argument("state_bytes is null".into()));
            }
            let made = inner.snapshot()?;
            if state.is_null() {
                state_bytes.write(made.len());
                return Ok(());
            }
            copy_out(&made, state, capacity_bytes, state_bytes)
        })
    }
}

/// Take up a snapshot of a navigator that was made the same.
#[no_mangle]
pub unsafe extern "C" fn uwcoop_restore(
    navigator: *mut uwcoop_navigator,
    state: *const u8,
    state_bytes: usize,
) -> uwcoop_code {
    // SAFETY: the caller's word; `state` is valid for `state_bytes`.
    unsafe { with(navigator, |inner, _| Ok(inner.restore(slice_of("state", state, state_bytes)?)?)) }
}

/// # Safety
/// `to` is valid for `capacity` bytes, `length` for writing.
unsafe fn copy_out(from: &[u8], to: *mut u8, capacity: usize, length: *mut usize) -> Result<(), Failure> {
    // SAFETY: the caller's word.
    unsafe { length.write(from.len()) };
    if from.len() > capacity {
        return Err(Failure::TooSmall { needed: from.len(), capacity });
    }
    // SAFETY: as above, and `from` is no longer than the buffer.
    unsafe { std::ptr::copy_nonoverlapping(from.as_ptr(), to, from.len()) };
    Ok(())
}

fn outcome_of(outcome: Outcome) -> uwcoop_outcome {
    match outcome {
        Outcome::Fused => uwcoop_outcome::UWCOOP_FUSED,
        Outcome::Noted => uwcoop_outcome::UWCOOP_NOTED,
        Outcome::Gated => uwcoop_outcome::UWCOOP_GATED,
        Outcome::Rejected => uwcoop_outcome::UWCOOP_REJECTED,
    }
}
