//! Settings of late events, the same for every navigator of one vehicle.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::{Bounded, Made, Unread, completed};
use crate::error::Error;
use crate::event::VehicleId;
use crate::navigator::delayed::{BOUNDS, Delayed, DelayedOptions, Late};

/// What becomes of events that are older than the navigator's time.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LateSettings {
    /// Refused, replayed in their place, or used when they come.
    pub late: Late,
    /// How old an event may be, s.
    pub lag_s: f64,
}

impl Default for LateSettings {
    fn default() -> Self {
        Self { late: Late::Refuse, lag_s: 30.0 }
    }
}

impl LateSettings {
    /// Its options.
    pub const OPTIONS: [&'static str; 2] = ["late", "lag_s"];

    /// Its bounds.
    pub const BOUNDS: [Bounded; 1] = BOUNDS;

    /// Those of `stated` that are its own, completed by the defaults, and the rest.
    ///
    /// # Errors
    /// A value of another type or outside its bound.
    pub fn split(
        navigator: &'static str,
        stated: &Map<String, Value>,
    ) -> Result<(Self, Map<String, Value>), Error> {
        let (own, rest): (Vec<_>, Vec<_>) =
            stated.clone().into_iter().partition(|(option, _)| Self::OPTIONS.contains(&option.as_str()));
        let own: Map<String, Value> = own.into_iter().collect();
        Ok((completed(navigator, &[], &Self::BOUNDS, &own)?, rest.into_iter().collect()))
    }

    /// Options that have no effect as the others stand.
    #[must_use]
    pub fn unread(&self, central: bool) -> Vec<Unread> {
        if central {
            return Self::OPTIONS.map(|option| (option, "a centralised reference is fed in order")).to_vec();
        }
        if self.late == Late::Refuse { vec![("lag_s", "late is \"refuse\"")] } else { Vec::new() }
    }

    /// A navigator of vehicle `own` with the window that is asked for; a centralised reference as it is.
    #[must_use]
    pub fn around(&self, made: Made, own: VehicleId) -> Made {
        match made {
            Made::Navigator(navigator) if self.late != Late::Refuse => {
                let options = DelayedOptions { late: self.late, lag_s: self.lag_s };
                Made::Navigator(Box::new(Delayed::around(navigator, own, options)))
            }
            as_it_is => as_it_is,
        }
    }
}
