//! Where a vehicle may be by its start and dead reckoning alone: the prior that an acquisition searches.

use nalgebra::{Matrix2, SMatrix, SVector, Vector2};
use serde::{Deserialize, Serialize};

use crate::chart::Chart;
use crate::cloud::Cloud;
use crate::kernels::particles::{cholesky_2x2, displacement_map};
use crate::kernels::weights::{weighted_covariance, weighted_mean};
use crate::navigator::drift::Drift;
use crate::random::Stream;

/// Positions of a start that are off the chart are drawn again at most so often.
const REDRAWS: u32 = 32;

/// Joint Gaussian of the position and the linear states, predicted by dead reckoning and never updated by soundings.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct SearchRegion<const K: usize> {
    mean_m: Vector2<f64>,
    linear: SVector<f64, K>,
    position: Matrix2<f64>,
    cross: SMatrix<f64, 2, K>,
    covariance: SMatrix<f64, K, K>,
    /// A vehicle that starts is taken to be on its chart; one that was under way may have left it.
    on_chart: bool,
}

impl<const K: usize> SearchRegion<K> {
    /// Around a fix (covariance [ee, en, nn]), with the priors of the drift.
    pub fn around_fix(position_m: [f64; 2], [ee, en, nn]: [f64; 3], drift: &Drift) -> Self {
        Self {
            mean_m: position_m.into(),
            linear: SVector::zeros(),
            position: Matrix2::new(ee, en, en, nn),
            cross: SMatrix::zeros(),
            covariance: drift.prior(),
            on_chart: true,
        }
    }

    /// What a cloud says, `shared` being the covariance of its linear states about each particle's mean.
    pub fn of_cloud(cloud: &Cloud<K>, shared: &SMatrix<f64, K, K>) -> Self {
        let w = cloud.weights();
        let (mean, [ee, en, nn]) = cloud.position_moments();
        let linear = cloud.linear_mean();
        let (at, columns) = ([&cloud.east, &cloud.north], &cloud.linear);
        Self {
            mean_m: mean.into(),
            linear: linear.into(),
            position: Matrix2::new(ee, en, en, nn),
            cross: SMatrix::from_fn(|r, c| weighted_covariance(w, at[r], mean[r], &columns[c], linear[c])),
            covariance: shared
                + SMatrix::from_fn(|r, c| {
                    weighted_covariance(w, &columns[r], linear[r], &columns[c], linear[c])
                }),
            on_chart: false,
        }
    }

    /// Dead reckoning over `dt_s` with the commanded velocity.
    pub fn advance(&mut self, velocity_mps: [f64; 2], dt_s: f64, drift: &Drift) {
        let map = displacement_map::<K>(velocity_mps, dt_s);
        let f = SMatrix::<f64, 2, K>::from_fn(|r, c| map[r][c]);
        let [ee, en, nn] = drift.position_walk(dt_s);
        self.mean_m += Vector2::from(velocity_mps) * dt_s + f * self.linear;
        let coupled = f * self.cross.transpose();
        self.position += coupled
            + coupled.transpose()
            + f * self.covariance * f.transpose()
            + Matrix2::new(ee, en, en, nn);
        self.cross += f * self.covariance;
        self.covariance += drift.walk::<K>(dt_s);
    }

    /// Updates it by a fix.
    pub fn fix(&mut self, position_m: [f64; 2], [ee, en, nn]: [f64; 3]) {
        let Some(inverse) = (self.position + Matrix2::new(ee, en, en, nn)).try_inverse() else { return };
        let off = Vector2::from(position_m) - self.mean_m;
        let (gain, coupled) = (self.position * inverse, self.cross.transpose() * inverse);
        self.mean_m += gain * off;
        self.linear += coupled * off;
        let position = self.position - gain * self.position;
        self.covariance -= coupled * self.cross;
        self.cross -= gain * self.cross;
        self.position = (position + position.transpose()) * 0.5;
    }

