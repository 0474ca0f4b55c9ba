//! Joint Gaussians over teammates, one for each particle: prediction, soundings, fixes, ranges.
//!
//! Columns are structures of arrays: `mean` holds D columns of N particles, `covariance` the rows of the packed lower
//! triangle, one column of N for each element. A teammate's block is
//!
//! ```text
//! base + 0 1 2 3   4   5       6      7 8
//!        e n b c_e c_n heading thrust β β̇
//! ```
//!
//! The last two, the clock difference as a range in m and its rate in m/s, are there where clocks may differ
//! ([`BlockLayout`]); before all blocks stands s, the scale error of the sound speed, where that may be off.
//!
//! A packet becomes a list of [`Op`]s that is run for [`LANES`] particles at a time: their joint Gaussian stays in the
//! first-level cache from the first prediction to the last range.

mod operations;

pub use operations::{BLOCK, BlockLayout, Op, Prediction, RangeOp, packed, packed_len};

use super::dispatch;
use super::lookup::{Grid, Paired};
use super::math::ln;
use crate::measurement::range::{self as range_model, LateArrivals};
use crate::measurement::sounding as sounding_model;

/// Particles that are worked on together.
pub const LANES: usize = 8;
const E: usize = 0;
const N: usize = 1;
const B: usize = 2;

type Lane = [f64; LANES];

/// Standard deviation of the chart's error under a block.
#[derive(Debug, Clone, Copy)]
pub enum MapSigma<'a> {
    /// The same everywhere, m.
    Uniform(f64),
    /// One for each node of the chart, m; `fallback` where it is not finite.
    PerNode {
        /// Row-major, like the chart.
        sigma_m: &'a [f32],
        /// m.
        fallback: f64,
    },
}

/// Where soundings are looked up.
#[derive(Debug, Clone, Copy)]
pub struct Terrain<'a> {
    /// The chart proper: the centre of the five points must lie on it.
    pub chart: Grid<'a, Paired>,
    /// A copy with its holes filled: the outer four may lie on it.
    pub filled: Grid<'a, Paired>,
    /// Its error.
    pub sigma: MapSigma<'a>,
    /// Degrees of freedom of Student's t; infinite for a Gaussian.
    pub dof: f64,
}

/// Own positions of each particle at two instants: at the last launch, and at the packet's arrival.
#[derive(Debug, Clone, Copy)]
pub struct Own<'a> {
    /// [east, north] columns for each instant, m.
    pub at: [[&'a [f64]; 2]; 2],
}

/// The joint Gaussians of all particles.
pub struct Joints<'a> {
    /// Number of states.
    pub dim: usize,
    /// D columns of N.
    pub mean: &'a mut [f64],
    /// Packed rows of N, of the particles that `order` names.
    pub before: &'a [f64],
    /// Whose covariance each particle has.
    pub order: &'a [u32],
    /// Out: packed rows of N, in the particles' order.
    pub after: &'a mut [f64],
    /// Scratch, resized as needed.
    pub scratch: &'a mut Vec<Lane>,
}

/// What [`run`] does: operations on the block that starts at `base`.
pub struct BlockUpdates<'a> {
    /// First state of the sender's block.
    pub base: usize,
    /// Which states there are.
    pub layout: BlockLayout,
    /// In the order of time.
    pub ops: &'a [Op],
    /// None: soundings have no likelihood and change nothing.
    pub terrain: Option<Terrain<'a>>,
    /// Own positions.
    pub own: Own<'a>,
    /// What each particle says of the current that the sender shares, [east, north] columns, m/s.
    pub current: Option<[&'a [f64]; 2]>,
    /// Ranges that may come late; none: all are Gaussian.
    pub late: Option<LateArrivals>,
}

