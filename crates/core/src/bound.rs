//! How well a team could possibly know where it is: the posterior Cramér–Rao bound along known tracks.
//!
//! One Gaussian over the states of all vehicles, [e, n, b, c_e, c_n(, heading bias, thrust bias)] each, with all
//! cross-covariances, as if every sensor of the team were wired to one computer. Where vehicles share their water, b and c
//! are each a common part, [B, C_e, C_n] behind the last vehicle, and a vehicle's own. The process is linear and the noises are
//! Gaussian, so with Jacobians taken at the truth the recursion of Tichavský, Muravchik & Nehorai (1998) is the Riccati
//! equation of a Kalman filter; it is kept here in covariance form, one scalar measurement after another.
//!
//! ```text
//! step      P ← F P Fᵀ + Q                       F: position += Δt · (current, and what biases do at this velocity)
//! sounding  H = [∂h/∂e, ∂h/∂n, 1]                R = n_c (σ² + σ_map²), n_c as `mpf` tempers it
//! range     H = ±(unit vector), receiver − sender R = σ_R²
//! update    P ← P − P Hᵀ H P / (H P Hᵀ + R)
//! ```
//!
//! *Statistically linearised*, the gradient is not the one at the true point but what five points over the recursion's
//! own spread of positions show, and what they show beside a plane counts as noise; ranges get their curvature. A filter
//! that cannot know where on its spread it is cannot use more, so this is the nearer yardstick on flat, wavy bottoms.

mod recursion;

use recursion::Recursion;

use crate::chart::Chart;
use crate::error::{Error, finite, non_negative, positive};
use crate::event::{VehicleId, check_fix_covariance};
use crate::navigator::drift::Drift;
use crate::navigator::settings::{MpfSettings, TeamSettings};

/// What the team knows of its world: the model of `mpf`, whose options these are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BoundModel {
    /// Process noise and priors.
    pub drift: Drift,
    /// Whether compass and thrust biases are states (7 in place of 5 per vehicle).
    pub bias_states: bool,
    /// Standard deviation of a sounding, m; `None` takes what the sensor states.
    pub sigma_depth_m: Option<f64>,
    /// Prior of the datum offset, m.
    pub sigma_offset0_m: f64,
    /// Its walk per sounding, m.
    pub sigma_offset_m_per_sounding: f64,
    /// Distance over which the chart's error stays itself, m; `None` asks the chart.
    pub correlation_length_m: Option<f64>,
    /// Standard deviation of the chart's error, m; `None` asks the chart.
    pub sigma_map_m: Option<f64>,
    /// Least distance between soundings that are used, m.
    pub sounding_spacing_m: f64,
    /// Standard deviation of a range, m.
    pub sigma_range_m: f64,
    /// Two vehicles' currents differ by this share of the drift's prior and walk; 1: they have nothing in common.
    pub current_difference: f64,
    /// Standard deviation of the difference of two vehicles' datum offsets, m; infinite: they have nothing in common.
    pub offset_difference_m: f64,
    /// Whether soundings tell anything.
    pub terrain: bool,
    /// Whether ranges tell anything.
    pub ranges: bool,
    /// Statistically linearised over the recursion's own spread, in place of gradients at the truth.
    pub linearised: bool,
}

/// Something that told the team something.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Observation {
    /// A position fix; the first one of a vehicle is its start.
    Fix {
        /// Who.
        vehicle: VehicleId,
        /// [ee, en, nn], m².
        covariance_m2: [f64; 3],
    },
    /// A sounding.
    Sounding {
        /// Who.
        vehicle: VehicleId,
        /// Standard deviation that the sensor states, m.
        sigma_m: f64,
    },
    /// A commanded velocity, in force until the next: what biases act on.
    Motion {
        /// Who.
        vehicle: VehicleId,
        /// [east, north], m/s.
        velocity_mps: [f64; 2],
    },
    /// A range, at its arrival.
    Range {
        /// Who launched, and when (ns).
        sender: VehicleId,
        /// Launch, ns.
        tol_ns: i64,
        /// Who measured.
        receiver: VehicleId,
    },
}

