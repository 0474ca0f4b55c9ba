//! The packet of `team`: what goes in comes out within a step, and any bytes give a typed result.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests fail by panicking")]

use proptest::prelude::*;
use uwcoop_core::packet::{
    FixContent, Header, PacketError, ReportedFix, ReportedRange, ReportedSounding, TeamLayout, TeamReport,
    append_crc,
};

const SENDER: u16 = 1;
const TOL: i64 = 123_000_000_000;

fn layout(vehicles: usize, frame_bytes: usize) -> TeamLayout {
    TeamLayout::new(vehicles, frame_bytes - 4).unwrap()
}

#[test]
fn layouts_are_what_the_documentation_says() {
    let three = layout(3, 32);
    assert_eq!((three.pieces(), three.soundings(), three.has_ranges()), (3, 9, true));
    assert_eq!(three.soundings_beside_fix(), 2);
    let five = layout(5, 32);
    assert_eq!((five.soundings(), five.has_ranges()), (4, true));
    let sixteen = layout(16, 32);
    assert_eq!((sixteen.pieces(), sixteen.soundings(), sixteen.has_ranges()), (6, 5, false));
    let sixteen = layout(16, 64);
    assert_eq!((sixteen.soundings(), sixteen.has_ranges()), (10, true));
    for vehicles in 2..=16 {
        for frame_bytes in [32, 64, 96] {
            let layout = layout(vehicles, frame_bytes);
            assert!(layout.soundings() >= 4 && layout.payload_bytes() + 4 == frame_bytes);
        }
    }
    assert!(matches!(TeamLayout::new(3, 16), Err(PacketError::Length { .. })));
}

prop_compose! {
    fn reports(vehicles: u16)(
        depth_m in 0.0..100.0f64,
        window in 1u32..120,
        position in prop::array::uniform2(-2e5..2e5f64),
        pieces in prop::collection::vec(prop::array::uniform2(-30.0..30.0f64), 3..=6),
        start in 1.0..900.0f64,
        steps in prop::collection::vec(-1.2..1.2f64, 0..9),
        newest in 0u32..30,
        ranges in prop::collection::vec((0.5..2000.0f64, 0u8..4, any::<bool>()), usize::from(vehicles)),
        fix in prop::option::of((0.0..8000.0f64, prop::array::uniform2(-250.0..250.0f64), 0.3..40.0f64, any::<bool>())),
        sequence: u8,
    ) -> TeamReport {
        let mut report = TeamReport { sequence, depth_m, window_s: f64::from(window), position_m: position, ..TeamReport::default() };
        report.pieces_m.extend(pieces);
        let mut depth = start;
        for (k, step) in steps.iter().enumerate() {
            report.soundings.push(ReportedSounding { age_s: f64::from(newest) / 4.0 + k as f64, water_depth_m: depth });
            depth += step;
        }
        for (vehicle, (range_m, sequence, there)) in ranges.into_iter().enumerate() {
            if there && vehicle as u16 != SENDER {
                report.ranges.push(ReportedRange { vehicle: vehicle as u16, sequence, range_m });
            }
        }
        report.fix = fix.map(|(age_s, pair, sigma_m, start)| ReportedFix {
            age_s,
            content: if start { FixContent::Start(pair.map(|x| 20.0 * x)) } else { FixContent::Residual(pair) },
            sigma_m,
        });
        report
    }
}

/// Distance of two numbers that are known modulo something.
fn apart(a: f64, b: f64, modulus: f64) -> f64 {
    let d = a - b;
    if modulus.is_finite() { (d - modulus * (d / modulus).round()).abs() } else { d.abs() }
}

