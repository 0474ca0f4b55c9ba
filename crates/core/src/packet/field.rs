//! One value each: what a field can hold, and how it is rounded.
//!
//! Fields are plain constants, so that a packet's layout reads as a list. Each has `encode` (value to code, with every
//! check), `decode` (code to value), and `write`/`read` that move the code through a [`BitWriter`] or [`BitReader`].

use super::bits::mask;
use super::layout::{FieldStep, Scale, explain};
use super::{BitReader, BitWriter, PacketError};
use std::f64::consts::TAU;

/// Widest scaled field, bits: every code is then an exact `f64`.
const SCALED_BITS_MAX: u32 = 52;

/// Which neighbouring step stands for a value between two steps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rounding {
    /// The nearer one, at most half a step away; ties away from zero.
    Nearest,
    /// The larger one: for what may be overstated only.
    Up,
    /// The smaller one: for what may be understated only.
    Down,
    /// The one nearer to zero.
    TowardZero,
}

impl Rounding {
    fn apply(self, steps: f64) -> f64 {
        match self {
            Self::Nearest => steps.round(),
            Self::Up => steps.ceil(),
            Self::Down => steps.floor(),
            Self::TowardZero => steps.trunc(),
        }
    }
}

/// An unsigned integer, 0 to 2^bits − 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UnsignedField {
    /// What it holds, for errors.
    pub name: &'static str,
    /// Width, 0 to 64.
    pub bits: u32,
}

impl UnsignedField {
    /// Writes `value`.
    ///
    /// # Errors
    /// [`PacketError::TooManyBits`] above 2^bits − 1, [`PacketError::Definition`] for a width above 64.
    pub fn write(&self, writer: &mut BitWriter, value: u64) -> Result<(), PacketError> {
        writer.push(self.name, value, self.bits)
    }

    /// Reads a value.
    ///
    /// # Errors
    /// [`PacketError::Truncated`] at the end of the packet, [`PacketError::Definition`] for a width above 64.
    pub fn read(&self, reader: &mut BitReader) -> Result<u64, PacketError> {
        reader.take(self.name, self.bits)
    }
}

/// A number in whole steps of `1 / steps_per_unit`, from 0 (unsigned) or on both sides of it (two's complement).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FixedField {
    /// What it holds, for errors.
    pub name: &'static str,
    /// Unit of the value.
    pub unit: &'static str,
    /// Width, 1 to 52.
    pub bits: u32,
    /// Steps in one unit (an integer keeps decimal steps such as 0.1 exact), > 0.
    pub steps_per_unit: f64,
    /// Whether negative values fit: −2^(bits−1) to 2^(bits−1) − 1 steps in place of 0 to 2^bits − 1.
    pub signed: bool,
    /// Which step stands for a value between two.
    pub rounding: Rounding,
}

impl FixedField {
    /// Smallest and largest code.
    fn bounds(&self) -> Result<(i64, i64), PacketError> {
        width(self.name, self.bits, SCALED_BITS_MAX)?;
        if !(self.steps_per_unit > 0.0 && self.steps_per_unit.is_finite()) {
            return Err(PacketError::Definition {
                field: self.name,
                quantity: "steps per unit",
                value: self.steps_per_unit,
                minimum: f64::MIN_POSITIVE,
                maximum: f64::MAX,
            });
        }
        let (minimum, magnitude) =
            if self.signed { (-(1 << (self.bits - 1)), self.bits - 1) } else { (0, self.bits) };
        Ok((minimum, (1 << magnitude) - 1))
    }

    /// The number of steps that stands for `value`.
    ///
    /// # Errors
    /// [`PacketError::NotFinite`]; [`PacketError::OutOfRange`] when it rounds to a step that the field does not have
    /// (a value within the rounding of the last step fits); [`PacketError::Definition`].
    pub fn encode(&self, value: f64) -> Result<i64, PacketError> {
        let (minimum, maximum) = self.bounds()?;
        finite(self.name, value)?;
        let steps = self.rounding.apply(value * self.steps_per_unit);
        // Codes have at most 52 bits, so both conversions are exact.
        if steps < minimum as f64 || steps > maximum as f64 {
            return Err(PacketError::OutOfRange {
                field: self.name,
                unit: self.unit,
                value,
                minimum: self.decode(minimum),
                maximum: self.decode(maximum),
            });
        }
        Ok(steps as i64)
    }

    /// The value of a number of steps.
    #[must_use]
    pub fn decode(&self, steps: i64) -> f64 {
        steps as f64 / self.steps_per_unit
    }

    /// Writes `value`.
    ///
    /// # Errors
    /// As [`FixedField::encode`].
    pub fn write(&self, writer: &mut BitWriter, value: f64) -> Result<(), PacketError> {
        let steps = self.encode(value)?;
        let (minimum, maximum) = self.bounds()?;
        writer.push(self.name, steps as u64 & mask(self.name, self.bits)?, self.bits)?;
        explain(|| Scale {
            unit: self.unit,
            minimum: self.decode(minimum),
            maximum: self.decode(maximum),
            step: FieldStep::Linear(self.steps_per_unit.recip()),
            rounding: self.rounding,
        });
        Ok(())
    }

    /// Reads a value.
    ///
    /// # Errors
    /// [`PacketError::Truncated`] at the end of the packet, [`PacketError::Definition`].
    pub fn read(&self, reader: &mut BitReader) -> Result<f64, PacketError> {
        self.bounds()?;
        let code = reader.take(self.name, self.bits)?;
        let steps = if self.signed { sign_extend(code, self.bits) } else { code as i64 };
        Ok(self.decode(steps))
    }
}

