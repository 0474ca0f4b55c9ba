//! The event loop of a team: order, losses, delivery, snapshots.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests fail by panicking")]

mod world;

use std::sync::{Arc, Mutex};

use uwcoop_core::error::Error;
use uwcoop_core::event::{Class, Event, Payload, VehicleId};
use uwcoop_core::link::{LinkConfig, Slot};
use uwcoop_core::navigator::{CentralEstimator, Estimate, Kinds, Navigator, Outcome, Profile, Status};
use uwcoop_core::random::{Purpose, Streams};
use uwcoop_core::replay::{Estimators, Mission, Opportunity, Replay, Tracks};
use world::*;

/// What a fake saw: (time, vehicle, what).
type Seen = Arc<Mutex<Vec<(i64, VehicleId, String)>>>;

fn name(payload: &Payload) -> String {
    match payload {
        Payload::Reception { sender, bytes, .. } => format!("reception from {sender}, {} bytes", bytes.len()),
        Payload::Delivered { to, tol_ns } => format!("delivered to {to}, {tol_ns}"),
        Payload::Depth { depth_m, .. } => format!("depth {depth_m}"),
        Payload::Landed => "landed".into(),
        other => format!("{:?}", other.class()),
    }
}

/// Writes down what it is told and sends packets of a fixed length.
struct Fake {
    vehicle: VehicleId,
    seen: Seen,
    packet_bytes: usize,
    oracle: bool,
}

fn nothing(t_ns: i64) -> Estimate {
    Estimate {
        t_ns,
        mean_m: [0.0; 2],
        covariance_m2: [1.0, 0.0, 1.0],
        yaw: None,
        ess: None,
        rejected: 0,
        status: Status::Navigating,
    }
}

impl Navigator for Fake {
    fn handle(&mut self, event: &Event) -> Result<Outcome, Error> {
        assert_eq!(event.vehicle, self.vehicle);
        self.seen.lock().unwrap().push((event.t_ns, event.vehicle, name(&event.payload)));
        Ok(Outcome::Fused)
    }

    fn transmit(&mut self, tol_ns: i64, _capacity_bytes: usize) -> Result<Option<Arc<[u8]>>, Error> {
        self.seen.lock().unwrap().push((tol_ns, self.vehicle, "transmit".into()));
        Ok((self.packet_bytes > 0).then(|| vec![self.vehicle as u8; self.packet_bytes].into()))
    }

    fn estimate(&self, t_ns: i64) -> Estimate {
        nothing(t_ns)
    }

    fn snapshot(&self) -> Result<Vec<u8>, Error> {
        Ok(Vec::new())
    }

    fn restore(&mut self, _snapshot: &[u8]) -> Result<(), Error> {
        Ok(())
    }

    fn profile(&self) -> Profile {
        Profile {
            takes_ranges: true,
            has_checksum: false,
            needs_delivery_oracle: self.oracle,
            uses: Kinds::all(),
        }
    }
}

/// A team of fakes; `packet_bytes` and `oracle` for each vehicle.
fn fakes(seen: &Seen, packet_bytes: &[usize], oracle: &[bool]) -> Estimators {
    let fake = |(vehicle, (&packet_bytes, &oracle))| {
        let fake = Fake { vehicle: vehicle as VehicleId, seen: seen.clone(), packet_bytes, oracle };
        Box::new(fake) as Box<dyn Navigator>
    };
    Estimators::Each(packet_bytes.iter().zip(oracle).enumerate().map(fake).collect())
}

/// Frames of 32 bytes, up to 4 of them, half a second each after 0.1 s of preamble.
fn link() -> LinkConfig {
    LinkConfig::new(32, 4, 0.5, 0.1, SOUND_SPEED_MPS).unwrap()
}

fn slot(tol_ns: i64, sender: VehicleId) -> Slot {
    Slot { tol_ns, sender, capacity_bytes: 128 }
}

fn opportunity(tol_ns: i64, sender: VehicleId, receiver: VehicleId, toa_ns: i64) -> Opportunity {
    Opportunity { tol_ns, sender, receiver, toa_ns, survive_probability: 1.0, draws: vec![0.5; 4] }
}

fn run(mission: Mission, team: Estimators) -> Result<Tracks, Error> {
    let end_ns = mission.end_ns();
    let mut replay = Replay::new(Arc::new(mission), team, Arc::from([0, end_ns]), 0)?;
    replay.run()?;
    Ok(replay.into_tracks())
}

