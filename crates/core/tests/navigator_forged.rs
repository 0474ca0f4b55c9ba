//! What forged packets can do where no tag stops them: move nobody further than honest doubt does, and never overflow.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests fail by panicking")]

#[allow(clippy::duplicate_mod, reason = "one small sea for several test binaries")]
mod seafloor;
mod world;

use std::sync::Arc;

use uwcoop_core::event::Payload;
use uwcoop_core::navigator::{Navigator, Outcome};
use uwcoop_core::packet::landmark::{ExchangeFormat, ExchangePacket, ExchangeSize};
use uwcoop_core::packet::{FixContent, ReportedFix, TeamLayout, TeamReport};
use world::fleet::*;
use world::{SECOND, distance, event, rich};

/// How far a role exchange that tells another pose of the old landmark moves that landmark's own estimate, m.
fn moved_by_exchange(name: usize, off_m: [f64; 2], off_rad: f64, claimed: f64) -> (&'static str, f64) {
    let (name, landmark) = seafloor::navigators(0, 2).remove(name);
    let mut pair = vec![landmark, seafloor::navigators(1, 2).remove(0).1];
    let mut sea = seafloor::Seafloor::new(2, 5);
    sea.start(&mut pair);
    sea.leg(60, 0, &mut pair);
    pair[1].handle(&event(sea.t_ns, 1, Payload::Landed)).unwrap();
    let honest = pair[1].transmit(sea.t_ns, 128).unwrap().unwrap();
    let format = ExchangeFormat::Two;
    let mut packet = ExchangePacket::decode(&honest, format, [0.0; 2], 1, sea.t_ns).unwrap();
    for mode in &mut packet.modes {
        mode.mean[0] = (mode.mean[0] + off_m[0]).clamp(-2047.0, 2047.0);
        mode.mean[1] = (mode.mean[1] + off_m[1]).clamp(-2047.0, 2047.0);
        mode.mean[2] += off_rad;
        mode.covariance *= claimed;
    }
    let bytes = packet.encode(format, ExchangeSize::B32, 1, sea.t_ns).unwrap();
    let before = pair[0].estimate(sea.t_ns).mean_m;
    let payload = Payload::Reception { sender: 1, tol_ns: sea.t_ns, toa_ns: sea.t_ns, bytes: bytes.into() };
    pair[0].handle(&event(sea.t_ns, 0, payload)).unwrap();
    (name, distance(pair[0].estimate(sea.t_ns).mean_m, before))
}

#[test]
fn a_forged_role_exchange_moves_no_vehicle_by_more_than_doubt() {
    for navigator in 0..4 {
        let (_, honest_m) = moved_by_exchange(navigator, [0.0; 2], 0.0, 1.0);
        assert!(honest_m < 1.0, "an honest exchange is believed: {honest_m} m");
        for off_m in [[2047.0, 2047.0], [-2047.0, 2047.0], [300.0, 0.0], [0.0, -60.0], [40.0, 40.0]] {
            for (off_rad, claimed) in [(0.0, 1.0), (0.0, 1e-3), (0.0, 1e4), (3.0, 1.0)] {
                // 2.9 km for the first one, once.
                let (name, m) = moved_by_exchange(navigator, off_m, off_rad, claimed);
                assert!(m < 1.0, "{name}: moved by {m} m for {off_m:?}, {off_rad} rad, claimed {claimed}");
            }
        }
    }
}

/// A packet of vehicle 0 with another fix in it.
fn with_fix(bytes: &Arc<[u8]>, tol_ns: i64, fix: ReportedFix) -> Arc<[u8]> {
    let options = team_options(3, 1);
    let layout = TeamLayout::new(3, options.frame_bytes - options.tag_bytes).unwrap();
    let mut report = TeamReport::default();
    report.decode(bytes, &layout, 0, tol_ns).unwrap();
    report.fix = Some(fix);
    // Beside a fix there is room for fewer soundings.
    report.soundings.truncate(layout.soundings_beside_fix());
    report.encode(&layout, 0, tol_ns).unwrap().into()
}

/// Vehicle 1's estimate at 40 s after a packet of vehicle 0 at 36 s, as sent or with a fix in it.
fn after_packet(fix: Option<ReportedFix>, particles: usize) -> [f64; 2] {
    let mut fleet = fleet_of(particles);
    play(&mut fleet, &acts(3, 35), |_, _, _| true);
    let tol_ns = 36 * SECOND;
    let mut bytes = fleet[0].transmit(tol_ns, CAPACITY).unwrap().unwrap();
    if let Some(fix) = fix {
        bytes = with_fix(&bytes, tol_ns, fix);
    }
    let heard = receptions(0, 3, tol_ns, &bytes).into_iter().find(|e| e.vehicle == 1).unwrap();
    fleet[1].handle(&heard).unwrap();
    fleet[1].estimate(40 * SECOND).mean_m
}

fn fleet_of(particles: usize) -> Vec<Box<dyn Navigator>> {
    let options = team_options(3, particles);
    (0..3).map(|v| Box::new(team_of(v, options.clone(), Some(rich()))) as Box<dyn Navigator>).collect()
}

#[test]
fn a_forged_fix_in_a_packet_moves_no_teammate_by_more_than_doubt() {
    let honest = after_packet(None, 400);
    for residual_m in [[12.0, 0.0], [-15.0, 15.0], [0.0, 15.9], [-15.9, -15.9]] {
        for sigma_m in [0.25, 1.0, 4.0] {
            let fix = ReportedFix { age_s: 1.0, content: FixContent::Residual(residual_m), sigma_m };
            // 22 to 31 m, once.
            let moved_m = distance(after_packet(Some(fix), 400), honest);
            assert!(
                moved_m < 3.0,
                "moved by {moved_m} m by a fix that is off by {residual_m:?}, sigma {sigma_m}"
            );
        }
    }
}

#[test]
fn who_joins_late_by_a_fix_that_is_no_start_is_taken_in_and_nothing_overflows() {
    for age_s in [0.0, 1.0, 30.0] {
        let mut fleet = fleet_of(60);
        // Vehicle 1 hears nobody, until a packet with a fix of a vehicle that it does not know.
        play(&mut fleet, &acts(3, 35), |_, receiver, _| receiver != 1);
        let tol_ns = 36 * SECOND;
        let bytes = fleet[0].transmit(tol_ns, CAPACITY).unwrap().unwrap();
        let fix = ReportedFix { age_s, content: FixContent::Residual([0.5, -0.5]), sigma_m: 2.0 };
        let bytes = with_fix(&bytes, tol_ns, fix);
        let heard = receptions(0, 3, tol_ns, &bytes).into_iter().find(|e| e.vehicle == 1).unwrap();
        assert_eq!(fleet[1].handle(&heard).unwrap(), Outcome::Fused, "age {age_s} s");
        let off_m = distance(fleet[1].estimate(40 * SECOND).mean_m, track(1, 40.0));
        assert!(off_m < 15.0, "{off_m} m");
    }
}
