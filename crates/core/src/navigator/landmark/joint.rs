//! One Gaussian over the own pose, the landmark's pose and the sensors' biases.

use nalgebra::{Matrix2x3, Matrix3, Matrix6, Rotation2, SMatrix, SVector, Vector2, Vector3, Vector6};
use serde::{Deserialize, Serialize};

use super::model::{Measurement, Pose, to_polar, wrap};
use super::odometry::Increment;
use crate::mixture::Mode;

/// Own pose (3), landmark's pose (3), gyro bias, DVL scale, DVL misalignment.
pub const STATES: usize = 9;
/// Mean of all states.
pub type State = SVector<f64, STATES>;
/// Covariance of all states.
pub type Covariance = SMatrix<f64, STATES, STATES>;

/// Mean and covariance, angles wrapped.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Joint {
    /// [own e, n, yaw, landmark e, n, yaw, gyro bias rad/s, DVL scale, DVL misalignment rad].
    pub mean: State,
    /// Its covariance.
    pub covariance: Covariance,
}

/// What keeps a variance from vanishing where it is divided by: 0.1 mm, 0.001°.
const FLOOR: [f64; 3] = [1e-8, 1e-8, 3e-10];

impl Joint {
    /// A start: own pose and biases apart, the landmark known exactly.
    #[must_use]
    pub fn new(
        own: Vector3<f64>,
        own_covariance: Matrix3<f64>,
        landmark: Pose,
        bias_sigma: [f64; 3],
    ) -> Self {
        let mut joint = Self { mean: State::zeros(), covariance: Covariance::zeros() };
        joint.mean.fixed_rows_mut::<3>(0).copy_from(&own);
        joint.mean.fixed_rows_mut::<3>(3).copy_from(&Vector3::from(landmark));
        joint.covariance.fixed_view_mut::<3, 3>(0, 0).copy_from(&own_covariance);
        for (k, sigma) in bias_sigma.into_iter().enumerate() {
            joint.covariance[(6 + k, 6 + k)] = sigma * sigma;
        }
        joint
    }

    /// Own pose.
    #[must_use]
    pub fn own(&self) -> Pose {
        [self.mean[0], self.mean[1], self.mean[2]]
    }

    /// The landmark's.
    #[must_use]
    pub fn landmark(&self) -> Pose {
        [self.mean[3], self.mean[4], self.mean[5]]
    }

    /// The biases.
    #[must_use]
    pub fn bias(&self) -> Vector3<f64> {
        self.mean.fixed_rows::<3>(6).into_owned()
    }

    /// Moves the own pose by pre-integrated odometry; the gyro's bias walks by `walk` rad/s/√s.
    pub fn advance(&mut self, increment: &Increment, walk: f64) {
        let turn = Rotation2::new(self.mean[2]);
        let (displacement, yaw) = increment.corrected(&self.bias());
        let moved = turn * displacement;
        let mut transition = Covariance::identity();
        transition[(0, 2)] = -moved.y;
        transition[(1, 2)] = moved.x;
        let by_position = turn.matrix() * increment.by_bias.fixed_view::<2, 3>(0, 0);
        transition.fixed_view_mut::<2, 3>(0, 6).copy_from(&by_position);
        transition.fixed_view_mut::<1, 3>(2, 6).copy_from(&increment.by_bias.fixed_view::<1, 3>(2, 0));
        let mut frame = Matrix3::identity();
        frame.fixed_view_mut::<2, 2>(0, 0).copy_from(turn.matrix());
        let noise = frame * increment.covariance * frame.transpose();
        let mut covariance = transition * self.covariance * transition.transpose();
        let own = covariance.fixed_view::<3, 3>(0, 0) + noise;
        covariance.fixed_view_mut::<3, 3>(0, 0).copy_from(&own);
        // A bias that is known to be zero does not walk.
        if covariance[(6, 6)] > 0.0 {
            covariance[(6, 6)] += walk * walk * increment.dt_s;
        }
        self.covariance = symmetric(&covariance);
        self.mean[0] += moved.x;
        self.mean[1] += moved.y;
        self.mean[2] = wrap(self.mean[2] + yaw);
    }

