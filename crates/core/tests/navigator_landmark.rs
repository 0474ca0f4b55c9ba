//! Alternating landmark: roles, lost and damaged packets, bad input, recovery, honesty.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests fail by panicking")]
#![allow(clippy::needless_range_loop, reason = "a vehicle is an index into the team and into the truth")]

mod seafloor;

use seafloor::*;
use uwcoop_core::event::Payload;
use uwcoop_core::measurement::angle::wrap;
use uwcoop_core::navigator::landmark::{Landmark, LandmarkOptions, LandmarkPaper};
use uwcoop_core::navigator::{Navigator, Outcome, Status};
use uwcoop_core::packet::landmark::ExchangeSize;

type Fleet = Vec<Box<dyn Navigator>>;

fn robust(vehicles: usize) -> Fleet {
    let one = |v: usize| Landmark::new(v as u16, vehicles, robust_options(), 3).unwrap();
    (0..vehicles).map(|v| Box::new(one(v)) as Box<dyn Navigator>).collect()
}

fn paper(vehicles: usize, particles: usize) -> Fleet {
    let one = |v: usize| LandmarkPaper::new(v as u16, vehicles, paper_options(particles), 3).unwrap();
    (0..vehicles).map(|v| Box::new(one(v)) as Box<dyn Navigator>).collect()
}

/// Three legs and two exchanges; the mission's vehicles and world.
fn mission(mut team: Fleet, seed: u64, lose: &[usize]) -> (Seafloor, Fleet) {
    let mut sea = Seafloor::new(team.len(), seed);
    sea.start(&mut team);
    sea.leg(150, 0, &mut team);
    sea.exchange(1, 0, &mut team, lose);
    sea.leg(150, 1, &mut team);
    sea.exchange(0, 1, &mut team, &[]);
    sea.leg(100, 0, &mut team);
    (sea, team)
}

#[test]
fn both_navigators_stay_near_the_truth_through_exchanges() {
    for seed in 0..4 {
        for (name, team, limit_m) in [("robust", robust(2), 1.2), ("paper", paper(2, 1500), 1.5)] {
            let (sea, team) = mission(team, seed, &[]);
            for v in 0..2 {
                let (position, yaw, _) = sea.error(v, team[v].as_ref());
                assert!(position < limit_m && yaw < 0.09, "{name} {seed} {v}: {position} m {yaw} rad");
            }
        }
    }
}

#[test]
fn the_robust_navigator_and_a_follower_are_honest() {
    let (mut main, mut sub, mut count) = (0.0, 0.0, 0.0);
    for seed in 0..40 {
        let (sea, team) = mission(robust(3), 100 + seed, &[]);
        main += (sea.error(0, team[0].as_ref()).2 + sea.error(1, team[1].as_ref()).2) / 6.0;
        sub += sea.error(2, team[2].as_ref()).2 / 3.0;
        count += 1.0;
    }
    // Mean of 40 (80) NEES over three degrees of freedom: standard deviation 0.13 and less.
    assert!((0.6..1.5).contains(&(main / count)), "main vehicles {}", main / count);
    assert!((0.6..1.5).contains(&(sub / count)), "follower {}", sub / count);
}

#[test]
fn a_lost_packet_costs_what_was_in_it_and_no_more() {
    let (mut nees, mut worst) = (0.0, 0.0f64);
    for seed in 0..12 {
        // The old landmark and the follower hear nothing of the first exchange.
        let (sea, team) = mission(robust(3), 300 + seed, &[0, 2]);
        for v in 0..3 {
            let (position, _, n) = sea.error(v, team[v].as_ref());
            nees += n / 3.0 / 36.0;
            worst = worst.max(position);
        }
    }
    assert!(worst < 2.5, "{worst} m");
    assert!((0.5..1.7).contains(&nees), "{nees}");
}

