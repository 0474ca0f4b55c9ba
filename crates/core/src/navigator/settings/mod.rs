//! Settings: the options of a scenario file. The only place of their names, defaults and bounds.
//!
//! A structure for each method; `Default` holds the defaults. [`Settings::complete`] fills in what a user did not state,
//! and refuses what it does not know and what lies outside its bound; [`Settings::unread`] says what would have no effect. What depends on the chart or
//! on the size of the team is settled when a navigator is made.

mod bounds;
mod dmpf;
mod drift;
mod landmark;
pub(super) mod landmark_exchange;
mod landmark_paper;
mod late;
mod mpf;
pub(super) mod origin;
mod origin_references;
pub(super) mod range;
mod team;
pub(super) mod terrain;

pub use bounds::{Bound, Bounded, check_all};
pub use dmpf::DmpfSettings;
pub use drift::{DriftPreset, DriftSettings, PRESET_OPTIONS};
pub use landmark::LandmarkSettings;
pub use landmark_paper::LandmarkPaperSettings;
pub use late::LateSettings;
pub use mpf::MpfSettings;
pub use origin::{DeifRedundantSettings, DeifSettings, MdeifSettings};
pub use origin_references::{BeliefSettings, CekfSettings, InterleavedSettings};
pub use team::TeamSettings;

use std::sync::Arc;

use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::{Map, Value};

use super::{CentralEstimator, Navigator};
use crate::chart::Chart;
use crate::error::Error;
use crate::event::VehicleId;

/// An option that is not read, and why.
pub type Unread = (&'static str, &'static str);

/// What one vehicle's navigator is made from beside its options and chart.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Context<'a> {
    /// Its index in the team.
    pub vehicle: VehicleId,
    /// Size of the team.
    pub vehicles: usize,
    /// Sound speed that the team agreed on, m/s.
    pub sound_speed_mps: f64,
    /// Seed of the navigator's random streams.
    pub seed: u64,
    /// By vehicle, whether it uses ranges, as the team agreed; empty: all do.
    pub ranging: &'a [bool],
}

impl Context<'_> {
    /// Whether each vehicle uses ranges.
    #[must_use]
    pub fn ranging(&self) -> Vec<bool> {
        if self.ranging.is_empty() { vec![true; self.vehicles] } else { self.ranging.to_vec() }
    }

    /// Whether this vehicle uses ranges.
    #[must_use]
    pub fn ranges(&self) -> bool {
        self.ranging.get(usize::from(self.vehicle)).copied().unwrap_or(true)
    }
}

/// What settings make.
pub enum Made {
    /// The navigator of one vehicle.
    Navigator(Box<dyn Navigator>),
    /// One estimator for the whole team.
    Central(Box<dyn CentralEstimator>),
}

impl Made {
    /// A navigator of one vehicle.
    ///
    /// # Errors
    /// The error of the constructor.
    pub fn navigator(made: Result<impl Navigator + 'static, Error>) -> Result<Self, Error> {
        made.map(|navigator| Self::Navigator(Box::new(navigator)))
    }

    /// An estimator of the team.
    ///
    /// # Errors
    /// The error of the constructor.
    pub fn central(made: Result<impl CentralEstimator + 'static, Error>) -> Result<Self, Error> {
        made.map(|estimator| Self::Central(Box::new(estimator)))
    }
}

/// The settings of one method. `Default` is complete.
pub trait Settings: Default + Serialize + DeserializeOwned {
    /// The method.
    const METHOD: &'static str;

    /// Options of related methods that this one does not have, each with the reason.
    const WITHOUT: &'static [Unread] = &[];

    /// Bounds of the numbers.
    fn bounds() -> Vec<Bounded>;

    /// Options that have no effect as the others stand.
    fn unread(&self) -> Vec<Unread>;

    /// The navigator or the central estimator.
    ///
    /// # Errors
    /// A value that no bound foresees; a team or chart that the method cannot take.
    fn make(&self, context: &Context<'_>, chart: Option<Arc<Chart>>) -> Result<Made, Error>;

    /// `stated` completed by the defaults.
    ///
    /// # Errors
    /// [`Error::Setting`] naming an option that the method does not have or whose value has another type;
    /// [`Error::OutOfBound`].
    fn complete(stated: &Map<String, Value>) -> Result<Self, Error> {
        completed(Self::METHOD, Self::WITHOUT, &Self::bounds(), stated)
    }
}

/// `stated` completed by the defaults of `T`, which has these bounds.
///
/// # Errors
/// As [`Settings::complete`].
fn completed<T: Default + Serialize + DeserializeOwned>(
    navigator: &'static str,
    without: &[Unread],
    bounds: &[Bounded],
    stated: &Map<String, Value>,
) -> Result<T, Error> {
    let refuse =
        |option: &str, reason: String| Error::Setting { navigator, option: option.to_owned(), reason };
    let mut full = as_map(&T::default())?;
    for (option, value) in stated {
        if !full.contains_key(option) {
            let known = without.iter().find(|(name, _)| name == option);
            return Err(refuse(option, known.map_or("no such option", |(_, reason)| reason).to_owned()));
        }
        // Alone among defaults, so that the error names the option.
        let mut alone = as_map(&T::default())?;
        alone.insert(option.clone(), value.clone());
        serde_json::from_value::<T>(Value::Object(alone))
            .map_err(|error| refuse(option, format!("{value}: {error}")))?;
        full.insert(option.clone(), value.clone());
    }
    for (option, bound) in bounds {
        if let Some(value) = full.get(*option).and_then(Value::as_f64) {
            bound.check(option, value)?;
        }
    }
    serde_json::from_value(Value::Object(full)).map_err(|error| refuse("", error.to_string()))
}

/// Settings as a map from option to value.
///
/// # Errors
/// [`Error::External`] for settings that are no map.
pub(super) fn as_map(settings: &impl Serialize) -> Result<Map<String, Value>, Error> {
    match serde_json::to_value(settings) {
        Ok(Value::Object(map)) => Ok(map),
        Ok(_) => Err(Error::External("settings are not a map".into())),
        Err(error) => Err(Error::External(error.to_string())),
    }
}

/// `options`, all not read for one reason, where `applies`.
pub(super) fn all_unread(
    applies: bool,
    options: &[&'static str],
    reason: &'static str,
) -> impl Iterator<Item = Unread> {
    let options = if applies { options.to_vec() } else { Vec::new() };
    options.into_iter().map(move |option| (option, reason))
}
