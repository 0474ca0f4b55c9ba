//! Positions and ranges from fixed stations: an ultra-short baseline whose fixes come late, beacons at known places.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests fail by panicking")]

mod world;

use uwcoop_core::event::{Event, Kind, Payload};
use uwcoop_core::navigator::clock::ClockOptions;
use uwcoop_core::navigator::delayed::{Delayed, DelayedOptions, Late};
use uwcoop_core::navigator::{Navigator, Outcome};
use world::fleet::{team_of, team_options};
use world::*;

const VELOCITY_MPS: [f64; 2] = [0.8, 0.3];
const PARTICLES: usize = 1500;
const DEPTH_M: f64 = 3.0;
/// Place and depth of the beacons.
const BEACONS: [([f64; 2], f64); 2] = [([120.0, 20.0], 15.0), ([60.0, 330.0], 12.0)];

/// Where a vehicle is that drifts with a current which nobody has told it.
fn truth(current_mps: [f64; 2], t_s: f64) -> [f64; 2] {
    [0, 1].map(|axis| 50.0 + (VELOCITY_MPS[axis] + current_mps[axis]) * t_s)
}

/// Terrain navigators over a seabed that tells nothing.
fn navigators(seed: u64) -> Vec<(&'static str, Box<dyn Navigator>)> {
    let flat = chart_of(|_, _| 20.0);
    let mut lone = mpf_options(PARTICLES);
    lone.range = None;
    let mut ranging = dmpf_options(PARTICLES);
    ranging.terrain = false;
    vec![
        ("dmpf", Box::new(dmpf(0, 2, ranging, &flat, seed))),
        ("mpf", Box::new(mpf::<2>(0, 2, mpf_options(PARTICLES), &flat, seed))),
        ("mpf-terrain-only", Box::new(mpf::<2>(0, 2, lone, &flat, seed))),
        ("team", Box::new(team_of(0, team_options(2, PARTICLES), Some(flat.clone())))),
    ]
}

/// Start, command and depth; `more` says what else comes in a second.
fn fly(
    navigator: &mut dyn Navigator,
    seconds: i64,
    seed: u64,
    mut more: impl FnMut(i64, &[f64]) -> Option<Payload>,
) {
    let noise = world_noise(seed, 0, 6 * (seconds as usize + 1));
    let start = [0, 1].map(|axis| 50.0 + 2.0 * noise[axis]);
    navigator.handle(&fix(0, 0, start, 4.0)).unwrap();
    for second in 0..=seconds {
        let t_ns = second * SECOND;
        let mut payloads = vec![
            Payload::Motion { velocity_mps: VELOCITY_MPS },
            Payload::Depth { depth_m: DEPTH_M, sigma_m: 0.05 },
        ];
        payloads.extend(more(second, &noise[6 * second as usize..][..6]));
        for payload in payloads {
            navigator.handle(&event(t_ns, 0, payload)).unwrap();
        }
    }
}

/// The normalised square of the error.
fn nees(navigator: &dyn Navigator, t_s: f64, truth_m: [f64; 2]) -> (f64, f64) {
    let estimate = navigator.estimate((t_s * 1e9) as i64);
    let [e, n] = [0, 1].map(|axis| estimate.mean_m[axis] - truth_m[axis]);
    let [ee, en, nn] = estimate.covariance_m2;
    ((nn * e * e - 2.0 * en * e * n + ee * n * n) / (ee * nn - en * en), e.hypot(n))
}

