//! The rounded form of a report.

use super::fix_field::{read_fix, write_fix};
use super::layout::{COUNTER, DIFFERENCE_BITS, HEARD_BITS, PIECE_BITS, SPACINGS_S, TeamLayout};
use super::report::{KNOTS_MAX, ReportedRange, ReportedSounding, SOUNDINGS_MAX, TeamReport};
use crate::packet::{
    BitReader, BitWriter, CRC_BYTES, FixedField, ModuloField, PacketError, PacketKind, Rounding,
    UnsignedField, append_crc, bits, field,
};

const WINDOW: FixedField = FixedField {
    name: "window",
    unit: "s",
    bits: 7,
    steps_per_unit: 1.0,
    signed: false,
    rounding: Rounding::Up,
};
const POSITION: ModuloField = ModuloField { name: "dead-reckoned position", bits: 16 };
const POSITION_STEPS_PER_M: f64 = 8.0;
const PIECE_SCALE: UnsignedField = UnsignedField { name: "scale of the pieces", bits: 2 };
const NEWEST: FixedField = FixedField {
    name: "age of the newest sounding",
    unit: "s",
    bits: 5,
    steps_per_unit: 4.0,
    signed: false,
    rounding: Rounding::Nearest,
};
const SPACING: UnsignedField = UnsignedField { name: "spacing of soundings", bits: 3 };
const DEPTH_SCALE: UnsignedField = UnsignedField { name: "scale of soundings", bits: 2 };
const DEPTH_STEP_M: f64 = 0.02;
const FIRST: UnsignedField = UnsignedField { name: "newest sounding", bits: 11 };
const NO_FIRST: u64 = (1 << 11) - 1;
const NO_DIFFERENCE: i64 = -64;
const RANGE: UnsignedField = UnsignedField { name: "range", bits: 13 };
const RANGE_STEPS_PER_M: f64 = 4.0;

/// Steps per metre of a piece at a scale.
fn piece_steps_per_m(scale: u64) -> f64 {
    POSITION_STEPS_PER_M / (1u64 << scale) as f64
}

fn depth_step_m(scale: u64) -> f64 {
    DEPTH_STEP_M * (1u64 << (2 * scale)) as f64
}

fn signed(name: &'static str, reader: &mut BitReader, bits: u32) -> Result<i64, PacketError> {
    Ok(field::sign_extend(reader.take(name, bits)?, bits))
}

fn push_signed(name: &'static str, writer: &mut BitWriter, value: i64, bits: u32) -> Result<(), PacketError> {
    writer.push(name, value as u64 & bits::mask(name, bits)?, bits)
}

impl TeamReport {
    /// The rounded form, checksum included, for `sender` (index in the team) and the slot at `tol_ns`.
    ///
    /// # Errors
    /// [`PacketError`] naming the field that cannot hold its value: nothing is clipped. Soundings whose differences no
    /// scale holds, and ranges beyond the field, are left out.
    pub fn encode(&self, layout: &TeamLayout, sender: u16, tol_ns: i64) -> Result<Vec<u8>, PacketError> {
        let mut writer = BitWriter::with_capacity(layout.payload_bytes() + CRC_BYTES);
        let kind = if self.fix.is_some() { PacketKind::TeamFix } else { PacketKind::Team };
        self.header(kind).write(&mut writer, HEARD_BITS)?;
        WINDOW.write(&mut writer, self.window_s)?;
        let mut knots = [[0i64; 2]; KNOTS_MAX + 1];
        for (axis, position) in self.position_m.iter().enumerate() {
            field::finite(POSITION.name, *position)?;
            let steps = (position * POSITION_STEPS_PER_M).round();
            POSITION.write(&mut writer, (steps as i64) as u64)?;
            // Sums are rounded, not pieces, so that their errors do not add up.
            knots[0][axis] = 0;
        }
        let scale = self.piece_scale(layout, &mut knots)?;
        PIECE_SCALE.write(&mut writer, scale)?;
        for pair in knots.windows(2).take(layout.pieces) {
            for (newer, older) in pair[0].iter().zip(pair[1]) {
                let piece = older - newer;
                push_signed("piece of displacement", &mut writer, piece, PIECE_BITS)?;
            }
        }
        if let Some(fix) = &self.fix {
            write_fix(fix, &mut writer)?;
        }
        self.write_soundings(layout, &mut writer)?;
        self.write_ranges(layout, sender, &mut writer)?;
        let mut payload = writer.finish();
        payload.resize(layout.payload_bytes(), 0);
        Ok(append_crc(payload, sender, tol_ns))
    }

