//! Navigators that exchange pose graphs: bad input, snapshots, late decoding, memory.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests fail by panicking")]

use std::sync::Arc;

use uwcoop_core::event::{Event, Payload, VehicleId};
use uwcoop_core::information::replica::Methods;
use uwcoop_core::navigator::origin::deif::{Deif, Repair};
use uwcoop_core::navigator::origin::lasting::LastingOptions;
use uwcoop_core::navigator::origin::local_options::LocalOptions;
use uwcoop_core::navigator::origin::mdeif::{Mdeif, MdeifOptions};
use uwcoop_core::navigator::{Navigator, Outcome};
use uwcoop_core::packet::graph::GraphForm;

const SECOND: i64 = 1_000_000_000;
const SOUND: f64 = 1500.0;
const CAPACITY: usize = 1 << 20;

fn local() -> LocalOptions {
    LocalOptions {
        process_noise_m2_per_s3: 1e-4,
        process_noise_dvl_m2_per_s3: 1e-2,
        sigma_velocity0_mps: 1.0,
        sigma_odometry_scale: 1e-3,
        sigma_gyro_bias_radps: 0.0,
        sigma_range_m: 1.0,
        gate_sigmas: 6.0,
        clock: uwcoop_core::navigator::clock::ClockOptions::NONE,
    }
}

fn mdeif(own: VehicleId, ranging: &[bool], form: GraphForm) -> Mdeif {
    let methods = Methods { joint: true, lags: 6, equation_6: true, loss_max: 1e-4 };
    let options =
        MdeifOptions { local: local(), lasting: LastingOptions::NONE, form, exact_lags: 2, methods };
    Mdeif::new(own, ranging, options, SOUND).unwrap()
}

fn event(t_ns: i64, vehicle: VehicleId, payload: Payload) -> Event {
    Event { t_ns, vehicle, payload }
}

fn fix(t_ns: i64, vehicle: VehicleId, x: f64, sigma: f64) -> Event {
    let v = sigma * sigma;
    event(t_ns, vehicle, Payload::Fix { position_m: [x, 0.0], covariance_m2: [v, 0.0, v] })
}

fn heard(t_ns: i64, own: VehicleId, sender: VehicleId, tol_ns: i64, range_m: f64, bytes: &[u8]) -> Event {
    let toa_ns = tol_ns + (range_m / SOUND * 1e9) as i64;
    event(t_ns, own, Payload::Reception { sender, tol_ns, toa_ns, bytes: Arc::from(bytes) })
}

/// A ship that takes fixes at 1 Hz and an AUV with heading and DVL; the state of both after `seconds`.
fn drive(ship: &mut dyn Navigator, auv: &mut dyn Navigator, from_s: i64, to_s: i64) {
    for t in from_s..to_s {
        let wobble = ((t * 7919) % 13) as f64 / 6.5 - 1.0;
        ship.handle(&fix(t * SECOND, 0, 300.0 + 2.0 * wobble, 3.0)).unwrap();
        if t == 0 {
            auv.handle(&fix(0, 1, 0.0, 1.0)).unwrap();
        }
        for third in 0..3 {
            let t_ns = t * SECOND + third * SECOND / 3;
            let heading = Payload::Heading { yaw_rad: 0.3, sigma_rad: 0.035 };
            auv.handle(&event(t_ns, 1, heading)).unwrap();
            let velocity = Payload::GroundVelocity { velocity_mps: [0.5, 0.02 * wobble], sigma_mps: 0.05 };
            auv.handle(&event(t_ns, 1, velocity)).unwrap();
        }
    }
}

/// Launch times and packets.
type Launches = Vec<(i64, Arc<[u8]>)>;

