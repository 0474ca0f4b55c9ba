//! The bound against a Kalman filter written out with full matrices, and what a bound must do.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests fail by panicking")]

mod world;

use nalgebra::{DMatrix, DVector};
use uwcoop_core::bound::{BoundModel, Observation, TrueTracks, bound};
use uwcoop_core::chart::Chart;
use world::*;

const VEHICLES: usize = 3;
const END_S: i64 = 200;
/// States per vehicle with biases.
const S: usize = 7;
const SLOPE: [f64; 2] = [0.0625, -0.03125];

fn model() -> BoundModel {
    BoundModel {
        drift: drift(),
        bias_states: true,
        sigma_depth_m: None,
        sigma_offset0_m: 1.0,
        sigma_offset_m_per_sounding: 0.002,
        correlation_length_m: None,
        sigma_map_m: None,
        sounding_spacing_m: 0.0,
        sigma_range_m: 1.0,
        current_difference: 1.0,
        offset_difference_m: f64::INFINITY,
        terrain: true,
        ranges: true,
        linearised: false,
    }
}

fn position(vehicle: usize, t_s: f64) -> [f64; 2] {
    let v = vehicle as f64;
    [100.0 + 60.0 * v + 0.7 * t_s + 8.0 * (0.05 * t_s + v).sin(), 80.0 + 45.0 * v * v - 0.2 * t_s + 100.0]
}

fn velocity(vehicle: usize, t_s: f64) -> [f64; 2] {
    let (a, b) = (position(vehicle, t_s), position(vehicle, t_s + 1.0));
    [b[0] - a[0], b[1] - a[1]]
}

fn truth() -> TrueTracks {
    let tracks = (0..VEHICLES).map(|v| (0..=END_S).map(|t| position(v, t as f64)).collect()).collect();
    TrueTracks::new((0..=END_S).map(|t| t * SECOND).collect(), tracks).unwrap()
}

/// A fix at the start and one at 90 s, soundings and commands each second, a range each three seconds.
fn observations() -> Vec<(i64, Observation)> {
    let mut all = Vec::new();
    for vehicle in 0..VEHICLES as u16 {
        all.push((0, Observation::Fix { vehicle, covariance_m2: [25.0, 0.0, 25.0] }));
        for t in 0..=END_S {
            let velocity_mps = velocity(usize::from(vehicle), t as f64);
            all.push((t * SECOND, Observation::Motion { vehicle, velocity_mps }));
            all.push((t * SECOND, Observation::Sounding { vehicle, sigma_m: 0.3 }));
        }
    }
    for k in 0..END_S / 3 {
        let (sender, receiver) = ((k % 3) as u16, ((k + 1 + k / 3 % 2) % 3) as u16);
        let tol_ns = 3 * k * SECOND;
        all.push((tol_ns + SECOND / 4, Observation::Range { sender, tol_ns, receiver }));
    }
    all.push((90 * SECOND, Observation::Fix { vehicle: 1, covariance_m2: [4.0, 1.0, 9.0] }));
    all
}

fn plane() -> std::sync::Arc<Chart> {
    // Depths that float32 holds exactly, so that the slope is exact too.
    chart_of(|east, north| 30.0 + SLOPE[0] * east + SLOPE[1] * north)
}

fn seconds() -> Vec<i64> {
    (0..=END_S).map(|t| t * SECOND).collect()
}

/// P ← F P Fᵀ + Q and P ← (I − K H) P with matrices as in a textbook; times in quarter seconds. Currents, and their
/// walks, of two vehicles correlate by `current`.
struct Textbook {
    p: DMatrix<f64>,
    current: f64,
}

impl Textbook {
    fn new(current: f64, offset: f64) -> Self {
        let d = drift();
        let prior = [
            25.0,
            25.0,
            1.0,
            d.sigma_current0_mps.powi(2),
            d.sigma_current0_mps.powi(2),
            d.sigma_heading_bias0_rad.powi(2),
            d.sigma_thrust_bias0_mps.powi(2),
        ];
        let p = DMatrix::from_fn(VEHICLES * S, VEHICLES * S, |r, c| {
            let share = if r == c { 1.0 } else { Self::share(r, c, current, offset) };
            prior[r % S] * share
        });
        Self { p, current }
    }

