//! The joint Gaussians of `team` against dense matrices, particle by particle.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests fail by panicking")]

use nalgebra::{DMatrix, DVector};
use uwcoop_core::kernels::jitter::{JitterScratch, jitter_followers};
use uwcoop_core::kernels::lookup::{Grid, Paired, bilinear, paired};
use uwcoop_core::kernels::team::{
    BLOCK, BlockLayout, BlockUpdates, Joints, MapSigma, Op, Own, Prediction, RangeOp, Terrain, packed,
    packed_len, run,
};
use uwcoop_core::measurement::range::LateArrivals;
use uwcoop_core::random::{Purpose, Streams};

/// Not a multiple of the lanes.
const COUNT: usize = 13;
const DIM: usize = 2 * BLOCK;
const SIDE: usize = 120;

fn normals(step: u32, count: usize) -> Vec<f64> {
    let (mut a, mut b) = (vec![0.0; count], vec![0.0; count]);
    Streams::new(11, 2).at(Purpose::Process, step).normal_pairs(0, &mut a, &mut b);
    a
}

/// Means and covariances of `COUNT` particles over two teammates.
struct World {
    mean: Vec<DVector<f64>>,
    covariance: Vec<DMatrix<f64>>,
    /// The particle whose covariance each has.
    order: Vec<u32>,
    own: [Vec<f64>; 2],
    layout: BlockLayout,
    late: Option<LateArrivals>,
}

impl World {
    fn new() -> Self {
        Self::of(BlockLayout::default())
    }

    fn of(layout: BlockLayout) -> Self {
        let blocks = [
            ([60.0, 55.0, 0.2, 0.1, -0.1, 0.01, 0.02], [4.0, 3.0, 0.5, 0.2, 0.2, 0.03, 0.08]),
            ([30.0, 85.0, -0.1, 0.0, 0.1, 0.0, 0.0], [5.0, 2.0, 0.4, 0.2, 0.1, 0.02, 0.05]),
        ];
        let (mut centre, mut scale) = (Vec::new(), Vec::new());
        if layout.scale {
            centre.push(0.004);
            scale.push(0.007);
        }
        for (means, sigmas) in blocks {
            centre.extend(means);
            scale.extend(sigmas);
            if layout.clock {
                centre.extend([2.0, 0.01]);
                scale.extend([6.0, 0.03]);
            }
        }
        let dim = layout.base(2);
        let each = |i: usize| normals(i as u32, dim * dim + dim);
        let mean = (0..COUNT)
            .map(|i| DVector::from_fn(dim, |r, _| centre[r] + 0.3 * scale[r] * each(i)[dim * dim + r]))
            .collect();
        let covariance = (0..COUNT)
            .map(|i| {
                let z = each(i);
                let root = DMatrix::from_fn(dim, dim, |r, c| {
                    scale[r] * (0.3 * z[r * dim + c] + if r == c { 1.0 } else { 0.0 })
                });
                &root * root.transpose()
            })
            .collect();
        let order = (0..COUNT as u32).map(|i| (i * 5 + 3) % COUNT as u32).collect();
        let own = [normals(90, COUNT), normals(91, COUNT)].map(|c| c.iter().map(|x| 20.0 + x).collect());
        Self { mean, covariance, order, own, layout, late: None }
    }

    fn covariance_of(&self, i: usize) -> &DMatrix<f64> {
        &self.covariance[self.order[i] as usize]
    }

    /// Runs operations on the first block; means and covariances after them, log-likelihoods, innovations.
    #[allow(clippy::type_complexity)]
    fn run(
        &self,
        base: usize,
        ops: &[Op],
        terrain: Option<Terrain<'_>>,
    ) -> (Vec<DVector<f64>>, Vec<DMatrix<f64>>, Vec<f64>, [Vec<f64>; 2]) {
        let dim = self.layout.base(2);
        let mut mean: Vec<f64> = (0..dim).flat_map(|r| self.mean.iter().map(move |m| m[r])).collect();
        let mut before = vec![0.0; packed_len(dim) * COUNT];
        for r in 0..dim {
            for c in 0..=r {
                for (i, p) in self.covariance.iter().enumerate() {
                    before[packed(r, c) * COUNT + i] = p[(r, c)];
                }
            }
        }
        let mut after = vec![0.0; before.len()];
        let weighing = ops.iter().filter(|op| op.weighs()).count();
        let mut rows = vec![0.0; weighing * COUNT];
        let mut innovation = [vec![0.0; weighing * COUNT], vec![0.0; weighing * COUNT]];
        let [east, north] = &self.own;
        let updates = BlockUpdates {
            base,
            layout: self.layout,
            late: self.late,
            ops,
            terrain,
            own: Own { at: [[east, north], [north, east]] },
            current: None,
        };
        let mut scratch = Vec::new();
        let mut joints = Joints {
            dim,
            mean: &mut mean,
            before: &before,
            order: &self.order,
            after: &mut after,
            scratch: &mut scratch,
        };
        let [nu, s] = &mut innovation;
        run(&updates, &mut joints, &mut rows, &mut [nu, s]);
        let means = (0..COUNT).map(|i| DVector::from_fn(dim, |r, _| mean[r * COUNT + i])).collect();
        let covariances =
            (0..COUNT).map(|i| DMatrix::from_fn(dim, dim, |r, c| after[packed(r, c) * COUNT + i])).collect();
        (means, covariances, rows, innovation)
    }
}

