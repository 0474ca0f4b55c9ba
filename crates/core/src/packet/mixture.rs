//! A position belief of a few modes as a packet (Tan, Chitre & Hover 2016, section 7).

use super::header::{Header, PacketKind, TEAM_MAX};
use super::{Belief, BitReader, BitWriter, PacketError, UnsignedField, append_crc, check_crc};

const HEARD_BITS: u32 = TEAM_MAX as u32;
const COUNT: UnsignedField = UnsignedField { name: "number of modes less one", bits: 2 };
const SHARE: UnsignedField = UnsignedField { name: "share of a mode", bits: 7 };
const SHARE_STEPS: f64 = 127.0;
/// Most modes of a packet.
pub const MODES_MAX: usize = 4;

/// One to four Gaussian modes, each rounded as in a [`BeliefPacket`](super::BeliefPacket).
///
/// ```text
/// | header 38 bits | modes − 1: 2 bits | modes × (share 7, e 20, n 20, σ_e 8, σ_n 8, correlation 10) | zero bits | CRC 16 |
/// ```
///
/// Two modes take 26 bytes, four 44. A share is rounded to 1/127 of the whole and at least one step; decoded shares are
/// normalised to one.
#[derive(Debug, Clone, PartialEq)]
pub struct MixturePacket {
    /// Sequence, depth, acknowledgements; its kind is [`PacketKind::Mixture`].
    pub header: Header,
    /// Share and belief of each mode.
    pub modes: Vec<(f64, Belief)>,
}

impl MixturePacket {
    /// The packet's bytes, checksum included, for `sender` and `tol_ns`.
    ///
    /// # Errors
    /// [`PacketError::OutOfRange`] for no or too many modes or a share outside 0 to 1, and what a belief refuses.
    pub fn encode(&self, sender: u16, tol_ns: i64) -> Result<Vec<u8>, PacketError> {
        let outside = |field, value, minimum, maximum| {
            Err(PacketError::OutOfRange { field, unit: "", value, minimum, maximum })
        };
        if !(1..=MODES_MAX).contains(&self.modes.len()) {
            return outside("number of modes", self.modes.len() as f64, 1.0, MODES_MAX as f64);
        }
        let mut writer = BitWriter::with_capacity(48);
        self.header.write(&mut writer, HEARD_BITS)?;
        COUNT.write(&mut writer, self.modes.len() as u64 - 1)?;
        for (share, belief) in &self.modes {
            if !(0.0..=1.0 + 1e-9).contains(share) {
                return outside("share of a mode", *share, 0.0, 1.0);
            }
            SHARE.write(&mut writer, (share * SHARE_STEPS).round().clamp(1.0, SHARE_STEPS) as u64)?;
            belief.check()?;
            belief.write_rounded(&mut writer)?;
        }
        Ok(append_crc(writer.finish(), sender, tol_ns))
    }

    /// Reads what `sender` launched at `tol_ns`. Any bytes give a typed result.
    ///
    /// # Errors
    /// As [`BeliefPacket::decode`](super::BeliefPacket::decode).
    pub fn decode(bytes: &[u8], sender: u16, tol_ns: i64) -> Result<Self, PacketError> {
        let mut reader = BitReader::new(check_crc(bytes, sender, tol_ns)?);
        let header = Header::read(&mut reader, HEARD_BITS)?;
        if header.kind != PacketKind::Mixture {
            return Err(PacketError::InvalidCode {
                field: "packet kind",
                code: u64::from(header.kind.code()),
            });
        }
        let count = COUNT.read(&mut reader)? + 1;
        let mut modes = Vec::with_capacity(MODES_MAX);
        for _ in 0..count {
            let steps = SHARE.read(&mut reader)?;
            if steps == 0 {
                return Err(PacketError::InvalidCode { field: "share of a mode", code: 0 });
            }
            modes.push((steps as f64, Belief::read_rounded(&mut reader)?));
        }
        reader.finish()?;
        let total: f64 = modes.iter().map(|m| m.0).sum();
        modes.iter_mut().for_each(|m| m.0 /= total);
        Ok(Self { header, modes })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::packet::HeardBitmap;
    use nalgebra::{Matrix2, Vector2};

    fn packet(modes: usize) -> MixturePacket {
        let mode = |k: usize| {
            let at = k as f64;
            let belief = Belief {
                mean_m: Vector2::new(100.0 * at, -7.25 * at),
                covariance_m2: Matrix2::new(4.0 + at, 0.5, 0.5, 9.0),
            };
            (1.0 / modes as f64, belief)
        };
        MixturePacket {
            header: Header {
                kind: PacketKind::Mixture,
                sequence: 9,
                depth_m: 2.0,
                heard: HeardBitmap::default(),
            },
            modes: (0..modes).map(mode).collect(),
        }
    }

    #[test]
    fn modes_come_back_and_never_claim_more() {
        for (count, length) in [(1, 17), (2, 26), (3, 35), (4, 44)] {
            let sent = packet(count);
            let bytes = sent.encode(3, 77).expect("it fits");
            assert_eq!(bytes.len(), length);
            let got = MixturePacket::decode(&bytes, 3, 77).expect("its own bytes");
            assert!((got.modes.iter().map(|m| m.0).sum::<f64>() - 1.0).abs() < 1e-12);
            for ((share, belief), (sent_share, sent)) in got.modes.iter().zip(&sent.modes) {
                assert!((share - sent_share).abs() < 0.01);
                assert!((belief.mean_m - sent.mean_m).amax() <= 1.0 / 32.0);
                let slack = belief.covariance_m2 - sent.covariance_m2;
                assert!(slack.symmetric_eigenvalues().min() > -1e-9);
            }
            for bit in 0..8 * bytes.len() {
                let mut bad = bytes.clone();
                bad[bit / 8] ^= 1 << (bit % 8);
                assert!(MixturePacket::decode(&bad, 3, 77).is_err());
            }
        }
    }

    #[test]
    fn impossible_mixtures_are_refused() {
        assert!(packet(5).encode(0, 0).is_err());
        let mut none = packet(1);
        none.modes.clear();
        assert!(none.encode(0, 0).is_err());
        let mut bad = packet(2);
        bad.modes[0].0 = f64::NAN;
        assert!(bad.encode(0, 0).is_err());
    }
}
