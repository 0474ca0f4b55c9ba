//! Local data of one vehicle since its last broadcast: displacement, soundings, ranges, fixes. Never a belief.

use crate::packet::{Header, HeardBitmap, PacketKind};

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
pub enum FixContent {
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
    pub content: FixContent,
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

    pub(super) fn header(&self, kind: PacketKind) -> Header {
        Header { kind, sequence: self.sequence, depth_m: self.depth_m, heard: HeardBitmap::default() }
    }
}
