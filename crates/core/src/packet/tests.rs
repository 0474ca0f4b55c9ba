//! Round trips, rounding that never overstates, and decoders fed with anything.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests fail by panicking")]

mod properties;

use super::*;
use nalgebra::{Matrix2, Vector2};
use proptest::prelude::*;
use std::f64::consts::{PI, TAU};

/// xorshift64*: the same bytes on every machine, fast enough for millions.
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_F491_4F6C_DD1D)
    }
}

fn header(kind: PacketKind) -> Header {
    Header { kind, sequence: 0xA5, depth_m: 12.3, heard: HeardBitmap::from_bits(0b101) }
}

fn packet(kind: PacketKind, mean: (f64, f64), sigma: (f64, f64), correlation: f64) -> BeliefPacket {
    let cross = correlation * sigma.0 * sigma.1;
    let covariance_m2 = Matrix2::new(sigma.0 * sigma.0, cross, cross, sigma.1 * sigma.1);
    let belief = Belief { mean_m: Vector2::new(mean.0, mean.1), covariance_m2 };
    BeliefPacket { header: header(kind), belief }
}

fn least_eigenvalue(m: &Matrix2<f64>) -> f64 {
    m.symmetric_eigenvalues().min()
}

#[test]
fn layout_and_checksum_are_the_documented_ones() {
    // CRC-16/IBM-3740's catalogued check value.
    assert_eq!(CRC.checksum(b"123456789"), 0x29B1);
    assert_eq!((BELIEF_BYTES, BELIEF_F64_BYTES), (15, 47));
    let bytes = packet(PacketKind::Belief, (-1.0, 2.5), (4.0, 8.0), 0.5).encode(3, 42_000_000_000).unwrap();
    let mut reader = BitReader::new(&bytes);
    let mut take = |bits| reader.take("field", bits).unwrap();
    assert_eq!([take(4), take(8), take(10), take(16)], [1, 0xA5, 123, 0b101]);
    assert_eq!([take(20), take(20)], [(1 << 20) - 16, 40]);
    // 2^(−4 + code/16): 4 m is code 96, 8 m code 112, each one or more above for the mean's rounding.
    let (sigma_e, sigma_n, correlation) = (take(8), take(8), take(10));
    assert!((97..=99).contains(&sigma_e) && (113..=115).contains(&sigma_n), "{sigma_e} {sigma_n}");
    // atanh 0.5 is code 52.7.
    assert!((40..=52).contains(&correlation), "{correlation}");
    let crc = take(16) as u16;
    let mut covered = bytes[..13].to_vec();
    covered.extend_from_slice(&[0, 3]);
    covered.extend_from_slice(&42_000_000_000i64.to_be_bytes());
    assert_eq!(crc, CRC.checksum(&covered));
}

#[test]
fn every_flipped_bit_is_found() {
    for kind in [PacketKind::Belief, PacketKind::BeliefF64] {
        let bytes = packet(kind, (120.0, -7.0), (3.0, 2.0), -0.3).encode(2, 9_000_000_000).unwrap();
        assert!(check_crc(&bytes, 2, 9_000_000_000).is_ok());
        for first in 0..bytes.len() * 8 {
            for second in first..bytes.len() * 8 {
                let mut damaged = bytes.clone();
                damaged[first / 8] ^= 0x80 >> (first % 8);
                if second > first {
                    damaged[second / 8] ^= 0x80 >> (second % 8);
                }
                let result = BeliefPacket::decode(&damaged, 2, 9_000_000_000);
                assert!(matches!(result, Err(PacketError::Checksum { .. })), "{first} {second}");
            }
        }
    }
}

#[test]
fn another_sender_or_slot_is_found() {
    let tol_ns = 301 * 1_000_000_000;
    let bytes = packet(PacketKind::Belief, (0.0, 0.0), (3.0, 2.0), 0.0).encode(2, tol_ns).unwrap();
    for sender in (0..=u16::MAX).filter(|sender| *sender != 2) {
        assert!(check_crc(&bytes, sender, tol_ns).is_err(), "sender {sender}");
    }
    // 16 bits cannot tell all times apart; a day of one-second slots has about 1.3 coincidences.
    let confused =
        (0..86_400i64).filter(|s| check_crc(&bytes, 2, s * 1_000_000_000).is_ok() && *s != 301).count();
    assert!(confused <= 6, "{confused} of 86,399 other launch times pass");
    for s in 1..60 {
        assert!(check_crc(&bytes, 2, tol_ns + s * 1_000_000_000).is_err());
        assert!(check_crc(&bytes, 2, tol_ns - s * 1_000_000_000).is_err());
    }
}

