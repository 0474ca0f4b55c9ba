//! A team replaying a mission, without the GIL.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use numpy::{IntoPyArray, PyArrayMethods, PyReadonlyArray1};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use rayon::prelude::*;
use uwcoop_core::error::Error;
use uwcoop_core::navigator::{Navigator as CoreNavigator, Outcome};
use uwcoop_core::replay::{Estimators, InnovationRecord, OutcomeCounts, Replay as CoreReplay, Tracks};

use crate::authentication::Authenticator;
use crate::central_estimator::CentralEstimator;
use crate::errors::{argument, navigator};
use crate::mission::Mission;
use crate::navigators::Navigator;
use crate::python_navigator::{Failure, PythonNavigator};

/// One team replaying one mission.
#[pyclass(frozen, module = "uwcoop._native")]
pub struct Replay {
    inner: Mutex<Option<CoreReplay>>,
    failure: Failure,
    elapsed: Mutex<Duration>,
}

impl Replay {
    /// Runs and adds up the time it took.
    fn timed(&self, until_ns: i64) -> PyResult<()> {
        let start = Instant::now();
        let result = self.with(|r| r.run_until(until_ns));
        if let Ok(mut elapsed) = self.elapsed.lock() {
            *elapsed += start.elapsed();
        }
        result
    }

    fn with<T>(&self, f: impl FnOnce(&mut CoreReplay) -> Result<T, Error>) -> PyResult<T> {
        let mut guard =
            self.inner.lock().map_err(|_| argument("the replay failed in another thread".into()))?;
        let replay = guard.as_mut().ok_or_else(|| argument("the replay's tracks were taken".into()))?;
        let result = f(replay);
        drop(guard);
        if let Ok(mut failure) = self.failure.lock()
            && let Some(error) = failure.take()
        {
            return Err(error);
        }
        result.map_err(navigator)
    }
}

/// One navigator for each vehicle, in a sequence's order.
fn each(navigators: &Bound<'_, PyAny>, failure: &Failure) -> PyResult<Vec<Box<dyn CoreNavigator>>> {
    let one = |object: PyResult<Bound<'_, PyAny>>| -> PyResult<Box<dyn CoreNavigator>> {
        let object = object?;
        match object.cast::<Navigator>() {
            Ok(native) => native.get().take(),
            Err(_) => Ok(Box::new(PythonNavigator::new(&object, failure.clone())?)),
        }
    };
    navigators.try_iter()?.map(one).collect()
}

#[pymethods]
impl Replay {
    /// `navigators`: one for each vehicle, native or any object with `handle`, `transmit`, `estimate`; or one
    /// `CentralEstimator` for all. Estimates are recorded at `sample_ns` (ascending), particles at every `cloud_every`-th of them (0: never).
    #[new]
    #[pyo3(signature = (mission, navigators, sample_ns, cloud_every))]
    fn new(
        mission: &Mission,
        navigators: &Bound<'_, PyAny>,
        sample_ns: PyReadonlyArray1<'_, i64>,
        cloud_every: usize,
    ) -> PyResult<Self> {
        let failure = Failure::default();
        let team = match navigators.cast::<CentralEstimator>() {
            Ok(central) => Estimators::Central(central.get().take()?),
            Err(_) => Estimators::Each(each(navigators, &failure)?),
        };
        let samples: Arc<[i64]> = sample_ns.as_array().iter().copied().collect();
        let inner = CoreReplay::new(mission.inner.clone(), team, samples, cloud_every).map_err(navigator)?;
        Ok(Self { inner: Mutex::new(Some(inner)), failure, elapsed: Mutex::default() })
    }

    /// Tags the packets of every vehicle, and checks them; before the replay begins.
    fn authenticate(&self, authenticator: &Authenticator) -> PyResult<()> {
        self.with(|r| r.authenticate(&authenticator.inner))
    }

    /// Runs until everything before `until_ns` has happened; without it, to the end.
    #[pyo3(signature = (until_ns = None))]
    fn run(&self, py: Python<'_>, until_ns: Option<i64>) -> PyResult<()> {
        py.detach(|| self.timed(until_ns.unwrap_or(i64::MAX)))
    }

