//! Which of a peer's last packets arrived.

use super::LinkError;
use super::error::within;
use super::sequence::residue;
use crate::packet::{BitReader, BitWriter, ModuloField, PacketError};
use serde::{Deserialize, Serialize};

const NEWEST: ModuloField = ModuloField { name: "newest acknowledged sequence", bits: 8 };
const RECEIVED: &str = "acknowledgement bitmap";

/// Which of the last n packets of one peer were received, by the peer's counter.
///
/// Bit k of the map stands for packet `newest − k`, k = 0 … n − 1. On the channel: eight bits of `newest`, then n bits,
/// k = n − 1 first. Both ends know n from the packet's layout.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "Unchecked", into = "Unchecked")]
pub struct AckBitmap {
    length: u32,
    newest: u64,
    received: u64,
}

/// The same fields before their check.
#[derive(Serialize, Deserialize)]
struct Unchecked {
    length: u32,
    newest: u64,
    received: u64,
}

impl AckBitmap {
    /// Longest bitmap, packets.
    pub const LENGTH_MAX: u32 = 64;

    /// An empty bitmap over the last `length` packets, 1 to 64.
    ///
    /// # Errors
    /// [`LinkError::OutOfRange`] for another length.
    pub fn new(length: u32) -> Result<Self, LinkError> {
        within("length of an acknowledgement bitmap", f64::from(length), 1.0, f64::from(Self::LENGTH_MAX))?;
        Ok(Self { length, newest: 0, received: 0 })
    }

    /// Packets that it looks back on.
    #[must_use]
    pub fn length(&self) -> u32 {
        self.length
    }

    /// Bits that [`write`](Self::write) takes.
    #[must_use]
    pub fn bits(&self) -> u32 {
        NEWEST.bits + self.length
    }

    /// The newest packet that it covers, received or only known to have been sent; none while nothing is marked.
    #[must_use]
    pub fn newest(&self) -> Option<u64> {
        (self.received != 0).then_some(self.newest)
    }

    /// Moves on so that `newest` is covered, as not received: older packets drop out. Never moves back.
    pub fn advance(&mut self, newest: u64) {
        if newest > self.newest {
            self.received = self.masked(shift_up(self.received, newest - self.newest));
            self.newest = newest;
        }
    }

    /// Marks packet `counter` as received, moving on if it is new. False when it is too old to be covered or was
    /// marked before; nothing has changed then.
    pub fn mark(&mut self, counter: u64) -> bool {
        self.advance(counter);
        let before = self.received;
        self.received |= self.masked(shift_up(1, self.newest - counter));
        self.received != before
    }

    /// Whether packet `counter` is marked.
    #[must_use]
    pub fn is_received(&self, counter: u64) -> bool {
        counter <= self.newest && shift_up(1, self.newest - counter) & self.received != 0
    }

    /// Adds what `other`, about the same peer, has marked and this one still covers.
    pub fn merge(&mut self, other: &Self) {
        self.advance(other.newest);
        // `self.newest` is now the larger one.
        self.received |= self.masked(shift_up(other.received, self.newest - other.newest));
    }

    /// The marked packets, newest first.
    pub fn received(&self) -> impl Iterator<Item = u64> + use<> {
        let Self { length, newest, received } = *self;
        (0..length).filter(move |back| received >> back & 1 == 1).map(move |back| newest - u64::from(back))
    }

    /// Writes eight bits of the newest packet and the bitmap; an empty one as zeros.
    ///
    /// # Errors
    /// None for a bitmap made by this type's functions.
    pub fn write(&self, writer: &mut BitWriter) -> Result<(), PacketError> {
        NEWEST.write(writer, self.newest().unwrap_or(0))?;
        writer.push(RECEIVED, self.received, self.length)
    }

    /// Reads what a peer acknowledges of the reader's *own* packets, the last of which was `last_sent` (none: nothing
    /// sent yet). The newest acknowledged packet is the last one, up to `last_sent`, with the eight bits.
    ///
    /// # Errors
    /// [`PacketError::InvalidCode`] when packets are acknowledged that were never sent, [`PacketError::Truncated`] at
    /// the end of the packet, [`PacketError::Definition`] for a length outside 1 to 64.
    pub fn read(reader: &mut BitReader, length: u32, last_sent: Option<u64>) -> Result<Self, PacketError> {
        let Ok(mut bitmap) = Self::new(length) else {
            return Err(PacketError::Definition {
                field: RECEIVED,
                quantity: "width in bits",
                value: f64::from(length),
                minimum: 1.0,
                maximum: f64::from(Self::LENGTH_MAX),
            });
        };
        let code = NEWEST.read(reader)?;
        let received = reader.take(RECEIVED, length)?;
        if received == 0 {
            return Ok(bitmap);
        }
        let invalid = |field, code| PacketError::InvalidCode { field, code };
        let last_sent = last_sent.ok_or(invalid(RECEIVED, received))?;
        // Eight bits, so the conversion is exact.
        let behind = residue(last_sent).wrapping_sub(code as u8);
        bitmap.newest = last_sent.checked_sub(u64::from(behind)).ok_or(invalid(NEWEST.name, code))?;
        bitmap.received = received;
        if bitmap.reaches_below_zero() {
            return Err(invalid(RECEIVED, received));
        }
        Ok(bitmap)
    }

    /// Whether a packet before number 0 is marked.
    fn reaches_below_zero(&self) -> bool {
        let oldest = u64::from(63 - self.received.leading_zeros().min(63));
        self.received != 0 && oldest > self.newest
    }

    fn masked(&self, bits: u64) -> u64 {
        bits & (u64::MAX >> (Self::LENGTH_MAX - self.length))
    }
}

/// `bits << by`, and zero when everything is shifted out.
fn shift_up(bits: u64, by: u64) -> u64 {
    u32::try_from(by).ok().and_then(|by| bits.checked_shl(by)).unwrap_or(0)
}

impl TryFrom<Unchecked> for AckBitmap {
    type Error = LinkError;

    fn try_from(raw: Unchecked) -> Result<Self, LinkError> {
        let mut bitmap = Self::new(raw.length)?;
        bitmap.newest = raw.newest;
        bitmap.received = raw.received;
        let most = bitmap.masked(u64::MAX);
        if raw.received > most || bitmap.reaches_below_zero() {
            return Err(LinkError::OutOfRange {
                quantity: "acknowledgement bitmap",
                value: raw.received as f64,
                minimum: 0.0,
                maximum: if raw.received > most { most as f64 } else { shift_up(2, raw.newest) as f64 - 1.0 },
            });
        }
        Ok(bitmap)
    }
}

impl From<AckBitmap> for Unchecked {
    fn from(bitmap: AckBitmap) -> Self {
        let AckBitmap { length, newest, received } = bitmap;
        Self { length, newest, received }
    }
}