    /// Adds independent noise to the own pose.
    pub fn disturb(&mut self, sigma_m: f64, sigma_rad: f64) {
        for (k, sigma) in [sigma_m, sigma_m, sigma_rad].into_iter().enumerate() {
            self.covariance[(k, k)] += sigma * sigma;
        }
    }

    /// Innovation and its row of derivatives for one channel; `delay` is the motion from transmission to reception.
    #[must_use]
    pub fn channel(
        &self,
        channel: usize,
        measured: f64,
        delay: &Increment,
    ) -> (f64, SMatrix<f64, 1, STATES>) {
        let (own, landmark) = (self.own(), self.landmark());
        let at = at_transmit(own, delay, &self.bias());
        // How the position at transmission turns with the yaw at reception.
        let swing = Vector2::new(-(own[1] - at[1]), own[0] - at[0]);
        let here = Vector2::new(own[0] - landmark[0], own[1] - landmark[1]);
        let there = Vector2::new(at[0] - landmark[0], at[1] - landmark[1]);
        let mut row = SMatrix::<f64, 1, STATES>::zeros();
        let mut put = |k: usize, g: Vector2<f64>| {
            row[k] += g.x;
            row[k + 1] += g.y;
        };
        // Where the two stand on one spot a direction says nothing.
        let (r_here, r_there) = (here.norm().max(1e-3), there.norm().max(1e-3));
        let innovation = match channel {
            0 => {
                let (u, v) = (here / r_here * 0.5, there / r_there * 0.5);
                put(0, u + v);
                put(3, -u - v);
                // d(at)/d(yaw) = −d(own − at)/d(yaw).
                row[2] = -v.dot(&swing);
                measured - 0.5 * (r_here + r_there)
            }
            1 => {
                let g = Vector2::new(-here.y, here.x) / (r_here * r_here);
                put(0, g);
                put(3, -g);
                row[2] = -1.0;
                wrap(measured + own[2] - (-here.y).atan2(-here.x))
            }
            _ => {
                let g = Vector2::new(-there.y, there.x) / (r_there * r_there);
                put(0, g);
                put(3, -g);
                row[2] = -g.dot(&swing);
                row[5] = -1.0;
                wrap(measured + landmark[2] - there.y.atan2(there.x))
            }
        };
        (innovation, row)
    }

    /// One scalar measurement; `outlier` is (ε, W). Returns the share of the measurement that was believed.
    ///
    /// The posterior of the mixture (1 − ε) N(ν; 0, S) + ε / W is replaced by its mean and covariance.
    pub fn update(
        &mut self,
        innovation: f64,
        row: &SMatrix<f64, 1, STATES>,
        variance: f64,
        outlier: Option<(f64, f64)>,
    ) -> f64 {
        let cross = self.covariance * row.transpose();
        let s = (row * cross)[0] + variance;
        let believed = outlier.map_or(1.0, |(share, width)| {
            let inlier = (1.0 - share) * (-0.5 * innovation * innovation / s).exp()
                / (std::f64::consts::TAU * s).sqrt();
            inlier / (inlier + share / width)
        });
        let gain = cross / s;
        self.mean += gain * (believed * innovation);
        self.mean[2] = wrap(self.mean[2]);
        self.mean[5] = wrap(self.mean[5]);
        let spread = believed * (1.0 - believed) * innovation * innovation - believed * s;
        self.covariance = symmetric(&(self.covariance + gain * gain.transpose() * spread));
        believed
    }

    /// Own pose as the landmark sees it, and its covariance.
    #[must_use]
    pub fn relative(&self) -> (Vector3<f64>, Matrix3<f64>) {
        let (z, j) = relative(self.own(), self.landmark());
        let p = self.covariance.fixed_view::<6, 6>(0, 0);
        (z, j * p * j.transpose())
    }

