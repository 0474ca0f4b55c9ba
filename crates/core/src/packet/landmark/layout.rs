//! Widths and scales of each size, and the bits of a packet.

use std::f64::consts::{PI, TAU};

use crc::{CRC_8_SMBUS, Crc};
use nalgebra::{SMatrix, SVector};

use super::correlation::{join, split};
use super::{ExchangeFormat, ExchangePacket, ExchangeSize, floored};
use crate::mixture::Mode;
use crate::packet::field::sign_extend;
use crate::packet::{BitReader, BitWriter, PacketError, UnsignedField, implied_bytes};

const CRC_8: Crc<u8> = Crc::<u8>::new(&CRC_8_SMBUS);
const TYPE: UnsignedField = UnsignedField { name: "exchange type", bits: 3 };
const SEQUENCE: UnsignedField = UnsignedField { name: "exchange sequence", bits: 4 };
const MODES: UnsignedField = UnsignedField { name: "exchange modes less one", bits: 2 };
const SHARE: UnsignedField = UnsignedField { name: "share of a mode", bits: 8 };
const SHARE_STEPS: f64 = 256.0;
const DIFFERENCE_BITS: u32 = 12;
const NAMES: [&str; 6] =
    ["landmark x", "landmark y", "landmark yaw", "distance to mover", "bearing of mover", "relative yaw"];
const SIGMA_NAMES: [&str; 6] = [
    "sigma of landmark x",
    "sigma of landmark y",
    "sigma of landmark yaw",
    "sigma of distance",
    "sigma of bearing",
    "sigma of relative yaw",
];
const UNITS: [&str; 6] = ["m", "m", "rad", "m", "rad", "rad"];
/// Which coordinates are angles.
pub const ANGLES: [bool; 6] = [false, false, true, false, true, true];
const DEGREE: f64 = PI / 180.0;
/// σ of class 0 in 8 bytes.
const CLASS_SIGMA: [f64; 6] = [0.15, 0.15, 0.35 * DEGREE, 0.075, 0.15 * DEGREE, 0.5 * DEGREE];

/// How standard deviations are written.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Sigmas {
    /// One class for all six; true: the least that covers them, false: nearest to the geometric mean.
    Class { cover: bool },
    /// Six codes of (bits, steps per octave): σ = base · 2^(q / steps).
    Each { codes: [(u32, f64); 6], base_m: f64, base_rad: f64, up: bool },
}

/// One size of one format.
pub struct Layout {
    size: ExchangeSize,
    sequence: bool,
    /// Positions modulo 2^bits steps, to be resolved by the receiver.
    modulo: bool,
    bits: [u32; 6],
    steps_per_m: [f64; 2],
    sigmas: Sigmas,
    /// Width and scale of each correlation: z = tanh(q / scale).
    correlations: Option<[(u32, f64); 15]>,
    /// Whether the receiver adds the variance of rounding the mean.
    rounding: bool,
}

