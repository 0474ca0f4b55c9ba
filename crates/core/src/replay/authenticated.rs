//! A team whose packets carry tags.

use super::{Estimators, Replay};
use crate::error::Error;
use crate::event::VehicleId;
use crate::link::Authenticator;
use crate::navigator::Navigator;
use crate::navigator::authenticated::authenticated;

impl Estimators {
    /// The same team with every vehicle's packets tagged and checked. A centralised estimator sends none.
    #[must_use]
    pub fn authenticated(self, authenticator: &Authenticator) -> Self {
        let Self::Each(navigators) = self else { return self };
        let vehicles = navigators.len();
        let authenticate = |(own, navigator): (usize, Box<dyn Navigator>)| -> Box<dyn Navigator> {
            authenticated(navigator, own as VehicleId, vehicles, authenticator.clone())
        };
        Self::Each(navigators.into_iter().enumerate().map(authenticate).collect())
    }
}

impl Replay {
    /// Tags the packets of every vehicle, and checks them, from here on; before anything has happened.
    ///
    /// # Errors
    /// [`Error::OutOfBound`] once the replay has begun.
    pub fn authenticate(&mut self, authenticator: &Authenticator) -> Result<(), Error> {
        let happened = self.cursor.event + self.cursor.slot + self.cursor.sample;
        if happened > 0 {
            return Err(Error::OutOfBound {
                quantity: "events replayed before authentication",
                value: happened as f64,
                bound: "0",
            });
        }
        let team = std::mem::replace(&mut self.team, Estimators::Each(Vec::new()));
        self.team = team.authenticated(authenticator);
        Ok(())
    }
}
