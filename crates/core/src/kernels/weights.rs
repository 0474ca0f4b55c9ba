//! Log-weights to weights, effective sample size, moments, kernel entropy, residual resampling.

use super::dispatch;
use super::math::{exp, floor_split};

const LANES: usize = 8;

/// Sum in eight interleaved lanes: vectorises, and its order depends on the length alone.
#[inline(always)]
fn lane_sum(lanes: [f64; LANES]) -> f64 {
    ((lanes[0] + lanes[4]) + (lanes[2] + lanes[6])) + ((lanes[1] + lanes[5]) + (lanes[3] + lanes[7]))
}

dispatch! {
    /// Normalises `log_weights` in place and writes the weights; returns (ln of the sum before, Σ w²).
    ///
    /// If no log-weight is finite, nothing changes and `None` is returned. A NaN counts as −∞.
    pub fn normalise(log_weights: &mut [f64], weights: &mut [f64]) -> Option<(f64, f64)> {
        let mut max = [f64::NEG_INFINITY; LANES];
        let (whole, rest) = log_weights.as_chunks::<LANES>();
        for x in whole {
            for l in 0..LANES {
                max[l] = if x[l] > max[l] { x[l] } else { max[l] };
            }
        }
        for (m, &x) in max.iter_mut().zip(rest) {
            *m = if x > *m { x } else { *m };
        }
        exponentiate(max, log_weights, weights)
    }
}

dispatch! {
    /// Adds `prior` to `log_weights` and does as [`normalise`]; without a finite sum, `log_weights` end as the sums.
    pub fn update(prior: &[f64], log_weights: &mut [f64], weights: &mut [f64]) -> Option<(f64, f64)> {
        let n = prior.len().min(log_weights.len());
        let mut max = [f64::NEG_INFINITY; LANES];
        let (whole, rest) = log_weights[..n].as_chunks_mut::<LANES>();
        let (prior, prior_rest) = prior[..n].as_chunks::<LANES>();
        for (x, p) in whole.iter_mut().zip(prior) {
            for l in 0..LANES {
                x[l] += p[l];
                max[l] = if x[l] > max[l] { x[l] } else { max[l] };
            }
        }
        for ((m, x), p) in max.iter_mut().zip(rest).zip(prior_rest) {
            *x += p;
            *m = if *x > *m { *x } else { *m };
        }
        exponentiate(max, &mut log_weights[..n], weights)
    }
}

/// The rest of [`normalise`], from the greatest log-weight of each lane on.
#[inline(always)]
fn exponentiate(max: [f64; LANES], log_weights: &mut [f64], weights: &mut [f64]) -> Option<(f64, f64)> {
    /// Weights that are summed while they are in the nearest cache. Maps and sums are loops of their own: only so does
    /// each vectorise.
    const PART: usize = 32 * LANES;
    let n = log_weights.len().min(weights.len());
    let (log_weights, weights) = (&mut log_weights[..n], &mut weights[..n]);
    let top = max.iter().fold(f64::NEG_INFINITY, |a, &b| if b > a { b } else { a });
    if !top.is_finite() {
        return None;
    }
    let (mut sums, mut squares) = ([0.0; LANES], [0.0; LANES]);
    for (weights, logs) in weights.chunks_mut(PART).zip(log_weights.chunks(PART)) {
        for (w, &x) in weights.iter_mut().zip(logs) {
            let shifted = x - top;
            let value = exp(shifted);
            // NaN fails the comparison as well and gets no weight.
            *w = if shifted > -700.0 { value } else { 0.0 };
        }
        let (whole, rest) = weights.as_chunks::<LANES>();
        for w in whole {
            for l in 0..LANES {
                sums[l] += w[l];
                squares[l] += w[l] * w[l];
            }
        }
        for ((sum, square), w) in sums.iter_mut().zip(&mut squares).zip(rest) {
            *sum += w;
            *square += w * w;
        }
    }
    let total = lane_sum(sums);
    let inverse = 1.0 / total;
    let log_total = top + total.ln();
    for (w, x) in weights.iter_mut().zip(&mut *log_weights) {
        *w *= inverse;
        let log_weight = *x - log_total;
        *x = if log_weight > -1e300 { log_weight } else { -1e300 };
    }
    Some((log_total, lane_sum(squares) * inverse * inverse))
}

