//! Packets of every kind by the million, numbers at the ends of their range, fixes that are nearly singular, and a corpus of
//! packets that once did something: never a panic, never a belief that is none, and what is rejected changes nothing.
//!
//! The large counts are ignored by default: `make hostile` runs them; `UWCOOP_PACKETS` says how many there are.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests fail by panicking")]

mod hostile;
mod registry;
#[allow(clippy::duplicate_mod, reason = "one small sea for several test binaries")]
mod seafloor;
mod world;

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use hostile::*;
use proptest::prelude::*;
use registry::*;
use uwcoop_core::event::Payload;
use uwcoop_core::navigator::{Navigator, Outcome};
use world::{SECOND, event};

/// Rejected packets between two looks at the state: so few that a counter stays within its byte of the snapshot.
const BATCH: usize = 60;

/// What came of many packets.
#[derive(Debug, Default)]
struct Tally {
    rejected: usize,
    other: usize,
}

/// Throws packets at one navigator. Those that it rejects are handed, a batch at a time, to one that stands where this one
/// began: nothing but counters has changed there after all of them.
fn assault(entry: &Entry, target: &Target, packets: usize, seal: bool, seed: u64) -> Tally {
    let mut random = Random(seed);
    let (mut navigator, mut other) = (restored(entry, target), restored(entry, target));
    let (mut tally, mut rejected) = (Tally::default(), Vec::with_capacity(BATCH));
    for k in 0..packets {
        let payload = made_up(&mut random, &target.payload);
        let bytes = if seal { target.sealed(payload) } else { payload };
        if target.hand(navigator.as_mut(), &bytes) == Outcome::Rejected {
            tally.rejected += 1;
            rejected.push(bytes);
        } else {
            tally.other += 1;
            let flaw = target.flaw(navigator.as_ref());
            assert!(flaw.is_none(), "{flaw:?} after {}", hex(&bytes));
            navigator.restore(&target.snapshot).unwrap();
        }
        if rejected.len() == BATCH || k + 1 == packets {
            check_rejected(other.as_mut(), target, &rejected);
            other.restore(&target.snapshot).unwrap();
            rejected.clear();
        }
    }
    tally
}

fn check_rejected(navigator: &mut dyn Navigator, target: &Target, rejected: &[Vec<u8>]) {
    for bytes in rejected {
        assert_eq!(target.hand(navigator, bytes), Outcome::Rejected, "{}: {}", target.name, hex(bytes));
    }
    let after = navigator.snapshot().unwrap();
    let differing = target.snapshot.iter().zip(&after).filter(|(b, a)| b != a);
    let counted: Vec<usize> = differing.map(|(b, a)| usize::from(a.wrapping_sub(*b))).collect();
    let same = after.len() == target.snapshot.len()
        && counted.len() <= 5
        // One counter for all of them, others that tell the reasons apart.
        && counted.iter().sum::<usize>() <= 2 * rejected.len()
        && (rejected.is_empty() || counted.contains(&rejected.len()));
    let packets: Vec<String> = rejected.iter().map(|bytes| hex(bytes)).collect();
    assert!(same, "{} changed by one of {packets:#?}: counts {counted:?}", target.name);
}

/// One navigator for each kind of packet.
fn one_of_each_kind() -> Vec<&'static (usize, Target)> {
    let mut kinds = BTreeMap::new();
    for target in TARGETS.iter() {
        kinds.entry(target.1.kind()).or_insert(target);
    }
    kinds.into_values().collect()
}

fn packets(usual: usize) -> usize {
    std::env::var("UWCOOP_PACKETS").ok().and_then(|text| text.parse().ok()).unwrap_or(usual)
}

#[test]
fn thousands_of_packets_at_every_navigator_with_and_without_a_check_that_fits() {
    let entries = registry();
    for (index, target) in TARGETS.iter() {
        let mut navigator = restored(&entries[*index], target);
        let honest = target.hand(navigator.as_mut(), &target.sealed(target.payload.clone()));
        assert_ne!(
            honest,
            Outcome::Rejected,
            "{}: what is altered is a packet that it would take",
            target.name
        );
        let bare = assault(&entries[*index], target, 1000, false, 1);
        assert!(bare.rejected > 300, "{}: {bare:?}", target.name);
        let sealed = assault(&entries[*index], target, 300, true, 2);
        assert!(sealed.rejected > 60, "{}: {sealed:?}", target.name);
    }
    assert!(one_of_each_kind().len() >= 10, "kinds of packets");
}