fn depth(t_ns: i64, vehicle: VehicleId, depth_m: f64) -> Event {
    event(t_ns, vehicle, Payload::Depth { depth_m, sigma_m: 0.1 })
}

#[test]
fn ties_are_sensors_receptions_transmissions_roles_then_vehicle_then_sequence() {
    assert!(
        Class::Sensor < Class::Reception
            && Class::Reception < Class::Transmit
            && Class::Transmit < Class::Role
    );
    let t = 10 * SECOND;
    // Given in the wrong order on purpose; vehicle 1's two depths keep theirs.
    let events = vec![
        event(t, 0, Payload::Landed),
        depth(t, 2, 20.0),
        depth(t, 1, 12.0),
        depth(t, 1, 11.0),
        event(t, 1, Payload::Landed),
        depth(t, 0, 10.0),
        depth(t - 1, 2, 1.0),
        depth(t + 1, 0, 2.0),
    ];
    // The packet of the slot at 5 s ends its decoding exactly at t: one frame, 0.6 s.
    let toa = t - 600_000_000;
    let slots = vec![slot(5 * SECOND, 0), slot(t, 2)];
    let opportunities = vec![opportunity(5 * SECOND, 0, 2, toa), opportunity(5 * SECOND, 0, 1, toa)];
    let seen = Seen::default();
    let mission = Mission::new(3, link(), events, slots, opportunities, 20 * SECOND).unwrap();
    run(mission, fakes(&seen, &[8, 8, 8], &[false; 3])).unwrap();
    let expected: Vec<(i64, VehicleId, &str)> = vec![
        (5 * SECOND, 0, "transmit"),
        (t - 1, 2, "depth 1"),
        (t, 0, "depth 10"),
        (t, 1, "depth 12"),
        (t, 1, "depth 11"),
        (t, 2, "depth 20"),
        (t, 1, "reception from 0, 8 bytes"),
        (t, 2, "reception from 0, 8 bytes"),
        (t, 2, "transmit"),
        (t, 0, "landed"),
        (t, 1, "landed"),
        (t + 1, 0, "depth 2"),
    ];
    let seen = seen.lock().unwrap();
    let seen: Vec<_> = seen.iter().map(|(t, v, what)| (*t, *v, what.as_str())).collect();
    assert_eq!(seen, expected);
}

#[test]
fn a_record_is_taken_after_everything_of_its_instant() {
    let seen = Seen::default();
    let mission =
        Mission::new(1, link(), vec![event(SECOND, 0, Payload::Landed)], vec![], vec![], SECOND).unwrap();
    let mut replay =
        Replay::new(Arc::new(mission), fakes(&seen, &[0], &[false]), Arc::from([SECOND]), 0).unwrap();
    replay.run_until(SECOND).unwrap();
    assert!(seen.lock().unwrap().is_empty(), "until is exclusive");
    replay.run_until(SECOND + 1).unwrap();
    assert_eq!(seen.lock().unwrap().len(), 1);
    let tracks = replay.into_tracks();
    assert_eq!((tracks.t_ns, tracks.mean_m), (vec![SECOND], vec![[0.0; 2]]));
}

#[test]
fn a_reception_is_stamped_when_its_decoding_ends() {
    for (bytes, frames) in [(0, 0), (1, 1), (32, 1), (33, 2), (128, 4)] {
        let seen = Seen::default();
        let toa = 1_234_567_890;
        let mission = Mission::new(
            2,
            link(),
            vec![],
            vec![slot(SECOND, 0)],
            vec![opportunity(SECOND, 0, 1, toa)],
            9 * SECOND,
        );
        let tracks = run(mission.unwrap(), fakes(&seen, &[bytes, 0], &[false; 2])).unwrap();
        let seen = seen.lock().unwrap();
        if frames == 0 {
            assert_eq!(seen.len(), 1, "silence is not heard");
            assert!(tracks.packets.is_empty() && tracks.sent.is_empty());
            continue;
        }
        let decoded = toa + 100_000_000 + frames * 500_000_000;
        assert_eq!(seen[1], (decoded, 1, format!("reception from 0, {bytes} bytes")));
        assert_eq!(tracks.sent, vec![(0, SECOND, bytes as u32)]);
        let packet = tracks.packets[0];
        assert_eq!(
            (packet.frames, packet.toa_ns, packet.received, packet.accepted),
            (frames as u32, toa, true, true)
        );
    }
}

