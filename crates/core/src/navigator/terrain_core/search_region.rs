//! Where a vehicle may be by its start and dead reckoning alone: the prior that an acquisition searches.

use nalgebra::{Matrix2, SMatrix, SVector, Vector2};
use serde::{Deserialize, Serialize};

use crate::chart::Chart;
use crate::cloud::Cloud;
use crate::kernels::particles::{cholesky_2x2, displacement_map};
use crate::kernels::weights::weighted_covariance;
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
    /// What of the position's covariance is a fix's: evenly spread, where the rest is Gaussian.
    disc: Matrix2<f64>,
    cross: SMatrix<f64, 2, K>,
    covariance: SMatrix<f64, K, K>,
    /// A vehicle that starts is taken to be on its chart; one that was under way may have left it.
    pub on_chart: bool,
}

impl<const K: usize> SearchRegion<K> {
    /// Around a fix (covariance [ee, en, nn]), with the priors of the drift.
    pub fn around_fix(position_m: [f64; 2], [ee, en, nn]: [f64; 3], drift: &Drift) -> Self {
        Self {
            mean_m: position_m.into(),
            linear: SVector::zeros(),
            position: Matrix2::new(ee, en, en, nn),
            disc: Matrix2::new(ee, en, en, nn),
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
            disc: Matrix2::zeros(),
            cross: SMatrix::from_fn(|r, c| weighted_covariance(w, at[r], mean[r], &columns[c], linear[c])),
            covariance: shared
                + SMatrix::from_fn(|r, c| {
                    weighted_covariance(w, &columns[r], linear[r], &columns[c], linear[c])
                }),
            on_chart: false,
        }
    }

    /// Dead reckoning over `dt_s` with the commanded velocity; `walk_m2`: process noise of the position, [ee, en, nn].
    pub fn advance(&mut self, velocity_mps: [f64; 2], dt_s: f64, walk_m2: [f64; 3], drift: &Drift) {
        let map = displacement_map::<K>(velocity_mps, dt_s);
        let f = SMatrix::<f64, 2, K>::from_fn(|r, c| map[r][c]);
        let [ee, en, nn] = walk_m2;
        self.mean_m += Vector2::from(velocity_mps) * dt_s + f * self.linear;
        let coupled = f * self.cross.transpose();
        self.position += coupled
            + coupled.transpose()
            + f * self.covariance * f.transpose()
            + Matrix2::new(ee, en, en, nn);
        self.cross += f * self.covariance;
        self.covariance += drift.walk::<K>(dt_s);
    }

    /// Moves it by `by_m`.
    pub fn shift(&mut self, by_m: [f64; 2]) {
        self.mean_m += Vector2::from(by_m);
    }

    /// The error of the velocity may be larger by `more`, m²/s² on each axis.
    pub fn widen(&mut self, more: f64) {
        self.covariance[(0, 0)] += more;
        self.covariance[(1, 1)] += more;
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
        self.disc = Matrix2::zeros();
    }

    /// Mean and covariance [ee, en, nn] of the position, m and m².
    pub fn position(&self) -> ([f64; 2], [f64; 3]) {
        (self.mean_m.into(), [self.position[(0, 0)], self.position[(0, 1)], self.position[(1, 1)]])
    }

    /// Scatters particles over the region, the linear states to what each position makes of them. Returns the linear
    /// covariance about those means.
    pub fn scatter(
        &self,
        cloud: &mut Cloud<K>,
        chart: &Chart,
        mut stream: impl FnMut() -> Stream,
    ) -> SMatrix<f64, K, K> {
        let grid = chart.grid();
        let low = [grid.east0_m, grid.north0_m];
        let span = [grid.cols - 1, grid.rows - 1].map(|cells| cells as f64 * grid.cell_m);
        // Twice the sigma reaches over the chart on all sides: a start says nothing but "on the chart".
        let whole = self.on_chart
            && [0, 1].iter().all(|&a| {
                let reach = 2.0 * self.position[(a, a)].sqrt();
                self.mean_m[a] - reach <= low[a] && self.mean_m[a] + reach >= low[a] + span[a]
            });
        if whole {
            let stream = stream();
            stream.uniforms(0, &mut cloud.east);
            stream.uniforms(1, &mut cloud.north);
            cloud.east.iter_mut().for_each(|e| *e = low[0] + *e * span[0]);
            cloud.north.iter_mut().for_each(|n| *n = low[1] + *n * span[1]);
        } else {
            self.draw(cloud, &stream(), |_, _| true);
            let beyond = |e: f64, n: f64| {
                !(0.0..=span[0]).contains(&(e - low[0])) || !(0.0..=span[1]).contains(&(n - low[1]))
            };
            let any = |cloud: &Cloud<K>| cloud.east.iter().zip(&cloud.north).any(|(e, n)| beyond(*e, *n));
            let mut redraws = if self.on_chart { REDRAWS } else { 0 };
            while redraws > 0 && any(cloud) {
                self.draw(cloud, &stream(), beyond);
                redraws -= 1;
            }
        }
        self.condition(cloud)
    }

    /// Draws the positions of those particles anew for which `which` holds.
    fn draw(&self, cloud: &mut Cloud<K>, stream: &Stream, which: impl Fn(f64, f64) -> bool) {
        let n = cloud.len();
        let mut columns: [Vec<f64>; 4] = std::array::from_fn(|_| vec![0.0; n]);
        let [u, v, a, b] = &mut columns;
        stream.uniforms(0, u);
        stream.uniforms(1, v);
        stream.normal_pairs(2, a, b);
        let root = |m: Matrix2<f64>| cholesky_2x2([m[(0, 0)], m[(0, 1)], m[(1, 1)]]);
        let (disc, rest) = (root(self.disc), root(self.position - self.disc));
        for (i, (e, n)) in cloud.east.iter_mut().zip(&mut cloud.north).enumerate() {
            if which(*e, *n) {
                let radius = 2.0 * u[i].sqrt();
                let (sin, cos) = (std::f64::consts::TAU * v[i]).sin_cos();
                let (x, y) = (radius * cos, radius * sin);
                *e = self.mean_m[0] + disc[0] * x + rest[0] * a[i];
                *n = self.mean_m[1] + disc[1] * x + disc[2] * y + rest[1] * a[i] + rest[2] * b[i];
            }
        }
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

    /// What the charted seabed is like under the particles of a fresh scatter; `None` where none has a depth.
    pub fn seabed(chart: &Chart, cloud: &Cloud<K>) -> Option<Seabed> {
        let places = || cloud.east.iter().zip(&cloud.north);
        let depths: Vec<f64> = places().filter_map(|(e, n)| chart.depth_at(*e, *n)).collect();
        let slopes = places().filter_map(|(e, n)| chart.gradient_at(*e, *n)).map(|[e, n]| e * e + n * n);
        if depths.is_empty() {
            return None;
        }
        let count = depths.len() as f64;
        let mean_m = depths.iter().sum::<f64>() / count;
        let relief_m2 = depths.iter().map(|d| (d - mean_m).powi(2)).sum::<f64>() / count;
        Some(Seabed { mean_m, relief_m2, slope2: slopes.sum::<f64>() / count })
    }
}

/// What a seabed is like on the whole.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub struct Seabed {
    /// Mean depth, m.
    pub mean_m: f64,
    /// Variance of the depth, m².
    pub relief_m2: f64,
    /// Mean square of the slope.
    pub slope2: f64,
}
