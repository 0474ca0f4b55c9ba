//! What is sent comes back as it was meant, damage is found, what does not fit is refused.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests fail by panicking")]

use super::*;
use proptest::prelude::*;

fn belief(scale: f64) -> Mode<6> {
    let sigma = [0.2, 0.25, 0.008, 0.15, 0.007, 0.02].map(|s| s * scale);
    let mut covariance = SMatrix::<f64, 6, 6>::from_fn(|r, c| if r == c { sigma[r] * sigma[r] } else { 0.0 });
    for (r, c, rho) in [(0, 1, 0.3), (0, 2, -0.8), (3, 4, 0.2), (4, 5, 0.6), (2, 5, -0.4)] {
        covariance[(r, c)] = rho * sigma[r] * sigma[c];
        covariance[(c, r)] = covariance[(r, c)];
    }
    Mode { weight: 1.0, mean: SVector::from([412.31, -97.7, 3.1, 17.33, -2.2, 0.4]), covariance }
}

fn packet(modes: usize) -> ExchangePacket {
    let one = |k: usize| {
        let mut mode = belief(0.5 + 0.2 * k as f64);
        mode.weight = if modes == 1 { 1.0 } else { 1.0 / modes as f64 };
        mode.mean[0] += 3.0 * k as f64;
        mode.mean[2] += 0.1 * k as f64;
        mode
    };
    ExchangePacket { sequence: Some(9), modes: (0..modes).map(one).collect() }
}

#[test]
fn every_size_brings_its_content_back() {
    for size in ExchangeSize::ALL {
        let sent = packet(size.modes());
        let bytes = sent.encode(ExchangeFormat::Two, size, 3, 77).unwrap();
        assert_eq!(bytes.len(), size.bytes());
        let got = ExchangePacket::decode(&bytes, ExchangeFormat::Two, [410.0, -100.0], 3, 77).unwrap();
        assert_eq!(got.modes.len(), sent.modes.len());
        for (got, sent) in got.modes.iter().zip(&sent.modes) {
            assert!((got.weight - sent.weight).abs() < 0.02);
            for k in 0..6 {
                let off = got.mean[k] - sent.mean[k];
                let off = if layout::ANGLES[k] { off.sin() } else { off };
                assert!(off.abs() < [0.07, 0.07, 0.007, 0.07, 0.007, 0.0125][k], "{size:?} {k} {off}");
                let ratio = got.covariance[(k, k)] / sent.covariance[(k, k)];
                let most = match size {
                    ExchangeSize::B8 => 4000.0,
                    ExchangeSize::B16 => 3.2,
                    _ => 1.3,
                };
                assert!(ratio > 0.9 && ratio < most, "{size:?} {k} {ratio}");
            }
            if size.bytes() >= 32 {
                let relative = (got.covariance - sent.covariance).norm() / sent.covariance.norm();
                assert!(relative < 0.15, "{size:?} {relative}");
            }
        }
    }
}

#[test]
fn damage_another_slot_and_another_sender_are_found() {
    for size in ExchangeSize::ALL {
        let bytes = packet(1).encode(ExchangeFormat::Two, size, 3, 77).unwrap();
        let near = [412.0, -98.0];
        let read =
            |bytes: &[u8], sender, tol| ExchangePacket::decode(bytes, ExchangeFormat::Two, near, sender, tol);
        assert!(read(&bytes, 2, 77).is_err() && read(&bytes, 3, 78).is_err());
        for bit in 0..8 * bytes.len() {
            let mut bad = bytes.clone();
            bad[bit / 8] ^= 1 << (bit % 8);
            assert!(read(&bad, 3, 77).is_err(), "{size:?} bit {bit}");
        }
    }
}

#[test]
fn what_does_not_fit_is_refused_with_its_numbers() {
    let refuse = |change: &dyn Fn(&mut Mode<6>), size| {
        let mut p = packet(1);
        change(&mut p.modes[0]);
        let refused = p.encode(ExchangeFormat::Two, size, 0, 0);
        assert!(refused.is_err(), "{size:?} {refused:?}");
        refused.unwrap_err().to_string()
    };
    assert!(refuse(&|m| m.mean[0] = 2050.0, ExchangeSize::B32).contains("landmark x 2050"));
    refuse(&|m| m.mean[3] = 129.0, ExchangeSize::B32);
    refuse(&|m| m.mean[3] = 65.0, ExchangeSize::B8);
    refuse(&|m| m.mean[5] = f64::NAN, ExchangeSize::B40);
    refuse(&|m| m.covariance *= 1e6, ExchangeSize::B32);
    refuse(&|m| m.covariance *= 1e3, ExchangeSize::B8);
    refuse(&|m| m.covariance[(0, 0)] = -1.0, ExchangeSize::B16);
    assert!(packet(3).encode(ExchangeFormat::Two, ExchangeSize::B64, 0, 0).is_err());
    assert!(packet(1).encode(ExchangeFormat::One, ExchangeSize::B40, 0, 0).is_err());
}

