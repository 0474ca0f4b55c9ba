//! How many modes: an information criterion on distinct points under a limit, and what to do with the result.

use std::collections::HashMap;

use nalgebra::SVector;
use serde::{Deserialize, Serialize};

use super::{Circular, FitOptions, Fitted, Mode, fit_best};
use crate::random::Stream;

/// What chooses the number of modes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Criterion {
    /// Bayesian information criterion.
    Bic,
    /// Akaike information criterion.
    Aic,
}

/// Points without their copies, with the copies' weights summed; order of first appearance.
///
/// A resampled cloud holds clones. A criterion that counts them as data fits modes to them.
#[must_use]
pub fn distinct<const D: usize>(
    points: &[SVector<f64, D>],
    weights: &[f64],
) -> (Vec<SVector<f64, D>>, Vec<f64>) {
    let mut seen: HashMap<[u64; D], usize> = HashMap::with_capacity(points.len());
    let (mut kept, mut shares) = (Vec::with_capacity(points.len()), Vec::with_capacity(points.len()));
    for (x, w) in points.iter().zip(weights) {
        let key = std::array::from_fn(|k| x[k].to_bits());
        let at = *seen.entry(key).or_insert_with(|| {
            kept.push(*x);
            shares.push(0.0);
            kept.len() - 1
        });
        shares[at] += w;
    }
    (kept, shares)
}

/// The mixture of 1 to `most` modes that the criterion likes best, each number fitted anew to the points: a larger
/// mixture is never cut down to the limit.
///
/// The search looks at about `search_points` of the distinct points; the winner is then fitted to all of them. It ends at the first number of modes that is no better than the one before.
/// `None` as [`fit_best`].
#[must_use]
pub fn select<const D: usize>(
    points: &[SVector<f64, D>],
    weights: &[f64],
    circular: Circular<D>,
    most: usize,
    criterion: Criterion,
    options: &FitOptions,
    search_points: usize,
    stream: &Stream,
) -> Option<Fitted<D>> {
    let (points, weights) = distinct(points, weights);
    let score = |f: &Fitted<D>| match criterion {
        Criterion::Bic => f.bic,
        Criterion::Aic => f.aic,
    };
    let (some, some_weights) = thinned(&points, &weights, search_points);
    let mut best = fit_best(&some, &some_weights, circular, 1, options, stream)?;
    let mut count = 1;
    for modes in 2..=most.min(some.len() / (D + 1)).max(1) {
        let Some(next) = fit_best(&some, &some_weights, circular, modes, options, stream) else { break };
        if score(&next) >= score(&best) {
            break;
        }
        (best, count) = (next, modes);
    }
    if some.len() == points.len() {
        return Some(best);
    }
    fit_best(&points, &weights, circular, count, options, stream)
}

/// About `most` of the points, spread by a multiplicative hash of their index: a stride could follow a pattern.
fn thinned<const D: usize>(
    points: &[SVector<f64, D>],
    weights: &[f64],
    most: usize,
) -> (Vec<SVector<f64, D>>, Vec<f64>) {
    if points.len() <= most {
        return (points.to_vec(), weights.to_vec());
    }
    let share = most as f64 / points.len() as f64;
    let limit = (share * f64::from(u32::MAX)) as u32;
    let chosen = |i: &usize| (*i as u32).wrapping_mul(2_654_435_761) <= limit;
    let (kept, shares): (Vec<_>, Vec<f64>) =
        (0..points.len()).filter(chosen).map(|i| (points[i], weights[i])).unzip();
    let total: f64 = shares.iter().sum();
    (kept, shares.iter().map(|w| w / total).collect())
}

/// How many of `count` samples each mode gets: systematic at u = ½, so shares are met within one sample and the
/// samples of a mode stand together.
#[must_use]
pub fn sample_counts<const D: usize>(modes: &[Mode<D>], count: usize) -> Vec<usize> {
    let total: f64 = modes.iter().map(|m| m.weight).sum();
    let mut counts = vec![0; modes.len()];
    let (mut k, mut cumulative) = (0, modes.first().map_or(0.0, |m| m.weight / total));
    for i in 0..count {
        let u = (i as f64 + 0.5) / count as f64;
        while u > cumulative && k + 1 < modes.len() {
            k += 1;
            cumulative += modes[k].weight / total;
        }
        if let Some(c) = counts.get_mut(k) {
            *c += 1;
        }
    }
    counts
}
