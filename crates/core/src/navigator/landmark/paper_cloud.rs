//! The paper's particles: mover and landmark pose in six columns, with the mover's recent poses for the delay.

use std::collections::VecDeque;

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};
use serde::{Deserialize, Serialize};

use super::model::{Pose, from_polar, to_polar};
use crate::kernels::landmark::{OdometryStep, predict};
use crate::kernels::particles::gather;
use crate::measurement::angle::wrap;
use crate::mixture::{Mode, sample_counts};
use crate::random::Stream;

/// Three columns of poses.
pub type Columns = [Vec<f64>; 3];

/// How far back the poses of a transmission may lie, ns.
const MEMORY_NS: i64 = 3_000_000_000;

/// Equally weighted particles.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct PaperCloud {
    /// This vehicle's pose in each particle.
    pub own: Columns,
    /// The landmark's.
    pub landmark: Columns,
    /// Own poses at earlier instants, oldest first.
    history: VecDeque<(i64, Columns)>,
    /// When the own poses became what they are.
    valid_ns: i64,
    #[serde(skip)]
    scratch: Scratch,
}

#[derive(Debug, Clone, Default)]
struct Scratch {
    normals: [Vec<f64>; 3],
    column: Vec<f64>,
    spare: Vec<Columns>,
}

impl PaperCloud {
    /// `count` particles at one pose each.
    #[must_use]
    pub fn new(count: usize, landmark: Pose) -> Self {
        Self {
            own: std::array::from_fn(|_| vec![0.0; count]),
            landmark: landmark.map(|v| vec![v; count]),
            history: VecDeque::new(),
            valid_ns: i64::MIN,
            scratch: Scratch::default(),
        }
    }

    /// Number of particles.
    #[must_use]
    pub fn len(&self) -> usize {
        self.own[0].len()
    }

