//! Propagation of particles with their marginalised Kalman states, roughening, Liu–West jitter, gathering.

use nalgebra::{Matrix2, SMatrix};

use super::dispatch;
use super::philox::{PAIRS, StreamKey, pairs};

/// Most Kalman states that a particle carries: current (2), compass bias, thrust bias.
pub const MAX_LINEAR: usize = 4;

/// One propagation step, everything that is common to all particles.
///
/// With F the 2 × K map from linear states to displacement and S = F P Fᵀ + Q (5)–(8): `innovation_m2` = S,
/// `root` = chol(S) (lower), `gain` = P Fᵀ S⁻¹, `map` = F.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ParticleStep<const K: usize> {
    /// Commanded displacement, m.
    pub displacement_m: [f64; 2],
    /// F.
    pub map: [[f64; K]; 2],
    /// S as [ee, en, nn].
    pub innovation_m2: [f64; 3],
    /// Lower Cholesky factor [l11, l21, l22] of S.
    pub root: [f64; 3],
    /// P Fᵀ S⁻¹, K rows.
    pub gain: [[f64; 2]; K],
}

/// Lower Cholesky factor [l11, l21, l22] of a symmetric positive semi-definite 2 × 2 matrix [xx, xy, yy].
#[must_use]
pub fn cholesky_2x2([xx, xy, yy]: [f64; 3]) -> [f64; 3] {
    let l11 = xx.max(0.0).sqrt();
    let l21 = if l11 > 0.0 { xy / l11 } else { 0.0 };
    [l11, l21, (yy - l21 * l21).max(0.0).sqrt()]
}

/// F for K = 2 (current) or K = 4 (current, compass bias, thrust bias): Δt[I₂, (u_n, −u_e)ᵀ, u/|u|].
#[must_use]
pub fn displacement_map<const K: usize>(velocity_mps: [f64; 2], dt_s: f64) -> [[f64; K]; 2] {
    let mut map = [[0.0; K]; 2];
    map[0][0] = dt_s;
    map[1][1] = dt_s;
    if K == MAX_LINEAR {
        let [ue, un] = velocity_mps;
        let speed = ue.hypot(un);
        map[0][2] = dt_s * un;
        map[1][2] = -dt_s * ue;
        if speed > 0.0 {
            map[0][3] = dt_s * ue / speed;
            map[1][3] = dt_s * un / speed;
        }
    }
    map
}

/// Prepares a step and advances the shared covariance: P ← P − P Fᵀ S⁻¹ F P + Q_kf (8).
///
/// `q_position` is Q_pf over the step [ee, en, nn], m²; `q_linear` is Q_kf over the step.
#[must_use]
pub fn prepare_step<const K: usize>(
    covariance: &mut SMatrix<f64, K, K>,
    velocity_mps: [f64; 2],
    dt_s: f64,
    q_position: [f64; 3],
    q_linear: &SMatrix<f64, K, K>,
) -> ParticleStep<K> {
    let map = displacement_map::<K>(velocity_mps, dt_s);
    let f = SMatrix::<f64, 2, K>::from_fn(|r, c| map[r][c]);
    let cross: SMatrix<f64, K, 2> = *covariance * f.transpose();
    let s: Matrix2<f64> =
        f * cross + Matrix2::new(q_position[0], q_position[1], q_position[1], q_position[2]);
    // Without noise and without uncertainty nothing is learnt from a displacement.
    let gain = s.try_inverse().map_or_else(SMatrix::<f64, K, 2>::zeros, |inverse| cross * inverse);
    let updated = *covariance - gain * cross.transpose() + q_linear;
    *covariance = (updated + updated.transpose()) * 0.5;
    let mut rows = [[0.0; 2]; K];
    for (k, row) in rows.iter_mut().enumerate() {
        *row = [gain[(k, 0)], gain[(k, 1)]];
    }
    let innovation_m2 = [s[(0, 0)], s[(0, 1)], s[(1, 1)]];
    ParticleStep {
        displacement_m: [velocity_mps[0] * dt_s, velocity_mps[1] * dt_s],
        map,
        innovation_m2,
        root: cholesky_2x2(innovation_m2),
        gain: rows,
    }
}

impl<const K: usize> ParticleStep<K> {
    /// p += F c + u Δt + ζ, c += P Fᵀ S⁻¹ ζ with ζ = chol(S) n (5)–(8), over columns of one length.
    #[inline(always)]
    fn apply(
        &self,
        east: &mut [f64],
        north: &mut [f64],
        linear: &mut [&mut [f64]; K],
        normals: impl Fn(usize) -> (f64, f64),
    ) {
        let n = east.len();
        let north = &mut north[..n];
        let mut columns = linear.each_mut().map(|c| &mut c[..n]);
        for i in 0..n {
            let (a, b) = normals(i);
            let ze = self.root[0] * a;
            let zn = self.root[1] * a + self.root[2] * b;
            let (mut de, mut dn) = (self.displacement_m[0] + ze, self.displacement_m[1] + zn);
            for (k, c) in columns.iter_mut().enumerate() {
                let value = c[i];
                de += self.map[0][k] * value;
                dn += self.map[1][k] * value;
                c[i] = value + self.gain[k][0] * ze + self.gain[k][1] * zn;
            }
            east[i] += de;
            north[i] += dn;
        }
    }
}