/// Ship and AUV under way, with a packet exchanged each ten seconds.
fn under_way(form: GraphForm, until_s: i64) -> (Mdeif, Mdeif, Launches) {
    let (mut ship, mut auv) = (mdeif(0, &[false, true], form), mdeif(1, &[false, true], form));
    let mut packets = Vec::new();
    for k in 0..until_s / 10 {
        drive(&mut ship, &mut auv, k * 10, k * 10 + 10);
        let tol_ns = (k * 10 + 9) * SECOND + SECOND * 7 / 10;
        let bytes = ship.transmit(tol_ns, CAPACITY).unwrap().unwrap();
        let range_m = 300.0 - 4.7 * (k + 1) as f64;
        let late_ns = tol_ns + (range_m / SOUND * 1e9) as i64;
        assert_eq!(auv.handle(&heard(late_ns, 1, 0, tol_ns, range_m, &bytes)), Ok(Outcome::Fused));
        packets.push((tol_ns, bytes));
    }
    (ship, auv, packets)
}

const FORMS: [GraphForm; 4] = [GraphForm::F64, GraphForm::Frame32, GraphForm::Frame64, GraphForm::Frame256];

#[test]
fn packets_fit_their_frames() {
    for (form, most) in FORMS.into_iter().zip([44 * 8 * 3 + 32, 32, 64, 256]) {
        let (_, _, packets) = under_way(form, 60);
        let longest = packets.iter().map(|(_, bytes)| bytes.len()).max().unwrap();
        assert!(longest <= most, "{form:?}: {longest} bytes");
    }
}

#[test]
fn bad_input_leaves_the_estimate_as_it_was() {
    for form in FORMS {
        let (mut ship, mut auv, packets) = under_way(form, 60);
        drive(&mut ship, &mut auv, 60, 70);
        let now_ns = 70 * SECOND;
        let good = ship.transmit(now_ns, CAPACITY).unwrap().unwrap();
        let before = auv.estimate(now_ns);
        let (old_ns, old) = &packets[2];
        let (last_ns, last) = packets.last().unwrap();
        let mut damaged = good.to_vec();
        damaged[5] ^= 0x10;
        let far = now_ns + 3_000 * SECOND;
        let cases = [
            ("replayed", heard(now_ns, 1, 0, *last_ns, 270.0, last)),
            ("reordered", heard(now_ns, 1, 0, *old_ns, 285.0, old)),
            ("damaged", heard(now_ns + SECOND, 1, 0, now_ns, 265.0, &damaged)),
            ("empty", heard(now_ns + SECOND, 1, 0, now_ns, 265.0, &[])),
            ("another slot", heard(now_ns + SECOND, 1, 0, now_ns - 1, 265.0, &good)),
            ("negative range", heard(now_ns + SECOND, 1, 0, now_ns, -10.0, &good)),
            ("no range", heard(now_ns + SECOND, 1, 0, now_ns, 0.0, &good)),
            ("far too long", heard(now_ns + SECOND, 1, 0, now_ns, 1200.0, &good)),
            ("arrives after it is decoded", heard(now_ns + SECOND, 1, 0, now_ns, 2e4, &good)),
            ("from itself", heard(now_ns + SECOND, 1, 1, now_ns, 265.0, &good)),
            ("from nobody", heard(now_ns + SECOND, 1, 7, now_ns, 265.0, &good)),
            ("the clock stepped back", fix(3 * SECOND, 1, 0.0, 1.0)),
            ("the clock stepped ahead", fix(far * 10, 1, 0.0, 1.0)),
            ("NaN", fix(now_ns + SECOND, 1, f64::NAN, 1.0)),
        ];
        for (name, event) in cases {
            let snapshot = auv.snapshot().unwrap();
            let outcome = auv.handle(&event);
            assert!(
                matches!(outcome, Err(_) | Ok(Outcome::Rejected | Outcome::Gated)),
                "{form:?}, {name}: {outcome:?}"
            );
            let after = auv.estimate(now_ns);
            if outcome.is_err() {
                assert_eq!(auv.snapshot().unwrap(), snapshot, "{form:?}, {name}: refused and yet changed");
            } else {
                assert!(after.rejected > 0, "{form:?}, {name} was not counted");
            }
            let off = (after.mean_m[0] - before.mean_m[0]).hypot(after.mean_m[1] - before.mean_m[1]);
            // A counted rejection moves the clock, nothing else.
            assert!(off < 1e-9, "{form:?}, {name}: moved by {off}");
            auv.restore(&snapshot).unwrap();
        }
        assert_eq!(
            auv.handle(&heard(now_ns + SECOND, 1, 0, now_ns, 300.0 - 0.478 * 70.0, &good)),
            Ok(Outcome::Fused),
            "{form:?}: after all that, a good packet is still one"
        );
    }
}

