//! Filters against what theory says of them.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests fail by panicking")]
#![allow(clippy::needless_range_loop, reason = "matrices and columns are indexed as in their formulas")]

mod world;

use nalgebra::{Matrix2, Matrix4, Vector2, Vector4};
use uwcoop_core::cloud::Cloud;
use uwcoop_core::kernels::weights::{weighted_covariance, weighted_mean};
use uwcoop_core::navigator::particle_core::ParticleCore;
use uwcoop_core::navigator::{Navigator, Status};
use uwcoop_core::random::{Purpose, Streams};
use world::*;

/// The exact filter for position and current: what the marginalised particles stand for.
struct Kalman {
    mean: Vector4<f64>,
    covariance: Matrix4<f64>,
}

impl Kalman {
    fn predict(&mut self, velocity_mps: [f64; 2], dt_s: f64) {
        let mut transition = Matrix4::identity();
        transition[(0, 2)] = dt_s;
        transition[(1, 3)] = dt_s;
        let (position, current) = (0.05f64.powi(2) * dt_s, 0.01f64.powi(2) * dt_s);
        let noise = Matrix4::from_diagonal(&Vector4::new(position, position, current, current));
        self.mean = transition * self.mean;
        self.mean[0] += velocity_mps[0] * dt_s;
        self.mean[1] += velocity_mps[1] * dt_s;
        self.covariance = transition * self.covariance * transition.transpose() + noise;
    }

    fn fix(&mut self, position_m: [f64; 2], variance_m2: f64) {
        let cross = self.covariance.fixed_view::<4, 2>(0, 0).clone_owned();
        let s = self.covariance.fixed_view::<2, 2>(0, 0) + Matrix2::identity() * variance_m2;
        let gain = cross * s.try_inverse().unwrap();
        self.mean += gain * (Vector2::from(position_m) - self.mean.fixed_rows::<2>(0));
        self.covariance -= gain * cross.transpose();
    }
}

#[test]
fn marginalised_particles_are_the_kalman_filter_where_all_is_linear() {
    let particles = 20_000;
    let mut core = ParticleCore::<2>::new(particles, drift(), Streams::new(4, 0)).unwrap();
    let (start, start_m2, fix_m2) = ([100.0, -50.0], 0.01, 4.0);
    core.advance(0);
    core.fix(start, [start_m2, 0.0, start_m2]);
    let mut kalman = Kalman {
        mean: Vector4::new(start[0], start[1], 0.0, 0.0),
        covariance: Matrix4::from_diagonal(&Vector4::new(start_m2, start_m2, 0.09, 0.09)),
    };
    let mut t_s = 0.0;
    for k in 0..60 {
        // Unequal steps, a turning command, and a fix now and then: all linear.
        let (dt_s, angle) = (0.5 + 0.25 * f64::from(k % 4), 0.1 * f64::from(k));
        let velocity_mps = [1.5 * angle.cos(), 1.5 * angle.sin()];
        core.velocity_mps = velocity_mps;
        t_s += dt_s;
        core.advance((t_s * 1e9f64).round() as i64);
        kalman.predict(velocity_mps, dt_s);
        if k == 15 || k == 40 {
            let position_m = [kalman.mean[0] + 1.5, kalman.mean[1] - 1.0];
            core.fix(position_m, [fix_m2, 0.0, fix_m2]);
            kalman.fix(position_m, fix_m2);
        }
        if k % 10 == 9 {
            agrees(&core, &kalman, k);
        }
    }
    // A prediction is a further step without particles.
    let predicted = core.estimate(((t_s + 8.0) * 1e9).round() as i64);
    kalman.predict(core.velocity_mps, 8.0);
    for (at, (row, column)) in [(0, 0), (0, 1), (1, 1)].into_iter().enumerate() {
        let (found, exact) = (predicted.covariance_m2[at], kalman.covariance[(row, column)]);
        assert!((found - exact).abs() < 0.08 * kalman.covariance[(0, 0)], "{found} {exact}");
    }
}

