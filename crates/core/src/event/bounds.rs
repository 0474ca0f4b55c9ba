//! What each number of an event may be: one table, read by [`super::Event::validate`] and by the Python layer.
//!
//! The bounds are wider than any honest source needs, and narrow enough that nothing computed from an event that keeps
//! them overflows or loses its digits. What contradicts the belief is a navigator's business, not this table's.

use super::Kind;
use crate::error::{Error, finite};

/// What one number of one kind of event may be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bound {
    /// Kind of event.
    pub kind: Kind,
    /// Name of the number with its unit, as the columns of a mission log call it.
    pub field: &'static str,
    /// Kind and field, for messages.
    pub quantity: &'static str,
    /// Least value.
    pub minimum: f64,
    /// Greatest value.
    pub maximum: f64,
    /// Whether the least value itself is refused.
    pub above: bool,
}

impl Bound {
    /// Refuses a value that is not finite or outside the bound.
    ///
    /// # Errors
    /// [`Error::NotFinite`], [`Error::OutsideBounds`].
    pub fn check(&self, value: f64) -> Result<(), Error> {
        finite(self.quantity, value)?;
        if value < self.minimum || value > self.maximum || (self.above && value == self.minimum) {
            let Self { quantity, minimum, maximum, above, .. } = *self;
            return Err(Error::OutsideBounds {
                quantity,
                value,
                open: if above { "above " } else { "" },
                minimum,
                maximum,
            });
        }
        Ok(())
    }
}

/// Faster than anything under water, and slow enough for sums over a mission to keep their digits, m/s.
const SPEED: f64 = 1e3;
/// Further than around the Earth, m.
const DISTANCE: f64 = 1e8;
/// A little deeper than the deepest sea, m.
const DEEPEST: f64 = 12_000.0;
/// Any number of turns that a gyro may have summed up, rad.
const ANGLE: f64 = 1e6;
/// Standard deviation that says nothing, in any unit.
const SIGMA: f64 = 1e6;
/// Displacement between two odometry events, m.
const STEP: f64 = 1e6;
/// No fix is better than a tenth of a millimetre, m²: a covariance of zero is one that was not given.
const FIX_FLOOR_M2: f64 = 1e-8;
/// Largest signal path, m.
const RANGE: f64 = 1e6;

macro_rules! bounds {
    ($($name:ident: $kind:ident $text:literal $field:literal, $minimum:expr, $maximum:expr, $above:expr;)+) => {
        $(pub(super) const $name: Bound = Bound {
            kind: Kind::$kind,
            field: $field,
            quantity: concat!($text, " ", $field),
            minimum: $minimum,
            maximum: $maximum,
            above: $above,
        };)+

        /// The bound of every number of every kind of event. Optional measurements may be missing; covariances must be
        /// positive semi-definite beside keeping these.
        pub const BOUNDS: &[Bound] = &[$($name),+];
    };
}

