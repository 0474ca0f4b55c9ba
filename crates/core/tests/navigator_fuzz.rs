//! Packets and snapshots that nobody honest made, at every navigator: never a panic, never a belief that is none, and
//! what is rejected changes nothing but counts. Overflow checks and debug assertions are on.
//!
//! Few cases by default; `UWCOOP_FUZZ_CASES` says how many (`make fuzz` runs them for a stated time).
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests fail by panicking")]

mod hostile;
mod registry;
#[allow(clippy::duplicate_mod, reason = "one small sea for several test binaries")]
mod seafloor;
mod world;

use hostile::*;
use proptest::prelude::*;
use registry::*;
use uwcoop_core::navigator::Navigator;
use uwcoop_core::packet::append_crc;

/// Where to change a packet, and what to write there.
fn damage() -> impl Strategy<Value = Vec<(usize, u8)>> {
    prop::collection::vec((0..400usize, any::<u8>()), 1..12)
}

proptest! {
    #![proptest_config(cases(60))]

    /// Bytes without sense, with and without a checksum that fits.
    #[test]
    fn any_bytes(bytes in prop::collection::vec(any::<u8>(), 0..120), sealed: bool, kind in 0..16u8) {
        let entries = registry();
        for (index, target) in TARGETS.iter() {
            let mut bytes = bytes.clone();
            // The first four bits name the kind of packet: most random ones would end there.
            if let Some(first) = bytes.first_mut() {
                *first = kind << 4 | *first & 15;
            }
            if sealed {
                bytes = append_crc(bytes, 1 - target.own, target.times[0]);
            }
            let mut navigator = restored(&entries[*index], target);
            receive(navigator.as_mut(), target, &bytes)?;
        }
    }

    /// A whole packet with some bytes written over, sealed again.
    #[test]
    fn packets_with_other_contents(damage in damage(), cut in prop::option::weighted(0.1, 0..400usize)) {
        let entries = registry();
        for (index, target) in TARGETS.iter() {
            let mut payload = target.payload.clone();
            for (at, byte) in &damage {
                let at = at % payload.len();
                payload[at] = *byte;
            }
            payload.truncate(cut.unwrap_or(usize::MAX));
            let mut navigator = restored(&entries[*index], target);
            receive(navigator.as_mut(), target, &target.sealed(payload))?;
        }
    }

    /// A snapshot with some bytes written over is refused and changes nothing, or is taken whole.
    #[test]
    fn snapshots_with_other_contents(damage in damage(), cut in prop::option::weighted(0.3, 0..5000usize)) {
        let entries = registry();
        for (index, target) in TARGETS.iter() {
            let mut snapshot = target.snapshot.clone();
            for (at, byte) in &damage {
                let at = at % snapshot.len();
                snapshot[at] = *byte;
            }
            snapshot.truncate(cut.unwrap_or(usize::MAX));
            let mut navigator = restored(&entries[*index], target);
            if navigator.restore(&snapshot).is_err() {
                prop_assert!(navigator.snapshot().unwrap() == target.snapshot, "{}", target.name);
            }
        }
    }
}