dispatch! {
    /// p += F c + u Δt + ζ, c += P Fᵀ S⁻¹ ζ with ζ = chol(S) n, n the normals `a`, `b` (5)–(8).
    pub fn propagate<const K: usize>(
        step: &ParticleStep<K>,
        east: &mut [f64],
        north: &mut [f64],
        linear: &mut [Vec<f64>; K],
        a: &[f64],
        b: &[f64],
    ) {
        let n = east.len().min(north.len()).min(a.len()).min(b.len());
        let (a, b) = (&a[..n], &b[..n]);
        let mut columns = linear.each_mut().map(|c| &mut c[..n]);
        step.apply(&mut east[..n], &mut north[..n], &mut columns, |i| (a[i], b[i]));
    }
}

dispatch! {
    /// [`propagate`] with the normal pairs of the stream's lane 0, which never leave the cache.
    pub fn propagate_drawn<const K: usize>(
        step: &ParticleStep<K>,
        stream: &StreamKey,
        east: &mut [f64],
        north: &mut [f64],
        linear: &mut [Vec<f64>; K],
    ) {
        let n = east.len().min(north.len());
        let mut first = 0;
        while first + PAIRS <= n {
            let [a, b] = pairs(stream, 0, first / PAIRS);
            let here = first..first + PAIRS;
            let mut columns = linear.each_mut().map(|c| &mut c[here.clone()]);
            step.apply(&mut east[here.clone()], &mut north[here.clone()], &mut columns, |i| {
                (f64::from(a[i]), f64::from(b[i]))
            });
            first += PAIRS;
        }
        if first < n {
            let [a, b] = pairs(stream, 0, first / PAIRS);
            let mut columns = linear.each_mut().map(|c| &mut c[first..n]);
            step.apply(&mut east[first..n], &mut north[first..n], &mut columns, |i| {
                (f64::from(a[i]), f64::from(b[i]))
            });
        }
    }
}

/// Moves every copy of a particle that was copied more than once by √variance · n.
pub fn roughen(
    east: &mut [f64],
    north: &mut [f64],
    ancestors: &[u32],
    counts: &[u32],
    variance_m2: f64,
    a: &[f64],
    b: &[f64],
) {
    let sigma = variance_m2.sqrt();
    let moved = east.iter_mut().zip(north).zip(a.iter().zip(b)).zip(ancestors);
    for (((e, n), (a, b)), &parent) in moved {
        let sigma = sigma * f64::from(u8::from(counts[parent as usize] > 1));
        *e += sigma * a;
        *n += sigma * b;
    }
}

dispatch! {
    /// [`roughen`] with the normal pairs of the stream's lane 0; copies are neighbours, as `ancestors` are ascending.
    pub fn roughen_drawn(
        east: &mut [f64],
        north: &mut [f64],
        ancestors: &[u32],
        variance_m2: f64,
        stream: &StreamKey,
    ) {
        let sigma = variance_m2.sqrt();
        let n = east.len().min(north.len()).min(ancestors.len());
        for (go, (east, north)) in east[..n].chunks_mut(PAIRS).zip(north[..n].chunks_mut(PAIRS)).enumerate() {
            let [a, b] = pairs(stream, 0, go);
            let near = neighbourhood(&ancestors[..n], go * PAIRS);
            for (l, (e, n)) in east.iter_mut().zip(north).enumerate() {
                // A factor, not a branch: which particles have copies cannot be predicted.
                let copied = (near[l + 1] == near[l]) | (near[l + 1] == near[l + 2]);
                let sigma = if copied { sigma } else { 0.0 };
                *e += sigma * f64::from(a[l]);
                *n += sigma * f64::from(b[l]);
            }
        }
    }
}

/// Ancestors of the particles `first..first + PAIRS` and one on each side; off the ends, one that no particle has.
#[inline(always)]
fn neighbourhood(ancestors: &[u32], first: usize) -> [u32; PAIRS + 2] {
    let whole = first.checked_sub(1).and_then(|from| ancestors.get(from..from + PAIRS + 2));
    if let Some(Ok(near)) = whole.map(<[u32; PAIRS + 2]>::try_from) {
        return near;
    }
    let mut near = [u32::MAX; PAIRS + 2];
    let (from, to) = (first.max(1) - 1, (first + PAIRS + 1).min(ancestors.len()));
    near[from + 1 - first..to + 1 - first].copy_from_slice(&ancestors[from..to]);
    near
}

/// Replaces `column` by its entries at `ancestors`, through `scratch` of the same length.
pub fn gather(column: &mut Vec<f64>, scratch: &mut Vec<f64>, ancestors: &[u32]) {
    for (s, &a) in scratch.iter_mut().zip(ancestors) {
        *s = column[a as usize];
    }
    std::mem::swap(column, scratch);
}

