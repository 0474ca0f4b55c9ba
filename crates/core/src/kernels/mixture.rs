//! The two loops of expectation–maximisation over columns of points.

use super::dispatch;
use super::math::{exp, ln};

const LANES: usize = 8;

#[inline(always)]
fn lane_sum(lanes: [f64; LANES]) -> f64 {
    ((lanes[0] + lanes[4]) + (lanes[2] + lanes[6])) + ((lanes[1] + lanes[5]) + (lanes[3] + lanes[7]))
}

dispatch! {
    /// Log-density of one mode at every point: `constant − ½ ‖W (x − mean)‖²`, W lower triangular, row by row.
    pub fn mode_log_density<const D: usize>(
        points: &[Vec<f64>; D],
        mean: &[f64; D],
        whiten: &[[f64; D]; D],
        constant: f64,
        out: &mut [f64],
    ) {
        let n = out.len();
        for first in (0..n).step_by(LANES) {
            let count = LANES.min(n - first);
            let mut square = [0.0; LANES];
            let mut d = [[0.0; LANES]; D];
            for k in 0..D {
                let column = &points[k][first..first + count];
                for (l, x) in column.iter().enumerate() {
                    d[k][l] = x - mean[k];
                }
            }
            for r in 0..D {
                let mut y = [0.0; LANES];
                for c in 0..=r {
                    for l in 0..LANES {
                        y[l] += whiten[r][c] * d[c][l];
                    }
                }
                for l in 0..LANES {
                    square[l] += y[l] * y[l];
                }
            }
            for l in 0..count {
                out[first + l] = constant - 0.5 * square[l];
            }
        }
    }
}

dispatch! {
    /// Log-densities of all modes (one column each) to responsibilities times weights; returns Σ wᵢ ln pᵢ.
    pub fn responsibilities(weights: &[f64], modes: &mut [Vec<f64>]) -> f64 {
        let n = weights.len();
        let mut total = [0.0; LANES];
        for first in (0..n).step_by(LANES) {
            let count = LANES.min(n - first);
            let mut top = [f64::NEG_INFINITY; LANES];
            for mode in modes.iter() {
                for (l, x) in mode[first..first + count].iter().enumerate() {
                    top[l] = if *x > top[l] { *x } else { top[l] };
                }
            }
            let mut sum = [0.0; LANES];
            for mode in modes.iter_mut() {
                for (l, x) in mode[first..first + count].iter_mut().enumerate() {
                    *x = exp(*x - top[l]);
                    sum[l] += *x;
                }
            }
            let mut scale = [0.0; LANES];
            for l in 0..count {
                let w = weights[first + l];
                scale[l] = w / sum[l];
                total[l] += w * (top[l] + ln(sum[l]));
            }
            for mode in modes.iter_mut() {
                for (l, x) in mode[first..first + count].iter_mut().enumerate() {
                    *x *= scale[l];
                }
            }
        }
        lane_sum(total)
    }
}

dispatch! {
    /// Share, mean and covariance (not yet divided by the share about `about`) of points under responsibilities:
    /// (Σ r, Σ r (x − about), lower triangle of Σ r (x − about)(x − about)ᵀ).
    pub fn mode_sums<const D: usize>(
        points: &[Vec<f64>; D],
        responsibility: &[f64],
        about: &[f64; D],
    ) -> (f64, [f64; D], [[f64; D]; D]) {
        let n = responsibility.len();
        let mut share = [0.0; LANES];
        let mut first_moment = [[0.0; LANES]; D];
        let mut second_moment = [[[0.0; LANES]; D]; D];
        for first in (0..n).step_by(LANES) {
            let count = LANES.min(n - first);
            let mut r = [0.0; LANES];
            r[..count].copy_from_slice(&responsibility[first..first + count]);
            let mut d = [[0.0; LANES]; D];
            for k in 0..D {
                for (l, x) in points[k][first..first + count].iter().enumerate() {
                    d[k][l] = x - about[k];
                }
            }
            for l in 0..LANES {
                share[l] += r[l];
            }
            for a in 0..D {
                let mut scaled = [0.0; LANES];
                for l in 0..LANES {
                    scaled[l] = r[l] * d[a][l];
                    first_moment[a][l] += scaled[l];
                }
                for b in 0..=a {
                    for l in 0..LANES {
                        second_moment[a][b][l] += scaled[l] * d[b][l];
                    }
                }
            }
        }
        (lane_sum(share), first_moment.map(lane_sum), second_moment.map(|row| row.map(lane_sum)))
    }
}
