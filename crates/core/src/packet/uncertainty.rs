//! Fields that say how sure someone is: their rounding never overstates it.

use super::bits::mask;
use super::field::{finite, sign_extend, width};
use super::layout::{FieldStep, Scale, explain};
use super::{BitReader, BitWriter, PacketError, Rounding};

/// Largest |log₂ σ| that a [`SigmaField`] may reach: variances stay well inside the range of `f64`.
const LOG2_MAX: f64 = 400.0;

/// A standard deviation on a logarithmic scale, rounded *up*: σ = 2^(lowest_log2 + code / steps_per_octave).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SigmaField {
    /// What it holds, for errors.
    pub name: &'static str,
    /// Unit of the value.
    pub unit: &'static str,
    /// Width, 1 to 16.
    pub bits: u32,
    /// Codes in a factor of two, > 0.
    pub steps_per_octave: u32,
    /// Base-2 logarithm of the smallest sigma; anything smaller, zero included, becomes it.
    pub lowest_log2: i32,
}

impl SigmaField {
    fn check(&self) -> Result<u32, PacketError> {
        width(self.name, self.bits, 16)?;
        let definition = |quantity, value, minimum, maximum| {
            Err(PacketError::Definition { field: self.name, quantity, value, minimum, maximum })
        };
        if self.steps_per_octave == 0 {
            return definition("steps per octave", 0.0, 1.0, f64::from(u32::MAX));
        }
        let last = (1u32 << self.bits) - 1;
        let lowest = f64::from(self.lowest_log2);
        let highest = lowest + f64::from(last) / f64::from(self.steps_per_octave);
        if lowest < -LOG2_MAX || highest > LOG2_MAX {
            return definition(
                "log2 of the range's far end",
                if lowest < -LOG2_MAX { lowest } else { highest },
                -LOG2_MAX,
                LOG2_MAX,
            );
        }
        Ok(last)
    }

    /// The smallest code whose sigma is not below `sigma`.
    ///
    /// # Errors
    /// [`PacketError::NotFinite`]; [`PacketError::OutOfRange`] below zero or above the largest sigma;
    /// [`PacketError::Definition`].
    pub fn encode(&self, sigma: f64) -> Result<u32, PacketError> {
        let last = self.check()?;
        finite(self.name, sigma)?;
        let maximum = self.decode(last);
        if !(0.0..=maximum).contains(&sigma) {
            return Err(PacketError::OutOfRange {
                field: self.name,
                unit: self.unit,
                value: sigma,
                minimum: 0.0,
                maximum,
            });
        }
        let steps = (sigma.log2() - f64::from(self.lowest_log2)) * f64::from(self.steps_per_octave);
        // The logarithm may be an ulp off either way: settle it by what the receiver will compute. log2(0) is −∞,
        // and the conversion saturates.
        let mut code = (steps.ceil().max(0.0) as u32).min(last);
        if code > 0 && self.decode(code - 1) >= sigma {
            code -= 1;
        }
        if self.decode(code) < sigma {
            code += 1;
        }
        Ok(code.min(last))
    }

    /// The sigma of a code.
    #[must_use]
    pub fn decode(&self, code: u32) -> f64 {
        (f64::from(self.lowest_log2) + f64::from(code) / f64::from(self.steps_per_octave)).exp2()
    }

    /// Writes `sigma`, rounded up.
    ///
    /// # Errors
    /// As [`SigmaField::encode`].
    pub fn write(&self, writer: &mut BitWriter, sigma: f64) -> Result<(), PacketError> {
        let code = self.encode(sigma)?;
        self.write_code(writer, code)
    }

    /// Writes a code that [`SigmaField::encode`] gave.
    pub(super) fn write_code(&self, writer: &mut BitWriter, code: u32) -> Result<(), PacketError> {
        let last = self.check()?;
        writer.push(self.name, u64::from(code), self.bits)?;
        explain(|| Scale {
            unit: self.unit,
            minimum: self.decode(0),
            maximum: self.decode(last),
            step: FieldStep::Factor(f64::from(self.steps_per_octave).recip().exp2()),
            rounding: Rounding::Up,
        });
        Ok(())
    }

    /// Reads a sigma.
    ///
    /// # Errors
    /// [`PacketError::Truncated`] at the end of the packet, [`PacketError::Definition`].
    pub fn read(&self, reader: &mut BitReader) -> Result<f64, PacketError> {
        self.check()?;
        // At most 16 bits, so the conversion is exact.
        Ok(self.decode(reader.take(self.name, self.bits)? as u32))
    }
}