    /// Own pose := the landmark's ⊕ z; biases stay, their correlation with the old own pose goes.
    pub fn place_own(&mut self, z: &Vector3<f64>, covariance: &Matrix3<f64>) {
        let landmark = self.landmark();
        let turn = Rotation2::new(landmark[2]);
        let arm = turn * Vector2::new(z.x, z.y);
        let mut by_landmark = Matrix3::identity();
        by_landmark[(0, 2)] = -arm.y;
        by_landmark[(1, 2)] = arm.x;
        let mut frame = Matrix3::identity();
        frame.fixed_view_mut::<2, 2>(0, 0).copy_from(turn.matrix());
        let mut from = Covariance::identity();
        from.fixed_view_mut::<3, 3>(0, 0).fill(0.0);
        from.fixed_view_mut::<3, 3>(0, 3).copy_from(&by_landmark);
        let mut p = from * self.covariance * from.transpose();
        let own = p.fixed_view::<3, 3>(0, 0) + frame * covariance * frame.transpose();
        p.fixed_view_mut::<3, 3>(0, 0).copy_from(&own);
        self.covariance = symmetric(&p);
        self.mean[0] = landmark[0] + arm.x;
        self.mean[1] = landmark[1] + arm.y;
        self.mean[2] = wrap(landmark[2] + z.z);
    }

    /// The landmark's pose := the own one seen from where the own pose is z: a landmark that nobody told of.
    pub fn place_landmark(&mut self, z: &Vector3<f64>, covariance: &Matrix3<f64>) {
        let own = self.own();
        let yaw = wrap(own[2] - z.z);
        let turn = Rotation2::new(yaw);
        let arm = turn * Vector2::new(z.x, z.y);
        // L = own − R(ψ − z_ψ) z.
        let mut by_own = Matrix3::identity();
        by_own[(0, 2)] = arm.y;
        by_own[(1, 2)] = -arm.x;
        let mut by_z = -Matrix3::identity();
        by_z.fixed_view_mut::<2, 2>(0, 0).copy_from(&-turn.matrix());
        by_z[(0, 2)] = -arm.y;
        by_z[(1, 2)] = arm.x;
        let mut from = Covariance::identity();
        from.fixed_view_mut::<3, 3>(3, 3).fill(0.0);
        from.fixed_view_mut::<3, 3>(3, 0).copy_from(&by_own);
        let mut p = from * self.covariance * from.transpose();
        let landmark = p.fixed_view::<3, 3>(3, 3) + by_z * covariance * by_z.transpose();
        p.fixed_view_mut::<3, 3>(3, 3).copy_from(&landmark);
        self.covariance = symmetric(&p);
        self.mean[3] = own[0] - arm.x;
        self.mean[4] = own[1] - arm.y;
        self.mean[5] = yaw;
    }

    /// The pair (own, landmark) in the packet's coordinates.
    #[must_use]
    pub fn polar(&self) -> Mode<6> {
        let (own, landmark) = (self.own(), self.landmark());
        let u = to_polar(own, landmark);
        let j = polar_by_poses(&u);
        let p = self.covariance.fixed_view::<6, 6>(0, 0);
        Mode { weight: 1.0, mean: Vector6::from(u), covariance: j * p * j.transpose() }
    }

