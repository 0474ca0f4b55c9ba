//! Authenticated links: what is forged, altered or replayed changes nothing but a count, for every kind of packet.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests fail by panicking")]

mod world;

use std::sync::{Arc, OnceLock};

use uwcoop_core::chart::Chart;
use uwcoop_core::error::Error;
use uwcoop_core::event::{Event, Payload};
use uwcoop_core::information::replica::Methods;
use uwcoop_core::link::{Authenticator, FailedTags, ReplayGuard};
use uwcoop_core::navigator::authenticated::Authenticated;
use uwcoop_core::navigator::origin::interleaved::{Interleaved, InterleavedOptions};
use uwcoop_core::navigator::origin::lasting::LastingOptions;
use uwcoop_core::navigator::origin::local_options::LocalOptions;
use uwcoop_core::navigator::origin::mdeif::{Mdeif, MdeifOptions};
use uwcoop_core::navigator::team::TeamOptions;
use uwcoop_core::navigator::{Navigator, Outcome};
use uwcoop_core::packet::graph::GraphForm;
use uwcoop_core::packet::{PacketKind, append_crc};
use world::fleet::{team_of, team_options};
use world::*;

const OWN: u16 = 1;
const PEER: u16 = 0;
const TEAM: usize = 3;
const NOW: i64 = 20 * SECOND;
const KEY: [u8; 32] = *b"a key that only this team shares";

type Boxed = Box<dyn Navigator>;

fn authenticator(tag_bytes: usize) -> Authenticator {
    Authenticator::new(&KEY, tag_bytes, 7).unwrap()
}

fn authenticated(navigator: Boxed, own: u16, tag_bytes: usize) -> Authenticated<Boxed> {
    Authenticated::new(navigator, own, TEAM, authenticator(tag_bytes))
}

/// Small navigators of every kind of packet, by name; their clouds are small because fuzzing snapshots them.
fn kinds(own: u16) -> Vec<(&'static str, Boxed)> {
    static CHART: OnceLock<Arc<Chart>> = OnceLock::new();
    let chart = CHART.get_or_init(rich).clone();
    let of = |packet| uwcoop_core::navigator::dmpf::DmpfOptions { packet, ..dmpf_options(12) };
    let mpf_of = |packet| uwcoop_core::navigator::mpf::MpfOptions { packet, ..mpf_options(12) };
    vec![
        ("belief", Box::new(dmpf(own, TEAM, of(PacketKind::Belief), &chart, 5))),
        ("belief f64", Box::new(mpf::<2>(own, TEAM, mpf_of(PacketKind::BeliefF64), &chart, 5))),
        ("mixture", Box::new(dmpf(own, TEAM, of(PacketKind::Mixture), &chart, 5))),
        ("cloud", Box::new(dmpf(own, TEAM, of(PacketKind::Cloud), &chart, 5))),
        (
            "team",
            Box::new(team_of(
                own,
                TeamOptions { tag_bytes: 8, ..team_options(TEAM, 12) },
                Some(chart.clone()),
            )),
        ),
        (
            "team f64",
            Box::new(team_of(own, TeamOptions { packet_f64: true, ..team_options(TEAM, 12) }, None)),
        ),
        ("pose graph", Box::new(mdeif(own))),
        ("bank of beliefs", Box::new(interleaved(own))),
        ("belief to mpf<4>", Box::new(mpf::<4>(own, TEAM, mpf_of(PacketKind::Belief), &chart, 5))),
    ]
}

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

fn mdeif(own: u16) -> Mdeif {
    let methods = Methods { joint: true, lags: 6, equation_6: true, loss_max: 1e-4 };
    let options = MdeifOptions {
        local: LOCAL,
        lasting: LastingOptions::NONE,
        form: GraphForm::F64,
        exact_lags: 2,
        methods,
    };
    Mdeif::new(own, &[true; TEAM], options, SOUND_SPEED_MPS).unwrap()
}

fn interleaved(own: u16) -> Interleaved {
    let options = InterleavedOptions { local: LOCAL, ranging: true };
    Interleaved::new(own, TEAM, options, SOUND_SPEED_MPS).unwrap()
}

