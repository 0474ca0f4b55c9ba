//! Factorisations of larger systems: the only module that knows faer.

use faer::linalg::solvers::Solve;
use faer::{Mat, MatRef, Side};

use crate::error::Error;

/// Schur complement: the information that stays on the entries `keep` (ascending or not, each once) when all others are
/// marginalised out: Λ_kk − Λ_km Λ_mm⁻¹ Λ_mk, η_k − Λ_km Λ_mm⁻¹ η_m. Row-major n × n in, row-major out.
///
/// # Errors
/// [`Error::Length`] for arrays that do not fit, [`Error::OutOfBound`] for an entry that is none or named twice,
/// [`Error::NotFinite`], [`Error::NotPositiveDefinite`] when what is marginalised out is not.
pub fn marginalize(matrix: &[f64], vector: &[f64], keep: &[usize]) -> Result<(Vec<f64>, Vec<f64>), Error> {
    let n = vector.len();
    if matrix.len() != n * n {
        return Err(Error::Length { quantity: "information matrix", found: matrix.len(), expected: n * n });
    }
    for value in matrix.iter().chain(vector) {
        crate::error::finite("information", *value)?;
    }
    let mut kept = vec![false; n];
    for &entry in keep {
        let bad = Error::OutOfBound {
            quantity: "entry to keep",
            value: entry as f64,
            bound: "0 to n - 1, each once",
        };
        match kept.get_mut(entry) {
            Some(flag) if !*flag => *flag = true,
            _ => return Err(bad),
        }
    }
    let out: Vec<usize> = (0..n).filter(|k| !kept[*k]).collect();
    let all = MatRef::from_row_major_slice(matrix, n, n);
    let pick = |rows: &[usize], columns: &[usize]| {
        Mat::from_fn(rows.len(), columns.len(), |r, c| all[(rows[r], columns[c])])
    };
    let mut stays = pick(keep, keep);
    let mut told: Vec<f64> = keep.iter().map(|k| vector[*k]).collect();
    if !out.is_empty() {
        let (own, across) = (pick(&out, &out), pick(keep, &out));
        let root = own
            .llt(Side::Lower)
            .map_err(|_| Error::NotPositiveDefinite { quantity: "information that is marginalised out" })?;
        let rest = Mat::from_fn(out.len(), 1, |r, _| vector[out[r]]);
        let (solved, solved_rest) = (root.solve(across.transpose()), root.solve(&rest));
        stays -= &across * solved;
        let moved = &across * solved_rest;
        told.iter_mut().enumerate().for_each(|(k, value)| *value -= moved[(k, 0)]);
    }
    let m = keep.len();
    let flat = (0..m * m).map(|i| 0.5 * (stays[(i / m, i % m)] + stays[(i % m, i / m)])).collect();
    Ok((flat, told))
}
