//! What every navigator keeps: a refused event changes nothing, a rejected packet only its counts, an estimate nothing;
//! a snapshot holds everything; whatever validates leaves a belief that is one.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests fail by panicking")]

mod registry;
#[allow(clippy::duplicate_mod, reason = "one small sea for several test binaries")]
mod seafloor;
mod world;

use std::sync::Arc;

use proptest::prelude::*;
use registry::*;
use uwcoop_core::event::{BOUNDS, Event, Kind, Payload, TIME_NS, TRAVEL_NS};
use uwcoop_core::navigator::{Estimate, Navigator, Outcome, Status};
use uwcoop_core::packet::{append_crc, check_crc};
use world::{SECOND, distance, event, reception};

/// Everything has happened then.
const NOW: i64 = END_S * SECOND + SECOND;

/// A navigator that has flown the mission, and what happened to it.
fn flown(entry: &Entry) -> (Box<dyn Navigator>, Flown) {
    let flown = fly(entry);
    let mut navigator = entry.subject();
    for step in &flown.steps {
        take(navigator.as_mut(), step);
    }
    (navigator, flown)
}

/// An estimate's bits but for the count.
fn belief_bits(e: &Estimate) -> Vec<u64> {
    let yaw = e.yaw.iter().flat_map(|(yaw, covariance)| std::iter::once(yaw).chain(covariance));
    let numbers = e.mean_m.iter().chain(&e.covariance_m2).chain(e.ess.iter()).chain(yaw);
    numbers.map(|x| x.to_bits()).chain([e.status as u64]).collect()
}

/// Why an estimate is not one: `None` for finite numbers with a covariance that is positive definite to rounding.
fn flaw(e: &Estimate) -> Option<&'static str> {
    if e.status == Status::NotStarted {
        let told =
            e.mean_m.iter().all(|x| x.is_nan()) && e.covariance_m2 == [f64::INFINITY, 0.0, f64::INFINITY];
        return (!told).then_some("claims something before the start");
    }
    let [ee, en, nn] = e.covariance_m2;
    if ![e.mean_m[0], e.mean_m[1], ee, en, nn].iter().all(|x| x.is_finite()) {
        return Some("not finite");
    }
    if ee < 0.0 || nn < 0.0 || en * en > ee * nn * (1.0 + 1e-9) + 1e-300 {
        return Some("not positive definite");
    }
    if let Some((yaw, [ye, yn, yy])) = e.yaw
        && !([yaw, ye, yn, yy].iter().all(|x| x.is_finite()) && yy >= 0.0)
    {
        return Some("yaw is none");
    }
    None
}

#[test]
fn the_mission_uses_what_the_registry_holds() {
    let names: Vec<&str> = registry().iter().map(|entry| entry.name).collect();
    assert_eq!(names.len(), 29, "a new navigator is one entry more: {names:?}");
    for entry in registry() {
        let (navigator, flown) = flown(&entry);
        let fused = flown.heard.iter().filter(|h| h.outcome == Outcome::Fused).count();
        let hears = navigator.profile().uses.contains(Kind::Reception);
        assert!(!hears || fused > 0, "{} fused none of {} packets", entry.name, flown.heard.len());
        let estimate = navigator.estimate(NOW);
        let error = distance(estimate.mean_m, place(entry.own, NOW));
        assert!(error < 40.0, "{} is {error} m off: {estimate:?}", entry.name);
    }
}

/// Every number of every kind of event just outside its bound, or not one at all.
fn spoilt(peer: u16) -> Vec<Payload> {
    let mut all = Vec::new();
    for kind in kinds_with_numbers() {
        let bounds = bounds_of(kind);
        let usual: Vec<f64> = bounds.iter().map(|bound| usual(bound)).collect();
        for (field, bound) in bounds.iter().enumerate() {
            let beyond = 1e-9 * bound.maximum.abs().max(1.0);
            let mut values =
                vec![f64::INFINITY, f64::NEG_INFINITY, 1e308, bound.maximum + beyond, bound.minimum - beyond];
            if bound.above {
                values.push(bound.minimum);
            }
            // A missing measurement of a mutual positioning is none to refuse.
            values.push(f64::NAN);
            for value in values {
                let mut numbers = usual.clone();
                numbers[field] = value;
                all.push(payload_of(kind, &numbers, peer, NOW));
            }
        }
    }
    for covariance_m2 in [[1.0, 1.5, 1.0], [1.0, -1.5, 1.0], [1e-8, 1.0, 1.0]] {
        all.push(Payload::Fix { position_m: [0.0; 2], covariance_m2 });
    }
    for covariance in [
        [1.0, 2.0, 0.0, 1.0, 0.0, 1.0],
        [0.0, 0.1, 0.0, 1.0, 0.0, 1.0],
        // Each pair is possible, the three together are not.
        [1.0, 0.9, 0.9, 1.0, -0.9, 1.0],
    ] {
        all.push(Payload::Odometry { displacement_m: [0.0; 2], yaw_change_rad: 0.0, covariance });
    }
    all
}

