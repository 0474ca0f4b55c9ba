//! Local data of one vehicle since its last broadcast: displacement, soundings, ranges, fixes. Never a belief.

use super::header::{Header, HeardBitmap, PacketKind};
use super::{
    BitReader, BitWriter, FixedField, FloatField, ModuloField, PacketError, Rounding, SEAL_BYTES, SigmaField,
    UnsignedField, open, seal,
};

/// Most knots of the displacement in a packet.
pub const KNOTS_MAX: usize = 16;
/// Most soundings in a packet.
pub const SOUNDINGS_MAX: usize = 64;

/// A sounding of the window.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReportedSounding {
    /// Before the launch, s.
    pub age_s: f64,
    /// Water depth, m. Of a decoded rounded packet modulo [`TeamReport::depth_modulus_m`].
    pub water_depth_m: f64,
}

/// A range that the sender measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReportedRange {
    /// To whose launch.
    pub vehicle: u16,
    /// The low two bits of that vehicle's packet counter.
    pub sequence: u8,
    /// Horizontal, from that vehicle at launch to the sender at arrival, m.
    pub range_m: f64,
}

/// What a fix says of dead reckoning.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FixSays {
    /// It is where dead reckoning began; commanded displacement from there to the launch, m.
    Start([f64; 2]),
    /// Fix minus dead reckoning at its time, m.
    Residual([f64; 2]),
}

/// A position fix of the sender.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReportedFix {
    /// Before the launch, s.
    pub age_s: f64,
    /// What it is measured against.
    pub said: FixSays,
    /// Standard deviation per axis, m.
    pub sigma_m: f64,
}

/// What a vehicle tells its team: its own data since its last broadcast.
#[derive(Debug, Clone, PartialEq)]
pub struct TeamReport {
    /// The sender's packet counter modulo 256.
    pub sequence: u8,
    /// The sender's depth below the surface, m.
    pub depth_m: f64,
    /// How far back the packet reaches, s.
    pub window_s: f64,
    /// Where dead reckoning from the first fix stands at launch, m. Of a decoded rounded packet modulo
    /// [`TeamReport::position_modulus_m`].
    pub position_m: [f64; 2],
    /// Displacement from launch − window·(j + 1)/M to launch − window·j/M, j = 0 … M − 1, m.
    pub pieces_m: Vec<[f64; 2]>,
    /// Soundings, newest first, equally spaced but for those that are missing.
    pub soundings: Vec<ReportedSounding>,
    /// At most one range to each teammate.
    pub ranges: Vec<ReportedRange>,
    /// A fix.
    pub fix: Option<ReportedFix>,
    /// Positions are known modulo this, m; infinite where they are whole.
    pub position_modulus_m: f64,
    /// Depths are known modulo this, m; infinite where they are whole.
    pub depth_modulus_m: f64,
    /// Variance of a sounding's rounding, m².
    pub depth_rounding_m2: f64,
    /// Variance of a range's rounding, m².
    pub range_rounding_m2: f64,
}

impl Default for TeamReport {
    fn default() -> Self {
        Self {
            sequence: 0,
            depth_m: 0.0,
            window_s: 0.0,
            position_m: [0.0; 2],
            pieces_m: Vec::with_capacity(KNOTS_MAX),
            soundings: Vec::with_capacity(SOUNDINGS_MAX),
            ranges: Vec::with_capacity(16),
            fix: None,
            position_modulus_m: f64::INFINITY,
            depth_modulus_m: f64::INFINITY,
            depth_rounding_m2: 0.0,
            range_rounding_m2: 0.0,
        }
    }
}