    /// Wall time that the runs took so far, s.
    #[getter]
    fn seconds(&self) -> f64 {
        self.elapsed.lock().map_or(f64::NAN, |e| e.as_secs_f64())
    }

    /// Everything that determines what comes next, and what was recorded so far, as bytes.
    fn snapshot<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let bytes = py.detach(|| self.with(|r| r.snapshot()))?;
        Ok(PyBytes::new(py, &bytes))
    }

    /// Takes up a snapshot made with the same mission and team.
    fn restore(&self, py: Python<'_>, snapshot: &[u8]) -> PyResult<()> {
        py.detach(|| self.with(|r| r.restore(snapshot)))
    }

    /// The record as a dict of arrays; the replay is over then.
    fn tracks<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let replay = self
            .inner
            .lock()
            .map_err(|_| argument("the replay failed in another thread".into()))?
            .take()
            .ok_or_else(|| argument("the replay's tracks were taken".into()))?;
        to_dict(py, replay.into_tracks())
    }
}

/// Runs many replays to the end on `threads` threads (0: all cores); results do not depend on the number.
#[pyfunction]
pub fn run_all(py: Python<'_>, replays: Vec<Py<Replay>>, threads: usize) -> PyResult<()> {
    py.detach(|| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .map_err(|e| argument(format!("{threads} threads: {e}")))?;
        pool.install(|| replays.par_iter().try_for_each(|r| r.get().timed(i64::MAX)))
    })
}

/// Counts by kind, (vehicle, 4): fused, noted, gated, rejected.
fn outcomes(py: Python<'_>, by_kind: BTreeMap<String, OutcomeCounts>) -> PyResult<Bound<'_, PyDict>> {
    let dict = PyDict::new(py);
    for (kind, counts) in by_kind {
        let rows = counts.len();
        let flat: Vec<u64> = counts.into_iter().flatten().collect();
        dict.set_item(kind, flat.into_pyarray(py).reshape([rows, 4])?)?;
    }
    Ok(dict)
}

/// Innovations in columns; `sender` is -1 for what is no range.
fn innovations<'py>(py: Python<'py>, records: &[InnovationRecord]) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    let integers =
        |f: fn(&InnovationRecord) -> i64| records.iter().map(f).collect::<Vec<_>>().into_pyarray(py);
    dict.set_item("t_ns", integers(|r| r.t_ns))?;
    dict.set_item("vehicle", integers(|r| i64::from(r.vehicle)))?;
    dict.set_item("kind", records.iter().map(|r| r.kind.name()).collect::<Vec<_>>())?;
    dict.set_item("sender", integers(|r| r.sender.map_or(-1, i64::from)))?;
    let fused = records.iter().map(|r| r.outcome == Outcome::Fused).collect::<Vec<_>>();
    dict.set_item("fused", fused.into_pyarray(py))?;
    let numbers =
        |f: fn(&InnovationRecord) -> f64| records.iter().map(f).collect::<Vec<_>>().into_pyarray(py);
    dict.set_item("innovation_m", numbers(|r| r.innovation_m))?;
    dict.set_item("sigma_m", numbers(|r| r.sigma_m))?;
    dict.set_item("squared", numbers(|r| r.squared))?;
    dict.set_item("jump_m", numbers(|r| r.jump_m))?;
    Ok(dict)
}

