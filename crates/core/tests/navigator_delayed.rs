//! Late and out-of-order events: whatever the order in which they come, the belief is that of everything in order.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests fail by panicking")]

mod registry;
#[allow(clippy::duplicate_mod, reason = "one small sea for several test binaries")]
mod seafloor;
mod world;

use std::cmp::Ordering;

use proptest::prelude::*;
use registry::*;
use serde_json::json;
use uwcoop_core::error::Error;
use uwcoop_core::event::{Class, Event, Payload};
use uwcoop_core::link::Authenticator;
use uwcoop_core::navigator::authenticated::authenticated;
use uwcoop_core::navigator::delayed::{Delayed, DelayedOptions, Late};
use uwcoop_core::navigator::packaged::{Options, PACKAGED, make_navigator};
use uwcoop_core::navigator::settings::Context;
use uwcoop_core::navigator::{Navigator, Outcome};
use world::{SECOND, event, fix};

const LAG_S: f64 = 20.0;
const LAG_NS: i64 = 20 * SECOND;

fn window(entry: &Entry) -> Delayed<Box<dyn Navigator>> {
    Delayed::new(entry.subject(), entry.own, DelayedOptions { late: Late::Replay, lag_s: LAG_S }).unwrap()
}

fn class(step: &Step) -> Class {
    match step {
        Step::Event(event) => event.payload.class(),
        Step::Transmit(_) => Class::Transmit,
    }
}

fn order(a: &Step, b: &Step) -> Ordering {
    match (a, b) {
        (Step::Event(a), Step::Event(b)) => a.order(b),
        _ => (time_of(a), class(a)).cmp(&(time_of(b), class(b))),
    }
}

/// What the subject was handed, in order.
fn steps(entry: &Entry) -> Vec<Step> {
    let mut steps = fly(entry).steps;
    steps.sort_by(order);
    steps
}

/// In order, without a window.
fn reference(entry: &Entry, steps: &[Step]) -> Box<dyn Navigator> {
    let mut navigator = entry.subject();
    for step in steps {
        take(navigator.as_mut(), step);
    }
    navigator
}

/// A diagnostic by its name.
fn number(navigator: &dyn Navigator, name: &str) -> f64 {
    navigator.diagnostics().iter().find(|(n, _)| *n == name).unwrap().1
}

#[test]
fn a_window_changes_nothing_while_everything_is_in_order() {
    for entry in registry() {
        let steps = steps(&entry);
        let (mut plain, mut wrapped) = (entry.subject(), window(&entry));
        for step in &steps {
            assert_eq!(take(plain.as_mut(), step), take(&mut wrapped, step), "{} at {step:?}", entry.name);
        }
        assert!(wrapped.inner().snapshot().unwrap() == plain.snapshot().unwrap(), "{}", entry.name);
        assert_eq!(number(&wrapped, "late_replayed"), 0.0, "{}", entry.name);
        assert_eq!(wrapped.profile(), plain.profile());
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 4, failure_persistence: None, ..ProptestConfig::default() })]

    /// Everything comes up to a lag after its time, launches too.
    #[test]
    fn any_permutation_within_the_lag_gives_the_same_bits(seed in any::<u64>(), share in 0.02..0.6f64) {
        for entry in registry() {
            let steps = steps(&entry);
            let whole = reference(&entry, &steps).snapshot().unwrap();
            let mut state = seed;
            let mut uniform = || {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (state >> 11) as f64 / (1u64 << 53) as f64
            };
            let mut coming: Vec<(i64, &Step)> = steps
                .iter()
                .map(|step| {
                    let late = uniform() < share;
                    let delay_ns = if late { (uniform() * LAG_NS as f64) as i64 } else { 0 };
                    (time_of(step) + delay_ns, step)
                })
                .collect();
            coming.sort_by_key(|(t_ns, _)| *t_ns);
            let mut wrapped = window(&entry);
            for (_, step) in coming {
                take(&mut wrapped, step);
            }
            prop_assert!(wrapped.inner().snapshot().unwrap() == whole, "{}", entry.name);
            prop_assert!(number(&wrapped, "late_replayed") > 0.0);
            prop_assert_eq!(number(&wrapped, "late_rejected"), 0.0);
        }
    }
}