fn close(found: &DMatrix<f64>, expected: &DMatrix<f64>, what: &str) {
    let off = (found - expected).norm() / expected.norm();
    assert!(off < 1e-9, "{what}: off by {off:e}");
}

fn close_mean(found: &DVector<f64>, expected: &DVector<f64>, what: &str) {
    let off = (found - expected).norm() / expected.norm();
    assert!(off < 1e-9, "{what}: off by {off:e}");
}

/// One Kalman update of (m, P).
fn dense_update(
    m: &DVector<f64>,
    p: &DMatrix<f64>,
    h: &DVector<f64>,
    innovation: f64,
    variance: f64,
) -> (DVector<f64>, DMatrix<f64>) {
    let hp = p * h;
    (m + &hp * (innovation / variance), p - &hp * hp.transpose() / variance)
}

#[test]
fn a_prediction_is_the_dense_one() {
    let world = World::new();
    let step = Prediction {
        displacement_m: [2.4, -1.1],
        dt_s: 3.0,
        speed_mps: 0.9,
        position_m2_per_s: 0.004,
        walk_per_s: [1e-4, 1e-8, 1e-6],
        clock_m2_per_s: 0.0,
    };
    for base in [0, BLOCK] {
        let (means, covariances, rows, _) = world.run(base, &[Op::Predict(step)], None);
        assert!(rows.is_empty());
        let mut f = DMatrix::<f64>::identity(DIM, DIM);
        let [de, dn] = step.displacement_m;
        for (axis, row) in [[3.0, 0.0, dn, de / 0.9], [0.0, 3.0, -de, dn / 0.9]].iter().enumerate() {
            for (k, x) in row.iter().enumerate() {
                f[(base + axis, base + 3 + k)] = *x;
            }
        }
        let mut q = DMatrix::<f64>::zeros(DIM, DIM);
        for axis in 0..2 {
            q[(base + axis, base + axis)] = 3.0 * 0.004 + 1e-4 * 27.0 / 3.0;
            q[(base + axis, base + 3 + axis)] = 0.5 * 1e-4 * 9.0;
            q[(base + 3 + axis, base + axis)] = 0.5 * 1e-4 * 9.0;
            q[(base + 3 + axis, base + 3 + axis)] = 3e-4;
        }
        q[(base + 5, base + 5)] = 3e-8;
        q[(base + 6, base + 6)] = 3e-6;
        for i in 0..COUNT {
            let mut expected = &f * &world.mean[i];
            expected[base] += de;
            expected[base + 1] += dn;
            close_mean(&means[i], &expected, "mean");
            close(&covariances[i], &(&f * world.covariance_of(i) * f.transpose() + &q), "covariance");
        }
    }
}

/// A chart on which five points see a plane exactly, or a bowl.
fn depths(curvature: f64) -> Vec<Paired> {
    let depths: Vec<f32> = (0..SIDE * SIDE)
        .map(|k| {
            let (e, n) = ((k % SIDE) as f64, (k / SIDE) as f64);
            (20.0 + 0.0625 * e - 0.03125 * n + curvature * (e - 60.0) * (e - 60.0)) as f32
        })
        .collect();
    paired(&depths, SIDE)
}

fn terrain(values: &[Paired], dof: f64) -> Terrain<'_> {
    let grid = Grid::new(values, SIDE, SIDE, 0.0, 0.0, 1.0).unwrap();
    Terrain { chart: grid, filled: grid, sigma: MapSigma::Uniform(0.1), dof }
}