#[test]
fn packets_that_are_damaged_old_or_another_size_are_rejected_and_change_nothing_else() {
    for (name, mut navigator) in navigators(0, 2) {
        let mut sea = Seafloor::new(2, 5);
        let mut mover = robust(2).remove(1);
        {
            let mut pair: Fleet = vec![navigator, mover];
            sea.start(&mut pair);
            sea.leg(60, 0, &mut pair);
            pair[1].handle(&event(sea.t_ns, 1, Payload::Landed)).unwrap();
            mover = pair.remove(1);
            navigator = pair.remove(0);
        }
        let t = sea.t_ns;
        let bytes = mover.transmit(t, 128).unwrap().unwrap();
        let hear = |n: &mut Box<dyn Navigator>, tol_ns, bytes: &[u8]| {
            let payload = Payload::Reception { sender: 1, tol_ns, toa_ns: tol_ns, bytes: bytes.into() };
            n.handle(&event(t, 0, payload)).unwrap()
        };
        let before = navigator.estimate(t);
        for bit in (0..8 * bytes.len()).step_by(7) {
            let mut bad = bytes.to_vec();
            bad[bit / 8] ^= 1 << (bit % 8);
            assert_eq!(hear(&mut navigator, t, &bad), Outcome::Rejected, "{name}");
        }
        for bad in [&bytes[..16], &[], &[0; 40]] {
            assert_eq!(hear(&mut navigator, t, bad), Outcome::Rejected, "{name}");
        }
        assert_eq!(navigator.estimate(t).mean_m, before.mean_m);
        assert!(navigator.estimate(t).rejected > before.rejected);
        assert_eq!(hear(&mut navigator, t, &bytes), Outcome::Fused, "{name}");
        assert_eq!(hear(&mut navigator, t, &bytes), Outcome::Rejected, "{name}: a copy");
        assert_eq!(hear(&mut navigator, t - SECOND, &bytes), Outcome::Rejected, "{name}: another slot");
    }
}

#[test]
fn a_repeated_packet_is_as_good_as_one() {
    let mut sea = Seafloor::new(2, 6);
    let mut team = robust(2);
    sea.start(&mut team);
    sea.leg(60, 0, &mut team);
    team[1].handle(&event(sea.t_ns, 1, Payload::Landed)).unwrap();
    let mut states = Vec::new();
    for _ in 0..2 {
        let tol_ns = sea.t_ns;
        let bytes = team[1].transmit(tol_ns, 128).unwrap().unwrap();
        sea.t_ns += 12 * SECOND;
        let payload = Payload::Reception { sender: 1, tol_ns, toa_ns: tol_ns, bytes };
        assert_eq!(team[0].handle(&event(sea.t_ns, 0, payload)).unwrap(), Outcome::Fused);
        let estimate = team[0].estimate(sea.t_ns);
        states.push((estimate.mean_m, estimate.covariance_m2, estimate.yaw));
    }
    assert_eq!(states[0], states[1]);
}

#[test]
fn events_that_no_honest_source_sends_change_nothing() {
    for (name, mut navigator) in navigators(1, 2) {
        let mut sea = Seafloor::new(2, 8);
        let mut team: Fleet = vec![robust(2).remove(0), navigator];
        sea.start(&mut team);
        sea.leg(30, 0, &mut team);
        navigator = team.remove(1);
        let later = sea.t_ns + SECOND;
        let fix = |range_m, own, peer, who| Payload::AcousticFix {
            peer: who,
            transmit_ns: later,
            range_m,
            own_bearing_rad: own,
            peer_bearing_rad: peer,
            peer_depth_m: None,
        };
        let before = navigator.snapshot().unwrap();
        for payload in [
            fix(Some(-1.0), Some(0.0), Some(0.0), 0),
            fix(Some(0.0), None, None, 0),
            fix(Some(10.0), Some(f64::NAN), None, 0),
            fix(Some(10.0), None, Some(f64::INFINITY), 0),
            fix(Some(f64::NAN), None, None, 0),
            fix(Some(10.0), Some(0.0), Some(0.0), 1),
            fix(Some(10.0), Some(0.0), Some(0.0), 9),
            Payload::GroundVelocity { velocity_mps: [f64::NAN, 0.0], sigma_mps: 0.01 },
            Payload::TurnRate { yaw_rate_radps: f64::INFINITY, sigma_radps: 0.01 },
        ] {
            assert!(navigator.handle(&event(later, 1, payload.clone())).is_err(), "{name} {payload:?}");
            assert_eq!(navigator.snapshot().unwrap(), before, "{name} {payload:?}");
        }
        let missing = navigator.handle(&event(later, 1, fix(None, None, None, 0))).unwrap();
        assert_ne!(missing, Outcome::Fused, "{name}");
    }
}