#[test]
fn a_packet_needs_as_many_draws_as_it_has_frames() {
    // (draws, bytes, received) at p = 0.5: a draw below p survives.
    let cases: [(&[f64], usize, bool); 8] = [
        (&[0.1, 0.9], 32, true),
        (&[0.9, 0.1], 32, false),
        (&[0.1, 0.9], 33, false),
        (&[0.1, 0.4], 64, true),
        (&[0.1, 0.4, 0.9], 64, true),
        (&[0.1, 0.4, 0.9], 65, false),
        // A draw at p does not survive, and a frame without a draw does not either.
        (&[0.5], 1, false),
        (&[0.1], 33, false),
    ];
    for (draws, bytes, received) in cases {
        let seen = Seen::default();
        let mut o = opportunity(SECOND, 0, 1, 2 * SECOND);
        (o.survive_probability, o.draws) = (0.5, draws.to_vec());
        let mission = Mission::new(2, link(), vec![], vec![slot(SECOND, 0)], vec![o], 9 * SECOND).unwrap();
        let tracks = run(mission, fakes(&seen, &[bytes, 0], &[false; 2])).unwrap();
        assert_eq!(tracks.packets[0].received, received, "{draws:?} and {bytes} bytes");
        assert_eq!(seen.lock().unwrap().len(), 1 + usize::from(received));
    }
}

#[test]
fn at_one_half_half_of_the_packets_and_a_quarter_of_the_long_ones_arrive() {
    let count = 20_000;
    let mut draws = vec![0.0; 2 * count];
    Streams::new(77, 0).at(Purpose::Process, 0).uniforms(0, &mut draws);
    for (bytes, expected) in [(15, 0.5), (47, 0.25)] {
        let tol = |k: usize| 10 * SECOND * k as i64;
        let slots = (0..count).map(|k| slot(tol(k), 0)).collect();
        let opportunities = (0..count)
            .map(|k| {
                let mut o = opportunity(tol(k), 0, 1, tol(k) + SECOND);
                (o.survive_probability, o.draws) = (0.5, draws[2 * k..2 * k + 2].to_vec());
                o
            })
            .collect();
        let mission = Mission::new(2, link(), vec![], slots, opportunities, tol(count)).unwrap();
        let seen = Seen::default();
        let tracks = run(mission, fakes(&seen, &[bytes, 0], &[false; 2])).unwrap();
        let share = tracks.packets.iter().filter(|p| p.received).count() as f64 / count as f64;
        let sigma = (expected * (1.0 - expected) / count as f64).sqrt();
        assert!((share - expected).abs() < 4.5 * sigma, "{bytes} bytes: {share} where {expected} is due");
        let heard = seen.lock().unwrap().iter().filter(|s| s.2.starts_with("reception")).count();
        assert_eq!(heard, tracks.packets.iter().filter(|p| p.received).count());
    }
}

#[test]
fn word_of_a_delivery_goes_to_those_who_ask_for_it_only() {
    let seen = Seen::default();
    let slots = vec![slot(SECOND, 0), slot(4 * SECOND, 1)];
    let mut lost = opportunity(SECOND, 0, 2, 2 * SECOND);
    lost.survive_probability = 0.0;
    let opportunities = vec![
        opportunity(SECOND, 0, 1, 2 * SECOND),
        lost,
        opportunity(4 * SECOND, 1, 0, 5 * SECOND),
        opportunity(4 * SECOND, 1, 2, 5 * SECOND),
    ];
    let mission = Mission::new(3, link(), vec![], slots, opportunities, 9 * SECOND).unwrap();
    run(mission, fakes(&seen, &[8; 3], &[true, false, true])).unwrap();
    let delivered: Vec<_> =
        seen.lock().unwrap().iter().filter(|s| s.2.starts_with("delivered")).cloned().collect();
    assert_eq!(delivered, vec![(2 * SECOND + 600_000_000, 0, format!("delivered to 1, {SECOND}"))]);
}