impl Observation {
    /// Order at one instant: what starts a vehicle first, and velocities from then on only.
    fn rank(&self) -> u8 {
        match self {
            Self::Fix { .. } => 0,
            Self::Sounding { .. } => 1,
            Self::Motion { .. } => 2,
            Self::Range { .. } => 3,
        }
    }
}

/// Where every vehicle truly was.
#[derive(Debug, Clone, PartialEq)]
pub struct TrueTracks {
    t_ns: Vec<i64>,
    /// By vehicle.
    position_m: Vec<Vec<[f64; 2]>>,
    /// By vehicle, path length since the start.
    travelled_m: Vec<Vec<f64>>,
}

impl TrueTracks {
    /// Tracks of straight lines between ascending instants; `position_m` by vehicle.
    ///
    /// # Errors
    /// [`Error::Length`], [`Error::NotFinite`], and [`Error::OutOfBound`] for instants that do not ascend.
    pub fn new(t_ns: Vec<i64>, position_m: Vec<Vec<[f64; 2]>>) -> Result<Self, Error> {
        if t_ns.is_empty() || t_ns.windows(2).any(|w| w[0] >= w[1]) {
            return Err(Error::OutOfBound {
                quantity: "instants of the truth",
                value: t_ns.len() as f64,
                bound: "one or more, ascending",
            });
        }
        for track in &position_m {
            if track.len() != t_ns.len() {
                return Err(Error::Length {
                    quantity: "true track",
                    found: track.len(),
                    expected: t_ns.len(),
                });
            }
            for [east, north] in track {
                finite("true easting, m", *east)?;
                finite("true northing, m", *north)?;
            }
        }
        let travelled_m = position_m
            .iter()
            .map(|track| {
                let mut sum = 0.0;
                let steps = track.windows(2).map(|w| (w[1][0] - w[0][0]).hypot(w[1][1] - w[0][1]));
                std::iter::once(0.0)
                    .chain(steps)
                    .map(|step| {
                        sum += step;
                        sum
                    })
                    .collect()
            })
            .collect();
        Ok(Self { t_ns, position_m, travelled_m })
    }

    /// Number of vehicles.
    #[must_use]
    pub fn vehicles(&self) -> usize {
        self.position_m.len()
    }

    /// Segment and share of it at an instant; the ends hold outside.
    fn at(&self, t_ns: i64) -> (usize, usize, f64) {
        let after = self.t_ns.partition_point(|t| *t <= t_ns);
        match (after.checked_sub(1), self.t_ns.get(after)) {
            (Some(k), Some(next)) => {
                let span = next.saturating_sub(self.t_ns[k]) as f64;
                (k, after, t_ns.saturating_sub(self.t_ns[k]) as f64 / span)
            }
            (Some(k), None) => (k, k, 0.0),
            (None, _) => (0, 0, 0.0),
        }
    }

    fn position(&self, vehicle: usize, t_ns: i64) -> [f64; 2] {
        let (a, b, share) = self.at(t_ns);
        let (from, to) = (self.position_m[vehicle][a], self.position_m[vehicle][b]);
        [0, 1].map(|axis| from[axis] + share * (to[axis] - from[axis]))
    }

    fn travelled(&self, vehicle: usize, t_ns: i64) -> f64 {
        let (a, b, share) = self.at(t_ns);
        let track = &self.travelled_m[vehicle];
        track[a] + share * (track[b] - track[a])
    }
}

impl BoundModel {
    /// What `mpf` is told of its world, and `team` of the water that vehicles share; all counted, at the true gradients.
    #[must_use]
    pub fn of(mpf: &MpfSettings, team: &TeamSettings, chart: Option<&Chart>) -> Self {
        let terrain = mpf.terrain.options(chart, mpf.drift.options());
        Self {
            drift: terrain.drift,
            bias_states: mpf.terrain.bias_states,
            sigma_depth_m: terrain.sigma_depth_m,
            sigma_offset0_m: terrain.sigma_offset0_m,
            sigma_offset_m_per_sounding: terrain.sigma_offset_m_per_sounding,
            correlation_length_m: terrain.correlation_length_m,
            sigma_map_m: terrain.sigma_map_m,
            sounding_spacing_m: terrain.sounding_spacing_m,
            sigma_range_m: mpf.range.sigma_range_m,
            current_difference: team.current_difference,
            offset_difference_m: team.offset_difference_m.unwrap_or(f64::INFINITY),
            terrain: true,
            ranges: true,
            linearised: false,
        }
    }