#[test]
fn an_hour_without_positionings_is_honest_and_ends_well() {
    let mut sea = Seafloor::new(2, 11);
    let mut team = robust(2);
    sea.start(&mut team);
    sea.leg(60, 0, &mut team);
    let sure = team[1].estimate(sea.t_ns).covariance_m2[0];
    sea.go(3600, 0, 0.02, &mut team, false);
    let estimate = team[1].estimate(sea.t_ns);
    assert_eq!(estimate.status, Status::Navigating);
    assert!(estimate.covariance_m2[0] > 2.0 * sure);
    let (_, _, nees) = sea.error(1, team[1].as_ref());
    assert!(nees < 16.3, "χ² of three degrees of freedom at 99.9 %: {nees}");
    sea.leg(200, 0, &mut team);
    let (position, yaw, _) = sea.error(1, team[1].as_ref());
    assert!(position < 1.5 && yaw < 0.15, "{position} m {yaw} rad");
}

fn number(navigator: &dyn Navigator, name: &str) -> f64 {
    navigator.diagnostics().into_iter().find(|d| d.0 == name).map(|d| d.1).unwrap()
}

fn of(options: LandmarkOptions, vehicles: usize) -> Fleet {
    let one = |v: usize| Landmark::new(v as u16, vehicles, options, 3).unwrap();
    (0..vehicles).map(|v| Box::new(one(v)) as Box<dyn Navigator>).collect()
}

#[test]
fn a_yaw_step_is_found_by_consensus_and_a_healthy_mission_has_none() {
    for (options, seed) in
        [robust_options(), by_consensus()].into_iter().flat_map(|o| (0..8).map(move |s| (o, s)))
    {
        let mut sea = Seafloor::new(2, 500 + seed);
        let mut team = of(options, 2);
        sea.start(&mut team);
        sea.leg(150, 0, &mut team);
        assert_eq!(number(team[1].as_ref(), "resets"), 0.0, "healthy, seed {seed}");
        sea.truth[1][2] += 0.35;
        sea.leg(150, 0, &mut team);
        let (position, yaw, _) = sea.error(1, team[1].as_ref());
        assert!(number(team[1].as_ref(), "resets") >= 1.0 || yaw < 0.1, "seed {seed}");
        assert!(position < 1.5 && yaw < 0.15, "seed {seed}: {position} m {yaw} rad");
    }
}

#[test]
fn a_vehicle_carried_away_and_turned_about_is_found_again() {
    for seed in 0..8 {
        let mut sea = Seafloor::new(2, 700 + seed);
        let mut team = robust(2);
        sea.start(&mut team);
        sea.leg(150, 0, &mut team);
        sea.truth[1][0] += 14.0;
        sea.truth[1][1] -= 6.0;
        sea.truth[1][2] = wrap(sea.truth[1][2] + 2.5);
        sea.leg(150, 0, &mut team);
        let (position, yaw, nees) = sea.error(1, team[1].as_ref());
        assert_eq!(number(team[1].as_ref(), "resets"), 1.0, "seed {seed}");
        assert!(position < 1.5 && yaw < 0.15 && nees < 21.1, "seed {seed}: {position} m {yaw} rad {nees}");
    }
}

#[test]
fn wild_bearings_that_agree_for_a_while_do_not_lose_the_vehicle() {
    for seed in 0..8 {
        let mut sea = Seafloor::new(2, 800 + seed);
        let mut team = robust(2);
        sea.start(&mut team);
        sea.leg(200, 0, &mut team);
        // Three in a row off by the same half radian: enough to believe a turn.
        for _ in 0..3 {
            sea.go(10, 0, SPEED, &mut team, false);
            let mut wild = sea.positioning(1, 0);
            if let Payload::AcousticFix { own_bearing_rad: Some(bearing), .. } = &mut wild {
                *bearing = wrap(*bearing + 0.5);
            }
            team[1].handle(&event(sea.t_ns, 1, wild)).unwrap();
        }
        sea.leg(100, 0, &mut team);
        let (position, yaw, nees) = sea.error(1, team[1].as_ref());
        assert!(position < 1.0 && yaw < 0.1 && nees < 21.1, "seed {seed}: {position} m {yaw} rad {nees}");
    }
}