fn sounding(water_depth_m: f64, shared: f64) -> Op {
    Op::Sounding { water_depth_m, noise_m2: 0.04, walk_m2: 1e-4, shared }
}

#[test]
fn a_sounding_over_a_plane_is_a_linear_update() {
    let world = World::new();
    let values = depths(0.0);
    let (means, covariances, rows, _) =
        world.run(0, &[sounding(22.0, 1.0)], Some(terrain(&values, f64::INFINITY)));
    let mut h = DVector::zeros(DIM);
    (h[0], h[1], h[2]) = (0.0625, -0.03125, 1.0);
    for i in 0..COUNT {
        let mut p = world.covariance_of(i).clone();
        p[(2, 2)] += 1e-4;
        let m = &world.mean[i];
        let innovation = 22.0 - (20.0 + 0.0625 * m[0] - 0.03125 * m[1]) - m[2];
        let s = (h.transpose() * &p * &h)[0] + 0.04 + 0.01;
        let (mean, covariance) = dense_update(m, &p, &h, innovation, s);
        // Depths are f32: 2e-6 m at 20 m.
        assert!((&means[i] - &mean).norm() < 1e-3, "{} {}", means[i], mean);
        assert!((&covariances[i] - &covariance).norm() / covariance.norm() < 1e-4);
        let expected = -0.5 * (innovation * innovation / s + s.ln());
        assert!((rows[i] - expected).abs() < 1e-3, "{} {expected}", rows[i]);
    }
}

/// The five-point linearisation as the methods page writes it, dense, with tempering and tails.
#[test]
fn a_sounding_over_a_bowl_is_statistically_linearised() {
    let world = World::new();
    let values = depths(0.002);
    let (dof, shared) = (4.0, 5.0);
    let t = terrain(&values, dof);
    let (means, covariances, rows, _) = world.run(BLOCK, &[sounding(25.0, shared)], Some(t));
    for i in 0..COUNT {
        let mut p = world.covariance_of(i).clone();
        let (e, n, b) = (BLOCK, BLOCK + 1, BLOCK + 2);
        p[(b, b)] += 1e-4;
        let m = &world.mean[i];
        let l11 = p[(e, e)].sqrt();
        let l21 = p[(n, e)] / l11;
        let l22 = (p[(n, n)] - l21 * l21).sqrt();
        let root3 = 3.0f64.sqrt();
        let h =
            |x: f64, y: f64| bilinear(&t.chart, m[e] + root3 * l11 * x, m[n] + root3 * (l21 * x + l22 * y));
        let (h0, h1, h2, h3, h4) = (h(0., 0.), h(1., 0.), h(-1., 0.), h(0., 1.), h(0., -1.));
        let mean = h0 / 3.0 + (h1 + h2 + h3 + h4) / 6.0;
        let (d1, d2) = ((h1 - h2) / (2.0 * root3), (h3 - h4) / (2.0 * root3));
        let spread = (h0 - mean).powi(2) / 3.0
            + [h1, h2, h3, h4].iter().map(|h| (h - mean).powi(2)).sum::<f64>() / 6.0;
        let rho = (spread - d1 * d1 - d2 * d2).max(0.0);
        let gn = d2 / l22;
        let mut row = DVector::zeros(DIM);
        (row[e], row[n], row[b]) = ((d1 - gn * l21) / l11, gn, 1.0);
        let innovation = 25.0 - mean - m[b];
        let hph = (row.transpose() * &p * &row)[0];
        let s = hph + 0.05 + rho;
        let log = -(0.5 * (dof + 1.0) * (1.0 + innovation * innovation / (dof * s)).ln()) - 0.5 * s.ln();
        assert!((rows[i] - log / shared).abs() < 1e-3, "{} {}", rows[i], log / shared);
        let r = shared * 0.05 + rho;
        let f = ((dof + innovation * innovation / (hph + r)) / (dof + 1.0)).max(1.0);
        let (mean, covariance) = dense_update(m, &p, &row, innovation, hph + f * r);
        assert!((&means[i] - &mean).norm() < 1e-3, "{} {}", means[i], mean);
        assert!((&covariances[i] - &covariance).norm() / covariance.norm() < 1e-4);
    }
}

