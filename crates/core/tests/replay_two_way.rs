//! Two-way ranging in the event loop: a poll costs its bytes, and who does not hear one keeps silent.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests fail by panicking")]

mod world;

use std::sync::Arc;

use uwcoop_core::error::Error;
use uwcoop_core::event::{Event, VehicleId};
use uwcoop_core::link::{LinkConfig, Slot};
use uwcoop_core::navigator::{Estimate, Kinds, Navigator, Outcome, Profile, Status};
use uwcoop_core::replay::{Estimators, Mission, Opportunity, Poll, Replay, Tracks};
use world::SECOND;

/// Sends 31 bytes whenever it may; says whether it wants ranges.
struct Talker {
    transmitted: u8,
    takes_ranges: bool,
}

impl Navigator for Talker {
    fn handle(&mut self, _event: &Event) -> Result<Outcome, Error> {
        Ok(Outcome::Fused)
    }

    fn transmit(&mut self, _tol_ns: i64, _capacity_bytes: usize) -> Result<Option<Arc<[u8]>>, Error> {
        self.transmitted += 1;
        Ok(self.takes_ranges.then(|| vec![self.transmitted; 31].into()))
    }

    fn estimate(&self, t_ns: i64) -> Estimate {
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

    fn snapshot(&self) -> Result<Vec<u8>, Error> {
        Ok(vec![self.transmitted])
    }

    fn restore(&mut self, snapshot: &[u8]) -> Result<(), Error> {
        self.transmitted = snapshot[0];
        Ok(())
    }

    fn profile(&self) -> Profile {
        Profile {
            takes_ranges: self.takes_ranges,
            has_checksum: false,
            needs_delivery_oracle: false,
            uses: Kinds::all(),
        }
    }
}

/// Four frames of 32 bytes.
fn mission() -> Result<Mission, Error> {
    let link = LinkConfig::new(32, 4, 0.5, 0.1, 1500.0).unwrap();
    let slots =
        (1..=3).map(|k| Slot { tol_ns: 5 * k * SECOND, sender: (k % 2) as VehicleId, capacity_bytes: 125 });
    let slots: Vec<Slot> = slots.collect();
    let heard = |s: &Slot| Opportunity {
        tol_ns: s.tol_ns,
        sender: s.sender,
        receiver: 1 - s.sender,
        toa_ns: s.tol_ns + SECOND / 2,
        survive_probability: 1.0,
        draws: vec![0.5; 4],
    };
    let opportunities = slots.iter().map(heard).collect();
    Mission::new(2, link, vec![], slots, opportunities, 30 * SECOND)
}

fn poll(slot: i64, answered: bool) -> Poll {
    let sender = (slot % 2) as VehicleId;
    Poll {
        tol_ns: 5 * slot * SECOND,
        sender,
        poller: 1 - sender,
        t_ns: 5 * slot * SECOND - SECOND,
        bytes: 2,
        air_time_ns: 364_000_000,
        reply_bytes: 3,
        answered,
    }
}

fn replay(polls: Vec<Poll>, takes_ranges: bool) -> Replay {
    let mission = mission().unwrap().with_polls(polls).unwrap();
    let talker = || Box::new(Talker { transmitted: 0, takes_ranges }) as Box<dyn Navigator>;
    let samples = Arc::from([0, 30 * SECOND]);
    Replay::new(Arc::new(mission), Estimators::Each(vec![talker(), talker()]), samples, 0).unwrap()
}

fn run(polls: Vec<Poll>, takes_ranges: bool) -> Tracks {
    let mut replay = replay(polls, takes_ranges);
    replay.run().unwrap();
    replay.into_tracks()
}

#[test]
fn a_poll_is_counted_and_its_answer_is_longer_than_the_packet() {
    // Given out of order on purpose; the second slot's poll is lost.
    let polls = vec![poll(3, true), poll(1, true), poll(2, false)];
    let tracks = run(polls.clone(), true);
    assert_eq!(tracks.polls, vec![polls[1], polls[2], polls[0]]);
    // 31 + 3 bytes: two frames, where 31 alone are one.
    assert_eq!(tracks.sent, vec![(1, 5 * SECOND, 34), (1, 15 * SECOND, 34)]);
    assert_eq!(tracks.packets.len(), 2);
    for packet in &tracks.packets {
        assert_eq!((packet.bytes, packet.frames, packet.received), (34, 2, true));
    }
    let one_way = run(vec![], true);
    assert_eq!(one_way.sent.len(), 3);
    assert!(one_way.polls.is_empty());
    assert!(one_way.packets.iter().all(|p| (p.bytes, p.frames) == (31, 1)));
}

#[test]
fn a_slot_whose_poll_was_lost_takes_no_packet_number() {
    let mut replay = replay(vec![poll(1, false), poll(2, true), poll(3, false)], true);
    replay.run().unwrap();
    assert_eq!(replay.into_tracks().sent, vec![(0, 10 * SECOND, 34)]);
}

#[test]
fn who_has_no_use_for_ranges_does_not_poll() {
    let tracks = run(vec![poll(1, true), poll(2, false), poll(3, true)], false);
    assert!(tracks.polls.is_empty());
    assert!(tracks.sent.is_empty());
}

#[test]
fn polls_are_in_a_snapshot() {
    let polls = vec![poll(1, true), poll(2, false), poll(3, true)];
    let mut first = replay(polls.clone(), true);
    first.run_until(12 * SECOND).unwrap();
    let snapshot = first.snapshot().unwrap();
    let mut second = replay(polls.clone(), true);
    second.restore(&snapshot).unwrap();
    second.run().unwrap();
    let tracks = second.into_tracks();
    assert_eq!(tracks.polls, polls);
    let whole = run(polls, true);
    assert_eq!(tracks.sent, whole.sent);
    assert_eq!(tracks.packets.len(), whole.packets.len());
}

#[test]
fn polls_that_make_no_sense_are_refused() {
    let good = poll(1, true);
    let refused = |polls: Vec<Poll>| mission().unwrap().with_polls(polls).unwrap_err().to_string();
    for (bad, says) in [
        (Poll { poller: 9, ..good }, "vehicle 9"),
        (Poll { poller: 1, ..good }, "vehicle 1"),
        (Poll { sender: 0, poller: 1, ..good }, "slot"),
        (Poll { tol_ns: 1, t_ns: 0, ..good }, "slot"),
        (Poll { t_ns: good.tol_ns + 1, ..good }, "time from poll to answer"),
        (Poll { air_time_ns: -1, ..good }, "air time of a poll"),
    ] {
        let message = refused(vec![bad]);
        assert!(message.contains(says), "{message}");
    }
    assert!(refused(vec![good, good]).contains("polls of one slot"));
}
