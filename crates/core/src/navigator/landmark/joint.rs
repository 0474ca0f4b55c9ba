//! One Gaussian over the mover as the landmark sees it, the landmark's pose and the sensors' biases.
//!
//! Positioning and odometry depend on the relative pose only. With it as the state, no measurement has a derivative
//! by the landmark's own pose. So a chain of exchanges gains no spurious information on the common heading, which is
//! not observable, from linearisation at different poses.

use nalgebra::{Matrix3, Rotation2, SMatrix, SVector, Vector2, Vector3};
use serde::{Deserialize, Serialize};

use super::model::{Measurement, Pose};
use super::odometry::Increment;
use super::pose_algebra::{at_transmit, between, compose, composed_by, inverse_by};
use crate::information::is_sound;
use crate::measurement::angle::wrap;

/// Own pose in the landmark's frame (3), landmark's pose in the world (3), gyro bias, DVL scale, DVL misalignment.
pub const STATES: usize = 9;
/// Mean of all states.
pub type JointVector = SVector<f64, STATES>;
/// Covariance of all states.
pub type Covariance = SMatrix<f64, STATES, STATES>;

/// Mean and covariance, angles wrapped.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Joint {
    /// [own forward, left, yaw of the landmark; landmark e, n, yaw; gyro bias rad/s, DVL scale, misalignment rad].
    pub mean: JointVector,
    /// Its covariance.
    pub covariance: Covariance,
}

/// Range, own and peer's bearing: standard deviations, and (ε, widths) of their outliers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Channels {
    /// m, rad, rad.
    pub sigma: [f64; 3],
    /// `None`: no outliers, every measurement has full weight.
    pub outliers: Option<(f64, [f64; 3])>,
}

/// Update of one scalar by the mixture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScalarUpdate {
    /// Probability that it was no outlier.
    pub share: f64,
    /// Logarithm of its density before it was used.
    pub log_evidence: f64,
}

/// Update by a positioning.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Correction {
    /// For each measured channel, the probability that it was no outlier.
    pub shares: [Option<f64>; 3],
    /// Logarithm of the density of all of it.
    pub log_evidence: f64,
}

impl Joint {
    /// A start: own pose in the world and biases apart, the landmark known exactly.
    #[must_use]
    pub fn new(own: Pose, own_covariance: &Matrix3<f64>, landmark: Pose, bias_sigma: [f64; 3]) -> Self {
        let mut joint = Self { mean: JointVector::zeros(), covariance: Covariance::zeros() };
        joint.mean.fixed_rows_mut::<3>(3).copy_from(&Vector3::from(landmark));
        for (k, sigma) in bias_sigma.into_iter().enumerate() {
            joint.covariance[(6 + k, 6 + k)] = sigma * sigma;
        }
        joint.set_own_pose(own, own_covariance);
        joint
    }

    /// Sets the own pose in the world, apart from everything else.
    pub fn set_own_pose(&mut self, own: Pose, own_covariance: &Matrix3<f64>) {
        let landmark = Vector3::from(self.landmark());
        let z = between(&landmark, &Vector3::from(own));
        let mut frame = Matrix3::<f64>::identity();
        frame.fixed_view_mut::<2, 2>(0, 0).copy_from(Rotation2::new(-landmark.z).matrix());
        self.mean.fixed_rows_mut::<3>(0).copy_from(&z);
        self.covariance.fixed_view_mut::<3, STATES>(0, 0).fill(0.0);
        self.covariance.fixed_view_mut::<STATES, 3>(0, 0).fill(0.0);
        let seen = frame * own_covariance * frame.transpose();
        self.covariance.fixed_view_mut::<3, 3>(0, 0).copy_from(&seen);
    }

    /// Own pose as the landmark sees it.
    #[must_use]
    pub fn seen(&self) -> Pose {
        [self.mean[0], self.mean[1], self.mean[2]]
    }

