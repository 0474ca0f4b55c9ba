//! Bits into bytes and back, most significant bit first.

use super::{PacketError, layout};

/// Collects bits, most significant first; the last byte is filled up with zeros.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct BitWriter {
    bytes: Vec<u8>,
    /// Bits of the last byte that are still free, 0 to 7.
    free: u32,
}

impl BitWriter {
    /// An empty writer with room for `bytes` bytes, which then grows without allocating up to that size.
    #[must_use]
    pub fn with_capacity(bytes: usize) -> Self {
        layout::restart();
        Self { bytes: Vec::with_capacity(bytes), free: 0 }
    }

    /// Appends the low `bits` (0 to 64) of `value`; `field` names it in errors.
    ///
    /// # Errors
    /// [`PacketError::TooManyBits`] when `value` needs more bits, [`PacketError::Definition`] for a width above 64.
    /// Nothing is appended then.
    pub fn push(&mut self, field: &'static str, value: u64, bits: u32) -> Result<(), PacketError> {
        let maximum = mask(field, bits)?;
        if value > maximum {
            return Err(PacketError::TooManyBits { field, value, bits, maximum });
        }
        layout::note(field, bits);
        let mut left = bits;
        while left > 0 {
            if self.free == 0 {
                self.bytes.push(0);
                self.free = 8;
            }
            let take = left.min(self.free);
            // `take` is at most 8, so neither shift reaches the width of its type and the part fits a byte.
            let part = (value >> (left - take)) & ((1 << take) - 1);
            if let Some(last) = self.bytes.last_mut() {
                *last |= (part as u8) << (self.free - take);
            }
            self.free -= take;
            left -= take;
        }
        Ok(())
    }

    /// Bits appended so far.
    #[must_use]
    pub fn bit_len(&self) -> usize {
        self.bytes.len() * 8 - self.free as usize
    }

    /// The bytes, with zeros after the last bit.
    #[must_use]
    pub fn finish(self) -> Vec<u8> {
        self.bytes
    }
}

/// Takes bits, most significant first, from borrowed bytes. Never reads past the end, never panics.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BitReader<'a> {
    bytes: &'a [u8],
    position: usize,
}

impl<'a> BitReader<'a> {
    /// A reader at the first bit of `bytes`.
    #[must_use]
    pub fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, position: 0 }
    }

    /// Bits not taken yet.
    #[must_use]
    pub fn left_bits(&self) -> usize {
        self.bytes.len().saturating_mul(8).saturating_sub(self.position)
    }

    /// Takes the next `bits` (0 to 64) as an unsigned number; `field` names it in errors.
    ///
    /// # Errors
    /// [`PacketError::Truncated`] when fewer bits are left, [`PacketError::Definition`] for a width above 64.
    /// The reader stays where it was then.
    pub fn take(&mut self, field: &'static str, bits: u32) -> Result<u64, PacketError> {
        mask(field, bits)?;
        let left_bits = self.left_bits();
        if left_bits < bits as usize {
            return Err(PacketError::Truncated { field, needed_bits: bits, left_bits });
        }
        let mut value = 0u64;
        let mut left = bits;
        while left > 0 {
            let byte = self.bytes.get(self.position / 8).copied().unwrap_or(0);
            let available = 8 - (self.position % 8) as u32;
            let take = left.min(available);
            let part = (u64::from(byte) >> (available - take)) & ((1 << take) - 1);
            value = (value << take) | part;
            self.position += take as usize;
            left -= take;
        }
        Ok(value)
    }

    /// Ends the reading: only zero bits up to the next whole byte may follow, so that one content has one form.
    ///
    /// # Errors
    /// [`PacketError::Padding`] when more than seven bits, or a bit that is not zero, follow.
    pub fn finish(mut self) -> Result<(), PacketError> {
        let left_bits = self.left_bits();
        let value = self.take("padding", left_bits.min(64) as u32)?;
        if left_bits < 8 && value == 0 { Ok(()) } else { Err(PacketError::Padding { left_bits, value }) }
    }
}

impl BitReader<'_> {
    /// Ends the reading of a body in a frame of fixed length: only zero bits may follow.
    ///
    /// # Errors
    /// [`PacketError::Padding`] when a bit that is not zero follows.
    pub fn finish_payload(mut self) -> Result<(), PacketError> {
        let left_bits = self.left_bits();
        while self.left_bits() > 0 {
            let value = self.take("padding", self.left_bits().min(64) as u32)?;
            if value != 0 {
                return Err(PacketError::Padding { left_bits, value });
            }
        }
        Ok(())
    }
}

/// The largest number of `bits` bits.
pub(super) fn mask(field: &'static str, bits: u32) -> Result<u64, PacketError> {
    match bits {
        0 => Ok(0),
        1..=64 => Ok(u64::MAX >> (64 - bits)),
        _ => Err(PacketError::Definition {
            field,
            quantity: "width in bits",
            value: f64::from(bits),
            minimum: 0.0,
            maximum: 64.0,
        }),
    }
}
