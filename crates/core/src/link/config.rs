//! The modem: frames, air time, sound speed.

use super::LinkError;
use super::error::within;
use serde::{Deserialize, Serialize};

/// Longest a packet may take, s: far above any modem, far below what overflows nanoseconds.
const AIR_TIME_MAX_S: f64 = 1e6;
/// Sound speeds outside these are not water, m/s.
const SOUND_SPEED_MPS: (f64, f64) = (1000.0, 2000.0);

/// The modem as both ends know it.
///
/// A packet of n bytes takes ⌈n / frame_bytes⌉ frames, at least one, and the channel for
/// `preamble_s + frames · frame_s`. It arrives only if all of its frames do.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Unchecked", into = "Unchecked")]
pub struct LinkConfig {
    frame_bytes: usize,
    max_frames: usize,
    frame_s: f64,
    preamble_s: f64,
    sound_speed_mps: f64,
}

/// The same fields before their check.
#[derive(Serialize, Deserialize)]
struct Unchecked {
    frame_bytes: usize,
    max_frames: usize,
    frame_s: f64,
    preamble_s: f64,
    sound_speed_mps: f64,
}

impl LinkConfig {
    /// Checks and keeps the modem's figures: bytes in a frame (≥ 1), most frames of one packet (≥ 1), air time of a
    /// frame and of the preamble (≥ 0 s, together at most 10⁶ s for the longest packet), and the sound speed that
    /// turns times into ranges (1000 to 2000 m/s).
    ///
    /// # Errors
    /// [`LinkError::OutOfRange`] naming the first figure outside its bounds.
    pub fn new(
        frame_bytes: usize,
        max_frames: usize,
        frame_s: f64,
        preamble_s: f64,
        sound_speed_mps: f64,
    ) -> Result<Self, LinkError> {
        // As f64 only for the bounds and their messages.
        within("frame_bytes", frame_bytes as f64, 1.0, f64::MAX)?;
        within("max_frames", max_frames as f64, 1.0, f64::MAX)?;
        within("frame_s", frame_s, 0.0, AIR_TIME_MAX_S)?;
        within("preamble_s", preamble_s, 0.0, AIR_TIME_MAX_S)?;
        within("longest packet, s", preamble_s + max_frames as f64 * frame_s, 0.0, AIR_TIME_MAX_S)?;
        within("sound_speed_mps", sound_speed_mps, SOUND_SPEED_MPS.0, SOUND_SPEED_MPS.1)?;
        Ok(Self { frame_bytes, max_frames, frame_s, preamble_s, sound_speed_mps })
    }

    /// Bytes in a frame.
    #[must_use]
    pub fn frame_bytes(&self) -> usize {
        self.frame_bytes
    }

    /// Most frames of one packet.
    #[must_use]
    pub fn max_frames(&self) -> usize {
        self.max_frames
    }

    /// Air time of a frame, s.
    #[must_use]
    pub fn frame_s(&self) -> f64 {
        self.frame_s
    }

    /// Air time before the first frame, s.
    #[must_use]
    pub fn preamble_s(&self) -> f64 {
        self.preamble_s
    }

    /// The sound speed that turns travel times into ranges, m/s.
    #[must_use]
    pub fn sound_speed_mps(&self) -> f64 {
        self.sound_speed_mps
    }

    /// The longest packet, bytes.
    #[must_use]
    pub fn max_bytes(&self) -> usize {
        self.frame_bytes.saturating_mul(self.max_frames)
    }

    /// Frames that a packet of `bytes` takes: ⌈bytes / frame_bytes⌉, at least one.
    ///
    /// # Errors
    /// [`LinkError::TooManyFrames`] when the modem does not send so many.
    pub fn frames_needed(&self, bytes: usize) -> Result<usize, LinkError> {
        let frames = bytes.div_ceil(self.frame_bytes).max(1);
        if frames > self.max_frames {
            return Err(LinkError::TooManyFrames {
                bytes,
                frames,
                frame_bytes: self.frame_bytes,
                max_frames: self.max_frames,
            });
        }
        Ok(frames)
    }

    /// Time that a packet of `bytes` occupies the channel, to the nearest ns.
    ///
    /// # Errors
    /// [`LinkError::TooManyFrames`] when the modem does not send so many.
    pub fn air_time_ns(&self, bytes: usize) -> Result<i64, LinkError> {
        let frames = self.frames_needed(bytes)?;
        // At most 1e6 s by construction, so the conversion is far from its limits.
        Ok(((self.preamble_s + frames as f64 * self.frame_s) * 1e9).round() as i64)
    }
}

impl TryFrom<Unchecked> for LinkConfig {
    type Error = LinkError;

    fn try_from(raw: Unchecked) -> Result<Self, LinkError> {
        Self::new(raw.frame_bytes, raw.max_frames, raw.frame_s, raw.preamble_s, raw.sound_speed_mps)
    }
}

impl From<LinkConfig> for Unchecked {
    fn from(config: LinkConfig) -> Self {
        let LinkConfig { frame_bytes, max_frames, frame_s, preamble_s, sound_speed_mps } = config;
        Self { frame_bytes, max_frames, frame_s, preamble_s, sound_speed_mps }
    }
}
