//! The packaged navigators by name: the only place that lists them, and the one constructor for all.

use std::sync::Arc;

use serde_json::{Map, Value, json};

use super::settings::{
    BeliefSettings, CekfSettings, Context, DeifRedundantSettings, DeifSettings, DmpfSettings, DriftSettings,
    InterleavedSettings, LandmarkPaperSettings, LandmarkSettings, LateSettings, Made, MdeifSettings,
    MpfSettings, Settings, TeamSettings, Unread, as_map,
};
use super::{CentralEstimator, Navigator};
use crate::chart::Chart;
use crate::error::Error;

/// Options as a scenario file states them.
pub type Options = Map<String, Value>;

type Make = fn(&Options, &Context<'_>, Option<Arc<Chart>>) -> Result<Made, Error>;

/// What the settings of one method can do.
#[derive(Clone, Copy)]
pub struct Method {
    /// Its name.
    pub name: &'static str,
    /// Whether it makes one estimator for the whole team.
    pub central: bool,
    describe: fn() -> Result<Value, Error>,
    unread: fn(&Options) -> Result<Vec<Unread>, Error>,
    make: Make,
}

/// A packaged navigator.
#[derive(Clone, Copy)]
pub struct Packaged {
    /// Its name in scenario files and tables.
    pub name: &'static str,
    /// What it is, in a sentence.
    pub summary: &'static str,
    /// Its method.
    pub method: Method,
    /// Options that make it what its name says, as JSON.
    fixed: &'static str,
    /// When it takes part unless a user names it.
    pub takes_part: TakesPart,
    /// False: it uses information that no vehicle has, e.g. which of its packets arrived.
    pub realisable: bool,
}

/// When a navigator takes part unless a user names it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TakesPart {
    /// Always.
    Always,
    /// Where the modem carries its packet.
    WithBandwidth,
    /// Where the scenario's `navigators` names it.
    Listed,
}

const fn method<S: Settings>(central: bool) -> Method {
    Method { name: S::METHOD, central, describe: describe::<S>, unread: unread::<S>, make: make::<S> }
}

fn describe<S: Settings>() -> Result<Value, Error> {
    let bounds: Map<String, Value> = S::bounds()
        .into_iter()
        .chain(LateSettings::BOUNDS)
        .map(|(option, bound)| {
            let mut limits = Map::new();
            limits.insert(if bound.above { "gt" } else { "ge" }.into(), bound.least.into());
            if bound.most.is_finite() {
                limits.insert(if bound.below { "lt" } else { "le" }.into(), bound.most.into());
            }
            (option.to_owned(), Value::Object(limits))
        })
        .collect();
    let without: Map<String, Value> =
        S::WITHOUT.iter().map(|(option, reason)| ((*option).to_owned(), (*reason).into())).collect();
    let mut defaults = as_map(&S::default())?;
    defaults.extend(as_map(&LateSettings::default())?);
    Ok(json!({ "defaults": defaults, "bounds": bounds, "without": without }))
}

fn unread<S: Settings>(stated: &Options) -> Result<Vec<Unread>, Error> {
    S::complete(stated).map(|settings| settings.unread())
}

fn make<S: Settings>(
    stated: &Options,
    context: &Context<'_>,
    chart: Option<Arc<Chart>>,
) -> Result<Made, Error> {
    S::complete(stated)?.make(context, chart)
}

impl Method {
    /// Defaults, bounds (`gt`, `ge`, `lt`, `le`) and options that it does not have, each with the reason.
    ///
    /// # Errors
    /// [`Error::External`] for settings that are no map.
    pub fn describe(&self) -> Result<Value, Error> {
        (self.describe)()
    }
}

impl Packaged {
    const fn of<S: Settings>(name: &'static str, summary: &'static str) -> Self {
        Self {
            name,
            summary,
            method: method::<S>(false),
            fixed: "{}",
            takes_part: TakesPart::Always,
            realisable: true,
        }
    }

    const fn listed<S: Settings>(name: &'static str, summary: &'static str) -> Self {
        Self { takes_part: TakesPart::Listed, ..Self::of::<S>(name, summary) }
    }

    const fn central<S: Settings>(name: &'static str, summary: &'static str) -> Self {
        Self { method: method::<S>(true), realisable: false, ..Self::listed::<S>(name, summary) }
    }

    const fn fixed_at(self, fixed: &'static str) -> Self {
        Self { fixed, ..self }
    }