#[test]
fn what_does_not_fit_is_named_and_never_clipped() {
    let encode = |packet: &BeliefPacket| packet.encode(0, 0);
    let good = packet(PacketKind::Belief, (0.0, 0.0), (3.0, 2.0), 0.0);
    let with = |change: fn(&mut BeliefPacket)| {
        let mut changed = good;
        change(&mut changed);
        encode(&changed).unwrap_err()
    };
    assert_eq!(
        with(|p| p.belief.mean_m.x = 40_000.0).to_string(),
        "mean easting 40000 m is outside -32768 to 32767.9375 m"
    );
    assert_eq!(
        with(|p| p.header.depth_m = 13_100.0).to_string(),
        "sender's depth 13100 m is outside 0 to 13004.8 m"
    );
    assert!(matches!(with(|p| p.header.depth_m = -0.06), PacketError::OutOfRange { .. }));
    assert!(matches!(with(|p| p.header.depth_m = f64::NAN), PacketError::NotFinite { .. }));
    assert!(matches!(
        with(|p| p.belief.mean_m.y = f64::NAN),
        PacketError::NotFinite { field: "mean northing", .. }
    ));
    assert!(matches!(with(|p| p.belief.covariance_m2.m12 = f64::INFINITY), PacketError::NotFinite { .. }));
    assert!(matches!(with(|p| p.belief.covariance_m2.m11 = -1.0), PacketError::NotCovariance { .. }));
    assert!(matches!(with(|p| p.belief.covariance_m2.m12 = 1.0), PacketError::NotCovariance { .. }));
    assert!(matches!(
        with(|p| p.belief.covariance_m2 = Matrix2::new(4.0, 7.0, 7.0, 9.0)),
        PacketError::NotCovariance { .. }
    ));
    let wide = packet(PacketKind::Belief, (0.0, 0.0), (3.0, 4000.0), 0.0);
    assert!(matches!(encode(&wide), Err(PacketError::OutOfRange { field: "sigma of northing", .. })));
    // At the end of the range there may be no room to raise a sigma: still a typed error.
    let edge = packet(PacketKind::Belief, (0.0, 0.0), (3922.0, 3922.0), 0.97);
    assert!(encode(&edge).is_ok() || matches!(encode(&edge), Err(PacketError::OutOfRange { .. })));
    // The f64 form has no such limits, but is no less careful.
    assert!(encode(&packet(PacketKind::BeliefF64, (1e9, 0.0), (1e6, 1.0), 0.9)).is_ok());
    let mut bad = packet(PacketKind::BeliefF64, (0.0, 0.0), (1.0, 1.0), 0.0);
    bad.belief.covariance_m2.m22 = -1e-3;
    assert!(matches!(encode(&bad), Err(PacketError::NotCovariance { .. })));
    assert!(HeardBitmap::default().insert(16).is_err());
    let mut writer = BitWriter::default();
    assert!(matches!(good.header.write(&mut writer, 2), Err(PacketError::TooManyBits { .. })));
}

#[test]
fn a_perfectly_known_or_degenerate_position_is_sent_honestly() {
    for covariance_m2 in
        [Matrix2::zeros(), Matrix2::new(1.0, 1.0, 1.0, 1.0), Matrix2::new(0.0, 0.0, 0.0, 9e4)]
    {
        let belief = Belief { mean_m: Vector2::new(0.03, -0.03), covariance_m2 };
        for kind in [PacketKind::Belief, PacketKind::BeliefF64] {
            let bytes = BeliefPacket { header: header(kind), belief }.encode(0, 0).unwrap();
            let received = BeliefPacket::decode(&bytes, 0, 0).unwrap().belief;
            let error = received.mean_m - belief.mean_m;
            let slack = received.covariance_m2 - covariance_m2 - error * error.transpose();
            assert!(least_eigenvalue(&slack) >= -1e-12, "{kind:?} {covariance_m2}");
        }
    }
}

#[test]
fn random_bytes_give_a_typed_result() {
    let mut noise = Noise(0x9E37_79B9_7F4A_7C15);
    let (mut opened, mut decoded) = (0, 0);
    let mut buffer = [0u8; 64];
    for trial in 0..1_000_000u32 {
        for chunk in buffer.chunks_mut(8) {
            chunk.copy_from_slice(&noise.next().to_be_bytes());
        }
        let length = match trial % 4 {
            0 => noise.next() as usize % 65,
            1 => BELIEF_F64_BYTES,
            _ => BELIEF_BYTES,
        };
        let bytes = &buffer[..length];
        let tol_ns = noise.next() as i64;
        opened += usize::from(check_crc(bytes, trial as u16, tol_ns).is_ok());
        let _ = BeliefPacket::decode(bytes, trial as u16, tol_ns);
        // Behind a valid checksum, with a known kind in half of them: the fields themselves.
        let mut payload = bytes[..length.saturating_sub(CRC_BYTES)].to_vec();
        if let Some(first) = payload.first_mut().filter(|_| trial & 4 == 0) {
            *first = (*first & 0x0F) | (1 << 4 << (trial >> 3 & 1));
        }
        if let Ok(packet) = BeliefPacket::decode(&append_crc(payload, 1, 2), 1, 2) {
            decoded += 1;
            assert!(
                least_eigenvalue(&packet.belief.covariance_m2) >= -1e-9 * packet.belief.covariance_m2.trace()
            );
        }
    }
    // One in 65,536 passes the checksum by chance.
    assert!((1..60).contains(&opened), "{opened}");
    assert!(decoded > 10_000, "{decoded}");
}

