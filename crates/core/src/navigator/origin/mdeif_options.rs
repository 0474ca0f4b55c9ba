//! Options of `mdeif`.

use super::lasting::LastingOptions;
use super::local_options::LocalOptions;
use crate::information::replica::Methods;
use crate::packet::graph::GraphForm;

/// Options of [`Mdeif`](super::mdeif::Mdeif).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MdeifOptions {
    /// Own sensors and ranges.
    pub local: LocalOptions,
    /// Errors that last, and noise that fits the day.
    pub lasting: LastingOptions,
    /// Layout of the packets.
    pub form: GraphForm,
    /// With how many of the last transmissions a float64 packet holds the exact joint.
    pub exact_lags: usize,
    /// What a client may use.
    pub methods: Methods,
}
