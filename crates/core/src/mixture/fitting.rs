//! Expectation–maximisation with k-means++ starts on weighted points whose coordinates may wrap.

use std::f64::consts::TAU;

use nalgebra::{SMatrix, SVector};

use super::Mode;
use crate::kernels::mixture::{mode_log_density, mode_sums, responsibilities};
use crate::measurement::angle::wrap;
use crate::random::Stream;

/// Which coordinates are angles (radians); the others are lengths.
pub type Circular<const D: usize> = [bool; D];

/// How hard to try.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FitOptions {
    /// Starts by k-means++; the most likely fit wins.
    pub starts: usize,
    /// Most iterations of a start.
    pub iterations: usize,
    /// A start ends when an iteration adds less than this to the mean log-likelihood of a point, nat.
    pub tolerance: f64,
    /// Added to the diagonal of a single mode's covariance in whitened coordinates.
    pub ridge_one: f64,
    /// The same for two and more modes, where it keeps a mode from collapsing on a few points.
    pub ridge_many: f64,
}

/// A mixture and how well it fits.
#[derive(Debug, Clone, PartialEq)]
pub struct Fitted<const D: usize> {
    /// Modes by falling weight; means of circular coordinates in [−π, π).
    pub modes: Vec<Mode<D>>,
    /// Log-likelihood of as many points as are distinct, nat.
    pub log_likelihood: f64,
    /// Bayesian information criterion on distinct points: smaller is better.
    pub bic: f64,
    /// Akaike's.
    pub aic: f64,
    /// Distinct points that the criteria count.
    pub points: usize,
    /// Whether the winning start ended before its last iteration.
    pub converged: bool,
}

/// Angles unwrapped about their weighted circular mean, so that a cloud that straddles ±π is one piece.
#[must_use]
pub fn centre<const D: usize>(
    points: &[SVector<f64, D>],
    weights: &[f64],
    circular: Circular<D>,
) -> Vec<SVector<f64, D>> {
    let mut centred = points.to_vec();
    for k in (0..D).filter(|k| circular[*k]) {
        let (mut s, mut c) = (0.0, 0.0);
        for (x, w) in points.iter().zip(weights) {
            s += w * x[k].sin();
            c += w * x[k].cos();
        }
        let mean = s.atan2(c);
        for x in &mut centred {
            x[k] = mean + wrap(x[k] - mean);
        }
    }
    centred
}

/// A coordinate with less spread than this (a landmark that is known exactly) is taken as having this much.
const FLAT: f64 = 1e-9;

/// Columns of points in coordinates whose covariance is the identity: x = mean + root · y.
struct Whitened<const D: usize> {
    columns: [Vec<f64>; D],
    mean: SVector<f64, D>,
    root: SMatrix<f64, D, D>,
    flat: [bool; D],
}

impl<const D: usize> Whitened<D> {
    fn of(points: &[SVector<f64, D>], weights: &[f64]) -> Option<Self> {
        let (mean, mut covariance) = super::moments(points, weights);
        if !covariance.iter().all(|v| v.is_finite()) {
            return None;
        }
        let flat: [bool; D] = std::array::from_fn(|k| covariance[(k, k)] < FLAT * FLAT);
        for k in 0..D {
            if flat[k] {
                covariance.row_mut(k).fill(0.0);
                covariance.column_mut(k).fill(0.0);
                covariance[(k, k)] = FLAT * FLAT;
            } else {
                // Coordinates that follow from others are told apart by their last bits.
                covariance[(k, k)] *= 1.0 + 1e-12;
            }
        }
        let root = covariance.cholesky()?.unpack();
        let inverse = root.solve_lower_triangular(&SMatrix::<f64, D, D>::identity())?;
        let white: Vec<SVector<f64, D>> = points.iter().map(|x| inverse * (x - mean)).collect();
        let scaled = |y: &SVector<f64, D>, k: usize| if flat[k] { 0.0 } else { y[k] };
        let columns = std::array::from_fn(|k| white.iter().map(|y| scaled(y, k)).collect::<Vec<_>>());
        Some(Self { columns, mean, root, flat })
    }