impl Layout {
    /// The layout of a size.
    pub fn of(format: ExchangeFormat, size: ExchangeSize) -> Result<Self, PacketError> {
        let two = format == ExchangeFormat::Two;
        let each = |codes| Sigmas::Each { codes, base_m: 0.0005, base_rad: DEGREE / 256.0, up: false };
        let first = Self {
            size,
            sequence: true,
            modulo: false,
            bits: [18, 18, 12, 13, 12, 12],
            steps_per_m: [64.0, 64.0],
            sigmas: each([(7, 8.0); 6]),
            correlations: Some([(7, 16.0); 15]),
            rounding: false,
        };
        // What grows by a few percent an exchange needs the finer steps: rounded to the nearest of coarse ones, it
        // would stand still.
        let standard = if two {
            Self {
                bits: [17, 17, 12, 12, 13, 12],
                steps_per_m: [32.0, 32.0],
                sigmas: each([(9, 32.0), (9, 32.0), (9, 32.0), (7, 8.0), (7, 8.0), (7, 8.0)]),
                correlations: Some(widths((9, 64.0), (7, 16.0), (6, 8.0))),
                rounding: true,
                ..first
            }
        } else {
            first
        };
        let coarse =
            Sigmas::Each { codes: [(4, 4.0 / 3.0); 6], base_m: 0.01, base_rad: 0.02 * DEGREE, up: true };
        Ok(match (size, two) {
            (ExchangeSize::B8, false) => Self {
                sequence: false,
                modulo: true,
                bits: [9, 9, 10, 10, 11, 10],
                steps_per_m: [16.0, 16.0],
                sigmas: Sigmas::Class { cover: false },
                correlations: None,
                rounding: true,
                ..standard
            },
            (ExchangeSize::B8, true) => Self {
                sequence: false,
                modulo: true,
                bits: [8, 8, 9, 9, 9, 8],
                steps_per_m: [8.0, 8.0],
                sigmas: Sigmas::Class { cover: true },
                correlations: None,
                ..standard
            },
            (ExchangeSize::B16, false) => {
                Self { sigmas: each([(6, 4.0); 6]), correlations: None, ..standard }
            }
            (ExchangeSize::B16, true) => Self {
                bits: [18, 18, 12, 12, 11, 10],
                steps_per_m: [64.0, 32.0],
                sigmas: coarse,
                correlations: None,
                ..standard
            },
            (ExchangeSize::B40, true) => Self {
                bits: [20, 20, 16, 14, 16, 16],
                steps_per_m: [64.0, 64.0],
                sigmas: each([(9, 32.0); 6]),
                correlations: Some([(9, 64.0); 15]),
                ..standard
            },
            (ExchangeSize::B40, false) => return Err(PacketError::Length { bytes: 40, expected: 32 }),
            (ExchangeSize::B32 | ExchangeSize::B64 | ExchangeSize::B128, _) => standard,
        })
    }

    /// One step of coordinate k.
    fn step(&self, k: usize) -> f64 {
        match k {
            0 | 1 => 1.0 / self.steps_per_m[0],
            3 => 1.0 / self.steps_per_m[1],
            _ => TAU / f64::from(self.bits[k]).exp2(),
        }
    }

    /// All bits before the check.
    pub fn write(&self, packet: &ExchangePacket) -> Result<BitWriter, PacketError> {
        let mut writer = BitWriter::with_capacity(self.size.bytes());
        self.write_to(packet, &mut writer)?;
        Ok(writer)
    }

    fn write_to(&self, packet: &ExchangePacket, writer: &mut BitWriter) -> Result<(), PacketError> {
        let count = packet.modes.len();
        if !(1..=self.size.modes()).contains(&count) {
            let maximum = self.size.modes() as f64;
            return out_of_range("number of modes", "", count as f64, 1.0, maximum);
        }
        TYPE.write(writer, self.size.code())?;
        if self.sequence {
            SEQUENCE.write(writer, u64::from(packet.sequence.unwrap_or(0) & 15))?;
        }
        if self.size.modes() > 1 {
            MODES.write(writer, count as u64 - 1)?;
        }
        let first = self.mean_codes(&packet.modes[0])?;
        for (k, code) in first.iter().enumerate() {
            self.write_code(writer, k, *code)?;
        }
        self.write_covariance(writer, &packet.modes[0])?;
        for mode in &packet.modes[1..] {
            let codes = self.mean_codes(mode)?;
            for k in 0..6 {
                let mut difference = codes[k] - first[k];
                if ANGLES[k] {
                    difference = sign_extend(difference as u64, self.bits[k]);
                }
                let limit = 1i64 << (DIFFERENCE_BITS - 1);
                if !(-limit..limit).contains(&difference) {
                    let far = limit as f64 * self.step(k);
                    return out_of_range(NAMES[k], UNITS[k], mode.mean[k], -far, far);
                }
                writer.push(NAMES[k], difference as u64 & mask(DIFFERENCE_BITS), DIFFERENCE_BITS)?;
            }
            if !(mode.weight > 0.0 && mode.weight < 1.0) {
                return out_of_range("share of a mode", "", mode.weight, 0.0, 1.0);
            }
            SHARE.write(writer, (mode.weight * SHARE_STEPS).round().clamp(1.0, SHARE_STEPS - 1.0) as u64)?;
            self.write_covariance(writer, mode)?;
        }
        Ok(())
    }