/// Mean NEES and RMS error of each navigator at the end of missions with a current each.
fn judged(
    seconds: i64,
    more: impl Fn([f64; 2], i64, &[f64]) -> Option<Payload>,
) -> Vec<(&'static str, f64, f64)> {
    const MISSIONS: u64 = 60;
    let mut sums: Vec<(&'static str, f64, f64)> = Vec::new();
    for seed in 0..MISSIONS {
        let current: Vec<f64> = world_noise(900 + seed, 0, 2).iter().map(|x| 0.3 * x).collect();
        let current = [current[0], current[1]];
        for (k, (name, mut navigator)) in navigators(seed).into_iter().enumerate() {
            fly(navigator.as_mut(), seconds, seed, |second, noise| more(current, second, noise));
            let (square, error_m) = nees(navigator.as_ref(), seconds as f64, truth(current, seconds as f64));
            if sums.len() == k {
                sums.push((name, 0.0, 0.0));
            }
            sums[k].1 += square / (MISSIONS as f64);
            sums[k].2 += error_m * error_m / (MISSIONS as f64);
        }
    }
    let o: Vec<_> = sums.into_iter().map(|(name, nees, square)| (name, nees, square.sqrt())).collect();
    eprintln!("DBG {o:?}");
    o
}

/// What an ultra-short baseline tells every ten seconds, `age_s` seconds late.
fn usbl(current: [f64; 2], second: i64, noise: &[f64], age_s: i64) -> Option<Payload> {
    if second < 20 || second % 10 != 0 {
        return None;
    }
    let then = truth(current, (second - age_s) as f64);
    Some(Payload::Usbl {
        measured_ns: (second - age_s) * SECOND,
        position_m: [then[0] + 2.0 * noise[2], then[1] + 2.0 * noise[3]],
        covariance_m2: [4.0, 0.0, 4.0],
    })
}

#[test]
fn late_positions_hold_a_drifting_vehicle_and_the_covariance_is_honest() {
    for (name, nees, rms_m) in judged(150, |current, second, noise| usbl(current, second, noise, 8)) {
        // Without them the current brings it 64 m off.
        assert!(rms_m < 5.0, "{name}: {rms_m} m");
        // 60 missions of two axes: 2 ± 0.26; a fix that is moved along counts a little less than it tells.
        assert!((0.9..2.8).contains(&nees) || name == "dmpf", "{name}: NEES {nees}");
    }
}

/// A slant range to the beacon whose turn it is, measured a second ago.
fn beacon(current: [f64; 2], second: i64, noise: &[f64], one_way: bool, clock_m: f64) -> Option<Payload> {
    if second < 5 || second % 5 != 0 {
        return None;
    }
    let (beacon_m, beacon_depth_m) = BEACONS[(second / 5 % 2) as usize];
    let level = distance(truth(current, (second - 1) as f64), beacon_m);
    Some(Payload::BeaconRange {
        measured_ns: (second - 1) * SECOND,
        beacon_m,
        beacon_depth_m,
        range_m: level.hypot(beacon_depth_m - DEPTH_M) + noise[4] + clock_m,
        sigma_m: 1.0,
        one_way,
    })
}

#[test]
fn two_way_ranges_to_beacons_hold_it_too() {
    for (name, nees, rms_m) in
        judged(150, |current, second, noise| beacon(current, second, noise, false, 0.0))
    {
        assert!(rms_m < 4.0, "{name}: {rms_m} m");
        // `dmpf` roughens by what its paper says, not by what it knows.
        assert!((1.0..3.0).contains(&nees) || name == "dmpf", "{name}: NEES {nees}");
    }
}

/// NEES and greatest error of `mpf` whose clock against the beacons is off by up to `clock_m`, as it is told.
fn one_way(clock_m: f64) -> (f64, f64, f64) {
    const MISSIONS: u64 = 60;
    let (mut square, mut worst_m, mut gated) = (0.0, 0.0f64, 0.0);
    for seed in 0..MISSIONS {
        let noise = world_noise(700 + seed, 0, 3);
        let current = [0.3 * noise[0], 0.3 * noise[1]];
        let mut options = mpf_options(PARTICLES);
        options.range.as_mut().unwrap().clock =
            ClockOptions { offset_sigma_s: clock_m / 1500.0 / 2f64.sqrt(), ..ClockOptions::NONE };
        let mut navigator = mpf::<2>(0, 2, options, &chart_of(|_, _| 20.0), seed);
        fly(&mut navigator, 150, seed, |second, white| {
            beacon(current, second, white, true, clock_m * noise[2])
        });
        let (nees, error_m) = nees(&navigator, 150.0, truth(current, 150.0));
        let all = navigator.diagnostics();
        gated += all.into_iter().find(|(name, _)| *name == "gated_ranges").unwrap().1;
        square += nees / (MISSIONS as f64);
        worst_m = worst_m.max(error_m);
    }
    (square, worst_m, gated)
}

#[test]
fn one_way_ranges_count_by_how_well_the_clock_is_known() {
    let (nees, worst_m, gated) = one_way(0.7);
    assert!(gated == 0.0 && worst_m < 15.0, "{gated} gated, {worst_m} m");
    assert!((0.5..3.0).contains(&nees), "NEES {nees}");
    // A clock that is off by 5 m is not for ranges to beacons: they are gated, and counted, but where one is nearly above.
    let (nees, _, gated) = one_way(5.0);
    assert!(gated > 60.0 * 29.0, "{gated} of 1800 gated");
    assert!((1.2..3.0).contains(&nees), "NEES {nees}");
}

#[test]
fn what_contradicts_everything_is_gated_and_what_cannot_be_placed_is_said() {
    let far = Payload::Usbl {
        measured_ns: 59 * SECOND,
        position_m: [900.0, -700.0],
        covariance_m2: [4.0, 0.0, 4.0],
    };
    let beacon = |range_m, beacon_depth_m, measured_ns| Payload::BeaconRange {
        measured_ns,
        beacon_m: BEACONS[0].0,
        beacon_depth_m,
        range_m,
        sigma_m: 1.0,
        one_way: false,
    };
    for (name, mut navigator) in navigators(3) {
        let uses = navigator.profile().uses;
        assert!(
            uses.contains(Kind::Usbl) && uses.contains(Kind::BeaconRange) && uses.contains(Kind::Depth),
            "{name}"
        );
        // Nothing of the own depth is known yet.
        navigator.handle(&fix(0, 0, [50.0, 50.0], 4.0)).unwrap();
        let early = navigator.handle(&event(0, 0, beacon(80.0, 15.0, 0))).unwrap();
        assert_eq!(early, Outcome::Noted, "{name}");
        fly(navigator.as_mut(), 60, 3, |_, _| None);
        let before = navigator.estimate(60 * SECOND);
        let cases = [
            (far.clone(), Outcome::Gated),
            (beacon(700.0, 15.0, 59 * SECOND), Outcome::Gated),
            // Shorter than the depths differ.
            (beacon(100.0, 300.0, 59 * SECOND), Outcome::Gated),
            (
                Payload::Usbl {
                    measured_ns: -500 * SECOND,
                    position_m: [50.0; 2],
                    covariance_m2: [4.0, 0.0, 4.0],
                },
                Outcome::Rejected,
            ),
            (beacon(80.0, 15.0, -500 * SECOND), Outcome::Rejected),
        ];
        for (k, (payload, expected)) in cases.into_iter().enumerate() {
            let outcome = navigator.handle(&event(60 * SECOND, 0, payload.clone())).unwrap();
            assert_eq!(outcome, expected, "{name}: {payload:?}");
            let after = navigator.estimate(60 * SECOND);
            assert_eq!((after.mean_m, after.covariance_m2), (before.mean_m, before.covariance_m2), "{name}");
            assert_eq!(after.rejected, before.rejected + k as u64 + 1, "{name}");
        }
    }
}

#[test]
fn inflated_a_late_fix_is_used_when_it_comes_and_a_late_depth_is_not() {
    for (name, inner) in navigators(3) {
        let options = DelayedOptions { late: Late::Inflate, lag_s: 20.0 };
        let mut navigator = Delayed::new(inner, 0, options).unwrap();
        fly(&mut navigator, 60, 3, |_, _| None);
        let sigma_m = |navigator: &dyn Navigator| {
            let [ee, _, nn] = navigator.estimate(60 * SECOND).covariance_m2;
            (ee + nn).sqrt()
        };
        let before_m = sigma_m(&navigator);
        let at = |second: i64, payload| event(second * SECOND, 0, payload);
        let position = |second: i64| Payload::Fix {
            position_m: truth([0.0; 2], second as f64),
            covariance_m2: [1.0, 0.0, 1.0],
        };
        let told = |navigator: &Delayed<_>, name: &str| {
            let all: Vec<(&str, f64)> = Navigator::diagnostics(navigator);
            all.into_iter().find(|(n, _)| *n == name).unwrap().1
        };
        assert_eq!(navigator.handle(&at(48, position(48))).unwrap(), Outcome::Fused, "{name}");
        let after_m = sigma_m(&navigator);
        assert!(after_m < 0.5 * before_m, "{name}: {before_m} m before, {after_m} m after");
        assert!(after_m > 1.4, "{name}: twelve seconds of drift are in it: {after_m} m");
        let off_m = distance(navigator.estimate(60 * SECOND).mean_m, truth([0.0; 2], 60.0));
        assert!(off_m < 8.0, "{name}: {off_m} m");
        let late_depth = at(50, Payload::Depth { depth_m: 9.0, sigma_m: 0.1 });
        assert_eq!(navigator.handle(&late_depth).unwrap(), Outcome::Rejected, "{name}");
        assert_eq!(
            navigator.handle(&at(39, position(39))).unwrap(),
            Outcome::Rejected,
            "{name}: older than the lag"
        );
        assert_eq!(
            (told(&navigator, "late_inflated"), told(&navigator, "late_rejected")),
            (1.0, 2.0),
            "{name}"
        );
        let next: Event = at(61, position(61));
        assert_ne!(navigator.handle(&next).unwrap(), Outcome::Rejected, "{name}");
    }
}