    fn back(&self, mode: &Mode<D>, circular: Circular<D>) -> Mode<D> {
        let mut mean = self.mean + self.root * mode.mean;
        for k in (0..D).filter(|k| circular[*k]) {
            mean[k] = wrap(mean[k]);
        }
        Mode { weight: mode.weight, mean, covariance: self.root * mode.covariance * self.root.transpose() }
    }
}

/// The best of `options.starts` fits of `modes` modes to weighted points; weights sum to one.
///
/// Points are unwrapped ([`centre`]), whitened by their own covariance, and each start draws its centres by k-means++ from
/// `stream`. Ties and order do not depend on threads. `None` for no points, no modes, more modes than points, or a
/// covariance that is not finite.
#[must_use]
pub fn fit_best<const D: usize>(
    points: &[SVector<f64, D>],
    weights: &[f64],
    circular: Circular<D>,
    modes: usize,
    options: &FitOptions,
    stream: &Stream,
) -> Option<Fitted<D>> {
    if points.is_empty() || modes == 0 || modes > points.len() || weights.len() != points.len() {
        return None;
    }
    let centred = centre(points, weights, circular);
    let white = Whitened::of(&centred, weights)?;
    let mut best: Option<(f64, Vec<Mode<D>>, bool)> = None;
    let starts = if modes == 1 { 1 } else { options.starts.max(1) };
    for start in 0..starts {
        let lane = (modes * 64 + start) as u32;
        let first = first_modes(&white, weights, modes, stream, lane);
        let Some(run) = climb(&white, weights, first, options) else { continue };
        if best.as_ref().is_none_or(|b| run.0 > b.0) {
            best = Some(run);
        }
    }
    Some(report(&white, best?, circular, points.len()))
}

/// A finished run in the points' own coordinates, with its criteria.
fn report<const D: usize>(
    white: &Whitened<D>,
    run: (f64, Vec<Mode<D>>, bool),
    circular: Circular<D>,
    n: usize,
) -> Fitted<D> {
    let (mean_log_likelihood, mut found, converged) = run;
    found.sort_by(|a, b| b.weight.total_cmp(&a.weight));
    let log_scale: f64 = (0..D).map(|k| white.root[(k, k)].ln()).sum();
    let log_likelihood = (mean_log_likelihood - log_scale) * n as f64;
    let parameters = (found.len() * (1 + D + D * (D + 1) / 2) - 1) as f64;
    Fitted {
        modes: found.iter().map(|m| white.back(m, circular)).collect(),
        log_likelihood,
        bic: parameters * (n as f64).ln() - 2.0 * log_likelihood,
        aic: 2.0 * parameters - 2.0 * log_likelihood,
        points: n,
        converged,
    }
}

/// EM from given modes: where it ends, for comparison with another implementation's optimum. `None` as [`fit_best`].
#[must_use]
pub fn fit_from<const D: usize>(
    points: &[SVector<f64, D>],
    weights: &[f64],
    circular: Circular<D>,
    first: &[Mode<D>],
    options: &FitOptions,
) -> Option<Fitted<D>> {
    if points.is_empty() || first.is_empty() || weights.len() != points.len() {
        return None;
    }
    let centred = centre(points, weights, circular);
    let white = Whitened::of(&centred, weights)?;
    let inverse = white.root.try_inverse()?;
    let whitened = |mode: &Mode<D>| {
        let mut d = mode.mean - white.mean;
        for k in (0..D).filter(|k| circular[*k]) {
            d[k] = wrap(d[k]);
        }
        Mode {
            weight: mode.weight,
            mean: inverse * d,
            covariance: inverse * mode.covariance * inverse.transpose(),
        }
    };
    let run = climb(&white, weights, first.iter().map(whitened).collect(), options)?;
    Some(report(&white, run, circular, points.len()))
}