    fn validate(&self) -> Result<(), Error> {
        self.drift.validate()?;
        positive("sigma_offset0_m", self.sigma_offset0_m)?;
        non_negative("sigma_offset_m_per_sounding", self.sigma_offset_m_per_sounding)?;
        non_negative("sounding_spacing_m", self.sounding_spacing_m)?;
        positive("sigma_range_m", self.sigma_range_m)?;
        if self.current_difference > 1.0 {
            let value = self.current_difference;
            return Err(Error::OutOfBound { quantity: "current_difference", value, bound: "0 to 1" });
        }
        non_negative("current_difference", self.current_difference)?;
        if self.offset_difference_m != f64::INFINITY {
            non_negative("offset_difference_m", self.offset_difference_m)?;
        }
        if let Some(sigma) = self.sigma_depth_m {
            positive("sigma_depth_m", sigma)?;
        }
        for given in [self.correlation_length_m, self.sigma_map_m].into_iter().flatten() {
            non_negative("correlation_length_m or sigma_map_m", given)?;
        }
        Ok(())
    }
}

/// The bound of every vehicle's position at `sample_ns` (ascending), [ee, en, nn] in m², by vehicle and instant; NaN
/// before a vehicle's first fix. `observations` with their times, in any order; those at an instant count for its
/// sample.
///
/// # Errors
/// A model or observation out of bounds, or an unknown vehicle.
pub fn bound(
    model: &BoundModel,
    chart: Option<&Chart>,
    truth: &TrueTracks,
    mut observations: Vec<(i64, Observation)>,
    sample_ns: &[i64],
) -> Result<Vec<Vec<[f64; 3]>>, Error> {
    model.validate()?;
    check(truth.vehicles(), &observations)?;
    observations.sort_by_key(|(t_ns, observation)| (*t_ns, observation.rank()));
    if model.bias_states {
        run::<4>(model, chart, truth, &observations, sample_ns)
    } else {
        run::<2>(model, chart, truth, &observations, sample_ns)
    }
}

fn check(vehicles: usize, observations: &[(i64, Observation)]) -> Result<(), Error> {
    let known = |vehicle: VehicleId| {
        if usize::from(vehicle) < vehicles {
            Ok(())
        } else {
            Err(Error::UnknownVehicle { vehicle, count: vehicles })
        }
    };
    for (_, observation) in observations {
        match *observation {
            Observation::Fix { vehicle, covariance_m2 } => {
                known(vehicle)?;
                check_fix_covariance(covariance_m2)?;
            }
            Observation::Sounding { vehicle, sigma_m } => {
                known(vehicle)?;
                non_negative("water depth sigma, m", sigma_m)?;
            }
            Observation::Motion { vehicle, velocity_mps: [east, north] } => {
                known(vehicle)?;
                finite("motion east velocity, m/s", east)?;
                finite("motion north velocity, m/s", north)?;
            }
            Observation::Range { sender, receiver, .. } => {
                known(sender)?;
                known(receiver)?;
            }
        }
    }
    Ok(())
}

fn run<const K: usize>(
    model: &BoundModel,
    chart: Option<&Chart>,
    truth: &TrueTracks,
    observations: &[(i64, Observation)],
    sample_ns: &[i64],
) -> Result<Vec<Vec<[f64; 3]>>, Error> {
    let mut recursion = Recursion::<K>::new(model, chart, truth);
    let mut out = vec![Vec::with_capacity(sample_ns.len()); truth.vehicles()];
    let mut next = observations.iter().peekable();
    for &sample in sample_ns {
        while let Some((t_ns, observation)) = next.next_if(|(t_ns, _)| *t_ns <= sample) {
            recursion.advance(*t_ns);
            recursion.update(*t_ns, observation);
        }
        recursion.advance(sample);
        for (vehicle, column) in out.iter_mut().enumerate() {
            column.push(recursion.position_covariance(vehicle));
        }
    }
    Ok(out)
}
