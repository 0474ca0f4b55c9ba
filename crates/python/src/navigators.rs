//! Native navigators, one event at a time from Python.

use std::sync::Mutex;

use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use uwcoop_core::navigator::authenticated::authenticated;
use uwcoop_core::navigator::{Estimate as CoreEstimate, Navigator as CoreNavigator, Outcome, Status};
use uwcoop_core::packet::layout::record;

use crate::authentication::{Authenticator, Field, described};
use crate::errors::{argument, navigator};
use crate::event::Event;

/// Belief of one vehicle about its own pose.
#[pyclass(frozen, module = "uwcoop._native")]
pub struct Estimate {
    inner: CoreEstimate,
}

#[pymethods]
impl Estimate {
    /// Time it holds for, ns.
    #[getter]
    fn t_ns(&self) -> i64 {
        self.inner.t_ns
    }

    /// [east, north], m.
    #[getter]
    fn mean_m<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.inner.mean_m.to_vec().into_pyarray(py)
    }

    /// 2 × 2, m².
    #[getter]
    fn covariance_m2<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let [ee, en, nn] = self.inner.covariance_m2;
        vec![ee, en, en, nn].into_pyarray(py).reshape([2, 2])
    }

    /// Yaw, rad; NaN where not estimated.
    #[getter]
    fn yaw_rad(&self) -> f64 {
        self.inner.yaw.map_or(f64::NAN, |y| y.0)
    }

    /// Effective sample size; NaN for navigators without particles.
    #[getter]
    fn ess(&self) -> f64 {
        self.inner.ess.unwrap_or(f64::NAN)
    }

    /// Measurements gated and packets rejected so far.
    #[getter]
    fn rejected(&self) -> u64 {
        self.inner.rejected
    }

    /// `not started`, `navigating`, `off chart` or `acquiring`.
    #[getter]
    fn status(&self) -> &'static str {
        match self.inner.status {
            Status::NotStarted => "not started",
            Status::Navigating => "navigating",
            Status::OffChart => "off chart",
            Status::Acquiring => "acquiring",
        }
    }

    fn __repr__(&self) -> String {
        format!("{:?}", self.inner)
    }
}

/// A native navigator; empty while a replay holds it.
#[pyclass(frozen, module = "uwcoop._native")]
pub struct Navigator {
    inner: Mutex<Option<Box<dyn CoreNavigator>>>,
}

impl Navigator {
    /// Wraps a navigator of the core.
    pub fn of(navigator: Box<dyn CoreNavigator>) -> Self {
        Self { inner: Mutex::new(Some(navigator)) }
    }

    /// Takes the navigator out for a replay.
    pub fn take(&self) -> PyResult<Box<dyn CoreNavigator>> {
        self.with(Option::take)?.ok_or_else(held)
    }

    fn with<T>(&self, f: impl FnOnce(&mut Option<Box<dyn CoreNavigator>>) -> T) -> PyResult<T> {
        let mut guard =
            self.inner.lock().map_err(|_| argument("the navigator failed in another thread".into()))?;
        Ok(f(&mut guard))
    }
}

fn held() -> PyErr {
    argument("the navigator was handed to a replay".into())
}

fn outcome(outcome: Outcome) -> &'static str {
    match outcome {
        Outcome::Fused => "fused",
        Outcome::Noted => "noted",
        Outcome::Gated => "gated",
        Outcome::Rejected => "rejected",
    }
}

#[pymethods]
impl Navigator {
    /// Advances to the event's time and fuses it: `fused`, `noted`, `gated` or `rejected`.
    fn handle(&self, event: &Event) -> PyResult<&'static str> {
        self.with(|n| n.as_mut().map(|n| n.handle(&event.inner)))?
            .ok_or_else(held)?
            .map(outcome)
            .map_err(navigator)
    }

    /// The packet for the slot at `tol_ns`, or None for silence.
    fn transmit<'py>(
        &self,
        py: Python<'py>,
        tol_ns: i64,
        capacity_bytes: usize,
    ) -> PyResult<Option<Bound<'py, PyBytes>>> {
        let packet = self
            .with(|n| n.as_mut().map(|n| n.transmit(tol_ns, capacity_bytes)))?
            .ok_or_else(held)?
            .map_err(navigator)?;
        Ok(packet.map(|bytes| PyBytes::new(py, &bytes)))
    }

    /// The same navigator as `vehicle` of a team of `vehicles` that tags its packets; this one is empty then.
    fn authenticated(&self, vehicle: u16, vehicles: usize, authenticator: &Authenticator) -> PyResult<Self> {
        let inner = authenticator.inner.clone();
        Ok(Self::of(authenticated(self.take()?, vehicle, vehicles, inner)))
    }

    /// As `transmit`, with the fields that were written: (name, bits of one, how many, scale), the scale being None or
    /// (unit, least, greatest, kind of step, step, rounding).
    fn transmit_described<'py>(
        &self,
        py: Python<'py>,
        tol_ns: i64,
        capacity_bytes: usize,
    ) -> PyResult<(Option<Bound<'py, PyBytes>>, Vec<Field>)> {
        let (packet, fields) = record(|| self.transmit(py, tol_ns, capacity_bytes));
        Ok((packet?, fields.iter().map(described).collect()))
    }

    /// The belief predicted to `t_ns`, without changing anything.
    fn estimate(&self, t_ns: i64) -> PyResult<Estimate> {
        let inner = self.with(|n| n.as_ref().map(|n| n.estimate(t_ns)))?.ok_or_else(held)?;
        Ok(Estimate { inner })
    }

    /// Everything that determines what comes next, as bytes.
    fn snapshot<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let bytes = self.with(|n| n.as_ref().map(|n| n.snapshot()))?.ok_or_else(held)?.map_err(navigator)?;
        Ok(PyBytes::new(py, &bytes))
    }

    /// Takes up a snapshot of a navigator configured the same.
    fn restore(&self, snapshot: &[u8]) -> PyResult<()> {
        self.with(|n| n.as_mut().map(|n| n.restore(snapshot)))?.ok_or_else(held)?.map_err(navigator)
    }

    /// Named numbers of the method's own, as they stand after the last event.
    fn diagnostics<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let numbers = self.with(|n| n.as_ref().map(|n| n.diagnostics()))?.ok_or_else(held)?;
        let out = PyDict::new(py);
        for (name, value) in numbers {
            out.set_item(name, value)?;
        }
        Ok(out)
    }

    /// Positions (N, 2) and weights (N,) of the particles; None for a navigator, or a moment, without.
    #[allow(clippy::type_complexity)]
    fn particles<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<Option<(Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<f64>>)>> {
        let particles = self.with(|n| n.as_ref().map(|n| n.particles()))?.ok_or_else(held)?;
        let Some(p) = particles else { return Ok(None) };
        let flat: Vec<f64> = p.east.iter().zip(&p.north).flat_map(|(e, n)| [*e, *n]).collect();
        Ok(Some((flat.into_pyarray(py).reshape([p.east.len(), 2])?, p.weights.into_pyarray(py))))
    }
}
