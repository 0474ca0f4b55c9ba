//! Arguments from C, checked.

use std::ffi::{c_char, CStr};
use std::fmt;

use uwcoop_core::chart::{Chart, SigmaMap};
use uwcoop_core::error::Error;

use crate::{uwcoop_chart, uwcoop_code};

/// Why a call failed.
#[derive(Debug)]
pub enum Failure {
    /// An argument that the caller must not give.
    Argument(String),
    /// What the core refused.
    Refused(Error),
    /// A buffer that does not hold the result.
    TooSmall {
        /// Bytes of the result.
        needed: usize,
        /// Bytes of the buffer.
        capacity: usize,
    },
    /// The navigator has failed before.
    Broken,
}

impl Failure {
    /// Its code.
    pub fn code(&self) -> uwcoop_code {
        match self {
            Self::Argument(_) => uwcoop_code::UWCOOP_BAD_ARGUMENT,
            Self::Refused(_) => uwcoop_code::UWCOOP_REFUSED,
            Self::TooSmall { .. } => uwcoop_code::UWCOOP_BUFFER_TOO_SMALL,
            Self::Broken => uwcoop_code::UWCOOP_INTERNAL,
        }
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Argument(text) => f.write_str(text),
            Self::Refused(error) => error.fmt(f),
            Self::TooSmall { needed, capacity } => {
                write!(f, "the buffer has {capacity} bytes: must have {needed}")
            }
            Self::Broken => f.write_str("the navigator failed before: it is to be destroyed"),
        }
    }
}

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        Self::Refused(error)
    }
}

/// A text that ends in 0.
///
/// # Safety
/// `text` is null or points to one that outlives the result.
pub unsafe fn text_of<'a>(what: &str, text: *const c_char) -> Result<&'a str, Failure> {
    if text.is_null() {
        return Err(Failure::Argument(format!("{what} is null")));
    }
    // SAFETY: the caller's word.
    unsafe { CStr::from_ptr(text) }.to_str().map_err(|_| Failure::Argument(format!("{what} is not UTF-8")))
}

/// `count` values; none of them may be null unless there are none.
///
/// # Safety
/// `values` is null or valid for `count` values that outlive the result.
pub unsafe fn slice_of<'a, T>(what: &str, values: *const T, count: usize) -> Result<&'a [T], Failure> {
    if count == 0 {
        return Ok(&[]);
    }
    if values.is_null() {
        return Err(Failure::Argument(format!("{what} is null")));
    }
    if count > isize::MAX as usize / size_of::<T>() {
        return Err(Failure::Argument(format!("{what} is said to have {count} values")));
    }
    // SAFETY: the caller's word, and no longer than any object can be.
    Ok(unsafe { std::slice::from_raw_parts(values, count) })
}

/// A copy of the chart.
///
/// # Safety
/// Its depths are valid for rows · cols values.
pub unsafe fn chart_of(chart: &uwcoop_chart) -> Result<Chart, Failure> {
    let nodes = chart
        .rows
        .checked_mul(chart.cols)
        .ok_or_else(|| Failure::Argument("chart has more nodes than there can be".into()))?;
    // SAFETY: the caller's word.
    let depth_m = unsafe { slice_of("chart depth_m", chart.depth_m, nodes) }?.to_vec();
    let sigma = SigmaMap::Uniform(chart.sigma_map_m);
    let uwcoop_chart { rows, cols, east0_m, north0_m, cell_m, correlation_length_m, .. } = *chart;
    Ok(Chart::new(depth_m, rows, cols, east0_m, north0_m, cell_m, sigma, correlation_length_m)?)
}