#[test]
fn a_belief_that_its_packet_does_not_hold_is_not_told_and_the_mission_goes_on() {
    let size = ExchangeSize::B8;
    let mut options = robust_options();
    options.packet = packet(size);
    let mut papers = paper_options(800);
    papers.packet = packet(size);
    let robust = |v: u16| Box::new(Landmark::new(v, 2, options, 3).unwrap()) as Box<dyn Navigator>;
    let paper = |v: u16| Box::new(LandmarkPaper::new(v, 2, papers, 3).unwrap()) as Box<dyn Navigator>;
    let (runs, mut sum) = (50, 0.0);
    for seed in 0..runs {
        let (sea, team) = untold(vec![robust(0), robust(1)], seed);
        let (position, yaw, nees) = sea.error(0, team[0].as_ref());
        assert!(position < 3.0 && yaw < 0.2, "{seed}: {position} m {yaw} rad");
        sum += nees;
    }
    // Means of 50 χ² of three degrees of freedom stay below 4.2 in 999 of 1000 cases.
    assert!(sum / (runs as f64) < 4.2, "{}", sum / runs as f64);
    let (sea, team) = untold(vec![paper(0), paper(1)], 4);
    let (position, yaw, _) = sea.error(0, team[0].as_ref());
    assert!(position < 3.0 && yaw < 0.2, "{position} m {yaw} rad");
}

/// A handover whose packet says nothing, and the old landmark's leg after it.
fn untold(mut team: Fleet, seed: u64) -> (Seafloor, Fleet) {
    let mut sea = Seafloor::new(2, seed);
    sea.start(&mut team);
    // Nothing was measured yet: a metre and 5° are more than 8 bytes can say.
    sea.go(60, 0, SPEED, &mut team, false);
    for v in 0..2 {
        team[v].handle(&event(sea.t_ns, v as u16, Payload::Landed)).unwrap();
    }
    let heard = Payload::AcousticFix {
        peer: 0,
        transmit_ns: sea.t_ns,
        range_m: Some(sea.truth[1][0].hypot(sea.truth[1][1])),
        own_bearing_rad: None,
        peer_bearing_rad: None,
        peer_depth_m: None,
    };
    team[1].handle(&event(sea.t_ns, 1, heard)).unwrap();
    let before = team[1].estimate(sea.t_ns);
    assert!(team[1].transmit(sea.t_ns, 128).unwrap().is_none());
    assert_eq!(number(team[1].as_ref(), "packets_untold"), 1.0);
    assert_eq!(team[1].estimate(sea.t_ns), before);
    // Roles change all the same, as the mission says; the old landmark places the new one by what it measures.
    for (v, payload) in [
        (1, Payload::RoleTaken { landmark: true }),
        (0, Payload::RoleTaken { landmark: false }),
        (0, Payload::LiftedOff),
    ] {
        team[v].handle(&event(sea.t_ns, v as u16, payload)).unwrap();
    }
    sea.leg(150, 1, &mut team);
    (sea, team)
}

#[test]
fn an_unknown_yaw_starts_with_particles_and_ends_with_a_gaussian() {
    let mut sea = Seafloor::new(2, 21);
    let mut navigator = Landmark::new(1, 2, robust_options(), 3).unwrap();
    let fix = Payload::Fix { position_m: [0.5, -9.0], covariance_m2: [1.0, 0.0, 1.0] };
    navigator.handle(&event(0, 1, fix)).unwrap();
    let core = |n: &Landmark| n.diagnostics()[0].1;
    let mut team: Fleet = vec![robust(2).remove(0), Box::new(navigator)];
    sea.leg(10, 0, &mut team);
    assert_eq!(team[1].diagnostics()[0], ("core_particles", 1.0));
    assert!(team[1].estimate(sea.t_ns).ess.is_some() && team[1].particles().is_some());
    sea.leg(200, 0, &mut team);
    assert_eq!(team[1].diagnostics()[0], ("core_particles", 0.0));
    let (position, yaw, _) = sea.error(1, team[1].as_ref());
    assert!(position < 1.5 && yaw < 0.15, "{position} m {yaw} rad");
    let fresh = Landmark::new(1, 2, robust_options(), 3).unwrap();
    assert_eq!(core(&fresh), 0.0);
    assert_eq!(fresh.estimate(0).status, Status::NotStarted);
}