dispatch! {
    /// Runs a packet's operations for every particle.
    ///
    /// `log_likelihood` gets one column of N for each operation that weighs, in their order; NaN where a particle has
    /// no chart. `innovation` gets as many columns of innovations, and of their variances.
    pub fn run(
        updates: &BlockUpdates<'_>,
        joints: &mut Joints<'_>,
        log_likelihood: &mut [f64],
        innovation: &mut [&mut [f64]; 2],
    ) {
        let d = joints.dim;
        let n = joints.order.len();
        joints.scratch.resize(2 * d + packed_len(d), [0.0; LANES]);
        let (m, rest) = joints.scratch.split_at_mut(d);
        let (hp, p) = rest.split_at_mut(d);
        for first in (0..n).step_by(LANES) {
            let count = (n - first).min(LANES);
            for (k, m) in m.iter_mut().enumerate() {
                load(m, &joints.mean[k * n..(k + 1) * n], first, count);
            }
            // Lanes past the end repeat the last particle.
            let mut from = [0usize; LANES];
            for l in 0..LANES {
                from[l] = joints.order[first + l.min(count - 1)] as usize;
            }
            for (k, p) in p.iter_mut().enumerate() {
                let column = &joints.before[k * n..(k + 1) * n];
                for l in 0..LANES {
                    p[l] = column[from[l]];
                }
            }
            let mut current = [[0.0; LANES]; 2];
            if let Some([east, north]) = updates.current {
                load(&mut current[0], east, first, count);
                load(&mut current[1], north, first, count);
            }
            let mut row = 0;
            for op in updates.ops {
                let (ll, nu, s) = match *op {
                    Op::Predict(step) => {
                        add_scaled(&mut m[updates.base + E], step.dt_s, &current[0]);
                        add_scaled(&mut m[updates.base + N], step.dt_s, &current[1]);
                        predict(m, p, updates.base, &step);
                        if let Some(clock) = updates.layout.clock_of(updates.base) {
                            predict_clock(m, p, clock, &step);
                        }
                        continue;
                    }
                    Op::Sounding { water_depth_m, noise_m2, walk_m2, shared } => match &updates.terrain {
                        Some(terrain) => sounding(
                            m, p, hp, updates.base, terrain, water_depth_m, noise_m2, walk_m2, shared,
                        ),
                        None => ([f64::NAN; LANES], [0.0; LANES], [1.0; LANES]),
                    },
                    Op::Fix { position_m, variance_m2 } => {
                        fix(m, p, hp, updates.base, position_m, variance_m2)
                    }
                    Op::RangeToOwn { own, clock_sign, range: measured } => {
                        let [east, north] = updates.own.at[own & 1];
                        let mut at = [[0.0; LANES]; 2];
                        load(&mut at[0], east, first, count);
                        load(&mut at[1], north, first, count);
                        range(m, p, hp, updates, RangeTarget::Point(at, clock_sign), measured)
                    }
                    Op::RangeToBlock { base, range: measured } => {
                        range(m, p, hp, updates, RangeTarget::Block(base), measured)
                    }
                };
                let column = row * n..(row + 1) * n;
                store(&ll, &mut log_likelihood[column.clone()], first, count);
                store(&nu, &mut innovation[0][column.clone()], first, count);
                store(&s, &mut innovation[1][column], first, count);
                row += 1;
            }
            for (k, m) in m.iter().enumerate() {
                store(m, &mut joints.mean[k * n..(k + 1) * n], first, count);
            }
            for (k, p) in p.iter().enumerate() {
                store(p, &mut joints.after[k * n..(k + 1) * n], first, count);
            }
        }
    }
}

#[inline(always)]
fn load(lane: &mut Lane, column: &[f64], first: usize, count: usize) {
    if count == LANES {
        lane.copy_from_slice(&column[first..first + LANES]);
    } else {
        for l in 0..LANES {
            lane[l] = column[first + l.min(count - 1)];
        }
    }
}

#[inline(always)]
fn store(lane: &Lane, column: &mut [f64], first: usize, count: usize) {
    if count == LANES {
        column[first..first + LANES].copy_from_slice(lane);
    } else {
        column[first..first + count].copy_from_slice(&lane[..count]);
    }
}

/// x += a·y.
#[inline(always)]
fn add_scaled(x: &mut Lane, a: f64, y: &Lane) {
    for l in 0..LANES {
        x[l] += a * y[l];
    }
}