/// Receptions whose times belong to no signal.
fn impossible_times(own: u16, other: u16, bytes: &Arc<[u8]>) -> Vec<Event> {
    let times = [
        // Launched after its arrival; arrived after it was decoded; years under way; of no clock.
        (NOW, NOW - 1),
        (NOW + SECOND, NOW + 2 * SECOND),
        (NOW, i64::MAX),
        (NOW - TRAVEL_NS - SECOND, NOW),
        (i64::MIN, NOW),
        (i64::MIN, i64::MAX),
        (-TIME_NS - 1, -TIME_NS - 1),
    ];
    let heard = |(tol_ns, toa_ns)| {
        event(
            NOW + SECOND / 2,
            own,
            Payload::Reception { sender: other, tol_ns, toa_ns, bytes: bytes.clone() },
        )
    };
    times.into_iter().map(heard).collect()
}

#[test]
fn what_no_honest_source_sends_is_refused_and_changes_nothing() {
    for entry in registry() {
        let (mut navigator, flown) = flown(&entry);
        let bytes = flown.heard.last().map_or_else(
            || Arc::from([0u8; 15].as_slice()),
            |h| match &h.event.payload {
                Payload::Reception { bytes, .. } => bytes.clone(),
                _ => unreachable!(),
            },
        );
        let (own, other) = (entry.own, entry.other());
        let mut bad: Vec<Event> = spoilt(other).into_iter().map(|p| event(NOW + SECOND, own, p)).collect();
        bad.extend(impossible_times(own, other, &bytes));
        // Of another vehicle, from the past, from nobody, from itself, at a time of no clock.
        bad.push(event(NOW, other, Payload::Landed));
        bad.push(event(NOW, 7, Payload::Landed));
        bad.push(event(END_S * SECOND - 1, own, Payload::Landed));
        bad.push(event(i64::MIN, own, Payload::Landed));
        bad.push(event(i64::MAX, own, Payload::Landed));
        bad.push(event(TIME_NS + 1, own, Payload::Landed));
        for sender in [own, 2, 15, 16, u16::MAX] {
            bad.push(reception(NOW, own, sender, NOW - SECOND, 50.0, &bytes));
        }
        assert!(bad.len() > 150, "there are events to refuse");
        for mut navigator in [navigator.as_mut(), entry.subject().as_mut()] {
            let before = navigator.snapshot().unwrap();
            for event in &bad {
                // One that has not begun has no past.
                if event.t_ns == END_S * SECOND - 1 && navigator.estimate(NOW).status == Status::NotStarted {
                    continue;
                }
                let refused = navigator.handle(event);
                assert!(refused.is_err(), "{} took {event:?}: {refused:?}", entry.name);
                assert!(navigator.snapshot().unwrap() == before, "{} changed by {event:?}", entry.name);
            }
            let _ = &mut navigator;
        }
    }
}

/// Receptions at the navigator's time that it must not use, however its packets are made: the last packet it heard,
/// damaged, in another slot, of another sender's slot, again, and from long ago.
fn bad_receptions(entry: &Entry, heard: &[Heard], at_ns: i64) -> Vec<Event> {
    let Some(Payload::Reception { bytes, .. }) = heard.last().map(|h| &h.event.payload) else {
        return Vec::new();
    };
    let tol_ns = at_ns - SECOND;
    let hear =
        |tol_ns: i64, bytes: &[u8]| reception(at_ns, entry.own, entry.other(), tol_ns, 40.0, &bytes.into());
    let mut all: Vec<Event> = heard
        .iter()
        .map(|h| match &h.event.payload {
            Payload::Reception { sender, tol_ns, toa_ns, bytes } => event(
                at_ns,
                entry.own,
                Payload::Reception {
                    sender: *sender,
                    tol_ns: *tol_ns,
                    toa_ns: *toa_ns,
                    bytes: bytes.clone(),
                },
            ),
            _ => unreachable!(),
        })
        .collect();
    all.push(hear(tol_ns, bytes));
    all.push(hear(tol_ns, &bytes[..bytes.len() - 1]));
    all.push(hear(tol_ns, &[bytes, [0].as_slice()].concat()));
    for zeros in [0, 1, 8, 15, 32, 64, 300] {
        all.push(hear(tol_ns, &vec![0; zeros]));
    }
    for bit in (0..8 * bytes.len()).step_by(1 + bytes.len() / 8) {
        let mut spoilt = bytes.to_vec();
        spoilt[bit / 8] ^= 1 << (bit % 8);
        all.push(hear(tol_ns, &spoilt));
    }
    all
}

