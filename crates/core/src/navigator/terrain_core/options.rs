//! Options of the terrain core: cloud, datum offset, soundings, health monitor, drift.

use crate::error::Error;
use crate::navigator::drift::Drift;
use crate::navigator::settings::check_all;
use crate::navigator::settings::terrain::TerrainSettings;

/// When the cloud no longer explains its soundings: an EWMA of normalised squared mean innovations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MonitorOptions {
    /// Weight of a new sounding.
    pub forgetting: f64,
    /// One sounding counts at most this.
    pub clip: f64,
    /// Alarm above this.
    pub alarm: f64,
    /// On alarm, spread of the position, m.
    pub spread_m: f64,
    /// Spread when an alarm repeats within `repeat_s`, m.
    pub repeat_spread_m: f64,
    /// Spread of the current, m/s.
    pub spread_current_mps: f64,
    /// No two alarms closer than this, s.
    pub quiet_s: f64,
    /// See `repeat_spread_m`, s.
    pub repeat_s: f64,
}

/// Options of the terrain core, as `mpf` and `team` have them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TerrainOptions {
    /// N.
    pub particles: usize,
    /// Resample at N_eff ≤ this × N.
    pub resample_share: f64,
    /// Standard deviation of a sounding, m; `None` takes what the sensor states.
    pub sigma_depth_m: Option<f64>,
    /// Prior of the datum offset (tide), m.
    pub sigma_offset0_m: f64,
    /// Its walk per sounding, m.
    pub sigma_offset_m_per_sounding: f64,
    /// Degrees of freedom of Student's t; infinite for a Gaussian.
    pub student_dof: f64,
    /// Distance over which the chart's error stays itself, m; `None` asks the chart.
    pub correlation_length_m: Option<f64>,
    /// Standard deviation of the chart's error, m; `None` asks the chart.
    pub sigma_map_m: Option<f64>,
    /// Least distance between soundings that are used, m.
    pub sounding_spacing_m: f64,
    /// Share of the particles that a sounding must leave as effective sample size; 0 never softens one.
    pub least_ess_share: f64,
    /// Soundings may be taken for so many times noisier than their sensor states, by what they show; `None`: never.
    pub depth_noise_factor_max: Option<f64>,
    /// Health monitor.
    pub monitor: Option<MonitorOptions>,
    /// A start known to less than this, along the longer axis, is searched for; so is a cloud that grew to more than twice
    /// as much, and beyond what its particles can hold, m.
    pub acquisition_sigma_m: f64,
    /// Particles while the position is searched for, at most.
    pub acquisition_particles: usize,
    /// Begin anywhere on the chart at the first sounding, where no fix came before it.
    pub start_anywhere: bool,
    /// Kernel width for the information of each update, m; `None`: not measured.
    pub update_entropy_sigma_m: Option<f64>,
    /// Process noise and priors.
    pub drift: Drift,
}

impl TerrainOptions {
    /// Refuses what is outside the bounds of the settings.
    ///
    /// # Errors
    /// [`Error::OutOfBound`], [`Error::NotFinite`].
    pub fn validate(&self) -> Result<(), Error> {
        let mut values = vec![
            ("particles", self.particles as f64),
            ("resample_share", self.resample_share),
            ("sigma_offset0_m", self.sigma_offset0_m),
            ("sigma_offset_m_per_sounding", self.sigma_offset_m_per_sounding),
            ("sounding_spacing_m", self.sounding_spacing_m),
            ("least_ess_share", self.least_ess_share),
            ("acquisition_sigma_m", self.acquisition_sigma_m),
            ("acquisition_particles", self.acquisition_particles as f64),
        ];
        let optional = [
            ("sigma_depth_m", self.sigma_depth_m),
            ("correlation_length_m", self.correlation_length_m),
            ("sigma_map_m", self.sigma_map_m),
            ("depth_noise_factor_max", self.depth_noise_factor_max),
            // Infinite for a Gaussian.
            ("update_entropy_sigma_m", self.update_entropy_sigma_m),
            ("student_dof", Some(self.student_dof).filter(|dof| *dof != f64::INFINITY)),
        ];
        values.extend(optional.into_iter().filter_map(|(option, value)| Some((option, value?))));
        if let Some(monitor) = &self.monitor {
            values.extend([
                ("monitor_forgetting", monitor.forgetting),
                ("monitor_clip", monitor.clip),
                ("monitor_alarm", monitor.alarm),
                ("monitor_spread_m", monitor.spread_m),
                ("monitor_repeat_spread_m", monitor.repeat_spread_m),
                ("monitor_spread_current_mps", monitor.spread_current_mps),
                ("monitor_quiet_s", monitor.quiet_s),
                ("monitor_repeat_s", monitor.repeat_s),
            ]);
        }
        check_all(&TerrainSettings::bounds(), &values)
    }
}