#[test]
fn a_packet_over_its_slot_or_its_modem_is_silence_in_that_slot_and_counted() {
    for (capacity_bytes, packet_bytes) in [(31, 32), (4096, 129)] {
        let seen = Seen::default();
        let slots = vec![Slot { tol_ns: SECOND, sender: 0, capacity_bytes }, slot(3 * SECOND, 1)];
        let opportunities =
            vec![opportunity(SECOND, 0, 1, 2 * SECOND), opportunity(3 * SECOND, 1, 0, 4 * SECOND)];
        let mission = Mission::new(2, link(), vec![], slots, opportunities, 9 * SECOND).unwrap();
        let tracks = run(mission, fakes(&seen, &[packet_bytes, 8], &[false; 2])).unwrap();
        // By vehicle, at the start and at the end.
        assert_eq!(tracks.unsent, [0, 1, 0, 0]);
        assert_eq!(tracks.sent, [(1, 3 * SECOND, 8)], "the others go on");
        assert_eq!(tracks.packets.len(), 1);
    }
}

/// A navigator that fails in a way that no slot explains.
struct Broken;

impl Navigator for Broken {
    fn handle(&mut self, _event: &Event) -> Result<Outcome, Error> {
        Ok(Outcome::Noted)
    }

    fn transmit(&mut self, _tol_ns: i64, _capacity_bytes: usize) -> Result<Option<Arc<[u8]>>, Error> {
        Err(Error::External("broken".into()))
    }

    fn estimate(&self, t_ns: i64) -> Estimate {
        nothing(t_ns)
    }

    fn snapshot(&self) -> Result<Vec<u8>, Error> {
        Ok(Vec::new())
    }

    fn restore(&mut self, _snapshot: &[u8]) -> Result<(), Error> {
        Ok(())
    }

    fn profile(&self) -> Profile {
        Profile { takes_ranges: true, has_checksum: false, needs_delivery_oracle: false, uses: Kinds::all() }
    }
}

#[test]
fn an_error_that_is_no_misfit_stops_the_replay() {
    let mission = Mission::new(1, link(), vec![], vec![slot(SECOND, 0)], vec![], 9 * SECOND).unwrap();
    let refused = run(mission, Estimators::Each(vec![Box::new(Broken)]));
    assert_eq!(refused.unwrap_err(), Error::External("broken".into()));
}

#[test]
fn a_vehicle_too_far_or_too_deep_for_its_packet_keeps_silent_and_the_others_go_on() {
    let chart = rich();
    // Beyond 32.768 km, more uncertain than 3,922 m, and deeper than any field; each for itself.
    for (name, position_m, variance_m2, depth_m, silent) in [
        ("far", [40_000.0, 0.0], 25.0, 3.0, true),
        ("lost", [0.0, 0.0], 1e8, 3.0, true),
        ("deepest", [0.0, 0.0], 25.0, 10_935.0, false),
    ] {
        let events =
            vec![fix(0, 0, position_m, variance_m2), depth(0, 0, depth_m), fix(0, 1, [100.0, 0.0], 25.0)];
        let slots = vec![slot(SECOND, 0), slot(3 * SECOND, 1)];
        let mission = Mission::new(2, link(), events, slots, vec![], 9 * SECOND).unwrap();
        // A vehicle that searches for its position is silent by itself: this one does not search.
        let mut options = mpf_options(60);
        options.terrain.acquisition_sigma_m = 1e6;
        let member = |own| Box::new(mpf::<2>(own, 2, options, &chart, 11)) as Box<dyn Navigator>;
        let tracks = run(mission, Estimators::Each(vec![member(0), member(1)])).unwrap();
        assert_eq!(tracks.unsent, [0, u64::from(silent), 0, 0], "{name}");
        assert_eq!(tracks.sent.len(), if silent { 1 } else { 2 }, "{name}");
    }
}

#[test]
fn a_mission_that_contradicts_itself_is_refused() {
    let good = opportunity(SECOND, 0, 1, 2 * SECOND);
    let slots = || vec![slot(SECOND, 0)];
    let with = |change: fn(&mut Opportunity)| {
        let mut o = good.clone();
        change(&mut o);
        Mission::new(2, link(), vec![], slots(), vec![o], 9 * SECOND)
    };
    assert!(with(|_| ()).is_ok());
    for change in [
        (|o| o.sender = 1) as fn(&mut Opportunity),
        |o| o.receiver = 2,
        |o| o.tol_ns += 1,
        |o| o.toa_ns = o.tol_ns - 1,
        |o| o.survive_probability = 1.5,
        |o| o.survive_probability = f64::NAN,
        |o| o.draws[2] = -0.1,
        |o| o.draws[0] = f64::NAN,
    ] {
        assert!(with(change).is_err());
    }
    let event_of = |vehicle, depth_m| vec![depth(0, vehicle, depth_m)];
    assert!(Mission::new(2, link(), event_of(2, 1.0), vec![], vec![], SECOND).is_err());
    assert!(Mission::new(2, link(), event_of(0, f64::NAN), vec![], vec![], SECOND).is_err());
    assert!(Mission::new(2, link(), vec![], vec![slot(SECOND, 2)], vec![], SECOND).is_err());
    let mission = Arc::new(Mission::new(2, link(), vec![], vec![], vec![], SECOND).unwrap());
    let alone = fakes(&Seen::default(), &[8], &[false]);
    assert!(Replay::new(mission, alone, Arc::from([]), 0).is_err(), "one navigator for two vehicles");
}

