//! The recursion of the bound: one joint covariance, one scalar measurement after another.

use nalgebra::DMatrix;

use super::{BoundModel, Observation, TrueTracks};
use crate::chart::Chart;
use crate::event::seconds;
use crate::kernels::particles::displacement_map;
use crate::measurement::{fix, range, sounding};

/// Position and datum offset come before the linear states.
const BEFORE_LINEAR: usize = 3;
/// The offset's place.
const OFFSET: usize = 2;

/// The joint covariance of the team, and what the next measurement's Jacobian depends on.
pub(super) struct Recursion<'a, const K: usize> {
    model: &'a BoundModel,
    chart: Option<&'a Chart>,
    truth: &'a TrueTracks,
    covariance: DMatrix<f64>,
    now_ns: Option<i64>,
    velocity_mps: Vec<[f64; 2]>,
    started: Vec<bool>,
    sounded_at_m: Vec<Option<f64>>,
    common: Common,
}

/// What the vehicles' datum offsets and currents have in common, as states [B, C_e, C_n] of their own: variance of the
/// whole is shared out so that two vehicles differ by what the model says.
struct Common {
    /// Share of a current's variance that is common, and that is a vehicle's own.
    current: [f64; 2],
    /// Variance of the datum offset that is common, and that is a vehicle's own, m².
    offset_m2: [f64; 2],
    started: bool,
}

impl Common {
    fn new(model: &BoundModel) -> Self {
        let half = model.current_difference * model.current_difference / 2.0;
        let prior_m2 = model.sigma_offset0_m * model.sigma_offset0_m;
        let own_m2 = (model.offset_difference_m * model.offset_difference_m / 2.0).min(prior_m2);
        Self {
            current: if model.current_difference < 1.0 { [1.0 - half, half] } else { [0.0, 1.0] },
            offset_m2: [prior_m2 - own_m2, own_m2],
            started: false,
        }
    }
}

/// Common states: the datum offset, then the current.
const COMMON: usize = 3;

/// One scalar measurement: (state, ∂measurement/∂state) where that is not zero.
type Jacobian = Vec<(usize, f64)>;

impl<'a, const K: usize> Recursion<'a, K> {
    /// States per vehicle.
    const STATES: usize = BEFORE_LINEAR + K;

    pub(super) fn new(model: &'a BoundModel, chart: Option<&'a Chart>, truth: &'a TrueTracks) -> Self {
        let vehicles = truth.vehicles();
        let size = vehicles * Self::STATES + COMMON;
        Self {
            model,
            chart,
            truth,
            covariance: DMatrix::zeros(size, size),
            now_ns: None,
            velocity_mps: vec![[0.0; 2]; vehicles],
            started: vec![false; vehicles],
            sounded_at_m: vec![None; vehicles],
            common: Common::new(model),
        }
    }

    /// Place of the common datum offset; the common current follows.
    fn common_place(&self) -> usize {
        self.started.len() * Self::STATES
    }

    /// P ← F P Fᵀ + Q up to `t_ns`.
    pub(super) fn advance(&mut self, t_ns: i64) {
        let dt_s = self.now_ns.map_or(0.0, |now| seconds(t_ns.saturating_sub(now)));
        self.now_ns = Some(t_ns);
        if dt_s <= 0.0 {
            return;
        }
        let walk = self.model.drift.walk::<K>(dt_s);
        let position_walk = self.model.drift.position_walk(dt_s);
        for vehicle in 0..self.started.len() {
            if !self.started[vehicle] {
                continue;
            }
            let (first, linear) = (vehicle * Self::STATES, vehicle * Self::STATES + BEFORE_LINEAR);
            let map = displacement_map::<K>(self.velocity_mps[vehicle], dt_s);
            for mut column in self.covariance.column_iter_mut() {
                for (axis, row) in map.iter().enumerate() {
                    let moved: f64 = row.iter().enumerate().map(|(k, f)| f * column[linear + k]).sum();
                    column[first + axis] += moved;
                }
            }
            for (axis, row) in map.iter().enumerate() {
                for (k, f) in row.iter().enumerate() {
                    let source = self.covariance.column(linear + k) * *f;
                    let mut target = self.covariance.column_mut(first + axis);
                    target += source;
                }
            }
            self.covariance[(first, first)] += position_walk[0];
            self.covariance[(first + 1, first + 1)] += position_walk[2];
            for k in 0..K {
                let walk = walk[(k, k)] * if k < 2 { self.common.current[1] } else { 1.0 };
                self.covariance[(linear + k, linear + k)] += walk;
                self.spread_walk(first, linear + k, [map[0][k], map[1][k]], walk);
            }
        }
        self.advance_common(dt_s, [walk[(0, 0)], walk[(1, 1)]]);
    }

