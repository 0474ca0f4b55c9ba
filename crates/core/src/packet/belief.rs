//! A position belief as a packet: mean and covariance, rounded so that it never claims more than was known.

use super::header::{Header, PacketKind, TEAM_MAX};
use super::{
    BitReader, BitWriter, CRC_BYTES, CorrelationField, FixedField, FloatField, PacketError, Rounding,
    SigmaField, append_crc, check_crc,
};
use nalgebra::{Matrix2, Vector2};
use serde::{Deserialize, Serialize};

/// Length of a packet of kind [`PacketKind::Belief`], checksum included, for any team of up to 16.
pub const BELIEF_BYTES: usize = (Header::bits(HEARD_BITS) as usize + 66).div_ceil(8) + CRC_BYTES;
/// Length of a packet of kind [`PacketKind::BeliefF64`], checksum included.
pub const BELIEF_F64_BYTES: usize = (Header::bits(HEARD_BITS) as usize + 5 * 64).div_ceil(8) + CRC_BYTES;

const HEARD_BITS: u32 = TEAM_MAX as u32;
const EAST: FixedField = coordinate("mean easting");
const NORTH: FixedField = coordinate("mean northing");
const SIGMA_E: SigmaField = sigma("sigma of easting");
const SIGMA_N: SigmaField = sigma("sigma of northing");
const CORRELATION: CorrelationField =
    CorrelationField { name: "correlation of easting and northing", bits: 10, steps_per_unit: 96.0 };
/// The mean of the packet is off by at most half a step per axis, so its error's outer product is at most this
/// times the identity, m².
const MEAN_ROUNDING_M2: f64 = 0.5 / (STEPS_PER_M * STEPS_PER_M);
const STEPS_PER_M: f64 = 16.0;
/// How many codes above the least possible one a sigma may go. One on both axes always suffices (the slack of 9 % in
/// variance that it opens is wider than a step of the correlation); where one axis alone suffices, that is tighter.
const SIGMA_BUMPS: u32 = 2;
/// How far rounding may take a computed covariance from symmetric and positive semi-definite, relative.
const ASYMMETRY: f64 = 1e-9;

const fn coordinate(name: &'static str) -> FixedField {
    FixedField {
        name,
        unit: "m",
        bits: 20,
        steps_per_unit: STEPS_PER_M,
        signed: true,
        rounding: Rounding::Nearest,
    }
}

const fn sigma(name: &'static str) -> SigmaField {
    SigmaField { name, unit: "m", bits: 8, steps_per_octave: 16, lowest_log2: -4 }
}

/// A Gaussian over a horizontal position.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Belief {
    /// Easting and northing in the team's local frame, m.
    pub mean_m: Vector2<f64>,
    /// Covariance, m²; symmetric positive semi-definite.
    pub covariance_m2: Matrix2<f64>,
}

/// A vehicle's position belief, as `dmpf` and `mpf` broadcast it.
///
/// The header's kind chooses the form. [`PacketKind::Belief`], [`BELIEF_BYTES`] = 15 bytes:
///
/// ```text
/// bit  0      4          12      22      38     58     78       86       94            104   120
///      | kind | sequence | depth | heard | e    | n    | σ_e    | σ_n    | correlation | CRC |
///      | 4    | 8        | 10    | 16    | 20   | 20   | 8      | 8      | 10          | 16  |
/// ```
///
/// | field | step | range | rounding |
/// |---|---|---|---|
/// | depth | 0.1 m, below 51.2 m at most 1/64 of it | 0 to 13,004.8 m | nearest |
/// | e, n | 1/16 m | −32,768 to 32,767.9375 m, two's complement | nearest |
/// | σ_e, σ_n | 1/16 octave (4.4 %) | 2⁻⁴ = 0.0625 m to 2^11.9375 ≈ 3,922 m | up |
/// | correlation | 1/96 in atanh ρ | ±tanh(511/96) = ±0.99995, two's complement | toward zero |
///
/// The decoded covariance minus the true one minus what rounding the mean can cost, (1/512 m²)·I, is positive
/// semi-definite: sigmas are raised, by at most two codes beyond rounding up, until that holds, and of all such codes
/// those with the smallest determinant are sent.
///
/// [`PacketKind::BeliefF64`], [`BELIEF_F64_BYTES`] = 47 bytes, for studies without a limit on bandwidth: after the
/// 38 bits of the header e, n, then the covariance's ee, en, nn as `f64`; two zero bits; CRC.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct BeliefPacket {
    /// Sequence, depth, acknowledgements, and which of the two forms.
    pub header: Header,
    /// What the sender believes about its own position at launch.
    pub belief: Belief,
}