bounds! {
    MOTION_E: Motion "motion" "velocity_e_mps", -SPEED, SPEED, false;
    MOTION_N: Motion "motion" "velocity_n_mps", -SPEED, SPEED, false;
    ODOMETRY_FORWARD: Odometry "odometry" "forward_m", -STEP, STEP, false;
    ODOMETRY_LEFT: Odometry "odometry" "left_m", -STEP, STEP, false;
    ODOMETRY_YAW: Odometry "odometry" "yaw_change_rad", -ANGLE, ANGLE, false;
    ODOMETRY_FF: Odometry "odometry" "cov_ff", 0.0, STEP * STEP, false;
    ODOMETRY_FL: Odometry "odometry" "cov_fl", -STEP * STEP, STEP * STEP, false;
    ODOMETRY_FY: Odometry "odometry" "cov_fy", -STEP * SIGMA, STEP * SIGMA, false;
    ODOMETRY_LL: Odometry "odometry" "cov_ll", 0.0, STEP * STEP, false;
    ODOMETRY_LY: Odometry "odometry" "cov_ly", -STEP * SIGMA, STEP * SIGMA, false;
    ODOMETRY_YY: Odometry "odometry" "cov_yy", 0.0, SIGMA * SIGMA, false;
    WATER_DEPTH: WaterDepth "water_depth" "water_depth_m", 0.0, DEEPEST, true;
    WATER_DEPTH_SIGMA: WaterDepth "water_depth" "sigma_m", 0.0, SIGMA, false;
    // A depth sensor at the surface reads a little above it.
    DEPTH: Depth "depth" "depth_m", -100.0, DEEPEST, false;
    DEPTH_SIGMA: Depth "depth" "sigma_m", 0.0, SIGMA, false;
    HEADING: Heading "heading" "yaw_rad", -ANGLE, ANGLE, false;
    HEADING_SIGMA: Heading "heading" "sigma_rad", 0.0, SIGMA, false;
    TURN_RATE: TurnRate "turn_rate" "yaw_rate_radps", -SPEED, SPEED, false;
    TURN_RATE_SIGMA: TurnRate "turn_rate" "sigma_radps", 0.0, SIGMA, false;
    GROUND_FORWARD: GroundVelocity "ground_velocity" "forward_mps", -SPEED, SPEED, false;
    GROUND_LEFT: GroundVelocity "ground_velocity" "left_mps", -SPEED, SPEED, false;
    GROUND_SIGMA: GroundVelocity "ground_velocity" "sigma_mps", 0.0, SIGMA, false;
    FIX_E: Fix "fix" "e_m", -DISTANCE, DISTANCE, false;
    FIX_N: Fix "fix" "n_m", -DISTANCE, DISTANCE, false;
    FIX_EE: Fix "fix" "cov_ee_m2", FIX_FLOOR_M2, DISTANCE * DISTANCE, false;
    FIX_EN: Fix "fix" "cov_en_m2", -DISTANCE * DISTANCE, DISTANCE * DISTANCE, false;
    FIX_NN: Fix "fix" "cov_nn_m2", FIX_FLOOR_M2, DISTANCE * DISTANCE, false;
    ACOUSTIC_RANGE: AcousticFix "acoustic_fix" "range_m", 0.0, RANGE, true;
    ACOUSTIC_OWN: AcousticFix "acoustic_fix" "own_bearing_rad", -ANGLE, ANGLE, false;
    ACOUSTIC_PEER: AcousticFix "acoustic_fix" "peer_bearing_rad", -ANGLE, ANGLE, false;
    ACOUSTIC_PEER_DEPTH: AcousticFix "acoustic_fix" "peer_depth_m", -100.0, DEEPEST, false;
    WATER_FORWARD: WaterVelocity "water_velocity" "forward_mps", -SPEED, SPEED, false;
    WATER_LEFT: WaterVelocity "water_velocity" "left_mps", -SPEED, SPEED, false;
    WATER_SIGMA: WaterVelocity "water_velocity" "sigma_mps", 0.0, SIGMA, false;
    BEACON_E: BeaconRange "beacon_range" "beacon_e_m", -DISTANCE, DISTANCE, false;
    BEACON_N: BeaconRange "beacon_range" "beacon_n_m", -DISTANCE, DISTANCE, false;
    BEACON_DEPTH: BeaconRange "beacon_range" "beacon_depth_m", -100.0, DEEPEST, false;
    BEACON_RANGE: BeaconRange "beacon_range" "range_m", 0.0, RANGE, true;
    BEACON_SIGMA: BeaconRange "beacon_range" "sigma_m", 0.0, SIGMA, false;
    USBL_E: Usbl "usbl" "e_m", -DISTANCE, DISTANCE, false;
    USBL_N: Usbl "usbl" "n_m", -DISTANCE, DISTANCE, false;
    USBL_EE: Usbl "usbl" "cov_ee_m2", FIX_FLOOR_M2, DISTANCE * DISTANCE, false;
    USBL_EN: Usbl "usbl" "cov_en_m2", -DISTANCE * DISTANCE, DISTANCE * DISTANCE, false;
    USBL_NN: Usbl "usbl" "cov_nn_m2", FIX_FLOOR_M2, DISTANCE * DISTANCE, false;
}

