//! Settings of `team`.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::drift::PRESET_OPTIONS;
use super::range::{BeliefForm, RangeSettings};
use super::terrain::TerrainSettings;
use super::{Bound, Bounded, Context, DriftPreset, DriftSettings, Made, Settings, Unread, all_unread};
use crate::chart::Chart;
use crate::error::Error;
use crate::navigator::drift::Drift;
use crate::navigator::team::{Team, TeamOptions};

/// Settings of `team`: those of the terrain core and of its ranges, and the following.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TeamSettings {
    /// The own core.
    #[serde(flatten)]
    pub terrain: TerrainSettings,
    /// Drift.
    #[serde(flatten)]
    pub drift: DriftSettings,
    /// Ranges.
    #[serde(flatten)]
    pub range: RangeSettings,
    /// Own data since the last broadcast, rounded to one frame; or the same as float64, for studies.
    pub packet: BeliefForm,
    /// Evidence by which the filter without ranges must explain the own soundings better before its cloud takes over, nat;
    /// 0: it is not run.
    pub referee_nat: f64,
    /// Bytes of a packet, tag or checksum included.
    pub frame_bytes: usize,
    /// Bytes of the frame that are kept for an authentication tag; it takes the checksum's place.
    pub tag_bytes: usize,
    /// Least distance between the soundings that are sent, m.
    pub packet_spacing_m: f64,
    /// Class of drift of each vehicle, in the team's order; `None`: all as `drift` and the options beside it.
    pub team_drift: Option<Vec<DriftPreset>>,
    /// Teammates whose cross-covariances are kept.
    pub group_size: usize,
    /// A packet that would leave a smaller effective share of the particles has its weight quartered, at most six times.
    pub packet_least_ess_share: f64,
    /// How much of a teammate's current is its own.
    pub current_difference: f64,
    /// Sigma of a teammate's datum offset (tide) minus this vehicle's own, m; `None`: they have nothing in common.
    pub offset_difference_m: Option<f64>,
    /// Over holes no wider than this a teammate's sounding is linearised on a filled copy of the chart, m.
    pub fill_reach_m: f64,
}

/// What belongs to packets.
const OF_PACKETS: [&str; 10] = [
    "referee_nat",
    "packet",
    "frame_bytes",
    "tag_bytes",
    "packet_spacing_m",
    "group_size",
    "packet_least_ess_share",
    "current_difference",
    "offset_difference_m",
    "fill_reach_m",
];

impl Default for TeamSettings {
    fn default() -> Self {
        Self {
            terrain: TerrainSettings { particles: 1500, ..TerrainSettings::default() },
            drift: DriftSettings::default(),
            range: RangeSettings { range_gate_sigmas: Some(6.0), ..RangeSettings::default() },
            packet: BeliefForm::Rounded,
            referee_nat: 10.0,
            frame_bytes: 32,
            tag_bytes: 4,
            packet_spacing_m: 0.0,
            team_drift: None,
            group_size: 4,
            packet_least_ess_share: 0.02,
            current_difference: 1.0,
            offset_difference_m: None,
            fill_reach_m: 60.0,
        }
    }
}

impl TeamSettings {
    /// Drift of each vehicle.
    fn drifts(&self, vehicles: usize) -> Result<Vec<Drift>, Error> {
        let own = &self.drift;
        match &self.team_drift {
            None => Ok(vec![own.options(); vehicles]),
            Some(classes) if classes.len() == vehicles => {
                Ok(classes.iter().map(|class| own.of(*class)).collect())
            }
            Some(classes) => Err(Error::Setting {
                navigator: Self::METHOD,
                option: "team_drift".into(),
                reason: format!("names {} vehicles: the team has {vehicles}", classes.len()),
            }),
        }
    }

    /// The options of one vehicle on this chart.
    ///
    /// # Errors
    /// `team_drift` does not name every vehicle.
    pub fn options(&self, context: &Context<'_>, chart: Option<&Chart>) -> Result<TeamOptions, Error> {
        let drifts = self.drifts(context.vehicles)?;
        let own = drifts.get(usize::from(context.vehicle)).copied();
        Ok(TeamOptions {
            terrain: self.terrain.options(chart, own.unwrap_or_else(|| self.drift.options())),
            drifts,
            use_ranges: self.range.use_ranges,
            sigma_range_m: self.range.sigma_range_m,
            range_gate_sigmas: self.range.gate_sigmas(),
            clock: self.range.clock,
            referee_nat: self.referee_nat,
            frame_bytes: self.frame_bytes,
            tag_bytes: self.tag_bytes,
            packet_f64: self.packet == BeliefForm::F64,
            packet_spacing_m: self.packet_spacing_m,
            group_size: self.group_size,
            least_ess_share: self.packet_least_ess_share,
            current_difference: self.current_difference,
            offset_difference_m: self.offset_difference_m.unwrap_or(f64::INFINITY),
            fill_reach_m: self.fill_reach_m,
        })
    }
}

impl Settings for TeamSettings {
    const METHOD: &'static str = "team";
    const WITHOUT: &'static [Unread] = &[
        ("range_temper", "team counts each datum once, and tempers no range"),
        ("range_novelty", "team hears measurements, not beliefs: each is new"),
        ("range_method", "team has one range likelihood, the Gaussian"),
        ("range_samples", "team draws no samples of a broadcast belief"),
        ("entropy_sigma_m", "team weighs whole packets, and does not say what a range told"),
    ];

    fn bounds() -> Vec<Bounded> {
        let own = [
            ("referee_nat", Bound::NON_NEGATIVE),
            ("frame_bytes", Bound::between(16.0, 256.0, "16 to 256")),
            ("tag_bytes", Bound::between(0.0, 32.0, "0 to 32")),
            ("packet_spacing_m", Bound::NON_NEGATIVE),
            ("group_size", Bound::between(1.0, 15.0, "1 to 15")),
            ("packet_least_ess_share", Bound::between(0.0, 0.5, "0 to 0.5")),
            ("current_difference", Bound::SHARE),
            ("offset_difference_m", Bound::NON_NEGATIVE),
            ("fill_reach_m", Bound::POSITIVE),
        ];
        own.into_iter()
            .chain(RangeSettings::BOUNDS)
            .chain(TerrainSettings::bounds())
            .chain(DriftSettings::bounds())
            .collect()
    }

    fn unread(&self) -> Vec<Unread> {
        let off = !self.range.use_ranges;
        // Teammates' biases are states whether or not the own ones are.
        let biases = off.then(|| self.terrain.unread_biases()).into_iter().flatten();
        let classes = self.team_drift.is_some();
        self.terrain
            .unread()
            .chain(biases)
            .chain(all_unread(off, &RangeSettings::OPTIONS, RangeSettings::OFF))
            .chain(all_unread(off, &OF_PACKETS, RangeSettings::OFF))
            .chain(all_unread(classes, &["drift"], "team_drift states it for each vehicle"))
            .chain(all_unread(classes, &PRESET_OPTIONS, "team_drift states it for each vehicle"))
            .collect()
    }

    fn make(&self, context: &Context<'_>, chart: Option<Arc<Chart>>) -> Result<Made, Error> {
        let options = self.options(context, chart.as_deref())?;
        let Context { vehicle, vehicles, sound_speed_mps, seed, .. } = *context;
        if self.terrain.bias_states {
            Made::navigator(Team::<4>::new(vehicle, vehicles, options, chart, sound_speed_mps, seed))
        } else {
            Made::navigator(Team::<2>::new(vehicle, vehicles, options, chart, sound_speed_mps, seed))
        }
    }
}
