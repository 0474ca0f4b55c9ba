//! Options of `team`.

use crate::error::Error;
use crate::navigator::clock::ClockOptions;
use crate::navigator::drift::Drift;
use crate::navigator::settings::{Settings, TeamSettings, check_all};
use crate::navigator::terrain_core::TerrainOptions;

/// Options of `team`.
#[derive(Debug, Clone, PartialEq)]
pub struct TeamOptions {
    /// The own core.
    pub terrain: TerrainOptions,
    /// Drift of each vehicle of the team.
    pub drifts: Vec<Drift>,
    /// Whether to talk and to listen.
    pub use_ranges: bool,
    /// Standard deviation of a range, m.
    pub sigma_range_m: f64,
    /// A range that the particles contradict by more than this many sigmas is gated; infinite for never.
    pub range_gate_sigmas: f64,
    /// What may be wrong with ranges.
    pub clock: ClockOptions,
    /// Evidence by which the filter without ranges must explain the own soundings better before its cloud takes over,
    /// nat; 0: it does not run.
    pub referee_nat: f64,
    /// Bytes of a frame, tag or checksum included.
    pub frame_bytes: usize,
    /// Bytes of the frame that an authentication tag takes.
    pub tag_bytes: usize,
    /// `f64` packets, for studies without a limit on bandwidth.
    pub packet_f64: bool,
    /// Least distance between the soundings of a packet, m.
    pub packet_spacing_m: f64,
    /// Most teammates whose cross-covariances are kept; larger teams fall into groups of this size.
    pub group_size: usize,
    /// A packet whose weights would leave a smaller effective share of the particles is softened.
    pub least_ess_share: f64,
    /// How much of a teammate's current is its own: 1 for currents that have nothing in common; below, the prior and
    /// walk of the difference to this vehicle's current are this share of the drift's.
    pub current_difference: f64,
    /// Standard deviation of a teammate's datum offset (tide) minus this vehicle's, m; infinite for offsets that have
    /// nothing in common.
    pub offset_difference_m: f64,
    /// How far the outer points of a sounding may lie from a depth of the chart, m.
    pub fill_reach_m: f64,
}

impl TeamOptions {
    /// Refuses what is outside the bounds of the settings.
    ///
    /// # Errors
    /// [`Error::NotFinite`], [`Error::OutOfBound`] naming the option.
    pub fn validate(&self) -> Result<(), Error> {
        let mut values = vec![
            ("sigma_range_m", self.sigma_range_m),
            ("frame_bytes", self.frame_bytes as f64),
            ("tag_bytes", self.tag_bytes as f64),
            ("packet_spacing_m", self.packet_spacing_m),
            ("group_size", self.group_size as f64),
            ("packet_least_ess_share", self.least_ess_share),
            ("current_difference", self.current_difference),
            ("fill_reach_m", self.fill_reach_m),
        ];
        // Infinite for a gate that is never closed, and for offsets that have nothing in common.
        let optional = [
            ("range_gate_sigmas", self.range_gate_sigmas),
            ("offset_difference_m", self.offset_difference_m),
        ];
        values.extend(optional.into_iter().filter(|(_, value)| *value != f64::INFINITY));
        check_all(&TeamSettings::bounds(), &values)?;
        self.drifts.iter().try_for_each(Drift::validate)
    }
}