    /// Biases of this belief given a new one on the own pose, which `sent` was when it was broadcast.
    ///
    /// The packet holds (M, L); L is this vehicle. Own pose := L, landmark := M, and what is known of the biases given
    /// the own pose stays: their correlation comes back with the packet, for no bytes.
    pub fn take_over(&mut self, sent: &Self, pair: &Pair) {
        let own: Matrix3<f64> = sent.covariance.fixed_view::<3, 3>(0, 0).into_owned();
        let cross: Matrix3<f64> = sent.covariance.fixed_view::<3, 3>(6, 0).into_owned();
        let gain = gain_on(&own, &cross);
        let shift = difference(&pair.landmark(), &Vector3::from(sent.own()));
        let bias = sent.bias() + gain * shift;
        let own_now: Matrix3<f64> = pair.covariance.fixed_view::<3, 3>(3, 3).into_owned();
        let left = sent.covariance.fixed_view::<3, 3>(6, 6) - gain * own * gain.transpose();
        let mut p = Covariance::zeros();
        p.fixed_view_mut::<3, 3>(0, 0).copy_from(&own_now);
        p.fixed_view_mut::<3, 3>(3, 3).copy_from(&pair.covariance.fixed_view::<3, 3>(0, 0));
        let pose_cross = pair.covariance.fixed_view::<3, 3>(3, 0);
        p.fixed_view_mut::<3, 3>(0, 3).copy_from(&pose_cross);
        p.fixed_view_mut::<3, 3>(6, 6).copy_from(&(left + gain * own_now * gain.transpose()));
        p.fixed_view_mut::<3, 3>(6, 0).copy_from(&(gain * own_now));
        p.fixed_view_mut::<3, 3>(6, 3).copy_from(&(gain * pose_cross));
        mirror(&mut p);
        self.covariance = symmetric(&p);
        self.mean.fixed_rows_mut::<3>(0).copy_from(&pair.landmark());
        self.mean.fixed_rows_mut::<3>(3).copy_from(&pair.mover());
        self.mean.fixed_rows_mut::<3>(6).copy_from(&bias);
    }

    /// A follower's update: own pose and biases given the *old* landmark pose that the packet carries, then the new
    /// landmark in its place. G = Cov(X, L) Cov(L)⁻¹.
    pub fn follow(&mut self, pair: &Pair) {
        let pick = |joint: &Covariance| {
            let mut cross = SMatrix::<f64, 6, 3>::zeros();
            cross.fixed_view_mut::<3, 3>(0, 0).copy_from(&joint.fixed_view::<3, 3>(0, 3));
            cross.fixed_view_mut::<3, 3>(3, 0).copy_from(&joint.fixed_view::<3, 3>(6, 3));
            cross
        };
        let mut x = Matrix6::zeros();
        for (a, i) in [0, 1, 2, 6, 7, 8].into_iter().enumerate() {
            for (b, j) in [0, 1, 2, 6, 7, 8].into_iter().enumerate() {
                x[(a, b)] = self.covariance[(i, j)];
            }
        }
        let old: Matrix3<f64> = self.covariance.fixed_view::<3, 3>(3, 3).into_owned();
        let gain = gain_on(&old, &pick(&self.covariance));
        let shift = gain * difference(&pair.landmark(), &Vector3::from(self.landmark()));
        let now: Matrix3<f64> = pair.covariance.fixed_view::<3, 3>(3, 3).into_owned();
        let x = x - gain * old * gain.transpose() + gain * now * gain.transpose();
        let cross = gain * pair.covariance.fixed_view::<3, 3>(3, 0);
        let mut p = Covariance::zeros();
        for (a, i) in [0, 1, 2, 6, 7, 8].into_iter().enumerate() {
            self.mean[i] += shift[a];
            for (b, j) in [0, 1, 2, 6, 7, 8].into_iter().enumerate() {
                p[(i, j)] = x[(a, b)];
            }
            for j in 0..3 {
                p[(i, 3 + j)] = cross[(a, j)];
                p[(3 + j, i)] = cross[(a, j)];
            }
        }
        p.fixed_view_mut::<3, 3>(3, 3).copy_from(&pair.covariance.fixed_view::<3, 3>(0, 0));
        self.mean[2] = wrap(self.mean[2]);
        self.mean.fixed_rows_mut::<3>(3).copy_from(&pair.mover());
        self.covariance = symmetric(&p);
    }
}