fn to_dict(py: Python<'_>, tracks: Tracks) -> PyResult<Bound<'_, PyDict>> {
    let dict = PyDict::new(py);
    let shape = [tracks.vehicles, tracks.t_ns.len()];
    let flat = |rows: Vec<[f64; 2]>| rows.into_iter().flatten().collect::<Vec<_>>().into_pyarray(py);
    let flat3 = |rows: Vec<[f64; 3]>| rows.into_iter().flatten().collect::<Vec<_>>().into_pyarray(py);
    dict.set_item("t_ns", tracks.t_ns.into_pyarray(py))?;
    dict.set_item("mean_m", flat(tracks.mean_m).reshape([shape[0], shape[1], 2])?)?;
    dict.set_item("covariance_m2", flat3(tracks.covariance_m2).reshape([shape[0], shape[1], 3])?)?;
    dict.set_item("yaw_rad", tracks.yaw_rad.into_pyarray(py).reshape(shape)?)?;
    dict.set_item("yaw_covariance", flat3(tracks.yaw_covariance).reshape([shape[0], shape[1], 3])?)?;
    dict.set_item("ess", tracks.ess.into_pyarray(py).reshape(shape)?)?;
    dict.set_item("rejected", tracks.rejected.into_pyarray(py).reshape(shape)?)?;
    dict.set_item("acquiring", tracks.acquiring.into_pyarray(py).reshape(shape)?)?;
    dict.set_item("unsent", tracks.unsent.into_pyarray(py).reshape(shape)?)?;
    dict.set_item("off_chart", tracks.off_chart.into_pyarray(py).reshape(shape)?)?;
    let diagnostics = PyDict::new(py);
    for (name, column) in tracks.diagnostics {
        diagnostics.set_item(name, column.into_pyarray(py).reshape(shape)?)?;
    }
    dict.set_item("diagnostics", diagnostics)?;
    dict.set_item("unused", tracks.unused)?;
    dict.set_item("outcomes", outcomes(py, tracks.outcomes)?)?;
    dict.set_item("innovations", innovations(py, &tracks.innovations)?)?;
    let column = |f: fn(&uwcoop_core::replay::PacketRecord) -> i64| {
        tracks.packets.iter().map(f).collect::<Vec<_>>().into_pyarray(py)
    };
    let packets = PyDict::new(py);
    packets.set_item("sender", column(|p| i64::from(p.sender)))?;
    packets.set_item("receiver", column(|p| i64::from(p.receiver)))?;
    packets.set_item("tol_ns", column(|p| p.tol_ns))?;
    packets.set_item("toa_ns", column(|p| p.toa_ns))?;
    packets.set_item("bytes", column(|p| i64::from(p.bytes)))?;
    packets.set_item("frames", column(|p| i64::from(p.frames)))?;
    let flags = |f: fn(&uwcoop_core::replay::PacketRecord) -> bool| {
        tracks.packets.iter().map(f).collect::<Vec<_>>().into_pyarray(py)
    };
    packets.set_item("received", flags(|p| p.received))?;
    packets.set_item("accepted", flags(|p| p.accepted))?;
    let information: Vec<f64> = tracks.packets.iter().map(|p| p.information_nat).collect();
    packets.set_item("information_nat", information.into_pyarray(py))?;
    dict.set_item("packets", packets)?;
    let sent = PyDict::new(py);
    let sent_column =
        |f: fn(&(u16, i64, u32)) -> i64| tracks.sent.iter().map(f).collect::<Vec<_>>().into_pyarray(py);
    sent.set_item("sender", sent_column(|s| i64::from(s.0)))?;
    sent.set_item("tol_ns", sent_column(|s| s.1))?;
    sent.set_item("bytes", sent_column(|s| i64::from(s.2)))?;
    dict.set_item("sent", sent)?;
    let polls = PyDict::new(py);
    let poll_column = |f: fn(&uwcoop_core::replay::Poll) -> i64| {
        tracks.polls.iter().map(f).collect::<Vec<_>>().into_pyarray(py)
    };
    polls.set_item("sender", poll_column(|p| i64::from(p.poller)))?;
    polls.set_item("t_ns", poll_column(|p| p.t_ns))?;
    polls.set_item("bytes", poll_column(|p| i64::from(p.bytes)))?;
    polls.set_item("air_time_ns", poll_column(|p| p.air_time_ns))?;
    dict.set_item("polls", polls)?;
    let mut clouds = Vec::with_capacity(tracks.clouds.len());
    for cloud in tracks.clouds {
        let rows = cloud.positions_m.len();
        let positions = cloud.positions_m.into_iter().flatten().collect::<Vec<_>>();
        clouds.push((
            cloud.t_ns,
            cloud.vehicle,
            positions.into_pyarray(py).reshape([rows, 2])?,
            cloud.weights.into_pyarray(py),
        ));
    }
    dict.set_item("clouds", clouds)?;
    Ok(dict)
}