/// Two members of a team that has been under way for twenty seconds.
fn pair(index: usize, tag_bytes: usize) -> (Authenticated<Boxed>, Authenticated<Boxed>) {
    let (mut peer, mut own) = (kinds(PEER).remove(index).1, kinds(OWN).remove(index).1);
    warm_up(peer.as_mut(), PEER);
    warm_up(own.as_mut(), OWN);
    (authenticated(peer, PEER, tag_bytes), authenticated(own, OWN, tag_bytes))
}

fn heard(sender: u16, tol_ns: i64, bytes: &[u8]) -> Event {
    let toa_ns = tol_ns + 28_000_000;
    event(NOW + 2 * SECOND, OWN, Payload::Reception { sender, tol_ns, toa_ns, bytes: bytes.into() })
}

#[test]
fn tags_are_those_of_rfc_4231() {
    // Test case 2 of the RFC shows that the primitive is HMAC-SHA-256; the tag's own input is checked against it below.
    use hmac::{Hmac, KeyInit, Mac};
    let mac = |key: &[u8], parts: &[&[u8]]| {
        let mut mac = Hmac::<sha2::Sha256>::new_from_slice(key).unwrap();
        parts.iter().for_each(|part| mac.update(part));
        mac.finalize().into_bytes()
    };
    let known = mac(b"Jefe", &[b"what do ya want ", b"for nothing?"]);
    assert_eq!(known[..8], [0x5b, 0xdc, 0xc1, 0x46, 0xbf, 0x60, 0x75, 0x4e]);

    let derived = mac(&KEY, &[b"uwcoop packet tag 1", &[8], &7u64.to_be_bytes()]);
    let want = mac(&derived, &[b"payload", &3u16.to_be_bytes(), &(-5i64).to_be_bytes()]);
    let bytes = authenticator(8).append_tag(b"payload", 3, -5);
    assert_eq!(bytes, [b"payload".as_slice(), &want[..8]].concat());
}

#[test]
fn a_tag_is_good_for_one_key_mission_length_sender_and_slot() {
    for tag_bytes in [4, 8] {
        let right = authenticator(tag_bytes);
        let bytes = right.append_tag(b"fifteen bytes..", 2, 9 * SECOND);
        assert_eq!(bytes.len(), 15 + tag_bytes);
        assert_eq!(right.check_tag(&bytes, 2, 9 * SECOND).unwrap(), b"fifteen bytes..");
        for (sender, tol_ns) in [(1, 9 * SECOND), (2, 9 * SECOND + 1), (2, -9 * SECOND), (u16::MAX, i64::MIN)]
        {
            assert!(right.check_tag(&bytes, sender, tol_ns).is_err(), "sender {sender} at {tol_ns}");
        }
        let mut other_key = KEY;
        other_key[31] ^= 1;
        for wrong in [
            Authenticator::new(&other_key, tag_bytes, 7).unwrap(),
            Authenticator::new(&KEY, tag_bytes, 8).unwrap(),
            authenticator(12 - tag_bytes),
        ] {
            assert!(wrong.check_tag(&bytes, 2, 9 * SECOND).is_err(), "{wrong:?}");
        }
        for short in 0..bytes.len() {
            assert!(right.check_tag(&bytes[..short], 2, 9 * SECOND).is_err(), "cut to {short} bytes");
        }
    }
}

#[test]
fn keys_and_tags_of_other_lengths_are_refused_and_no_key_is_shown() {
    for length in [0, 15, 65, 1000] {
        assert!(Authenticator::new(&vec![1; length], 8, 0).is_err(), "key of {length} bytes");
    }
    for tag_bytes in [0, 17, usize::MAX] {
        assert!(Authenticator::new(&KEY, tag_bytes, 0).is_err(), "tag of {tag_bytes} bytes");
    }
    let shown = format!("{:?} {:#?}", authenticator(8), authenticator(8));
    assert!(shown.contains("tag_bytes: 8") && !shown.contains("only this team") && !shown.contains("97, 32"));
}