/// What an exchange packet says, as poses: covariance over (M, L).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Pair {
    /// [M, L].
    pub mean: Vector6<f64>,
    /// Over (M, L).
    pub covariance: Matrix6<f64>,
}

impl Pair {
    /// The poses of a belief in polar form; several modes are replaced by their moments.
    #[must_use]
    pub fn of(modes: &[Mode<6>]) -> Option<Self> {
        let first = modes.first()?;
        let total: f64 = modes.iter().map(|m| m.weight).sum();
        let apart = |m: &Mode<6>| {
            let mut d = m.mean - first.mean;
            for k in [2, 4, 5] {
                d[k] = wrap(d[k]);
            }
            d
        };
        let shift: Vector6<f64> = modes.iter().map(|m| apart(m) * (m.weight / total)).sum();
        let covariance: Matrix6<f64> = modes
            .iter()
            .map(|m| {
                let d = apart(m) - shift;
                (m.covariance + d * d.transpose()) * (m.weight / total)
            })
            .sum();
        let u: [f64; 6] = (first.mean + shift).into();
        let (mover, landmark) = super::model::from_polar(u);
        let mean = Vector6::from_iterator(mover.into_iter().chain(landmark));
        let j = poses_by_polar(&u);
        Some(Self { mean, covariance: j * covariance * j.transpose() })
    }

    fn mover(&self) -> Vector3<f64> {
        self.mean.fixed_rows::<3>(0).into_owned()
    }

    fn landmark(&self) -> Vector3<f64> {
        self.mean.fixed_rows::<3>(3).into_owned()
    }
}

/// Where the mover was at transmission.
#[must_use]
pub fn at_transmit(own: Pose, delay: &Increment, bias: &Vector3<f64>) -> Pose {
    let (displacement, yaw) = delay.corrected(bias);
    let before = own[2] - yaw;
    let moved = Rotation2::new(before) * displacement;
    [own[0] - moved.x, own[1] - moved.y, wrap(before)]
}

/// Own pose in the landmark's frame, and its derivative by (own, landmark).
fn relative(own: Pose, landmark: Pose) -> (Vector3<f64>, SMatrix<f64, 3, 6>) {
    let back = Rotation2::new(-landmark[2]);
    let z = back * Vector2::new(own[0] - landmark[0], own[1] - landmark[1]);
    let mut j = SMatrix::<f64, 3, 6>::zeros();
    j.fixed_view_mut::<2, 2>(0, 0).copy_from(back.matrix());
    j.fixed_view_mut::<2, 2>(0, 3).copy_from(&-back.matrix());
    j[(0, 5)] = z.y;
    j[(1, 5)] = -z.x;
    j[(2, 2)] = 1.0;
    j[(2, 5)] = -1.0;
    (Vector3::new(z.x, z.y, wrap(own[2] - landmark[2])), j)
}

/// One positioning as the own pose at reception in the landmark's frame (23)–(25), with its covariance.
///
/// `None` unless all three channels were measured.
#[must_use]
pub fn seen(
    measured: &Measurement,
    sigma: [f64; 3],
    delay: &Increment,
    bias: &Vector3<f64>,
) -> Option<(Vector3<f64>, Matrix3<f64>)> {
    let (range, own, peer) = (measured.range_m?, measured.own_rad?, measured.peer_rad?);
    let (displacement, yaw) = delay.corrected(bias);
    let there = Vector2::new(range * peer.cos(), range * peer.sin());
    let turned = peer - own - std::f64::consts::PI;
    let here = there + Rotation2::new(turned - yaw) * displacement;
    // The direction at reception, which θ_ML looks along.
    let turned = wrap(here.y.atan2(here.x) - own - std::f64::consts::PI);
    let j = Matrix3::new(peer.cos(), 0.0, -there.y, peer.sin(), 0.0, there.x, 0.0, -1.0, 1.0); // by range, θ_ML, θ_LM
    let noise = Matrix3::from_diagonal(&Vector3::from(sigma.map(|s| s * s)));
    Some((Vector3::new(here.x, here.y, turned), j * noise * j.transpose()))
}