    /// Mean and covariance [ee, en, nn] of the position, m and m².
    pub fn position(&self) -> ([f64; 2], [f64; 3]) {
        (self.mean_m.into(), [self.position[(0, 0)], self.position[(0, 1)], self.position[(1, 1)]])
    }

    /// Scatters particles evenly over the region's ellipse of twice the standard deviation (for a fix, its disc), the linear
    /// states to what each position makes of them. Returns the linear covariance about those means.
    pub fn scatter(
        &self,
        cloud: &mut Cloud<K>,
        chart: &Chart,
        mut stream: impl FnMut() -> Stream,
    ) -> SMatrix<f64, K, K> {
        let (mean, covariance) = self.position();
        cloud.scatter_disc(mean, covariance, &stream());
        let grid = chart.grid();
        let low = [grid.east0_m, grid.north0_m];
        let span = [grid.cols - 1, grid.rows - 1].map(|cells| cells as f64 * grid.cell_m);
        let off = |e: f64, n: f64| {
            !(0.0..=span[0]).contains(&(e - low[0])) || !(0.0..=span[1]).contains(&(n - low[1]))
        };
        // Twice the sigma reaches over the chart on all sides: it says nothing but "on the chart".
        let whole = [0, 1].iter().all(|&a| {
            let reach = 2.0 * self.position[(a, a)].sqrt();
            mean[a] - reach <= low[a] && mean[a] + reach >= low[a] + span[a]
        });
        let [l11, l21, l22] = cholesky_2x2(covariance);
        let redraws = if !self.on_chart {
            0
        } else if whole {
            1
        } else {
            REDRAWS
        };
        let (mut u, mut v) = (vec![0.0; cloud.len()], vec![0.0; cloud.len()]);
        for _ in 0..redraws {
            if !whole && !cloud.east.iter().zip(&cloud.north).any(|(e, n)| off(*e, *n)) {
                break;
            }
            let stream = stream();
            stream.uniforms(0, &mut u);
            stream.uniforms(1, &mut v);
            for ((e, n), (u, v)) in cloud.east.iter_mut().zip(&mut cloud.north).zip(u.iter().zip(&v)) {
                if whole {
                    (*e, *n) = (low[0] + u * span[0], low[1] + v * span[1]);
                } else if off(*e, *n) {
                    let radius = 2.0 * u.sqrt();
                    let (sin, cos) = (std::f64::consts::TAU * v).sin_cos();
                    *e = mean[0] + l11 * radius * cos;
                    *n = mean[1] + l21 * radius * cos + l22 * radius * sin;
                }
            }
        }
        self.condition(cloud)
    }

    /// Linear states given each particle's position; returns their covariance about that.
    fn condition(&self, cloud: &mut Cloud<K>) -> SMatrix<f64, K, K> {
        let gain = self
            .position
            .try_inverse()
            .map_or_else(SMatrix::<f64, K, 2>::zeros, |inverse| self.cross.transpose() * inverse);
        for i in 0..cloud.len() {
            let off = Vector2::new(cloud.east[i] - self.mean_m[0], cloud.north[i] - self.mean_m[1]);
            let linear = self.linear + gain * off;
            for (column, value) in cloud.linear.iter_mut().zip(&linear) {
                column[i] = *value;
            }
        }
        let left = self.covariance - gain * self.cross;
        (left + left.transpose()) * 0.5
    }

    /// Mean and variance of the charted depth over the particles of a fresh scatter; `None` where none has one.
    pub fn depths(chart: &Chart, cloud: &Cloud<K>) -> Option<[f64; 2]> {
        let known: Vec<f64> =
            cloud.east.iter().zip(&cloud.north).filter_map(|(e, n)| chart.depth_at(*e, *n)).collect();
        if known.is_empty() {
            return None;
        }
        let weights = vec![1.0 / known.len() as f64; known.len()];
        let mean = weighted_mean(&weights, &known);
        Some([mean, weighted_covariance(&weights, &known, mean, &known, mean)])
    }
}