#[test]
#[ignore = "ten million packets of each kind take minutes: make hostile"]
fn ten_million_packets_of_each_kind() {
    let entries = registry();
    for (index, target) in one_of_each_kind() {
        let tally = assault(&entries[*index], target, packets(10_000_000), false, 3);
        eprintln!("{} {:?}: {tally:?}", target.name, target.kind());
    }
}

#[test]
#[ignore = "a million packets of each kind take minutes: make hostile"]
fn a_million_packets_of_each_kind_whose_check_fits() {
    let entries = registry();
    for (index, target) in one_of_each_kind() {
        let tally = assault(&entries[*index], target, packets(1_000_000), true, 4);
        eprintln!("{} {:?}: {tally:?}", target.name, target.kind());
    }
}

/// Numbers at the ends of what a float64 holds, at every bit of an honest packet where one may begin. One such packet made
/// the belief of `deif-redundant` not a number.
#[test]
fn numbers_at_the_ends_of_their_range_in_any_place_leave_a_belief_that_is_one() {
    let entries = registry();
    let mut handed = 0;
    for (index, target) in TARGETS.iter() {
        // Packets of bounded fields hold no float64.
        if target.payload.len() < 60 {
            continue;
        }
        let mut navigator = restored(&entries[*index], target);
        let every = 1 + target.payload.len() / 400 * 8;
        for first_bit in (0..8 * target.payload.len()).step_by(every) {
            let value = EXTREMES[(first_bit * 7 + first_bit / 64) % EXTREMES.len()];
            for value in [value, f64::NAN, 1e154] {
                let mut payload = target.payload.clone();
                write_number(&mut payload, first_bit, value);
                let bytes = target.sealed(payload);
                handed += 1;
                if target.hand(navigator.as_mut(), &bytes) != Outcome::Rejected {
                    let flaw = target.flaw(navigator.as_ref());
                    assert!(flaw.is_none(), "{flaw:?} after {value} at bit {first_bit}: {}", hex(&bytes));
                    navigator.restore(&target.snapshot).unwrap();
                }
            }
        }
    }
    assert!(handed > 10_000, "{handed} packets");
}

proptest! {
    #![proptest_config(cases(12))]

    /// Fixes that know one direction far better than the other, in any order with what a vehicle senses.
    #[test]
    fn fixes_that_are_nearly_singular_leave_a_belief_that_is_one(
        start in 0..60usize,
        fixes in prop::collection::vec(
            ((-8.0..3.0f64, -8.0..6.0f64, -1.0..1.0f64, 0..3u8), (-3.0..3.0f64, -3.0..3.0f64), 0..4_000i64), 1..10),
    ) {
        for entry in registry() {
            let flown = fly(&entry);
            let mut navigator = entry.subject();
            let mut t_ns = 0;
            for step in flown.steps.iter().take(start) {
                take(navigator.as_mut(), step);
                t_ns = t_ns.max(time_of(step));
            }
            for ((small, large, correlation, near), (de, dn), pause_ms) in &fixes {
                t_ns += pause_ms * 1_000_000;
                let (ee, nn) = (10f64.powf(*small), 10f64.powf(*large));
                // Two thirds of them next to the end of what a correlation can be.
                let correlation = match near {
                    0 => *correlation,
                    1 => correlation.signum() * (1.0 - 1e-9),
                    _ => 0.0,
                };
                let here = navigator.estimate(t_ns).mean_m;
                let near_m = if here[0].is_finite() { here } else { place(entry.own, t_ns) };
                let position_m = [near_m[0] + de, near_m[1] + dn];
                let covariance_m2 = [ee, correlation * (ee * nn).sqrt(), nn];
                let fix = Payload::Fix { position_m, covariance_m2 };
                let motion = Payload::GroundVelocity { velocity_mps: [1.0, 0.0], sigma_mps: 0.05 };
                let yaw = Payload::Heading { yaw_rad: 0.6, sigma_rad: 1e-6 };
                for payload in [fix, motion, yaw] {
                    let happened = event(t_ns, entry.own, payload);
                    let _ = navigator.handle(&happened);
                    for ahead_ns in [0, SECOND, 100 * SECOND] {
                        let e = navigator.estimate(t_ns + ahead_ns);
                        prop_assert!(sound(&e), "{} after {:?}: {:?}", entry.name, happened, e);
                    }
                }
            }
        }
    }
}