/// The bandwidth of Liu–West for N particles: ½(4/6N)^{1/8}.
#[must_use]
pub fn liu_west_bandwidth(particles: usize) -> f64 {
    0.5 * (4.0 / (6.0 * particles as f64)).powf(0.125)
}

/// Largest joint state that Liu–West moves: position, offset, linear states.
pub const MAX_JOINT: usize = 3 + MAX_LINEAR;

dispatch! {
    /// Liu–West on equally weighted columns: x ← μ + √(1−h²)(x − μ) + h chol(C) n, with C the cloud's own covariance.
    ///
    /// `normals` holds one slice for each column. A column without spread stays as it is.
    pub fn liu_west<const D: usize>(columns: &mut [&mut [f64]; D], bandwidth: f64, normals: &[&[f64]; D]) {
        let count = columns.iter().map(|c| c.len()).chain(normals.iter().map(|n| n.len())).min().unwrap_or(0);
        if count == 0 {
            return;
        }
        let inverse = 1.0 / count as f64;
        let mean: [f64; D] = std::array::from_fn(|d| sum(&columns[d][..count]) * inverse);
        let mut covariance = SMatrix::<f64, D, D>::zeros();
        for r in 0..D {
            for c in 0..=r {
                let products = product_sum(&columns[r][..count], mean[r], &columns[c][..count], mean[c]);
                covariance[(r, c)] = products * inverse;
                covariance[(c, r)] = covariance[(r, c)];
            }
        }
        // A trace of jitter keeps the factor defined where columns are linearly dependent.
        for d in 0..D {
            covariance[(d, d)] += 1e-9 * covariance[(d, d)] + 1e-14;
        }
        let Some(root) = covariance.cholesky().map(|c| c.l()) else { return };
        let shrink = (1.0 - bandwidth * bandwidth).sqrt();
        for d in 0..D {
            let (column, mean) = (&mut columns[d][..count], mean[d]);
            for x in &mut *column {
                *x = mean + shrink * (*x - mean);
            }
            for k in 0..=d {
                let factor = bandwidth * root[(d, k)];
                for (x, n) in column.iter_mut().zip(normals[k]) {
                    *x += factor * n;
                }
            }
        }
    }
}

/// Σ x in eight interleaved lanes: vectorises, and its order depends on the length alone.
#[inline(always)]
pub(super) fn sum(x: &[f64]) -> f64 {
    let (whole, rest) = x.as_chunks::<8>();
    let mut sums = [0.0; 8];
    for x in whole {
        for l in 0..8 {
            sums[l] += x[l];
        }
    }
    sums.iter().sum::<f64>() + rest.iter().sum::<f64>()
}

/// Σ (x − mx)(y − my), likewise.
#[inline(always)]
pub(super) fn product_sum(x: &[f64], mx: f64, y: &[f64], my: f64) -> f64 {
    let ((x, x_rest), (y, y_rest)) = (x.as_chunks::<8>(), y.as_chunks::<8>());
    let mut sums = [0.0; 8];
    for (x, y) in x.iter().zip(y) {
        for l in 0..8 {
            sums[l] += (x[l] - mx) * (y[l] - my);
        }
    }
    sums.iter().sum::<f64>() + x_rest.iter().zip(y_rest).map(|(x, y)| (x - mx) * (y - my)).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::philox::normal_pairs;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn drawing_within_the_loop_is_drawing_before(n in 1usize..200, seed: [u32; 2], copies in prop::collection::vec(0u32..4, 1..200)) {
            let stream = StreamKey { seed, step: 9, who: 2 };
            let (mut a, mut b) = (vec![0.0; n], vec![0.0; n]);
            normal_pairs(&stream, 0, &mut a, &mut b);
            let mut p = Matrix2::new(0.09, 0.02, 0.02, 0.04);
            let step: ParticleStep<2> = prepare_step(&mut p, [1.5, -0.4], 1.0, [0.01, 0.001, 0.02], &Matrix2::zeros());
            let column = |k: f64| (0..n).map(|i| k * i as f64).collect::<Vec<_>>();
            let start = || (column(1.0), column(-2.0), [column(0.01), column(-0.02)]);
            let (mut e0, mut n0, mut c0) = start();
            propagate(&step, &mut e0, &mut n0, &mut c0, &a, &b);
            let (mut e1, mut n1, mut c1) = start();
            propagate_drawn(&step, &stream, &mut e1, &mut n1, &mut c1);
            prop_assert_eq!((&e0, &n0, &c0), (&e1, &n1, &c1));

            let mut ancestors: Vec<u32> =
                copies.iter().enumerate().flat_map(|(i, c)| std::iter::repeat_n(i as u32, *c as usize)).collect();
            ancestors.resize(n, 300);
            let mut counts = vec![0; 301];
            ancestors.iter().for_each(|a| counts[*a as usize] += 1);
            roughen(&mut e0, &mut n0, &ancestors, &counts, 2.0, &a, &b);
            roughen_drawn(&mut e1, &mut n1, &ancestors, 2.0, &stream);
            prop_assert_eq!((e0, n0), (e1, n1));
        }
    }
}