    /// Correlation of two states of different vehicles.
    fn share(r: usize, c: usize, current: f64, offset: f64) -> f64 {
        match (r % S, c % S) {
            (2, 2) => offset,
            (3, 3) | (4, 4) => current,
            _ => 0.0,
        }
    }

    /// What displaces a vehicle at this velocity: current, a compass that errs clockwise, a thruster that errs ahead.
    fn map([e, n]: [f64; 2], dt: f64) -> [[f64; 4]; 2] {
        let speed = e.hypot(n);
        [[dt, 0.0, n * dt, e / speed * dt], [0.0, dt, -e * dt, n / speed * dt]]
    }

    fn step(&mut self, second: f64, dt: f64) {
        let d = drift();
        let mut f = DMatrix::identity(VEHICLES * S, VEHICLES * S);
        let walks = [
            d.sigma_position_m_per_sqrt_s,
            d.sigma_position_m_per_sqrt_s,
            0.0,
            d.sigma_current_mps_per_sqrt_s,
            d.sigma_current_mps_per_sqrt_s,
            d.sigma_heading_bias_rad_per_sqrt_s,
            d.sigma_thrust_bias_mps_per_sqrt_s,
        ];
        for v in 0..VEHICLES {
            let map = Self::map(velocity(v, second), dt);
            for axis in 0..2 {
                for k in 0..4 {
                    f[(v * S + axis, v * S + 3 + k)] = map[axis][k];
                }
            }
        }
        let mut q = DMatrix::from_diagonal(&DVector::from_fn(VEHICLES * S, |k, _| walks[k % S].powi(2) * dt));
        // A state that walks within the step displaces the vehicle within the step.
        for v in 0..VEHICLES {
            let map = Self::map(velocity(v, second), dt);
            for k in 0..4 {
                let (state, walk) = (v * S + 3 + k, walks[3 + k].powi(2) * dt);
                for a in 0..2 {
                    q[(v * S + a, state)] = map[a][k] * walk / 2.0;
                    q[(state, v * S + a)] = map[a][k] * walk / 2.0;
                    for b in 0..2 {
                        q[(v * S + a, v * S + b)] += map[a][k] * map[b][k] * walk / 3.0;
                    }
                }
            }
        }
        // Currents that walk together take vehicles along together.
        for (v, w) in (0..VEHICLES).flat_map(|v| (0..VEHICLES).map(move |w| (v, w))).filter(|(v, w)| v != w) {
            for axis in 0..2 {
                let (a, b, walk) = (v * S + axis, w * S + axis, self.current * walks[3].powi(2) * dt);
                q[(a + 3, b + 3)] = walk;
                q[(a, b + 3)] = dt * walk / 2.0;
                q[(a + 3, b)] = dt * walk / 2.0;
                q[(a, b)] = dt * dt * walk / 3.0;
            }
        }
        self.p = &f * &self.p * f.transpose() + q;
    }

    fn measure(&mut self, h: &DMatrix<f64>, r: &DMatrix<f64>) {
        let s = h * &self.p * h.transpose() + r;
        let gain = &self.p * h.transpose() * s.try_inverse().unwrap();
        let keep = DMatrix::identity(VEHICLES * S, VEHICLES * S) - gain * h;
        self.p = keep * &self.p;
    }

    fn scalar(&mut self, entries: &[(usize, f64)], r: f64) {
        let mut h = DMatrix::zeros(1, VEHICLES * S);
        entries.iter().for_each(|&(k, value)| h[(0, k)] = value);
        self.measure(&h, &DMatrix::from_element(1, 1, r));
    }
}

#[test]
fn on_a_plane_the_bound_is_the_covariance_of_a_kalman_filter() {
    kalman_filter(&model(), Textbook::new(0.0, 0.0));
}

#[test]
fn so_it_is_where_vehicles_share_their_water() {
    // Currents that differ by 0.2 of what one may be, tides of 1 m by 0.1 m.
    let shared = BoundModel { current_difference: 0.2, offset_difference_m: 0.1, ..model() };
    kalman_filter(&shared, Textbook::new(1.0 - 0.2 * 0.2 / 2.0, 1.0 - 0.1 * 0.1 / 2.0));
}

