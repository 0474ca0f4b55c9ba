//! Events from keyword arguments or from columns: one table of fields for both.

use std::sync::Arc;

use numpy::PyReadonlyArray1;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use uwcoop_core::event::{BOUNDS, Event as CoreEvent, Payload};

use crate::errors::{argument, log, navigator};
use crate::event_fields::{Fields, payload};

/// One thing that happened to one vehicle.
#[pyclass(frozen, module = "uwcoop._native")]
pub struct Event {
    pub inner: CoreEvent,
}

/// (kind, field, least value, greatest value, whether the least value itself is refused) of every number of every kind
/// of event.
#[pyfunction]
pub fn event_bounds() -> Vec<(&'static str, &'static str, f64, f64, bool)> {
    BOUNDS.iter().map(|b| (b.kind.name(), b.field, b.minimum, b.maximum, b.above)).collect()
}

/// A vehicle index.
pub fn vehicle(index: i64) -> PyResult<u16> {
    u16::try_from(index).map_err(|_| argument(format!("vehicle index is {index}, outside 0 to 65535")))
}

struct Keywords<'a, 'py>(&'a Bound<'py, PyDict>);

impl Fields for Keywords<'_, '_> {
    fn number(&self, name: &str) -> PyResult<f64> {
        self.0.get_item(name)?.ok_or_else(|| argument(format!("event field {name} is missing")))?.extract()
    }

    fn integer(&self, name: &str) -> PyResult<i64> {
        self.0.get_item(name)?.ok_or_else(|| argument(format!("event field {name} is missing")))?.extract()
    }
}

/// Columns of one event table.
pub struct Table<'py> {
    kind: String,
    columns: Bound<'py, PyDict>,
}

/// Columns turned into plain vectors once, rows read many times.
struct Rows {
    numbers: Vec<(String, Vec<f64>)>,
    integers: Vec<(String, Vec<i64>)>,
    row: usize,
    kind: String,
}

impl Fields for Rows {
    fn number(&self, name: &str) -> PyResult<f64> {
        let column = self.numbers.iter().find(|(n, _)| n == name);
        let value = column.and_then(|(_, c)| c.get(self.row));
        value.copied().ok_or_else(|| argument(format!("event table {} has no column {name}", self.kind)))
    }

    fn integer(&self, name: &str) -> PyResult<i64> {
        let column = self.integers.iter().find(|(n, _)| n == name);
        let value = column.and_then(|(_, c)| c.get(self.row));
        value.copied().ok_or_else(|| argument(format!("event table {} has no column {name}", self.kind)))
    }
}

impl<'py> Table<'py> {
    /// A table of one kind: a dict of equally long arrays.
    pub fn new(kind: String, columns: Bound<'py, PyDict>) -> Self {
        Self { kind, columns }
    }

    /// All events of the table.
    pub fn events(self) -> PyResult<Vec<CoreEvent>> {
        let mut rows = Rows { numbers: Vec::new(), integers: Vec::new(), row: 0, kind: self.kind.clone() };
        let mut length = None;
        for (name, column) in self.columns.iter() {
            let name: String = name.extract()?;
            let size = if let Ok(values) = column.extract::<PyReadonlyArray1<'_, i64>>() {
                rows.integers.push((name.clone(), values.as_array().to_vec()));
                values.as_array().len()
            } else if let Ok(values) = column.extract::<PyReadonlyArray1<'_, bool>>() {
                rows.integers.push((name.clone(), values.as_array().iter().map(|b| i64::from(*b)).collect()));
                values.as_array().len()
            } else if let Ok(values) = column.extract::<PyReadonlyArray1<'_, f64>>() {
                rows.numbers.push((name.clone(), values.as_array().to_vec()));
                values.as_array().len()
            } else {
                return Err(argument(format!(
                    "column {name} of event table {} is not a float64, int64 or bool array",
                    self.kind
                )));
            };
            if *length.get_or_insert(size) != size {
                return Err(argument(format!("columns of event table {} differ in length", self.kind)));
            }
        }
        let mut events = Vec::with_capacity(length.unwrap_or(0));
        for row in 0..length.unwrap_or(0) {
            rows.row = row;
            events.push(CoreEvent {
                t_ns: rows.integer("t_ns")?,
                vehicle: vehicle(rows.integer("vehicle")?)?,
                payload: payload(&self.kind, &rows)?,
            });
        }
        Ok(events)
    }
}

/// A reception with its bytes.
pub fn reception(
    t_ns: i64,
    receiver: i64,
    sender: i64,
    tol_ns: i64,
    toa_ns: i64,
    bytes: &[u8],
) -> PyResult<CoreEvent> {
    let payload = Payload::Reception { sender: vehicle(sender)?, tol_ns, toa_ns, bytes: Arc::from(bytes) };
    let event = CoreEvent { t_ns, vehicle: vehicle(receiver)?, payload };
    event.validate().map_err(log)?;
    Ok(event)
}

#[pymethods]
impl Event {
    /// An event of `kind` with the fields of that kind, e.g. `Event(0, 0, "depth", depth_m=2.0, sigma_m=0.1)`; a
    /// reception has `sender, tol_ns, toa_ns, bytes`.
    #[new]
    #[pyo3(signature = (t_ns, vehicle, kind, **fields))]
    fn new(
        t_ns: i64,
        vehicle: i64,
        kind: &str,
        fields: Option<&Bound<'_, PyDict>>,
        py: Python<'_>,
    ) -> PyResult<Self> {
        let empty = PyDict::new(py);
        let fields = fields.unwrap_or(&empty);
        let keywords = Keywords(fields);
        if kind == "reception" {
            let bytes: Vec<u8> = fields
                .get_item("bytes")?
                .ok_or_else(|| argument("event field bytes is missing".into()))?
                .extract()?;
            let inner = reception(
                t_ns,
                vehicle,
                keywords.integer("sender")?,
                keywords.integer("tol_ns")?,
                keywords.integer("toa_ns")?,
                &bytes,
            )?;
            return Ok(Self { inner });
        }
        let payload = payload(kind, &keywords)?;
        let inner = CoreEvent { t_ns, vehicle: self::vehicle(vehicle)?, payload };
        inner.validate().map_err(navigator)?;
        Ok(Self { inner })
    }