/// A fix of one's own place, so late that packets were sent in the meantime.
#[test]
fn a_fix_fifteen_seconds_late_takes_its_place_and_packets_stay_what_they_were() {
    let (mut outdated, mut noticed) = (0.0, 0);
    for entry in registry() {
        let mut all = steps(&entry);
        let at_ns = 20 * SECOND;
        let late = Step::Event(fix(at_ns, entry.own, place(entry.own, at_ns), 4.0));
        let mut wrapped = window(&entry);
        for step in all.iter().filter(|step| time_of(step) < at_ns + 15 * SECOND) {
            take(&mut wrapped, step);
        }
        let Step::Event(fix) = &late else { unreachable!() };
        let plain = wrapped.inner().snapshot().unwrap();
        wrapped.handle(fix).unwrap();
        noticed += usize::from(wrapped.inner().snapshot().unwrap() != plain);
        for step in all.iter().filter(|step| time_of(step) >= at_ns + 15 * SECOND) {
            take(&mut wrapped, step);
        }
        assert_eq!(number(&wrapped, "late_replayed"), 1.0, "{}", entry.name);
        outdated += number(&wrapped, "late_packets_outdated");
        all.push(late);
        all.sort_by(order);
        let whole = reference(&entry, &all).snapshot().unwrap();
        assert!(wrapped.inner().snapshot().unwrap() == whole, "{}", entry.name);
    }
    assert!(noticed > 20, "{noticed} navigators took notice");
    assert!(outdated > 5.0, "{outdated} packets would be others by now");
}

#[test]
fn what_is_older_than_the_lag_is_rejected_and_counted() {
    for entry in registry() {
        let mut wrapped = window(&entry);
        for step in steps(&entry) {
            take(&mut wrapped, &step);
        }
        let before = wrapped.inner().snapshot().unwrap();
        let rejected = wrapped.estimate(END_S * SECOND).rejected;
        let old =
            event(END_S * SECOND - LAG_NS - 1, entry.own, Payload::Depth { depth_m: 3.0, sigma_m: 0.1 });
        assert_eq!(wrapped.handle(&old).unwrap(), Outcome::Rejected, "{}", entry.name);
        assert!(wrapped.inner().snapshot().unwrap() == before, "{}", entry.name);
        assert_eq!(wrapped.estimate(END_S * SECOND).rejected, rejected + 1, "{}", entry.name);
        assert_eq!(number(&wrapped, "late_rejected"), 1.0);
    }
}

#[test]
fn what_is_refused_changes_nothing_late_or_not() {
    for entry in registry() {
        let mut wrapped = window(&entry);
        for step in steps(&entry) {
            take(&mut wrapped, &step);
        }
        let before = wrapped.snapshot().unwrap();
        for t_ns in [END_S * SECOND - 5 * SECOND, END_S * SECOND + SECOND] {
            let wrong = [
                event(t_ns, entry.other(), Payload::Depth { depth_m: 3.0, sigma_m: 0.1 }),
                event(t_ns, entry.own, Payload::Depth { depth_m: f64::NAN, sigma_m: 0.1 }),
                event(
                    t_ns,
                    entry.own,
                    Payload::Reception { sender: 9, tol_ns: t_ns, toa_ns: t_ns, bytes: [0; 9].into() },
                ),
            ];
            for event in &wrong {
                // The last is of a vehicle that only those who listen know.
                if wrapped.handle(event).is_ok() {
                    assert!(matches!(event.payload, Payload::Reception { .. }), "{} {event:?}", entry.name);
                    wrapped.restore(&before).unwrap();
                }
                assert!(wrapped.snapshot().unwrap() == before, "{} changed by {event:?}", entry.name);
            }
        }
    }
}

#[test]
fn a_snapshot_holds_the_window_and_a_spoilt_one_is_refused() {
    for entry in registry() {
        let steps = steps(&entry);
        let (mut whole, mut resumed) = (window(&entry), window(&entry));
        let late: Vec<&Step> = steps.iter().filter(|step| time_of(step) / SECOND % 7 == 3).collect();
        let mut coming: Vec<(i64, &Step)> = steps
            .iter()
            .map(|step| {
                (
                    time_of(step) + if late.iter().any(|l| std::ptr::eq(*l, step)) { 9 * SECOND } else { 0 },
                    step,
                )
            })
            .collect();
        coming.sort_by_key(|(t_ns, _)| *t_ns);
        for (i, (_, step)) in coming.iter().enumerate() {
            if i % 40 == 39 {
                let snapshot = resumed.snapshot().unwrap();
                let mut next = window(&entry);
                for spoilt in [&snapshot[..snapshot.len() / 2], &[7; 12]] {
                    assert!(next.restore(spoilt).is_err(), "{}", entry.name);
                }
                next.restore(&snapshot).unwrap();
                resumed = next;
            }
            assert_eq!(take(&mut whole, step), take(&mut resumed, step), "{}", entry.name);
        }
        assert!(whole.snapshot().unwrap() == resumed.snapshot().unwrap(), "{}", entry.name);
    }
}

/// An hour of events at 20 Hz: what is kept does not grow.
#[test]
fn the_window_is_bounded() {
    let entry = registry().into_iter().find(|entry| entry.name == "mpf").unwrap();
    let mut wrapped = window(&entry);
    let mut sizes = Vec::new();
    for tick in 0..72_000i64 {
        let t_ns = tick * SECOND / 20;
        wrapped.handle(&event(t_ns, entry.own, Payload::Depth { depth_m: 3.0, sigma_m: 0.1 })).unwrap();
        if tick % 12_000 == 11_999 {
            sizes.push(wrapped.snapshot().unwrap().len());
        }
    }
    let (least, most) = (sizes.iter().min().unwrap(), sizes.iter().max().unwrap());
    assert!(*most < least + least / 2 && *most < 2_000_000, "{sizes:?} bytes");
}