#[test]
fn authentic_packets_pass_once_with_every_kind_of_packet() {
    for tag_bytes in [4, 8] {
        for index in 0..kinds(OWN).len() {
            let (name, plain) = kinds(OWN).remove(index);
            let (mut peer, mut own) = pair(index, tag_bytes);
            let bytes = peer.transmit(NOW + SECOND, 1 << 20).unwrap().unwrap();
            let said = own.handle(&heard(PEER, NOW + SECOND, &bytes)).unwrap();
            assert_ne!(said, Outcome::Rejected, "{name}");

            // What the navigator made of it is what it would have made without tags.
            let mut plain = plain;
            warm_up(plain.as_mut(), OWN);
            let stripped = bytes[..bytes.len() - tag_bytes].to_vec();
            let stripped = append_crc(stripped, PEER, NOW + SECOND);
            assert_eq!(plain.handle(&heard(PEER, NOW + SECOND, &stripped)).unwrap(), said, "{name}");
            assert_eq!(own.inner().snapshot().unwrap(), plain.snapshot().unwrap(), "{name}");

            let before = own.inner().snapshot().unwrap();
            let again = own.handle(&heard(PEER, NOW + SECOND, &bytes)).unwrap();
            assert_eq!(again, Outcome::Rejected, "{name}: a replay");
            assert_eq!(own.inner().snapshot().unwrap(), before, "{name}");
            assert_eq!(own.unauthentic(), 1, "{name}");
            assert_eq!(own.estimate(NOW).rejected, plain.estimate(NOW).rejected + 1, "{name}");
        }
    }
}

#[test]
fn a_slot_is_deaf_after_a_few_forgeries_and_the_next_is_not() {
    for forgeries in [FailedTags::MOST - 1, FailedTags::MOST] {
        let (mut peer, mut own) = pair(0, 4);
        let honest: Vec<_> = (0..2).map(|k| peer.transmit(NOW + SECOND + k, 64).unwrap().unwrap()).collect();
        let mut forged = honest[0].to_vec();
        for k in 0..forgeries {
            forged[0] ^= 1 + k as u8;
            assert_eq!(own.handle(&heard(PEER, NOW + SECOND, &forged)).unwrap(), Outcome::Rejected);
            forged[0] ^= 1 + k as u8;
        }
        let said = own.handle(&heard(PEER, NOW + SECOND, &honest[0])).unwrap();
        assert_eq!(said == Outcome::Rejected, forgeries >= FailedTags::MOST);
        // A snapshot keeps the count.
        let (_, mut restored) = pair(0, 4);
        restored.restore(&own.snapshot().unwrap()).unwrap();
        assert_eq!(restored.handle(&heard(PEER, NOW + SECOND, &honest[0])).unwrap(), Outcome::Rejected);
        assert_ne!(own.handle(&heard(PEER, NOW + SECOND + 1, &honest[1])).unwrap(), Outcome::Rejected);
    }
}

#[test]
fn an_older_packet_kept_back_is_a_replay() {
    let (mut peer, mut own) = pair(0, 4);
    let kept = peer.transmit(NOW + SECOND, 64).unwrap().unwrap();
    let newer = peer.transmit(NOW + SECOND + 1, 64).unwrap().unwrap();
    assert_eq!(own.handle(&heard(PEER, NOW + SECOND + 1, &newer)).unwrap(), Outcome::Fused);
    assert_eq!(own.handle(&heard(PEER, NOW + SECOND, &kept)).unwrap(), Outcome::Rejected);
    // In another slot it is a forgery.
    assert_eq!(own.handle(&heard(PEER, NOW + SECOND + 2, &kept)).unwrap(), Outcome::Rejected);
    assert_eq!(own.unauthentic(), 2);
}

#[test]
fn what_no_honest_source_sends_is_an_error_before_it_is_a_forgery() {
    let (_, mut own) = pair(0, 8);
    let before = own.snapshot().unwrap();
    let mut misaddressed = heard(PEER, NOW, &[0; 23]);
    misaddressed.vehicle = 2;
    let launched_late =
        Payload::Reception { sender: PEER, tol_ns: NOW, toa_ns: NOW - 1, bytes: Arc::new([0; 23]) };
    for refused in [
        misaddressed,
        heard(OWN, NOW, &[0; 23]),
        heard(TEAM as u16, NOW, &[0; 23]),
        event(NOW + SECOND, OWN, launched_late),
    ] {
        assert!(own.handle(&refused).is_err(), "{refused:?}");
        assert_eq!(own.snapshot().unwrap(), before);
    }
}