/// Whether two snapshots differ in nothing but counts that went up by one.
fn only_counted(before: &[u8], after: &[u8]) -> bool {
    let differing: Vec<_> = before.iter().zip(after).filter(|(b, a)| b != a).collect();
    before.len() == after.len() && differing.len() <= 3 && differing.iter().all(|(b, a)| **a == **b + 1)
}

#[test]
fn a_packet_that_is_rejected_changes_its_counts_and_nothing_else() {
    for entry in registry() {
        let (mut navigator, flown) = flown(&entry);
        let at_ns = flown.steps.iter().map(time_of).max().unwrap().max(END_S * SECOND);
        navigator.handle(&event(at_ns, entry.own, Payload::Depth { depth_m: 3.0, sigma_m: 0.1 })).unwrap();
        let (before, belief) = (navigator.snapshot().unwrap(), belief_bits(&navigator.estimate(at_ns)));
        let bad = bad_receptions(&entry, &flown.heard, at_ns);
        for event in &bad {
            let outcome = navigator.handle(event).unwrap();
            assert_ne!(outcome, Outcome::Fused, "{} used {event:?}", entry.name);
            let after = navigator.snapshot().unwrap();
            assert!(
                only_counted(&before, &after),
                "{}: {outcome:?} changed more than counts by {event:?}",
                entry.name
            );
            assert_eq!(
                belief_bits(&navigator.estimate(at_ns)),
                belief,
                "{} changed by {event:?}",
                entry.name
            );
            navigator.restore(&before).unwrap();
        }
        let hears = navigator.profile().uses.contains(Kind::Reception);
        assert!(!hears || bad.len() > 20, "{}: {} packets to reject", entry.name, bad.len());
    }
}

/// A packet of this content as its sender would have sealed it for another slot: what a forger without a key can make.
fn sealed_again(bytes: &[u8], sender: u16, tol_ns: i64, other_ns: i64) -> Vec<u8> {
    match check_crc(bytes, sender, tol_ns) {
        Ok(payload) => append_crc(payload.to_vec(), sender, other_ns),
        Err(_) => bytes.to_vec(),
    }
}

/// The honest packet is still used after every packet that could have taken its place: whole ones whose launch or arrival
/// lies so far back that their range cannot be placed, that travelled for no time, or for longer than the sea is wide.
#[test]
fn no_packet_that_is_rejected_shuts_out_the_honest_ones() {
    for entry in registry() {
        let flown = fly(&entry);
        let mut navigator = entry.subject();
        let (mut fused, mut rejected) = (Vec::new(), 0);
        for step in &flown.steps {
            if let Step::Event(honest) = step
                && let Payload::Reception { sender, tol_ns, toa_ns, bytes } = &honest.payload
            {
                let times = [
                    (tol_ns - 900 * SECOND, toa_ns - 900 * SECOND),
                    (tol_ns - 500 * SECOND, *toa_ns),
                    (*toa_ns, *toa_ns),
                    (*tol_ns, honest.t_ns),
                    (honest.t_ns, honest.t_ns),
                ];
                for (other_ns, toa_ns) in times {
                    let bytes = sealed_again(bytes, *sender, *tol_ns, other_ns).into();
                    let payload = Payload::Reception { sender: *sender, tol_ns: other_ns, toa_ns, bytes };
                    // At the honest packet's own time, so that nothing but the packet can make a difference.
                    let nothing = event(honest.t_ns, entry.own, Payload::Delivered { tol_ns: 0, to: 9 });
                    navigator.handle(&nothing).unwrap();
                    let before = navigator.snapshot().unwrap();
                    let outcome = navigator.handle(&Event { payload, ..*honest }).unwrap();
                    let after = navigator.snapshot().unwrap();
                    if outcome == Outcome::Rejected {
                        assert!(
                            only_counted(&before, &after),
                            "{}: launch {other_ns}, arrival {toa_ns}",
                            entry.name
                        );
                        rejected += 1;
                    }
                    navigator.restore(&before).unwrap();
                }
                fused.push(navigator.handle(honest).unwrap());
                continue;
            }
            take(navigator.as_mut(), step);
        }
        let honest: Vec<Outcome> = flown.heard.iter().map(|h| h.outcome).collect();
        assert_eq!(fused, honest, "{}", entry.name);
        let hears = navigator.profile().takes_ranges;
        assert!(!hears || rejected > 0, "{} rejected none", entry.name);
    }
}

