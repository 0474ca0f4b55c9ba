//! Events from C.

use std::sync::Arc;

use uwcoop_core::event::{Event, Payload};

use crate::arguments::{slice_of, Failure};
use crate::{outcome_of, uwcoop_code, uwcoop_navigator, uwcoop_outcome, with};

/// What a sensor says, and its values in their order. World frame: local east–north, m; body frame: forward–left; angles
/// rad, yaw counter-clockwise from east; sigmas are standard deviations.
#[repr(i32)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum uwcoop_kind {
    /// Commanded velocity through the water: east, north, m/s.
    UWCOOP_MOTION = 0,
    /// Since the last one: forward m, left m, yaw rad; covariance ff, fl, fy, ll, ly, yy.
    UWCOOP_ODOMETRY = 1,
    /// Surface to seabed: m, sigma m.
    UWCOOP_WATER_DEPTH = 2,
    /// Own depth: m, sigma m.
    UWCOOP_DEPTH = 3,
    /// Yaw: rad, sigma rad.
    UWCOOP_HEADING = 4,
    /// Yaw rate: rad/s, sigma rad/s.
    UWCOOP_TURN_RATE = 5,
    /// Over ground: forward, left, sigma, m/s.
    UWCOOP_GROUND_VELOCITY = 6,
    /// Position: east m, north m; covariance ee, en, nn, m².
    UWCOOP_FIX = 7,
    /// The vehicle stands on the seabed: no values.
    UWCOOP_LANDED = 8,
    /// It no longer does: no values.
    UWCOOP_LIFTED_OFF = 9,
    /// It took a role: 1, the landmark's; 0, the mover's.
    UWCOOP_ROLE_TAKEN = 10,
    /// Through the water: forward, left, sigma, m/s.
    UWCOOP_WATER_VELOCITY = 11,
}

impl uwcoop_kind {
    /// The kind of this number, which C may choose freely.
    fn of(number: i32) -> Result<Self, Failure> {
        const ALL: [uwcoop_kind; 12] = [
            uwcoop_kind::UWCOOP_MOTION,
            uwcoop_kind::UWCOOP_ODOMETRY,
            uwcoop_kind::UWCOOP_WATER_DEPTH,
            uwcoop_kind::UWCOOP_DEPTH,
            uwcoop_kind::UWCOOP_HEADING,
            uwcoop_kind::UWCOOP_TURN_RATE,
            uwcoop_kind::UWCOOP_GROUND_VELOCITY,
            uwcoop_kind::UWCOOP_FIX,
            uwcoop_kind::UWCOOP_LANDED,
            uwcoop_kind::UWCOOP_LIFTED_OFF,
            uwcoop_kind::UWCOOP_ROLE_TAKEN,
            uwcoop_kind::UWCOOP_WATER_VELOCITY,
        ];
        let found = ALL.into_iter().find(|kind| *kind as i32 == number);
        found.ok_or_else(|| Failure::Argument(format!("kind is {number}: must be 0 to 11")))
    }
}

/// The payload of a kind with its values.
fn payload(kind: uwcoop_kind, values: &[f64]) -> Result<Payload, Failure> {
    use uwcoop_kind::*;
    let found = match (kind, values) {
        (UWCOOP_MOTION, &[e, n]) => Payload::Motion { velocity_mps: [e, n] },
        (UWCOOP_ODOMETRY, &[f, l, y, ff, fl, fy, ll, ly, yy]) => Payload::Odometry {
            displacement_m: [f, l],
            yaw_change_rad: y,
            covariance: [ff, fl, fy, ll, ly, yy],
        },
        (UWCOOP_WATER_DEPTH, &[water_depth_m, sigma_m]) => Payload::WaterDepth { water_depth_m, sigma_m },
        (UWCOOP_DEPTH, &[depth_m, sigma_m]) => Payload::Depth { depth_m, sigma_m },
        (UWCOOP_HEADING, &[yaw_rad, sigma_rad]) => Payload::Heading { yaw_rad, sigma_rad },
        (UWCOOP_TURN_RATE, &[yaw_rate_radps, sigma_radps]) => {
            Payload::TurnRate { yaw_rate_radps, sigma_radps }
        }
        (UWCOOP_GROUND_VELOCITY, &[f, l, sigma_mps]) => {
            Payload::GroundVelocity { velocity_mps: [f, l], sigma_mps }
        }
        (UWCOOP_FIX, &[e, n, ee, en, nn]) => Payload::Fix { position_m: [e, n], covariance_m2: [ee, en, nn] },
        (UWCOOP_WATER_VELOCITY, &[f, l, sigma_mps]) => {
            Payload::WaterVelocity { velocity_mps: [f, l], sigma_mps }
        }
        (UWCOOP_LANDED, &[]) => Payload::Landed,
        (UWCOOP_LIFTED_OFF, &[]) => Payload::LiftedOff,
        (UWCOOP_ROLE_TAKEN, &[role]) if role == 0.0 || role == 1.0 => {
            Payload::RoleTaken { landmark: role == 1.0 }
        }
        (UWCOOP_ROLE_TAKEN, &[role]) => {
            return Err(Failure::Argument(format!("role is {role}: must be 0 (mover) or 1 (landmark)")));
        }
        _ => return Err(Failure::Argument(format!("{kind:?} does not have {} values", values.len()))),
    };
    Ok(found)
}