#[test]
fn the_navigator_has_the_slot_less_the_tag() {
    for (tag_bytes, least) in [(1, 14), (2, 15), (4, 17), (8, 21)] {
        let (mut peer, _) = pair(0, tag_bytes);
        for capacity in [0, tag_bytes - 1, least - 1] {
            let before = peer.snapshot().unwrap();
            match peer.transmit(NOW + SECOND, capacity) {
                Err(Error::PacketTooLong { bytes, capacity: said }) => {
                    assert!(said == capacity && bytes > capacity && bytes <= least);
                }
                other => panic!("{other:?}"),
            }
            assert_eq!(peer.snapshot().unwrap(), before);
        }
        assert_eq!(peer.transmit(NOW + SECOND, least).unwrap().unwrap().len(), least);
    }
}

#[test]
fn a_snapshot_holds_the_counters_and_not_the_key() {
    let (mut peer, mut own) = pair(0, 8);
    let bytes = peer.transmit(NOW + SECOND, 64).unwrap().unwrap();
    own.handle(&heard(PEER, NOW + SECOND, &bytes)).unwrap();
    own.handle(&heard(PEER, NOW + SECOND, &bytes)).unwrap();
    let snapshot = own.snapshot().unwrap();
    assert!(!snapshot.windows(8).any(|w| KEY.windows(8).any(|k| k == w)), "no part of the key");

    let (_, mut resumed) = pair(0, 8);
    resumed.restore(&snapshot).unwrap();
    assert_eq!(resumed.snapshot().unwrap(), snapshot);
    assert_eq!(resumed.unauthentic(), 1);
    assert_eq!(
        resumed.handle(&heard(PEER, NOW + SECOND, &bytes)).unwrap(),
        Outcome::Rejected,
        "known to be old"
    );

    let before = resumed.snapshot().unwrap();
    let mut smaller = Authenticated::new(kinds(OWN).remove(0).1, OWN, TEAM - 1, authenticator(8));
    assert!(smaller.restore(&snapshot).is_err());
    for spoilt in [&snapshot[..snapshot.len() / 2], &[], &[0xFF; 40]] {
        assert!(resumed.restore(spoilt).is_err());
        assert_eq!(resumed.snapshot().unwrap(), before);
    }
}

#[test]
fn the_guard_only_goes_forward() {
    let mut guard = ReplayGuard::new(2);
    guard.commit(0, 5).unwrap();
    for stale in [5, 4, i64::MIN] {
        assert!(guard.check(0, stale).is_err() && guard.commit(0, stale).is_err());
    }
    assert!(guard.check(2, 9).is_err(), "a stranger");
    guard.commit(1, -3).unwrap();
    guard.commit(0, i64::MAX).unwrap();
    assert!(guard.check(0, i64::MAX).is_err());
}

/// Small, fast and good enough to mutate packets with (SplitMix64).
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    fn below(&mut self, n: usize) -> usize {
        (self.next() % n as u64) as usize
    }
}

/// A packet that nobody with the key tagged: an authentic one altered, cut, lengthened, moved to another slot or sender, or noise.
fn forged(random: &mut Random, known: &[(u16, i64, Arc<[u8]>)]) -> (u16, i64, Vec<u8>) {
    let (mut sender, mut tol_ns, bytes) = known[random.below(known.len())].clone();
    let mut bytes = bytes.to_vec();
    match random.below(8) {
        0..=2 => {
            for _ in 0..=random.below(4) {
                let at = random.below(bytes.len());
                bytes[at] ^= 1 << random.below(8);
            }
        }
        3 => bytes.truncate(random.below(bytes.len())),
        4 => (0..=random.below(40)).for_each(|_| bytes.push(random.next() as u8)),
        5 => tol_ns += 1 + random.below(900_000_000) as i64,
        6 => sender = 2 - sender,
        _ => {
            let length = random.below(70);
            bytes = (0..length).map(|_| random.next() as u8).collect();
        }
    }
    (sender, tol_ns, bytes)
}