    /// The current that all have takes all that have started along; its walk within the step as in `spread_walk`.
    fn advance_common(&mut self, dt_s: f64, walk: [f64; 2]) {
        if self.common.current[0] <= 0.0 {
            return;
        }
        let places: Vec<usize> =
            (0..self.started.len()).filter(|v| self.started[*v]).map(|v| v * Self::STATES).collect();
        for axis in 0..2 {
            let current = self.common_place() + 1 + axis;
            let row = self.covariance.row(current) * dt_s;
            for first in &places {
                let mut target = self.covariance.row_mut(first + axis);
                target += &row;
            }
            let column = self.covariance.column(current) * dt_s;
            for first in &places {
                let mut target = self.covariance.column_mut(first + axis);
                target += &column;
            }
            if !self.common.started {
                continue;
            }
            let walk = walk[axis] * self.common.current[0];
            self.covariance[(current, current)] += walk;
            for a in &places {
                self.covariance[(a + axis, current)] += dt_s * walk / 2.0;
                self.covariance[(current, a + axis)] += dt_s * walk / 2.0;
                for b in &places {
                    self.covariance[(a + axis, b + axis)] += dt_s * dt_s * walk / 3.0;
                }
            }
        }
    }

    /// What the walk of a linear state within the step does to the position: Q of continuous time, ∫ F(t) q F(t)ᵀ dt, so
    /// that a step may be cut anywhere. `moved` is what one unit of the state displaces in the step.
    fn spread_walk(&mut self, first: usize, state: usize, moved: [f64; 2], walk: f64) {
        for (a, moved_a) in moved.iter().enumerate() {
            self.covariance[(first + a, state)] += moved_a * walk / 2.0;
            self.covariance[(state, first + a)] += moved_a * walk / 2.0;
            for (b, moved_b) in moved.iter().enumerate() {
                self.covariance[(first + a, first + b)] += moved_a * moved_b * walk / 3.0;
            }
        }
    }

    pub(super) fn update(&mut self, t_ns: i64, observation: &Observation) {
        match *observation {
            Observation::Motion { vehicle, velocity_mps } => {
                self.velocity_mps[usize::from(vehicle)] = velocity_mps;
            }
            Observation::Fix { vehicle, covariance_m2 } => self.fix(usize::from(vehicle), covariance_m2),
            Observation::Sounding { vehicle, sigma_m } if self.model.terrain => {
                self.sounding(usize::from(vehicle), t_ns, sigma_m);
            }
            Observation::Range { sender, tol_ns, receiver } if self.model.ranges => {
                self.range(usize::from(sender), tol_ns, usize::from(receiver), t_ns);
            }
            Observation::Sounding { .. } | Observation::Range { .. } => {}
        }
    }

    fn fix(&mut self, vehicle: usize, [ee, en, nn]: [f64; 3]) {
        let first = vehicle * Self::STATES;
        if !self.started[vehicle] {
            // The prior is diagonal but for the fix; what is shared with teammates has states of its own.
            self.started[vehicle] = true;
            self.covariance[(first, first)] = ee;
            self.covariance[(first, first + 1)] = en;
            self.covariance[(first + 1, first)] = en;
            self.covariance[(first + 1, first + 1)] = nn;
            let prior = self.model.drift.prior::<K>();
            self.covariance[(first + OFFSET, first + OFFSET)] = self.common.offset_m2[1];
            for k in 0..K {
                let at = first + BEFORE_LINEAR + k;
                self.covariance[(at, at)] = prior[(k, k)] * if k < 2 { self.common.current[1] } else { 1.0 };
            }
            if !self.common.started {
                self.common.started = true;
                let at = self.common_place();
                self.covariance[(at, at)] = self.common.offset_m2[0];
                for k in 0..2 {
                    self.covariance[(at + 1 + k, at + 1 + k)] = prior[(k, k)] * self.common.current[0];
                }
            }
            return;
        }
        // Two measurements whose errors are independent: the easting, and the northing less what follows from it.
        let [ee, en, nn] = fix::floored([ee, en, nn]);
        let slope = en / ee;
        self.measure(&vec![(first, 1.0)], ee);
        let rest = (nn - slope * en).max(1e-9 * nn);
        self.measure(&vec![(first, -slope), (first + 1, 1.0)], rest);
    }

    fn sounding(&mut self, vehicle: usize, t_ns: i64, sensor_sigma_m: f64) {
        let (true, Some(chart)) = (self.started[vehicle], self.chart) else { return };
        let travelled_m = self.truth.travelled(vehicle, t_ns);
        let apart_m = self.sounded_at_m[vehicle].map(|at| travelled_m - at);
        if apart_m.is_some_and(|d| d < self.model.sounding_spacing_m) {
            return;
        }
        let [east, north] = self.truth.position(vehicle, t_ns);
        let slope = if self.model.linearised {
            spread_slope(chart, [east, north], self.position_covariance(vehicle))
        } else {
            chart.gradient_at(east, north).map(|gradient| (gradient, 0.0))
        };
        let Some((gradient, beside_plane_m2)) = slope else { return };
        self.sounded_at_m[vehicle] = Some(travelled_m);
        let correlation_m = self.model.correlation_length_m.unwrap_or(chart.correlation_length_m());
        let shared = sounding::sharing_error(correlation_m, apart_m);
        let sigma_m = self.model.sigma_depth_m.unwrap_or(sensor_sigma_m).max(sounding::LEAST_SIGMA_M);
        let sigma_map_m = self.model.sigma_map_m.unwrap_or_else(|| chart.sigma_map_at(east, north));
        let noise_m2 = shared * (sigma_m.powi(2) + sigma_map_m.powi(2)) + beside_plane_m2;
        let first = vehicle * Self::STATES;
        self.covariance[(first + OFFSET, first + OFFSET)] += self.model.sigma_offset_m_per_sounding.powi(2);
        let offsets = [(first + OFFSET, 1.0), (self.common_place(), 1.0)];
        self.measure(&vec![(first, gradient[0]), (first + 1, gradient[1]), offsets[0], offsets[1]], noise_m2);
    }