/// How a team's packets are laid out: both ends know it from the team's size and the frame.
///
/// `payload_bytes` are what is left of a frame for header and body. The rounded form, V = 3 in 28 bytes:
///
/// | field | bits | step | range | rounding |
/// |---|---|---|---|---|
/// | kind, sequence, depth | 4, 8, 10 | 1, 1, 0.1 m | depth 0 to 102.3 m | nearest |
/// | window | 7 | 1 s | 0 to 127 s | up |
/// | dead-reckoned position | 2 × 16 | 1/8 m | modulo 8192 m | nearest |
/// | scale e of the pieces | 2 | | steps of 2^e/8 m | |
/// | M pieces of displacement | 2 × 9 each | 2^e/8 m | ±32 … ±256 m | the sums to the nearest step |
/// | age of the newest sounding | 5 | 1/4 s | 0 to 7.75 s | nearest |
/// | spacing of soundings | 3 | | 1, 2, 3, 4, 6, 8, 12, 16 s | |
/// | scale d of soundings | 2 | | steps of 0.02·4^d m | |
/// | newest sounding | 11 | 0.02·4^d m | modulo 40.94 m·4^d; all ones: none | nearest |
/// | the S − 1 before it | 7 each | 0.02·4^d m | ±1.26 m·4^d from the one after; −64: none | the depths to the nearest step |
/// | a range for each teammate | 2 + 13 | counter, 1/4 m | 0.25 to 2047.75 m; 0: none | nearest |
///
/// A packet with a fix gives up soundings for it: age 3 + 10 (0.25·2^k s), which of the two 1, residual 2 × 12 (1/8 m,
/// ±256 m) or displacement since the start 2 × 12 (4 m, ±8192 m), σ 5 (quarter octaves from 1/4 m, up).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TeamLayout {
    vehicles: usize,
    pieces: usize,
    soundings: usize,
    ranges: usize,
    bits: usize,
}

const HEARD_BITS: u32 = 0;
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
const PIECE_BITS: u32 = 9;
const NEWEST: FixedField = FixedField {
    name: "age of the newest sounding",
    unit: "s",
    bits: 5,
    steps_per_unit: 4.0,
    signed: false,
    rounding: Rounding::Nearest,
};
const SPACING: UnsignedField = UnsignedField { name: "spacing of soundings", bits: 3 };
/// Spacings of soundings, s.
pub const SPACINGS_S: [f64; 8] = [1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0];
const DEPTH_SCALE: UnsignedField = UnsignedField { name: "scale of soundings", bits: 2 };
const DEPTH_STEP_M: f64 = 0.02;
const FIRST: UnsignedField = UnsignedField { name: "newest sounding", bits: 11 };
const NO_FIRST: u64 = (1 << 11) - 1;
const DIFFERENCE_BITS: u32 = 7;
const NO_DIFFERENCE: i64 = -64;
const COUNTER: ModuloField = ModuloField { name: "counter of a range", bits: 2 };
const RANGE: UnsignedField = UnsignedField { name: "range", bits: 13 };
const RANGE_STEPS_PER_M: f64 = 4.0;
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
const FIX_BITS: usize = 3 + 10 + 1 + 2 * 12 + 5;
/// Header, window, position, scale of the pieces.
const HEAD_BITS: usize = Header::bits(HEARD_BITS) as usize + 7 + 32 + 2;
const SOUNDING_HEAD_BITS: usize = 5 + 3 + 2 + 11;
const RANGE_BITS: usize = 2 + 13;
const PIECE_PAIR_BITS: usize = 2 * PIECE_BITS as usize;
/// A layout keeps at least so many soundings before it carries ranges.
const LEAST_SOUNDINGS: usize = 4;

impl TeamLayout {
    /// The layout for a team of `vehicles` (2 to 16) whose packets have `payload_bytes` for header and body.
    ///
    /// # Errors
    /// [`PacketError::Length`] where not even displacement, four soundings and a fix fit.
    pub fn new(vehicles: usize, payload_bytes: usize) -> Result<Self, PacketError> {
        let bits = payload_bytes * 8;
        let pieces = (3 + vehicles.saturating_sub(3) / 4).min(KNOTS_MAX);
        let fixed = HEAD_BITS + pieces * PIECE_PAIR_BITS + SOUNDING_HEAD_BITS;
        let soundings = |ranges: usize| {
            let left = bits.checked_sub(fixed + ranges * RANGE_BITS)?;
            Some((1 + left / DIFFERENCE_BITS as usize).min(SOUNDINGS_MAX))
        };
        let all = vehicles.saturating_sub(1);
        let least = LEAST_SOUNDINGS;
        let (ranges, soundings) = match (soundings(all), soundings(0)) {
            (Some(s), _) if s >= least => (all, s),
            (_, Some(s)) if s >= least => (0, s),
            _ => {
                let expected = (fixed + (least - 1) * DIFFERENCE_BITS as usize).div_ceil(8);
                return Err(PacketError::Length { bytes: payload_bytes, expected });
            }
        };
        Ok(Self { vehicles, pieces, soundings, ranges, bits })
    }