dispatch! {
    /// Of the particles whose log-likelihood is not NaN: the greatest log-likelihood (−∞ for none) and their weight.
    pub fn known_share(log_likelihood: &[f64], weights: &[f64]) -> (f64, f64) {
        let n = log_likelihood.len().min(weights.len());
        let (l, l_rest) = log_likelihood[..n].as_chunks::<LANES>();
        let (w, w_rest) = weights[..n].as_chunks::<LANES>();
        let (mut top, mut share) = ([f64::NEG_INFINITY; LANES], [0.0; LANES]);
        for (l, w) in l.iter().zip(w) {
            for k in 0..LANES {
                top[k] = if l[k] > top[k] { l[k] } else { top[k] };
                share[k] += if l[k].is_nan() { 0.0 } else { w[k] };
            }
        }
        for (k, (l, w)) in l_rest.iter().zip(w_rest).enumerate() {
            top[k] = if *l > top[k] { *l } else { top[k] };
            share[k] += if l.is_nan() { 0.0 } else { *w };
        }
        (top.into_iter().fold(f64::NEG_INFINITY, f64::max), lane_sum(share))
    }
}

dispatch! {
    /// Effective sample size of the weights exp(a + b), not normalised; 0 if none is finite.
    pub fn ess_after(a: &[f64], b: &[f64]) -> f64 {
        let mut top = f64::NEG_INFINITY;
        for (a, b) in a.iter().zip(b) {
            let sum = a + b;
            top = if sum > top { sum } else { top };
        }
        if !top.is_finite() {
            return 0.0;
        }
        let (mut sums, mut squares) = ([0.0; LANES], [0.0; LANES]);
        for (a, b) in a.chunks(LANES).zip(b.chunks(LANES)) {
            for (((a, b), sum), square) in a.iter().zip(b).zip(&mut sums).zip(&mut squares) {
                let shifted = a + b - top;
                let w = if shifted > -40.0 { exp(shifted) } else { 0.0 };
                *sum += w;
                *square += w * w;
            }
        }
        let sum = lane_sum(sums);
        sum * sum / lane_sum(squares)
    }
}

/// Effective sample size 1 / Σ w² (13) of normalised weights.
#[must_use]
pub fn effective_sample_size(weights: &[f64]) -> f64 {
    1.0 / weights.iter().map(|w| w * w).sum::<f64>()
}

dispatch! {
    /// Σ w x of one column.
    pub fn weighted_mean(weights: &[f64], x: &[f64]) -> f64 {
        let n = weights.len().min(x.len());
        let ((w, w_rest), (x, x_rest)) = (weights[..n].as_chunks::<LANES>(), x[..n].as_chunks::<LANES>());
        let mut sums = [0.0; LANES];
        for (w, x) in w.iter().zip(x) {
            for l in 0..LANES {
                sums[l] += w[l] * x[l];
            }
        }
        for ((w, x), s) in w_rest.iter().zip(x_rest).zip(&mut sums) {
            *s += w * x;
        }
        lane_sum(sums)
    }
}

dispatch! {
    /// Σ w (x − mx)(y − my) of two columns.
    pub fn weighted_covariance(weights: &[f64], x: &[f64], mx: f64, y: &[f64], my: f64) -> f64 {
        let n = weights.len().min(x.len()).min(y.len());
        let (w, w_rest) = weights[..n].as_chunks::<LANES>();
        let ((x, x_rest), (y, y_rest)) = (x[..n].as_chunks::<LANES>(), y[..n].as_chunks::<LANES>());
        let mut sums = [0.0; LANES];
        for ((w, x), y) in w.iter().zip(x).zip(y) {
            for l in 0..LANES {
                sums[l] += w[l] * (x[l] - mx) * (y[l] - my);
            }
        }
        for (((w, x), y), s) in w_rest.iter().zip(x_rest).zip(y_rest).zip(&mut sums) {
            *s += w * (x - mx) * (y - my);
        }
        lane_sum(sums)
    }
}

dispatch! {
    /// Σ w x of K columns.
    pub fn weighted_means<const K: usize>(weights: &[f64], columns: &[&[f64]; K]) -> [f64; K] {
        let n = columns.iter().map(|c| c.len()).min().unwrap_or(0).min(weights.len());
        let (w, w_rest) = weights[..n].as_chunks::<LANES>();
        let split = columns.map(|c| c[..n].as_chunks::<LANES>());
        let mut sums = [[0.0; LANES]; K];
        for (i, w) in w.iter().enumerate() {
            for (sums, (x, _)) in sums.iter_mut().zip(&split) {
                for l in 0..LANES {
                    sums[l] += w[l] * x[i][l];
                }
            }
        }
        for (sums, (_, x)) in sums.iter_mut().zip(&split) {
            for ((w, x), s) in w_rest.iter().zip(*x).zip(sums) {
                *s += w * x;
            }
        }
        sums.map(lane_sum)
    }
}