#[test]
fn over_a_hole_and_off_the_chart_nothing_changes_but_the_walk_of_the_offset() {
    let world = World::new();
    let mut values = depths(0.0);
    for row in values.chunks_mut(SIDE) {
        row[61..].fill([f32::NAN; 2]);
    }
    let t = terrain(&values, f64::INFINITY);
    let (means, covariances, rows, _) = world.run(0, &[sounding(22.0, 1.0)], Some(t));
    let mut over = 0;
    for i in 0..COUNT {
        if rows[i].is_nan() {
            over += 1;
            close_mean(&means[i], &world.mean[i], "mean");
            let mut p = world.covariance_of(i).clone();
            p[(2, 2)] += 1e-4;
            close(&covariances[i], &p, "covariance");
        }
    }
    assert!(over > 3, "{over} particles over the hole");
    let (means, _, rows, _) = world.run(0, &[sounding(22.0, 1.0)], None);
    assert!(rows.iter().all(|l| l.is_nan()));
    close_mean(&means[3], &world.mean[3], "without a chart");
}

/// Own places 0 are those at the last launch, to which the sender measured; 1, where this vehicle measured.
fn to_own(own: usize, range_m: f64) -> Op {
    let clock_sign = if own == 1 { 1.0 } else { -1.0 };
    Op::RangeToOwn { own, clock_sign, range: RangeOp { range_m, variance_m2: 1.0 } }
}

fn to_block(base: usize, range_m: f64) -> Op {
    Op::RangeToBlock { base, range: RangeOp { range_m, variance_m2: 1.0 } }
}

/// Second order across the line of sight, as the methods page writes it.
fn dense_range(
    m: &DVector<f64>,
    p: &DMatrix<f64>,
    base: usize,
    other: Option<usize>,
    at: [f64; 2],
    range_m: f64,
) -> (DVector<f64>, DMatrix<f64>, f64) {
    let (at, other_row) = match other {
        Some(o) => ([m[o], m[o + 1]], other),
        None => (at, None),
    };
    let (de, dn) = (m[base] - at[0], m[base + 1] - at[1]);
    let d = de.hypot(dn);
    let row = |ue: f64, un: f64| {
        let mut h = DVector::zeros(DIM);
        (h[base], h[base + 1]) = (ue, un);
        if let Some(o) = other_row {
            (h[o], h[o + 1]) = (-ue, -un);
        }
        h
    };
    let (u, v) = (row(de / d, dn / d), row(-dn / d, de / d));
    let t = (v.transpose() * p * &v)[0];
    let k = t / d.max(t.sqrt());
    let s = (u.transpose() * p * &u)[0] + 1.0 + 0.5 * k * k;
    let innovation = range_m - d - 0.5 * k;
    let (mean, covariance) = dense_update(m, p, &u, innovation, s);
    (mean, covariance, -0.5 * (innovation * innovation / s + s.ln()))
}

#[test]
fn ranges_to_oneself_and_between_blocks_are_the_dense_updates() {
    let world = World::new();
    for (ops, other, own) in [
        ([to_own(0, 50.0)], None, 0),
        ([to_own(1, 50.0)], None, 1),
        ([to_block(BLOCK, 44.0)], Some(BLOCK), 0),
    ] {
        let (means, covariances, rows, innovation) = world.run(0, &ops, None);
        for i in 0..COUNT {
            let mut at = [world.own[0][i], world.own[1][i]];
            if own == 1 {
                at.reverse();
            }
            let range_m = if other.is_some() { 44.0 } else { 50.0 };
            let (mean, covariance, log) =
                dense_range(&world.mean[i], world.covariance_of(i), 0, other, at, range_m);
            close_mean(&means[i], &mean, "mean");
            close(&covariances[i], &covariance, "covariance");
            assert!((rows[i] - log).abs() < 1e-9, "{} {log}", rows[i]);
            assert!(innovation[1][i] > 1.0);
        }
    }
}

const CLOCKED: BlockLayout = BlockLayout { scale: true, clock: true };