    /// True for none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.own[0].is_empty()
    }

    /// Own pose of particle i.
    #[must_use]
    pub fn own_pose(&self, i: usize) -> Pose {
        [self.own[0][i], self.own[1][i], self.own[2][i]]
    }

    /// The landmark's pose in particle i.
    #[must_use]
    pub fn landmark_pose(&self, i: usize) -> Pose {
        [self.landmark[0][i], self.landmark[1][i], self.landmark[2][i]]
    }

    /// Three columns of normals of this stream.
    fn normals(&mut self, stream: &Stream) -> &mut Scratch {
        let n = self.len();
        let scratch = &mut self.scratch;
        scratch.normals.iter_mut().for_each(|c| c.resize(n + 1, 0.0));
        scratch.column.resize(n, 0.0);
        let [a, b, c] = &mut scratch.normals;
        stream.normal_pairs(0, &mut a[..n], &mut b[..n]);
        // Both normals of a pair go into one column: none is wasted.
        let (first, second) = c.split_at_mut(n.div_ceil(2));
        stream.normal_pairs(1, first, &mut second[..n.div_ceil(2)]);
        scratch
    }

    /// Draws own positions.
    pub fn scatter_position(&mut self, mean_m: [f64; 2], covariance_m2: [f64; 3], stream: &Stream) {
        let [l11, l21, l22] = crate::kernels::particles::cholesky_2x2(covariance_m2);
        let n = self.len();
        self.normals(stream);
        let [a, b, _] = &self.scratch.normals;
        for i in 0..n {
            self.own[0][i] = mean_m[0] + l11 * a[i];
            self.own[1][i] = mean_m[1] + l21 * a[i] + l22 * b[i];
        }
    }

    /// Draws own yaws.
    pub fn scatter_yaw(&mut self, mean_rad: f64, sigma_rad: f64, stream: &Stream) {
        self.normals(stream);
        for (yaw, z) in self.own[2].iter_mut().zip(&self.scratch.normals[2]) {
            *yaw = wrap(mean_rad + sigma_rad * z);
        }
    }

    /// Spreads own yaws evenly over the circle.
    pub fn spread_yaw(&mut self) {
        let n = self.len() as f64;
        for (i, yaw) in self.own[2].iter_mut().enumerate() {
            *yaw = wrap(std::f64::consts::TAU * (i as f64 + 0.5) / n);
        }
    }

    /// Prediction (5)–(8) from `from_ns` to `to_ns`.
    pub fn predict(&mut self, step: &OdometryStep, from_ns: i64, to_ns: i64, stream: &Stream) {
        self.remember(from_ns, to_ns);
        let n = self.len();
        self.normals(stream);
        let [a, b, c] = &self.scratch.normals;
        let [x, y, yaw] = &mut self.own;
        predict(step, x, y, yaw, &a[..n], &b[..n], &c[..n]);
        self.valid_ns = to_ns;
    }

    fn remember(&mut self, from_ns: i64, to_ns: i64) {
        while self.history.front().is_some_and(|h| h.0 < to_ns.saturating_sub(MEMORY_NS)) {
            if let Some((_, columns)) = self.history.pop_front() {
                self.scratch.spare.push(columns);
            }
        }
        let mut columns = self.scratch.spare.pop().unwrap_or_default();
        for (to, from) in columns.iter_mut().zip(&self.own) {
            to.clone_from(from);
        }
        self.history.push_back((from_ns, columns));
    }

    /// Own poses as they were at `t_ns`, interpolated between steps; the oldest remembered ones before that.
    #[must_use]
    pub fn at(&self, t_ns: i64) -> Columns {
        if t_ns >= self.valid_ns || self.history.is_empty() {
            return self.own.clone();
        }
        let after = self.history.partition_point(|h| h.0 <= t_ns);
        let (late_ns, late) = match self.history.get(after) {
            Some((t, columns)) => (*t, columns),
            None => (self.valid_ns, &self.own),
        };
        let Some((early_ns, early)) = after.checked_sub(1).and_then(|i| self.history.get(i)) else {
            return late.clone();
        };
        let share = t_ns.saturating_sub(*early_ns) as f64 / late_ns.saturating_sub(*early_ns).max(1) as f64;
        let mut between = early.clone();
        for (column, (from, to)) in between.iter_mut().zip(early.iter().zip(late)).take(2) {
            for (out, (a, b)) in column.iter_mut().zip(from.iter().zip(to)) {
                *out = a + share * (b - a);
            }
        }
        for (out, (a, b)) in between[2].iter_mut().zip(early[2].iter().zip(&late[2])) {
            *out = wrap(a + share * wrap(b - a));
        }
        between
    }

    /// Particle i becomes a copy of `ancestors[i]`, its recent poses with it.
    pub fn resample(&mut self, ancestors: &[u32]) {
        self.scratch.column.resize(ancestors.len(), 0.0);
        let columns = self.own.iter_mut().chain(&mut self.landmark);
        for column in columns.chain(self.history.iter_mut().flat_map(|h| &mut h.1)) {
            gather(column, &mut self.scratch.column, ancestors);
        }
    }

    /// Mean (circular yaw) and covariance of the own pose.
    #[must_use]
    pub fn moments(&self) -> (Vector3<f64>, Matrix3<f64>) {
        moments(&self.own)
    }

    /// The particles in the packet's coordinates.
    #[must_use]
    pub fn polar(&self) -> Vec<SVector<f64, 6>> {
        (0..self.len()).map(|i| SVector::from(to_polar(self.own_pose(i), self.landmark_pose(i)))).collect()
    }

    /// Samples of a packet's belief: mover and landmark columns.
    pub fn expand(modes: &[Mode<6>], count: usize, stream: &Stream) -> (Columns, Columns) {
        let mut normals = vec![SVector::<f64, 6>::zeros(); count];
        let (mut a, mut b) = (vec![0.0; count], vec![0.0; count]);
        for pair in 0..3 {
            stream.normal_pairs(pair as u32, &mut a, &mut b);
            for (i, z) in normals.iter_mut().enumerate() {
                z[2 * pair] = a[i];
                z[2 * pair + 1] = b[i];
            }
        }
        expand(modes, &normals)
    }

    /// The old landmark's turn: own := L, landmark := M of the packet.
    pub fn become_landmark(&mut self, modes: &[Mode<6>], stream: &Stream) {
        (self.landmark, self.own) = Self::expand(modes, self.len(), stream);
        self.history.clear();
        self.valid_ns = i64::MIN;
    }

    /// A follower's turn: own pose moved with the old landmark's, Cov(S, L) Cov(L)⁻¹ (L' − L), then the new landmark.
    ///
    /// The reference of the method for several vehicles is another paper; this is METHODS' condition on the old
    /// landmark pose, applied to samples.
    pub fn adopt_landmark(&mut self, modes: &[Mode<6>], stream: &Stream) {
        let (mover, told) = Self::expand(modes, self.len(), stream);
        let (own_mean, _) = moments(&self.own);
        let (mean, covariance) = moments(&self.landmark);
        let n = self.len() as f64;
        let mut cross = Matrix3::zeros();
        for i in 0..self.len() {
            let s = apart(&Vector3::from(self.own_pose(i)), &own_mean);
            let l = apart(&Vector3::from(self.landmark_pose(i)), &mean);
            cross += s * l.transpose() / n;
        }
        let held = covariance + Matrix3::from_diagonal(&Vector3::new(1e-6, 1e-6, 1e-8));
        let gain: SMatrix<f64, 3, 3> =
            held.try_inverse().map_or_else(SMatrix::zeros, |inverse| cross * inverse);
        let told = told[0].iter().zip(&told[1]).zip(&told[2]);
        for (i, ((x, y), yaw)) in told.enumerate() {
            let new = Vector3::new(*x, *y, *yaw);
            let shift = gain * apart(&new, &Vector3::from(self.landmark_pose(i)));
            for k in 0..3 {
                self.own[k][i] += shift[k];
            }
            self.own[2][i] = wrap(self.own[2][i]);
        }
        self.landmark = mover;
    }
}

