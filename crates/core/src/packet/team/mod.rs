//! The packet of `team`: a [`TeamReport`] by a [`TeamLayout`], rounded or as `f64`.

mod exact;
mod fix_field;
mod layout;
mod report;
mod rounded;

pub use layout::{SPACINGS_S, TeamLayout};
pub use report::{
    FixContent, KNOTS_MAX, ReportedFix, ReportedRange, ReportedSounding, SOUNDINGS_MAX, TeamReport,
};

use super::{BitReader, CRC_BYTES, Header, PacketError, PacketKind, check_crc};
use layout::HEARD_BITS;

impl TeamReport {
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
        let payload = check_crc(bytes, sender, tol_ns)?;
        let mut reader = BitReader::new(payload);
        let header = Header::read(&mut reader, HEARD_BITS)?;
        self.sequence = header.sequence;
        self.depth_m = header.depth_m;
        match header.kind {
            PacketKind::Team | PacketKind::TeamFix => {
                if payload.len() != layout.payload_bytes() {
                    return Err(PacketError::Length {
                        bytes: bytes.len(),
                        expected: layout.payload_bytes() + CRC_BYTES,
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
}