/// Hands an event over, and writes what became of it.
///
/// # Safety
/// `navigator` and `outcome` as the caller's word has them; `outcome` may be null.
unsafe fn hand_over(
    navigator: *mut uwcoop_navigator,
    t_ns: i64,
    payload: impl FnOnce() -> Result<Payload, Failure>,
    outcome: *mut uwcoop_outcome,
) -> uwcoop_code {
    // SAFETY: the caller's word.
    unsafe {
        with(navigator, |inner, vehicle| {
            let found = outcome_of(inner.handle(&Event { t_ns, vehicle, payload: payload()? })?);
            if !outcome.is_null() {
                outcome.write(found);
            }
            Ok(())
        })
    }
}

/// Hand over what a sensor said at `t_ns`, a `kind` of `uwcoop_kind`, with its `count` values. Events come in the order of time.
///
/// `outcome` may be null.
#[no_mangle]
pub unsafe extern "C" fn uwcoop_handle(
    navigator: *mut uwcoop_navigator,
    t_ns: i64,
    kind: i32,
    values: *const f64,
    count: usize,
    outcome: *mut uwcoop_outcome,
) -> uwcoop_code {
    // SAFETY: the caller's word; `values` is valid for `count` values.
    unsafe {
        let told = || payload(uwcoop_kind::of(kind)?, slice_of("values", values, count)?);
        hand_over(navigator, t_ns, told, outcome)
    }
}

/// Hand over a mutual positioning with `peer` that ended at `t_ns` and began at `transmit_ns`: slant range, direction to the
/// peer in the own body frame, direction to this vehicle in the peer's, the peer's depth. NaN is what was not measured.
///
/// `outcome` may be null.
#[no_mangle]
pub unsafe extern "C" fn uwcoop_acoustic_fix(
    navigator: *mut uwcoop_navigator,
    t_ns: i64,
    peer: u16,
    transmit_ns: i64,
    range_m: f64,
    own_bearing_rad: f64,
    peer_bearing_rad: f64,
    peer_depth_m: f64,
    outcome: *mut uwcoop_outcome,
) -> uwcoop_code {
    let measured = |value: f64| (!value.is_nan()).then_some(value);
    let payload = Payload::AcousticFix {
        peer,
        transmit_ns,
        range_m: measured(range_m),
        own_bearing_rad: measured(own_bearing_rad),
        peer_bearing_rad: measured(peer_bearing_rad),
        peer_depth_m: measured(peer_depth_m),
    };
    // SAFETY: the caller's word.
    unsafe { hand_over(navigator, t_ns, || Ok(payload), outcome) }
}

/// Hand over, at `t_ns`, a range to a beacon at a known place: the signal arrived at `measured_ns`; slant range and its sigma,
/// m; `one_way` is 1 for a travel time one way, in which the difference of the clocks stands, 0 for one there and back.
///
/// `outcome` may be null.
#[no_mangle]
pub unsafe extern "C" fn uwcoop_beacon_range(
    navigator: *mut uwcoop_navigator,
    t_ns: i64,
    measured_ns: i64,
    beacon_e_m: f64,
    beacon_n_m: f64,
    beacon_depth_m: f64,
    range_m: f64,
    sigma_m: f64,
    one_way: i32,
    outcome: *mut uwcoop_outcome,
) -> uwcoop_code {
    let told = || {
        if !(0..=1).contains(&one_way) {
            return Err(Failure::Argument(format!("one_way is {one_way}: must be 0 or 1")));
        }
        let (beacon_m, one_way) = ([beacon_e_m, beacon_n_m], one_way == 1);
        Ok(Payload::BeaconRange { measured_ns, beacon_m, beacon_depth_m, range_m, sigma_m, one_way })
    };
    // SAFETY: the caller's word.
    unsafe { hand_over(navigator, t_ns, told, outcome) }
}

/// Hand over, at `t_ns`, a position by an ultra-short baseline that was measured at `measured_ns`: east, north, m; covariance,
/// m².
///
/// `outcome` may be null.
#[no_mangle]
pub unsafe extern "C" fn uwcoop_usbl(
    navigator: *mut uwcoop_navigator,
    t_ns: i64,
    measured_ns: i64,
    east_m: f64,
    north_m: f64,
    cov_ee_m2: f64,
    cov_en_m2: f64,
    cov_nn_m2: f64,
    outcome: *mut uwcoop_outcome,
) -> uwcoop_code {
    let covariance_m2 = [cov_ee_m2, cov_en_m2, cov_nn_m2];
    let payload = Payload::Usbl { measured_ns, position_m: [east_m, north_m], covariance_m2 };
    // SAFETY: the caller's word.
    unsafe { hand_over(navigator, t_ns, || Ok(payload), outcome) }
}

/// Hand over a packet: `t_ns` when decoding ended, `tol_ns` launch, `toa_ns` arrival of the signal's start.
///
/// `outcome` may be null.
#[no_mangle]
pub unsafe extern "C" fn uwcoop_receive(
    navigator: *mut uwcoop_navigator,
    t_ns: i64,
    sender: u16,
    tol_ns: i64,
    toa_ns: i64,
    packet: *const u8,
    packet_bytes: usize,
    outcome: *mut uwcoop_outcome,
) -> uwcoop_code {
    // SAFETY: the caller's word; `packet` is valid for `packet_bytes`.
    unsafe {
        let told = || {
            let bytes: Arc<[u8]> = slice_of("packet", packet, packet_bytes)?.into();
            Ok(Payload::Reception { sender, tol_ns, toa_ns, bytes })
        };
        hand_over(navigator, t_ns, told, outcome)
    }
}