    /// M, pieces of the displacement.
    #[must_use]
    pub fn pieces(&self) -> usize {
        self.pieces
    }

    /// S, most soundings of a packet without a fix.
    #[must_use]
    pub fn soundings(&self) -> usize {
        self.soundings
    }

    /// Most soundings of a packet with a fix; 0 where the fix takes the newest sounding's place as well.
    #[must_use]
    pub fn soundings_beside_fix(&self) -> usize {
        let used = HEAD_BITS + self.pieces * PIECE_PAIR_BITS + self.ranges * RANGE_BITS + FIX_BITS;
        match self.bits.checked_sub(used + SOUNDING_HEAD_BITS) {
            Some(left) => (1 + left / DIFFERENCE_BITS as usize).min(self.soundings),
            None => 0,
        }
    }

    /// Whether packets carry ranges.
    #[must_use]
    pub fn has_ranges(&self) -> bool {
        self.ranges > 0
    }

    /// Length of the payload, bytes.
    #[must_use]
    pub fn payload_bytes(&self) -> usize {
        self.bits / 8
    }
}

/// Steps per metre of a piece at a scale.
fn piece_steps_per_m(scale: u64) -> f64 {
    POSITION_STEPS_PER_M / (1u64 << scale) as f64
}

fn depth_step_m(scale: u64) -> f64 {
    DEPTH_STEP_M * (1u64 << (2 * scale)) as f64
}

fn signed(name: &'static str, reader: &mut BitReader, bits: u32) -> Result<i64, PacketError> {
    Ok(super::field::sign_extend(reader.take(name, bits)?, bits))
}

fn push_signed(name: &'static str, writer: &mut BitWriter, value: i64, bits: u32) -> Result<(), PacketError> {
    writer.push(name, value as u64 & super::bits::mask(name, bits)?, bits)
}

impl TeamReport {
    /// Empties it, keeping its memory.
    pub fn clear(&mut self) {
        let empty = |v: &mut Vec<[f64; 2]>| v.clear();
        empty(&mut self.pieces_m);
        self.soundings.clear();
        self.ranges.clear();
        self.fix = None;
        self.position_modulus_m = f64::INFINITY;
        self.depth_modulus_m = f64::INFINITY;
        self.depth_rounding_m2 = 0.0;
        self.range_rounding_m2 = 0.0;
    }

