//! What `team` keeps: equality with `mpf` when nobody is heard, resumption, refusals, silence and return.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests fail by panicking")]

mod world;

use std::sync::Arc;

use uwcoop_core::chart::Chart;
use uwcoop_core::event::{Event, Payload};
use uwcoop_core::navigator::team::Team;
use uwcoop_core::navigator::{Estimate, Navigator, Outcome};
use world::fleet::*;
use world::*;

const PARTICLES: usize = 300;

fn bits(e: &Estimate) -> Vec<u64> {
    e.mean_m.iter().chain(&e.covariance_m2).chain(e.ess.iter()).map(|x| x.to_bits()).collect()
}

fn fleet(chart: bool) -> Vec<Box<dyn Navigator>> {
    fleet_over(chart.then(rich), PARTICLES)
}

fn fleet_over(chart: Option<Arc<Chart>>, particles: usize) -> Vec<Box<dyn Navigator>> {
    (0..3)
        .map(|v| Box::new(team_of(v, team_options(3, particles), chart.clone())) as Box<dyn Navigator>)
        .collect()
}

/// A seabed with a twentieth of the relief: alone it says little.
fn flat_depth(east: f64, north: f64) -> f64 {
    20.0 + 0.05 * (rich_depth(east, north) - 20.0)
}

fn error_m(navigator: &dyn Navigator, v: u16, t_s: i64) -> f64 {
    distance(navigator.estimate(t_s * SECOND).mean_m, track(v, t_s as f64))
}

#[test]
fn who_hears_nobody_is_mpf_without_ranges_bit_for_bit() {
    let chart = rich();
    let mut options = mpf_options(PARTICLES);
    options.range = None;
    let mut alone = mpf::<2>(1, 3, options, &chart, 5);
    let mut team = team_of(1, team_options(3, PARTICLES), Some(chart));
    let mut launched = 0;
    for act in acts(3, 200) {
        match act {
            Act::Event(event) if event.vehicle == 1 => {
                let outcomes = [alone.handle(&event).unwrap(), team.handle(&event).unwrap()];
                // Its own depth is of use to who reduces ranges alone.
                let depth = matches!(event.payload, Payload::Depth { .. });
                assert!(depth || outcomes[0] == outcomes[1], "{outcomes:?} {event:?}");
                assert_eq!(bits(&alone.estimate(event.t_ns)), bits(&team.estimate(event.t_ns)));
            }
            Act::Launch { vehicle: 1, tol_ns } => {
                launched += u32::from(team.transmit(tol_ns, CAPACITY).unwrap().is_some());
                assert!(alone.transmit(tol_ns, CAPACITY).unwrap().is_none());
            }
            _ => {}
        }
    }
    assert!(launched > 20, "{launched} packets");
    assert!(team.estimate(200 * SECOND).ess.unwrap() > 10.0);
}

#[test]
fn the_referee_is_mpf_without_ranges_bit_for_bit_whatever_is_heard() {
    let chart = rich();
    let mut fleet: Vec<_> =
        (0..3).map(|v| team_of(v, team_options(3, PARTICLES), Some(chart.clone()))).collect();
    let mut options = mpf_options(PARTICLES);
    options.range = None;
    let mut alone: Vec<_> = (0..3).map(|v| mpf::<2>(v, 3, options, &chart, 5)).collect();
    let (mut heard, mut differs) = (0, 0);
    for act in acts(3, 200) {
        match act {
            Act::Event(event) => {
                let v = usize::from(event.vehicle);
                fleet[v].handle(&event).unwrap();
                alone[v].handle(&event).unwrap();
                let lone = fleet[v].lone().unwrap().state.core.estimate(event.t_ns);
                assert_eq!(bits(&alone[v].estimate(event.t_ns)), bits(&lone), "{event:?}");
                differs += u32::from(bits(&lone) != bits(&fleet[v].estimate(event.t_ns)));
            }
            Act::Launch { vehicle, tol_ns } => {
                let bytes = fleet[usize::from(vehicle)].transmit(tol_ns, CAPACITY).unwrap().unwrap();
                for event in receptions(vehicle, 3, tol_ns, &bytes) {
                    let outcome = fleet[usize::from(event.vehicle)].handle(&event).unwrap();
                    heard += u32::from(outcome == Outcome::Fused);
                }
            }
        }
    }
    assert!(heard > 100 && differs > 100, "{heard} packets fused, {differs} estimates differ");
}