/// `tests/corpus/packets.txt`: a line for each packet, with the navigator that it did something to.
fn corpus_file() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/corpus/packets.txt")
}

fn unhex(text: &str) -> Vec<u8> {
    (0..text.len() / 2).map(|k| u8::from_str_radix(&text[2 * k..2 * k + 2], 16).unwrap()).collect()
}

#[test]
fn the_corpus_does_no_harm() {
    let entries = registry();
    let text = std::fs::read_to_string(corpus_file()).unwrap();
    let lines: Vec<_> = text.lines().filter(|line| !line.starts_with('#') && !line.is_empty()).collect();
    assert!(lines.len() > 100, "a corpus");
    let mut met = BTreeSet::new();
    for line in lines {
        let (name, payload) = line.rsplit_once(' ').unwrap();
        let payload = unhex(payload);
        for (index, target) in TARGETS.iter() {
            // At its own navigator, and at those whose packets begin alike.
            if target.name == name || target.kind().0 == payload.first().map_or(255, |byte| byte >> 4) {
                let mut navigator = restored(&entries[*index], target);
                receive(navigator.as_mut(), target, &target.sealed(payload.clone())).unwrap();
                met.insert(target.name);
            }
        }
    }
    assert_eq!(met.len(), TARGETS.len(), "every navigator that hears: {met:?}");
}

/// What a packet did, told coarsely: packets that do something new make the corpus.
fn effect(
    target: &Target,
    navigator: &dyn Navigator,
    outcome: Outcome,
) -> (Outcome, u64, i32, [i32; 2], usize) {
    let e = navigator.estimate(target.times[2]);
    let size = |x: f64| if x > 0.0 { x.log2().round() as i32 } else { -1000 };
    let [ee, _, nn] = e.covariance_m2;
    let told = navigator.diagnostics().iter().filter(|(_, value)| value.abs() > 0.0).count();
    (outcome, e.rejected, e.ess.map_or(0, |ess| (ess / 10.0) as i32), [size(ee) / 2, size(nn) / 2], told)
}

/// Makes the corpus anew: of many packets those that did what none before did, at most so many for a navigator.
#[test]
#[ignore = "writes tests/corpus/packets.txt"]
fn write_the_corpus() {
    const MOST: usize = 12;
    let entries = registry();
    let mut lines = vec![
        "# Packets without their check that did something new to a navigator of the registry, made by"
            .to_owned(),
        "# navigator_hostile::write_the_corpus, and after them those that once did harm.".to_owned(),
    ];
    for (index, target) in TARGETS.iter() {
        let (mut random, mut seen) = (Random(9), BTreeSet::new());
        lines.push(format!("{} {}", target.name, hex(&target.payload)));
        for _ in 0..20_000 {
            let payload = made_up(&mut random, &target.payload);
            if payload.len() > 700 || payload.is_empty() {
                continue;
            }
            let mut navigator = restored(&entries[*index], target);
            let outcome = target.hand(navigator.as_mut(), &target.sealed(payload.clone()));
            let new = seen.insert(format!("{:?}", effect(target, navigator.as_ref(), outcome)));
            if new && seen.len() <= MOST {
                lines.push(format!("{} {}", target.name, hex(&payload)));
            }
        }
    }
    let text = std::fs::read_to_string(corpus_file()).unwrap_or_default();
    let kept = text.split_once("# Once did harm\n").map_or("", |(_, kept)| kept);
    lines.push("# Once did harm".to_owned());
    std::fs::write(corpus_file(), lines.join("\n") + "\n" + kept).unwrap();
}