    /// Own pose in the world.
    #[must_use]
    pub fn own(&self) -> Pose {
        compose(&Vector3::from(self.landmark()), &Vector3::from(self.seen())).into()
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

    /// Derivative of the own pose in the world by the states.
    #[must_use]
    pub fn own_rows(&self) -> SMatrix<f64, 3, STATES> {
        let (by_landmark, by_seen) =
            composed_by(&Vector3::from(self.landmark()), &Vector3::from(self.seen()));
        let mut rows = SMatrix::<f64, 3, STATES>::zeros();
        rows.fixed_view_mut::<3, 3>(0, 0).copy_from(&by_seen);
        rows.fixed_view_mut::<3, 3>(0, 3).copy_from(&by_landmark);
        rows
    }

    /// Covariance of the own pose in the world.
    #[must_use]
    pub fn own_covariance(&self) -> Matrix3<f64> {
        let rows = self.own_rows();
        rows * self.covariance * rows.transpose()
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
        let own = self.seen();
        let at = at_transmit(own, delay, &self.bias());
        // How the position at transmission turns with the yaw at reception.
        let swing = Vector2::new(-(own[1] - at[1]), own[0] - at[0]);
        let (here, there) = (Vector2::new(own[0], own[1]), Vector2::new(at[0], at[1]));
        let mut row = SMatrix::<f64, 1, STATES>::zeros();
        // Where both are at the same position a direction has no information.
        let (r_here, r_there) = (here.norm().max(1e-3), there.norm().max(1e-3));
        match channel {
            0 => {
                let (u, v) = (here / r_here * 0.5, there / r_there * 0.5);
                (row[0], row[1], row[2]) = (u.x + v.x, u.y + v.y, -v.dot(&swing));
                (measured - 0.5 * (r_here + r_there), row)
            }
            1 => {
                let g = Vector2::new(-here.y, here.x) / (r_here * r_here);
                (row[0], row[1], row[2]) = (g.x, g.y, -1.0);
                (wrap(measured + own[2] - (-here.y).atan2(-here.x)), row)
            }
            _ => {
                let g = Vector2::new(-there.y, there.x) / (r_there * r_there);
                (row[0], row[1], row[2]) = (g.x, g.y, -g.dot(&swing));
                (wrap(measured - there.y.atan2(there.x)), row)
            }
        }
    }

    /// One scalar measurement; `outlier` is (ε, W).
    ///
    /// The posterior of the mixture (1 − ε) N(ν; 0, S) + ε / W is replaced by its mean and covariance.
    pub fn update(
        &mut self,
        innovation: f64,
        row: &SMatrix<f64, 1, STATES>,
        variance: f64,
        outlier: Option<(f64, f64)>,
    ) -> ScalarUpdate {
        let cross = self.covariance * row.transpose();
        let s = (row * cross)[0] + variance;
        let log_density = -0.5 * (innovation * innovation / s + (std::f64::consts::TAU * s).ln());
        let (share, log_evidence) = outlier.map_or((1.0, log_density), |(share, width)| {
            let (inlier, wild) = ((1.0 - share) * log_density.exp(), share / width);
            (inlier / (inlier + wild), (inlier + wild).ln())
        });
        let gain = cross / s;
        self.mean += gain * (share * innovation);
        self.wrap();
        let spread = share * (1.0 - share) * innovation * innovation - share * s;
        self.covariance = symmetric(&(self.covariance + gain * gain.transpose() * spread));
        ScalarUpdate { share, log_evidence }
    }

    /// A positioning, channel by channel, the sharpest first.
    pub fn correct(&mut self, measured: &Measurement, delay: &Increment, channels: &Channels) -> Correction {
        let values = [measured.range_m, measured.own_rad, measured.peer_rad];
        let mut correction = Correction { shares: [None; 3], log_evidence: 0.0 };
        for channel in [2, 0, 1] {
            let Some(value) = values[channel] else { continue };
            let (innovation, row) = self.channel(channel, value, delay);
            let sigma = channels.sigma[channel];
            let outlier = channels.outliers.map(|(share, widths)| (share, widths[channel]));
            let believed = self.update(innovation, &row, sigma * sigma, outlier);
            correction.shares[channel] = Some(believed.share);
            correction.log_evidence += believed.log_evidence;
        }
        correction
    }

    /// A position in the world; false, and nothing changed, if it contradicts the belief by more than χ² `gate`.
    ///
    /// In Joseph's form: a sum of squares, which rounding cannot take below zero.
    pub fn fix(&mut self, position_m: [f64; 2], noise: &nalgebra::Matrix2<f64>, gate: f64) -> bool {
        let rows = self.own_rows().fixed_view::<2, STATES>(0, 0).into_owned();
        let own = self.own();
        let innovation = Vector2::new(position_m[0] - own[0], position_m[1] - own[1]);
        let s = rows * self.covariance * rows.transpose() + noise;
        let Some(inverse) = s.try_inverse() else { return false };
        if innovation.dot(&(inverse * innovation)) > gate {
            return false;
        }
        let gain = self.covariance * rows.transpose() * inverse;
        let before = self.clone();
        self.mean += gain * innovation;
        self.wrap();
        let keep = Covariance::identity() - gain * rows;
        let kept = keep * self.covariance * keep.transpose();
        self.covariance = symmetric(&(kept + gain * noise * gain.transpose()));
        // Numbers of very different size may have lost what makes them a covariance.
        let (own, covariance) = (self.own(), self.own_covariance());
        let sound = is_sound(own.iter(), 2, |row, column| covariance[(row, column)]);
        if !sound {
            *self = before;
        }
        sound
    }

    pub(super) fn wrap(&mut self) {
        for k in [2, 5] {
            self.mean[k] = wrap(self.mean[k]);
        }
    }

    /// Own pose as the landmark sees it, and its covariance.
    #[must_use]
    pub fn relative(&self) -> (Vector3<f64>, Matrix3<f64>) {
        (Vector3::from(self.seen()), self.covariance.fixed_view::<3, 3>(0, 0).into_owned())
    }

    /// Own pose := the mean of several positionings; its correlation with everything else becomes zero.
    pub fn place_own(&mut self, z: &Vector3<f64>, covariance: &Matrix3<f64>) {
        self.covariance.fixed_view_mut::<3, STATES>(0, 0).fill(0.0);
        self.covariance.fixed_view_mut::<STATES, 3>(0, 0).fill(0.0);
        self.covariance.fixed_view_mut::<3, 3>(0, 0).copy_from(covariance);
        self.mean.fixed_rows_mut::<3>(0).copy_from(z);
    }

    /// The landmark := the pose from which the own pose is at z, for a landmark whose packet was lost.
    pub fn place_landmark(&mut self, z: &Vector3<f64>, covariance: &Matrix3<f64>) {
        let own = Vector3::from(self.own());
        let back = between(z, &Vector3::zeros());
        let (by_own, by_back) = composed_by(&own, &back);
        let mut from = Covariance::identity();
        from.fixed_view_mut::<6, STATES>(0, 0).fill(0.0);
        from.fixed_view_mut::<3, STATES>(3, 0).copy_from(&(by_own * self.own_rows()));
        let mut by_z = SMatrix::<f64, STATES, 3>::zeros();
        by_z.fixed_view_mut::<3, 3>(0, 0).copy_from(&Matrix3::identity());
        by_z.fixed_view_mut::<3, 3>(3, 0).copy_from(&(by_back * inverse_by(z)));
        // Second-order terms of two uncertain rotations: the products of their errors, times the distance. One positioning
        // gives the yaw to 6°; over dozens of such placements, neglecting them would make the filter overconfident.
        let own_turn = self.own_covariance()[(2, 2)];
        let bend = (z.x * z.x + z.y * z.y) * covariance[(2, 2)] * (own_turn + 0.5 * covariance[(2, 2)]);
        self.covariance =
            symmetric(&(from * self.covariance * from.transpose() + by_z * covariance * by_z.transpose()));
        self.covariance[(3, 3)] += bend;
        self.covariance[(4, 4)] += bend;
        self.mean.fixed_rows_mut::<3>(3).copy_from(&compose(&own, &back));
        self.mean.fixed_rows_mut::<3>(0).copy_from(z);
    }
}

pub(super) fn symmetric(p: &Covariance) -> Covariance {
    (p + p.transpose()) * 0.5
}