#[test]
fn who_hears_its_team_knows_more_than_alone() {
    let flat = || fleet_over(Some(chart_of(flat_depth)), PARTICLES);
    let (mut together, mut apart) = (flat(), flat());
    let all = acts_over(3, 240, flat_depth);
    let outcomes = play(&mut together, &all, |_, _, _| true);
    play(&mut apart, &all, |_, _, _| false);
    assert!(outcomes.iter().filter(|o| **o == Outcome::Fused).count() > 140, "{outcomes:?}");
    for (v, (with, without)) in together.iter().zip(&apart).enumerate() {
        let spread = |n: &dyn Navigator| {
            let [ee, en, nn] = n.estimate(240 * SECOND).covariance_m2;
            (ee * nn - en * en).sqrt()
        };
        let (a, b) = (spread(with.as_ref()), spread(without.as_ref()));
        assert!(a < b, "vehicle {v}: {a} m² against {b} m²");
        let off = error_m(with.as_ref(), v as u16, 240);
        assert!(off * off < 16.0 * a, "vehicle {v}: {off} m, {a} m²");
    }
}

#[test]
fn a_resumed_run_is_the_uninterrupted_one() {
    let all = acts(3, 120);
    let lost = |s: u16, r: u16, tol: i64| (tol / SECOND + i64::from(2 * s + r)) % 5 != 0;
    let mut whole = fleet(true);
    play(&mut whole, &all, lost);
    for cut in [all.len() / 3, all.len() / 2 + 7] {
        let mut first = fleet(true);
        play(&mut first, &all[..cut], lost);
        let mut second = fleet(true);
        for (from, to) in first.iter().zip(&mut second) {
            to.restore(&from.snapshot().unwrap()).unwrap();
        }
        play(&mut second, &all[cut..], lost);
        for (a, b) in whole.iter().zip(&second) {
            assert_eq!(bits(&a.estimate(121 * SECOND)), bits(&b.estimate(121 * SECOND)));
            assert_eq!(a.snapshot().unwrap(), b.snapshot().unwrap());
        }
    }
}

#[test]
fn a_snapshot_of_something_else_is_refused_and_changes_nothing() {
    let mut fleet = fleet(true);
    play(&mut fleet, &acts(3, 30), |_, _, _| true);
    let before = fleet[0].snapshot().unwrap();
    let larger = team_of(0, team_options(3, 2 * PARTICLES), Some(rich())).snapshot().unwrap();
    let more = team_of(0, team_options(8, PARTICLES), Some(rich())).snapshot().unwrap();
    let mut shared = team_options(3, PARTICLES);
    shared.current_difference = if shared.current_difference < 1.0 { 1.0 } else { 0.1 };
    let shared = team_of(0, shared, Some(rich())).snapshot().unwrap();
    for spoilt in [&before[..before.len() / 2], &[], &[0xFF; 40], &larger, &more, &shared] {
        assert!(fleet[0].restore(spoilt).is_err());
        assert_eq!(fleet[0].snapshot().unwrap(), before);
    }
}

/// A fleet at 30 s and the next packet of vehicle 0 with its launch.
fn next_packet() -> (Vec<Box<dyn Navigator>>, Arc<[u8]>, i64) {
    let mut fleet = fleet(true);
    play(&mut fleet, &acts(3, 35), |_, _, _| true);
    let tol = 36 * SECOND;
    let bytes = fleet[0].transmit(tol, CAPACITY).unwrap().unwrap();
    (fleet, bytes, tol)
}

