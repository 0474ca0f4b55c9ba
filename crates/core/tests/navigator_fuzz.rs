//! Packets and snapshots that nobody honest made, at every navigator: never a panic, never a belief that is none, and
//! what is rejected changes nothing but counts. Overflow checks and debug assertions are on.
//!
//! Few cases by default; `UWCOOP_FUZZ_CASES` says how many (`make fuzz` runs them for a stated time).
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests fail by panicking")]

mod registry;
#[allow(clippy::duplicate_mod, reason = "one small sea for several test binaries")]
mod seafloor;
mod world;

use std::sync::LazyLock;

use proptest::prelude::*;
use registry::*;
use uwcoop_core::event::Payload;
use uwcoop_core::navigator::{Navigator, Outcome, Status};
use uwcoop_core::packet::{append_crc, check_crc};
use world::{SECOND, event};

/// A navigator under way, as a snapshot, and a whole packet that it would take next.
struct Target {
    name: &'static str,
    own: u16,
    snapshot: Vec<u8>,
    /// Launch, arrival, and end of decoding of that packet.
    times: [i64; 3],
    payload: Vec<u8>,
    has_crc: bool,
}

/// Every navigator that packets reach, before the last packet of the mission. The index is that of the registry.
static TARGETS: LazyLock<Vec<(usize, Target)>> = LazyLock::new(|| {
    let targets = registry().into_iter().enumerate().filter_map(|(index, entry)| {
        let flown = fly(&entry);
        let last = flown.heard.last()?;
        let Payload::Reception { sender, tol_ns, toa_ns, bytes } = &last.event.payload else { return None };
        let mut navigator = entry.subject();
        for step in &flown.steps {
            if matches!(step, Step::Event(event) if *event == last.event) {
                break;
            }
            take(navigator.as_mut(), step);
        }
        // Its clock stands at the end of decoding: only the packet makes a difference then.
        let t_ns = last.event.t_ns;
        let nothing = event(t_ns, entry.own, Payload::Delivered { tol_ns: 0, to: 9 });
        navigator.handle(&nothing).unwrap();
        let opened = check_crc(bytes, *sender, *tol_ns).ok();
        let target = Target {
            name: entry.name,
            own: entry.own,
            snapshot: navigator.snapshot().unwrap(),
            times: [*tol_ns, *toa_ns, t_ns],
            payload: opened.map_or_else(|| bytes.to_vec(), <[u8]>::to_vec),
            has_crc: opened.is_some(),
        };
        Some((index, target))
    });
    targets.collect()
});

fn cases(few: u32) -> ProptestConfig {
    let cases = std::env::var("UWCOOP_FUZZ_CASES").ok().and_then(|text| text.parse().ok()).unwrap_or(few);
    ProptestConfig { cases, failure_persistence: None, ..ProptestConfig::default() }
}

fn restored(entry: &Entry, target: &Target) -> Box<dyn Navigator> {
    let mut navigator = entry.subject();
    navigator.restore(&target.snapshot).unwrap();
    navigator
}

/// Hands a packet over and looks at what it did.
fn receive(navigator: &mut dyn Navigator, target: &Target, bytes: Vec<u8>) -> Result<(), TestCaseError> {
    let [tol_ns, toa_ns, t_ns] = target.times;
    let payload = Payload::Reception { sender: 1 - target.own, tol_ns, toa_ns, bytes: bytes.into() };
    let heard = event(t_ns, target.own, payload);
    let outcome = navigator.handle(&heard);
    prop_assert!(outcome.is_ok(), "{}: {:?}", target.name, outcome);
    if outcome == Ok(Outcome::Rejected) {
        let after = navigator.snapshot().unwrap();
        let differing: Vec<_> = target.snapshot.iter().zip(&after).filter(|(b, a)| b != a).collect();
        let counted = differing.len() <= 3 && differing.iter().all(|(b, a)| **a == **b + 1);
        prop_assert!(after.len() == target.snapshot.len() && counted, "{} {:?}", target.name, heard);
    }
    for ahead_ns in [0, SECOND, 100 * SECOND] {
        let e = navigator.estimate(t_ns + ahead_ns);
        let [ee, en, nn] = e.covariance_m2;
        let sound = e.mean_m.iter().chain(&e.covariance_m2).all(|x| x.is_finite())
            && ee >= 0.0
            && nn >= 0.0
            && en * en <= ee * nn * (1.0 + 1e-9) + 1e-300;
        prop_assert!(sound || e.status == Status::NotStarted, "{} {:?}: {:?}", target.name, heard, e);
    }
    let _ = (navigator.transmit(t_ns + SECOND, CAPACITY), navigator.diagnostics(), navigator.particles());
    Ok(())
}

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
            receive(navigator.as_mut(), target, bytes)?;
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
            if target.has_crc {
                payload = append_crc(payload, 1 - target.own, target.times[0]);
            }
            let mut navigator = restored(&entries[*index], target);
            receive(navigator.as_mut(), target, payload)?;
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
