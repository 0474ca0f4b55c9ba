//! A mission from columns.

use std::sync::Arc;

use numpy::{PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use uwcoop_core::link::{LinkConfig, Slot};
use uwcoop_core::replay::{Mission as CoreMission, Opportunity, Poll};

use crate::errors::{argument, log};
use crate::event::{Table, reception, vehicle};

/// The navigators' half of a mission log.
#[pyclass(frozen, module = "uwcoop._native")]
pub struct Mission {
    pub inner: Arc<CoreMission>,
}

fn integers(columns: &Bound<'_, PyDict>, name: &str) -> PyResult<Vec<i64>> {
    let column = columns.get_item(name)?.ok_or_else(|| argument(format!("column {name} is missing")))?;
    Ok(column.extract::<PyReadonlyArray1<'_, i64>>()?.as_array().to_vec())
}

fn numbers(columns: &Bound<'_, PyDict>, name: &str) -> PyResult<Vec<f64>> {
    let column = columns.get_item(name)?.ok_or_else(|| argument(format!("column {name} is missing")))?;
    Ok(column.extract::<PyReadonlyArray1<'_, f64>>()?.as_array().to_vec())
}

fn equally_long(table: &str, lengths: &[usize]) -> PyResult<()> {
    if lengths.windows(2).any(|w| w[0] != w[1]) {
        return Err(argument(format!("columns of {table} differ in length: {lengths:?}")));
    }
    Ok(())
}

fn slots(columns: &Bound<'_, PyDict>) -> PyResult<Vec<Slot>> {
    if columns.is_empty() {
        return Ok(Vec::new());
    }
    let (tol, sender, capacity) =
        (integers(columns, "tol_ns")?, integers(columns, "sender")?, integers(columns, "capacity_bytes")?);
    equally_long("slots", &[tol.len(), sender.len(), capacity.len()])?;
    tol.iter()
        .zip(sender)
        .zip(capacity)
        .map(|((&tol_ns, sender), capacity)| {
            let capacity_bytes = usize::try_from(capacity)
                .map_err(|_| argument(format!("capacity_bytes is {capacity}, below 0")))?;
            Ok(Slot { tol_ns, sender: vehicle(sender)?, capacity_bytes })
        })
        .collect()
}

fn opportunities(columns: &Bound<'_, PyDict>) -> PyResult<Vec<Opportunity>> {
    if columns.is_empty() {
        return Ok(Vec::new());
    }
    let (tol, toa) = (integers(columns, "tol_ns")?, integers(columns, "toa_ns")?);
    let (sender, receiver) = (integers(columns, "sender")?, integers(columns, "receiver")?);
    let probability = numbers(columns, "survive_probability")?;
    let draws = columns.get_item("draws")?.ok_or_else(|| argument("column draws is missing".into()))?;
    let draws = draws.extract::<PyReadonlyArray2<'_, f64>>()?;
    let n = tol.len();
    equally_long(
        "opportunities",
        &[n, toa.len(), sender.len(), receiver.len(), probability.len(), draws.shape()[0]],
    )?;
    (0..n)
        .map(|i| {
            Ok(Opportunity {
                tol_ns: tol[i],
                sender: vehicle(sender[i])?,
                receiver: vehicle(receiver[i])?,
                toa_ns: toa[i],
                survive_probability: probability[i],
                draws: draws.as_array().row(i).to_vec(),
            })
        })
        .collect()
}

fn polls(columns: &Bound<'_, PyDict>) -> PyResult<Vec<Poll>> {
    if columns.is_empty() {
        return Ok(Vec::new());
    }
    let (tol, t) = (integers(columns, "tol_ns")?, integers(columns, "t_ns")?);
    let (sender, poller) = (integers(columns, "sender")?, integers(columns, "poller")?);
    let (bytes, reply) = (integers(columns, "poll_bytes")?, integers(columns, "reply_bytes")?);
    let air_time = integers(columns, "air_time_ns")?;
    let answered =
        columns.get_item("answered")?.ok_or_else(|| argument("column answered is missing".into()))?;
    let answered = answered.extract::<PyReadonlyArray1<'_, bool>>()?;
    let n = tol.len();
    equally_long(
        "polls",
        &[
            n,
            t.len(),
            sender.len(),
            poller.len(),
            bytes.len(),
            reply.len(),
            air_time.len(),
            answered.shape()[0],
        ],
    )?;
    let count = |name: &str, value: i64| {
        u32::try_from(value).map_err(|_| argument(format!("{name} is {value}, not 0 to {}", u32::MAX)))
    };
    (0..n)
        .map(|i| {
            Ok(Poll {
                tol_ns: tol[i],
                sender: vehicle(sender[i])?,
                poller: vehicle(poller[i])?,
                t_ns: t[i],
                bytes: count("poll_bytes", bytes[i])?,
                air_time_ns: air_time[i],
                reply_bytes: count("reply_bytes", reply[i])?,
                answered: answered.as_array()[i],
            })
        })
        .collect()
}

#[pymethods]
impl Mission {
    /// `link` is (frame_bytes, max_frames, frame_s, preamble_s, sound_speed_mps); the tables are dicts of columns as in
    /// `uwcoop.missionlog`; `receptions` and `payloads` are what a real modem decoded, `polls` those of two-way ranging.
    #[new]
    #[pyo3(signature = (vehicles, link, events, slots, opportunities, receptions, payloads, end_ns, polls = None))]
    #[allow(clippy::too_many_arguments)]
    fn new(
        vehicles: usize,
        link: (usize, usize, f64, f64, f64),
        events: &Bound<'_, PyDict>,
        slots: &Bound<'_, PyDict>,
        opportunities: &Bound<'_, PyDict>,
        receptions: &Bound<'_, PyDict>,
        payloads: Vec<Vec<u8>>,
        end_ns: i64,
        polls: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let link = LinkConfig::new(link.0, link.1, link.2, link.3, link.4).map_err(|e| log(e.into()))?;
        let mut all = Vec::new();
        for (kind, columns) in events.iter() {
            all.extend(Table::new(kind.extract()?, columns.cast_into::<PyDict>()?).events()?);
        }
        if !receptions.is_empty() {
            let (t, receiver) = (integers(receptions, "t_ns")?, integers(receptions, "receiver")?);
            let sender = integers(receptions, "sender")?;
            let (tol, toa) = (integers(receptions, "tol_ns")?, integers(receptions, "toa_ns")?);
            equally_long(
                "receptions",
                &[t.len(), receiver.len(), sender.len(), tol.len(), toa.len(), payloads.len()],
            )?;
            for (i, bytes) in payloads.iter().enumerate() {
                all.push(reception(t[i], receiver[i], sender[i], tol[i], toa[i], bytes)?);
            }
        }
        let (slots, opportunities) = (self::slots(slots)?, self::opportunities(opportunities)?);
        let polls = polls.map_or_else(|| Ok(Vec::new()), self::polls)?;
        let mission = CoreMission::new(vehicles, link, all, slots, opportunities, end_ns)
            .and_then(|mission| mission.with_polls(polls))
            .map_err(log)?;
        Ok(Self { inner: Arc::new(mission) })
    }

    /// Number of vehicles.
    #[getter]
    fn vehicles(&self) -> usize {
        self.inner.vehicles()
    }

    /// Air time of a packet of so many bytes, s.
    fn air_time_s(&self, bytes: usize) -> PyResult<f64> {
        let ns = self.inner.link().air_time_ns(bytes).map_err(|e| log(e.into()))?;
        Ok(uwcoop_core::event::seconds(ns))
    }
}