/// Nobody acknowledges: the origin's eight bits come round, and packets go on being read.
#[test]
fn an_origin_older_than_its_counter_is_still_known() {
    for form in FORMS {
        let (mut ship, mut auv) = (mdeif(0, &[false, true], form), mdeif(1, &[false, true], form));
        auv.handle(&fix(0, 1, 300.0, 2.0)).unwrap();
        for second in 0..4 * 300i64 {
            let now_ns = second * SECOND;
            ship.handle(&fix(now_ns, 0, 0.1 * (second % 7) as f64, 3.0)).unwrap();
            if second % 4 != 3 {
                continue;
            }
            let packet = ship.transmit(now_ns, CAPACITY).unwrap().unwrap();
            let outcome = auv.handle(&heard(now_ns + SECOND, 1, 0, now_ns, 300.0, &packet)).unwrap();
            assert_eq!(outcome, Outcome::Fused, "{form:?}, packet {}", second / 4);
        }
    }
}

#[test]
fn a_packet_of_an_unknown_origin_is_rejected_and_counted() {
    let (mut ship, mut auv, _) = under_way(GraphForm::F64, 60);
    drive(&mut ship, &mut auv, 60, 70);
    let unheard = ship.transmit(70 * SECOND, CAPACITY).unwrap().unwrap();
    // Somebody acknowledges, in the AUV's name, a packet that the AUV never received.
    let mut liar = mdeif(1, &[false, true], GraphForm::F64);
    liar.handle(&fix(0, 1, 0.0, 1.0)).unwrap();
    liar.handle(&heard(71 * SECOND, 1, 0, 70 * SECOND, 266.0, &unheard)).unwrap();
    let lie = liar.transmit(72 * SECOND, CAPACITY).unwrap().unwrap();
    ship.handle(&heard(73 * SECOND, 0, 1, 72 * SECOND, 266.0, &lie)).unwrap();
    for t in 73..100 {
        ship.handle(&fix(t * SECOND, 0, 300.0, 3.0)).unwrap();
    }
    for k in 0..4 {
        ship.transmit((100 + k) * SECOND, CAPACITY).unwrap().unwrap();
    }
    let packet = ship.transmit(110 * SECOND, CAPACITY).unwrap().unwrap();
    let before = auv.estimate(111 * SECOND);
    let outcome = auv.handle(&heard(111 * SECOND, 1, 0, 110 * SECOND, 266.0, &packet)).unwrap();
    assert_eq!(outcome, Outcome::Rejected);
    let after = auv.estimate(111 * SECOND);
    assert_eq!(after.rejected, before.rejected + 1);
    assert!((after.mean_m[0] - before.mean_m[0]).abs() < 1e-9);
    let counted = auv.diagnostics().into_iter().find(|(name, _)| *name == "unknown_origin").unwrap().1;
    assert!((counted - 1.0).abs() < f64::EPSILON);
}

#[test]
fn a_snapshot_goes_on_as_if_nothing_had_happened() {
    for form in FORMS {
        let (mut ship, mut auv, _) = under_way(form, 60);
        let mut resumed = mdeif(1, &[false, true], form);
        resumed.restore(&auv.snapshot().unwrap()).unwrap();
        drive(&mut ship, &mut auv, 60, 70);
        let mut other = mdeif(0, &[false, true], form);
        drive(&mut other, &mut resumed, 60, 70);
        let bytes = ship.transmit(70 * SECOND, CAPACITY).unwrap().unwrap();
        let reception = heard(71 * SECOND, 1, 0, 70 * SECOND, 266.0, &bytes);
        assert_eq!(auv.handle(&reception), resumed.handle(&reception));
        assert_eq!(auv.estimate(72 * SECOND), resumed.estimate(72 * SECOND));
        assert_eq!(auv.snapshot().unwrap(), resumed.snapshot().unwrap());
    }
}