/// m, P ← F m + displacement, F P Fᵀ + Q for one block; the others keep their place and their correlation.
#[inline(always)]
fn predict(m: &mut [Lane], p: &mut [Lane], base: usize, step: &Prediction) {
    let dt = step.dt_s;
    let [de, dn] = step.displacement_m;
    let (te, tn) =
        if step.speed_mps > 0.05 { (de / step.speed_mps, dn / step.speed_mps) } else { (0.0, 0.0) };
    // Rows of F that are not the identity, over [c_e, c_n, heading, thrust].
    let f = [[dt, 0.0, dn, te], [0.0, dt, -de, tn]];
    let drive = [base + 3, base + 4, base + 5, base + 6];
    let (e, n) = (base + E, base + N);
    for (axis, by) in [(e, de), (n, dn)] {
        let mut moved = m[axis];
        for l in 0..LANES {
            moved[l] += by;
        }
        for k in 0..4 {
            add_scaled(&mut moved, f[axis - base][k], &m[drive[k]]);
        }
        m[axis] = moved;
    }
    let old: [[Lane; 4]; 2] = std::array::from_fn(|a| std::array::from_fn(|k| p[packed(base + a, drive[k])]));
    for j in (0..m.len()).filter(|j| *j != e && *j != n) {
        let (mut pe, mut pn) = (p[packed(e, j)], p[packed(n, j)]);
        for k in 0..4 {
            let x = p[packed(drive[k], j)];
            add_scaled(&mut pe, f[0][k], &x);
            add_scaled(&mut pn, f[1][k], &x);
        }
        p[packed(e, j)] = pe;
        p[packed(n, j)] = pn;
    }
    let (mut ee, mut en, mut nn) = (p[packed(e, e)], p[packed(n, e)], p[packed(n, n)]);
    for k in 0..4 {
        let (new_e, new_n) = (p[packed(e, drive[k])], p[packed(n, drive[k])]);
        for l in 0..LANES {
            ee[l] += f[0][k] * (old[0][k][l] + new_e[l]);
            en[l] += f[1][k] * new_e[l] + f[0][k] * old[1][k][l];
            nn[l] += f[1][k] * (old[1][k][l] + new_n[l]);
        }
    }
    // A walk of the current over a long step moves the position as well.
    let q = step.walk_per_s[0];
    let (position, coupled) = (dt * step.position_m2_per_s + q * dt * dt * dt / 3.0, 0.5 * q * dt * dt);
    for l in 0..LANES {
        ee[l] += position;
        nn[l] += position;
        p[packed(base + 3, e)][l] += coupled;
        p[packed(base + 4, n)][l] += coupled;
        for k in 0..4 {
            p[packed(drive[k], drive[k])][l] += dt * step.walk_per_s[if k < 2 { 0 } else { k - 1 }];
        }
    }
    p[packed(e, e)] = ee;
    p[packed(n, e)] = en;
    p[packed(n, n)] = nn;
}

/// β += Δt β̇ with its covariance; the clock's own walk.
#[inline(always)]
fn predict_clock(m: &mut [Lane], p: &mut [Lane], clock: usize, step: &Prediction) {
    let (dt, rate) = (step.dt_s, clock + 1);
    let by = m[rate];
    add_scaled(&mut m[clock], dt, &by);
    let old = p[packed(clock, rate)];
    for j in (0..m.len()).filter(|j| *j != clock) {
        let coupled = p[packed(rate, j)];
        add_scaled(&mut p[packed(clock, j)], dt, &coupled);
    }
    let new = p[packed(clock, rate)];
    let variance = &mut p[packed(clock, clock)];
    for l in 0..LANES {
        variance[l] += dt * (old[l] + new[l] + step.clock_m2_per_s);
    }
}

/// m += hp ν/s, P −= hp hpᵀ/s, with hp = P Hᵀ; `inverse` is 1/s, 0 where nothing is to change.
#[inline(always)]
fn update(m: &mut [Lane], p: &mut [Lane], hp: &[Lane], innovation: &Lane, inverse: &Lane) {
    let mut at = 0;
    for r in 0..m.len() {
        let mut gain = [0.0; LANES];
        for l in 0..LANES {
            gain[l] = hp[r][l] * inverse[l];
            m[r][l] += gain[l] * innovation[l];
        }
        for (p, hp) in p[at..=at + r].iter_mut().zip(hp) {
            for l in 0..LANES {
                p[l] -= gain[l] * hp[l];
            }
        }
        at += r + 1;
    }
}