    /// Options that have no effect as `stated`, what is fixed, and the defaults stand, each with the reason.
    ///
    /// # Errors
    /// What [`Settings::complete`] says.
    pub fn unread(&self, stated: &Options) -> Result<Vec<Unread>, Error> {
        let whole: Options = stated.clone().into_iter().chain(self.fixed()?).collect();
        let (late, rest) = LateSettings::split(self.name, &whole)?;
        let mut unread = (self.method.unread)(&rest).map_err(|error| self.renamed(error))?;
        unread.extend(late.unread(self.method.central));
        Ok(unread)
    }

    /// Options that make it what its name says.
    /// Options that make it what its name says.
    ///
    /// # Errors
    /// [`Error::External`] for a table that is not JSON.
    pub fn fixed(&self) -> Result<Options, Error> {
        serde_json::from_str(self.fixed).map_err(|error| Error::External(error.to_string()))
    }

    /// What it is made from `stated`.
    fn make(
        &self,
        context: &Context<'_>,
        stated: &Options,
        chart: Option<Arc<Chart>>,
    ) -> Result<Made, Error> {
        let fixed = self.fixed()?;
        for (option, value) in &fixed {
            if let Some(other) = stated.get(option).filter(|other| *other != value) {
                return Err(Error::Setting {
                    navigator: self.name,
                    option: option.clone(),
                    reason: format!("is {other}: this navigator has it at {value}"),
                });
            }
        }
        let whole: Options = stated.clone().into_iter().chain(fixed.clone()).collect();
        let read = || {
            for (option, reason) in self.unread(stated)? {
                if stated.contains_key(option) && !fixed.contains_key(option) {
                    return Err(Error::Setting {
                        navigator: self.name,
                        option: option.to_owned(),
                        reason: format!("not read, because {reason}"),
                    });
                }
            }
            let (late, rest) = LateSettings::split(self.name, &whole)?;
            (self.method.make)(&rest, context, chart).map(|made| late.around(made, context.vehicle))
        };
        read().map_err(|error| self.renamed(error))
    }

    /// An error about the method's options is one about this navigator's.
    fn renamed(&self, error: Error) -> Error {
        match error {
            Error::Setting { option, reason, .. } => Error::Setting { navigator: self.name, option, reason },
            other => other,
        }
    }
}

/// A packaged navigator for one vehicle, from the options that a user states.
///
/// # Errors
/// An unknown name or option, a value outside its bound, an option that would not be read, a centralised reference.
pub fn make_navigator(
    name: &str,
    context: &Context<'_>,
    options: &Options,
    chart: Option<Arc<Chart>>,
) -> Result<Box<dyn Navigator>, Error> {
    match packaged(name)?.make(context, options, chart)? {
        Made::Navigator(navigator) => Ok(navigator),
        Made::Central(_) => {
            Err(Error::External(format!("{name} is made for the whole team, not for one vehicle")))
        }
    }
}

/// A packaged centralised reference; `context` is the first vehicle's.
///
/// # Errors
/// As [`make_navigator`]; a navigator of one vehicle.
pub fn make_central(
    name: &str,
    context: &Context<'_>,
    options: &Options,
) -> Result<Box<dyn CentralEstimator>, Error> {
    match packaged(name)?.make(context, options, None)? {
        Made::Central(estimator) => Ok(estimator),
        Made::Navigator(_) => {
            Err(Error::External(format!("{name} is made for one vehicle, not for the whole team")))
        }
    }
}

/// The packaged navigator of this name.
///
/// # Errors
/// [`Error::External`] naming those that there are.
pub fn packaged(name: &str) -> Result<&'static Packaged, Error> {
    PACKAGED.iter().find(|packaged| packaged.name == name).ok_or_else(|| {
        let names: Vec<&str> = PACKAGED.iter().map(|packaged| packaged.name).collect();
        Error::External(format!("navigator {name:?} is unknown; there are {}", names.join(", ")))
    })
}

/// Section 4 of Walls & Eustice (2012): float64, no exact lags, and no health indicator before equation (6).
///
/// The joint of a packet counts as exact only where the newest node is its origin, for which (6) is 0/0.
const MDEIF_PAPER: &str = r#"{
    "packet_form": "f64", "exact_lags": 0, "use_joint": true, "use_equation_6": true, "health_loss_max": 1e9
}"#;