    /// A range between the sender at launch and the receiver at arrival. The sender's own way in between is known but for
    /// its drift, through which the measurement sees the linear states.
    fn range(&mut self, sender: usize, tol_ns: i64, receiver: usize, toa_ns: i64) {
        if !(self.started[sender] && self.started[receiver]) || sender == receiver {
            return;
        }
        let (from, to) = (self.truth.position(sender, tol_ns), self.truth.position(receiver, toa_ns));
        let between = [to[0] - from[0], to[1] - from[1]];
        if between == [0.0; 2] {
            return;
        }
        let (s, r) = (sender * Self::STATES, receiver * Self::STATES);
        let expected = range::expected(between, self.relative_covariance(s, r));
        let unit = expected.direction;
        let travel_s = seconds(toa_ns.saturating_sub(tol_ns)).max(0.0);
        let map = displacement_map::<K>(self.velocity_mps[sender], travel_s);
        let mut jacobian: Jacobian = vec![(r, unit[0]), (r + 1, unit[1]), (s, -unit[0]), (s + 1, -unit[1])];
        for (k, (east, north)) in map[0].iter().zip(&map[1]).enumerate() {
            let seen = unit[0] * east + unit[1] * north;
            jacobian.push((s + BEFORE_LINEAR + k, seen));
            if k < 2 {
                jacobian.push((self.common_place() + 1 + k, seen));
            }
        }
        let mut noise_m2 = self.model.sigma_range_m.powi(2);
        if self.model.linearised {
            noise_m2 += expected.curvature_m2();
        }
        self.measure(&jacobian, noise_m2);
    }

    /// Covariance [ee, en, nn] of two vehicles' relative position.
    fn relative_covariance(&self, s: usize, r: usize) -> [f64; 3] {
        let p = &self.covariance;
        [(0, 0), (0, 1), (1, 1)]
            .map(|(a, b)| p[(r + a, r + b)] + p[(s + a, s + b)] - p[(r + a, s + b)] - p[(s + a, r + b)])
    }

    /// P ← P − P Hᵀ H P / (H P Hᵀ + R).
    fn measure(&mut self, jacobian: &Jacobian, noise_m2: f64) {
        let size = self.covariance.nrows();
        let mut gain = vec![0.0; size];
        for &(state, h) in jacobian {
            for (g, p) in gain.iter_mut().zip(self.covariance.column(state).iter()) {
                *g += h * p;
            }
        }
        let variance: f64 = jacobian.iter().map(|&(state, h)| h * gain[state]).sum::<f64>() + noise_m2;
        if variance <= 0.0 {
            return;
        }
        for (column, g) in gain.iter().enumerate() {
            let scale = g / variance;
            for (p, g) in self.covariance.column_mut(column).iter_mut().zip(&gain) {
                *p -= scale * g;
            }
        }
    }

    /// [ee, en, nn] of one vehicle; NaN before it started.
    pub(super) fn position_covariance(&self, vehicle: usize) -> [f64; 3] {
        if !self.started[vehicle] {
            return [f64::NAN; 3];
        }
        let at = vehicle * Self::STATES;
        let p = &self.covariance;
        [p[(at, at)], p[(at, at + 1)], p[(at + 1, at + 1)]]
    }
}

/// The plane that five points over a spread of positions show, and the variance that they show beside it, m².
///
/// An outer point without a depth is taken to continue its opposite through the centre; none at the centre: no sounding.
fn spread_slope(chart: &Chart, [east, north]: [f64; 2], [ee, en, nn]: [f64; 3]) -> Option<([f64; 2], f64)> {
    let centre = chart.depth_at(east, north)?;
    let factor = sounding::position_factor([ee, en, nn]);
    let [l11, l21, l22] = factor.map(|l| sounding::OUTER * l);
    let pair = |de: f64, dn: f64| {
        let (ahead, behind) = (chart.depth_at(east + de, north + dn), chart.depth_at(east - de, north - dn));
        match (ahead, behind) {
            (Some(a), Some(b)) => (a, b),
            (Some(a), None) => (a, 2.0 * centre - a),
            (None, Some(b)) => (2.0 * centre - b, b),
            (None, None) => (centre, centre),
        }
    };
    let (h1, h2) = pair(l11, l21);
    let (h3, h4) = pair(0.0, l22);
    let plane = sounding::plane([centre, h1, h2, h3, h4], factor);
    Some((plane.gradient, plane.residual_m2.max(0.0)))
}
