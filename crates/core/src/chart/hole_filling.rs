//! Filling the holes of a depth grid from their rims.

use crate::kernels::lookup::{Grid, Paired, paired};

/// Depths with holes filled up to `reach_m` from the nearest node that has one, ring by ring with the mean of the
/// neighbours that are known; `None` for a grid without holes.
#[must_use]
pub fn fill_holes(grid: &Grid<'_, Paired>, reach_m: f64) -> Option<Vec<Paired>> {
    let mut depths: Vec<f32> = grid.values.iter().map(|[depth, _]| *depth).collect();
    if depths.iter().all(|d| !d.is_nan()) {
        return None;
    }
    let (rows, cols) = (grid.rows, grid.cols);
    let known = |depths: &[f32], r: usize, c: usize| -> (f32, u8) {
        let (mut sum, mut count) = (0.0, 0);
        for nr in r.saturating_sub(1)..=(r + 1).min(rows - 1) {
            for nc in c.saturating_sub(1)..=(c + 1).min(cols - 1) {
                let depth = depths[nr * cols + nc];
                if !depth.is_nan() {
                    sum += depth;
                    count += 1;
                }
            }
        }
        (sum, count)
    };
    let mut rim: Vec<usize> = (0..depths.len())
        .filter(|at| depths[*at].is_nan() && known(&depths, at / cols, at % cols).1 > 0)
        .collect();
    let mut queued: Vec<bool> = depths.iter().map(|d| !d.is_nan()).collect();
    rim.iter().for_each(|at| queued[*at] = true);
    for _ in 0..(reach_m / grid.cell_m).floor() as usize {
        let ring: Vec<f32> = rim
            .iter()
            .map(|at| {
                let (sum, count) = known(&depths, at / cols, at % cols);
                sum / f32::from(count)
            })
            .collect();
        rim.iter().zip(&ring).for_each(|(at, depth)| depths[*at] = *depth);
        let mut next = Vec::new();
        for at in &rim {
            let (r, c) = (at / cols, at % cols);
            for nr in r.saturating_sub(1)..=(r + 1).min(rows - 1) {
                for nc in c.saturating_sub(1)..=(c + 1).min(cols - 1) {
                    let there = nr * cols + nc;
                    if !queued[there] {
                        queued[there] = true;
                        next.push(there);
                    }
                }
            }
        }
        rim = next;
        if rim.is_empty() {
            break;
        }
    }
    Some(paired(&depths, cols))
}
