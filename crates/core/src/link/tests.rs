//! Air time, slots, counters against naive models, geometry, snapshots.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests fail by panicking")]

mod properties;

use super::*;
use crate::packet::{BitReader, BitWriter, PacketError};
use proptest::prelude::*;
use std::collections::BTreeSet;

const SECOND: i64 = 1_000_000_000;

fn micromodem() -> LinkConfig {
    LinkConfig::new(32, 3, 0.4, 0.1, 1500.0).unwrap()
}

fn slot(second: i64, sender: u16, capacity_bytes: usize) -> Slot {
    Slot { tol_ns: second * SECOND, sender, capacity_bytes }
}

fn restored<T: serde::Serialize + serde::de::DeserializeOwned>(value: &T) -> T {
    postcard::from_bytes(&postcard::to_stdvec(value).unwrap()).unwrap()
}

#[test]
fn air_time_counts_whole_frames() {
    let link = micromodem();
    assert_eq!(link.max_bytes(), 96);
    for (bytes, frames) in [(0, 1), (1, 1), (32, 1), (33, 2), (96, 3)] {
        assert_eq!(link.frames_needed(bytes), Ok(frames));
        assert_eq!(link.air_time_ns(bytes), Ok(100_000_000 + frames as i64 * 400_000_000));
    }
    assert_eq!(
        link.air_time_ns(97).unwrap_err().to_string(),
        "packet of 97 bytes needs 4 frames of 32 bytes, the modem sends at most 3"
    );
    assert!(link.frames_needed(usize::MAX).is_err());
    let unlimited = LinkConfig::new(usize::MAX, usize::MAX, 0.0, 0.0, 1500.0).unwrap();
    assert_eq!(unlimited.air_time_ns(usize::MAX), Ok(0));
}

#[test]
fn a_modem_that_cannot_be_is_refused() {
    for (frame_bytes, max_frames, frame_s, preamble_s, speed) in [
        (0, 1, 0.1, 0.0, 1500.0),
        (32, 0, 0.1, 0.0, 1500.0),
        (32, 1, -0.1, 0.0, 1500.0),
        (32, 1, 0.1, f64::NAN, 1500.0),
        (32, 1, f64::INFINITY, 0.0, 1500.0),
        (32, usize::MAX, 0.1, 0.0, 1500.0),
        (32, 1, 0.1, 0.0, 0.0),
        (32, 1, 0.1, 0.0, 330.0),
    ] {
        let result = LinkConfig::new(frame_bytes, max_frames, frame_s, preamble_s, speed);
        assert!(matches!(result, Err(LinkError::OutOfRange { .. })), "{result:?}");
    }
    assert_eq!(
        LinkConfig::new(32, 1, 0.1, 0.0, -1500.0).unwrap_err().to_string(),
        "sound_speed_mps -1500 is outside 1000 to 2000"
    );
}

#[test]
fn slots_answer_whose_turn_it_is() {
    let table = SlotTable::new(vec![slot(0, 0, 32), slot(3, 1, 32), slot(6, 2, 0), slot(9, 0, 32)]).unwrap();
    assert_eq!(table.slots().len(), 4);
    assert_eq!(table.at(3 * SECOND).map(|slot| slot.sender), Some(1));
    assert_eq!(table.at(4 * SECOND), None);
    assert_eq!(table.previous_of(0, 9 * SECOND).map(|slot| slot.tol_ns), Some(0));
    assert_eq!(table.previous_of(0, 0), None);
    assert_eq!(table.next_of(0, 1).map(|slot| slot.tol_ns), Some(9 * SECOND));
    assert_eq!(table.next_of(1, 3 * SECOND).map(|slot| slot.tol_ns), Some(3 * SECOND));
    assert_eq!(table.next_of(1, i64::MAX), None);
    assert!(table.check_packet(1, 3 * SECOND, 32).is_ok());
    assert!(matches!(table.check_packet(1, 3 * SECOND, 33), Err(LinkError::SlotTooShort { .. })));
    assert!(matches!(table.check_packet(0, 3 * SECOND, 1), Err(LinkError::NoSlot { .. })));
    assert!(matches!(table.check_packet(2, 6 * SECOND, 1), Err(LinkError::SlotTooShort { .. })));
    assert!(table.check_against(&micromodem()).is_ok());
    assert_eq!(restored(&table), table);
}