/// A centralised reference that writes down whom it hears of.
struct Central {
    seen: Seen,
}

impl CentralEstimator for Central {
    fn handle(&mut self, vehicle: VehicleId, event: &Event) -> Result<Outcome, Error> {
        assert_eq!(vehicle, event.vehicle);
        self.seen.lock().unwrap().push((event.t_ns, vehicle, name(&event.payload)));
        Ok(Outcome::Fused)
    }

    fn estimate(&self, vehicle: VehicleId, t_ns: i64) -> Estimate {
        Estimate { mean_m: [f64::from(vehicle), 0.0], ..nothing(t_ns) }
    }

    fn launch(&mut self, vehicle: VehicleId, tol_ns: i64) -> Result<bool, Error> {
        self.seen.lock().unwrap().push((tol_ns, vehicle, "launch".into()));
        Ok(true)
    }

    fn profile(&self) -> Profile {
        Profile { takes_ranges: true, has_checksum: false, needs_delivery_oracle: false, uses: Kinds::all() }
    }

    fn assumed_packet_bytes(&self) -> usize {
        33
    }

    fn snapshot(&self) -> Result<Vec<u8>, Error> {
        Ok(Vec::new())
    }

    fn restore(&mut self, _snapshot: &[u8]) -> Result<(), Error> {
        Ok(())
    }
}

#[test]
fn a_team_estimator_is_fed_everybody_and_sends_nothing() {
    let seen = Seen::default();
    let events = (0..3).map(|v| depth(SECOND, v, f64::from(v))).collect();
    let slots = vec![slot(2 * SECOND, 1)];
    let mut short = opportunity(2 * SECOND, 1, 2, 3 * SECOND);
    short.draws.truncate(1);
    let opportunities = vec![opportunity(2 * SECOND, 1, 0, 3 * SECOND), short];
    let mission = Mission::new(3, link(), events, slots, opportunities, 9 * SECOND).unwrap();
    let tracks = run(mission, Estimators::Central(Box::new(Central { seen: seen.clone() }))).unwrap();
    let seen = seen.lock().unwrap();
    // Its ranges ride on an assumed packet of two frames: that decides loss and air time, and no bytes travel.
    let decoded = 3 * SECOND + 1_100_000_000;
    let expected: Vec<(i64, VehicleId, String)> = vec![
        (SECOND, 0, "depth 0".into()),
        (SECOND, 1, "depth 1".into()),
        (SECOND, 2, "depth 2".into()),
        (2 * SECOND, 1, "launch".into()),
        (decoded, 0, "reception from 1, 0 bytes".into()),
    ];
    assert_eq!(*seen, expected);
    assert_eq!(tracks.packets.iter().map(|p| p.received).collect::<Vec<_>>(), [true, false]);
    assert_eq!(tracks.mean_m, [[0.0; 2], [0.0; 2], [1.0, 0.0], [1.0, 0.0], [2.0, 0.0], [2.0, 0.0]]);
}

