//! Whether a packet was tagged by a holder of the team's key, for this slot, and is heard for the first time.

use std::fmt;

use hmac::{Hmac, KeyInit, Mac};
use serde::{Deserialize, Serialize};
use sha2::Sha256;
use zeroize::Zeroizing;

use super::LinkError;
use super::error::within;
use crate::packet::implied_bytes;

/// What the key is used for, so that the same key elsewhere never gives the same tag.
const DOMAIN: &[u8] = b"uwcoop packet tag 1";

/// Tags of a team's packets: HMAC-SHA-256 (RFC 2104, FIPS 180-4), truncated from the left.
///
/// ```text
/// on the channel:  | packet: header, body | tag, 1 to 16 bytes |
/// tag = HMAC(K, packet | sender, u16 big-endian | tol_ns, i64 big-endian)      cut to its first bytes
/// K   = HMAC(key, "uwcoop packet tag 1" | length of the tag, u8 | mission, u64 big-endian)
/// ```
///
/// The sender and the launch time follow from the slot and cost no bytes. A forged tag of n bytes is accepted with
/// probability 2^(−8n), independently at each try. The launch time is also the counter against replays
/// ([`ReplayGuard`]); it starts anew with each mission, so `mission` (the mission's epoch, say) must differ between
/// missions that share a key. Key material is overwritten when it is dropped. A tag shows that *some* holder of the key sent a packet: teammates can imitate each other.
#[derive(Clone)]
pub struct Authenticator {
    keyed: Hmac<Sha256>,
    tag_bytes: usize,
}

impl Authenticator {
    /// Shortest key, bytes.
    pub const KEY_BYTES_MIN: usize = 16;
    /// Longest key, bytes: one block of the hash.
    pub const KEY_BYTES_MAX: usize = 64;
    /// Longest tag, bytes.
    pub const TAG_BYTES_MAX: usize = 16;

    /// Tags of `tag_bytes` (1 to 16) bytes with the team's `key` of 16 to 64 random bytes, for one `mission`.
    ///
    /// # Errors
    /// [`LinkError::OutOfRange`] for another length of key or tag; the key itself is in no message.
    pub fn new(key: &[u8], tag_bytes: usize, mission: u64) -> Result<Self, LinkError> {
        let (least, most) = (Self::KEY_BYTES_MIN as f64, Self::KEY_BYTES_MAX as f64);
        within("bytes in the team's key", key.len() as f64, least, most)?;
        within("bytes in an authentication tag", tag_bytes as f64, 1.0, Self::TAG_BYTES_MAX as f64)?;
        let mut derive = keyed(key)?;
        derive.update(DOMAIN);
        // At most 16, as checked above.
        derive.update(&[tag_bytes as u8]);
        derive.update(&mission.to_be_bytes());
        let derived = Zeroizing::new(<[u8; 32]>::from(derive.finalize().into_bytes()));
        Ok(Self { keyed: keyed(derived.as_slice())?, tag_bytes })
    }

    /// Bytes that a tag adds to a packet.
    #[must_use]
    pub fn tag_bytes(&self) -> usize {
        self.tag_bytes
    }

    fn mac(&self, packet: &[u8], sender: u16, tol_ns: i64) -> Hmac<Sha256> {
        let mut mac = self.keyed.clone();
        mac.update(packet);
        mac.update(&implied_bytes(sender, tol_ns));
        mac
    }

    /// The packet with its tag, for the slot of `sender` at `tol_ns`.
    #[must_use]
    pub fn append_tag(&self, packet: &[u8], sender: u16, tol_ns: i64) -> Vec<u8> {
        let tag = self.mac(packet, sender, tol_ns).finalize().into_bytes();
        let mut tagged = Vec::with_capacity(packet.len() + self.tag_bytes);
        tagged.extend_from_slice(packet);
        tagged.extend(tag.iter().take(self.tag_bytes));
        tagged
    }

    /// The packet without its tag, which is compared in constant time.
    ///
    /// # Errors
    /// [`LinkError::Unauthentic`] for bytes that no holder of the key tagged for this sender, launch time and mission.
    pub fn check_tag<'a>(&self, tagged: &'a [u8], sender: u16, tol_ns: i64) -> Result<&'a [u8], LinkError> {
        let unauthentic = LinkError::Unauthentic { bytes: tagged.len(), sender, tol_ns };
        let Some(split) = tagged.len().checked_sub(self.tag_bytes) else { return Err(unauthentic) };
        let (packet, tag) = tagged.split_at(split);
        match self.mac(packet, sender, tol_ns).verify_truncated_left(tag) {
            Ok(()) => Ok(packet),
            Err(_) => Err(unauthentic),
        }
    }
}

fn keyed(key: &[u8]) -> Result<Hmac<Sha256>, LinkError> {
    // HMAC takes keys of any length; the error exists for other MACs of the same trait.
    Hmac::new_from_slice(key).map_err(|_| LinkError::OutOfRange {
        quantity: "bytes in the team's key",
        value: key.len() as f64,
        minimum: Authenticator::KEY_BYTES_MIN as f64,
        maximum: Authenticator::KEY_BYTES_MAX as f64,
    })
}

/// Never shows the key.
impl fmt::Debug for Authenticator {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Authenticator").field("tag_bytes", &self.tag_bytes).finish_non_exhaustive()
    }
}

/// Launch time of the newest authentic packet of each teammate: the counter that every next one must exceed.
///
/// In TDMA a sender's packets arrive in the order of their slots, so nothing honest is lost by insisting on it.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ReplayGuard {
    newest_ns: Vec<Option<i64>>,
}

impl ReplayGuard {
    /// For a team of so many vehicles, none of which was heard.
    #[must_use]
    pub fn new(vehicles: usize) -> Self {
        Self { newest_ns: vec![None; vehicles] }
    }

    /// Vehicles in the team.
    #[must_use]
    pub fn vehicles(&self) -> usize {
        self.newest_ns.len()
    }

    /// Whether an authentic packet of `sender` launched at `tol_ns` is new. Changes nothing.
    ///
    /// # Errors
    /// [`LinkError::Replayed`] for one that is not newer than the newest; [`LinkError::OutOfRange`] for a sender that
    /// the team does not have.
    pub fn check(&self, sender: u16, tol_ns: i64) -> Result<(), LinkError> {
        match self.newest_ns.get(usize::from(sender)) {
            Some(&Some(newest_ns)) if tol_ns <= newest_ns => {
                Err(LinkError::Replayed { sender, tol_ns, newest_ns })
            }
            Some(_) => Ok(()),
            None => {
                within("sender index", f64::from(sender), 0.0, self.newest_ns.len() as f64 - 1.0).map(|_| ())
            }
        }
    }

    /// Records a packet that [`check`](Self::check) admitted.
    ///
    /// # Errors
    /// As [`check`](Self::check); nothing has changed then.
    pub fn commit(&mut self, sender: u16, tol_ns: i64) -> Result<(), LinkError> {
        self.check(sender, tol_ns)?;
        if let Some(newest) = self.newest_ns.get_mut(usize::from(sender)) {
            *newest = Some(tol_ns);
        }
        Ok(())
    }
}
