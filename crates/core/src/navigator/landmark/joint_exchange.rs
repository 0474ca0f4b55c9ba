//! The joint belief in a role exchange: as the packet holds it, and after one was received.

use nalgebra::{Matrix3, Matrix6, SMatrix, Vector3, Vector6};
use serde::{Deserialize, Serialize};

use super::joint::{Joint, STATES, symmetric};
use super::pose_algebra::{between, between_by, compose, composed_by, difference, inverse_by};
use crate::measurement::angle::wrap;
use crate::mixture::Mode;

/// What keeps a variance from vanishing where it is divided by: 0.1 mm, 0.001°.
const FLOOR: [f64; 3] = [1e-8, 1e-8, 3e-10];

impl Joint {
    /// The pair (own, landmark) in the packet's coordinates.
    #[must_use]
    pub fn polar(&self) -> Mode<6> {
        let [x, y, yaw] = self.seen();
        let rho = x.hypot(y);
        let r = rho.max(1e-3);
        let [e, n, landmark_yaw] = self.landmark();
        let mean = Vector6::new(e, n, landmark_yaw, rho, y.atan2(x), yaw);
        let mut j = Matrix6::zeros();
        for k in 0..3 {
            j[(k, 3 + k)] = 1.0;
        }
        (j[(3, 0)], j[(3, 1)]) = (x / r, y / r);
        (j[(4, 0)], j[(4, 1)]) = (-y / (r * r), x / (r * r));
        j[(5, 2)] = 1.0;
        let p = self.covariance.fixed_view::<6, 6>(0, 0);
        Mode { weight: 1.0, mean, covariance: j * p * j.transpose() }
    }

    /// The old landmark's turn. The packet holds (M, L); L is this vehicle, whose belief at its own last broadcast was
    /// `sent`: own := L, landmark := M, and what was known of the biases given the own pose stays: their correlation
    /// comes back with the packet, for no bytes.
    pub fn become_landmark(&mut self, sent: &Self, pair: &Pair) {
        let rows = sent.own_rows();
        let own = sent.own_covariance();
        let cross: SMatrix<f64, 3, STATES> = rows * sent.covariance;
        let bias_cross: Matrix3<f64> = cross.fixed_view::<3, 3>(0, 6).transpose();
        let gain = gain_on(&own, &bias_cross);
        let bias = sent.bias() + gain * difference(&pair.landmark, &Vector3::from(sent.own()));
        let left = sent.covariance.fixed_view::<3, 3>(6, 6) - gain * own * gain.transpose();
        // Seen from M, L stands at z⁻¹; M itself at L ⊕ z.
        let (by_landmark, by_seen) = composed_by(&pair.landmark, &pair.seen);
        let mut from = SMatrix::<f64, STATES, 6>::zeros();
        from.fixed_view_mut::<3, 3>(0, 3).copy_from(&inverse_by(&pair.seen));
        from.fixed_view_mut::<3, 3>(3, 0).copy_from(&by_landmark);
        from.fixed_view_mut::<3, 3>(3, 3).copy_from(&by_seen);
        from.fixed_view_mut::<3, 3>(6, 0).copy_from(&gain);
        let mut p = from * pair.covariance * from.transpose();
        let bias_now = p.fixed_view::<3, 3>(6, 6) + left;
        p.fixed_view_mut::<3, 3>(6, 6).copy_from(&bias_now);
        self.covariance = symmetric(&p);
        self.mean.fixed_rows_mut::<3>(0).copy_from(&between(&pair.seen, &Vector3::zeros()));
        self.mean.fixed_rows_mut::<3>(3).copy_from(&compose(&pair.landmark, &pair.seen));
        self.mean.fixed_rows_mut::<3>(6).copy_from(&bias);
        self.wrap();
    }

    /// A follower's turn: own pose and biases given the *old* landmark pose that the packet carries, then the new
    /// landmark in its place. G = Cov(X, L) Cov(L)⁻¹.
    pub fn adopt_landmark(&mut self, pair: &Pair) {
        let held = [0, 1, 2, 6, 7, 8];
        let old: Matrix3<f64> = self.covariance.fixed_view::<3, 3>(3, 3).into_owned();
        let cross = SMatrix::<f64, 6, 3>::from_fn(|r, c| self.covariance[(held[r], 3 + c)]);
        let gain = gain_on(&old, &cross);
        let shift = gain * difference(&pair.landmark, &Vector3::from(self.landmark()));
        let x = SMatrix::<f64, 6, 6>::from_fn(|r, c| self.covariance[(held[r], held[c])]);
        for (a, i) in held.into_iter().enumerate() {
            self.mean[i] += shift[a];
        }
        // Over (own seen from L, biases, L, M seen from L).
        let mut wide = SMatrix::<f64, 12, 12>::zeros();
        let mut by_pair = SMatrix::<f64, 12, 6>::zeros();
        by_pair.fixed_view_mut::<6, 3>(0, 0).copy_from(&gain);
        by_pair.fixed_view_mut::<6, 6>(6, 0).copy_from(&Matrix6::identity());
        wide.fixed_view_mut::<6, 6>(0, 0).copy_from(&(x - gain * old * gain.transpose()));
        wide += by_pair * pair.covariance * by_pair.transpose();
        let seen = Vector3::from(self.seen());
        let (by_mover, by_own) = between_by(&pair.seen, &seen);
        let (by_landmark, by_seen) = composed_by(&pair.landmark, &pair.seen);
        let mut from = SMatrix::<f64, STATES, 12>::zeros();
        from.fixed_view_mut::<3, 3>(0, 0).copy_from(&by_own);
        from.fixed_view_mut::<3, 3>(0, 9).copy_from(&by_mover);
        from.fixed_view_mut::<3, 3>(3, 6).copy_from(&by_landmark);
        from.fixed_view_mut::<3, 3>(3, 9).copy_from(&by_seen);
        from.fixed_view_mut::<3, 3>(6, 3).copy_from(&Matrix3::identity());
        self.covariance = symmetric(&(from * wide * from.transpose()));
        self.mean.fixed_rows_mut::<3>(0).copy_from(&between(&pair.seen, &seen));
        self.mean.fixed_rows_mut::<3>(3).copy_from(&compose(&pair.landmark, &pair.seen));
        self.wrap();
    }
}

/// What an exchange packet says: the old landmark in the world, and the mover as it sees it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Pair {
    /// L.
    pub landmark: Vector3<f64>,
    /// M in L's frame.
    pub seen: Vector3<f64>,
    /// Over (L, M in L's frame).
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
        let u = first.mean + shift;
        let (s, c) = u[4].sin_cos();
        let rho = u[3];
        let mut j = Matrix6::identity();
        (j[(3, 3)], j[(3, 4)]) = (c, -rho * s);
        (j[(4, 3)], j[(4, 4)]) = (s, rho * c);
        Some(Self {
            landmark: Vector3::new(u[0], u[1], wrap(u[2])),
            seen: Vector3::new(rho * c, rho * s, wrap(u[5])),
            covariance: j * covariance * j.transpose(),
        })
    }
}

/// Cov(X, Y) Cov(Y)⁻¹; zero for components of Y without variance.
fn gain_on<const N: usize>(y: &Matrix3<f64>, cross: &SMatrix<f64, N, 3>) -> SMatrix<f64, N, 3> {
    let held = y + Matrix3::from_diagonal(&Vector3::from(FLOOR));
    held.try_inverse().map_or_else(SMatrix::zeros, |inverse| cross * inverse)
}