/// A sounding: the chart statistically linearised over the block's position with five points (see the methods page).
#[inline(always)]
fn sounding(
    m: &mut [Lane],
    p: &mut [Lane],
    hp: &mut [Lane],
    base: usize,
    terrain: &Terrain<'_>,
    water_depth_m: f64,
    noise_m2: f64,
    walk_m2: f64,
    shared: f64,
) -> (Lane, Lane, Lane) {
    let (e, n, b) = (base + E, base + N, base + B);
    let (me, mn, mb) = (m[e], m[n], m[b]);
    for l in 0..LANES {
        p[packed(b, b)][l] += walk_m2;
    }
    let (mut l11, mut l21, mut l22) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
    for l in 0..LANES {
        [l11[l], l21[l], l22[l]] =
            sounding_model::position_factor([p[packed(e, e)][l], p[packed(n, e)][l], p[packed(n, n)][l]]);
    }
    let shifted = |se: f64, sn: f64| {
        let (mut x, mut y) = (me, mn);
        for l in 0..LANES {
            x[l] += sounding_model::OUTER * se * l11[l];
            y[l] += sounding_model::OUTER * (se * l21[l] + sn * l22[l]);
        }
        depths(&terrain.filled, &x, &y)
    };
    let (h1, h2) = (shifted(1.0, 0.0), shifted(-1.0, 0.0));
    let (h3, h4) = (shifted(0.0, 1.0), shifted(0.0, -1.0));
    let h0 = depths(&terrain.chart, &me, &mn);
    let sigma = sigma_map(terrain, &me, &mn);
    let (mut nu, mut rho, mut known) = ([0.0; LANES], [0.0; LANES], [false; LANES]);
    let (mut ge, mut gn) = ([0.0; LANES], [0.0; LANES]);
    for l in 0..LANES {
        let plane = sounding_model::plane([h0[l], h1[l], h2[l], h3[l], h4[l]], [l11[l], l21[l], l22[l]]);
        let on_chart = !plane.mean_m.is_nan();
        known[l] = on_chart;
        let innovation = water_depth_m - plane.mean_m - mb[l];
        nu[l] = if on_chart { innovation } else { 0.0 };
        rho[l] = if plane.residual_m2 > 0.0 { plane.residual_m2 } else { 0.0 };
        ge[l] = if on_chart { plane.gradient[0] } else { 0.0 };
        gn[l] = if on_chart { plane.gradient[1] } else { 0.0 };
    }
    for (r, hp) in hp.iter_mut().enumerate() {
        let (pe, pn, pb) = (&p[packed(r, e)], &p[packed(r, n)], &p[packed(r, b)]);
        for l in 0..LANES {
            hp[l] = ge[l] * pe[l] + gn[l] * pn[l] + pb[l];
        }
    }
    let (mut ll, mut s_out, mut inverse) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
    for l in 0..LANES {
        let spread = ge[l] * hp[e][l] + gn[l] * hp[n][l] + hp[b][l];
        let noise = noise_m2 + sigma[l] * sigma[l];
        let s = spread + noise + rho[l];
        let square = nu[l] * nu[l];
        let value = sounding_model::log_likelihood(square, s, terrain.dof);
        ll[l] = if known[l] { value / shared } else { f64::NAN };
        let r = shared * noise + rho[l];
        let inflation = sounding_model::inflation(square, spread + r, terrain.dof);
        inverse[l] = if known[l] { 1.0 / (spread + inflation * r) } else { 0.0 };
        s_out[l] = s;
    }
    update(m, p, hp, &nu, &inverse);
    (ll, nu, s_out)
}

/// A fix, one axis after the other.
#[inline(always)]
fn fix(
    m: &mut [Lane],
    p: &mut [Lane],
    hp: &mut [Lane],
    base: usize,
    position_m: [f64; 2],
    variance_m2: f64,
) -> (Lane, Lane, Lane) {
    let (mut ll, mut nu, mut s) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
    for axis in [E, N] {
        let state = base + axis;
        for (r, hp) in hp.iter_mut().enumerate() {
            *hp = p[packed(r, state)];
        }
        let mut inverse = [0.0; LANES];
        for l in 0..LANES {
            nu[l] = position_m[axis] - m[state][l];
            s[l] = hp[state][l] + variance_m2;
            inverse[l] = 1.0 / s[l];
            ll[l] -= 0.5 * (nu[l] * nu[l] * inverse[l] + ln(s[l]));
        }
        update(m, p, hp, &nu, &inverse);
    }
    (ll, nu, s)
}

/// The other end of a range: own positions with the sign of β, or another block.
enum RangeTarget {
    Point([Lane; 2], f64),
    Block(usize),
}