#[test]
fn a_snapshot_goes_on_as_if_nothing_had_happened() {
    for (name, navigator) in navigators(1, 2) {
        let mut sea = Seafloor::new(2, 31);
        let mut team: Fleet = vec![robust(2).remove(0), navigator];
        sea.start(&mut team);
        sea.leg(35, 0, &mut team);
        let taken = team[1].snapshot().unwrap();
        let index = navigators(1, 2).iter().position(|n| n.0 == name).unwrap();
        let mut other = navigators(1, 2).remove(index).1;
        other.restore(&taken).unwrap();
        assert_eq!(other.snapshot().unwrap(), taken, "{name}");
        assert!(other.restore(&taken[..taken.len() / 2]).is_err(), "{name}");
        assert_eq!(other.snapshot().unwrap(), taken, "{name}: a broken snapshot changes nothing");
        for k in 0..40 {
            let t = sea.t_ns + k * SECOND / 5;
            let mut events = vec![
                Payload::GroundVelocity { velocity_mps: [0.15, 0.01], sigma_mps: 0.016 },
                Payload::TurnRate { yaw_rate_radps: 0.03, sigma_radps: 0.0013 },
            ];
            if k % 10 == 9 {
                events.push(sea.positioning(1, 0));
            }
            for payload in events {
                let e = event(t, 1, payload);
                assert_eq!(team[1].handle(&e).unwrap(), other.handle(&e).unwrap(), "{name}");
            }
        }
        assert_eq!(team[1].snapshot().unwrap(), other.snapshot().unwrap(), "{name}");
    }
}

#[test]
fn every_packet_size_takes_the_roles_over() {
    for size in ExchangeSize::ALL {
        let mut options = robust_options();
        options.packet = packet(size);
        let mut papers = paper_options(800);
        papers.packet = packet(size);
        let one = |v: usize| Box::new(Landmark::new(v as u16, 2, options, 3).unwrap()) as Box<dyn Navigator>;
        let other =
            |v: usize| Box::new(LandmarkPaper::new(v as u16, 2, papers, 3).unwrap()) as Box<dyn Navigator>;
        for team in [vec![one(0), one(1)], vec![other(0), other(1)]] {
            let (sea, team) = mission(team, 900, &[]);
            for v in 0..2 {
                let (position, yaw, _) = sea.error(v, team[v].as_ref());
                let limit_m = if size.bytes() < 32 { 3.0 } else { 2.0 };
                assert!(position < limit_m && yaw < 0.15, "{size:?} {v}: {position} m {yaw} rad");
            }
        }
    }
}

#[test]
fn who_has_nothing_to_say_is_silent_and_a_slot_too_short_is_refused() {
    for (name, mut navigator) in navigators(0, 2) {
        assert!(navigator.transmit(0, 128).unwrap().is_none(), "{name}");
        let mut sea = Seafloor::new(2, 3);
        let mut team: Fleet = vec![navigator, robust(2).remove(1)];
        sea.start(&mut team);
        sea.leg(20, 0, &mut team);
        assert!(team[0].transmit(sea.t_ns, 128).unwrap().is_none(), "{name}: the landmark");
        assert!(team[1].transmit(sea.t_ns, 128).unwrap().is_none(), "{name}: afloat");
        team[1].handle(&event(sea.t_ns, 1, Payload::Landed)).unwrap();
        assert!(team[1].transmit(sea.t_ns, 31).is_err(), "{name}");
        assert_eq!(team[1].transmit(sea.t_ns, 32).unwrap().unwrap().len(), 32, "{name}");
    }
}

fn dead_reckoning() -> Landmark {
    let options = LandmarkOptions { use_fixes: false, particles: 0, ..robust_options() };
    Landmark::new(1, 2, options, 3).unwrap()
}

/// 1 m/s east for `seconds`, the DVL told by `reading`; the estimate at the end.
fn swim(
    navigator: &mut dyn Navigator,
    seconds: i64,
    reading: impl Fn(i64) -> Option<[f64; 2]>,
) -> (Vec<Outcome>, uwcoop_core::navigator::Estimate) {
    let event = |t_ns: i64, payload: Payload| uwcoop_core::event::Event { t_ns, vehicle: 1, payload };
    let fix = Payload::Fix { position_m: [0.0; 2], covariance_m2: [1.0, 0.0, 1.0] };
    navigator.handle(&event(0, fix)).unwrap();
    navigator.handle(&event(0, Payload::Heading { yaw_rad: 0.0, sigma_rad: 0.001 })).unwrap();
    let mut outcomes = Vec::new();
    for s in 0..=seconds {
        let t_ns = s * 1_000_000_000;
        let gyro = Payload::TurnRate { yaw_rate_radps: 0.0, sigma_radps: 1e-4 };
        navigator.handle(&event(t_ns, gyro)).unwrap();
        if let Some(velocity_mps) = reading(s) {
            let dvl = Payload::GroundVelocity { velocity_mps, sigma_mps: 0.01 };
            outcomes.push(navigator.handle(&event(t_ns, dvl)).unwrap());
        }
    }
    (outcomes, navigator.estimate(seconds * 1_000_000_000))
}