fn check_fix(sent: Option<ReportedFix>, read: Option<ReportedFix>) {
    let (Some(sent), Some(read)) = (sent, read) else {
        assert_eq!(sent.is_some(), read.is_some());
        return;
    };
    assert!((sent.age_s - read.age_s).abs() <= 0.125 + sent.age_s / 1000.0, "{sent:?} {read:?}");
    // Up to 16 m a step is a quarter of an octave, above it a whole one.
    let step = if sent.sigma_m <= 16.0 { 1.2 } else { 2.0 };
    assert!(read.sigma_m >= sent.sigma_m && read.sigma_m <= step * sent.sigma_m + 1e-9);
    let (a, b, step) = match (sent.content, read.content) {
        (FixContent::Start(a), FixContent::Start(b)) => (a, b, 4.0),
        (FixContent::Residual(a), FixContent::Residual(b)) => (a, b, 0.125),
        other => panic!("{other:?}"),
    };
    assert!((0..2).all(|k| (a[k] - b[k]).abs() <= 0.5 * step + 1e-9));
}

proptest! {
    #[test]
    fn what_goes_in_comes_out_within_a_step(report in reports(3)) {
        let layout = layout(3, 32);
        let bytes = report.encode(&layout, SENDER, TOL).unwrap();
        prop_assert!(bytes.len() <= 32);
        let mut read = TeamReport::default();
        read.decode(&bytes, &layout, SENDER, TOL).unwrap();
        prop_assert_eq!(read.sequence, report.sequence);
        prop_assert_eq!(read.window_s, report.window_s);
        prop_assert!((read.depth_m - report.depth_m).abs() <= 0.5 * Header::depth_step_m(report.depth_m) + 1e-9);
        for axis in 0..2 {
            prop_assert!(apart(read.position_m[axis], report.position_m[axis], read.position_modulus_m) <= 0.0625 + 1e-6);
            let (mut a, mut b) = (0.0, 0.0);
            for (sent, got) in report.pieces_m.iter().zip(&read.pieces_m) {
                a += sent[axis];
                b += got[axis];
                prop_assert!((a - b).abs() <= 0.0625 + 1e-9, "sums are rounded, not pieces");
            }
        }
        let room = if report.fix.is_some() { layout.soundings_beside_fix() } else { layout.soundings() };
        prop_assert_eq!(read.soundings.len(), report.soundings.len().min(room));
        for (sent, got) in report.soundings.iter().zip(&read.soundings) {
            prop_assert!((sent.age_s - got.age_s).abs() < 1e-9);
            prop_assert!(apart(sent.water_depth_m, got.water_depth_m, read.depth_modulus_m) <= 0.01 + 1e-6);
        }
        prop_assert_eq!(read.ranges.len(), report.ranges.len());
        for (sent, got) in report.ranges.iter().zip(&read.ranges) {
            prop_assert_eq!((sent.vehicle, sent.sequence), (got.vehicle, got.sequence));
            prop_assert!((sent.range_m - got.range_m).abs() <= 0.125 + 1e-9);
        }
        check_fix(report.fix, read.fix);
    }

    #[test]
    fn the_f64_form_is_exact(report in reports(5)) {
        let layout = layout(5, 64);
        let bytes = report.encode_f64(SENDER, TOL).unwrap();
        let mut read = TeamReport::default();
        read.decode(&bytes, &layout, SENDER, TOL).unwrap();
        read.depth_m = report.depth_m;
        prop_assert_eq!(read, report);
    }

    #[test]
    fn any_bytes_give_a_typed_result(bytes in prop::collection::vec(any::<u8>(), 0..80), vehicles in 2usize..=16) {
        let layout = layout(vehicles, 64);
        let mut read = TeamReport::default();
        prop_assert!(read.decode(&bytes, &layout, SENDER, TOL).is_err() || !bytes.is_empty());
    }

    /// A checksum can be right and the content nonsense: a decoder that never trusts bounds it all the same.
    #[test]
    fn nonsense_with_a_checksum_is_refused_or_bounded(
        mut payload in prop::collection::vec(any::<u8>(), 28..=28),
        kind in 5u8..=7,
        longer in prop::collection::vec(any::<u8>(), 0..200),
    ) {
        payload[0] = (kind << 4) | (payload[0] & 0x0F);
        if kind == 7 {
            payload.extend(longer);
        }
        let layout = layout(3, 32);
        let mut read = TeamReport::default();
        if read.decode(&append_crc(payload, SENDER, TOL), &layout, SENDER, TOL).is_ok() {
            prop_assert!(read.soundings.len() <= 64 && read.pieces_m.len() <= 16 && read.ranges.len() <= 2);
            let all = read.pieces_m.iter().flatten().chain(&read.position_m).copied();
            let all = all.chain(read.soundings.iter().flat_map(|s| [s.age_s, s.water_depth_m]));
            prop_assert!(all.chain(read.ranges.iter().map(|r| r.range_m)).all(|x| x.abs() <= 1e8));
            prop_assert!(read.ranges.iter().all(|r| r.vehicle != SENDER && r.vehicle < 3));
        }
    }
}

