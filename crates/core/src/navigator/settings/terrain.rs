//! Options of the terrain core, which `mpf` and `team` have alike.

use serde::{Deserialize, Serialize};

use super::drift::BIAS_OPTIONS;
use super::{Bound, Bounded, Unread, all_unread};
use crate::chart::Chart;
use crate::navigator::drift::Drift;
use crate::navigator::terrain_core::{MonitorOptions, TerrainOptions};

/// Bound of a cloud's size.
pub const PARTICLES: Bounded = ("particles", Bound::between(10.0, 1e7, "10 to 10,000,000"));

/// Cloud, datum offset, soundings, health monitor. Drift stands beside it: serde refuses unknown options only where
/// flattened structures are not nested.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TerrainSettings {
    /// Particles.
    pub particles: usize,
    /// Resample when the effective sample size falls to this share of the particles.
    pub resample_share: f64,
    /// Sigma of a sounding, m; `None`: what the sensor states.
    pub sigma_depth_m: Option<f64>,
    /// Prior of the datum offset (tide), m, positive = deeper than the chart.
    pub sigma_offset0_m: f64,
    /// Walk of the datum offset, m; `None`: 0.005, or 0.002 on a chart whose error is not correlated.
    pub sigma_offset_m_per_sounding: Option<f64>,
    /// Degrees of freedom of the sounding's Student t; `None`: 4, or a Gaussian on a chart whose error is not correlated.
    pub student_dof: Option<f64>,
    /// Distance over which the chart's error stays itself, m; `None`: as the chart states.
    pub correlation_length_m: Option<f64>,
    /// Sigma of the chart's error, m; `None`: as the chart states.
    pub sigma_map_m: Option<f64>,
    /// Least distance between the soundings that are used, m.
    pub sounding_spacing_m: f64,
    /// A sounding that would leave a smaller effective share of the particles has its sigma doubled, six times at most.
    pub least_ess_share: f64,
    /// Soundings are taken for noisier than stated where they show it, by this factor at most; `None`: as stated.
    pub depth_noise_factor_max: Option<f64>,
    /// A start known to less than this, along the longer axis, is searched for; so is a cloud that grew to more than twice
    /// as much, and beyond what its particles can hold, m.
    pub acquisition_sigma_m: f64,
    /// Particles while the position is searched for, at most.
    pub acquisition_particles: usize,
    /// Begin anywhere on the chart at the first sounding, where no fix came before it.
    pub start_anywhere: bool,
    /// Compass and thrust bias as further Kalman states.
    pub bias_states: bool,
    /// Spread the cloud when its soundings have contradicted it for long.
    pub monitor: bool,
    /// Weight of a new sounding.
    pub monitor_forgetting: f64,
    /// One sounding counts at most this.
    pub monitor_clip: f64,
    /// Alarm above this mean normalised squared innovation.
    pub monitor_alarm: f64,
    /// Spread of the position on alarm, m.
    pub monitor_spread_m: f64,
    /// The same when an alarm repeats within `monitor_repeat_s`, m.
    pub monitor_repeat_spread_m: f64,
    /// Spread of the current, m/s.
    pub monitor_spread_current_mps: f64,
    /// No two alarms closer than this, s.
    pub monitor_quiet_s: f64,
    /// See `monitor_repeat_spread_m`, s.
    pub monitor_repeat_s: f64,
    /// Kernel width of the entropies that say what each measurement update told, m; `None`: not asked.
    pub update_entropy_sigma_m: Option<f64>,
}

const MONITOR_OPTIONS: [&str; 8] = [
    "monitor_forgetting",
    "monitor_clip",
    "monitor_alarm",
    "monitor_spread_m",
    "monitor_repeat_spread_m",
    "monitor_spread_current_mps",
    "monitor_quiet_s",
    "monitor_repeat_s",
];