/// Derivative of the polar form by (M, L).
fn polar_by_poses(u: &[f64; 6]) -> Matrix6<f64> {
    let (s, c) = (u[2] + u[4]).sin_cos();
    let r = u[3].max(1e-3);
    let mut j = Matrix6::zeros();
    for k in 0..3 {
        j[(k, 3 + k)] = 1.0;
    }
    for (row, g) in [(3, [c, s]), (4, [-s / r, c / r])] {
        for (k, value) in g.into_iter().enumerate() {
            j[(row, k)] = value;
            j[(row, 3 + k)] = -value;
        }
    }
    j[(4, 5)] = -1.0;
    j[(5, 2)] = 1.0;
    j[(5, 5)] = -1.0;
    j
}

/// Derivative of (M, L) by the polar form.
fn poses_by_polar(u: &[f64; 6]) -> Matrix6<f64> {
    let (s, c) = (u[2] + u[4]).sin_cos();
    let r = u[3];
    let mut j = Matrix6::zeros();
    for k in 0..3 {
        j[(k, k)] = 1.0;
        j[(3 + k, k)] = 1.0;
    }
    for column in [2, 4] {
        j[(0, column)] = -r * s;
        j[(1, column)] = r * c;
    }
    j[(0, 3)] = c;
    j[(1, 3)] = s;
    j[(2, 5)] = 1.0;
    j
}

/// Cov(X, Y) Cov(Y)⁻¹; what is known exactly tells nothing.
fn gain_on<const N: usize>(y: &Matrix3<f64>, cross: &SMatrix<f64, N, 3>) -> SMatrix<f64, N, 3> {
    let held = y + Matrix3::from_diagonal(&Vector3::from(FLOOR));
    held.try_inverse().map_or_else(SMatrix::zeros, |inverse| cross * inverse)
}

fn difference(a: &Vector3<f64>, b: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new(a.x - b.x, a.y - b.y, wrap(a.z - b.z))
}

/// Copies the blocks that were set to their mirror images.
fn mirror(p: &mut Covariance) {
    for (row, column) in [(0, 3), (6, 0), (6, 3)] {
        let block: Matrix3<f64> = p.fixed_view::<3, 3>(row, column).transpose();
        p.fixed_view_mut::<3, 3>(column, row).copy_from(&block);
    }
}

fn symmetric(p: &Covariance) -> Covariance {
    (p + p.transpose()) * 0.5
}

/// Composes a pose seen in some frame with later motion.
#[must_use]
pub fn carried(
    pose: &Vector3<f64>,
    covariance: &Matrix3<f64>,
    increment: &Increment,
    bias: &Vector3<f64>,
) -> (Vector3<f64>, Matrix3<f64>) {
    let turn = Rotation2::new(pose.z);
    let (displacement, yaw) = increment.corrected(bias);
    let moved = turn * displacement;
    let mut transition = Matrix3::identity();
    transition[(0, 2)] = -moved.y;
    transition[(1, 2)] = moved.x;
    let mut frame = Matrix3::identity();
    frame.fixed_view_mut::<2, 2>(0, 0).copy_from(turn.matrix());
    let p =
        transition * covariance * transition.transpose() + frame * increment.covariance * frame.transpose();
    (Vector3::new(pose.x + moved.x, pose.y + moved.y, wrap(pose.z + yaw)), p)
}

/// Position rows of a pose block, for callers that want [ee, en, nn].
#[must_use]
pub fn position_block(p: &Matrix3<f64>) -> [f64; 3] {
    let top: Matrix2x3<f64> = p.fixed_view::<2, 3>(0, 0).into_owned();
    [top[(0, 0)], top[(0, 1)], top[(1, 1)]]
}