    /// The rounded form, sealed for `sender` (index in the team) and the slot at `tol_ns`.
    ///
    /// # Errors
    /// [`PacketError`] naming the field that cannot hold its value: nothing is clipped. Soundings whose differences no
    /// scale holds, and ranges beyond the field, are left out by [`TeamReport::fit`] before.
    pub fn encode(&self, layout: &TeamLayout, sender: u16, tol_ns: i64) -> Result<Vec<u8>, PacketError> {
        let mut writer = BitWriter::with_capacity(layout.payload_bytes() + SEAL_BYTES);
        let kind = if self.fix.is_some() { PacketKind::TeamFix } else { PacketKind::Team };
        self.header(kind).write(&mut writer, HEARD_BITS)?;
        WINDOW.write(&mut writer, self.window_s)?;
        let mut knots = [[0i64; 2]; KNOTS_MAX + 1];
        for (axis, position) in self.position_m.iter().enumerate() {
            super::field::finite(POSITION.name, *position)?;
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
        Ok(seal(payload, sender, tol_ns))
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
                    super::field::finite("piece of displacement", piece[axis])?;
                    sum[axis] += piece[axis];
                    knots[j + 1][axis] = (sum[axis] * steps).round() as i64;
                    fits &= (-limit..limit).contains(&(knots[j + 1][axis] - knots[j][axis]));
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
            super::field::finite("sounding", s.water_depth_m)?;
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

    fn header(&self, kind: PacketKind) -> Header {
        Header { kind, sequence: self.sequence, depth_m: self.depth_m, heard: HeardBitmap::default() }
    }

    /// Reads a packet of either form into this report, reusing its memory. Any bytes give a typed result; after an
    /// error the report holds nothing of use.
    ///
    /// # Errors
    /// [`PacketError`], for damaged bytes, another sender or slot, and for what a correct sender never writes.
    pub fn decode(
        &mut self,
        bytes: &[u8],
        layout: &TeamLayout,
        sender: u16,
        tol_ns: i64,
    ) -> Result<(), PacketError> {
        self.clear();
        let payload = open(bytes, sender, tol_ns)?;
        let mut reader = BitReader::new(payload);
        let header = Header::read(&mut reader, HEARD_BITS)?;
        self.sequence = header.sequence;
        self.depth_m = header.depth_m;
        match header.kind {
            PacketKind::Team | PacketKind::TeamFix => {
                if payload.len() != layout.payload_bytes() {
                    return Err(PacketError::Length {
                        bytes: bytes.len(),
                        expected: layout.payload_bytes() + SEAL_BYTES,
                    });
                }
                self.read_rounded(&mut reader, layout, sender, header.kind == PacketKind::TeamFix)?;
                reader.finish_payload()
            }
            PacketKind::TeamF64 => {
                self.read_f64(&mut reader, layout, sender)?;
                reader.finish()
            }
            other => Err(PacketError::InvalidCode { field: "packet kind", code: u64::from(other.code()) }),
        }
    }

    fn read_rounded(
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
            let (start, [e, n]) = match fix.said {
                FixSays::Start(since_m) => (1.0, since_m),
                FixSays::Residual(residual_m) => (0.0, residual_m),
            };
            [fix.age_s, start, e, n, fix.sigma_m].into_iter().try_for_each(&mut put)?;
        }
        self.soundings.iter().try_for_each(|s| put(s.age_s).and_then(|()| put(s.water_depth_m)))?;
        for range in &self.ranges {
            VEHICLE.write(&mut writer, u64::from(range.vehicle))?;
            COUNTER.write(&mut writer, u64::from(range.sequence))?;
            NUMBER.write(&mut writer, range.range_m)?;
        }
        Ok(seal(writer.finish(), sender, tol_ns))
    }

    fn read_f64(
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
            let said = if start > 0.5 { FixSays::Start(pair) } else { FixSays::Residual(pair) };
            self.fix = Some(ReportedFix { age_s, said, sigma_m: take(1e-3, FARTHEST)? });
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

fn write_fix(fix: &ReportedFix, writer: &mut BitWriter) -> Result<(), PacketError> {
    super::field::finite(FIX_AGE.name, fix.age_s)?;
    let steps = (fix.age_s / FIX_AGE_STEP_S).max(0.0);
    let scale = (0..8).find(|k| (steps / f64::from(1u32 << k)).round() < 1024.0);
    // Older than a mission of nine hours is as old as that.
    let scale = scale.unwrap_or(7);
    let code = (steps / f64::from(1u32 << scale)).round().min(1023.0);
    FIX_AGE_SCALE.write(writer, scale)?;
    FIX_AGE.write(writer, code as u64)?;
    let (start, field, pair) = match fix.said {
        FixSays::Start(since_m) => (1, SINCE, since_m),
        FixSays::Residual(residual_m) => (0, RESIDUAL, residual_m),
    };
    FIX_IS_START.write(writer, start)?;
    pair.into_iter().try_for_each(|x| field.write(writer, x))?;
    let code = FIX_SIGMA.encode(fix.sigma_m)?;
    writer.push(FIX_SIGMA.name, u64::from(code), FIX_SIGMA.bits)
}

fn read_fix(reader: &mut BitReader) -> Result<ReportedFix, PacketError> {
    let scale = FIX_AGE_SCALE.read(reader)?;
    let age_s = FIX_AGE.read(reader)? as f64 * FIX_AGE_STEP_S * (1u64 << scale) as f64;
    let said = if FIX_IS_START.read(reader)? == 1 {
        FixSays::Start([SINCE.read(reader)?, SINCE.read(reader)?])
    } else {
        FixSays::Residual([RESIDUAL.read(reader)?, RESIDUAL.read(reader)?])
    };
    Ok(ReportedFix { age_s, said, sigma_m: FIX_SIGMA.read(reader)? })
}