#[test]
fn a_clock_difference_runs_on_by_its_rate() {
    let world = World::of(CLOCKED);
    let (base, dim) = (CLOCKED.base(1), CLOCKED.base(2));
    let step = Prediction {
        displacement_m: [2.4, -1.1],
        dt_s: 4.0,
        speed_mps: 0.9,
        position_m2_per_s: 0.004,
        walk_per_s: [1e-4, 1e-8, 1e-6],
        clock_m2_per_s: 0.02,
    };
    let (means, covariances, _, _) = world.run(base, &[Op::Predict(step)], None);
    let (clock, rate) = (base + BLOCK, base + BLOCK + 1);
    for i in 0..COUNT {
        let p = world.covariance_of(i);
        let mut f = DMatrix::<f64>::identity(dim, dim);
        f[(clock, rate)] = 4.0;
        let [de, dn] = step.displacement_m;
        for (axis, row) in [[4.0, 0.0, dn, de / 0.9], [0.0, 4.0, -de, dn / 0.9]].iter().enumerate() {
            for (k, x) in row.iter().enumerate() {
                f[(base + axis, base + 3 + k)] = *x;
            }
        }
        let expected = &f * p * f.transpose();
        for r in 0..dim {
            let more = if r == clock { 0.08 } else { 0.0 };
            let off = (covariances[i][(clock, r)] - expected[(clock, r)] - more).abs();
            assert!(off < 1e-9 * (1.0 + expected[(clock, r)].abs()), "{r}: {off}");
        }
        assert!((means[i][clock] - world.mean[i][clock] - 4.0 * world.mean[i][rate]).abs() < 1e-12);
    }
}

/// z = (1 + s) D ± β of each kind of range, dense.
#[test]
fn a_range_sees_scale_and_clocks_with_their_signs() {
    let world = World::of(CLOCKED);
    let (own, other, dim) = (CLOCKED.base(0), CLOCKED.base(1), CLOCKED.base(2));
    for (op, far, clocks) in [
        (to_own(0, 50.0), None, vec![(own + BLOCK, -1.0)]),
        (to_own(1, 50.0), None, vec![(own + BLOCK, 1.0)]),
        (to_block(other, 44.0), Some(other), vec![(own + BLOCK, -1.0), (other + BLOCK, 1.0)]),
    ] {
        let (means, covariances, rows, [nu, s]) = world.run(own, &[op], None);
        for i in 0..COUNT {
            let (m, p) = (&world.mean[i], world.covariance_of(i));
            let mut at = [world.own[0][i], world.own[1][i]];
            if matches!(op, Op::RangeToOwn { own: 1, .. }) {
                at.reverse();
            }
            if let Some(far) = far {
                at = [m[far], m[far + 1]];
            }
            let (de, dn) = (m[own] - at[0], m[own + 1] - at[1]);
            let d = de.hypot(dn);
            let (mut u, mut v) = (DVector::<f64>::zeros(dim), DVector::<f64>::zeros(dim));
            for (place, sign) in [(Some(own), 1.0), (far, -1.0)] {
                let Some(place) = place else { continue };
                (u[place], u[place + 1]) = (sign * de / d, sign * dn / d);
                (v[place], v[place + 1]) = (-sign * dn / d, sign * de / d);
            }
            let t = (v.transpose() * p * &v)[0];
            let k = t / d.max(t.sqrt());
            let length = d + 0.5 * k;
            let mut h = u * (1.0 + m[0]);
            h[0] = length;
            let range_m = if far.is_some() { 44.0 } else { 50.0 };
            let mut innovation = range_m - (1.0 + m[0]) * length;
            for (clock, sign) in &clocks {
                h[*clock] = *sign;
                innovation -= sign * m[*clock];
            }
            let variance = (h.transpose() * p * &h)[0] + 1.0 + 0.5 * k * k;
            let (mean, covariance) = dense_update(m, p, &h, innovation, variance);
            assert!((nu[i] - innovation).abs() < 1e-9 && (s[i] / variance - 1.0).abs() < 1e-9);
            close_mean(&means[i], &mean, "mean");
            close(&covariances[i], &covariance, "covariance");
            assert!((rows[i] + 0.5 * (innovation * innovation / variance + variance.ln())).abs() < 1e-9);
        }
    }
}

/// The block moves by the moments of the mixture, which the model states as derivatives.
#[test]
fn a_range_that_may_be_late_updates_by_the_mixture() {
    let mut world = World::new();
    let (_, _, _, [nu, s]) = world.run(0, &[to_own(1, 75.0)], None);
    for share in [1e-12, 0.3] {
        let late = LateArrivals { share, mean_m: 20.0, floor_per_m: 0.0 };
        world.late = Some(late);
        let (means, covariances, rows, _) = world.run(0, &[to_own(1, 75.0)], None);
        for i in 0..COUNT {
            let (m, p) = (&world.mean[i], world.covariance_of(i));
            let (de, dn) = (m[0] - world.own[1][i], m[1] - world.own[0][i]);
            let mut h = DVector::<f64>::zeros(DIM);
            (h[0], h[1]) = (de / de.hypot(dn), dn / de.hypot(dn));
            let hp = p * &h;
            let expected = late.likelihood(nu[i], s[i]);
            assert!((rows[i] - expected.log_z).abs() < 1e-9);
            close_mean(&means[i], &(m - &hp * expected.slope), "mean");
            close(&covariances[i], &(p + &hp * hp.transpose() * expected.curvature), "covariance");
        }
    }
}

