//! Native navigators, one event at a time from Python.

use std::sync::Mutex;

use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use uwcoop_core::navigator::authenticated::Authenticated;
use uwcoop_core::navigator::dead_reckoning::DeadReckoning;
use uwcoop_core::navigator::dmpf::{Dmpf, DmpfOptions};
use uwcoop_core::navigator::drift::Drift;
use uwcoop_core::navigator::mpf::{Mpf, MpfOptions};
use uwcoop_core::navigator::range::{RangeMethod, RangeOptions};
use uwcoop_core::navigator::terrain_core::{MonitorOptions, TerrainOptions};
use uwcoop_core::navigator::{Estimate as CoreEstimate, Navigator as CoreNavigator, Outcome, Status};
use uwcoop_core::packet::PacketKind;
use uwcoop_core::packet::layout::record;

use crate::authentication::{Authenticator, Field, described};
use crate::chart::Chart;
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
    pub fn of(navigator: impl CoreNavigator + 'static) -> Self {
        Self { inner: Mutex::new(Some(Box::new(navigator))) }
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

/// A dict of options; every key must be there, so that defaults stay in one place.
pub struct Options<'a, 'py>(pub &'a Bound<'py, PyDict>);

impl Options<'_, '_> {
    pub fn number(&self, name: &str) -> PyResult<f64> {
        self.maybe(name)?.ok_or_else(|| argument(format!("option {name} is missing")))
    }

    pub fn maybe(&self, name: &str) -> PyResult<Option<f64>> {
        match self.0.get_item(name)? {
            Some(value) if !value.is_none() => Ok(Some(value.extract()?)),
            _ => Ok(None),
        }
    }

    pub fn count(&self, name: &str) -> PyResult<usize> {
        let value = self.0.get_item(name)?.ok_or_else(|| argument(format!("option {name} is missing")))?;
        value.extract()
    }

    pub fn flag(&self, name: &str) -> PyResult<bool> {
        let value = self.0.get_item(name)?.ok_or_else(|| argument(format!("option {name} is missing")))?;
        value.extract()
    }

    pub fn word(&self, name: &str) -> PyResult<String> {
        let value = self.0.get_item(name)?.ok_or_else(|| argument(format!("option {name} is missing")))?;
        value.extract()
    }

    pub(crate) fn drift(&self) -> PyResult<Drift> {
        Ok(Drift {
            sigma_position_m_per_sqrt_s: self.number("sigma_position_m_per_sqrt_s")?,
            sigma_current_mps_per_sqrt_s: self.number("sigma_current_mps_per_sqrt_s")?,
            sigma_current0_mps: self.number("sigma_current0_mps")?,
            sigma_heading_bias0_rad: self.number("sigma_heading_bias0_rad")?,
            sigma_heading_bias_rad_per_sqrt_s: self.number("sigma_heading_bias_rad_per_sqrt_s")?,
            sigma_thrust_bias0_mps: self.number("sigma_thrust_bias0_mps")?,
            sigma_thrust_bias_mps_per_sqrt_s: self.number("sigma_thrust_bias_mps_per_sqrt_s")?,
        })
    }

    fn range(&self) -> PyResult<Option<RangeOptions>> {
        if !self.flag("use_ranges")? {
            return Ok(None);
        }
        let method = match self.word("range_method")?.as_str() {
            "eq17" => RangeMethod::Eq17 { samples: self.maybe("range_samples")?.map_or(0, |n| n as usize) },
            "gaussian" => RangeMethod::Gaussian { temper: self.number("range_temper")? },
            other => return Err(argument(format!("range_method is {other:?}, not eq17 or gaussian"))),
        };
        Ok(Some(RangeOptions {
            method,
            sigma_m: self.number("sigma_range_m")?,
            gate_sigmas: self.maybe("range_gate_sigmas")?.unwrap_or(f64::INFINITY),
            entropy_sigma_m: self.maybe("entropy_sigma_m")?,
        }))
    }

    fn packet(&self) -> PyResult<PacketKind> {
        match self.word("packet")?.as_str() {
            "rounded" => Ok(PacketKind::Belief),
            "f64" => Ok(PacketKind::BeliefF64),
            "particles" => Ok(PacketKind::Cloud),
            "modes" => Ok(PacketKind::Mixture),
            other => Err(argument(format!("packet is {other:?}, not rounded, f64, modes or particles"))),
        }
    }

    fn monitor(&self) -> PyResult<Option<MonitorOptions>> {
        if !self.flag("monitor")? {
            return Ok(None);
        }
        Ok(Some(MonitorOptions {
            forgetting: self.number("monitor_forgetting")?,
            clip: self.number("monitor_clip")?,
            alarm: self.number("monitor_alarm")?,
            spread_m: self.number("monitor_spread_m")?,
            repeat_spread_m: self.number("monitor_repeat_spread_m")?,
            spread_current_mps: self.number("monitor_spread_current_mps")?,
            quiet_s: self.number("monitor_quiet_s")?,
            repeat_s: self.number("monitor_repeat_s")?,
        }))
    }

    fn dmpf(&self) -> PyResult<DmpfOptions> {
        Ok(DmpfOptions {
            particles: self.count("particles")?,
            window: self.count("window")?,
            sigma_like_m: self.number("sigma_like_m")?,
            resample_share: self.number("resample_share")?,
            roughening_m2: self.number("roughening_m2")?,
            range: self.range()?,
            terrain: self.flag("use_terrain")?,
            packet: self.packet()?,
            modes: self.count("modes")?,
            drift: self.drift()?,
        })
    }

    fn mpf(&self) -> PyResult<MpfOptions> {
        Ok(MpfOptions {
            terrain: self.terrain(None)?,
            range: self.range()?,
            range_novelty: self.flag("range_novelty")?,
            packet: self.packet()?,
        })
    }

    /// The terrain core; a drift of its own wins over the options'.
    pub(crate) fn terrain(&self, drift: Option<Drift>) -> PyResult<TerrainOptions> {
        Ok(TerrainOptions {
            particles: self.count("particles")?,
            resample_share: self.number("resample_share")?,
            sigma_depth_m: self.maybe("sigma_depth_m")?,
            sigma_offset0_m: self.number("sigma_offset0_m")?,
            sigma_offset_m_per_sounding: self.number("sigma_offset_m_per_sounding")?,
            student_dof: self.number("student_dof")?,
            correlation_length_m: self.maybe("correlation_length_m")?,
            sigma_map_m: self.maybe("sigma_map_m")?,
            sounding_spacing_m: self.number("sounding_spacing_m")?,
            least_ess_share: self.number("least_ess_share")?,
            acquisition_sigma_m: self.number("acquisition_sigma_m")?,
            acquisition_particles: self.count("acquisition_particles")?,
            start_anywhere: self.flag("start_anywhere")?,
            monitor: self.monitor()?,
            drift: drift.map_or_else(|| self.drift(), Ok)?,
        })
    }
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
    /// Dead reckoning of one vehicle.
    #[staticmethod]
    fn dead_reckoning(vehicle: u16, vehicles: usize, options: &Bound<'_, PyDict>) -> PyResult<Self> {
        let navigator_ =
            DeadReckoning::new(vehicle, vehicles, Options(options).drift()?).map_err(navigator)?;
        Ok(Self::of(navigator_))
    }

    /// D-MPF of one vehicle.
    #[staticmethod]
    #[pyo3(signature = (vehicle, vehicles, options, chart, sound_speed_mps, seed))]
    fn dmpf(
        vehicle: u16,
        vehicles: usize,
        options: &Bound<'_, PyDict>,
        chart: Option<&Chart>,
        sound_speed_mps: f64,
        seed: u64,
    ) -> PyResult<Self> {
        let options = Options(options).dmpf()?;
        let chart = chart.map(|c| c.inner.clone());
        Dmpf::new(vehicle, vehicles, options, chart, sound_speed_mps, seed).map(Self::of).map_err(navigator)
    }

    /// The consistent marginalised particle filter of one vehicle.
    #[staticmethod]
    #[pyo3(signature = (vehicle, vehicles, options, chart, sound_speed_mps, seed))]
    fn mpf(
        vehicle: u16,
        vehicles: usize,
        options: &Bound<'_, PyDict>,
        chart: Option<&Chart>,
        sound_speed_mps: f64,
        seed: u64,
    ) -> PyResult<Self> {
        let bias_states = Options(options).flag("bias_states")?;
        let options = Options(options).mpf()?;
        let chart = chart.map(|c| c.inner.clone());
        if bias_states {
            Mpf::<4>::new(vehicle, vehicles, options, chart, sound_speed_mps, seed).map(Self::of)
        } else {
            Mpf::<2>::new(vehicle, vehicles, options, chart, sound_speed_mps, seed).map(Self::of)
        }
        .map_err(navigator)
    }

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
        Ok(Self::of(Authenticated::new(self.take()?, vehicle, vehicles, inner)))
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