#[test]
fn a_packet_that_is_rejected_changes_its_count_and_nothing_else() {
    let (mut fleet, good, tol) = next_packet();
    assert!(good.len() <= 32);
    let receiver = fleet[1].as_mut();
    let now = tol + SECOND;
    receiver.handle(&event_at(now)).unwrap();
    let before = receiver.estimate(now);
    let mut bad: Vec<Event> = Vec::new();
    let spoilt = |bytes: Vec<u8>, sender, tol| reception(now, 1, sender, tol, 41.0, &bytes.into());
    for bit in 0..8 * good.len() {
        let mut bytes = good.to_vec();
        bytes[bit / 8] ^= 1 << (bit % 8);
        bad.push(spoilt(bytes, 0, tol));
    }
    bad.push(spoilt(good.to_vec(), 0, tol - 3 * SECOND));
    bad.push(spoilt(good.to_vec(), 2, tol));
    bad.push(spoilt(good[..good.len() - 1].to_vec(), 0, tol));
    bad.push(spoilt([&good[..], &[0]].concat(), 0, tol));
    bad.push(spoilt(packet(0, tol, 20, [170.0, 200.0], 3.0).to_vec(), 0, tol));
    bad.push(spoilt(Vec::new(), 0, tol));
    for (k, event) in bad.iter().enumerate() {
        assert_eq!(receiver.handle(event).unwrap(), Outcome::Rejected, "{event:?}");
        let after = receiver.estimate(now);
        assert_eq!(bits(&after), bits(&before));
        assert_eq!(after.rejected, before.rejected + k as u64 + 1);
    }
    let good = receptions(0, 3, tol, &good).into_iter().find(|e| e.vehicle == 1).unwrap();
    let good = Event { t_ns: now, ..good };
    assert_eq!(receiver.handle(&good).unwrap(), Outcome::Fused);
    assert_ne!(bits(&receiver.estimate(now)), bits(&before));
    // Once is enough.
    let before = receiver.estimate(now);
    assert_eq!(receiver.handle(&good).unwrap(), Outcome::Rejected);
    assert_eq!(bits(&receiver.estimate(now)), bits(&before));
}

fn event_at(t_ns: i64) -> Event {
    event(t_ns, 1, uwcoop_core::event::Payload::Motion { velocity_mps: [0.5, 0.2] })
}

#[test]
fn events_that_no_honest_source_sends_are_refused_and_change_nothing() {
    let (mut fleet, good, tol) = next_packet();
    let receiver = fleet[1].as_mut();
    let before = receiver.snapshot().unwrap();
    let mut refused = vec![
        event_at(tol - 30 * SECOND),
        fix(tol, 1, [f64::NAN, 0.0], 1.0),
        fix(tol, 0, [1.0, 0.0], 1.0),
        reception(tol + SECOND, 1, 1, tol, 40.0, &good),
        reception(tol + SECOND, 1, 3, tol, 40.0, &good),
        reception(tol + SECOND, 1, u16::MAX, tol, 40.0, &good),
    ];
    refused.push(reception(tol + SECOND, 1, 0, tol, -40.0, &good));
    for event in &refused {
        assert!(receiver.handle(event).is_err(), "{event:?}");
        assert_eq!(receiver.snapshot().unwrap(), before, "{event:?}");
    }
}

#[test]
fn a_packet_longer_than_its_slot_is_refused_and_takes_no_number() {
    let (mut fleet, _, tol) = next_packet();
    let before = fleet[2].snapshot().unwrap();
    assert!(fleet[2].transmit(tol + 3 * SECOND, 20).is_err());
    assert_eq!(fleet[2].snapshot().unwrap(), before);
    assert!(fleet[2].transmit(tol + 3 * SECOND, 32).unwrap().is_some());
}

#[test]
fn options_outside_their_bounds_are_refused() {
    let build = |change: fn(&mut uwcoop_core::navigator::team::TeamOptions)| {
        let mut options = team_options(3, PARTICLES);
        change(&mut options);
        Team::<2>::new(0, 3, options, None, SOUND_SPEED_MPS, 1).map(|_| ())
    };
    assert!(build(|_| ()).is_ok());
    assert!(build(|o| o.frame_bytes = 20).is_err());
    assert!(build(|o| o.sigma_range_m = 0.0).is_err());
    assert!(build(|o| o.group_size = 0).is_err());
    assert!(build(|o| o.drifts.clear()).is_err());
    assert!(build(|o| o.terrain.particles = 3).is_err());
}

/// The uncertainty of vehicle 2 in the eyes of vehicle 0, m².
fn seen(fleet: &[Team<2>]) -> f64 {
    let (_, _, [ee, _, nn]) = fleet[0].teammate(2).unwrap();
    ee + nn
}

