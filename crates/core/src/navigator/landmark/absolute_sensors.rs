//! Fixes of the position and compass readings of `landmark`.

use nalgebra::Matrix3;

use super::robust::Landmark;
use crate::measurement::angle::wrap;
use crate::measurement::fix;
use crate::navigator::Outcome;

/// Variance of an unknown yaw: uniform on the circle.
pub(super) const UNKNOWN_YAW: f64 = std::f64::consts::PI * std::f64::consts::PI / 3.0;

impl Landmark {
    pub(super) fn fix(&mut self, position_m: [f64; 2], [ee, en, nn]: [f64; 3]) -> Outcome {
        self.settle();
        let joint = &mut self.state.joint;
        if !self.state.positioned {
            self.state.positioned = true;
            let yaw_variance = joint.own_covariance()[(2, 2)];
            let start = Matrix3::new(ee, en, 0.0, en, nn, 0.0, 0.0, 0.0, yaw_variance);
            joint.set_own_pose([position_m[0], position_m[1], joint.own()[2]], &start);
            return Outcome::Fused;
        }
        if !joint.fix(position_m, &nalgebra::Matrix2::new(ee, en, en, nn), fix::GATE) {
            return self.gated();
        }
        self.state.scatter = None;
        self.state.jumps.clear();
        Outcome::Fused
    }

    pub(super) fn heading(&mut self, yaw_rad: f64, sigma_rad: f64) -> Outcome {
        self.settle();
        let joint = &mut self.state.joint;
        let variance = (sigma_rad * sigma_rad).max(1e-12);
        let spread = joint.own_covariance();
        let own = joint.own();
        // The yaw was unknown: the compass reading is the estimate.
        if spread[(2, 2)] >= UNKNOWN_YAW {
            let mut start = spread;
            start.fill_row(2, 0.0);
            start.fill_column(2, 0.0);
            start[(2, 2)] = variance;
            joint.set_own_pose([own[0], own[1], wrap(yaw_rad)], &start);
            return Outcome::Fused;
        }
        let innovation = wrap(yaw_rad - own[2]);
        if innovation * innovation > fix::GATE * (spread[(2, 2)] + variance) {
            return self.gated();
        }
        let row = joint.own_rows().fixed_view::<1, 9>(2, 0).into_owned();
        joint.update(innovation, &row, variance, None);
        self.state.scatter = None;
        self.state.jumps.clear();
        Outcome::Fused
    }
}