    /// The mean in steps, checked against what the first mode's fields hold.
    fn mean_codes(&self, mode: &Mode<6>) -> Result<[i64; 6], PacketError> {
        let mut codes = [0; 6];
        for k in 0..6 {
            let value = mode.mean[k];
            if !value.is_finite() {
                return Err(PacketError::NotFinite { field: NAMES[k], value });
            }
            let steps = (value / self.step(k)).round();
            let bounded = k == 3 || (k < 2 && !self.modulo);
            if bounded {
                let (low, high) = if k < 2 {
                    let half = f64::from(self.bits[k] - 1).exp2();
                    (-half, half - 1.0)
                } else {
                    (0.0, f64::from(self.bits[k]).exp2() - 1.0)
                };
                if !(low..=high).contains(&steps) {
                    return out_of_range(NAMES[k], "m", value, low * self.step(k), high * self.step(k));
                }
            }
            codes[k] = if ANGLES[k] { sign_extend(steps as i64 as u64, self.bits[k]) } else { steps as i64 };
        }
        Ok(codes)
    }

    fn write_code(&self, writer: &mut BitWriter, k: usize, code: i64) -> Result<(), PacketError> {
        writer.push(NAMES[k], code as u64 & mask(self.bits[k]), self.bits[k])
    }

    fn write_covariance(&self, writer: &mut BitWriter, mode: &Mode<6>) -> Result<(), PacketError> {
        let (base_m, base_rad) = match self.sigmas {
            Sigmas::Each { base_m, base_rad, .. } => (base_m, base_rad),
            Sigmas::Class { .. } => (1e-6, 1e-6),
        };
        let floor = SVector::<f64, 6>::from_fn(|k, _| if ANGLES[k] { base_rad } else { base_m });
        let covariance = floored(&mode.covariance, &floor);
        let (sigma, partial) =
            split(&covariance).ok_or(PacketError::NotDefinite { field: "covariance of an exchange" })?;
        match self.sigmas {
            Sigmas::Class { cover } => write_class(writer, &sigma, cover)?,
            Sigmas::Each { codes, up, .. } => {
                for (k, (bits, per_octave)) in codes.into_iter().enumerate() {
                    let octaves = per_octave * (sigma[k] / floor[k]).log2();
                    // Up to a thousandth of a step is rounding of the floor, not of the value.
                    let code = if up { (octaves - 1e-3).ceil() } else { octaves.round() }.max(0.0);
                    let most = f64::from(bits).exp2() - 1.0;
                    if code > most {
                        let maximum = floor[k] * (most / per_octave).exp2();
                        return out_of_range(SIGMA_NAMES[k], UNITS[k], sigma[k], floor[k], maximum);
                    }
                    writer.push(SIGMA_NAMES[k], code as u64, bits)?;
                }
            }
        }
        if let Some(codes) = self.correlations {
            for (z, (bits, scale)) in partial.into_iter().zip(codes) {
                let most = f64::from(bits - 1).exp2() - 1.0;
                // Beyond the last code a correlation is understated, which claims less.
                let code = (scale * z.clamp(-1.0, 1.0).atanh()).round().clamp(-most, most) as i64;
                writer.push("partial correlation", code as u64 & mask(bits), bits)?;
            }
        }
        Ok(())
    }

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

/// Widths of the fifteen correlations: within (x_L, y_L, ψ_L), within (ρ, β, γ), between the two.
fn widths(landmark: (u32, f64), relative: (u32, f64), between: (u32, f64)) -> [(u32, f64); 15] {
    let mut all = [between; 15];
    let mut at = 0;
    for row in 1..6 {
        for column in 0..row {
            if row < 3 {
                all[at] = landmark;
            } else if column > 2 {
                all[at] = relative;
            }
            at += 1;
        }
    }
    all
}

fn write_class(writer: &mut BitWriter, sigma: &SVector<f64, 6>, cover: bool) -> Result<(), PacketError> {
    let octaves: [f64; 6] = std::array::from_fn(|k| (sigma[k] / CLASS_SIGMA[k]).log2());
    let class = if cover {
        octaves.iter().copied().fold(f64::NEG_INFINITY, f64::max).ceil()
    } else {
        (octaves.iter().sum::<f64>() / 6.0).round()
    }
    .max(0.0);
    if class > 3.0 {
        let worst = (0..6).max_by(|a, b| octaves[*a].total_cmp(&octaves[*b])).unwrap_or(0);
        let maximum = 8.0 * CLASS_SIGMA[worst];
        return out_of_range(SIGMA_NAMES[worst], UNITS[worst], sigma[worst], 0.0, maximum);
    }
    writer.push("class of sigmas", class as u64, 2)
}

fn out_of_range<T>(
    field: &'static str,
    unit: &'static str,
    value: f64,
    minimum: f64,
    maximum: f64,
) -> Result<T, PacketError> {
    Err(PacketError::OutOfRange { field, unit, value, minimum, maximum })
}

fn mask(bits: u32) -> u64 {
    (1u64 << bits) - 1
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

/// CRC-8 over payload and implied fields.
pub fn check_8(payload: &[u8], sender: u16, tol_ns: i64) -> u8 {
    let mut digest = CRC_8.digest();
    digest.update(payload);
    digest.update(&implied_bytes(sender, tol_ns));
    digest.finalize()
}

/// Checks the CRC-8 at the end.
pub fn compare_8(bytes: &[u8], sender: u16, tol_ns: i64) -> Result<(), PacketError> {
    let Some((received, payload)) = bytes.split_last() else {
        return Err(PacketError::Length { bytes: 0, expected: 8 });
    };
    let computed = check_8(payload, sender, tol_ns);
    if computed == *received {
        return Ok(());
    }
    Err(PacketError::Checksum { received: u16::from(*received), computed: u16::from(computed) })
}

/// Payload and the big-endian check at its end.
pub fn split_tail(bytes: &[u8]) -> Result<(&[u8], u16), PacketError> {
    let Some((payload, tail)) = bytes.split_last_chunk::<2>() else {
        return Err(PacketError::Length { bytes: bytes.len(), expected: 2 });
    };
    Ok((payload, u16::from_be_bytes(*tail)))
}

/// Bits of format 1 in 32 bytes before the check.
const SHIFTED_BITS: usize = 239;

/// Format 1 in 32 bytes: 239 bits, the CRC-16 of those bits set flush right in 30 bytes, one zero bit.
pub fn finish_shifted(packet: &ExchangePacket, layout: &Layout) -> Result<Vec<u8>, PacketError> {
    let mut flush_right = BitWriter::with_capacity(30);
    flush_right.push("lead", 0, 1)?;
    layout.write_to(packet, &mut flush_right)?;
    let crc = crate::packet::CRC.checksum(&flush_right.finish());
    let mut writer = layout.write(packet)?;
    writer.push("checksum", u64::from(crc), 16)?;
    Ok(writer.finish())
}

/// Checks what [`finish_shifted`] wrote.
pub fn compare_shifted(bytes: &[u8]) -> Result<(), PacketError> {
    let mut reader = BitReader::new(bytes);
    let mut flush_right = BitWriter::with_capacity(30);
    flush_right.push("lead", 0, 1)?;
    let mut left = SHIFTED_BITS;
    while left > 0 {
        let take = left.min(48) as u32;
        flush_right.push("payload", reader.take("payload", take)?, take)?;
        left -= take as usize;
    }
    let computed = crate::packet::CRC.checksum(&flush_right.finish());
    // Sixteen bits.
    let received = reader.take("checksum", 16)? as u16;
    if received != computed {
        return Err(PacketError::Checksum { received, computed });
    }
    reader.finish()
}