/// Latest and, negative, earliest time of anything, ns: 73 years about the mission's epoch. Differences of times that
/// keep it cannot overflow.
pub const TIME_NS: i64 = 1 << 61;

/// Longest travel of a signal, ns: 1,500 km of water.
pub const TRAVEL_NS: i64 = 1_000_000_000_000;

/// Refuses a time that the clock of no mission shows.
///
/// # Errors
/// [`Error::OutsideBounds`].
pub fn check_time(quantity: &'static str, t_ns: i64) -> Result<(), Error> {
    if (-TIME_NS..=TIME_NS).contains(&t_ns) {
        return Ok(());
    }
    let limit = TIME_NS as f64;
    Err(Error::OutsideBounds { quantity, value: t_ns as f64, open: "", minimum: -limit, maximum: limit })
}

/// Refuses a duration from `from_ns` to `to_ns` that is negative or longer than `most_ns`; both times are in bounds.
///
/// # Errors
/// [`Error::OutsideBounds`].
pub fn check_span(quantity: &'static str, from_ns: i64, to_ns: i64, most_ns: i64) -> Result<(), Error> {
    let span_ns = to_ns.saturating_sub(from_ns);
    if (0..=most_ns).contains(&span_ns) {
        return Ok(());
    }
    let (value, maximum) = (super::seconds(span_ns), super::seconds(most_ns));
    Err(Error::OutsideBounds { quantity, value, open: "", minimum: 0.0, maximum })
}

/// Refuses a launch and an arrival that belong to no signal.
///
/// # Errors
/// [`Error::OutsideBounds`].
pub fn check_travel(tol_ns: i64, toa_ns: i64) -> Result<(), Error> {
    check_time("launch tol_ns", tol_ns)?;
    check_time("arrival toa_ns", toa_ns)?;
    check_span("travel time (toa − tol), s", tol_ns, toa_ns, TRAVEL_NS)
}

/// Refuses the upper triangle of a covariance with an eigenvalue below zero; each number keeps its bound already.
///
/// # Errors
/// [`Error::NotPositiveDefinite`].
pub fn check_triangle<const N: usize>(
    quantity: &'static str,
    covariance: &nalgebra::SMatrix<f64, N, N>,
) -> Result<(), Error> {
    // As correlations, so that one rounding holds for all units.
    let deviation = covariance.diagonal().map(f64::sqrt);
    let mut correlation = *covariance;
    for row in 0..N {
        for column in 0..N {
            let scale = deviation[row] * deviation[column];
            if scale > 0.0 {
                correlation[(row, column)] /= scale;
            } else if covariance[(row, column)] != 0.0 {
                return Err(Error::NotPositiveDefinite { quantity });
            }
        }
    }
    // Cholesky in place, with the rounding that a singular covariance may have below zero.
    for k in 0..N {
        let pivot = correlation[(k, k)];
        if pivot < -CORRELATION_SLACK {
            return Err(Error::NotPositiveDefinite { quantity });
        }
        for row in k + 1..N {
            let entry = correlation[(row, k)];
            if pivot <= CORRELATION_SLACK {
                if entry.abs() > CORRELATION_SLACK.sqrt() {
                    return Err(Error::NotPositiveDefinite { quantity });
                }
                continue;
            }
            for column in k + 1..N {
                let taken = entry * correlation[(column, k)] / pivot;
                correlation[(row, column)] -= taken;
            }
        }
    }
    Ok(())
}

/// Rounding may leave a singular covariance this much below zero, relative to its diagonal.
pub const CORRELATION_SLACK: f64 = 1e-9;