fn kalman_filter(model: &BoundModel, mut book: Textbook) {
    let found = bound(model, Some(&plane()), &truth(), observations(), &seconds()).unwrap();
    for t in 0..=END_S {
        if t == 90 {
            let mut h = DMatrix::zeros(2, VEHICLES * S);
            (h[(0, S)], h[(1, S + 1)]) = (1.0, 1.0);
            book.measure(&h, &DMatrix::from_row_slice(2, 2, &[4.0, 1.0, 1.0, 9.0]));
        }
        for v in 0..VEHICLES {
            book.p[(v * S + 2, v * S + 2)] += 0.002f64.powi(2);
            book.scalar(&[(v * S, SLOPE[0]), (v * S + 1, SLOPE[1]), (v * S + 2, 1.0)], 0.09);
        }
        for (v, track) in found.iter().enumerate() {
            let at = |a: usize, b: usize| book.p[(v * S + a, v * S + b)];
            let got = track[t as usize];
            for (got, want) in got.iter().zip([at(0, 0), at(0, 1), at(1, 1)]) {
                assert!((got - want).abs() < 1e-6 * at(0, 0), "vehicle {v} at {t} s: {got} not {want}");
            }
        }
        let k = t / 3;
        book.step(t as f64, 0.25);
        if t % 3 == 0 && k < END_S / 3 {
            let (s, r) = ((k % 3) as usize, ((k + 1 + k / 3 % 2) % 3) as usize);
            let at = t as f64;
            let (from, now) = (position(s, at), position(r, at));
            let ahead = velocity(r, at);
            let to = [now[0] + 0.25 * ahead[0], now[1] + 0.25 * ahead[1]];
            let d = (to[0] - from[0]).hypot(to[1] - from[1]);
            let u = [(to[0] - from[0]) / d, (to[1] - from[1]) / d];
            let mut h = vec![(r * S, u[0]), (r * S + 1, u[1]), (s * S, -u[0]), (s * S + 1, -u[1])];
            let map = Textbook::map(velocity(s, at), 0.25);
            for (j, (east, north)) in map[0].iter().zip(map[1]).enumerate() {
                h.push((s * S + 3 + j, u[0] * east + u[1] * north));
            }
            book.scalar(&h, 1.0);
        }
        book.step(t as f64, 0.75);
    }
}

#[test]
fn on_a_plane_linearising_over_the_spread_changes_only_the_ranges() {
    let without = BoundModel { ranges: false, ..model() };
    let spread = BoundModel { linearised: true, ..without };
    let plain = bound(&without, Some(&plane()), &truth(), observations(), &seconds()).unwrap();
    let over = bound(&spread, Some(&plane()), &truth(), observations(), &seconds()).unwrap();
    for (a, b) in plain.iter().flatten().zip(over.iter().flatten()) {
        // Depths are float32: a slope over a short baseline keeps fewer digits.
        assert!((a[0] - b[0]).abs() < 2e-2 * a[0] && (a[2] - b[2]).abs() < 2e-2 * a[2], "{a:?} {b:?}");
    }
}

fn rms(found: &[Vec<[f64; 3]>]) -> f64 {
    let late: Vec<f64> = found.iter().flat_map(|v| v[50..].iter().map(|c| c[0] + c[2])).collect();
    (late.iter().sum::<f64>() / late.len() as f64).sqrt()
}