impl BeliefPacket {
    /// The packet's bytes, checksum included, for the `sender` (index in the team) and launch time `tol_ns` of its slot.
    ///
    /// # Errors
    /// [`PacketError::NotFinite`], [`PacketError::OutOfRange`] naming the field that cannot hold its value,
    /// [`PacketError::NotCovariance`], [`PacketError::TooManyBits`]. Nothing is ever clipped.
    pub fn encode(&self, sender: u16, tol_ns: i64) -> Result<Vec<u8>, PacketError> {
        let mut writer = BitWriter::with_capacity(BELIEF_F64_BYTES);
        self.header.write(&mut writer, HEARD_BITS)?;
        self.belief.check()?;
        match self.header.kind {
            PacketKind::Belief => self.belief.write_rounded(&mut writer)?,
            PacketKind::BeliefF64 => self.belief.write_f64(&mut writer)?,
            other => return Err(not_a_belief(other)),
        }
        Ok(append_crc(writer.finish(), sender, tol_ns))
    }

    /// Reads a packet of either form that `sender` launched at `tol_ns`. Any bytes give a typed result.
    ///
    /// # Errors
    /// [`PacketError::Checksum`] for damaged bytes, another sender or another slot; [`PacketError::Length`],
    /// [`PacketError::InvalidCode`], [`PacketError::Padding`], [`PacketError::NotFinite`] and
    /// [`PacketError::NotCovariance`] for what a correct sender never sends.
    pub fn decode(bytes: &[u8], sender: u16, tol_ns: i64) -> Result<Self, PacketError> {
        let payload = check_crc(bytes, sender, tol_ns)?;
        let expected = match Header::peek_kind(payload)? {
            PacketKind::Belief => BELIEF_BYTES,
            PacketKind::BeliefF64 => BELIEF_F64_BYTES,
            other => return Err(not_a_belief(other)),
        };
        if bytes.len() != expected {
            return Err(PacketError::Length { bytes: bytes.len(), expected });
        }
        let mut reader = BitReader::new(payload);
        let header = Header::read(&mut reader, HEARD_BITS)?;
        let belief = match header.kind {
            PacketKind::Belief => Belief::read_rounded(&mut reader)?,
            PacketKind::BeliefF64 => Belief::read_f64(&mut reader)?,
            other => return Err(not_a_belief(other)),
        };
        reader.finish()?;
        Ok(Self { header, belief })
    }
}

fn not_a_belief(kind: PacketKind) -> PacketError {
    PacketError::InvalidCode { field: "packet kind", code: u64::from(kind.code()) }
}

impl Belief {
    /// Finite, symmetric and positive semi-definite, but for rounding.
    pub(super) fn check(&self) -> Result<(), PacketError> {
        let values = [
            (EAST.name, self.mean_m.x),
            (NORTH.name, self.mean_m.y),
            ("variance of easting", self.covariance_m2.m11),
            ("covariance of easting and northing", self.covariance_m2.m12),
            ("covariance of northing and easting", self.covariance_m2.m21),
            ("variance of northing", self.covariance_m2.m22),
        ];
        if let Some((field, value)) = values.into_iter().find(|(_, value)| !value.is_finite()) {
            return Err(PacketError::NotFinite { field, value });
        }
        let (ee, en, ne, nn) =
            (self.covariance_m2.m11, self.covariance_m2.m12, self.covariance_m2.m21, self.covariance_m2.m22);
        // The square roots are taken apart so that their product cannot overflow; of a negative number they are NaN.
        let scale = ee.sqrt() * nn.sqrt();
        let proper =
            (en - ne).abs() <= ASYMMETRY * scale && en.abs().max(ne.abs()) <= (1.0 + ASYMMETRY) * scale;
        if proper { Ok(()) } else { Err(PacketError::NotCovariance { ee, en, ne, nn }) }
    }

    pub(super) fn write_rounded(&self, writer: &mut BitWriter) -> Result<(), PacketError> {
        EAST.write(writer, self.mean_m.x)?;
        NORTH.write(writer, self.mean_m.y)?;
        let codes = CovarianceCodes::covering(&self.covariance_m2)?;
        SIGMA_E.write_code(writer, codes.sigma_e)?;
        SIGMA_N.write_code(writer, codes.sigma_n)?;
        CORRELATION.write_code(writer, codes.correlation)
    }

    pub(super) fn read_rounded(reader: &mut BitReader) -> Result<Self, PacketError> {
        let mean_m = Vector2::new(EAST.read(reader)?, NORTH.read(reader)?);
        let (sigma_e, sigma_n) = (SIGMA_E.read(reader)?, SIGMA_N.read(reader)?);
        let covariance_m2 = covariance(sigma_e, sigma_n, CORRELATION.read(reader)?);
        Ok(Self { mean_m, covariance_m2 })
    }

    fn write_f64(&self, writer: &mut BitWriter) -> Result<(), PacketError> {
        let covariance = &self.covariance_m2;
        let values = [self.mean_m.x, self.mean_m.y, covariance.m11, covariance.m12, covariance.m22];
        F64_FIELDS.iter().zip(values).try_for_each(|(field, value)| field.write(writer, value))
    }