#[test]
fn an_estimate_changes_nothing_and_is_one_at_any_time() {
    for entry in registry() {
        let (navigator, _) = flown(&entry);
        let before = navigator.snapshot().unwrap();
        for t_ns in [0, NOW / 2, NOW - 1, NOW, NOW + 7 * SECOND, NOW + 1000 * SECOND] {
            let first = navigator.estimate(t_ns);
            assert_eq!(flaw(&first), None, "{} at {t_ns} ns: {first:?}", entry.name);
            assert_eq!(format!("{first:?}"), format!("{:?}", navigator.estimate(t_ns)), "{}", entry.name);
            let _ = (navigator.particles(), navigator.diagnostics(), navigator.information_nat());
        }
        assert!(navigator.snapshot().unwrap() == before, "{}", entry.name);
        let fresh = entry.subject();
        assert_eq!(flaw(&fresh.estimate(NOW)), None, "{}: {:?}", entry.name, fresh.estimate(NOW));
    }
}

#[test]
fn a_snapshot_at_every_step_goes_on_as_if_nothing_had_happened() {
    for entry in registry() {
        let flown = fly(&entry);
        let (mut whole, mut resumed) = (entry.subject(), entry.subject());
        for step in &flown.steps {
            let mut next = entry.subject();
            let snapshot = resumed.snapshot().unwrap();
            next.restore(&snapshot).unwrap();
            assert!(next.snapshot().unwrap() == snapshot, "{} at {step:?}", entry.name);
            resumed = next;
            assert_eq!(
                take(whole.as_mut(), step),
                take(resumed.as_mut(), step),
                "{} at {step:?}",
                entry.name
            );
            let t_ns = time_of(step);
            let (a, b) = (whole.estimate(t_ns), resumed.estimate(t_ns));
            assert_eq!(belief_bits(&a), belief_bits(&b), "{} at {step:?}", entry.name);
            assert_eq!(a.rejected, b.rejected, "{} at {step:?}", entry.name);
        }
    }
}

#[test]
fn a_snapshot_of_something_else_is_refused_and_changes_nothing() {
    for entry in registry() {
        let (mut navigator, _) = flown(&entry);
        let before = navigator.snapshot().unwrap();
        for spoilt in [&before[..before.len() / 2], &[], &[0xFF; 40]] {
            assert!(navigator.restore(spoilt).is_err(), "{}", entry.name);
            assert!(navigator.snapshot().unwrap() == before, "{}", entry.name);
        }
    }
}

#[test]
fn a_slot_too_short_is_refused_and_changes_nothing_but_counts() {
    for entry in registry() {
        let flown = fly(&entry);
        let mut navigator = entry.subject();
        let mut talks = 0;
        for step in &flown.steps {
            if let Step::Transmit(tol_ns) = step {
                let before = navigator.snapshot().unwrap();
                if navigator.transmit(*tol_ns, 1).is_err() {
                    let after = navigator.snapshot().unwrap();
                    assert!(only_counted(&before, &after), "{} at {tol_ns} ns", entry.name);
                    talks += 1;
                }
                navigator.restore(&before).unwrap();
            }
            let packet = take(navigator.as_mut(), step);
            if let (Some(bytes), Step::Transmit(tol_ns)) = (packet, step) {
                let checked = check_crc(&bytes, entry.own, *tol_ns).is_ok();
                assert_eq!(checked, navigator.profile().has_checksum, "{}", entry.name);
                talks -= 1;
            }
        }
        assert_eq!(talks, 0, "{}: every packet was refused a slot of one byte", entry.name);
    }
}