#[test]
fn slots_out_of_order_or_too_close_are_refused() {
    for second in [0, -1] {
        let result = SlotTable::new(vec![slot(0, 0, 32), slot(second, 1, 32)]);
        assert!(matches!(result, Err(LinkError::SlotOrder { index: 1, before: 0, .. })));
    }
    assert!(matches!(
        SlotTable::new(vec![slot(0, SlotTable::SENDERS_MAX, 32)]),
        Err(LinkError::OutOfRange { .. })
    ));
    let tight = SlotTable::new(vec![slot(0, 0, 96), slot(1, 1, 32)]).unwrap();
    assert_eq!(
        tight.check_against(&micromodem()).unwrap_err().to_string(),
        "slot at 0 ns: 96 bytes take 1300000000 ns, but the next slot starts 1000000000 ns later"
    );
    let large = SlotTable::new(vec![slot(0, 0, 97)]).unwrap();
    assert!(matches!(large.check_against(&micromodem()), Err(LinkError::TooManyFrames { .. })));
    let apart = SlotTable::new(vec![
        Slot { tol_ns: i64::MIN, sender: 0, capacity_bytes: 1 },
        Slot { tol_ns: i64::MAX, sender: 0, capacity_bytes: 1 },
    ]);
    assert!(apart.unwrap().check_against(&micromodem()).is_ok());
}

#[test]
fn the_sequence_wraps_at_every_place() {
    for lost in 0..=255u64 {
        let (mut own, mut window) = (Sequencer::new(), ReceiveWindow::new());
        assert_eq!((own.last(), own.take()), (None, Ok(0)));
        assert_eq!(window.accept(0, 0), Ok(0));
        for cycle in 1..8i64 {
            for _ in 0..lost {
                own.take().unwrap();
            }
            let sequence = own.residue();
            let counter = own.take().unwrap();
            assert_eq!(own.last(), Some(counter));
            assert_eq!(window.accept(sequence, cycle * SECOND), Ok(counter), "{lost} lost at a time");
            assert!(window.accept(sequence, cycle * SECOND).is_err());
        }
    }
    // Without losses, through four wraps and the whole window.
    let mut window = ReceiveWindow::new();
    for counter in 0..1024u64 {
        assert_eq!(window.accept((counter % 256) as u8, counter as i64), Ok(counter));
    }
    assert!(window.contains(1023) && window.contains(992) && !window.contains(991));
}

#[test]
fn rejection_says_why_and_changes_nothing() {
    let mut window = ReceiveWindow::new();
    assert_eq!(window.newest(), None);
    for counter in (10..90u64).step_by(2) {
        window.accept(counter as u8, counter as i64 * SECOND).unwrap();
    }
    let before = window.clone();
    let reject = |sequence: u8, second: i64| {
        let mut copy = before.clone();
        let error = copy.accept(sequence, second * SECOND).unwrap_err();
        assert_eq!(copy, before);
        error
    };
    assert!(matches!(reject(88, 88), LinkError::Duplicate { .. }));
    assert!(matches!(reject(87, 88), LinkError::Duplicate { .. }));
    assert!(matches!(reject(11, 11), LinkError::TooOld { .. }));
    assert_eq!(
        reject(70, 71),
        LinkError::OutOfSequence { sequence: 70, tol_ns: 71 * SECOND, lower: 70, upper: 72 }
    );
    for sequence in [72, 200] {
        assert!(matches!(reject(sequence, 71), LinkError::OutOfSequence { .. }));
    }
    // Overtaken on the way: once.
    assert_eq!(window.accept(71, 71 * SECOND), Ok(71));
    assert!(window.accept(71, 71 * SECOND).is_err());
    // An admission is good for the state that gave it.
    let admission = window.check(89, 89 * SECOND).unwrap();
    assert!(window.commit(Admission { counter: 88, ..admission }).is_err());
    window.commit(admission).unwrap();
    assert_eq!(window.commit(admission), Err(LinkError::StaleAdmission { counter: 89, tol_ns: 89 * SECOND }));
    assert_eq!(window.newest(), Some(admission));
}

#[test]
fn a_recorded_packet_is_never_accepted_again() {
    // An old packet whose eight bits fit into a gap of the window.
    let mut window = ReceiveWindow::new();
    for counter in 0..300u64 {
        if counter < 260 || counter % 3 == 0 {
            window.accept((counter % 256) as u8, counter as i64 * SECOND).unwrap();
        }
    }
    for counter in 0..300u64 {
        let accepted = window.clone().accept((counter % 256) as u8, counter as i64 * SECOND);
        let missing = counter >= 260 && counter % 3 != 0 && counter < 297;
        let newer = counter > 297;
        assert_eq!(accepted.is_ok(), missing || newer, "{counter}: {accepted:?}");
    }
}