    fn read_f64(reader: &mut BitReader) -> Result<Self, PacketError> {
        let mut values = [0.0; F64_FIELDS.len()];
        for (field, value) in F64_FIELDS.iter().zip(&mut values) {
            *value = field.read(reader)?;
        }
        let [east, north, ee, en, nn] = values;
        let belief = Self { mean_m: Vector2::new(east, north), covariance_m2: Matrix2::new(ee, en, en, nn) };
        belief.check()?;
        Ok(belief)
    }
}

const F64_FIELDS: [FloatField; 5] = [
    FloatField { name: EAST.name },
    FloatField { name: NORTH.name },
    FloatField { name: "variance of easting" },
    FloatField { name: "covariance of easting and northing" },
    FloatField { name: "variance of northing" },
];

/// The three codes that stand for a covariance.
#[derive(Debug, Clone, Copy, PartialEq)]
struct CovarianceCodes {
    sigma_e: u32,
    sigma_n: u32,
    correlation: i32,
}

impl CovarianceCodes {
    /// The tightest codes (smallest determinant) whose covariance is at least `truth` plus the mean's rounding.
    fn covering(truth: &Matrix2<f64>) -> Result<Self, PacketError> {
        let wanted = truth + Matrix2::identity() * MEAN_ROUNDING_M2;
        let (sigma_e, sigma_n) = (wanted.m11.sqrt(), wanted.m22.sqrt());
        let least = Self {
            sigma_e: SIGMA_E.encode(sigma_e)?,
            sigma_n: SIGMA_N.encode(sigma_n)?,
            correlation: CORRELATION.encode((wanted.m12 / (sigma_e * sigma_n)).clamp(-1.0, 1.0))?,
        };
        let mut best: Option<(f64, Self)> = None;
        for bump_e in 0..=SIGMA_BUMPS {
            for bump_n in 0..=SIGMA_BUMPS {
                let Some(candidate) =
                    least.raised(bump_e, bump_n).and_then(|codes| codes.toward_zero(&wanted))
                else {
                    continue;
                };
                let determinant = candidate.decode().determinant();
                if best.is_none_or(|(smallest, _)| determinant < smallest) {
                    best = Some((determinant, candidate));
                }
            }
        }
        // Only the end of the sigmas' range can leave none: name the one that has no room.
        let (field, value) = if sigma_e > sigma_n { (SIGMA_E, sigma_e) } else { (SIGMA_N, sigma_n) };
        best.map(|(_, codes)| codes).ok_or_else(|| PacketError::OutOfRange {
            field: field.name,
            unit: field.unit,
            value,
            minimum: 0.0,
            maximum: field.decode(last_code(&field)),
        })
    }

    /// Larger sigmas, or none where the field ends.
    fn raised(self, bump_e: u32, bump_n: u32) -> Option<Self> {
        let (sigma_e, sigma_n) = (self.sigma_e + bump_e, self.sigma_n + bump_n);
        let fits = sigma_e <= last_code(&SIGMA_E) && sigma_n <= last_code(&SIGMA_N);
        fits.then_some(Self { sigma_e, sigma_n, ..self })
    }

    /// These sigmas with the largest correlation, no larger than the true one, that covers `wanted`.
    ///
    /// With δ the excess of the variances, covering means |ρ̂ σ̂_e σ̂_n − wanted_en| ≤ √(δ_e δ_n): the largest code
    /// inside is either the rounded truth or the one below that bound (two, where the bound's own rounding bites).
    fn toward_zero(self, wanted: &Matrix2<f64>) -> Option<Self> {
        let (sigma_e, sigma_n) = (SIGMA_E.decode(self.sigma_e), SIGMA_N.decode(self.sigma_n));
        let excess = (sigma_e * sigma_e - wanted.m11).max(0.0) * (sigma_n * sigma_n - wanted.m22).max(0.0);
        let bound = (wanted.m12.abs() + excess.sqrt()) / (sigma_e * sigma_n);
        let most = CORRELATION.encode(bound.min(1.0)).ok()?.min(self.correlation.abs());
        [most, most - 1]
            .into_iter()
            .filter(|magnitude| *magnitude >= 0)
            .map(|magnitude| Self { correlation: self.correlation.signum() * magnitude, ..self })
            .find(|codes| is_positive_semi_definite(&(codes.decode() - wanted)))
    }

    fn decode(self) -> Matrix2<f64> {
        covariance(
            SIGMA_E.decode(self.sigma_e),
            SIGMA_N.decode(self.sigma_n),
            CORRELATION.decode(self.correlation),
        )
    }
}

fn last_code(field: &SigmaField) -> u32 {
    (1 << field.bits) - 1
}

fn covariance(sigma_e: f64, sigma_n: f64, correlation: f64) -> Matrix2<f64> {
    let cross = correlation * sigma_e * sigma_n;
    Matrix2::new(sigma_e * sigma_e, cross, cross, sigma_n * sigma_n)
}

fn is_positive_semi_definite(matrix: &Matrix2<f64>) -> bool {
    matrix.m11 >= 0.0 && matrix.m22 >= 0.0 && matrix.m11 * matrix.m22 >= matrix.m12 * matrix.m21
}
