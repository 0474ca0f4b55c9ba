//! An immutable depth grid in the local frame, with its own quality.
//!
//! ```text
//! row i ↑ north0 + i·cell      (0,0) is the south-west node; depth positive down, m
//!       └→ column j, east0 + j·cell
//! ```
//! A lookup is bilinear between the four nodes around a point. Off the chart or where one of the four is a hole
//! (NaN) there is no depth; nothing is clamped.

mod hole_filling;

use crate::error::{Error, non_negative};
use crate::kernels::lookup::{self, Grid, Paired};

/// Standard deviation of a chart's error.
#[derive(Debug, Clone, PartialEq)]
pub enum SigmaMap {
    /// The same everywhere, m.
    Uniform(f64),
    /// One for each node, m; a cell that has none takes `fallback`.
    PerNode {
        /// Row-major, like the depths.
        sigma_m: Vec<f32>,
        /// Used where the node's own value is not finite, m.
        fallback: f64,
    },
}

/// A depth grid with its geometry and quality.
#[derive(Debug, Clone, PartialEq)]
pub struct Chart {
    nodes: Vec<Paired>,
    rows: usize,
    cols: usize,
    east0_m: f64,
    north0_m: f64,
    cell_m: f64,
    sigma_map: SigmaMap,
    correlation_length_m: f64,
    mean_depth_m: f64,
    depth_range_m: [f64; 2],
}

impl Chart {
    /// Builds a chart from row-major depths, southernmost row first.
    ///
    /// # Errors
    /// [`Error::Chart`] if the grid is smaller than 2 × 2, of the wrong length or all holes; [`Error::NotFinite`] or
    /// [`Error::OutOfBound`] for a geometry or quality that makes no sense.
    #[allow(clippy::too_many_arguments)]
    pub fn new(
        depth_m: Vec<f32>,
        rows: usize,
        cols: usize,
        east0_m: f64,
        north0_m: f64,
        cell_m: f64,
        sigma_map: SigmaMap,
        correlation_length_m: f64,
    ) -> Result<Self, Error> {
        lookup::check_geometry(rows, cols, east0_m, north0_m, cell_m)?;
        if depth_m.len() != rows * cols {
            return Err(Error::Length {
                quantity: "chart depths",
                found: depth_m.len(),
                expected: rows * cols,
            });
        }
        non_negative("chart correlation_length_m", correlation_length_m)?;
        match &sigma_map {
            SigmaMap::Uniform(sigma) => {
                non_negative("chart sigma_map_m", *sigma)?;
            }
            SigmaMap::PerNode { sigma_m, fallback } => {
                non_negative("chart sigma_map_m", *fallback)?;
                if sigma_m.len() != rows * cols {
                    return Err(Error::Length {
                        quantity: "chart sigma_map_m",
                        found: sigma_m.len(),
                        expected: rows * cols,
                    });
                }
            }
        }
        let (mut sum, mut count) = (0.0, 0u64);
        let mut depth_range_m = [f64::INFINITY, f64::NEG_INFINITY];
        for d in depth_m.iter().filter(|d| d.is_finite()).map(|d| f64::from(*d)) {
            sum += d;
            count += 1;
            depth_range_m = [depth_range_m[0].min(d), depth_range_m[1].max(d)];
        }
        if count == 0 {
            return Err(Error::Chart("every node is a hole".into()));
        }
        Ok(Self {
            nodes: lookup::paired(&depth_m, cols),
            rows,
            cols,
            east0_m,
            north0_m,
            cell_m,
            sigma_map,
            correlation_length_m,
            mean_depth_m: sum / count as f64,
            depth_range_m,
        })
    }

    /// The grid that lookups work on, each node with its northern neighbour beside it: twice the memory, but one load a
    /// cell.
    #[must_use]
    pub fn grid(&self) -> Grid<'_, Paired> {
        Grid {
            values: &self.nodes,
            rows: self.rows,
            cols: self.cols,
            east0_m: self.east0_m,
            north0_m: self.north0_m,
            cell_m: self.cell_m,
        }
    }

    /// The nodes of [`Chart::grid`] with holes filled up to `reach_m` from the nearest node that has a depth, ring by ring
    /// with the mean of the known neighbours; `None` for a chart without holes.
    #[must_use]
    pub fn nodes_with_holes_filled(&self, reach_m: f64) -> Option<Vec<Paired>> {
        hole_filling::fill_holes(&self.grid(), reach_m)
    }

    /// Depth below the surface datum, m; `None` off the chart or beside a hole.
    #[must_use]
    pub fn depth_at(&self, east_m: f64, north_m: f64) -> Option<f64> {
        let depth = lookup::bilinear(&self.grid(), east_m, north_m);
        depth.is_finite().then_some(depth)
    }

    /// ∂depth/∂(east, north) inside the cell, 1; `None` where there is no depth.
    #[must_use]
    pub fn gradient_at(&self, east_m: f64, north_m: f64) -> Option<[f64; 2]> {
        let gradient = lookup::gradient(&self.grid(), east_m, north_m);
        gradient.iter().all(|g| g.is_finite()).then_some(gradient)
    }

    /// Standard deviation of the chart's error at the nearest node, m.
    #[must_use]
    pub fn sigma_map_at(&self, east_m: f64, north_m: f64) -> f64 {
        match &self.sigma_map {
            SigmaMap::Uniform(sigma) => *sigma,
            SigmaMap::PerNode { sigma_m, fallback } => {
                let column = ((east_m - self.east0_m) / self.cell_m).round();
                let row = ((north_m - self.north0_m) / self.cell_m).round();
                if !(column >= 0.0 && row >= 0.0) {
                    return *fallback;
                }
                let (column, row) = (column as usize, row as usize);
                if column >= self.cols || row >= self.rows {
                    return *fallback;
                }
                let sigma = f64::from(sigma_m[row * self.cols + column]);
                if sigma.is_finite() && sigma >= 0.0 { sigma } else { *fallback }
            }
        }
    }

    /// Quality of the chart.
    #[must_use]
    pub fn sigma_map(&self) -> &SigmaMap {
        &self.sigma_map
    }

    /// Distance over which the chart's error stays itself, m; 0 for a white or absent error.
    #[must_use]
    pub fn correlation_length_m(&self) -> f64 {
        self.correlation_length_m
    }

    /// Mean depth of all nodes, m.
    #[must_use]
    pub fn mean_depth_m(&self) -> f64 {
        self.mean_depth_m
    }

    /// Whether a water depth is possible on this chart: inside its range of depths, widened by half of that range (the
    /// seabed in holes) and by `IMPOSSIBLE_SIGMAS` times `sigma_m` (sounder, tide and chart together).
    #[must_use]
    pub fn admits(&self, water_depth_m: f64, sigma_m: f64) -> bool {
        let [shallowest, deepest] = self.depth_range_m;
        let sigma_map_m = match &self.sigma_map {
            SigmaMap::Uniform(sigma) => *sigma,
            SigmaMap::PerNode { fallback, .. } => *fallback,
        };
        let slack_m = 0.5 * (deepest - shallowest) + IMPOSSIBLE_SIGMAS * sigma_m.hypot(sigma_map_m);
        (shallowest - slack_m..=deepest + slack_m).contains(&water_depth_m)
    }
}

/// A sounding further outside the chart's depths than this many sigmas is no sounding of this seabed: a sounder that is
/// stuck, saturated, or in air.
const IMPOSSIBLE_SIGMAS: f64 = 8.0;