#[test]
fn counters_end_without_a_panic() {
    let bytes = postcard::to_stdvec(&vec![Admission { counter: u64::MAX - 1, tol_ns: 0 }]).unwrap();
    let mut window: ReceiveWindow = postcard::from_bytes(&bytes).unwrap();
    assert_eq!(window.accept(255, 1), Ok(u64::MAX));
    assert_eq!(window.accept(0, 2), Err(LinkError::CounterExhausted { counter: u64::MAX }));
    let mut own: Sequencer = postcard::from_bytes(&postcard::to_stdvec(&u64::MAX).unwrap()).unwrap();
    assert_eq!(own.take(), Err(LinkError::CounterExhausted { counter: u64::MAX }));
    let mut acks = AckBitmap::new(64).unwrap();
    assert!(acks.mark(0) && acks.mark(u64::MAX) && !acks.mark(0));
    assert_eq!(acks.received().collect::<Vec<_>>(), [u64::MAX]);
}

#[test]
fn acknowledgements_of_what_was_never_sent_are_refused() {
    let read = |bytes: &[u8], last| AckBitmap::read(&mut BitReader::new(bytes), 8, last);
    assert_eq!(read(&[0, 0], None), AckBitmap::new(8).map_err(|_| unreachable!()));
    assert!(matches!(read(&[0, 1], None), Err(PacketError::InvalidCode { .. })));
    assert!(matches!(read(&[5, 1], Some(4)), Err(PacketError::InvalidCode { .. })));
    assert_eq!(read(&[5, 1], Some(260)).unwrap().newest(), Some(5));
    assert!(matches!(read(&[3, 0b1_0000], Some(3)), Err(PacketError::InvalidCode { .. })));
    assert!(read(&[3, 0b1000], Some(3)).unwrap().is_received(0));
    assert!(matches!(read(&[3], Some(3)), Err(PacketError::Truncated { .. })));
    for length in [0, 65, u32::MAX] {
        assert!(AckBitmap::new(length).is_err());
        assert!(AckBitmap::read(&mut BitReader::new(&[0; 20]), length, Some(9)).is_err());
    }
}

#[test]
fn snapshots_come_back_and_forged_ones_do_not() {
    assert_eq!(restored(&micromodem()), micromodem());
    let mut acks = AckBitmap::new(12).unwrap();
    acks.mark(300);
    acks.mark(295);
    assert_eq!(restored(&acks), acks);
    let mut window = ReceiveWindow::new();
    window.accept(4, 5).unwrap();
    window.accept(6, 9).unwrap();
    assert_eq!(restored(&window), window);
    let mut own = Sequencer::new();
    own.take().unwrap();
    assert_eq!(restored(&own), own);

    let forged =
        |value: &(u32, u64, u64)| postcard::from_bytes::<AckBitmap>(&postcard::to_stdvec(value).unwrap());
    assert!(forged(&(12, 300, 1)).is_ok());
    assert!(forged(&(0, 0, 0)).is_err() && forged(&(65, 0, 0)).is_err());
    assert!(forged(&(4, 300, 16)).is_err() && forged(&(12, 3, 16)).is_err());
    let backwards = vec![Admission { counter: 2, tol_ns: 5 }, Admission { counter: 1, tol_ns: 6 }];
    assert!(postcard::from_bytes::<ReceiveWindow>(&postcard::to_stdvec(&backwards).unwrap()).is_err());
    let many: Vec<_> = (0..33).map(|k| Admission { counter: k, tol_ns: k as i64 }).collect();
    assert!(postcard::from_bytes::<ReceiveWindow>(&postcard::to_stdvec(&many).unwrap()).is_err());
    let slots = vec![slot(3, 0, 1), slot(2, 0, 1)];
    assert!(postcard::from_bytes::<SlotTable>(&postcard::to_stdvec(&slots).unwrap()).is_err());
    let modem = postcard::to_stdvec(&(0usize, 1usize, 0.1f64, 0.1f64, 1500.0f64)).unwrap();
    assert!(postcard::from_bytes::<LinkConfig>(&modem).is_err());
}