/// Means within 4.5 and covariances within 5 Monte-Carlo standard errors.
fn agrees(core: &ParticleCore<2>, kalman: &Kalman, k: i32) {
    let cloud = &core.cloud;
    let columns = [&cloud.east, &cloud.north, &cloud.linear[0], &cloud.linear[1]];
    let means = columns.map(|c| weighted_mean(cloud.weights(), c));
    let n = cloud.ess();
    for r in 0..4 {
        let off = means[r] - kalman.mean[r];
        let allowed = 4.5 * (kalman.covariance[(r, r)] / n).sqrt();
        assert!(off.abs() < allowed, "step {k}, mean {r}: {off} off where {allowed} is allowed");
        for c in 0..=r {
            let mut found = weighted_covariance(cloud.weights(), columns[r], means[r], columns[c], means[c]);
            // Currents: the spread of the particles' means and what each of them does not know.
            if r >= 2 && c >= 2 {
                found += core.covariance[(r - 2, c - 2)];
            }
            let exact = kalman.covariance[(r, c)];
            let scale = (kalman.covariance[(r, r)] * kalman.covariance[(c, c)]).sqrt();
            let allowed = 5.0 * scale * (2.0 / n).sqrt();
            assert!(
                (found - exact).abs() < allowed,
                "step {k}, covariance {r} {c}: {found}, exactly {exact}"
            );
        }
    }
}

#[test]
fn liu_west_keeps_mean_and_covariance() {
    let n = 20_000;
    let mut cloud = Cloud::<2>::new(n);
    cloud.add_offset();
    let streams = Streams::new(9, 0);
    // Correlated columns: the offset and the currents lean on the position.
    let (mut a, mut b) = (vec![0.0; n], vec![0.0; n]);
    let mut base = Vec::new();
    for lane in 0..3 {
        streams.at(Purpose::Process, 0).normal_pairs(lane, &mut a, &mut b);
        base.extend([a.clone(), b.clone()]);
    }
    for i in 0..n {
        cloud.east[i] = 5e5 + 8.0 * base[0][i];
        cloud.north[i] = 4e6 + 3.0 * base[1][i] + 2.0 * base[0][i];
        cloud.offset[i] = 0.7 + 0.2 * base[2][i] + 0.05 * base[0][i];
        cloud.linear[0][i] = 0.1 * base[3][i] - 0.02 * base[1][i];
        cloud.linear[1][i] = 0.05 * base[4][i];
    }
    let columns = |c: &Cloud<2>| {
        [c.east.clone(), c.north.clone(), c.offset.clone(), c.linear[0].clone(), c.linear[1].clone()]
    };
    let weights = vec![1.0 / n as f64; n];
    let before = columns(&cloud);
    cloud.liu_west(&streams.at(Purpose::Jitter, 1));
    let after = columns(&cloud);
    let moments = |c: &[Vec<f64>; 5]| {
        let mean: Vec<f64> = c.iter().map(|x| weighted_mean(&weights, x)).collect();
        let covariance: Vec<f64> = (0..25)
            .map(|k| weighted_covariance(&weights, &c[k / 5], mean[k / 5], &c[k % 5], mean[k % 5]))
            .collect();
        (mean, covariance)
    };
    let ((mean0, cov0), (mean1, cov1)) = (moments(&before), moments(&after));
    let h = uwcoop_core::kernels::particles::liu_west_bandwidth(n);
    for r in 0..5 {
        let sigma = cov0[6 * r].sqrt();
        // Only the jitter h·σ·n moves the mean, and only its sample covariance changes the covariance.
        assert!((mean1[r] - mean0[r]).abs() < 4.5 * h * sigma / (n as f64).sqrt(), "mean {r}");
        let moved = after[r].iter().zip(&before[r]).filter(|(a, b)| a != b).count();
        assert!(moved > n / 2, "column {r} was moved");
        for c in 0..5 {
            let scale = (cov0[6 * r] * cov0[6 * c]).sqrt();
            let off = cov1[5 * r + c] - cov0[5 * r + c];
            assert!(off.abs() < 5.0 * scale * 2.0 * h / (n as f64).sqrt(), "covariance {r} {c}: {off}");
        }
    }
}