/// Centres by k-means++, each with the whole covariance's share.
fn first_modes<const D: usize>(
    white: &Whitened<D>,
    weights: &[f64],
    modes: usize,
    stream: &Stream,
    lane: u32,
) -> Vec<Mode<D>> {
    let n = weights.len();
    let mut uniforms = vec![0.0; modes];
    stream.uniforms(lane, &mut uniforms);
    let mut distance = vec![1.0; n];
    let mut found = Vec::with_capacity(modes);
    for u in uniforms {
        let total: f64 = distance.iter().zip(weights).map(|(d, w)| d * w).sum();
        let mut left = u * total;
        let pick = distance.iter().zip(weights).position(|(d, w)| {
            left -= d * w;
            left <= 0.0
        });
        let pick = pick.unwrap_or(n - 1);
        let mean = SVector::<f64, D>::from_fn(|k, _| white.columns[k][pick]);
        for (i, d) in distance.iter_mut().enumerate() {
            let square: f64 = (0..D).map(|k| (white.columns[k][i] - mean[k]).powi(2)).sum();
            *d = if found.is_empty() { square } else { d.min(square) };
        }
        let covariance = SMatrix::identity() / (modes * modes) as f64;
        found.push(Mode { weight: 1.0 / modes as f64, mean, covariance });
    }
    found
}

/// EM from `modes`: (mean log-likelihood of a point in whitened coordinates, modes, whether it converged).
fn climb<const D: usize>(
    white: &Whitened<D>,
    weights: &[f64],
    mut modes: Vec<Mode<D>>,
    options: &FitOptions,
) -> Option<(f64, Vec<Mode<D>>, bool)> {
    let ridge = if modes.len() == 1 { options.ridge_one } else { options.ridge_many };
    let mut columns = vec![vec![0.0; weights.len()]; modes.len()];
    let mut before = f64::NEG_INFINITY;
    let mut converged = false;
    for _ in 0..options.iterations.max(1) {
        let now = expect(white, weights, &modes, &mut columns)?;
        // The single mode needs one step, and its likelihood is that of the fitted one.
        if now - before < options.tolerance {
            converged = true;
            break;
        }
        before = now;
        maximise(white, &mut modes, &columns, ridge);
    }
    let last = expect(white, weights, &modes, &mut columns)?;
    last.is_finite().then_some((last, modes, converged))
}

fn expect<const D: usize>(
    white: &Whitened<D>,
    weights: &[f64],
    modes: &[Mode<D>],
    columns: &mut [Vec<f64>],
) -> Option<f64> {
    for (mode, column) in modes.iter().zip(columns.iter_mut()) {
        let root = mode.covariance.cholesky()?.unpack();
        let inverse = root.solve_lower_triangular(&SMatrix::<f64, D, D>::identity())?;
        let log_root: f64 = (0..D).map(|d| root[(d, d)].ln()).sum();
        let constant = mode.weight.max(f64::MIN_POSITIVE).ln() - log_root - 0.5 * D as f64 * TAU.ln();
        let whiten: [[f64; D]; D] = std::array::from_fn(|r| std::array::from_fn(|c| inverse[(r, c)]));
        let mean: [f64; D] = std::array::from_fn(|k| mode.mean[k]);
        mode_log_density(&white.columns, &mean, &whiten, constant, column);
    }
    Some(responsibilities(weights, columns))
}

fn maximise<const D: usize>(white: &Whitened<D>, modes: &mut [Mode<D>], columns: &[Vec<f64>], ridge: f64) {
    for (mode, column) in modes.iter_mut().zip(columns) {
        let about: [f64; D] = std::array::from_fn(|k| mode.mean[k]);
        let (share, first, second) = mode_sums(&white.columns, column, &about);
        // A mode that lost all its points stays where it is with no weight.
        mode.weight = share;
        if share <= 1e-12 {
            continue;
        }
        let shift = SVector::<f64, D>::from_fn(|k, _| first[k] / share);
        mode.mean += shift;
        mode.covariance = SMatrix::from_fn(|r, c| {
            let raw = if r >= c { second[r][c] } else { second[c][r] };
            // Unit variance where there is no spread, for any number of modes: it must not sway the criterion.
            let added = if r != c {
                0.0
            } else if white.flat[r] {
                1.0
            } else {
                ridge
            };
            raw / share - shift[r] * shift[c] + added
        });
    }
}