/// A correlation, plain or partial, rounded *toward zero*: ρ = tanh(code / steps_per_unit).
///
/// Equal steps of atanh ρ cost about the same information everywhere, near ±1 too; codes are −(2^(bits−1) − 1) to
/// 2^(bits−1) − 1, so |ρ| < 1 and what is decoded is always a proper correlation. Anything nearer to ±1 than the last
/// code becomes the last code: that is toward zero as well.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CorrelationField {
    /// What it holds, for errors.
    pub name: &'static str,
    /// Width, 2 to 16.
    pub bits: u32,
    /// Codes in one unit of atanh ρ, > 0.
    pub steps_per_unit: f64,
}

impl CorrelationField {
    fn check(&self) -> Result<i32, PacketError> {
        let definition = |quantity, value, minimum, maximum| {
            Err(PacketError::Definition { field: self.name, quantity, value, minimum, maximum })
        };
        if !(2..=16).contains(&self.bits) {
            return definition("width in bits", f64::from(self.bits), 2.0, 16.0);
        }
        let last = (1i32 << (self.bits - 1)) - 1;
        // tanh(x) is exactly 1 from about 19 on; a correlation of 1 is not a proper one.
        let least = f64::from(last) / 18.0;
        if !(self.steps_per_unit >= least && self.steps_per_unit.is_finite()) {
            return definition("steps per unit", self.steps_per_unit, least, f64::MAX);
        }
        Ok(last)
    }

    /// The code of the largest magnitude not above that of `correlation`, with its sign.
    ///
    /// # Errors
    /// [`PacketError::NotFinite`]; [`PacketError::OutOfRange`] outside −1 to 1; [`PacketError::Definition`].
    pub fn encode(&self, correlation: f64) -> Result<i32, PacketError> {
        let last = self.check()?;
        finite(self.name, correlation)?;
        let magnitude = correlation.abs();
        if magnitude > 1.0 {
            return Err(PacketError::OutOfRange {
                field: self.name,
                unit: "",
                value: correlation,
                minimum: -1.0,
                maximum: 1.0,
            });
        }
        // atanh(1) is infinite, and the conversion saturates. As for sigmas, an ulp is settled by `decode`.
        let mut code = ((magnitude.atanh() * self.steps_per_unit).floor() as i32).clamp(0, last);
        if code < last && self.decode(code + 1) <= magnitude {
            code += 1;
        }
        if self.decode(code) > magnitude {
            code -= 1;
        }
        Ok(if correlation < 0.0 { -code } else { code })
    }

    /// The correlation of a code.
    #[must_use]
    pub fn decode(&self, code: i32) -> f64 {
        (f64::from(code) / self.steps_per_unit).tanh()
    }

    /// Writes `correlation`, rounded toward zero.
    ///
    /// # Errors
    /// As [`CorrelationField::encode`].
    pub fn write(&self, writer: &mut BitWriter, correlation: f64) -> Result<(), PacketError> {
        let code = self.encode(correlation)?;
        self.write_code(writer, code)
    }

    /// Writes a code that [`CorrelationField::encode`] gave.
    pub(super) fn write_code(&self, writer: &mut BitWriter, code: i32) -> Result<(), PacketError> {
        let last = self.check()?;
        writer.push(self.name, i64::from(code) as u64 & mask(self.name, self.bits)?, self.bits)?;
        explain(|| Scale {
            unit: "",
            minimum: self.decode(-last),
            maximum: self.decode(last),
            step: FieldStep::Atanh(self.steps_per_unit.recip()),
            rounding: Rounding::TowardZero,
        });
        Ok(())
    }

    /// Reads a correlation.
    ///
    /// # Errors
    /// [`PacketError::InvalidCode`] for −2^(bits−1), which no sender writes; [`PacketError::Truncated`] at the end of
    /// the packet; [`PacketError::Definition`].
    pub fn read(&self, reader: &mut BitReader) -> Result<f64, PacketError> {
        let last = self.check()?;
        let raw = reader.take(self.name, self.bits)?;
        // At most 16 bits, so the conversion is exact.
        let code = sign_extend(raw, self.bits) as i32;
        if code < -last {
            return Err(PacketError::InvalidCode { field: self.name, code: raw });
        }
        Ok(self.decode(code))
    }
}
