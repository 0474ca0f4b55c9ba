//! Tags of packets, and what packets consist of.

use pyo3::prelude::*;
use pyo3::types::PyBytes;
use uwcoop_core::link::Authenticator as CoreAuthenticator;
use uwcoop_core::packet::Rounding;
use uwcoop_core::packet::layout::{FieldStep, FieldUse};

use crate::errors::navigator;

/// Tags of a team's packets: HMAC-SHA-256 over packet, sender and launch time, cut to `tag_bytes`.
#[pyclass(frozen, module = "uwcoop._native")]
pub struct Authenticator {
    pub inner: CoreAuthenticator,
}

#[pymethods]
impl Authenticator {
    /// `key`: 16 to 64 bytes that the whole team shares; `mission` must differ between missions with the same key.
    #[new]
    fn new(key: &[u8], tag_bytes: usize, mission: u64) -> PyResult<Self> {
        let inner = CoreAuthenticator::new(key, tag_bytes, mission).map_err(|e| navigator(e.into()))?;
        Ok(Self { inner })
    }

    /// Bytes that a tag adds to a packet.
    #[getter]
    fn tag_bytes(&self) -> usize {
        self.inner.tag_bytes()
    }

    /// The packet with its tag, for the slot of `sender` at `tol_ns`.
    fn append_tag<'py>(
        &self,
        py: Python<'py>,
        packet: &[u8],
        sender: u16,
        tol_ns: i64,
    ) -> Bound<'py, PyBytes> {
        PyBytes::new(py, &self.inner.append_tag(packet, sender, tol_ns))
    }

    /// The packet without its tag; None if no holder of the key tagged it for this sender, launch time and mission.
    fn check_tag<'py>(
        &self,
        py: Python<'py>,
        tagged: &[u8],
        sender: u16,
        tol_ns: i64,
    ) -> Option<Bound<'py, PyBytes>> {
        self.inner.check_tag(tagged, sender, tol_ns).ok().map(|packet| PyBytes::new(py, packet))
    }
}

/// (unit, least, greatest, kind of step, step, rounding).
type Scale = (&'static str, f64, f64, &'static str, f64, &'static str);
/// (name, bits of one, how many, scale).
pub type Field = (&'static str, u32, usize, Option<Scale>);

/// A field as Python sees it.
pub fn described(field: &FieldUse) -> Field {
    let scale = field.scale.as_ref().map(|scale| {
        let (kind, step) = match scale.step {
            FieldStep::Linear(step) => ("linear", step),
            FieldStep::Factor(step) => ("factor", step),
            FieldStep::Atanh(step) => ("atanh", step),
            FieldStep::Growing(step) => ("growing", step),
        };
        let rounding = match scale.rounding {
            Rounding::Nearest => "nearest",
            Rounding::Up => "up",
            Rounding::Down => "down",
            Rounding::TowardZero => "toward zero",
        };
        (scale.unit, scale.minimum, scale.maximum, kind, step, rounding)
    });
    (field.name, field.bits, field.count, scale)
}