/// A range, second order in what stands across the line of sight.
#[inline(always)]
fn range(
    m: &mut [Lane],
    p: &mut [Lane],
    hp: &mut [Lane],
    updates: &BlockUpdates<'_>,
    target: RangeTarget,
    RangeOp { range_m, variance_m2 }: RangeOp,
) -> (Lane, Lane, Lane) {
    let (base, layout) = (updates.base, updates.layout);
    let (e, n) = (base + E, base + N);
    let (at, a) = match target {
        RangeTarget::Point(at, _) => (at, [p[packed(e, e)], p[packed(n, e)], p[packed(n, n)]]),
        RangeTarget::Block(other) => {
            let (oe, on) = (other + E, other + N);
            let mut a = [[0.0; LANES]; 3];
            for l in 0..LANES {
                a[0][l] = p[packed(e, e)][l] + p[packed(oe, oe)][l] - 2.0 * p[packed(e, oe)][l];
                a[1][l] =
                    p[packed(n, e)][l] + p[packed(on, oe)][l] - p[packed(n, oe)][l] - p[packed(e, on)][l];
                a[2][l] = p[packed(n, n)][l] + p[packed(on, on)][l] - 2.0 * p[packed(n, on)][l];
            }
            ([m[oe], m[on]], a)
        }
    };
    let (mut ue, mut un, mut nu, mut s) = ([0.0; LANES], [0.0; LANES], [0.0; LANES], [0.0; LANES]);
    let mut length = [0.0; LANES];
    for l in 0..LANES {
        let relative = [m[e][l] - at[0][l], m[n][l] - at[1][l]];
        let expected = range_model::expected(relative, [a[0][l], a[1][l], a[2][l]]);
        [ue[l], un[l]] = expected.direction;
        nu[l] = expected.innovation(range_m);
        s[l] = variance_m2 + expected.curvature_m2();
        length[l] = expected.distance_m + 0.5 * expected.curvature_m;
    }
    // (1 + s) D, which a scale error lengthens.
    if layout.scale {
        for l in 0..LANES {
            let scale = m[0][l];
            nu[l] -= scale * length[l];
            ue[l] *= 1.0 + scale;
            un[l] *= 1.0 + scale;
        }
    }
    // States that a range sees with a constant: the clock differences of its two ends.
    let mut clocks = [None, None];
    if let Some(clock) = layout.clock_of(base) {
        clocks = match target {
            RangeTarget::Point(_, sign) => [Some((clock, sign)), None],
            RangeTarget::Block(other) => [Some((clock, -1.0)), Some((other + BLOCK, 1.0))],
        };
    }
    for (clock, sign) in clocks.into_iter().flatten() {
        let beta = m[clock];
        add_scaled(&mut nu, -sign, &beta);
    }
    for (r, hp) in hp.iter_mut().enumerate() {
        let (pe, pn) = (&p[packed(r, e)], &p[packed(r, n)]);
        for l in 0..LANES {
            hp[l] = ue[l] * pe[l] + un[l] * pn[l];
        }
        if let RangeTarget::Block(other) = target {
            let (pe, pn) = (&p[packed(r, other + E)], &p[packed(r, other + N)]);
            for l in 0..LANES {
                hp[l] -= ue[l] * pe[l] + un[l] * pn[l];
            }
        }
        if layout.scale {
            let scale = &p[packed(r, 0)];
            for l in 0..LANES {
                hp[l] += length[l] * scale[l];
            }
        }
        for (clock, sign) in clocks.into_iter().flatten() {
            add_scaled(hp, sign, &p[packed(r, clock)]);
        }
    }
    let mut spread = [0.0; LANES];
    for l in 0..LANES {
        spread[l] = ue[l] * hp[e][l] + un[l] * hp[n][l];
    }
    if let RangeTarget::Block(other) = target {
        for l in 0..LANES {
            spread[l] -= ue[l] * hp[other + E][l] + un[l] * hp[other + N][l];
        }
    }
    if layout.scale {
        for l in 0..LANES {
            spread[l] += length[l] * hp[0][l];
        }
    }
    for (clock, sign) in clocks.into_iter().flatten() {
        add_scaled(&mut spread, sign, &hp[clock]);
    }
    for l in 0..LANES {
        s[l] += if spread[l] > 0.0 { spread[l] } else { 0.0 };
    }
    if let Some(late) = &updates.late {
        let ll = late_update(m, p, hp, late, &nu, &s);
        return (ll, nu, s);
    }
    let (mut ll, mut inverse) = ([0.0; LANES], [0.0; LANES]);
    for l in 0..LANES {
        inverse[l] = 1.0 / s[l];
        ll[l] = -0.5 * (nu[l] * nu[l] * inverse[l] + ln(s[l]));
    }
    update(m, p, hp, &nu, &inverse);
    (ll, nu, s)
}