#[test]
fn ranges_are_positive_or_an_error() {
    assert_eq!(range_m(5, 5 + SECOND, 1500.0), Ok(1500.0));
    assert!(range_m(i64::MIN, i64::MAX, 1500.0).unwrap() > 2.7e13);
    for (tol_ns, toa_ns) in [(5, 5), (6, 5), (i64::MAX, i64::MIN)] {
        assert!(matches!(range_m(tol_ns, toa_ns, 1500.0), Err(LinkError::RangeNotPositive { .. })));
    }
    for speed in [0.0, -1500.0, f64::NAN, f64::INFINITY] {
        assert!(matches!(range_m(0, 1, speed), Err(LinkError::OutOfRange { .. })));
    }
    assert!(range_m(i64::MIN, i64::MAX, f64::MAX).is_err());
}

#[test]
fn slant_ranges_reduce_clamp_or_fail() {
    let reduce = |slant, a, b| slant_to_horizontal(slant, a, b, 1.0, 3.0);
    assert_eq!(reduce(5.0, 10.0, 7.0), Ok(HorizontalRange { range_m: 4.0, clamped: false }));
    assert_eq!(reduce(5.0, 7.0, 10.0), reduce(5.0, 10.0, 7.0));
    assert_eq!(reduce(3.0, 7.0, 10.0), Ok(HorizontalRange { range_m: 0.0, clamped: false }));
    assert_eq!(reduce(7.0, 0.0, 10.0), Ok(HorizontalRange { range_m: 0.0, clamped: true }));
    assert_eq!(
        reduce(6.5, 0.0, 10.0),
        Err(LinkError::SlantTooShort { slant_m: 6.5, depth_difference_m: 10.0, allowance_m: 3.0 })
    );
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(matches!(reduce(bad, 0.0, 10.0), Err(LinkError::OutOfRange { quantity: "slant_m", .. })));
    }
    assert!(reduce(1.0, f64::NAN, 0.0).is_err() && reduce(1.0, 0.0, f64::INFINITY).is_err());
    assert!(slant_to_horizontal(1.0, 0.0, 0.0, -1.0, 3.0).is_err());
    assert!(slant_to_horizontal(1.0, 0.0, 0.0, 1.0, f64::NAN).is_err());
    assert!(reduce(f64::MAX, f64::MAX, 0.0).is_err());
    assert!(reduce(1.0, f64::MAX, f64::MIN).is_err());
}

/// Depths as a header carries them: over all depths, distances and differences, the squared error of a range that was
/// reduced with the rounded depth is what its variance says.
#[test]
fn the_error_of_a_reduced_range_is_what_the_rounding_of_a_depth_says() {
    use crate::packet::Header;
    let mut state = 1u64;
    let mut uniform = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    for (shallowest_m, deepest_m) in [(52.0, 100.0), (300.0, 900.0), (2000.0, 6000.0), (9000.0, 11_000.0)] {
        for ratio in [0.0, 0.3, 1.0, 3.0] {
            let (mut squares, mut count, mut worst) = (0.0, 0.0, 0.0f64);
            for _ in 0..4000 {
                let sender_m = shallowest_m + (deepest_m - shallowest_m) * uniform();
                // From well above the step of a depth to where one is nearly above the other.
                let step_m = Header::coarse_depth_step_m(sender_m);
                let horizontal_m = step_m * (2.0 + 60.0 * uniform());
                let own_m = sender_m - ratio * horizontal_m;
                let slant_m = horizontal_m.hypot(own_m - sender_m);
                let carried_m = Header::carried_depth_m(sender_m);
                let reduced = slant_to_horizontal(slant_m, own_m, carried_m, step_m, 4.0).unwrap();
                let variance_m2 = depth_rounding_m2(reduced.range_m, own_m - carried_m, step_m);
                let square = (reduced.range_m - horizontal_m).powi(2);
                squares += square / variance_m2;
                worst = worst.max(square / variance_m2);
                count += 1.0;
            }
            let mean = squares / count;
            // The carried difference holds the error itself: of like depths the variance is thrice too large.
            let least = if ratio >= 1.0 { 0.5 } else { 0.1 };
            assert!((least..1.5).contains(&mean), "{shallowest_m} to {deepest_m} m, ratio {ratio}: {mean}");
            assert!(worst < 36.0, "{shallowest_m} to {deepest_m} m, ratio {ratio}: {worst}");
        }
    }
    assert_eq!(Header::coarse_depth_step_m(51.1), 0.0);
    assert_eq!(Header::coarse_depth_step_m(51.2), 0.8);
    assert_eq!(depth_rounding_m2(10.0, 30.0, 0.0), 0.0);
}