/// Samples of modes in polar form from given normals: (M, L) columns; the samples of a mode stand together.
#[must_use]
pub fn expand(modes: &[Mode<6>], normals: &[SVector<f64, 6>]) -> (Columns, Columns) {
    let count = normals.len();
    let mut mover: Columns = std::array::from_fn(|_| Vec::with_capacity(count));
    let mut landmark: Columns = std::array::from_fn(|_| Vec::with_capacity(count));
    let mut left = normals.iter();
    for (mode, share) in modes.iter().zip(sample_counts(modes, count)) {
        let root = mode.covariance.cholesky().map_or_else(SMatrix::zeros, |c| c.unpack());
        for z in left.by_ref().take(share) {
            let (m, l) = from_polar((mode.mean + root * z).into());
            for k in 0..3 {
                mover[k].push(m[k]);
                landmark[k].push(l[k]);
            }
        }
    }
    (mover, landmark)
}

fn apart(a: &Vector3<f64>, b: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new(a.x - b.x, a.y - b.y, wrap(a.z - b.z))
}

/// Mean (circular yaw) and covariance of equally weighted poses.
#[must_use]
pub fn moments(columns: &Columns) -> (Vector3<f64>, Matrix3<f64>) {
    let n = columns[0].len() as f64;
    let (sin, cos) = columns[2].iter().fold((0.0, 0.0), |(s, c), yaw| {
        let (y, x) = yaw.sin_cos();
        (s + y, c + x)
    });
    let mean =
        Vector3::new(columns[0].iter().sum::<f64>() / n, columns[1].iter().sum::<f64>() / n, sin.atan2(cos));
    let mut covariance = Matrix3::zeros();
    for ((x, y), yaw) in columns[0].iter().zip(&columns[1]).zip(&columns[2]) {
        let d = Vector3::new(x - mean.x, y - mean.y, wrap(yaw - mean.z));
        covariance += d * d.transpose();
    }
    (mean, covariance / n)
}