#[test]
fn a_landmark_that_is_known_exactly_has_a_packet() {
    let mut p = packet(1);
    for k in 0..3 {
        for j in 0..6 {
            p.modes[0].covariance[(k, j)] = 0.0;
            p.modes[0].covariance[(j, k)] = 0.0;
        }
    }
    let bytes = p.encode(ExchangeFormat::Two, ExchangeSize::B32, 0, 0).unwrap();
    let got = ExchangePacket::decode(&bytes, ExchangeFormat::Two, [0.0; 2], 0, 0).unwrap();
    assert!(got.modes[0].covariance[(0, 0)].sqrt() < 0.012);
}

/// By how much a standard deviation may come back smaller: half a step of its code, where it is rounded to the nearest.
fn shrinks(size: ExchangeSize, k: usize) -> f64 {
    let per_octave = match size {
        ExchangeSize::B8 | ExchangeSize::B16 => return 1e-3,
        ExchangeSize::B40 => 32.0,
        _ if k < 3 => 32.0,
        _ => 8.0,
    };
    1.0 - (-0.5f64 / per_octave).exp2() + 1e-9
}

#[test]
fn a_single_mode_takes_the_shortest_packet_that_holds_it() {
    for (size, modes, least) in [
        (ExchangeSize::B8, 1, 8),
        (ExchangeSize::B16, 1, 16),
        (ExchangeSize::B32, 1, 32),
        (ExchangeSize::B40, 1, 40),
        (ExchangeSize::B64, 1, 32),
        (ExchangeSize::B64, 2, 64),
        (ExchangeSize::B128, 1, 32),
        (ExchangeSize::B128, 2, 64),
        (ExchangeSize::B128, 3, 128),
        (ExchangeSize::B128, 4, 128),
    ] {
        assert_eq!(size.least_for(modes).bytes(), least, "{size:?} {modes}");
        assert!(size.admits(least));
        let sent = packet(modes);
        let bytes = sent.encode(ExchangeFormat::Two, size.least_for(modes), 3, 77).unwrap();
        let got = ExchangePacket::decode(&bytes, ExchangeFormat::Two, [410.0, -100.0], 3, 77).unwrap();
        assert_eq!((bytes.len(), got.modes.len()), (least, modes));
    }
    assert!(!ExchangeSize::B32.admits(64) && !ExchangeSize::B40.admits(32) && !ExchangeSize::B64.admits(128));
}

proptest! {
    #[test]
    fn a_packet_claims_no_more_than_the_belief_or_refuses_it(
        octaves in proptest::array::uniform6(-6.0f64..10.0),
        partial in proptest::collection::vec(-0.999f64..0.999, 15),
    ) {
        let base = [0.1, 0.1, 0.003, 0.1, 0.003, 0.01];
        let sigma = SVector::<f64, 6>::from_fn(|k, _| base[k] * octaves[k].exp2());
        let mut belief = belief(1.0);
        belief.covariance = correlation::join(&sigma, &partial.try_into().unwrap());
        let sent = ExchangePacket { sequence: Some(1), modes: vec![belief] };
        for size in ExchangeSize::ALL {
            let told = sent.encode(ExchangeFormat::Two, size, 3, 77);
            let Ok(bytes) = told else {
                prop_assert!(matches!(told, Err(PacketError::OutOfRange { .. })), "{size:?} {told:?}");
                continue;
            };
            let got = ExchangePacket::decode(&bytes, ExchangeFormat::Two, [410.0, -100.0], 3, 77).unwrap();
            for k in 0..6 {
                let back = got.modes[0].covariance[(k, k)].sqrt();
                prop_assert!(back >= sigma[k] * (1.0 - shrinks(size, k)), "{size:?} {k}: {back} for {}", sigma[k]);
            }
        }
    }

    #[test]
    fn any_bytes_give_a_typed_result(bytes in proptest::collection::vec(any::<u8>(), 0..140), x in any::<f64>()) {
        for format in [ExchangeFormat::One, ExchangeFormat::Two] {
            if let Ok(p) = ExchangePacket::decode(&bytes, format, [x, -x], 1, 5) {
                for mode in p.modes {
                    prop_assert!(mode.covariance.cholesky().is_some());
                }
            }
        }
    }
}