impl Default for TerrainSettings {
    fn default() -> Self {
        Self {
            particles: 600,
            resample_share: 2.0 / 3.0,
            sigma_depth_m: None,
            sigma_offset0_m: 1.0,
            sigma_offset_m_per_sounding: None,
            student_dof: None,
            correlation_length_m: None,
            sigma_map_m: None,
            sounding_spacing_m: 0.0,
            least_ess_share: 0.02,
            depth_noise_factor_max: Some(4.0),
            acquisition_sigma_m: 20.0,
            acquisition_particles: 20_000,
            start_anywhere: false,
            bias_states: false,
            monitor: true,
            monitor_forgetting: 0.05,
            monitor_clip: 25.0,
            monitor_alarm: 6.0,
            monitor_spread_m: 10.0,
            monitor_repeat_spread_m: 25.0,
            monitor_spread_current_mps: 0.1,
            monitor_quiet_s: 20.0,
            monitor_repeat_s: 100.0,
            update_entropy_sigma_m: None,
        }
    }
}

impl TerrainSettings {
    /// Bounds of its options.
    #[must_use]
    pub fn bounds() -> Vec<Bounded> {
        let own = [
            PARTICLES,
            ("resample_share", Bound::SHARE),
            ("sigma_depth_m", Bound::POSITIVE),
            ("sigma_offset0_m", Bound::POSITIVE),
            ("sigma_offset_m_per_sounding", Bound::NON_NEGATIVE),
            ("student_dof", Bound::POSITIVE),
            ("correlation_length_m", Bound::NON_NEGATIVE),
            ("sigma_map_m", Bound::NON_NEGATIVE),
            ("sounding_spacing_m", Bound::NON_NEGATIVE),
            ("least_ess_share", Bound::between(0.0, 0.5, "0 to 0.5")),
            ("depth_noise_factor_max", Bound::between(1.0, 6.0, "1 to 6")),
            ("acquisition_sigma_m", Bound::POSITIVE),
            ("acquisition_particles", Bound::between(10.0, 1e7, "10 to 10,000,000")),
            ("monitor_forgetting", Bound::SHARE),
            ("monitor_clip", Bound::POSITIVE),
            ("monitor_alarm", Bound::POSITIVE),
            ("update_entropy_sigma_m", Bound::POSITIVE),
        ];
        let spreads = MONITOR_OPTIONS[3..].iter().map(|option| (*option, Bound::NON_NEGATIVE));
        own.into_iter().chain(spreads).collect()
    }

    /// Options that have no effect as the others stand.
    pub fn unread(&self) -> impl Iterator<Item = Unread> {
        all_unread(!self.monitor, &MONITOR_OPTIONS, "monitor is false")
    }

    /// Options of bias states, where there are none.
    pub fn unread_biases(&self) -> impl Iterator<Item = Unread> {
        all_unread(!self.bias_states, &BIAS_OPTIONS, "bias_states is false")
    }

    /// Tails and walk chosen for the chart's kind of error; the drift is the caller's.
    #[must_use]
    pub fn options(&self, chart: Option<&Chart>, drift: Drift) -> TerrainOptions {
        let stated_m = chart.map_or(0.0, Chart::correlation_length_m);
        let white = self.correlation_length_m.unwrap_or(stated_m) == 0.0;
        TerrainOptions {
            particles: self.particles,
            resample_share: self.resample_share,
            sigma_depth_m: self.sigma_depth_m,
            sigma_offset0_m: self.sigma_offset0_m,
            sigma_offset_m_per_sounding: self.sigma_offset_m_per_sounding.unwrap_or(if white {
                0.002
            } else {
                0.005
            }),
            student_dof: self.student_dof.unwrap_or(if white { f64::INFINITY } else { 4.0 }),
            correlation_length_m: self.correlation_length_m,
            sigma_map_m: self.sigma_map_m,
            sounding_spacing_m: self.sounding_spacing_m,
            least_ess_share: self.least_ess_share,
            depth_noise_factor_max: self.depth_noise_factor_max,
            acquisition_sigma_m: self.acquisition_sigma_m,
            acquisition_particles: self.acquisition_particles,
            start_anywhere: self.start_anywhere,
            monitor: self.monitor.then_some(MonitorOptions {
                forgetting: self.monitor_forgetting,
                clip: self.monitor_clip,
                alarm: self.monitor_alarm,
                spread_m: self.monitor_spread_m,
                repeat_spread_m: self.monitor_repeat_spread_m,
                spread_current_mps: self.monitor_spread_current_mps,
                quiet_s: self.monitor_quiet_s,
                repeat_s: self.monitor_repeat_s,
            }),
            update_entropy_sigma_m: self.update_entropy_sigma_m,
            drift,
        }
    }
}
