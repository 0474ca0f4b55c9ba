//! How well a measurement fitted the belief before it was used: what a mission without truth is judged by.

use crate::measurement::range::CloudInnovation;

/// A sounding or a range, measured less expected.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Innovation {
    /// m.
    pub value_m: f64,
    /// Its variance by belief, chart and sensor together, m².
    pub variance_m2: f64,
}

impl From<CloudInnovation> for Innovation {
    fn from(seen: CloudInnovation) -> Self {
        Self { value_m: seen.mean_m, variance_m2: seen.variance_m2 }
    }
}

/// The innovation of the event that is being handled. It is no part of a navigator's state: a snapshot does not hold it,
/// and two states that differ in it alone are equal.
#[derive(Debug, Clone, Copy, Default)]
pub struct LastInnovation(pub Option<Innovation>);

impl PartialEq for LastInnovation {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}
