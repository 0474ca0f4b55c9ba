//! The sender's depth in ten bits: decimetres near the surface, a share of the depth in the deep sea.

use super::field::{Rounding, finite};
use super::layout::{FieldStep, Scale, explain};
use super::{BitReader, BitWriter, PacketError};

/// A depth below the surface, m, 0 to 13,004.8.
///
/// ```text
/// code          0 … 511      512 + 64 k + j, k = 0 … 7, j = 0 … 63
/// depth, m      code / 10    (64 + j) · 0.8 · 2^k
/// step, m       0.1          0.8 · 2^k: between 1/128 and 1/64 of the depth
/// ```
///
/// The steps follow the depth because what a slant range loses by them is the error of a difference of depths, and deep
/// vehicles are far apart. All values are whole decimetres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DepthField {
    /// What it holds, for errors.
    pub name: &'static str,
}

/// Codes of 0.1 m each.
const FINE: i64 = 512;
/// Codes of an octave below.
const OCTAVE: i64 = 64;
/// Decimetres between the codes of the first octave: it begins at 51.2 m.
const FIRST_STEP_DM: i64 = FINE / OCTAVE;
const OCTAVES: i64 = 8;
const STEPS_PER_M: f64 = 10.0;

impl DepthField {
    /// Width.
    pub const BITS: u32 = 10;
    /// Greatest depth.
    pub const DEEPEST_M: f64 = 13_004.8;

    /// Depth of a code, dm.
    fn decimetres(code: i64) -> i64 {
        if code < FINE {
            return code;
        }
        let (octave, place) = ((code - FINE) / OCTAVE, (code - FINE) % OCTAVE);
        ((OCTAVE + place) * FIRST_STEP_DM) << octave
    }

    /// The octave of a depth: none above 51.2 m.
    fn octave(decimetres: f64) -> Option<i64> {
        (0..OCTAVES).rev().find(|k| decimetres >= (FINE << k) as f64)
    }

    /// Distance between neighbouring codes at a depth, m.
    pub fn step_m(depth_m: f64) -> f64 {
        let step_dm = Self::octave(depth_m * STEPS_PER_M).map_or(1, |k| FIRST_STEP_DM << k);
        step_dm as f64 / STEPS_PER_M
    }

    /// The code of the nearest depth.
    ///
    /// # Errors
    /// [`PacketError::NotFinite`]; [`PacketError::OutOfRange`] for a depth that rounds to one that the field does not have.
    pub fn encode(&self, depth_m: f64) -> Result<i64, PacketError> {
        finite(self.name, depth_m)?;
        let decimetres = depth_m * STEPS_PER_M;
        let code = match Self::octave(decimetres) {
            None => decimetres.round(),
            // The last step of an octave rounds up to the first code of the next.
            Some(k) => {
                let step = (FIRST_STEP_DM << k) as f64;
                (FINE + k * OCTAVE - OCTAVE) as f64 + (decimetres / step).round()
            }
        };
        if !(0.0..(1u32 << Self::BITS) as f64).contains(&code) {
            let (minimum, maximum) = (0.0, Self::DEEPEST_M);
            return Err(PacketError::OutOfRange {
                field: self.name,
                unit: "m",
                value: depth_m,
                minimum,
                maximum,
            });
        }
        // Exact: a whole number below 1024.
        Ok(code as i64)
    }

    /// The depth of a code, m.
    pub fn decode(code: i64) -> f64 {
        Self::decimetres(code) as f64 / STEPS_PER_M
    }

    /// Writes a depth.
    ///
    /// # Errors
    /// As [`DepthField::encode`].
    pub fn write(&self, writer: &mut BitWriter, depth_m: f64) -> Result<(), PacketError> {
        let code = self.encode(depth_m)?;
        writer.push(self.name, code as u64, Self::BITS)?;
        explain(|| Scale {
            unit: "m",
            minimum: 0.0,
            maximum: Self::DEEPEST_M,
            step: FieldStep::Growing(STEPS_PER_M.recip()),
            rounding: Rounding::Nearest,
        });
        Ok(())
    }

    /// Reads a depth.
    ///
    /// # Errors
    /// [`PacketError::Truncated`] at the end of the packet.
    pub fn read(&self, reader: &mut BitReader) -> Result<f64, PacketError> {
        Ok(Self::decode(reader.take(self.name, Self::BITS)? as i64))
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests fail by panicking")]

    use super::*;

    const FIELD: DepthField = DepthField { name: "depth" };

    #[test]
    fn every_code_is_a_depth_and_every_depth_its_nearest_code() {
        let depths: Vec<f64> = (0..1024).map(DepthField::decode).collect();
        assert!(depths.windows(2).all(|pair| pair[0] < pair[1]));
        assert_eq!((depths[0], depths[511], depths[512]), (0.0, 51.1, 51.2));
        assert_eq!(depths[1023], DepthField::DEEPEST_M);
        for (code, depth) in depths.iter().enumerate() {
            assert_eq!(FIELD.encode(*depth).unwrap(), code as i64);
        }
        for k in 0..130_048 {
            let depth_m = f64::from(k) * 0.1 + 0.013;
            let carried = DepthField::decode(FIELD.encode(depth_m).unwrap());
            assert!((carried - depth_m).abs() <= 0.5 * DepthField::step_m(depth_m) + 1e-9, "{depth_m} m");
        }
    }

    #[test]
    fn what_no_code_holds_is_refused() {
        for depth_m in [-0.06, 13_060.0, 1e300, f64::NAN, f64::INFINITY] {
            assert!(FIELD.encode(depth_m).is_err(), "{depth_m}");
        }
        assert_eq!(FIELD.encode(-0.04).unwrap(), 0);
    }
}