fn options(late: &str) -> Options {
    json!({ "late": late, "lag_s": LAG_S }).as_object().unwrap().clone()
}

#[test]
fn every_packaged_navigator_has_the_options() {
    let context =
        Context { vehicle: 0, vehicles: 2, sound_speed_mps: 1500.0, seed: 4, ranging: &[true, false] };
    let depth = |t_ns| event(t_ns, 0, Payload::Depth { depth_m: 3.0, sigma_m: 0.1 });
    let mut made = 0;
    for one in PACKAGED.iter().filter(|one| !one.method.central) {
        let mut plain = make_navigator(one.name, &context, &Options::new(), None).unwrap();
        let mut wrapped = make_navigator(one.name, &context, &options("replay"), None).unwrap();
        for navigator in [&mut plain, &mut wrapped] {
            navigator.handle(&fix(0, 0, [5.0, 5.0], 4.0)).unwrap();
            navigator.handle(&depth(10 * SECOND)).unwrap();
        }
        let refused = plain.handle(&depth(5 * SECOND));
        assert!(matches!(refused, Err(Error::FromThePast { .. })), "{}: {refused:?}", one.name);
        wrapped.handle(&depth(5 * SECOND)).unwrap();
        made += 1;

        let bad = json!({ "late": "replay", "lag_s": 0.0 });
        let said =
            make_navigator(one.name, &context, bad.as_object().unwrap(), None).err().unwrap().to_string();
        assert_eq!(said, "lag_s is 0, outside 0.1 to 600");
        let said = make_navigator(one.name, &context, &options("refuse"), None).err().unwrap().to_string();
        assert_eq!(said, format!("navigator.{}.lag_s: not read, because late is \"refuse\"", one.name));
    }
    assert!(made > 15);
}

/// A launch takes some navigators ahead of all events: what comes then for an earlier time is late, not an error.
#[test]
fn inflated_an_event_from_before_a_launch_is_late() {
    let context =
        Context { vehicle: 0, vehicles: 2, sound_speed_mps: 1500.0, seed: 4, ranging: &[true, true] };
    let mut made = 0;
    for one in PACKAGED.iter().filter(|one| !one.method.central) {
        let Ok(mut navigator) = make_navigator(one.name, &context, &options("inflate"), None) else {
            continue;
        };
        navigator.handle(&fix(0, 0, [5.0, 5.0], 4.0)).unwrap();
        if navigator.transmit(8 * SECOND, 100_000).is_err() {
            continue;
        }
        for second in [6, 7] {
            let outcome = navigator.handle(&fix(second * SECOND, 0, [5.0, 5.0], 4.0)).unwrap();
            assert!(matches!(outcome, Outcome::Fused | Outcome::Noted | Outcome::Rejected), "{}", one.name);
        }
        navigator.handle(&fix(9 * SECOND, 0, [5.0, 5.0], 4.0)).unwrap();
        made += 1;
    }
    assert!(made > 12, "{made}");
}

/// Tags lie within the window: a packet that comes after a later one of the same sender is checked in its place.
#[test]
fn tags_are_checked_in_order_however_packets_come() {
    let key = Authenticator::new(&[7; 16], 4, 1).unwrap();
    let context = |vehicle| Context { vehicle, vehicles: 2, sound_speed_mps: 1500.0, seed: 4, ranging: &[] };
    let make = |vehicle| {
        let navigator = make_navigator("mpf", &context(vehicle), &options("replay"), None).unwrap();
        authenticated(navigator, vehicle, 2, key.clone())
    };
    let (mut sender, mut receiver) = (make(0), make(1));
    sender.handle(&fix(0, 0, [0.0, 0.0], 4.0)).unwrap();
    receiver.handle(&fix(0, 1, [100.0, 0.0], 4.0)).unwrap();
    let packets: Vec<Event> = [2, 4]
        .map(|second| {
            let bytes = sender.transmit(second * SECOND, 64).unwrap().unwrap();
            world::reception(second * SECOND + SECOND, 1, 0, second * SECOND, 100.0, &bytes)
        })
        .to_vec();
    let mut in_order = make(1);
    in_order.handle(&fix(0, 1, [100.0, 0.0], 4.0)).unwrap();
    for packet in &packets {
        assert_eq!(in_order.handle(packet).unwrap(), Outcome::Fused);
    }
    for packet in packets.iter().rev() {
        assert_eq!(receiver.handle(packet).unwrap(), Outcome::Fused);
    }
    let at_ns = 6 * SECOND;
    assert_eq!(format!("{:?}", receiver.estimate(at_ns)), format!("{:?}", in_order.estimate(at_ns)));
    assert_eq!(number(receiver.as_ref(), "late_replayed"), 1.0);
}
