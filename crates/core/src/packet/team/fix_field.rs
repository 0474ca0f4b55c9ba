//! The field of a fix: its age, whether it is the start, what it says, its sigma.

use super::report::{FixContent, ReportedFix};
use crate::packet::{
    BitReader, BitWriter, FixedField, PacketError, Rounding, SigmaField, UnsignedField, field,
};

const FIX_AGE_SCALE: UnsignedField = UnsignedField { name: "scale of a fix's age", bits: 3 };
const FIX_AGE: UnsignedField = UnsignedField { name: "age of a fix", bits: 10 };
const FIX_AGE_STEP_S: f64 = 0.25;
const RESIDUAL: FixedField = FixedField {
    name: "residual of a fix",
    unit: "m",
    bits: 12,
    steps_per_unit: 8.0,
    signed: true,
    rounding: Rounding::Nearest,
};
const SINCE: FixedField = FixedField {
    name: "displacement since the start",
    unit: "m",
    bits: 12,
    steps_per_unit: 0.25,
    signed: true,
    rounding: Rounding::Nearest,
};
const FIX_IS_START: UnsignedField = UnsignedField { name: "fix at the start", bits: 1 };
const FIX_SIGMA: SigmaField =
    SigmaField { name: "sigma of a fix", unit: "m", bits: 5, steps_per_octave: 4, lowest_log2: -2 };

/// From this code of [`FIX_SIGMA`] on, 16 m, a code is a whole octave: the last stands for 2048 m.
const FIX_SIGMA_COARSE: u32 = 24;

fn fix_sigma_code(sigma_m: f64) -> Result<u32, PacketError> {
    let (fine_m, last) = (FIX_SIGMA.decode(FIX_SIGMA_COARSE), (1 << FIX_SIGMA.bits) - 1);
    if sigma_m <= fine_m || !sigma_m.is_finite() {
        return FIX_SIGMA.encode(sigma_m);
    }
    let maximum = fix_sigma_m(last);
    (FIX_SIGMA_COARSE..=last).find(|code| fix_sigma_m(*code) >= sigma_m).ok_or(PacketError::OutOfRange {
        field: FIX_SIGMA.name,
        unit: FIX_SIGMA.unit,
        value: sigma_m,
        minimum: 0.0,
        maximum,
    })
}

fn fix_sigma_m(code: u32) -> f64 {
    FIX_SIGMA.decode(code.min(FIX_SIGMA_COARSE)) * f64::from(1u32 << code.saturating_sub(FIX_SIGMA_COARSE))
}

pub(super) fn write_fix(fix: &ReportedFix, writer: &mut BitWriter) -> Result<(), PacketError> {
    field::finite(FIX_AGE.name, fix.age_s)?;
    let steps = (fix.age_s / FIX_AGE_STEP_S).max(0.0);
    let scale = (0..8).find(|k| (steps / f64::from(1u32 << k)).round() < 1024.0);
    // Older than a mission of nine hours is as old as that.
    let scale = scale.unwrap_or(7);
    let code = (steps / f64::from(1u32 << scale)).round().min(1023.0);
    FIX_AGE_SCALE.write(writer, scale)?;
    FIX_AGE.write(writer, code as u64)?;
    let (start, field, pair) = match fix.content {
        FixContent::Start(since_m) => (1, SINCE, since_m),
        FixContent::Residual(residual_m) => (0, RESIDUAL, residual_m),
    };
    FIX_IS_START.write(writer, start)?;
    pair.into_iter().try_for_each(|x| field.write(writer, x))?;
    let code = fix_sigma_code(fix.sigma_m)?;
    writer.push(FIX_SIGMA.name, u64::from(code), FIX_SIGMA.bits)
}

pub(super) fn read_fix(reader: &mut BitReader) -> Result<ReportedFix, PacketError> {
    let scale = FIX_AGE_SCALE.read(reader)?;
    let age_s = FIX_AGE.read(reader)? as f64 * FIX_AGE_STEP_S * (1u64 << scale) as f64;
    let content = if FIX_IS_START.read(reader)? == 1 {
        FixContent::Start([SINCE.read(reader)?, SINCE.read(reader)?])
    } else {
        FixContent::Residual([RESIDUAL.read(reader)?, RESIDUAL.read(reader)?])
    };
    let code = reader.take(FIX_SIGMA.name, FIX_SIGMA.bits)? as u32;
    Ok(ReportedFix { age_s, content, sigma_m: fix_sigma_m(code) })
}