dispatch! {
    /// Mean (10) and covariance (11) of positions: (mean, [ee, en, nn]).
    pub fn moments(weights: &[f64], east: &[f64], north: &[f64]) -> ([f64; 2], [f64; 3]) {
        let n = weights.len().min(east.len()).min(north.len());
        let mean = weighted_means(weights, &[&east[..n], &north[..n]]);
        let mut sums = [[0.0; LANES]; 3];
        let products = |sums: &mut [[f64; LANES]; 3], l: usize, w: f64, e: f64, n: f64| {
            let (de, dn) = (e - mean[0], n - mean[1]);
            let (we, wn) = (w * de, w * dn);
            sums[0][l] += we * de;
            sums[1][l] += we * dn;
            sums[2][l] += wn * dn;
        };
        let (w, w_rest) = weights[..n].as_chunks::<LANES>();
        let ((e, e_rest), (n_, n_rest)) = (east[..n].as_chunks::<LANES>(), north[..n].as_chunks::<LANES>());
        for ((w, e), n) in w.iter().zip(e).zip(n_) {
            for l in 0..LANES {
                products(&mut sums, l, w[l], e[l], n[l]);
            }
        }
        for (l, ((w, e), n)) in w_rest.iter().zip(e_rest).zip(n_rest).enumerate() {
            products(&mut sums, l, *w, *e, *n);
        }
        (mean, sums.map(lane_sum))
    }
}

/// Kernel entropy −Σ w_i ln Σ_j w_j exp(−½‖x_i − x_j‖²/σ²) (20)–(21); O(N²).
#[must_use]
pub fn kernel_entropy(weights: &[f64], east: &[f64], north: &[f64], sigma_m: f64) -> f64 {
    let mut entropy = 0.0;
    for (i, &wi) in weights.iter().enumerate() {
        if wi > 0.0 {
            let here = [east[i], north[i]];
            entropy -= wi * kernel_densities(weights, weights, east, north, here, sigma_m)[0].ln();
        }
    }
    entropy
}

/// By how much new weights lower the kernel entropy (19) of the same particles; the kernel of each pair is found once.
#[must_use]
pub fn entropy_drop(before: &[f64], after: &[f64], east: &[f64], north: &[f64], sigma_m: f64) -> f64 {
    let mut drop = 0.0;
    for i in 0..before.len() {
        let (was, is) = (before[i], after[i]);
        if was > 0.0 || is > 0.0 {
            let [old, new] = kernel_densities(before, after, east, north, [east[i], north[i]], sigma_m);
            drop -= if was > 0.0 { was * old.ln() } else { 0.0 };
            drop += if is > 0.0 { is * new.ln() } else { 0.0 };
        }
    }
    drop
}

dispatch! {
    /// Σ_j w_j exp(−½‖x − x_j‖²/σ²) at one place, for two sets of weights.
    fn kernel_densities(
        before: &[f64],
        after: &[f64],
        east: &[f64],
        north: &[f64],
        here: [f64; 2],
        sigma_m: f64,
    ) -> [f64; 2] {
        let scale = -0.5 / (sigma_m * sigma_m);
        let (mut old, mut new) = ([0.0; LANES], [0.0; LANES]);
        let (es, rest_e) = east.as_chunks::<LANES>();
        let (ns, rest_n) = north.as_chunks::<LANES>();
        let (bs, rest_b) = before.as_chunks::<LANES>();
        let (ws, rest_w) = after.as_chunks::<LANES>();
        for (((e, n), b), a) in es.iter().zip(ns).zip(bs).zip(ws) {
            for l in 0..LANES {
                let (de, dn) = (here[0] - e[l], here[1] - n[l]);
                let kernel = exp(scale * (de * de + dn * dn));
                old[l] += b[l] * kernel;
                new[l] += a[l] * kernel;
            }
        }
        for (l, (((e, n), b), a)) in rest_e.iter().zip(rest_n).zip(rest_b).zip(rest_w).enumerate() {
            let (de, dn) = (here[0] - e, here[1] - n);
            let kernel = exp(scale * (de * de + dn * dn));
            old[l] += b * kernel;
            new[l] += a * kernel;
        }
        [lane_sum(old), lane_sum(new)]
    }
}

/// Residual resampling (Liu & Chen 1998): ⌊N w⌋ copies of each particle, the R left by inverse CDF on the residual
/// weights with the first R of `uniforms`. Ancestors come out ascending.
///
/// All slices have N entries; `residual_cdf` and `counts` are scratch (`counts` ends as the number of copies of each
/// particle). Weights are normalised, uniforms in [0, 1).
pub fn residual_resample(
    weights: &[f64],
    uniforms: &[f64],
    residual_cdf: &mut [f64],
    counts: &mut [u32],
    ancestors: &mut [u32],
) {
    let left = residual_copies(weights, residual_cdf, counts).min(uniforms.len());
    residual_draw(&uniforms[..left], residual_cdf, counts, ancestors);
}

