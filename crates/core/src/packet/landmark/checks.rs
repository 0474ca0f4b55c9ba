//! Checksums of the exchange packets that do not end in the common CRC-16.

use crc::{CRC_8_SMBUS, Crc};

use super::ExchangePacket;
use super::layout::Layout;
use crate::packet::{BitReader, BitWriter, PacketError, implied_bytes};

const CRC_8: Crc<u8> = Crc::<u8>::new(&CRC_8_SMBUS);

/// CRC-8 over payload and implied fields.
pub fn check_8(payload: &[u8], sender: u16, tol_ns: i64) -> u8 {
    let mut digest = CRC_8.digest();
    digest.update(payload);
    digest.update(&implied_bytes(sender, tol_ns));
    digest.finalize()
}

/// Checks the CRC-8 at the end.
pub fn compare_8(bytes: &[u8], sender: u16, tol_ns: i64) -> Result<(), PacketError> {
    let Some((received, payload)) = bytes.split_last() else {
        return Err(PacketError::Length { bytes: 0, expected: 8 });
    };
    let computed = check_8(payload, sender, tol_ns);
    if computed == *received {
        return Ok(());
    }
    Err(PacketError::Checksum { received: u16::from(*received), computed: u16::from(computed) })
}

/// Payload and the big-endian check at its end.
pub fn split_tail(bytes: &[u8]) -> Result<(&[u8], u16), PacketError> {
    let Some((payload, tail)) = bytes.split_last_chunk::<2>() else {
        return Err(PacketError::Length { bytes: bytes.len(), expected: 2 });
    };
    Ok((payload, u16::from_be_bytes(*tail)))
}

/// Bits of format 1 in 32 bytes before the check.
const SHIFTED_BITS: usize = 239;

/// Format 1 in 32 bytes: 239 bits, the CRC-16 of those bits set flush right in 30 bytes, one zero bit.
pub fn finish_shifted(packet: &ExchangePacket, layout: &Layout) -> Result<Vec<u8>, PacketError> {
    let mut flush_right = BitWriter::with_capacity(30);
    flush_right.push("lead", 0, 1)?;
    layout.write_to(packet, &mut flush_right)?;
    let crc = crate::packet::CRC.checksum(&flush_right.finish());
    let mut writer = layout.write(packet)?;
    writer.push("checksum", u64::from(crc), 16)?;
    Ok(writer.finish())
}

/// Checks what [`finish_shifted`] wrote.
pub fn compare_shifted(bytes: &[u8]) -> Result<(), PacketError> {
    let mut reader = BitReader::new(bytes);
    let mut flush_right = BitWriter::with_capacity(30);
    flush_right.push("lead", 0, 1)?;
    let mut left = SHIFTED_BITS;
    while left > 0 {
        let take = left.min(48) as u32;
        flush_right.push("payload", reader.take("payload", take)?, take)?;
        left -= take as usize;
    }
    let computed = crate::packet::CRC.checksum(&flush_right.finish());
    // Sixteen bits.
    let received = reader.take("checksum", 16)? as u16;
    if received != computed {
        return Err(PacketError::Checksum { received, computed });
    }
    reader.finish()
}
