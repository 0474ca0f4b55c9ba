//! Bilinear lookups of single points, the exact path.

use crate::error::{Error, finite};

/// A node value: charts hold f32, golden cases f64.
pub trait Node: Copy {
    /// The value as f64.
    fn get(self) -> f64;
}

impl Node for f32 {
    #[inline(always)]
    fn get(self) -> f64 {
        f64::from(self)
    }
}

impl Node for f64 {
    #[inline(always)]
    fn get(self) -> f64 {
        self
    }
}

/// A node's value and that of its northern neighbour: the four nodes of a cell are then one load of 16 bytes.
pub type Paired = [f32; 2];

impl Node for Paired {
    #[inline(always)]
    fn get(self) -> f64 {
        f64::from(self[0])
    }
}

/// Every node of a row-major grid with its northern neighbour; the northernmost row, where no cell begins, with itself.
#[must_use]
pub fn paired(values: &[f32], cols: usize) -> Vec<Paired> {
    let last = values.len().saturating_sub(cols);
    let north = values.iter().skip(cols).chain(&values[last..]);
    values.iter().zip(north).map(|(south, north)| [*south, *north]).collect()
}

/// A borrowed row-major grid, southernmost row first. What [`Grid::new`] has checked is what unchecked loads rely on.
#[derive(Debug, Clone, Copy)]
pub struct Grid<'a, T> {
    /// `rows · cols` values; NaN is a hole.
    pub(crate) values: &'a [T],
    /// Nodes from south to north.
    pub(crate) rows: usize,
    /// Nodes from west to east.
    pub(crate) cols: usize,
    /// Easting of column 0, m.
    pub(crate) east0_m: f64,
    /// Northing of row 0, m.
    pub(crate) north0_m: f64,
    /// Distance between nodes, m.
    pub(crate) cell_m: f64,
}

/// No node lies further from the frame's zero, m: there a double still holds a fraction of a micrometre.
const FURTHEST_M: f64 = 1e8;
/// Least and greatest distance between nodes, m.
const CELL_M: [f64; 2] = [1e-3, 1e6];

/// Refuses a grid of fewer than 2 × 2 nodes, of more than an `i32` counts, or whose nodes lie nowhere.
///
/// # Errors
/// [`Error::Chart`], [`Error::OutsideBounds`], [`Error::NotFinite`].
pub fn check_geometry(
    rows: usize,
    cols: usize,
    east0_m: f64,
    north0_m: f64,
    cell_m: f64,
) -> Result<(), Error> {
    if rows < 2 || cols < 2 || rows.saturating_mul(cols) >= i32::MAX as usize {
        return Err(Error::Chart(format!("{rows} × {cols} nodes, outside 2 × 2 to 2^31 nodes")));
    }
    let within = |quantity, value: f64, [minimum, maximum]: [f64; 2]| {
        finite(quantity, value)?;
        if (minimum..=maximum).contains(&value) {
            return Ok(());
        }
        Err(Error::OutsideBounds { quantity, value, open: "", minimum, maximum })
    };
    within("chart cell_m", cell_m, CELL_M)?;
    let sides = [("chart east0_m", east0_m, cols), ("chart north0_m", north0_m, rows)];
    sides.into_iter().try_for_each(|(quantity, zero_m, nodes)| {
        within(quantity, zero_m, [-FURTHEST_M, FURTHEST_M])?;
        within(
            "furthest node of the chart, m",
            zero_m + (nodes - 1) as f64 * cell_m,
            [-FURTHEST_M, FURTHEST_M],
        )
    })
}

impl<'a, T> Grid<'a, T> {
    /// A grid over these values.
    ///
    /// # Errors
    /// What [`check_geometry`] says; [`Error::Length`] for another number of values than nodes.
    pub fn new(
        values: &'a [T],
        rows: usize,
        cols: usize,
        east0_m: f64,
        north0_m: f64,
        cell_m: f64,
    ) -> Result<Self, Error> {
        check_geometry(rows, cols, east0_m, north0_m, cell_m)?;
        if values.len() != rows * cols {
            let (found, expected) = (values.len(), rows * cols);
            return Err(Error::Length { quantity: "values of a grid", found, expected });
        }
        Ok(Self { values, rows, cols, east0_m, north0_m, cell_m })
    }

    /// The same nodes with other values; itself for another number of them.
    #[must_use]
    pub fn with_values(self, values: &'a [T]) -> Self {
        if values.len() == self.values.len() { Self { values, ..self } } else { self }
    }
}

struct Corners {
    nodes: [f64; 4], // south-west, south-east, north-west, north-east
    fe: f64,
    fn_: f64,
}

impl<T: Node> Grid<'_, T> {
    /// The cell around a point, or none off the grid; the last node belongs to the last cell.
    #[inline(always)]
    fn corners(&self, east_m: f64, north_m: f64) -> Option<Corners> {
        let x = (east_m - self.east0_m) / self.cell_m;
        let y = (north_m - self.north0_m) / self.cell_m;
        if !(x >= 0.0 && y >= 0.0 && x <= (self.cols - 1) as f64 && y <= (self.rows - 1) as f64) {
            return None;
        }
        let column = (x as usize).min(self.cols - 2);
        let row = (y as usize).min(self.rows - 2);
        let at = row * self.cols + column;
        let south = self.values.get(at..at + 2)?;
        let north = self.values.get(at + self.cols..at + self.cols + 2)?;
        Some(Corners {
            nodes: [south[0].get(), south[1].get(), north[0].get(), north[1].get()],
            fe: x - column as f64,
            fn_: y - row as f64,
        })
    }
}

/// Depth at a point, NaN off the grid or where one of the four nodes around it is a hole. Exact f64 path.
#[inline(always)]
#[must_use]
pub fn bilinear<T: Node>(grid: &Grid<'_, T>, east_m: f64, north_m: f64) -> f64 {
    let Some(Corners { nodes: [sw, se, nw, ne], fe, fn_ }) = grid.corners(east_m, north_m) else {
        return f64::NAN;
    };
    (1.0 - fn_) * ((1.0 - fe) * sw + fe * se) + fn_ * ((1.0 - fe) * nw + fe * ne)
}

/// ∂depth/∂(east, north) of the bilinear surface; NaN where there is no depth.
#[must_use]
pub fn gradient<T: Node>(grid: &Grid<'_, T>, east_m: f64, north_m: f64) -> [f64; 2] {
    let Some(Corners { nodes: [sw, se, nw, ne], fe, fn_ }) = grid.corners(east_m, north_m) else {
        return [f64::NAN; 2];
    };
    [
        ((1.0 - fn_) * (se - sw) + fn_ * (ne - nw)) / grid.cell_m,
        ((1.0 - fe) * (nw - sw) + fe * (ne - se)) / grid.cell_m,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_edge_is_on_the_chart_and_a_step_beyond_is_not() {
        let values: Vec<f32> = (0..20).map(|i| 15.0 + (0.9 * i as f32).sin()).collect();
        let grid = Grid { values: &values, rows: 5, cols: 4, east0_m: 10.0, north0_m: 20.0, cell_m: 2.0 };
        assert_eq!(bilinear(&grid, 10.0, 20.0), f64::from(values[0]));
        assert_eq!(bilinear(&grid, 16.0, 28.0), f64::from(values[19]));
        for (e, n) in [(9.999, 20.0), (16.001, 20.0), (10.0, 19.999), (10.0, 28.001), (f64::NAN, 20.0)] {
            assert!(bilinear(&grid, e, n).is_nan());
        }
    }
}