dispatch! {
    /// The first half of [`residual_resample`], before any uniform is needed: whole copies, the sums of the residual
    /// weights, and how many copies are left to draw.
    pub fn residual_copies(weights: &[f64], residual_cdf: &mut [f64], counts: &mut [u32]) -> usize {
        let n = weights.len().min(residual_cdf.len()).min(counts.len());
        let scale = n as f64;
        let (mut taken, mut carry) = (0u32, 0.0);
        let blocks = weights[..n].chunks(LANES).zip(residual_cdf[..n].chunks_mut(LANES));
        for ((w, cdf), count) in blocks.zip(counts[..n].chunks_mut(LANES)) {
            let (mut whole, mut rest) = ([0u32; LANES], [0.0; LANES]);
            for (l, w) in w.iter().enumerate() {
                let (copies, residual) = floor_split(scale * w);
                (whole[l], rest[l]) = (copies as u32, residual);
            }
            // Sums begin anew in each block, so that only one addition in eight waits for the one before.
            for l in 1..LANES {
                rest[l] += rest[l - 1];
            }
            for l in 0..LANES {
                taken = taken.wrapping_add(whole[l]);
            }
            for (c, r) in cdf.iter_mut().zip(rest) {
                *c = carry + r;
            }
            count.copy_from_slice(&whole[..count.len()]);
            carry += rest[LANES - 1];
        }
        n.saturating_sub(taken as usize)
    }
}

/// The second half of [`residual_resample`]: one more copy for each uniform, and the ancestors.
pub fn residual_draw(uniforms: &[f64], residual_cdf: &[f64], counts: &mut [u32], ancestors: &mut [u32]) {
    let n = residual_cdf.len();
    let total = residual_cdf.last().copied().unwrap_or(0.0);
    if !uniforms.is_empty() {
        let scale = n as f64 / total;
        guide(residual_cdf, scale, ancestors);
        for u in uniforms {
            let target = u * total;
            // The least index whose sum is above the target, from where the guide says it can begin. Two steps without
            // a branch nearly always suffice.
            let bucket = (target * scale) as u32 as usize;
            let mut index = ancestors[bucket.min(n - 1)] as usize;
            for _ in 0..2 {
                index += usize::from(index < n - 1 && residual_cdf[index] <= target);
            }
            while index < n - 1 && residual_cdf[index] <= target {
                index += 1;
            }
            counts[index] += 1;
        }
    }
    spread_ancestors(counts, ancestors);
}

/// `guide[k]`: how many sums, scaled to 0 to N, have a whole part below k (at most N − 1).
///
/// Scaling keeps the order, so a target whose own whole part is k lies above all of them.
fn guide(cdf: &[f64], scale: f64, guide: &mut [u32]) {
    guide.fill(0);
    for (i, c) in cdf.iter().enumerate() {
        // Ascending: the last of a whole part stays. By way of u32, which processors convert to in a third of the time.
        if let Some(next) = guide.get_mut((c * scale) as u32 as usize + 1) {
            *next = i as u32 + 1;
        }
    }
    let (mut below, last) = (0, (cdf.len() - 1) as u32);
    for g in guide {
        below = below.max(*g);
        *g = below.min(last);
    }
}