#[test]
fn a_kind_that_the_profile_does_not_name_changes_nothing() {
    for entry in registry() {
        let (mut navigator, flown) = flown(&entry);
        let at_ns = flown.steps.iter().map(time_of).max().unwrap().max(END_S * SECOND);
        let profile = navigator.profile();
        navigator.handle(&event(at_ns, entry.own, Payload::Delivered { tol_ns: at_ns, to: 9 })).unwrap();
        let before = belief_bits(&navigator.estimate(at_ns));
        let bare = [Payload::Landed, Payload::LiftedOff, Payload::RoleTaken { landmark: true }];
        let numbers = kinds_with_numbers().into_iter().map(|kind| {
            let usual: Vec<f64> = bounds_of(kind).iter().map(|bound| usual(bound)).collect();
            payload_of(kind, &usual, entry.other(), at_ns)
        });
        for payload in numbers.chain(bare).filter(|payload| !profile.uses.contains(payload.kind())) {
            let outcome = navigator.handle(&event(at_ns, entry.own, payload.clone())).unwrap();
            assert_eq!(outcome, Outcome::Noted, "{} {payload:?}", entry.name);
            assert_eq!(belief_bits(&navigator.estimate(at_ns)), before, "{} {payload:?}", entry.name);
        }
    }
}

#[test]
fn the_flags_of_profiles_are_those_of_the_methods() {
    for entry in registry() {
        let profile = entry.subject().profile();
        let no_ranges = entry.name.starts_with("landmark")
            || ["dead-reckoning", "terrain-only", "mpf-terrain-only", "team, ranges unused", "local-only"]
                .contains(&entry.name);
        assert_eq!(profile.takes_ranges, !no_ranges, "{}", entry.name);
        assert_eq!(profile.needs_delivery_oracle, entry.name == "deif", "{}", entry.name);
        assert_eq!(profile.uses.contains(Kind::Delivered), entry.name == "deif", "{}", entry.name);
    }
}

/// A number within its bound: usual, small, or at either end.
fn number(minimum: f64, maximum: f64, above: bool) -> impl Strategy<Value = f64> {
    let least = if above { f64::MIN_POSITIVE } else { minimum };
    prop_oneof![
        6 => (-3.0..3.0f64).prop_map(move |x| x.clamp(least, maximum)),
        2 => (-500.0..500.0f64).prop_map(move |x| x.clamp(least, maximum)),
        1 => Just(0.0f64.clamp(least, maximum)),
        1 => Just(least),
        1 => Just(maximum),
    ]
}

fn any_payload() -> impl Strategy<Value = (Kind, Vec<f64>)> {
    let kinds = kinds_with_numbers();
    prop::sample::select(kinds).prop_flat_map(|kind| {
        let numbers: Vec<_> = BOUNDS
            .iter()
            .filter(|bound| bound.kind == kind)
            .map(|bound| number(bound.minimum, bound.maximum, bound.above))
            .collect();
        (Just(kind), numbers)
    })
}

/// Cases of a property: few by default, as many as `UWCOOP_FUZZ_CASES` says.
fn cases(few: u32) -> ProptestConfig {
    let cases = std::env::var("UWCOOP_FUZZ_CASES").ok().and_then(|text| text.parse().ok()).unwrap_or(few);
    ProptestConfig { cases, failure_persistence: None, ..ProptestConfig::default() }
}

proptest! {
    #![proptest_config(cases(24))]

    /// Whatever validates, in any order and with any pause, leaves a belief that is one; whatever is refused, nothing.
    #[test]
    fn any_event_that_validates_leaves_a_belief_that_is_one(
        start in 0..40usize,
        events in prop::collection::vec((any_payload(), prop_oneof![4 => 0..3_000i64, 1 => Just(3_600_000i64)]), 1..25),
    ) {
        for entry in registry() {
            let mut navigator = entry.subject();
            let mut t_ns = 0;
            for step in fly(&entry).steps.iter().take(start) {
                take(navigator.as_mut(), step);
                t_ns = t_ns.max(time_of(step));
            }
            for ((kind, numbers), pause_ms) in &events {
                t_ns += pause_ms * 1_000_000;
                let payload = payload_of(*kind, numbers, entry.other(), t_ns);
                let happened = event(t_ns, entry.own, payload);
                let before = navigator.snapshot().unwrap();
                match navigator.handle(&happened) {
                    Ok(_) => prop_assert!(happened.validate().is_ok()),
                    Err(error) => {
                        let same = navigator.snapshot().unwrap() == before;
                        prop_assert!(same, "{} changed by {happened:?}: {error}", entry.name);
                    }
                }
                for ahead_ns in [0, SECOND] {
                    let estimate = navigator.estimate(t_ns + ahead_ns);
                    prop_assert_eq!(flaw(&estimate), None, "{} after {:?}: {:?}", entry.name, happened, estimate);
                }
            }
        }
    }
}