    /// Rounded sums of the pieces at the least scale that holds all of them.
    fn piece_scale(
        &self,
        layout: &TeamLayout,
        knots: &mut [[i64; 2]; KNOTS_MAX + 1],
    ) -> Result<u64, PacketError> {
        let limit = 1i64 << (PIECE_BITS - 1);
        for scale in 0..4 {
            let steps = piece_steps_per_m(scale);
            let mut fits = true;
            let mut sum = [0.0; 2];
            for j in 0..layout.pieces {
                let piece = self.pieces_m.get(j).copied().unwrap_or_default();
                for axis in 0..2 {
                    field::finite("piece of displacement", piece[axis])?;
                    sum[axis] += piece[axis];
                    knots[j + 1][axis] = (sum[axis] * steps).round() as i64;
                    fits &= (-limit..limit).contains(&knots[j + 1][axis].saturating_sub(knots[j][axis]));
                }
            }
            if fits {
                return Ok(scale);
            }
        }
        let most = limit as f64 / piece_steps_per_m(3);
        let value = self.pieces_m.iter().flatten().fold(0.0f64, |a, b| a.max(b.abs()));
        Err(PacketError::OutOfRange {
            field: "piece of displacement",
            unit: "m",
            value,
            minimum: -most,
            maximum: most,
        })
    }

    fn room(&self, layout: &TeamLayout) -> usize {
        if self.fix.is_some() { layout.soundings_beside_fix() } else { layout.soundings }
    }

