//! The references of the origin state keep the contract: what is refused changes nothing, snapshots hold everything,
//! memory is bounded, and a central filter without ranges is each vehicle's own.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests fail by panicking")]

mod world;

use std::sync::Arc;

use uwcoop_core::event::{Event, Payload, VehicleId};
use uwcoop_core::navigator::origin::belief::{BeliefNavigator, BeliefOptions, Correlation};
use uwcoop_core::navigator::origin::central::{Cekf, CentralOptions, Received};
use uwcoop_core::navigator::origin::interleaved::{Interleaved, InterleavedOptions, TEAM_MOST};
use uwcoop_core::navigator::origin::local_options::LocalOptions;
use uwcoop_core::navigator::{CentralEstimator, Navigator, Outcome};
use uwcoop_core::packet::PacketKind;
use world::*;

const LOCAL: LocalOptions = LocalOptions {
    process_noise_m2_per_s3: 1e-4,
    process_noise_dvl_m2_per_s3: 1e-2,
    sigma_velocity0_mps: 1.0,
    sigma_odometry_scale: 1e-3,
    sigma_gyro_bias_radps: 0.0,
    sigma_range_m: 1.0,
    gate_sigmas: 6.0,
    clock: uwcoop_core::navigator::clock::ClockOptions::NONE,
};

fn belief(vehicle: VehicleId, correlation: Correlation) -> Box<dyn Navigator> {
    let options = BeliefOptions {
        local: LOCAL,
        correlation,
        process_noise_factor: 1.0,
        ranging: true,
        talking: true,
        packet: PacketKind::BeliefF64,
    };
    Box::new(BeliefNavigator::new(vehicle, 2, options, SOUND_SPEED_MPS).unwrap())
}

fn navigators(vehicle: VehicleId) -> Vec<Box<dyn Navigator>> {
    let options = InterleavedOptions { local: LOCAL, ranging: true };
    vec![
        belief(vehicle, Correlation::Ignored),
        belief(vehicle, Correlation::Unknown),
        Box::new(Interleaved::new(vehicle, 2, options, SOUND_SPEED_MPS).unwrap()),
    ]
}

fn central() -> CentralOptions {
    CentralOptions {
        local: LOCAL,
        ranging: vec![false, true],
        sound_speed_mps: SOUND_SPEED_MPS,
        packet_bytes: 0,
    }
}

fn estimators() -> Vec<Box<dyn CentralEstimator>> {
    vec![Box::new(Cekf::new(central()).unwrap()), Box::new(Received::new(central()).unwrap())]
}

fn fix(t_ns: i64, vehicle: VehicleId, position_m: [f64; 2], variance: f64) -> Event {
    event(t_ns, vehicle, Payload::Fix { position_m, covariance_m2: [variance, 0.0, variance] })
}

fn heading(t_ns: i64, vehicle: VehicleId, yaw_rad: f64) -> Event {
    event(t_ns, vehicle, Payload::Heading { yaw_rad, sigma_rad: 0.03 })
}

fn velocity(t_ns: i64, vehicle: VehicleId, velocity_mps: [f64; 2]) -> Event {
    event(t_ns, vehicle, Payload::GroundVelocity { velocity_mps, sigma_mps: 0.05 })
}

fn heard(tol_ns: i64, receiver: VehicleId, sender: VehicleId, range_m: f64, bytes: Arc<[u8]>) -> Event {
    let toa_ns = tol_ns + (range_m / SOUND_SPEED_MPS * 1e9) as i64;
    event(toa_ns, receiver, Payload::Reception { sender, tol_ns, toa_ns, bytes })
}

/// Vehicle 0 stands with fixes, vehicle 1 moves east by DVL; both until `end_s`.
fn sensed(end_s: i64) -> Vec<Event> {
    let mut all = vec![fix(0, 0, [0.0, 0.0], 1.0), fix(0, 1, [100.0, 50.0], 4.0)];
    for s in 0..end_s {
        let t_ns = s * SECOND;
        all.push(fix(t_ns + 1, 0, [0.3 * (s as f64).sin(), 0.2], 9.0));
        all.push(heading(t_ns + 2, 1, 0.01 * (s as f64).cos()));
        all.push(velocity(t_ns + 3, 1, [1.5, 0.02]));
    }
    all
}

/// Both vehicles in one; a packet of vehicle 0 every ten seconds.
fn flown(navigators: &mut [Box<dyn Navigator>; 2], events: &[Event], from_s: i64, to_s: i64) {
    let range_to = |s: i64| (100.0 + 1.5 * s as f64).hypot(50.0);
    for s in from_s..to_s {
        for event in events.iter().filter(|e| (s * SECOND..(s + 1) * SECOND).contains(&e.t_ns)) {
            navigators[usize::from(event.vehicle)].handle(event).unwrap();
        }
        if s % 10 == 5 {
            let tol_ns = s * SECOND + SECOND / 2;
            let packet = navigators[0].transmit(tol_ns, 10_000).unwrap().unwrap();
            navigators[1].handle(&heard(tol_ns, 1, 0, range_to(s), packet)).unwrap();
        }
    }
}

