//! Words that kernels of the alternating landmark method take.

use pyo3::prelude::*;
use uwcoop_core::mixture::Criterion;
use uwcoop_core::navigator::landmark::model::{Gate, RatioReading};
use uwcoop_core::packet::landmark::{ExchangeFormat, ExchangeSize};

use crate::errors::argument;

/// Format 1 or 2.
pub fn exchange_format(format: usize) -> PyResult<ExchangeFormat> {
    match format {
        1 => Ok(ExchangeFormat::One),
        2 => Ok(ExchangeFormat::Two),
        other => Err(argument(format!("packet_format is {other}, not 1 or 2"))),
    }
}

/// A size in bytes.
pub fn exchange_size(bytes: usize) -> PyResult<ExchangeSize> {
    ExchangeSize::from_bytes(bytes)
        .map_err(|_| argument(format!("packet_bytes is {bytes}, not 8, 16, 32, 40, 64 or 128")))
}

/// `bic` or `aic`.
pub fn criterion(word: &str) -> PyResult<Criterion> {
    match word {
        "bic" => Ok(Criterion::Bic),
        "aic" => Ok(Criterion::Aic),
        other => Err(argument(format!("criterion is {other:?}, not bic or aic"))),
    }
}

/// The gate of a name.
pub fn gate(word: &str, share: f64, widths: [f64; 3]) -> PyResult<Gate> {
    match word {
        "joint" => Ok(Gate::Joint),
        "separate" => Ok(Gate::Separate),
        "none" => Ok(Gate::None),
        "mixture" => Ok(Gate::Mixture { share, widths }),
        other => Err(argument(format!("gate is {other:?}, not joint, separate, none or mixture"))),
    }
}

/// `linear` or `log`.
pub fn reading(word: &str) -> PyResult<RatioReading> {
    match word {
        "linear" => Ok(RatioReading::Linear),
        "log" => Ok(RatioReading::Log),
        other => Err(argument(format!("monitor_reading is {other:?}, not linear or log"))),
    }
}