#[test]
fn steep_soundings_take_a_larger_step_and_missing_ones_are_missing() {
    let layout = layout(3, 32);
    let mut report = TeamReport { window_s: 9.0, ..TeamReport::default() };
    report.pieces_m.extend([[1.0, 0.0]; 3]);
    let depths = [100.0, 104.0, f64::NAN, 111.0, 95.0];
    for (k, d) in depths.iter().enumerate().filter(|(_, d)| !d.is_nan()) {
        report.soundings.push(ReportedSounding { age_s: k as f64, water_depth_m: *d });
    }
    let bytes = report.encode(&layout, SENDER, TOL).unwrap();
    let mut read = TeamReport::default();
    read.decode(&bytes, &layout, SENDER, TOL).unwrap();
    assert_eq!(read.soundings.len(), 4);
    for (sent, got) in report.soundings.iter().zip(&read.soundings) {
        assert_eq!(sent.age_s, got.age_s);
        assert!(apart(sent.water_depth_m, got.water_depth_m, read.depth_modulus_m) <= 0.16 + 1e-9);
    }
    assert!(read.depth_rounding_m2 > 0.32 * 0.32 / 12.1, "a step of 0.32 m");
    report.pieces_m[1] = [900.0, 0.0];
    assert!(matches!(report.encode(&layout, SENDER, TOL), Err(PacketError::OutOfRange { .. })));
    report.pieces_m[1] = [f64::NAN, 0.0];
    assert!(matches!(report.encode(&layout, SENDER, TOL), Err(PacketError::NotFinite { .. })));
}

proptest! {
    #[test]
    fn the_sigma_of_a_fix_reaches_a_thousand_metres_and_is_never_understated(sigma_m in 0.0..1000.0f64) {
        let layout = layout(3, 32);
        let mut report = TeamReport { window_s: 10.0, ..TeamReport::default() };
        report.pieces_m.extend([[1.0, 2.0]; 3]);
        report.fix = Some(ReportedFix { age_s: 1.0, content: FixContent::Start([0.0; 2]), sigma_m });
        let bytes = report.encode(&layout, SENDER, TOL).unwrap();
        prop_assert_eq!(bytes.len(), layout.payload_bytes() + 2);
        let mut read = TeamReport::default();
        read.decode(&bytes, &layout, SENDER, TOL).unwrap();
        let found = read.fix.unwrap().sigma_m;
        // Quarter octaves where starts are known, whole ones beyond 16 m.
        let step = if sigma_m <= 16.0 { 2f64.powf(0.25) } else { 2.0 };
        prop_assert!(found >= sigma_m && found <= (sigma_m * step * 1.000001).max(0.25), "{} as {}", sigma_m, found);
    }
}

#[test]
fn a_sigma_that_no_fix_has_is_refused() {
    let layout = layout(3, 32);
    for sigma_m in [2048.1, f64::INFINITY, f64::NAN, -1.0] {
        let mut report = TeamReport { window_s: 10.0, ..TeamReport::default() };
        report.pieces_m.extend([[1.0, 2.0]; 3]);
        report.fix = Some(ReportedFix { age_s: 1.0, content: FixContent::Start([0.0; 2]), sigma_m });
        let refused = report.encode(&layout, SENDER, TOL).unwrap_err();
        assert!(refused.to_string().contains("sigma of a fix"), "{refused}");
    }
}
