//! A report as `f64`, for studies without a limit on bandwidth.

use super::layout::{COUNTER, HEARD_BITS, TeamLayout};
use super::report::{
    FixContent, KNOTS_MAX, ReportedFix, ReportedRange, ReportedSounding, SOUNDINGS_MAX, TeamReport,
};
use crate::packet::{BitReader, BitWriter, FloatField, PacketError, PacketKind, UnsignedField, append_crc};

const PIECES: UnsignedField = UnsignedField { name: "number of pieces", bits: 5 };
const SOUNDINGS: UnsignedField = UnsignedField { name: "number of soundings", bits: 7 };
const RANGES: UnsignedField = UnsignedField { name: "number of ranges", bits: 5 };
const HAS_FIX: UnsignedField = UnsignedField { name: "fix", bits: 1 };
const VEHICLE: UnsignedField = UnsignedField { name: "vehicle of a range", bits: 4 };
const NUMBER: FloatField = FloatField { name: "number of a team packet" };
/// Nothing that an honest sender says is larger: metres and seconds.
const FARTHEST: f64 = 1e8;

fn bounded(field: &'static str, code: u64, low: u64, high: u64) -> Result<u64, PacketError> {
    if (low..=high).contains(&code) { Ok(code) } else { Err(PacketError::InvalidCode { field, code }) }
}

fn within(value: f64, minimum: f64, maximum: f64) -> Result<f64, PacketError> {
    if (minimum..=maximum).contains(&value) {
        Ok(value)
    } else {
        Err(PacketError::OutOfRange { field: NUMBER.name, unit: "m or s", value, minimum, maximum })
    }
}

impl TeamReport {
    /// The same content as `f64`, for studies without a limit on bandwidth.
    ///
    /// # Errors
    /// [`PacketError::NotFinite`], [`PacketError::TooManyBits`].
    pub fn encode_f64(&self, sender: u16, tol_ns: i64) -> Result<Vec<u8>, PacketError> {
        let mut writer = BitWriter::with_capacity(64 + 16 * (self.soundings.len() + self.pieces_m.len()));
        self.header(PacketKind::TeamF64).write(&mut writer, HEARD_BITS)?;
        PIECES.write(&mut writer, self.pieces_m.len() as u64)?;
        SOUNDINGS.write(&mut writer, self.soundings.len() as u64)?;
        RANGES.write(&mut writer, self.ranges.len() as u64)?;
        HAS_FIX.write(&mut writer, u64::from(self.fix.is_some()))?;
        let mut put = |value: f64| NUMBER.write(&mut writer, value);
        put(self.window_s)?;
        self.position_m.iter().chain(self.pieces_m.iter().flatten()).try_for_each(|x| put(*x))?;
        if let Some(fix) = &self.fix {
            let (start, [e, n]) = match fix.content {
                FixContent::Start(since_m) => (1.0, since_m),
                FixContent::Residual(residual_m) => (0.0, residual_m),
            };
            [fix.age_s, start, e, n, fix.sigma_m].into_iter().try_for_each(&mut put)?;
        }
        self.soundings.iter().try_for_each(|s| put(s.age_s).and_then(|()| put(s.water_depth_m)))?;
        for range in &self.ranges {
            VEHICLE.write(&mut writer, u64::from(range.vehicle))?;
            COUNTER.write(&mut writer, u64::from(range.sequence))?;
            NUMBER.write(&mut writer, range.range_m)?;
        }
        Ok(append_crc(writer.finish(), sender, tol_ns))
    }

    pub(super) fn read_f64(
        &mut self,
        reader: &mut BitReader,
        layout: &TeamLayout,
        sender: u16,
    ) -> Result<(), PacketError> {
        let pieces = bounded(PIECES.name, PIECES.read(reader)?, 1, KNOTS_MAX as u64)?;
        let soundings = bounded(SOUNDINGS.name, SOUNDINGS.read(reader)?, 0, SOUNDINGS_MAX as u64)?;
        let ranges = bounded(RANGES.name, RANGES.read(reader)?, 0, layout.vehicles as u64)?;
        let has_fix = HAS_FIX.read(reader)? == 1;
        let mut take = |low: f64, high: f64| within(NUMBER.read(reader)?, low, high);
        self.window_s = take(0.0, FARTHEST)?;
        for value in &mut self.position_m {
            *value = take(-FARTHEST, FARTHEST)?;
        }
        for _ in 0..pieces {
            self.pieces_m.push([take(-FARTHEST, FARTHEST)?, take(-FARTHEST, FARTHEST)?]);
        }
        if has_fix {
            let (age_s, start) = (take(0.0, FARTHEST)?, take(0.0, 1.0)?);
            let pair = [take(-FARTHEST, FARTHEST)?, take(-FARTHEST, FARTHEST)?];
            let content = if start > 0.5 { FixContent::Start(pair) } else { FixContent::Residual(pair) };
            self.fix = Some(ReportedFix { age_s, content, sigma_m: take(1e-3, FARTHEST)? });
        }
        let mut last_s = -1.0;
        for _ in 0..soundings {
            let (age_s, water_depth_m) = (take(0.0, FARTHEST)?, take(-FARTHEST, FARTHEST)?);
            if age_s <= last_s {
                return Err(PacketError::InvalidCode { field: "order of soundings", code: 0 });
            }
            last_s = age_s;
            self.soundings.push(ReportedSounding { age_s, water_depth_m });
        }
        for _ in 0..ranges {
            let vehicle = VEHICLE.read(reader)? as u16;
            let sequence = COUNTER.read(reader)? as u8;
            let range_m = within(NUMBER.read(reader)?, 1e-6, FARTHEST)?;
            let known = usize::from(vehicle) < layout.vehicles && vehicle != sender;
            if !known || self.ranges.iter().any(|r| r.vehicle >= vehicle) {
                return Err(PacketError::InvalidCode { field: VEHICLE.name, code: u64::from(vehicle) });
            }
            self.ranges.push(ReportedRange { vehicle, sequence, range_m });
        }
        Ok(())
    }
}
