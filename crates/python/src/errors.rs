//! Core errors to the classes of `uwcoop.errors`.

use pyo3::prelude::*;
use pyo3::types::PyType;
use uwcoop_core::error::Error;

/// An exception of `uwcoop.errors` by name.
pub fn raise(class: &str, message: String) -> PyErr {
    Python::attach(|py| {
        let found = py
            .import("uwcoop.errors")
            .and_then(|m| m.getattr(class))
            .and_then(|c| Ok(c.cast_into::<PyType>()?));
        match found {
            Ok(class) => PyErr::from_type(class, (message,)),
            Err(error) => error,
        }
    })
}

/// What a navigator refused.
pub fn navigator(error: Error) -> PyErr {
    raise("NavigatorError", error.to_string())
}

/// What is wrong with a mission.
pub fn log(error: Error) -> PyErr {
    raise("LogError", error.to_string())
}

/// What is wrong with a chart.
pub fn chart(error: Error) -> PyErr {
    raise("ChartError", error.to_string())
}

/// A bad argument of a kernel.
pub fn argument(message: String) -> PyErr {
    pyo3::exceptions::PyValueError::new_err(message)
}
