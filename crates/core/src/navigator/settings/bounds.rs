//! Bounds of numbers. Settings state them; constructors of navigators check their options against the same.

use crate::error::{Error, finite};

/// An option and its bound.
pub type Bounded = (&'static str, Bound);

/// Refuses a value outside the bound that `bounds` has for its option.
///
/// # Errors
/// What [`Bound::check`] says; [`Error::External`] for an option that `bounds` does not have.
pub fn check_all(bounds: &[Bounded], values: &[(&'static str, f64)]) -> Result<(), Error> {
    values.iter().try_for_each(|(option, value)| match bounds.iter().find(|(name, _)| name == option) {
        Some((_, bound)) => bound.check(option, *value),
        None => Err(Error::External(format!("{option} = {value} has no bound"))),
    })
}

/// Between what a number must lie.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bound {
    /// Lower end.
    pub least: f64,
    /// Whether the lower end itself is refused.
    pub above: bool,
    /// Upper end; infinite for none.
    pub most: f64,
    /// Whether the upper end itself is refused.
    pub below: bool,
    text: &'static str,
}

impl Bound {
    /// Above 0.
    pub const POSITIVE: Self =
        Self { least: 0.0, above: true, most: f64::INFINITY, below: false, text: "above 0" };
    /// 0 and above.
    pub const NON_NEGATIVE: Self =
        Self { least: 0.0, above: false, most: f64::INFINITY, below: false, text: "0 and above" };
    /// Above 0, at most 1.
    pub const SHARE: Self =
        Self { least: 0.0, above: true, most: 1.0, below: false, text: "above 0, at most 1" };
    /// 0 and above, below 1.
    pub const OUTLIER_SHARE: Self =
        Self { least: 0.0, above: false, most: 1.0, below: true, text: "0 and above, below 1" };

    /// Both ends included; `text` says them.
    #[must_use]
    pub const fn between(least: f64, most: f64, text: &'static str) -> Self {
        Self { least, above: false, most, below: false, text }
    }

    /// Refuses what lies outside.
    ///
    /// # Errors
    /// [`Error::NotFinite`], [`Error::OutOfBound`] naming the option.
    pub fn check(&self, option: &'static str, value: f64) -> Result<(), Error> {
        finite(option, value)?;
        let low = value < self.least || (self.above && value == self.least);
        let high = value > self.most || (self.below && value == self.most);
        if low || high {
            return Err(Error::OutOfBound { quantity: option, value, bound: self.text });
        }
        Ok(())
    }
}