#[test]
fn more_information_never_hurts() {
    let chart = rich();
    let of = |terrain, ranges| {
        let model = BoundModel { terrain, ranges, ..model() };
        bound(&model, Some(&chart), &truth(), observations(), &seconds()).unwrap()
    };
    let (neither, terrain, ranges, both) =
        (of(false, false), of(true, false), of(false, true), of(true, true));
    for (less, more) in [(&neither, &terrain), (&neither, &ranges), (&terrain, &both), (&ranges, &both)] {
        for (a, b) in less.iter().flatten().zip(more.iter().flatten()) {
            assert!(b[0] <= a[0] * (1.0 + 1e-9) && b[2] <= a[2] * (1.0 + 1e-9), "{b:?} above {a:?}");
        }
        assert!(rms(more) < 0.97 * rms(less), "{} and {}", rms(more), rms(less));
    }
    // A chart that errs, or one whose error stays itself, tells less.
    let with = |sigma_map_m, correlation_length_m| {
        let model = BoundModel { sigma_map_m, correlation_length_m, ..model() };
        rms(&bound(&model, Some(&chart), &truth(), observations(), &seconds()).unwrap())
    };
    assert!(with(Some(0.5), None) > 1.02 * rms(&both));
    assert!(with(Some(0.5), Some(10.0)) > 1.1 * with(Some(0.5), None));
}

#[test]
fn spread_over_waves_tells_less_than_the_gradient_at_the_truth() {
    let chart = rich();
    let spread = BoundModel { linearised: true, ..model() };
    let plain = rms(&bound(&model(), Some(&chart), &truth(), observations(), &seconds()).unwrap());
    let over = rms(&bound(&spread, Some(&chart), &truth(), observations(), &seconds()).unwrap());
    assert!(over > plain && over < 20.0 * plain, "{over} and {plain}");
}

#[test]
fn a_vehicle_has_no_bound_before_its_fix_and_teammates_do_not_hear_of_it() {
    let late = 60 * SECOND;
    let observations: Vec<_> = observations()
        .into_iter()
        .map(|(t, o)| match o {
            Observation::Fix { vehicle: 2, .. } => (late, o),
            _ => (t, o),
        })
        .collect();
    let without: Vec<_> = observations
        .iter()
        .copied()
        .filter(|(_, o)| {
            !matches!(o, Observation::Range { sender: 2, .. } | Observation::Range { receiver: 2, .. })
        })
        .collect();
    let chart = rich();
    let found = bound(&model(), Some(&chart), &truth(), observations, &seconds()).unwrap();
    let alone = bound(&model(), Some(&chart), &truth(), without, &seconds()).unwrap();
    for t in 0..=END_S as usize {
        assert_eq!(found[2][t][0].is_nan(), t < 60, "at {t} s");
        assert!(found[0][t][0].is_finite());
        if t < 60 {
            // Ranges that nobody uses still cut a prediction in two: equal to rounding.
            for (with, without) in found[0][t].iter().zip(alone[0][t]) {
                assert!((with - without).abs() < 1e-12 * found[0][t][0], "at {t} s: {with} not {without}");
            }
        }
    }
    assert_ne!(found[0][END_S as usize], alone[0][END_S as usize], "from then on they do");
}

#[test]
fn without_a_chart_only_ranges_tell() {
    let with = bound(&model(), None, &truth(), observations(), &seconds()).unwrap();
    let model = BoundModel { terrain: false, ..model() };
    assert_eq!(with, bound(&model, Some(&rich()), &truth(), observations(), &seconds()).unwrap());
}

#[test]
fn impossible_input_is_refused() {
    let times = || vec![0, SECOND];
    assert!(TrueTracks::new(vec![], vec![]).is_err());
    assert!(TrueTracks::new(vec![SECOND, 0], vec![vec![[0.0; 2]; 2]]).is_err());
    assert!(TrueTracks::new(times(), vec![vec![[0.0; 2]; 3]]).is_err());
    assert!(TrueTracks::new(times(), vec![vec![[0.0, f64::NAN], [0.0; 2]]]).is_err());
    let stranger = vec![(0, Observation::Sounding { vehicle: 3, sigma_m: 0.1 })];
    let negative = vec![(0, Observation::Sounding { vehicle: 0, sigma_m: -0.1 })];
    let impossible = vec![(0, Observation::Fix { vehicle: 0, covariance_m2: [1.0, 2.0, 1.0] })];
    for bad in [stranger, negative, impossible] {
        assert!(bound(&model(), None, &truth(), bad.clone(), &seconds()).is_err(), "{bad:?}");
    }
    let bad = BoundModel { sigma_range_m: 0.0, ..model() };
    assert!(bound(&bad, None, &truth(), vec![], &seconds()).is_err());
}