#[test]
fn without_a_dvl_dead_reckoning_grows_uncertain() {
    let whole = swim(&mut dead_reckoning(), 200, |_| Some([1.0, 0.0])).1;
    let gap = |from: i64, to: i64| {
        swim(&mut dead_reckoning(), 200, move |s| (s < from || s > to).then_some([1.0, 0.0])).1
    };
    let sixty = gap(100, 159);
    // q a³ / 3 with q = 0.01 m²/s³, as of `local-only`, of the 59 s beyond two that the last velocity holds for.
    let grown = sixty.covariance_m2[0] - whole.covariance_m2[0];
    assert!((grown / (0.01 / 3.0 * 59f64.powi(3)) - 1.0).abs() < 0.01, "{grown}");
    let early = gap(0, 59);
    let grown = early.covariance_m2[2] - whole.covariance_m2[2];
    assert!((grown / (0.01 / 3.0 * 58f64.powi(3)) - 1.0).abs() < 0.01, "{grown}");
    // A single reading that is missing costs nothing; an estimate ahead of the last reading does.
    assert!((gap(100, 100).covariance_m2[0] - whole.covariance_m2[0]).abs() < 1e-9);
    let mut navigator = dead_reckoning();
    swim(&mut navigator, 100, |_| Some([1.0, 0.0]));
    let ahead = navigator.estimate(160_000_000_000).covariance_m2[2];
    assert!(ahead > 600.0, "{ahead}");
}

#[test]
fn without_a_dvl_the_papers_particles_spread_as_far() {
    let run = |silent: std::ops::Range<i64>| {
        let options = paper_options(4000);
        let mut paper = LandmarkPaper::new(1, 2, options, 3).unwrap();
        swim(&mut paper, 200, move |s| (!silent.contains(&s)).then_some([1.0, 0.0])).1
    };
    let (whole, gap) = (run(0..0), run(100..160));
    for axis in [0, 2] {
        let grown = gap.covariance_m2[axis] - whole.covariance_m2[axis];
        let expected = 0.01 / 3.0 * 59f64.powi(3);
        assert!((grown / expected - 1.0).abs() < 0.1, "{grown} of {expected}");
    }
    // A reading that is missing costs nothing: the same draws give the same bits.
    assert_eq!(run(100..101).covariance_m2, whole.covariance_m2);
}

#[test]
fn a_dvl_without_bottom_track_is_gated_and_counted() {
    for no_velocity in [[-32.768, -32.768], [-32.768, 0.0], [0.0, 31.0]] {
        let mut navigator = dead_reckoning();
        let read = |s: i64| Some(if (100..110).contains(&s) { no_velocity } else { [1.0, 0.0] });
        let (outcomes, estimate) = swim(&mut navigator, 200, read);
        assert_eq!(outcomes.iter().filter(|o| **o == Outcome::Gated).count(), 10);
        assert_eq!(estimate.rejected, 10);
        assert!((estimate.mean_m[0] - 200.0).abs() < 1e-6, "{:?}", estimate.mean_m);
        let local = swim(&mut dead_reckoning(), 200, |_| Some([1.0, 0.0])).1;
        assert!(estimate.covariance_m2[0] > local.covariance_m2[0] + 1.0, "ten seconds without a velocity");
    }
}

proptest::proptest! {
    #![proptest_config(proptest::prelude::ProptestConfig::with_cases(32))]

    /// However events split the time, the same gap costs the same.
    #[test]
    fn the_drift_does_not_depend_on_how_time_is_cut(gap_s in 3i64..90, cut in 1i64..20) {
        let ends = |step: i64| {
            let mut navigator = dead_reckoning();
            swim(&mut navigator, 10, |_| Some([1.0, 0.0]));
            for s in (11..=10 + gap_s).filter(|s| s % step == 0) {
                let gyro = Payload::TurnRate { yaw_rate_radps: 0.0, sigma_radps: 0.0 };
                let event = uwcoop_core::event::Event { t_ns: s * 1_000_000_000, vehicle: 1, payload: gyro };
                navigator.handle(&event).unwrap();
            }
            let late = (10 + gap_s) * 1_000_000_000;
            let estimate = navigator.estimate(late);
            estimate.covariance_m2[2]
        };
        let drift = 0.01 / 3.0 * (gap_s as f64 - 2.0).max(0.0).powi(3);
        proptest::prop_assert!(((ends(1) - ends(cut)) / drift.max(0.1)).abs() < 0.05);
        proptest::prop_assert!(ends(cut) > drift);
    }
}
