//! The bits of an exchange packet, read.

use nalgebra::{SMatrix, SVector};

use super::ExchangePacket;
use super::correlation::join;
use super::layout::{
    ANGLES, CLASS_SIGMA, DIFFERENCE_BITS, Layout, MODES, NAMES, SEQUENCE, SHARE, SHARE_STEPS, SIGMA_NAMES,
    Sigmas, TYPE,
};
use crate::mixture::Mode;
use crate::packet::field::sign_extend;
use crate::packet::{BitReader, PacketError};

impl Layout {
    /// Reads the packet; up to `spare_bits` and the rest of the bytes may follow.
    pub fn read(
        &self,
        bytes: &[u8],
        spare_bits: usize,
        landmark_m: [f64; 2],
    ) -> Result<ExchangePacket, PacketError> {
        let mut reader = BitReader::new(bytes);
        let code = TYPE.read(&mut reader)?;
        if code != self.size.code() {
            return Err(PacketError::InvalidCode { field: TYPE.name, code });
        }
        // Four bits.
        let sequence = if self.sequence { Some(SEQUENCE.read(&mut reader)? as u8) } else { None };
        let count = if self.size.modes() > 1 { MODES.read(&mut reader)? as usize + 1 } else { 1 };
        if count > self.size.modes() {
            return Err(PacketError::InvalidCode { field: MODES.name, code: count as u64 - 1 });
        }
        let mut first = [0; 6];
        for (k, code) in first.iter_mut().enumerate() {
            *code = self.read_code(&mut reader, k, landmark_m)?;
        }
        let mut modes = vec![Mode {
            weight: 0.0,
            mean: self.mean(first),
            covariance: self.read_covariance(&mut reader)?,
        }];
        for _ in 1..count {
            let mut codes = first;
            for (k, code) in codes.iter_mut().enumerate() {
                *code += sign_extend(reader.take(NAMES[k], DIFFERENCE_BITS)?, DIFFERENCE_BITS);
            }
            let share = SHARE.read(&mut reader)?;
            let covariance = self.read_covariance(&mut reader)?;
            modes.push(Mode { weight: share as f64 / SHARE_STEPS, mean: self.mean(codes), covariance });
        }
        let others: f64 = modes.iter().map(|m| m.weight).sum();
        modes[0].weight = 1.0 - others;
        if modes.iter().any(|m| m.weight <= 0.0) {
            return Err(PacketError::InvalidCode { field: SHARE.name, code: 0 });
        }
        if spare_bits == 0 {
            zeros(reader)?;
        }
        Ok(ExchangePacket { sequence, modes })
    }

    fn read_code(&self, reader: &mut BitReader, k: usize, landmark_m: [f64; 2]) -> Result<i64, PacketError> {
        let raw = reader.take(NAMES[k], self.bits[k])?;
        if self.modulo && k < 2 {
            let near = (landmark_m[k] / self.step(k)).round();
            let near = if near.is_finite() { near as i64 } else { 0 };
            // The code of this residue nearest to where the receiver takes the landmark to be.
            return Ok(near + sign_extend((raw as i64 - near) as u64, self.bits[k]));
        }
        Ok(if k == 3 { raw as i64 } else { sign_extend(raw, self.bits[k]) })
    }

    fn mean(&self, codes: [i64; 6]) -> SVector<f64, 6> {
        SVector::from_fn(|k, _| {
            let code = if ANGLES[k] { sign_extend(codes[k] as u64, self.bits[k]) } else { codes[k] };
            code as f64 * self.step(k)
        })
    }

    fn read_covariance(&self, reader: &mut BitReader) -> Result<SMatrix<f64, 6, 6>, PacketError> {
        let mut sigma = SVector::<f64, 6>::zeros();
        match self.sigmas {
            Sigmas::Class { .. } => {
                let scale = (reader.take("class of sigmas", 2)? as f64).exp2();
                sigma = SVector::from_fn(|k, _| CLASS_SIGMA[k] * scale);
            }
            Sigmas::Each { codes, base_m, base_rad, .. } => {
                for (k, (bits, per_octave)) in codes.into_iter().enumerate() {
                    let base = if ANGLES[k] { base_rad } else { base_m };
                    sigma[k] = base * (reader.take(SIGMA_NAMES[k], bits)? as f64 / per_octave).exp2();
                }
            }
        }
        let mut partial = [0.0; 15];
        if let Some(codes) = self.correlations {
            for (z, (bits, scale)) in partial.iter_mut().zip(codes) {
                *z = (sign_extend(reader.take("partial correlation", bits)?, bits) as f64 / scale).tanh();
            }
        }
        let mut covariance = join(&sigma, &partial);
        if self.rounding {
            for k in 0..6 {
                covariance[(k, k)] += self.step(k) * self.step(k) / 12.0;
            }
        }
        Ok(covariance)
    }
}

/// Refuses anything but zeros.
fn zeros(mut reader: BitReader) -> Result<(), PacketError> {
    let left_bits = reader.left_bits();
    while reader.left_bits() > 0 {
        let value = reader.take("padding", reader.left_bits().min(64) as u32)?;
        if value != 0 {
            return Err(PacketError::Padding { left_bits, value });
        }
    }
    Ok(())
}