/// All of them.
pub static PACKAGED: &[Packaged] = &[
    Packaged::of::<DriftSettings>(
        "dead-reckoning",
        "Integrated commanded velocity, with the covariance of its unknown errors.",
    ),
    Packaged::of::<DmpfSettings>(
        "dmpf",
        "D-MPF of Tan, Chitre & Hover (2016): depth differences and ranges to broadcast beliefs.",
    ),
    Packaged {
        takes_part: TakesPart::WithBandwidth,
        ..Packaged::of::<DmpfSettings>(
            "dmpf-unlimited",
            "dmpf that broadcasts all its particles (section 5.1 of the paper); needs a modem without a limit.",
        )
        .fixed_at(r#"{"packet": "particles"}"#)
    },
    Packaged::of::<DmpfSettings>("terrain-only", "dmpf without ranges.").fixed_at(r#"{"use_ranges": false}"#),
    Packaged::of::<DmpfSettings>("ranging-only", "dmpf without soundings.").fixed_at(r#"{"use_terrain": false}"#),
    Packaged::of::<MpfSettings>(
        "mpf",
        "Consistent marginalised particle filter: datum offset, correlated chart error, ranges weighted by novelty.",
    ),
    Packaged::listed::<BeliefSettings>(
        "local-only",
        "Own sensors alone: DVL, heading and fixes in a filter with white acceleration.",
    )
    .fixed_at(r#"{"correlation": "ignored", "use_ranges": false}"#),
    Packaged::central::<CekfSettings>(
        "cekf",
        "Centralised filter with all data of the team, delayed states at launches (Webster et al. 2009).",
    )
    .fixed_at(r#"{"fed": "everything"}"#),
    Packaged::central::<CekfSettings>(
        "cekf-received",
        "cekf for each vehicle alone, with the raw data of exactly the packets that reached it.",
    )
    .fixed_at(r#"{"fed": "received"}"#),
    Packaged {
        realisable: false,
        ..Packaged::listed::<DeifSettings>(
            "deif",
            "Delta information between launches, with a delivery oracle (Walls & Eustice 2012, section 3). One-way only.",
        )
    },
    Packaged::listed::<DeifRedundantSettings>(
        "deif-redundant",
        "deif that repeats its last deltas in each packet in place of the oracle. One-way only.",
    ),
    Packaged::listed::<MdeifSettings>(
        "mdeif",
        "Origin-state method: local pose graphs over a lossy channel (Walls & Eustice 2012, section 4).",
    ),
    Packaged::listed::<MdeifSettings>(
        "mdeif-paper",
        "MDEIF as published: equation (6) at any cost in rounding; the filtered-error model only where (6) has no solution.",
    )
    .fixed_at(MDEIF_PAPER),
    Packaged::listed::<BeliefSettings>(
        "nekf",
        "Packets of mean and covariance, correlation ignored (Walls & Eustice 2012, section 2.1).",
    )
    .fixed_at(r#"{"correlation": "ignored"}"#),
    Packaged::listed::<InterleavedSettings>(
        "interleaved",
        "Interleaved update: a bank of filters with a table of origins (Bahr, Walter & Leonard 2009).",
    ),
    Packaged::listed::<BeliefSettings>(
        "covariance-intersection",
        "Packets of mean and covariance, correlation taken as unknown.",
    )
    .fixed_at(r#"{"correlation": "unknown"}"#),
    Packaged::listed::<BeliefSettings>(
        "covariance-intersection-inflated",
        "covariance-intersection with four times the process noise.",
    )
    .fixed_at(r#"{"correlation": "unknown", "process_noise_factor": 4.0}"#),
    Packaged::of::<MpfSettings>("mpf-terrain-only", "mpf without ranges.").fixed_at(r#"{"use_ranges": false}"#),
    Packaged::of::<TeamSettings>(
        "team",
        "Every particle carries its teammates; only soundings, displacement and ranges are broadcast.",
    ),
    Packaged::listed::<LandmarkSettings>(
        "dead-reckoning-dvl",
        "Integrated ground velocity and yaw rate, from the deployment's fix.",
    )
    .fixed_at(r#"{"use_fixes": false}"#),
    Packaged::listed::<LandmarkPaperSettings>(
        "landmark-paper",
        "Alternating landmark of Matsuda et al. (2017): particles over mover and landmark, with reconstruction.",
    ),
    Packaged::listed::<LandmarkSettings>(
        "landmark-ekf",
        "Alternating landmark by an extended Kalman filter without outlier model.",
    )
    .fixed_at(r#"{"outlier_share": 0.0, "recovery": false, "particles": 0}"#),
    Packaged::listed::<LandmarkSettings>(
        "landmark",
        "Robust alternating landmark: mixture likelihoods, recovery by alternative hypotheses, Gaussian once converged.",
    ),
];