/// Throws forged and altered packets at a navigator of every kind of packet: none may be accepted, panic, or change it.
fn assault(tries: usize, seed: u64, look_every: usize) {
    let count = kinds(OWN).len();
    for index in 0..count {
        let (name, _) = kinds(OWN).remove(index);
        let (mut peer, mut own) = pair(index, 8);
        let mut known = Vec::new();
        for slot in 0..16 {
            let tol_ns = NOW + SECOND + slot;
            let bytes = peer.transmit(tol_ns, 1 << 20).unwrap().unwrap();
            // What was altered twice in the same place is the packet itself: it must have been heard.
            own.handle(&heard(PEER, tol_ns, &bytes)).unwrap();
            known.push((PEER, tol_ns, bytes));
        }
        let counted = own.unauthentic();
        let before = own.inner().snapshot().unwrap();
        let mut random = Random(seed ^ index as u64);
        let key = authenticator(8);
        for k in 0..tries.div_ceil(count) {
            let (sender, tol_ns, bytes) = forged(&mut random, &known);
            // A receiver is soon deaf in these slots: whether the tag would have passed is asked apart.
            let passes = key.check_tag(&bytes, sender, tol_ns).is_ok();
            assert!(!passes || known.contains(&(sender, tol_ns, bytes.clone().into())), "{name}: {bytes:?}");
            let said = own.handle(&heard(sender, tol_ns, &bytes)).unwrap();
            assert_eq!(said, Outcome::Rejected, "{name}: {bytes:?} of {sender} at {tol_ns}");
            if k % look_every == 0 {
                assert_eq!(own.inner().snapshot().unwrap(), before, "{name}: {bytes:?}");
            }
        }
        assert_eq!(own.inner().snapshot().unwrap(), before, "{name}");
        assert_eq!(own.unauthentic() - counted, tries.div_ceil(count) as u64, "{name}: every one is counted");
    }
}

#[test]
fn a_hundred_thousand_forged_packets_change_nothing() {
    assault(100_000, 1, 100);
}

#[test]
#[ignore = "ten million packets take a minute; run with --ignored"]
fn ten_million_forged_packets_change_nothing() {
    assault(10_000_000, 2, 1000);
}

#[test]
fn decoders_without_tags_give_a_typed_answer_to_anything() {
    // Behind a CRC alone, damage may pass (2^-16); nothing may panic, and what is rejected changes only the count.
    for index in 0..kinds(OWN).len() {
        let (name, mut own) = kinds(OWN).remove(index);
        let mut peer = kinds(PEER).remove(index).1;
        warm_up(peer.as_mut(), PEER);
        warm_up(own.as_mut(), OWN);
        let mut known = Vec::new();
        for slot in 0..4 {
            let tol_ns = NOW + SECOND + slot;
            known.push((PEER, tol_ns, peer.transmit(tol_ns, 1 << 20).unwrap().unwrap()));
        }
        // The clock moves on at the first one, whatever it is.
        let _ = own.handle(&heard(PEER, NOW, &[]));
        let mut random = Random(3 + index as u64);
        let mut rejected = 0u32;
        for _ in 0..4000 {
            let (sender, tol_ns, bytes) = forged(&mut random, &known);
            let before = own.estimate(NOW + 2 * SECOND);
            if own.handle(&heard(sender, tol_ns, &bytes)).unwrap() == Outcome::Rejected {
                rejected += 1;
                let after = own.estimate(NOW + 2 * SECOND);
                assert_eq!(after.rejected, before.rejected + 1, "{name}");
                assert_eq!(after.mean_m, before.mean_m, "{name}: {bytes:?}");
                assert_eq!(after.covariance_m2, before.covariance_m2, "{name}: {bytes:?}");
            }
        }
        assert!(rejected > 3900, "{name}: {rejected} of 4000 rejected");
    }
}