#[test]
fn fields_that_cannot_work_are_refused() {
    let mut writer = BitWriter::default();
    let fixed = |bits, steps_per_unit| FixedField {
        name: "x",
        unit: "m",
        bits,
        steps_per_unit,
        signed: true,
        rounding: Rounding::Nearest,
    };
    for field in [fixed(0, 1.0), fixed(53, 1.0), fixed(8, 0.0), fixed(8, f64::NAN), fixed(8, -1.0)] {
        assert!(matches!(field.write(&mut writer, 0.0), Err(PacketError::Definition { .. })));
        assert!(matches!(field.read(&mut BitReader::new(&[0; 16])), Err(PacketError::Definition { .. })));
    }
    let sigma = |bits, steps_per_octave, lowest_log2| SigmaField {
        name: "s",
        unit: "m",
        bits,
        steps_per_octave,
        lowest_log2,
    };
    for field in [sigma(0, 8, 0), sigma(17, 8, 0), sigma(8, 0, 0), sigma(16, 1, 0), sigma(8, 8, i32::MIN)] {
        assert!(matches!(field.encode(1.0), Err(PacketError::Definition { .. })));
        assert!(matches!(field.read(&mut BitReader::new(&[0; 16])), Err(PacketError::Definition { .. })));
    }
    for (bits, steps_per_unit) in [(1, 8.0), (17, 8.0), (8, 1.0), (8, f64::NAN)] {
        let field = CorrelationField { name: "r", bits, steps_per_unit };
        assert!(matches!(field.encode(0.1), Err(PacketError::Definition { .. })));
        assert!(matches!(field.read(&mut BitReader::new(&[0; 16])), Err(PacketError::Definition { .. })));
    }
    assert!(AngleField { name: "a", bits: 0 }.write(&mut writer, 0.0).is_err());
    assert!(ModuloField { name: "m", bits: 64 }.write(&mut writer, 0).is_err());
    assert!(writer.push("w", 0, 65).is_err());
    assert!(BitReader::new(&[0; 16]).take("w", 65).is_err());
    assert_eq!(writer.bit_len(), 0);
    // The pattern between the two halves of the correlation's codes is nobody's.
    let correlation = CorrelationField { name: "r", bits: 7, steps_per_unit: 16.0 };
    let read = correlation.read(&mut BitReader::new(&[0b1000_0000]));
    assert_eq!(read, Err(PacketError::InvalidCode { field: "r", code: 64 }));
    assert!(Header::read(&mut BitReader::new(&[0x10, 0, 0, 0, 0, 0]), 17).is_err());
}

#[test]
fn sigma_codes_are_tight_and_stable() {
    let field = SigmaField { name: "s", unit: "m", bits: 8, steps_per_octave: 16, lowest_log2: -4 };
    for code in 0..256 {
        let sigma = field.decode(code);
        assert_eq!(field.encode(sigma), Ok(code));
        if code < 255 {
            assert_eq!(field.encode(sigma * (1.0 + 1e-12)), Ok(code + 1));
        }
    }
    assert_eq!(field.encode(0.0), Ok(0));
    assert!(matches!(field.encode(-1e-9), Err(PacketError::OutOfRange { .. })));
    assert!(matches!(field.encode(3923.0), Err(PacketError::OutOfRange { .. })));
    let correlation = CorrelationField { name: "r", bits: 8, steps_per_unit: 32.0 };
    for code in -127..=127 {
        assert_eq!(correlation.encode(correlation.decode(code)), Ok(code));
    }
    assert_eq!((correlation.encode(1.0), correlation.encode(-1.0)), (Ok(127), Ok(-127)));
    assert!(correlation.encode(1.0 + 1e-12).is_err());
}

#[test]
fn padding_must_be_zero_and_short() {
    let good = packet(PacketKind::BeliefF64, (0.0, 0.0), (3.0, 2.0), 0.0).encode(0, 0).unwrap();
    let mut payload = good[..45].to_vec();
    payload[44] |= 1;
    let result = BeliefPacket::decode(&append_crc(payload.clone(), 0, 0), 0, 0);
    assert_eq!(result, Err(PacketError::Padding { left_bits: 2, value: 1 }));
    payload.push(0);
    let result = BeliefPacket::decode(&append_crc(payload, 0, 0), 0, 0);
    assert_eq!(result, Err(PacketError::Length { bytes: 48, expected: 47 }));
    let long = BitReader::new(&[0; 9]).finish();
    assert_eq!(long, Err(PacketError::Padding { left_bits: 72, value: 0 }));
    assert!(matches!(check_crc(&[1], 0, 0), Err(PacketError::Length { .. })));
    assert!(matches!(
        BeliefPacket::decode(&append_crc(vec![], 0, 0), 0, 0),
        Err(PacketError::Truncated { .. })
    ));
}
