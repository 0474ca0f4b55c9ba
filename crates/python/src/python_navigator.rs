//! A navigator written in Python, seen by the core as any other.

use std::sync::{Arc, Mutex};

use pyo3::prelude::*;
use pyo3::types::PyBytes;
use uwcoop_core::error::Error;
use uwcoop_core::event::{Event as CoreEvent, Kind};
use uwcoop_core::navigator::{Estimate, Kinds, Navigator, Outcome, Profile, Status};

use crate::errors::argument;
use crate::event::Event;

/// The first exception that a Python navigator raised; raised again when the replay returns.
pub type Failure = Arc<Mutex<Option<PyErr>>>;

/// Any object with `handle(event)`, `transmit(tol_ns, capacity_bytes)`, `estimate(t_ns)`; `snapshot` and `restore` are
/// asked for only when a snapshot is. It may say what it asks for, see [`profile_of`].
pub struct PythonNavigator {
    object: Py<PyAny>,
    failure: Failure,
    profile: Profile,
}

/// What a Python navigator says of itself: the attributes `takes_ranges`, `needs_delivery_oracle` and `uses`, each
/// optional; read once, before the first event. Its packets are its own affair, so it has no checksum that a tag could
/// replace.
fn profile_of(object: &Bound<'_, PyAny>) -> PyResult<Profile> {
    let flag = |name: &str, otherwise: bool| -> PyResult<bool> {
        let Some(value) = object.getattr_opt(name)? else { return Ok(otherwise) };
        value.extract().map_err(|_| argument(format!("{name} of a navigator is {value}, not True or False")))
    };
    let uses = match object.getattr_opt("uses")? {
        None => Kinds::all(),
        Some(names) => {
            let names: Vec<String> = names
                .extract()
                .map_err(|_| argument(format!("uses of a navigator is {names}, not names of event kinds")))?;
            names.iter().try_fold(Kinds::default(), |kinds, name| {
                let kind = Kind::ALL.into_iter().find(|kind| kind.name() == name);
                kind.map(|kind| kinds.with(kind, true))
                    .ok_or_else(|| argument(format!("uses of a navigator names {name:?}, no kind of event")))
            })?
        }
    };
    Ok(Profile {
        takes_ranges: flag("takes_ranges", true)?,
        has_checksum: false,
        needs_delivery_oracle: flag("needs_delivery_oracle", false)?,
        uses,
    })
}

impl PythonNavigator {
    pub fn new(object: &Bound<'_, PyAny>, failure: Failure) -> PyResult<Self> {
        let profile = profile_of(object)?;
        Ok(Self { object: object.clone().unbind(), failure, profile })
    }

    /// Keeps the exception and tells the core that something outside it failed.
    fn failed(&self, error: PyErr) -> Error {
        let message = error.to_string();
        if let Ok(mut failure) = self.failure.lock() {
            failure.get_or_insert(error);
        }
        Error::External(message)
    }

    fn check(&self) -> Result<(), Error> {
        match self.failure.lock() {
            Ok(failure) => match failure.as_ref() {
                Some(error) => Err(Error::External(error.to_string())),
                None => Ok(()),
            },
            Err(_) => Err(Error::External("a navigator failed in another thread".into())),
        }
    }

    fn ask(&self, py: Python<'_>, t_ns: i64) -> PyResult<Estimate> {
        let found = self.object.bind(py).call_method1("estimate", (t_ns,))?;
        let [e, n]: [f64; 2] = found.getattr("mean_m")?.extract()?;
        let [[ee, en], [_, nn]]: [[f64; 2]; 2] = found.getattr("covariance_m2")?.extract()?;
        Ok(Estimate {
            t_ns,
            mean_m: [e, n],
            covariance_m2: [ee, en, nn],
            yaw: None,
            ess: None,
            rejected: 0,
            status: Status::Navigating,
        })
    }
}

impl Navigator for PythonNavigator {
    fn handle(&mut self, event: &CoreEvent) -> Result<Outcome, Error> {
        self.check()?;
        Python::attach(|py| {
            let event = Event { inner: event.clone() };
            let answer = self.object.bind(py).call_method1("handle", (event,))?;
            Ok(match answer.extract::<Option<String>>()?.as_deref() {
                Some("noted") => Outcome::Noted,
                Some("gated") => Outcome::Gated,
                Some("rejected") => Outcome::Rejected,
                _ => Outcome::Fused,
            })
        })
        .map_err(|e| self.failed(e))
    }

    fn transmit(&mut self, tol_ns: i64, capacity_bytes: usize) -> Result<Option<Arc<[u8]>>, Error> {
        self.check()?;
        Python::attach(|py| {
            let packet = self.object.bind(py).call_method1("transmit", (tol_ns, capacity_bytes))?;
            Ok(packet.extract::<Option<Vec<u8>>>()?.map(Arc::from))
        })
        .map_err(|e| self.failed(e))
    }

    fn profile(&self) -> Profile {
        self.profile
    }

    fn estimate(&self, t_ns: i64) -> Estimate {
        Python::attach(|py| self.ask(py, t_ns)).unwrap_or_else(|error| {
            self.failed(error);
            Estimate {
                t_ns,
                mean_m: [f64::NAN; 2],
                covariance_m2: [f64::NAN; 3],
                yaw: None,
                ess: None,
                rejected: 0,
                status: Status::NotStarted,
            }
        })
    }

    fn snapshot(&self) -> Result<Vec<u8>, Error> {
        Python::attach(|py| self.object.bind(py).call_method0("snapshot")?.extract::<Vec<u8>>())
            .map_err(|e| self.failed(e))
    }

    fn restore(&mut self, snapshot: &[u8]) -> Result<(), Error> {
        Python::attach(|py| {
            self.object.bind(py).call_method1("restore", (PyBytes::new(py, snapshot),)).map(|_| ())
        })
        .map_err(|e| self.failed(e))
    }
}
