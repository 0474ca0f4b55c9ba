//! From measured times to distances.

use super::LinkError;
use super::error::within;

/// Slant range of a signal launched at `tol_ns` that arrived at `toa_ns` (start of the signal), m: travel time times
/// `sound_speed_mps`. It lies between the sender at launch and the receiver at arrival.
///
/// # Errors
/// [`LinkError::OutOfRange`] unless the sound speed is positive and finite; [`LinkError::RangeNotPositive`] for an
/// arrival that is not after the launch.
pub fn range_m(tol_ns: i64, toa_ns: i64, sound_speed_mps: f64) -> Result<f64, LinkError> {
    within("sound_speed_mps", sound_speed_mps, f64::MIN_POSITIVE, f64::MAX)?;
    // The difference is taken as an integer: as seconds since the epoch, times would lose their nanoseconds.
    let travel_ns = i128::from(toa_ns) - i128::from(tol_ns);
    let range_m = travel_ns as f64 * 1e-9 * sound_speed_mps;
    if travel_ns > 0 && range_m > 0.0 {
        within("range_m", range_m, 0.0, f64::MAX)?;
        return Ok(range_m);
    }
    Err(LinkError::RangeNotPositive { range_m, tol_ns, toa_ns })
}

/// A slant range reduced to the horizontal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HorizontalRange {
    /// Horizontal distance, m, ≥ 0.
    pub range_m: f64,
    /// True when the slant range was shorter than the depth difference (within its noise) and zero stands for it:
    /// one vehicle is about above the other, and the range says little about the horizontal.
    pub clamped: bool,
}

/// What the rounding of a depth does to the range that [`slant_to_horizontal`] reduces with it: mean square error, m².
///
/// With depths `depth_difference_m` = Δ apart as carried, h = √(s² − Δ²) and an error δ of one depth that is uniform over
/// `step_m`, h² is off by 2Δδ + δ². With v = step²/12, e = v (Δ² + 9/20 v) is a quarter of the mean square of that, and
/// h is off by √e / h while h² is the larger; where one vehicle is about above the other, by no more than e^¼.
#[must_use]
pub fn depth_rounding_m2(horizontal_m: f64, depth_difference_m: f64, step_m: f64) -> f64 {
    if step_m <= 0.0 {
        return 0.0;
    }
    let v = step_m * step_m / 12.0;
    let e = v * (depth_difference_m * depth_difference_m + 0.45 * v);
    e / (horizontal_m * horizontal_m).max(e.sqrt())
}

/// Horizontal part of a slant range between depths `depth_a_m` and `depth_b_m` (positive down, m):
/// √(slant² − (depth_a − depth_b)²).
///
/// Noise may make a slant range up to `gates · sigma_m` shorter than the depth difference, where `sigma_m` is the
/// standard deviation of the range (and of the depth difference, if that matters): zero stands for it then, and the
/// result says so.
///
/// # Errors
/// [`LinkError::SlantTooShort`] for a slant range shorter than that; [`LinkError::OutOfRange`] for one that is not
/// positive, a negative `sigma_m` or `gates`, and anything that is not finite.
pub fn slant_to_horizontal(
    slant_m: f64,
    depth_a_m: f64,
    depth_b_m: f64,
    sigma_m: f64,
    gates: f64,
) -> Result<HorizontalRange, LinkError> {
    within("slant_m", slant_m, f64::MIN_POSITIVE, f64::MAX)?;
    within("depth_a_m", depth_a_m, f64::MIN, f64::MAX)?;
    within("depth_b_m", depth_b_m, f64::MIN, f64::MAX)?;
    within("sigma_m", sigma_m, 0.0, f64::MAX)?;
    within("gates", gates, 0.0, f64::MAX)?;
    let depth_difference_m = (depth_a_m - depth_b_m).abs();
    if slant_m >= depth_difference_m {
        // As a product the small difference of two large squares keeps its digits.
        let range_m = ((slant_m - depth_difference_m) * (slant_m + depth_difference_m)).sqrt();
        within("horizontal range_m", range_m, 0.0, f64::MAX)?;
        return Ok(HorizontalRange { range_m, clamped: false });
    }
    let allowance_m = gates * sigma_m;
    if depth_difference_m - slant_m <= allowance_m {
        return Ok(HorizontalRange { range_m: 0.0, clamped: true });
    }
    Err(LinkError::SlantTooShort { slant_m, depth_difference_m, allowance_m })
}
