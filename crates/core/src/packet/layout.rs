//! What a packet consists of, told by the code that encodes it.
//!
//! While [`record`] runs a closure, every field that this thread writes is noted: name, width, and for scaled fields
//! range, step and rounding. So a description of a packet cannot differ from the packet.

use std::cell::RefCell;

use super::Rounding;

/// Range, step and rounding of a field that stands for a number.
#[derive(Debug, Clone, PartialEq)]
pub struct Scale {
    /// Unit of the value; empty for a pure number.
    pub unit: &'static str,
    /// Least value.
    pub minimum: f64,
    /// Greatest value.
    pub maximum: f64,
    /// What one code more means.
    pub step: FieldStep,
    /// Which code stands for a value between two.
    pub rounding: Rounding,
}

/// What one code more means.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FieldStep {
    /// So much more, in the field's unit.
    Linear(f64),
    /// So many times as much.
    Factor(f64),
    /// So much more of atanh of the value.
    Atanh(f64),
    /// So much more near zero, at most a 64th of the value further out.
    Growing(f64),
}

/// One field, or several equal ones.
#[derive(Debug, Clone, PartialEq)]
pub struct FieldUse {
    /// What it holds.
    pub name: &'static str,
    /// Width of one, bits.
    pub bits: u32,
    /// How many of them there are.
    pub count: usize,
    /// What its codes mean, where it is a number; none for counters, bitmaps and bytes.
    pub scale: Option<Scale>,
}

impl FieldUse {
    /// Bits of all of them.
    #[must_use]
    pub fn total_bits(&self) -> usize {
        self.bits as usize * self.count
    }
}

const CHECKSUM: &str = "CRC-16";

thread_local! {
    static NOTES: RefCell<Option<Vec<FieldUse>>> = const { RefCell::new(None) };
}

/// Runs `encode` and gives, beside its result, the fields that it wrote, in their order; one that repeats is one entry,
/// where it came first. Not meant to be nested: the inner call takes its notes alone.
pub fn record<T>(encode: impl FnOnce() -> T) -> (T, Vec<FieldUse>) {
    let before = NOTES.replace(Some(Vec::new()));
    let result = encode();
    let notes = NOTES.replace(before).unwrap_or_default();
    (result, runs(notes))
}

/// Notes a field of so many bits, if somebody listens. Fields of no bits are not there.
pub fn note(name: &'static str, bits: u32) {
    NOTES.with_borrow_mut(|notes| {
        if let Some(notes) = notes
            && bits > 0
        {
            notes.push(FieldUse { name, bits, count: 1, scale: None });
        }
    });
}

/// Says what the codes of the field noted last mean.
pub(super) fn explain(scale: impl FnOnce() -> Scale) {
    NOTES.with_borrow_mut(|notes| {
        if let Some(last) = notes.as_mut().and_then(|notes| notes.last_mut()) {
            last.scale = Some(scale());
        }
    });
}

/// Begins anew: a packet is written into a writer of its own, and one that was given up is not sent.
pub(super) fn restart() {
    NOTES.with_borrow_mut(|notes| {
        if let Some(notes) = notes {
            notes.clear();
        }
    });
}

/// Notes the zero bits up to the end of a payload, and the checksum.
pub(super) fn note_end_of_payload(bytes: usize) {
    let written = NOTES.with_borrow(|notes| {
        notes.as_ref().map_or(bytes * 8, |notes| notes.iter().map(FieldUse::total_bits).sum())
    });
    note("zero bits", (bytes * 8).saturating_sub(written) as u32);
    note(CHECKSUM, super::CRC_BYTES as u32 * 8);
}

/// Notes a tag of so many bits; it may have taken the checksum's place.
pub(crate) fn note_tag(bits: u32, replaces_checksum: bool) {
    NOTES.with_borrow_mut(|notes| {
        if let Some(notes) = notes
            && replaces_checksum
            && notes.last().is_some_and(|last| last.name == CHECKSUM)
        {
            notes.pop();
        }
    });
    note("authentication tag", bits);
}

/// Equal fields once, with their number.
fn runs(notes: Vec<FieldUse>) -> Vec<FieldUse> {
    let mut merged: Vec<FieldUse> = Vec::new();
    for field in notes {
        let same = |f: &&mut FieldUse| f.name == field.name && f.bits == field.bits && f.scale == field.scale;
        match merged.iter_mut().find(same) {
            Some(known) => known.count += field.count,
            None => merged.push(field),
        }
    }
    merged
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests fail by panicking")]

    use super::*;
    use crate::packet::{Belief, BeliefPacket, CloudPacket, Header, HeardBitmap, PacketKind};
    use nalgebra::{Matrix2, Vector2};

    fn header(kind: PacketKind) -> Header {
        Header { kind, sequence: 3, depth_m: 2.0, heard: HeardBitmap::from_bits(1) }
    }

    fn belief(kind: PacketKind) -> BeliefPacket {
        let belief =
            Belief { mean_m: Vector2::new(1.0, 2.0), covariance_m2: Matrix2::new(4.0, 1.0, 1.0, 9.0) };
        BeliefPacket { header: header(kind), belief }
    }

    #[test]
    fn the_fields_add_up_to_the_packet() {
        for kind in [PacketKind::Belief, PacketKind::BeliefF64] {
            let (bytes, fields) = record(|| belief(kind).encode(1, 5).unwrap());
            assert_eq!(fields.iter().map(FieldUse::total_bits).sum::<usize>(), bytes.len() * 8, "{fields:?}");
        }
        let (cloud, n) = (vec![0.1; 7], 7);
        let packet = CloudPacket {
            header: header(PacketKind::Cloud),
            east: cloud.clone(),
            north: cloud.clone(),
            weights: cloud,
        };
        let (bytes, fields) = record(|| packet.encode(1, 5).unwrap());
        assert_eq!(fields.iter().map(FieldUse::total_bits).sum::<usize>(), bytes.len() * 8, "{fields:?}");
        assert_eq!(fields.iter().filter(|f| f.count == n).count(), 3, "three columns of seven: {fields:?}");
    }

    #[test]
    fn a_belief_says_what_its_documentation_says() {
        let (_, fields) = record(|| belief(PacketKind::Belief).encode(1, 5).unwrap());
        let widths: Vec<u32> = fields.iter().map(|f| f.bits).collect();
        assert_eq!(widths, [4, 8, 10, 16, 20, 20, 8, 8, 10, 16]);
        let scale = |name: &str| fields.iter().find(|f| f.name == name).unwrap().scale.clone().unwrap();
        let east = scale("mean easting");
        assert_eq!(
            (east.minimum, east.maximum, east.step),
            (-32768.0, 32767.9375, FieldStep::Linear(1.0 / 16.0))
        );
        let sigma = scale("sigma of easting");
        assert_eq!((sigma.minimum, sigma.rounding), (0.0625, Rounding::Up));
        assert!((sigma.maximum - 3922.0).abs() < 0.5);
        let depth = scale("sender's depth");
        assert_eq!((depth.unit, depth.minimum, depth.maximum), ("m", 0.0, 13_004.8));
    }

    #[test]
    fn nobody_listens_unless_asked_and_an_inner_listener_hears_alone() {
        belief(PacketKind::Belief).encode(1, 5).unwrap();
        let ((), outer) = record(|| {
            note("before", 3);
            let (_, inner) = record(|| note("inside", 4));
            assert_eq!(inner.len(), 1);
            note("nothing", 0);
            note("before", 3);
        });
        assert_eq!(outer, [FieldUse { name: "before", bits: 3, count: 2, scale: None }]);
    }
}