    /// The spacing's code, and each sounding's place on the grid of times (by age).
    fn spacing_code(&self) -> Result<u64, PacketError> {
        let newest = self.soundings.first().map_or(0.0, |s| s.age_s);
        'spacing: for (code, spacing) in SPACINGS_S.iter().enumerate().rev() {
            for s in &self.soundings {
                let place = (s.age_s - newest) / spacing;
                if (place - place.round()).abs() * spacing > 0.3 {
                    continue 'spacing;
                }
            }
            return Ok(code as u64);
        }
        Ok(0)
    }

    fn write_soundings(&self, layout: &TeamLayout, writer: &mut BitWriter) -> Result<(), PacketError> {
        let room = self.room(layout);
        if room == 0 {
            return Ok(());
        }
        let Some(newest) = self.soundings.first() else {
            NEWEST.write(writer, 0.0)?;
            SPACING.write(writer, 0)?;
            DEPTH_SCALE.write(writer, 0)?;
            FIRST.write(writer, NO_FIRST)?;
            for _ in 1..room {
                push_signed("sounding", writer, NO_DIFFERENCE, DIFFERENCE_BITS)?;
            }
            return Ok(());
        };
        let code = self.spacing_code()?;
        let spacing = SPACINGS_S[code as usize];
        let mut depths = [f64::NAN; SOUNDINGS_MAX];
        for s in &self.soundings {
            let place = ((s.age_s - newest.age_s) / spacing).round() as usize;
            field::finite("sounding", s.water_depth_m)?;
            if let Some(depth) = depths.get_mut(place).filter(|_| place < room) {
                *depth = s.water_depth_m;
            }
        }
        let scale = (0..4).find(|scale| differences_fit(&depths[..room], depth_step_m(*scale)));
        let step = depth_step_m(scale.unwrap_or(3));
        NEWEST.write(writer, newest.age_s)?;
        SPACING.write(writer, code)?;
        DEPTH_SCALE.write(writer, scale.unwrap_or(3))?;
        let mut last = (depths[0] / step).round() as i64;
        FIRST.write(writer, last.rem_euclid(NO_FIRST as i64) as u64)?;
        for depth in &depths[1..room] {
            let steps = (depth / step).round();
            let difference = if steps.is_nan() { NO_DIFFERENCE } else { steps as i64 - last };
            // What no scale holds is left out: the next one is measured from the last that was sent.
            let sent = if difference.abs() < 64 { difference } else { NO_DIFFERENCE };
            push_signed("sounding", writer, sent, DIFFERENCE_BITS)?;
            if sent != NO_DIFFERENCE {
                last += sent;
            }
        }
        Ok(())
    }

    fn write_ranges(
        &self,
        layout: &TeamLayout,
        sender: u16,
        writer: &mut BitWriter,
    ) -> Result<(), PacketError> {
        if !layout.has_ranges() {
            return Ok(());
        }
        for vehicle in (0..layout.vehicles as u16).filter(|v| *v != sender) {
            let found = self.ranges.iter().find(|r| r.vehicle == vehicle);
            let steps = found.map_or(0.0, |r| (r.range_m * RANGE_STEPS_PER_M).round());
            // A range that the field cannot hold is none.
            let steps = if (1.0..8192.0).contains(&steps) { steps as u64 } else { 0 };
            let counter = found.filter(|_| steps > 0).map_or(0, |r| u64::from(r.sequence));
            COUNTER.write(writer, counter)?;
            RANGE.write(writer, steps)?;
        }
        Ok(())
    }

    pub(super) fn read_rounded(
        &mut self,
        reader: &mut BitReader,
        layout: &TeamLayout,
        sender: u16,
        with_fix: bool,
    ) -> Result<(), PacketError> {
        self.window_s = WINDOW.read(reader)?;
        for position in &mut self.position_m {
            *position = POSITION.read(reader)? as f64 / POSITION_STEPS_PER_M;
        }
        self.position_modulus_m = f64::from(1u32 << POSITION.bits) / POSITION_STEPS_PER_M;
        let steps = piece_steps_per_m(PIECE_SCALE.read(reader)?);
        for _ in 0..layout.pieces {
            let mut piece = [0.0; 2];
            for value in &mut piece {
                *value = signed("piece of displacement", reader, PIECE_BITS)? as f64 / steps;
            }
            self.pieces_m.push(piece);
        }
        if with_fix {
            self.fix = Some(read_fix(reader)?);
        }
        self.read_soundings(reader, layout)?;
        self.read_ranges(reader, layout, sender)
    }

    fn read_soundings(&mut self, reader: &mut BitReader, layout: &TeamLayout) -> Result<(), PacketError> {
        let room = self.room(layout);
        if room == 0 {
            return Ok(());
        }
        let newest_s = NEWEST.read(reader)?;
        let spacing_s = SPACINGS_S[SPACING.read(reader)? as usize % SPACINGS_S.len()];
        let step = depth_step_m(DEPTH_SCALE.read(reader)?);
        let first = FIRST.read(reader)?;
        self.depth_modulus_m = NO_FIRST as f64 * step;
        self.depth_rounding_m2 = step * step / 12.0;
        let mut last = first as i64;
        for place in 0..room {
            if place > 0 {
                let difference = signed("sounding", reader, DIFFERENCE_BITS)?;
                if difference == NO_DIFFERENCE {
                    continue;
                }
                last += difference;
            }
            if first != NO_FIRST {
                let age_s = newest_s + spacing_s * place as f64;
                self.soundings.push(ReportedSounding { age_s, water_depth_m: last as f64 * step });
            }
        }
        Ok(())
    }

    fn read_ranges(
        &mut self,
        reader: &mut BitReader,
        layout: &TeamLayout,
        sender: u16,
    ) -> Result<(), PacketError> {
        self.range_rounding_m2 = 1.0 / (12.0 * RANGE_STEPS_PER_M * RANGE_STEPS_PER_M);
        if !layout.has_ranges() {
            return Ok(());
        }
        for vehicle in (0..layout.vehicles as u16).filter(|v| *v != sender) {
            let sequence = COUNTER.read(reader)? as u8;
            let steps = RANGE.read(reader)?;
            if steps > 0 {
                let range_m = steps as f64 / RANGE_STEPS_PER_M;
                self.ranges.push(ReportedRange { vehicle, sequence, range_m });
            }
        }
        Ok(())
    }
}

/// Whether every difference of neighbours that are there fits its field at this step.
fn differences_fit(depths: &[f64], step: f64) -> bool {
    let mut last = (depths[0] / step).round();
    depths[1..].iter().filter(|d| !d.is_nan()).all(|d| {
        let steps = (d / step).round();
        let fits = (steps - last).abs() < 64.0;
        last = steps;
        fits
    })
}
