//! The bias of a gyro, estimated while its vehicle is at rest.

use serde::{Deserialize, Serialize};

use super::joint::Joint;

/// Turn rates measured while the vehicle does not turn: each is the gyro's bias plus noise. They are summarised by their
/// weighted mean.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct StationaryGyro {
    information: f64,
    weighted_sum: f64,
}

impl StationaryGyro {
    /// Adds a reading.
    pub fn add(&mut self, reading: f64, sigma: f64) {
        if sigma > 0.0 {
            self.information += 1.0 / (sigma * sigma);
            self.weighted_sum += reading / (sigma * sigma);
        }
    }

    /// Corrects the gyro's bias, where it is a state; the logarithm of the readings' density before that.
    pub fn apply(&self, joint: &mut Joint) -> f64 {
        if self.information <= 0.0 {
            return 0.0;
        }
        let mut row = nalgebra::SMatrix::<f64, 1, 9>::zeros();
        row[6] = 1.0;
        let innovation = self.weighted_sum / self.information - joint.mean[6];
        joint.update(innovation, &row, 1.0 / self.information, None).log_evidence
    }
}