/// Three vehicles on straight tracks for a minute, a slot every 3 s, a fifth of the packets lost.
fn real_mission() -> Mission {
    let tracks = [
        |t: f64| [80.0 + 1.4 * t, 90.0 + 0.3 * t],
        |t: f64| [250.0 - 0.9 * t, 100.0 + 1.1 * t],
        |t: f64| [150.0 + 0.2 * t, 300.0 - 1.4 * t],
    ];
    let vehicles: Vec<_> = tracks.into_iter().enumerate().map(|(k, t)| Vehicle::new(k as u16, t)).collect();
    let mut events: Vec<Event> = vehicles.iter().map(|v| fix(0, v.index, v.position_m(0), 25.0)).collect();
    for second in 0..=60 {
        events.extend(vehicles.iter().flat_map(|v| v.second(second, rich_depth)));
    }
    let mut draws = vec![0.0; 200];
    Streams::new(3, 0).at(Purpose::Process, 0).uniforms(0, &mut draws);
    let mut draws = draws.chunks(2);
    let (mut slots, mut opportunities) = (Vec::new(), Vec::new());
    for k in 1..=19 {
        let (tol_ns, sender) = (3 * k * SECOND, (k % 3) as VehicleId);
        slots.push(Slot { tol_ns, sender, capacity_bytes: 64 });
        for receiver in (0..3).filter(|r| *r != sender) {
            let from = vehicles[usize::from(sender)].position_m(tol_ns);
            let range_m = distance(from, vehicles[usize::from(receiver)].position_m(tol_ns));
            opportunities.push(Opportunity {
                tol_ns,
                sender,
                receiver,
                toa_ns: tol_ns + (range_m / SOUND_SPEED_MPS * 1e9) as i64,
                survive_probability: 0.8,
                draws: draws.next().unwrap().to_vec(),
            });
        }
    }
    Mission::new(3, link(), events, slots, opportunities, 60 * SECOND).unwrap()
}

fn real_team(kind: &str) -> Estimators {
    let chart = rich();
    let member = |own| -> Box<dyn Navigator> {
        match kind {
            "dmpf" => Box::new(dmpf(own, 3, dmpf_options(60), &chart, 11)),
            "mpf<2>" => Box::new(mpf::<2>(own, 3, mpf_options(60), &chart, 11)),
            _ => Box::new(mpf::<4>(own, 3, mpf_options(60), &chart, 11)),
        }
    };
    Estimators::Each((0..3).map(member).collect())
}

#[test]
fn a_mission_resumed_from_a_snapshot_equals_the_uninterrupted_one() {
    let mission = Arc::new(real_mission());
    let samples: Arc<[i64]> = (0..=120).map(|k| k * SECOND / 2).collect();
    for kind in ["dmpf", "mpf<2>", "mpf<4>"] {
        let fresh = || Replay::new(mission.clone(), real_team(kind), samples.clone(), 10).unwrap();
        let mut whole = fresh();
        whole.run().unwrap();
        // Debug text of an f64 gives back its bits, and NaN equals NaN.
        let whole = format!("{:?}", whole.into_tracks());
        assert!(whole.contains("accepted: true") && whole.contains("received: false"));
        // At the start, between two events, while a packet is in the water (decoding takes 0.6 s), and at the end.
        let cuts = [0, 10 * SECOND + 1, 30 * SECOND + 300_000_000, i64::MAX];
        for cut in cuts {
            let mut first = fresh();
            first.run_until(cut).unwrap();
            let snapshot = first.snapshot().unwrap();
            first.run().unwrap();
            assert!(
                format!("{:?}", first.into_tracks()) == whole,
                "{kind}: a snapshot at {cut} ns changed its run"
            );
            let mut second = fresh();
            second.restore(&snapshot).unwrap();
            assert_eq!(second.snapshot().unwrap(), snapshot, "{kind} at {cut} ns");
            second.run().unwrap();
            assert!(format!("{:?}", second.into_tracks()) == whole, "{kind} resumed at {cut} ns differs");
        }
        // One after another.
        let mut replay = fresh();
        for cut in cuts {
            let mut next = fresh();
            replay.run_until(cut).unwrap();
            next.restore(&replay.snapshot().unwrap()).unwrap();
            replay = next;
        }
        assert!(format!("{:?}", replay.into_tracks()) == whole, "{kind} resumed again and again differs");
    }
}

#[test]
fn a_snapshot_of_another_mission_is_refused() {
    let mission = Arc::new(real_mission());
    let replay =
        |samples: &[i64]| Replay::new(mission.clone(), real_team("dmpf"), samples.into(), 0).unwrap();
    let mut one = replay(&[0, SECOND]);
    one.run_until(SECOND).unwrap();
    let snapshot = one.snapshot().unwrap();
    assert!(replay(&[0, 2 * SECOND]).restore(&snapshot).is_err());
    assert!(replay(&[0, SECOND]).restore(&snapshot[..snapshot.len() / 2]).is_err());
    assert!(replay(&[0, SECOND]).restore(&[]).is_err());
}