/// A mission of one vehicle under an unknown current on the rich chart; position error and covariance at its end.
fn end_of_mission(
    seed: u64,
    seconds: i64,
    tide_m: f64,
    navigator: &mut dyn Navigator,
) -> ([f64; 2], [f64; 3]) {
    let noise = world_noise(seed, 901, 8);
    let walk = [world_noise(seed, 902, seconds as usize + 2), world_noise(seed, 903, seconds as usize + 2)];
    // True track: straight at 1.5 m/s through the water, current drawn from its prior (0.1 m/s), and noise.
    let (heading, current) = (noise[0], [0.1 * noise[1], 0.1 * noise[2]]);
    let command = [1.5 * heading.cos(), 1.5 * heading.sin()];
    let mut positions = vec![[200.0 - 75.0 * heading.cos(), 200.0 - 75.0 * heading.sin()]];
    for k in 0..=seconds as usize {
        let p = positions[k];
        positions.push([0, 1].map(|a| p[a] + command[a] + current[a] + 0.05 * walk[a][k]));
    }
    let track = move |t: f64| positions[t.round() as usize];
    let mut vehicle = Vehicle::new(0, track);
    vehicle.tide_m = tide_m;
    vehicle.sounding_errors_m =
        world_noise(seed, 904, seconds as usize + 1).iter().map(|z| 0.05 * z).collect();
    // The fix is off within its disc.
    let off = 10.0 * (0.5 + 0.5 * noise[3].tanh()).sqrt();
    let (s, c) = (7.0 * noise[4]).sin_cos();
    let start = vehicle.position_m(0);
    navigator.handle(&fix(0, 0, [start[0] + off * c, start[1] + off * s], 25.0)).unwrap();
    for second in 0..=seconds {
        for mut event in vehicle.second(second, rich_depth) {
            if let uwcoop_core::event::Payload::Motion { velocity_mps } = &mut event.payload {
                *velocity_mps = command;
            }
            navigator.handle(&event).unwrap();
        }
    }
    let estimate = navigator.estimate(seconds * SECOND);
    assert_eq!(estimate.status, Status::Navigating);
    let truth = vehicle.position_m(seconds * SECOND);
    ([estimate.mean_m[0] - truth[0], estimate.mean_m[1] - truth[1]], estimate.covariance_m2)
}

fn nees([e, n]: [f64; 2], [ee, en, nn]: [f64; 3]) -> f64 {
    (nn * e * e - 2.0 * en * e * n + ee * n * n) / (ee * nn - en * en)
}

/// Quantile of χ² by Wilson and Hilferty's cube root, for a standard normal quantile `z`.
fn chi2_quantile(dof: f64, z: f64) -> f64 {
    let v = 2.0 / (9.0 * dof);
    dof * (1.0 - v + z * v.sqrt()).powi(3)
}

#[test]
fn mpf_is_consistent_over_seeds() {
    let (runs, mut sum, mut errors) = (60, 0.0, Vec::new());
    let chart = rich();
    for seed in 0..runs {
        // Fewer lose one cloud in some hundred in the first minute: the disc of the fix is 50 times wider than what a
        // sounding says.
        let mut options = mpf_options(4000);
        options.range = None;
        options.terrain.drift.sigma_current0_mps = 0.1;
        options.terrain.drift.sigma_current_mps_per_sqrt_s = 1e-4;
        let mut navigator = mpf::<2>(0, 1, options, &chart, seed);
        let tide_m = world_noise(seed, 905, 1)[0];
        let (error, covariance) = end_of_mission(seed, 100, tide_m, &mut navigator);
        sum += nees(error, covariance);
        errors.push(error[0].hypot(error[1]));
    }
    errors.sort_by(f64::total_cmp);
    assert!(errors[30] < 1.0 && errors[59] < 10.0, "median {} m, worst {} m", errors[30], errors[59]);
    // Two-sided 99.9 %.
    let dof = 2.0 * runs as f64;
    let (low, high) = (chi2_quantile(dof, -3.29), chi2_quantile(dof, 3.29));
    assert!((low..high).contains(&sum), "NEES sums to {sum} over {runs} seeds, outside {low} to {high}");
}

#[test]
fn mpf_learns_the_tide() {
    let chart = rich();
    for tide_m in [-0.8, 0.0, 1.3] {
        let mut navigator = mpf::<2>(0, 1, mpf_options(600), &chart, 3);
        let (error, _) = end_of_mission(17, 120, tide_m, &mut navigator);
        let (offset_m, variance_m2) = navigator.terrain().datum_offset();
        assert!(error[0].hypot(error[1]) < 2.0, "{error:?}");
        assert!(
            (offset_m - tide_m).abs() < 4.0 * variance_m2.sqrt(),
            "{offset_m} ± √{variance_m2}, truly {tide_m}"
        );
        assert!(variance_m2.sqrt() < 0.1, "√{variance_m2}");
    }
}

#[test]
fn chi2_quantiles_are_those_of_tables() {
    assert!((chi2_quantile(120.0, 3.290_527) - 177.602_9).abs() < 0.7);
    assert!((chi2_quantile(60.0, 1.644_854) - 79.081_9).abs() < 0.05);
}
