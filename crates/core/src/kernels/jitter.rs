//! Liu–West jitter of columns that follow others.

use super::dispatch;
use super::particles::{product_sum, sum};
use super::team::{packed, packed_len};

/// Scratch of [`jitter_followers`].
#[derive(Debug, Clone, Default)]
pub struct JitterScratch {
    mean: Vec<f64>,
    root: Vec<f64>,
    column: Vec<f64>,
}

dispatch! {
    /// Liu–West on columns that follow others: the joint of `leaders` and `followers` is shrunk and jittered with its own
    /// covariance, and only the followers are written (the leaders' own jitter, with `leader_normals`, is the same with
    /// and without followers). All columns have N entries; `followers` and `normals` hold theirs one after another.
    pub fn jitter_followers(
        leaders: &[&[f64]],
        leader_normals: &[&[f64]],
        followers: &mut [f64],
        normals: &[f64],
        bandwidth: f64,
        scratch: &mut JitterScratch,
    ) {
        let Some(n) = leaders.first().map(|c| c.len()).filter(|n| *n > 0) else { return };
        let (k, d) = (leaders.len(), leaders.len() + followers.len() / n);
        let JitterScratch { mean, root, column } = scratch;
        mean.resize(d, 0.0);
        root.resize(packed_len(d), 0.0);
        column.resize(n, 0.0);
        let inverse = 1.0 / n as f64;
        let at = |j: usize| ((j - k) * n, (j - k + 1) * n);
        for j in 0..d {
            let total = if j < k {
                sum(leaders[j])
            } else {
                let (a, b) = at(j);
                sum(&followers[a..b])
            };
            mean[j] = total * inverse;
        }
        for r in 0..d {
            let row = if r < k {
                leaders[r]
            } else {
                let (a, b) = at(r);
                &followers[a..b]
            };
            for c in 0..=r {
                let other = if c < k {
                    leaders[c]
                } else {
                    let (a, b) = at(c);
                    &followers[a..b]
                };
                root[packed(r, c)] = product_sum(row, mean[r], other, mean[c]) * inverse;
            }
            // A trace of jitter keeps the factor defined where columns are linearly dependent.
            let diagonal = &mut root[packed(r, r)];
            *diagonal += 1e-9 * *diagonal + 1e-14;
        }
        if !cholesky(root, d) {
            return;
        }
        let shrink = (1.0 - bandwidth * bandwidth).sqrt();
        for r in k..d {
            let (a, b) = at(r);
            for (x, old) in column.iter_mut().zip(&followers[a..b]) {
                *x = mean[r] + shrink * (old - mean[r]);
            }
            for c in 0..=r {
                let factor = bandwidth * root[packed(r, c)];
                let z = if c < k { leader_normals[c] } else { &normals[(c - k) * n..(c - k + 1) * n] };
                for (x, z) in column.iter_mut().zip(z) {
                    *x += factor * z;
                }
            }
            followers[a..b].copy_from_slice(column);
        }
    }
}

/// In-place Cholesky factor of a packed lower triangle; false, and garbage, for what is not positive definite.
#[inline(always)]
fn cholesky(a: &mut [f64], d: usize) -> bool {
    for r in 0..d {
        for c in 0..=r {
            let mut sum = a[packed(r, c)];
            for k in 0..c {
                sum -= a[packed(r, k)] * a[packed(c, k)];
            }
            if r == c {
                if sum.is_nan() || sum <= 0.0 {
                    return false;
                }
                a[packed(r, r)] = sum.sqrt();
            } else {
                a[packed(r, c)] = sum / a[packed(c, c)];
            }
        }
    }
    true
}