fn pair(kind: usize) -> [Box<dyn Navigator>; 2] {
    [navigators(0).swap_remove(kind), navigators(1).swap_remove(kind)]
}

#[test]
fn what_no_honest_source_sends_changes_nothing() {
    for kind in 0..navigators(1).len() {
        let mut team = pair(kind);
        flown(&mut team, &sensed(30), 0, 30);
        let [mut server, mut own] = team;
        let now = 30 * SECOND;
        let before = own.snapshot().unwrap();
        let packet = server.transmit(now, 10_000).unwrap().unwrap();
        let mut bad = vec![
            fix(now, 1, [f64::NAN, 0.0], 1.0),
            fix(now, 1, [0.0, 0.0], -1.0),
            heading(now, 1, f64::INFINITY),
            velocity(now, 1, [0.0, f64::NAN]),
            fix(now - 20 * SECOND, 1, [0.0, 0.0], 1.0),
            fix(now, 0, [0.0, 0.0], 1.0),
            heard(now, 1, 9, 100.0, packet.clone()),
            heard(now, 1, 1, 100.0, packet.clone()),
            heard(now, 1, 0, -30.0, packet.clone()),
            fix(now + 100_000 * SECOND, 1, [0.0, 0.0], 1.0),
        ];
        let late = Payload::Reception { sender: 0, tol_ns: now, toa_ns: now + 2, bytes: packet };
        bad.push(event(now + 1, 1, late));
        for event in bad {
            assert!(own.handle(&event).is_err(), "{kind} {event:?}");
            assert_eq!(own.snapshot().unwrap(), before, "{kind} {event:?}");
        }
    }
}

#[test]
fn packets_that_are_damaged_repeated_or_of_another_family_are_counted_and_not_used() {
    for kind in 0..navigators(1).len() {
        let mut team = pair(kind);
        flown(&mut team, &sensed(30), 0, 30);
        let [mut server, mut own] = team;
        let tol_ns = 30 * SECOND;
        let packet = server.transmit(tol_ns, 10_000).unwrap().unwrap();
        let mut damaged = packet.to_vec();
        damaged[3] ^= 1;
        let other = pair((kind + 2) % 3)[0].transmit(tol_ns, 10_000).unwrap();
        assert!(other.is_none(), "it has not started");
        let later = tol_ns + SECOND;
        own.handle(&heading(later, 1, 0.0)).unwrap();
        let count = own.estimate(later).rejected;
        let mean = own.estimate(later).mean_m;
        let arrival = |bytes: &[u8]| {
            let toa_ns = tol_ns + SECOND / 10;
            event(later, 1, Payload::Reception { sender: 0, tol_ns, toa_ns, bytes: bytes.into() })
        };
        for bytes in [&damaged[..], &[], &packet[..packet.len() - 1]] {
            assert_eq!(own.handle(&arrival(bytes)).unwrap(), Outcome::Rejected);
        }
        assert_eq!(own.estimate(later).rejected, count + 3);
        assert_eq!(own.estimate(later).mean_m, mean);
        own.handle(&arrival(&packet)).unwrap();
        assert_eq!(own.handle(&arrival(&packet)).unwrap(), Outcome::Rejected, "a copy");
        assert!(server.transmit(tol_ns + 1, 3).is_err(), "a slot too short");
    }
}

#[test]
fn a_snapshot_holds_everything() {
    let events = sensed(60);
    for kind in 0..navigators(1).len() {
        let mut whole = pair(kind);
        flown(&mut whole, &events, 0, 60);
        let (mut first, mut second) = (pair(kind), pair(kind));
        flown(&mut first, &events, 0, 33);
        for k in 0..2 {
            second[k].restore(&first[k].snapshot().unwrap()).unwrap();
        }
        flown(&mut second, &events, 33, 60);
        for k in 0..2 {
            assert_eq!(second[k].snapshot().unwrap(), whole[k].snapshot().unwrap());
            assert_eq!(second[k].estimate(61 * SECOND), whole[k].estimate(61 * SECOND));
        }
    }
}

