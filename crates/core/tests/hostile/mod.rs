//! Navigators under way, as targets of packets that nobody honest made, and what must hold of what they do with them.
#![allow(dead_code, reason = "each test binary uses a part of it")]

use std::sync::LazyLock;

use proptest::prelude::*;
use uwcoop_core::event::Payload;
use uwcoop_core::navigator::{Estimate, Navigator, Outcome, Status};
use uwcoop_core::packet::{append_crc, check_crc};

use crate::registry::*;
use crate::world::{SECOND, event};

/// A navigator under way, as a snapshot, and a whole packet that it would take next.
pub struct Target {
    pub name: &'static str,
    pub own: u16,
    pub snapshot: Vec<u8>,
    /// Launch, arrival, and end of decoding of that packet.
    pub times: [i64; 3],
    pub payload: Vec<u8>,
    pub has_crc: bool,
}

impl Target {
    /// A payload as its sender would send it.
    pub fn sealed(&self, payload: Vec<u8>) -> Vec<u8> {
        if self.has_crc { append_crc(payload, 1 - self.own, self.times[0]) } else { payload }
    }

    /// Four bits that name the kind of packet, and whether it is a role exchange, whose first bits name another thing.
    pub fn kind(&self) -> (u8, bool) {
        let exchange = self.name.starts_with("landmark");
        (if exchange { 0 } else { self.payload[0] >> 4 }, exchange)
    }

    /// Hands a packet over.
    pub fn hand(&self, navigator: &mut dyn Navigator, bytes: &[u8]) -> Outcome {
        let [tol_ns, toa_ns, t_ns] = self.times;
        let payload = Payload::Reception { sender: 1 - self.own, tol_ns, toa_ns, bytes: bytes.into() };
        let outcome = navigator.handle(&event(t_ns, self.own, payload));
        outcome.unwrap_or_else(|error| panic!("{}: {error} after {}", self.name, hex(bytes)))
    }

    /// Why the belief after a packet is none.
    pub fn flaw(&self, navigator: &dyn Navigator) -> Option<String> {
        [0, SECOND, 100 * SECOND].into_iter().find_map(|ahead_ns| {
            let e = navigator.estimate(self.times[2] + ahead_ns);
            (!sound(&e)).then(|| format!("{}: {e:?}", self.name))
        })
    }
}

/// Whether an estimate is finite with a covariance of a Gaussian.
pub fn sound(e: &Estimate) -> bool {
    let [ee, en, nn] = e.covariance_m2;
    e.status == Status::NotStarted
        || e.mean_m.iter().chain(&e.covariance_m2).all(|x| x.is_finite())
            && ee >= 0.0
            && nn >= 0.0
            && en * en <= ee * nn * (1.0 + 1e-9) + 1e-300
}

pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Every navigator that packets reach, before a packet of the mission that it used. The index is that of the registry.
pub static TARGETS: LazyLock<Vec<(usize, Target)>> = LazyLock::new(|| {
    let targets = registry().into_iter().enumerate().filter_map(|(index, entry)| {
        let flown = fly(&entry);
        // The last that it used, if it uses any.
        let used = flown.heard.iter().rfind(|heard| heard.outcome == Outcome::Fused);
        let last = used.or(flown.heard.last())?;
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

pub fn cases(few: u32) -> ProptestConfig {
    let cases = std::env::var("UWCOOP_FUZZ_CASES").ok().and_then(|text| text.parse().ok()).unwrap_or(few);
    ProptestConfig { cases, failure_persistence: None, ..ProptestConfig::default() }
}

pub fn restored(entry: &Entry, target: &Target) -> Box<dyn Navigator> {
    let mut navigator = entry.subject();
    navigator.restore(&target.snapshot).unwrap();
    navigator
}

/// Hands a packet over and looks at what it did.
pub fn receive(
    navigator: &mut dyn Navigator,
    target: &Target,
    bytes: &[u8],
) -> Result<Outcome, TestCaseError> {
    let outcome = target.hand(navigator, bytes);
    if outcome == Outcome::Rejected {
        let after = navigator.snapshot().unwrap();
        let differing: Vec<_> = target.snapshot.iter().zip(&after).filter(|(b, a)| b != a).collect();
        let counted = differing.len() <= 3 && differing.iter().all(|(b, a)| **a == **b + 1);
        let same = after.len() == target.snapshot.len() && counted;
        prop_assert!(same, "{} changed by {}", target.name, hex(bytes));
    }
    let flaw = target.flaw(navigator);
    prop_assert!(flaw.is_none(), "{:?} after {}", flaw, hex(bytes));
    let _ = (
        navigator.transmit(target.times[2] + SECOND, CAPACITY),
        navigator.diagnostics(),
        navigator.particles(),
    );
    Ok(outcome)
}

/// Small, fast and good enough to make packets with (SplitMix64).
pub struct Random(pub u64);

impl Random {
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    pub fn below(&mut self, n: usize) -> usize {
        (self.next() % n as u64) as usize
    }
}

/// Numbers at the ends of what a float64 holds.
pub const EXTREMES: [f64; 10] =
    [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e308, -1e308, 1e154, -1e154, 1e-308, 0.0, -1.0];

/// Writes a float64 at any bit of a payload, high bit first.
pub fn write_number(payload: &mut [u8], first_bit: usize, value: f64) {
    let bits = value.to_bits();
    for k in 0..64 {
        let at = first_bit + k;
        if at < 8 * payload.len() {
            let mask = 0x80 >> (at % 8);
            if bits >> (63 - k) & 1 == 1 { payload[at / 8] |= mask } else { payload[at / 8] &= !mask }
        }
    }
}

/// A payload that nobody honest made: noise of any length, or an honest payload written over, cut, lengthened, with bits
/// turned or numbers at the ends of their range.
pub fn made_up(random: &mut Random, honest: &[u8]) -> Vec<u8> {
    let mut payload = honest.to_vec();
    match random.below(8) {
        0 => {
            let length = random.below(130);
            payload = (0..length).map(|_| random.next() as u8).collect();
        }
        1 => {
            let kind = honest[0] & 0xF0;
            payload = (0..honest.len()).map(|_| random.next() as u8).collect();
            payload[0] = kind | payload[0] & 0x0F;
        }
        2 => payload.truncate(random.below(honest.len())),
        3 => (0..=random.below(40)).for_each(|_| payload.push(random.next() as u8)),
        4 => {
            for _ in 0..=random.below(3) {
                let value = EXTREMES[random.below(EXTREMES.len())];
                write_number(&mut payload, random.below(8 * honest.len()), value);
            }
        }
        _ => {
            for _ in 0..=random.below(6) {
                let at = random.below(payload.len());
                payload[at] = if random.below(2) == 0 {
                    payload[at] ^ 1 << random.below(8)
                } else {
                    random.next() as u8
                };
            }
        }
    }
    payload
}
