//! Centralised references, handed to a replay in place of a team's navigators.

use std::sync::Mutex;

use pyo3::prelude::*;
use uwcoop_core::navigator::CentralEstimator as CoreEstimator;

use crate::errors::argument;

/// A centralised reference: fed the events of the whole team, transmits nothing. Empty while a replay holds it.
#[pyclass(frozen, module = "uwcoop._native")]
pub struct CentralEstimator {
    inner: Mutex<Option<Box<dyn CoreEstimator>>>,
}

impl CentralEstimator {
    /// Wraps an estimator of the core.
    pub fn of(estimator: Box<dyn CoreEstimator>) -> Self {
        Self { inner: Mutex::new(Some(estimator)) }
    }

    /// Takes the estimator out for a replay.
    pub fn take(&self) -> PyResult<Box<dyn CoreEstimator>> {
        self.inner
            .lock()
            .map_err(|_| argument("the estimator failed in another thread".into()))?
            .take()
            .ok_or_else(|| argument("the estimator was handed to a replay".into()))
    }
}