#[test]
fn a_fix_is_two_dense_updates() {
    let world = World::new();
    let position_m = [63.0, 52.0];
    let (means, covariances, rows, _) = world.run(0, &[Op::Fix { position_m, variance_m2: 9.0 }], None);
    for i in 0..COUNT {
        let (mut m, mut p, mut log) = (world.mean[i].clone(), world.covariance_of(i).clone(), 0.0);
        for axis in 0..2 {
            let mut h = DVector::zeros(DIM);
            h[axis] = 1.0;
            let s = p[(axis, axis)] + 9.0;
            let innovation = position_m[axis] - m[axis];
            log -= 0.5 * (innovation * innovation / s + s.ln());
            (m, p) = dense_update(&m, &p, &h, innovation, s);
        }
        close_mean(&means[i], &m, "mean");
        close(&covariances[i], &p, "covariance");
        assert!((rows[i] - log).abs() < 1e-9);
    }
}

#[test]
fn operations_in_one_go_are_operations_one_by_one() {
    let mut world = World::new();
    let values = depths(0.001);
    let t = terrain(&values, 4.0);
    let step = Prediction {
        displacement_m: [1.0, 0.5],
        dt_s: 1.0,
        speed_mps: 1.1,
        position_m2_per_s: 0.0025,
        walk_per_s: [1e-4, 0.0, 0.0],
        clock_m2_per_s: 0.0,
    };
    let ops = [
        Op::Predict(step),
        sounding(24.0, 2.0),
        to_block(BLOCK, 44.0),
        Op::Predict(step),
        sounding(24.1, 2.0),
    ];
    let (means, covariances, rows, _) = world.run(0, &ops, Some(t));
    let mut logs = Vec::new();
    for op in ops {
        let (mean, covariance, row, _) = world.run(0, &[op], Some(t));
        logs.extend(row);
        (world.mean, world.covariance) = (mean, covariance);
        world.order = (0..COUNT as u32).collect();
    }
    assert_eq!(rows, logs);
    assert_eq!(means, world.mean);
    assert_eq!(covariances, world.covariance);
}

#[test]
fn followers_keep_mean_and_covariance_with_their_leaders() {
    let n = 40_000;
    let [a, b, c] = [1, 2, 3].map(|k| normals(k, n));
    let leader: Vec<f64> = a.iter().map(|x| 5.0 + 2.0 * x).collect();
    let follower: Vec<f64> = a.iter().zip(&b).map(|(a, b)| -3.0 + a + 0.5 * b).collect();
    let mut both = [follower.clone(), c.clone()].concat();
    let own_normals = normals(7, n);
    let noise = [normals(8, n), normals(9, n)].concat();
    let h = 0.3;
    jitter_followers(&[&leader], &[&own_normals], &mut both, &noise, h, &mut JitterScratch::default());
    // The leader's own jitter, as its owner does it.
    let mean = |x: &[f64]| x.iter().sum::<f64>() / n as f64;
    let covariance = |x: &[f64], y: &[f64]| {
        let (mx, my) = (mean(x), mean(y));
        x.iter().zip(y).map(|(x, y)| (x - mx) * (y - my)).sum::<f64>() / n as f64
    };
    let (m, s) = (mean(&leader), covariance(&leader, &leader).sqrt());
    let moved: Vec<f64> = leader
        .iter()
        .zip(&own_normals)
        .map(|(x, z)| m + (1.0 - h * h).sqrt() * (x - m) + h * s * z)
        .collect();
    let after = &both[..n];
    assert!((mean(after) - mean(&follower)).abs() < 0.02);
    assert!((covariance(after, after) / covariance(&follower, &follower) - 1.0).abs() < 0.03);
    assert!((covariance(after, &moved) / covariance(&follower, &leader) - 1.0).abs() < 0.03);
    assert!(after.iter().zip(&follower).any(|(x, y)| (x - y).abs() > 0.1), "it moved");
    assert!((covariance(&both[n..], &both[n..]) - 1.0).abs() < 0.04);
}