/// `counts[i]` times i, ascending.
fn spread_ancestors(counts: &[u32], ancestors: &mut [u32]) {
    /// Most particles have no more copies: all are written, the next particle overwrites what is too much.
    const MOST: usize = 4;
    let mut at = 0;
    for (i, &count) in counts.iter().enumerate() {
        let end = (at + count as usize).min(ancestors.len());
        if let Some(slots) = ancestors.get_mut(at..at + MOST) {
            slots.fill(i as u32);
            if end > at + MOST {
                ancestors[at + MOST..end].fill(i as u32);
            }
        } else {
            ancestors[at..end].fill(i as u32);
        }
        at = end;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::philox::{StreamKey, uniforms};
    use proptest::prelude::*;

    fn normalised(raw: &[f64]) -> Vec<f64> {
        let sum: f64 = raw.iter().sum();
        raw.iter().map(|x| x / sum).collect()
    }

    fn resample(weights: &[f64], uniforms: &[f64]) -> (Vec<u32>, Vec<u32>) {
        let n = weights.len();
        let (mut cdf, mut counts, mut ancestors) = (vec![0.0; n], vec![0; n], vec![u32::MAX; n]);
        residual_resample(weights, uniforms, &mut cdf, &mut counts, &mut ancestors);
        (counts, ancestors)
    }

    proptest! {
        #[test]
        fn copies_are_at_least_the_whole_part(
            raw in prop::collection::vec(prop_oneof![Just(0.0), 1e-12..1.0f64, Just(3.0)], 1..200),
            seed: [u32; 2],
        ) {
            prop_assume!(raw.iter().sum::<f64>() > 0.0);
            let w = normalised(&raw);
            let n = w.len();
            let mut u = vec![0.0; n];
            uniforms(&StreamKey { seed, step: 0, who: 0 }, 0, &mut u);
            let (counts, ancestors) = resample(&w, &u);
            prop_assert_eq!(counts.iter().sum::<u32>() as usize, n);
            prop_assert!(ancestors.windows(2).all(|p| p[0] <= p[1]));
            for i in 0..n {
                prop_assert!(f64::from(counts[i]) >= (n as f64 * w[i]).floor());
                prop_assert_eq!(ancestors.iter().filter(|&&a| a as usize == i).count() as u32, counts[i]);
                // A weight of nothing may only be drawn where rounding left the last residual slot over.
                prop_assert!(w[i] > 0.0 || counts[i] == 0 || i == n - 1);
            }
        }

        #[test]
        fn the_guide_finds_what_a_search_finds(
            raw in prop::collection::vec(prop_oneof![Just(0.0), 1e-12..1.0f64, Just(3.0), Just(1e-3)], 1..300),
            seed: [u32; 2],
        ) {
            prop_assume!(raw.iter().sum::<f64>() > 0.0);
            let (w, n) = (normalised(&raw), raw.len());
            let mut u = vec![0.0; n];
            uniforms(&StreamKey { seed, step: 0, who: 0 }, 0, &mut u);
            let (mut expected, mut cdf, mut total) = (vec![0u32; n], Vec::new(), 0.0);
            for (count, w) in expected.iter_mut().zip(&w) {
                *count = (n as f64 * w).floor() as u32;
                total += n as f64 * w - f64::from(*count);
                cdf.push(total);
            }
            let left = n - expected.iter().sum::<u32>() as usize;
            for u in &u[..left] {
                expected[cdf.partition_point(|c| *c <= u * total).min(n - 1)] += 1;
            }
            prop_assert_eq!(resample(&w, &u).0, expected);
        }

        #[test]
        fn extreme_log_weights_keep_weights_sane(
            mut log_w in prop::collection::vec(
                prop_oneof![-1e6..1e6f64, Just(f64::NEG_INFINITY), Just(f64::NAN), -1e308..-1e200f64, Just(700.0)],
                1..100,
            ),
        ) {
            let before: Vec<u64> = log_w.iter().map(|x| x.to_bits()).collect();
            let mut w = vec![0.25; log_w.len()];
            match normalise(&mut log_w, &mut w) {
                None => {
                    prop_assert!(before.iter().all(|&b| !f64::from_bits(b).is_finite()));
                    prop_assert_eq!(before, log_w.iter().map(|x| x.to_bits()).collect::<Vec<_>>());
                    prop_assert!(w.iter().all(|&x| x == 0.25));
                }
                Some((_, squares)) => {
                    prop_assert!((w.iter().sum::<f64>() - 1.0).abs() < 1e-12);
                    prop_assert!(w.iter().all(|&x| (0.0..=1.0 + 1e-15).contains(&x)));
                    prop_assert!((1.0 / squares / effective_sample_size(&w) - 1.0).abs() < 1e-12);
                    prop_assert!(log_w.iter().all(|x| x.is_finite() && *x <= 1e-9));
                }
            }
        }
    }

    #[test]
    fn resampling_is_unbiased() {
        let w = normalised(&[0.3, 0.05, 1.7, 0.9, 0.02, 2.4, 0.6]);
        let n = w.len();
        let runs = 40_000;
        let mut sums = vec![0.0; n];
        for run in 0..runs {
            let mut u = vec![0.0; n];
            uniforms(&StreamKey { seed: [5, 0], step: run, who: 0 }, 0, &mut u);
            for (s, c) in sums.iter_mut().zip(resample(&w, &u).0) {
                *s += f64::from(c);
            }
        }
        for (s, w) in sums.iter().zip(&w) {
            let (mean, expected) = (s / f64::from(runs), n as f64 * w);
            assert!((mean - expected).abs() < 5.0 * (1.0 / f64::from(runs)).sqrt(), "{mean} {expected}");
        }
    }
}
