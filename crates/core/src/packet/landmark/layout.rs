//! Widths and scales of each size, and the bits of a packet.

use std::f64::consts::{PI, TAU};

use nalgebra::SVector;

use super::correlation::split;
use super::{ExchangeFormat, ExchangePacket, ExchangeSize, floored};
use crate::mixture::Mode;
use crate::packet::field::sign_extend;
use crate::packet::{BitWriter, PacketError, UnsignedField};

pub(super) const TYPE: UnsignedField = UnsignedField { name: "exchange type", bits: 3 };
pub(super) const SEQUENCE: UnsignedField = UnsignedField { name: "exchange sequence", bits: 4 };
pub(super) const MODES: UnsignedField = UnsignedField { name: "exchange modes less one", bits: 2 };
pub(super) const SHARE: UnsignedField = UnsignedField { name: "share of a mode", bits: 8 };
pub(super) const SHARE_STEPS: f64 = 256.0;
pub(super) const DIFFERENCE_BITS: u32 = 12;
pub(super) const NAMES: [&str; 6] =
    ["landmark x", "landmark y", "landmark yaw", "distance to mover", "bearing of mover", "relative yaw"];
pub(super) const SIGMA_NAMES: [&str; 6] = [
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
pub(super) const CLASS_SIGMA: [f64; 6] = [0.15, 0.15, 0.35 * DEGREE, 0.075, 0.15 * DEGREE, 0.5 * DEGREE];

/// How standard deviations are written.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Sigmas {
    /// One class for all six; true: the least that covers them, false: nearest to the geometric mean.
    Class { cover: bool },
    /// Six codes of (bits, steps per octave): σ = base · 2^(q / steps).
    Each { codes: [(u32, f64); 6], base_m: f64, base_rad: f64, up: bool },
}

/// One size of one format.
pub struct Layout {
    pub(super) size: ExchangeSize,
    pub(super) sequence: bool,
    /// Positions modulo 2^bits steps, to be resolved by the receiver.
    pub(super) modulo: bool,
    pub(super) bits: [u32; 6],
    pub(super) steps_per_m: [f64; 2],
    pub(super) sigmas: Sigmas,
    /// Width and scale of each correlation: z = tanh(q / scale).
    pub(super) correlations: Option<[(u32, f64); 15]>,
    /// Whether the receiver adds the variance of rounding the mean.
    pub(super) rounding: bool,
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
    pub(super) fn step(&self, k: usize) -> f64 {
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

    pub(super) fn write_to(
        &self,
        packet: &ExchangePacket,
        writer: &mut BitWriter,
    ) -> Result<(), PacketError> {
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