/// A range that may be late: m −= hp g, P += hp hpᵀ g₂ with g, g₂ the derivatives of ln Z.
#[inline(always)]
fn late_update(
    m: &mut [Lane],
    p: &mut [Lane],
    hp: &[Lane],
    late: &LateArrivals,
    nu: &Lane,
    s: &Lane,
) -> Lane {
    let (mut ll, mut slope, mut inverse) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
    for l in 0..LANES {
        let likelihood = late.likelihood(nu[l], s[l]);
        ll[l] = likelihood.log_z;
        slope[l] = likelihood.slope;
        inverse[l] = -likelihood.curvature;
    }
    for (m, hp) in m.iter_mut().zip(hp) {
        for l in 0..LANES {
            m[l] -= hp[l] * slope[l];
        }
    }
    // The mean has moved; what is left is the covariance.
    update(m, p, hp, &[0.0; LANES], &inverse);
    ll
}

/// Bilinear depths; NaN off the grid or where one of the four nodes is a hole.
#[inline(always)]
fn depths(grid: &Grid<'_, Paired>, east_m: &Lane, north_m: &Lane) -> Lane {
    let inverse = 1.0 / grid.cell_m;
    let (last_e, last_n) = ((grid.cols - 1) as f64, (grid.rows - 1) as f64);
    let (mut index, mut fe, mut fn_) = ([0usize; LANES], [0.0f32; LANES], [0.0f32; LANES]);
    let mut inside = [false; LANES];
    for l in 0..LANES {
        let (x, y) = ((east_m[l] - grid.east0_m) * inverse, (north_m[l] - grid.north0_m) * inverse);
        inside[l] = x >= 0.0 && y >= 0.0 && x <= last_e && y <= last_n;
        // The last node belongs to the last cell; what is outside (or NaN) reads the first cell and is dropped.
        let x = if inside[l] { x } else { 0.0 };
        let y = if inside[l] { y } else { 0.0 };
        let (column, row) = ((x as i32).min(grid.cols as i32 - 2), (y as i32).min(grid.rows as i32 - 2));
        fe[l] = (x - f64::from(column)) as f32;
        fn_[l] = (y - f64::from(row)) as f32;
        index[l] = row as usize * grid.cols + column as usize;
    }
    let mut out = [0.0; LANES];
    for l in 0..LANES {
        let at = index[l];
        debug_assert!(at + 1 < grid.values.len());
        // SAFETY: column ≤ cols − 2 and row ≤ rows − 2, so the west and the east of the cell are on the grid.
        let ([sw, nw], [se, ne]) =
            unsafe { (*grid.values.get_unchecked(at), *grid.values.get_unchecked(at + 1)) };
        let south = sw + fe[l] * (se - sw);
        let north = nw + fe[l] * (ne - nw);
        let depth = f64::from(south + fn_[l] * (north - south));
        out[l] = if inside[l] { depth } else { f64::NAN };
    }
    out
}

/// Standard deviation of the chart's error at the nearest node.
#[inline(always)]
fn sigma_map(terrain: &Terrain<'_>, east_m: &Lane, north_m: &Lane) -> Lane {
    match terrain.sigma {
        MapSigma::Uniform(sigma) => [sigma; LANES],
        MapSigma::PerNode { sigma_m, fallback } => {
            let grid = &terrain.chart;
            let mut out = [fallback; LANES];
            for l in 0..LANES {
                let column = ((east_m[l] - grid.east0_m) / grid.cell_m + 0.5).floor();
                let row = ((north_m[l] - grid.north0_m) / grid.cell_m + 0.5).floor();
                if column >= 0.0 && row >= 0.0 && column < grid.cols as f64 && row < grid.rows as f64 {
                    let at = row as usize * grid.cols + column as usize;
                    if let Some(sigma) = sigma_m.get(at).filter(|s| s.is_finite() && **s >= 0.0) {
                        out[l] = f64::from(*sigma);
                    }
                }
            }
            out
        }
    }
}