#[test]
fn a_central_filter_without_ranges_is_each_vehicles_own() {
    for mut team in estimators() {
        let mut alone = [belief(0, Correlation::Ignored), belief(1, Correlation::Ignored)];
        for event in sensed(40) {
            team.handle(event.vehicle, &event).unwrap();
            alone[usize::from(event.vehicle)].handle(&event).unwrap();
        }
        for (vehicle, own) in alone.iter().enumerate() {
            let (found, expected) =
                (team.estimate(vehicle as VehicleId, 41 * SECOND), own.estimate(41 * SECOND));
            for axis in 0..2 {
                assert!((found.mean_m[axis] - expected.mean_m[axis]).abs() < 1e-9);
            }
            for k in 0..3 {
                assert!((found.covariance_m2[k] - expected.covariance_m2[k]).abs() < 1e-9);
            }
        }
    }
}

#[test]
fn central_filters_use_a_signal_once_refuse_what_is_bad_and_stay_small() {
    for mut team in estimators() {
        let mut largest = 0;
        for event in sensed(300) {
            let second = event.t_ns / SECOND;
            let starts = event.t_ns % SECOND == 3;
            team.handle(event.vehicle, &event).unwrap();
            if starts && second % 10 == 5 {
                let tol_ns = event.t_ns + SECOND / 2;
                assert!(team.launch(0, tol_ns).unwrap());
                let arrival = heard(tol_ns, 1, 0, (100.0 + 1.5 * second as f64).hypot(50.0), Arc::new([]));
                let before = team.estimate(1, arrival.t_ns).covariance_m2;
                assert_eq!(team.handle(1, &arrival).unwrap(), Outcome::Fused);
                let after = team.estimate(1, arrival.t_ns);
                assert!(after.covariance_m2[0] < before[0]);
                assert_eq!(team.handle(1, &arrival).unwrap(), Outcome::Rejected);
                assert_eq!(team.estimate(1, arrival.t_ns).mean_m, after.mean_m);
                assert_eq!(team.estimate(1, arrival.t_ns).rejected, after.rejected + 1);
            }
            if second == 150 {
                largest = largest.max(team.snapshot().unwrap().len());
            }
        }
        assert!(team.snapshot().unwrap().len() <= largest + largest / 4, "memory grows with the mission");
        let before = team.snapshot().unwrap();
        let now = 300 * SECOND;
        assert!(team.handle(1, &fix(now, 1, [f64::NAN, 0.0], 1.0)).is_err());
        assert!(team.handle(0, &fix(now, 1, [0.0, 0.0], 1.0)).is_err());
        assert!(team.handle(7, &fix(now, 7, [0.0, 0.0], 1.0)).is_err());
        assert!(team.handle(1, &heard(now, 1, 5, 10.0, Arc::new([]))).is_err());
        assert!(team.launch(0, 0).is_err() && team.launch(9, now).is_err());
        assert_eq!(team.snapshot().unwrap(), before);
    }
}

#[test]
fn teams_too_large_for_a_bank_are_refused() {
    let options = InterleavedOptions { local: LOCAL, ranging: true };
    assert!(Interleaved::new(0, TEAM_MOST, options, SOUND_SPEED_MPS).is_ok());
    assert!(Interleaved::new(0, TEAM_MOST + 1, options, SOUND_SPEED_MPS).is_err());
    assert!(Interleaved::new(3, 2, options, SOUND_SPEED_MPS).is_err());
}

#[test]
fn odometry_moves_a_vehicle_that_then_has_no_velocity() {
    let mut own = belief(1, Correlation::Ignored);
    own.handle(&fix(0, 1, [10.0, 20.0], 0.01)).unwrap();
    own.handle(&heading(0, 1, std::f64::consts::FRAC_PI_2)).unwrap();
    let step = |t_ns, yaw_change_rad| {
        let covariance = [0.04, 0.0, 0.0, 0.04, 0.0, 0.0];
        event(t_ns, 1, Payload::Odometry { displacement_m: [3.0, 1.0], yaw_change_rad, covariance })
    };
    own.handle(&step(SECOND, -std::f64::consts::FRAC_PI_2)).unwrap();
    let after = own.estimate(100 * SECOND);
    // Facing north, forward is north and left is west; and nothing moves while nobody says so.
    assert!((after.mean_m[0] - 9.0).abs() < 1e-9 && (after.mean_m[1] - 23.0).abs() < 1e-9);
    assert_eq!(after.covariance_m2, own.estimate(SECOND).covariance_m2);
    own.handle(&step(2 * SECOND, 0.0)).unwrap();
    let then = own.estimate(2 * SECOND);
    assert!((then.mean_m[0] - 12.0).abs() < 1e-9 && (then.mean_m[1] - 24.0).abs() < 1e-9);
    assert!(then.covariance_m2[0] > after.covariance_m2[0] + 0.039);
    own.handle(&velocity(3 * SECOND, 1, [1.0, 0.0])).unwrap();
    assert_eq!(own.estimate(3 * SECOND).mean_m, then.mean_m);
}