    /// Time since the mission's epoch, ns.
    #[getter]
    fn t_ns(&self) -> i64 {
        self.inner.t_ns
    }

    /// Index of the vehicle.
    #[getter]
    fn vehicle(&self) -> u16 {
        self.inner.vehicle
    }

    /// Kind of the event, as in `uwcoop.missionlog.EVENT_COLUMNS`, or `reception`, `delivered`.
    #[getter]
    fn kind(&self) -> &'static str {
        self.inner.payload.kind().name()
    }

    /// The fields by name, as the constructor takes them.
    #[getter]
    fn fields<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let d = PyDict::new(py);
        let nan = |v: &Option<f64>| v.unwrap_or(f64::NAN);
        match &self.inner.payload {
            Payload::Motion { velocity_mps: [e, n] } => {
                d.set_item("velocity_e_mps", e)?;
                d.set_item("velocity_n_mps", n)?;
            }
            Payload::Odometry { displacement_m: [f, l], yaw_change_rad, covariance } => {
                d.set_item("forward_m", f)?;
                d.set_item("left_m", l)?;
                d.set_item("yaw_change_rad", yaw_change_rad)?;
                for (name, value) in
                    ["cov_ff", "cov_fl", "cov_fy", "cov_ll", "cov_ly", "cov_yy"].iter().zip(covariance)
                {
                    d.set_item(name, value)?;
                }
            }
            Payload::WaterDepth { water_depth_m, sigma_m } => {
                d.set_item("water_depth_m", water_depth_m)?;
                d.set_item("sigma_m", sigma_m)?;
            }
            Payload::Depth { depth_m, sigma_m } => {
                d.set_item("depth_m", depth_m)?;
                d.set_item("sigma_m", sigma_m)?;
            }
            Payload::Heading { yaw_rad, sigma_rad } => {
                d.set_item("yaw_rad", yaw_rad)?;
                d.set_item("sigma_rad", sigma_rad)?;
            }
            Payload::TurnRate { yaw_rate_radps, sigma_radps } => {
                d.set_item("yaw_rate_radps", yaw_rate_radps)?;
                d.set_item("sigma_radps", sigma_radps)?;
            }
            Payload::GroundVelocity { velocity_mps: [f, l], sigma_mps } => {
                d.set_item("forward_mps", f)?;
                d.set_item("left_mps", l)?;
                d.set_item("sigma_mps", sigma_mps)?;
            }
            Payload::Fix { position_m: [e, n], covariance_m2: [ee, en, nn] } => {
                for (name, value) in
                    [("e_m", e), ("n_m", n), ("cov_ee_m2", ee), ("cov_en_m2", en), ("cov_nn_m2", nn)]
                {
                    d.set_item(name, value)?;
                }
            }
            Payload::AcousticFix {
                peer,
                transmit_ns,
                range_m,
                own_bearing_rad,
                peer_bearing_rad,
                peer_depth_m,
            } => {
                d.set_item("peer", peer)?;
                d.set_item("transmit_ns", transmit_ns)?;
                d.set_item("range_m", nan(range_m))?;
                d.set_item("own_bearing_rad", nan(own_bearing_rad))?;
                d.set_item("peer_bearing_rad", nan(peer_bearing_rad))?;
                d.set_item("peer_depth_m", nan(peer_depth_m))?;
            }
            Payload::WaterVelocity { velocity_mps: [f, l], sigma_mps } => {
                d.set_item("forward_mps", f)?;
                d.set_item("left_mps", l)?;
                d.set_item("sigma_mps", sigma_mps)?;
            }
            Payload::BeaconRange {
                measured_ns,
                beacon_m: [e, n],
                beacon_depth_m,
                range_m,
                sigma_m,
                one_way,
            } => {
                d.set_item("measured_ns", measured_ns)?;
                for (name, value) in [
                    ("beacon_e_m", e),
                    ("beacon_n_m", n),
                    ("beacon_depth_m", beacon_depth_m),
                    ("range_m", range_m),
                    ("sigma_m", sigma_m),
                ] {
                    d.set_item(name, value)?;
                }
                d.set_item("one_way", one_way)?;
            }
            Payload::Usbl { measured_ns, position_m: [e, n], covariance_m2: [ee, en, nn] } => {
                d.set_item("measured_ns", measured_ns)?;
                for (name, value) in
                    [("e_m", e), ("n_m", n), ("cov_ee_m2", ee), ("cov_en_m2", en), ("cov_nn_m2", nn)]
                {
                    d.set_item(name, value)?;
                }
            }
            Payload::RoleTaken { landmark } => d.set_item("landmark", landmark)?,
            Payload::Reception { sender, tol_ns, toa_ns, bytes } => {
                d.set_item("sender", sender)?;
                d.set_item("tol_ns", tol_ns)?;
                d.set_item("toa_ns", toa_ns)?;
                d.set_item("bytes", PyBytes::new(py, bytes))?;
            }
            Payload::Delivered { tol_ns, to } => {
                d.set_item("tol_ns", tol_ns)?;
                d.set_item("to", to)?;
            }
            Payload::Landed | Payload::LiftedOff => {}
        }
        Ok(d)
    }

    fn __repr__(&self) -> String {
        format!("{:?}", self.inner)
    }
}