#[test]
fn decoding_that_takes_seconds_changes_nothing() {
    let (mut ship, mut prompt, _) = under_way(GraphForm::F64, 60);
    let mut late = mdeif(1, &[false, true], GraphForm::F64);
    late.restore(&prompt.snapshot().unwrap()).unwrap();
    drive(&mut ship, &mut prompt, 60, 70);
    let mut twin = mdeif(0, &[false, true], GraphForm::F64);
    drive(&mut twin, &mut late, 60, 70);
    let tol_ns = 69 * SECOND + SECOND * 7 / 10;
    let bytes = ship.transmit(tol_ns, CAPACITY).unwrap().unwrap();
    let (range_m, decoded_ns) = (266.0, 76 * SECOND);
    prompt.handle(&heard(tol_ns + SECOND / 5, 1, 0, tol_ns, range_m, &bytes)).unwrap();
    for navigator in [&mut prompt, &mut late] {
        let mut other = mdeif(0, &[false, true], GraphForm::F64);
        drive(&mut other, navigator, 70, 76);
    }
    late.handle(&heard(decoded_ns, 1, 0, tol_ns, range_m, &bytes)).unwrap();
    let (a, b) = (prompt.estimate(decoded_ns), late.estimate(decoded_ns));
    for k in 0..2 {
        assert!((a.mean_m[k] - b.mean_m[k]).abs() < 1e-9, "{a:?} {b:?}");
    }
    for k in 0..3 {
        assert!((a.covariance_m2[k] - b.covariance_m2[k]).abs() < 1e-9, "{a:?} {b:?}");
    }
}

#[test]
fn memory_does_not_grow_over_a_day() {
    for acknowledged in [true, false] {
        let (mut ship, mut auv) =
            (mdeif(0, &[false, true], GraphForm::F64), mdeif(1, &[false, true], GraphForm::F64));
        let (mut early, mut most) = (0, 0);
        let mut x = 0.0;
        for k in 0..24 * 60 {
            let t_ns = k * 60 * SECOND;
            ship.handle(&fix(t_ns, 0, 300.0, 3.0)).unwrap();
            if k == 0 {
                auv.handle(&fix(t_ns, 1, x, 1.0)).unwrap();
            }
            x = auv.estimate(t_ns).mean_m[0];
            let bytes = ship.transmit(t_ns, CAPACITY).unwrap().unwrap();
            let range = (300.0 - x).abs().max(10.0);
            auv.handle(&heard(t_ns + SECOND, 1, 0, t_ns, range, &bytes)).unwrap();
            if acknowledged {
                let back = auv.transmit(t_ns + 2 * SECOND, CAPACITY).unwrap().unwrap();
                ship.handle(&heard(t_ns + 3 * SECOND, 0, 1, t_ns + 2 * SECOND, range, &back)).unwrap();
            }
            let bytes = ship.snapshot().unwrap().len().max(auv.snapshot().unwrap().len());
            if k < 200 { early = early.max(bytes) } else { most = most.max(bytes) }
        }
        assert!(most < early + 256, "{early} bytes after hours, {most} later");
    }
}

#[test]
fn the_deif_is_refused_where_it_cannot_work() {
    let error = Deif::new(0, &[true, true], local(), Repair::Oracle, SOUND).err().unwrap();
    assert!(error.to_string().contains("one-way"), "{error}");
    assert!(Deif::new(0, &[false, true, true], local(), Repair::Repeat(3), SOUND).is_err());
    assert!(
        Deif::new(0, &[false, true], local(), Repair::Oracle, SOUND).unwrap().profile().needs_delivery_oracle
    );
    assert!(
        !Deif::new(0, &[false, true], local(), Repair::Repeat(3), SOUND)
            .unwrap()
            .profile()
            .needs_delivery_oracle
    );
}

#[test]
fn a_sender_whose_axes_differ_is_refused_the_isotropic_form() {
    let mut auv = mdeif(1, &[true, true], GraphForm::Frame32);
    let mut ship = mdeif(0, &[true, true], GraphForm::Frame32);
    drive(&mut ship, &mut auv, 0, 10);
    auv.transmit(10 * SECOND, CAPACITY).expect_err("a DVL's axes differ");
    ship.transmit(10 * SECOND, CAPACITY).expect("GPS alone");
}