#[test]
fn who_falls_silent_and_comes_back_makes_nobody_jump() {
    let mut team: Vec<Team<2>> =
        (0..3).map(|v| team_of(v, team_options(3, PARTICLES), Some(rich()))).collect();
    let mut last = 0.0;
    let mut launches_of_2 = 0;
    for act in acts(3, 420) {
        match act {
            Act::Event(event) => _ = team[usize::from(event.vehicle)].handle(&event).unwrap(),
            Act::Launch { vehicle, tol_ns } => {
                let bytes = team[usize::from(vehicle)].transmit(tol_ns, CAPACITY).unwrap().unwrap();
                let t_s = tol_ns / SECOND;
                for event in receptions(vehicle, 3, tol_ns, &bytes) {
                    let silent = vehicle == 2 && (100..300).contains(&t_s);
                    if silent {
                        continue;
                    }
                    let r = usize::from(event.vehicle);
                    let before = team[r].estimate(event.t_ns).mean_m;
                    assert_eq!(team[r].handle(&event).unwrap(), Outcome::Fused);
                    let moved = distance(before, team[r].estimate(event.t_ns).mean_m);
                    let [ee, _, nn] = team[r].estimate(event.t_ns).covariance_m2;
                    assert!(moved < 2.0 + 3.0 * (ee + nn).sqrt(), "{t_s} s: vehicle {r} moved {moved} m");
                    if vehicle == 2 && r == 0 {
                        launches_of_2 += 1;
                        last = seen(&team);
                        assert!(last < 400.0, "{t_s} s: {last} m²");
                    }
                }
            }
        }
    }
    assert!(launches_of_2 > 20 && last > 0.0);
    for (v, navigator) in team.iter().enumerate() {
        assert!(error_m(navigator, v as u16, 420) < 4.0, "vehicle {v}");
    }
}

#[test]
fn who_joins_late_is_taken_in() {
    let mut team = fleet_over(Some(rich()), 1000);
    let heard = play(&mut team, &acts(3, 240), |s, r, tol| (s != 2 && r != 2) || tol > 120 * SECOND);
    assert!(heard.contains(&Outcome::Noted), "packets without a start are set aside");
    assert!(heard[heard.len() - 20..].iter().all(|o| *o == Outcome::Fused));
    for (v, navigator) in team.iter().enumerate() {
        let off = error_m(navigator.as_ref(), v as u16, 240);
        assert!(off < 4.0, "vehicle {v}: {off} m, {:?}", navigator.estimate(240 * SECOND));
    }
}

#[test]
fn without_a_chart_ranges_alone_do_no_harm() {
    let all = acts(3, 200);
    let (mut together, mut apart) = (fleet(false), fleet(false));
    play(&mut together, &all, |_, _, _| true);
    play(&mut apart, &all, |_, _, _| false);
    let area = |n: &dyn Navigator| {
        let [ee, _, nn] = n.estimate(200 * SECOND).covariance_m2;
        ee + nn
    };
    let sum = |team: &[Box<dyn Navigator>]| team.iter().map(|n| area(n.as_ref())).sum::<f64>();
    assert!(sum(&together) < sum(&apart));
}

#[test]
fn a_group_of_one_leaves_ranges_between_teammates_out() {
    let mut options = team_options(5, PARTICLES);
    options.group_size = 1;
    let mut fleet: Vec<Box<dyn Navigator>> =
        (0..5).map(|v| Box::new(team_of(v, options.clone(), Some(rich()))) as Box<dyn Navigator>).collect();
    let outcomes = play(&mut fleet, &acts(5, 150), |_, _, _| true);
    assert!(outcomes.iter().all(|o| *o == Outcome::Fused));
    for (v, navigator) in fleet.iter().enumerate() {
        assert!(error_m(navigator.as_ref(), v as u16, 150) < 4.0, "vehicle {v}");
    }
}

fn diagnostic(navigator: &dyn Navigator, name: &str) -> f64 {
    navigator.diagnostics().iter().find(|(n, _)| *n == name).unwrap_or_else(|| panic!("no {name}")).1
}