/// A counter of which only the low bits travel; the receiver finds the rest from what it knows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ModuloField {
    /// What it holds, for errors.
    pub name: &'static str,
    /// Width, 1 to 63.
    pub bits: u32,
}

impl ModuloField {
    /// The part that travels: `counter` modulo 2^bits.
    ///
    /// # Errors
    /// [`PacketError::Definition`] for a width outside 1 to 63.
    pub fn residue(&self, counter: u64) -> Result<u64, PacketError> {
        width(self.name, self.bits, 63)?;
        Ok(counter & mask(self.name, self.bits)?)
    }

    /// The counter nearest to `reference` that has this residue: from 2^(bits−1) below to 2^(bits−1) − 1 above it.
    /// Where that would leave the range of a counter (below 0, above `u64::MAX`), the next one inside.
    ///
    /// # Errors
    /// [`PacketError::InvalidCode`] for a residue of more than `bits` bits; [`PacketError::Definition`].
    pub fn unwrap_near(&self, residue: u64, reference: u64) -> Result<u64, PacketError> {
        width(self.name, self.bits, 63)?;
        let low = mask(self.name, self.bits)?;
        if residue > low {
            return Err(PacketError::InvalidCode { field: self.name, code: residue });
        }
        let ahead = residue.wrapping_sub(reference) & low;
        let behind = (low - ahead) + 1;
        let (above, below) = (reference.checked_add(ahead), reference.checked_sub(behind));
        let nearest = if ahead < behind { above.or(below) } else { below.or(above) };
        nearest.ok_or(PacketError::InvalidCode { field: self.name, code: residue })
    }

    /// Writes `counter` modulo 2^bits.
    ///
    /// # Errors
    /// [`PacketError::Definition`].
    pub fn write(&self, writer: &mut BitWriter, counter: u64) -> Result<(), PacketError> {
        writer.push(self.name, self.residue(counter)?, self.bits)
    }

    /// Reads a residue, 0 to 2^bits − 1.
    ///
    /// # Errors
    /// [`PacketError::Truncated`] at the end of the packet, [`PacketError::Definition`].
    pub fn read(&self, reader: &mut BitReader) -> Result<u64, PacketError> {
        width(self.name, self.bits, 63)?;
        reader.take(self.name, self.bits)
    }
}

/// An angle in radians, wrapped to [−π, π), in 2^bits equal steps, nearest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AngleField {
    /// What it holds, for errors.
    pub name: &'static str,
    /// Width, 1 to 52.
    pub bits: u32,
}

impl AngleField {
    /// One step, rad.
    #[must_use]
    pub fn step_rad(&self) -> f64 {
        TAU / f64::from(self.bits).exp2()
    }

    /// Writes an angle of any number of turns.
    ///
    /// # Errors
    /// [`PacketError::NotFinite`], [`PacketError::Definition`].
    pub fn write(&self, writer: &mut BitWriter, angle_rad: f64) -> Result<(), PacketError> {
        width(self.name, self.bits, SCALED_BITS_MAX)?;
        finite(self.name, angle_rad)?;
        // 0 to 2^bits steps; the last one is a whole turn, which the mask takes to zero.
        let steps = (angle_rad.rem_euclid(TAU) / self.step_rad()).round();
        writer.push(self.name, steps as u64 & mask(self.name, self.bits)?, self.bits)?;
        explain(|| Scale {
            unit: "rad",
            minimum: -TAU / 2.0,
            maximum: TAU / 2.0 - self.step_rad(),
            step: FieldStep::Linear(self.step_rad()),
            rounding: Rounding::Nearest,
        });
        Ok(())
    }

    /// Reads an angle, −π to just below π.
    ///
    /// # Errors
    /// [`PacketError::Truncated`] at the end of the packet, [`PacketError::Definition`].
    pub fn read(&self, reader: &mut BitReader) -> Result<f64, PacketError> {
        width(self.name, self.bits, SCALED_BITS_MAX)?;
        let code = reader.take(self.name, self.bits)?;
        Ok(sign_extend(code, self.bits) as f64 * self.step_rad())
    }
}

/// A finite `f64` in its 64 bits, for packets of unlimited precision.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FloatField {
    /// What it holds, for errors.
    pub name: &'static str,
}

impl FloatField {
    /// Writes `value`.
    ///
    /// # Errors
    /// [`PacketError::NotFinite`].
    pub fn write(&self, writer: &mut BitWriter, value: f64) -> Result<(), PacketError> {
        finite(self.name, value)?;
        writer.push(self.name, value.to_bits(), 64)
    }

    /// Reads a value.
    ///
    /// # Errors
    /// [`PacketError::NotFinite`] for a pattern that is none, [`PacketError::Truncated`] at the end of the packet.
    pub fn read(&self, reader: &mut BitReader) -> Result<f64, PacketError> {
        let value = f64::from_bits(reader.take(self.name, 64)?);
        finite(self.name, value)?;
        Ok(value)
    }
}

pub(super) fn finite(field: &'static str, value: f64) -> Result<(), PacketError> {
    if value.is_finite() { Ok(()) } else { Err(PacketError::NotFinite { field, value }) }
}

pub(super) fn width(field: &'static str, bits: u32, most: u32) -> Result<(), PacketError> {
    if (1..=most).contains(&bits) {
        return Ok(());
    }
    Err(PacketError::Definition {
        field,
        quantity: "width in bits",
        value: f64::from(bits),
        minimum: 1.0,
        maximum: f64::from(most),
    })
}

/// The two's complement number in the low `bits` (1 to 64) of `code`.
pub(super) fn sign_extend(code: u64, bits: u32) -> i64 {
    let shift = 64u32.saturating_sub(bits).min(63);
    (code << shift) as i64 >> shift
}