/// The counter of a reported range has two bits. Who lost four packets of a vehicle in a row finds them equal again, while
/// its block of that vehicle stands four cycles too early.
#[test]
fn a_reported_range_to_a_launch_that_was_lost_is_not_taken_for_an_earlier_one() {
    let mut options = team_options(3, PARTICLES);
    // Nothing else may keep the wrong range away.
    options.range_gate_sigmas = f64::INFINITY;
    options.referee_nat = 0.0;
    let cycle = 3 * SLOT_S * SECOND;
    let silent = 150 * SECOND..150 * SECOND + 5 * cycle;
    let play_with = |lost: bool| {
        let mut team: Vec<Team<2>> = (0..3).map(|v| team_of(v, options.clone(), Some(rich()))).collect();
        let mut worst = 0.0f64;
        for act in acts(3, 240) {
            match act {
                Act::Event(event) => _ = team[usize::from(event.vehicle)].handle(&event).unwrap(),
                Act::Launch { vehicle, tol_ns } => {
                    let bytes = team[usize::from(vehicle)].transmit(tol_ns, CAPACITY).unwrap().unwrap();
                    for event in receptions(vehicle, 3, tol_ns, &bytes) {
                        if lost && vehicle == 2 && event.vehicle == 0 && silent.contains(&tol_ns) {
                            continue;
                        }
                        team[usize::from(event.vehicle)].handle(&event).unwrap();
                    }
                    if let Some((at_ns, mean, [ee, _, nn])) =
                        team[0].teammate(2).filter(|_| tol_ns > 60 * SECOND)
                    {
                        let off = distance(mean, track(2, at_ns as f64 / SECOND as f64));
                        worst = worst.max(off / (1.0 + (ee + nn).sqrt()));
                    }
                }
            }
        }
        let counts = team.iter().map(|n| diagnostic(n, "reported_ranges_stale") as u64).collect::<Vec<_>>();
        (counts, worst)
    };
    let (counts, worst) = play_with(false);
    assert_eq!(counts, [0, 0, 0], "without losses every reported range has its launch");
    assert!(worst < 4.0, "{worst} sigmas");
    let (counts, worst) = play_with(true);
    assert!(counts[0] >= 1 && counts[1..] == [0, 0], "{counts:?}");
    assert!(worst < 4.0, "{worst} sigmas");
}

/// Ranges that lie pull a vehicle off; the filter without ranges brings it back.
#[test]
fn a_vehicle_that_its_team_led_astray_comes_back() {
    let final_errors = |referee_nat: f64| {
        let mut options = team_options(3, PARTICLES);
        options.range_gate_sigmas = f64::INFINITY;
        options.terrain.monitor = None;
        options.referee_nat = referee_nat;
        let chart = chart_of(middling_depth);
        let mut team: Vec<Box<dyn Navigator>> = (0..3)
            .map(|v| Box::new(team_of(v, options.clone(), Some(chart.clone()))) as Box<dyn Navigator>)
            .collect();
        for act in acts_over(3, 300, middling_depth) {
            match act {
                Act::Event(event) => _ = team[usize::from(event.vehicle)].handle(&event).unwrap(),
                Act::Launch { vehicle, tol_ns } => {
                    let bytes = team[usize::from(vehicle)].transmit(tol_ns, CAPACITY).unwrap().unwrap();
                    for mut event in receptions(vehicle, 3, tol_ns, &bytes) {
                        let lies = event.vehicle == 1 && (60..150).contains(&(tol_ns / SECOND));
                        if let uwcoop_core::event::Payload::Reception { toa_ns, .. } = &mut event.payload
                            && lies
                        {
                            // 30 m.
                            *toa_ns += 20_000_000;
                        }
                        team[usize::from(event.vehicle)].handle(&event).unwrap();
                    }
                }
            }
        }
        let off = error_m(team[1].as_ref(), 1, 300);
        (off, if referee_nat > 0.0 { diagnostic(team[1].as_ref(), "referee_takeovers") } else { 0.0 })
    };
    let (without, _) = final_errors(0.0);
    let (with, takeovers) = final_errors(10.0);
    assert!(takeovers >= 1.0, "nobody took over; {with} m, {without} m without");
    assert!(with < 5.0, "{with} m with, {without} m without the referee");
    assert!(without > 2.0 * with, "{with} m with, {without} m without the referee");
}

/// A fifth of the relief.
fn middling_depth(east: f64, north: f64) -> f64 {
    20.0 + 0.2 * (rich_depth(east, north) - 20.0)
}
