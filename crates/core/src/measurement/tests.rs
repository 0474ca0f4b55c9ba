//! The models against their definitions, and every place that uses one against the model.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests fail by panicking")]

use proptest::prelude::*;

use super::angle::{wrap, wrap_fast};
use super::fix;
use super::range::{CloudInnovation, LateArrivals, along, expected};
use super::sounding::{
    OUTER, inflation, log_likelihood, neutral_log_likelihood, plane, position_factor, sharing_error,
};
use crate::kernels::likelihood::{OffsetModel, RangeBelief};
use crate::kernels::team::{
    BLOCK, BlockLayout, BlockUpdates, Joints, Op, Own, RangeOp, packed, packed_len, run,
};

proptest! {
    #[test]
    fn both_wraps_are_the_same_angle(angle in -1e4..1e4f64) {
        let (exact, fast) = (wrap(angle), wrap_fast(angle));
        prop_assert!((-std::f64::consts::PI..std::f64::consts::PI).contains(&exact));
        let apart = (exact - fast).rem_euclid(std::f64::consts::TAU);
        prop_assert!(apart.min(std::f64::consts::TAU - apart) < 1e-9);
    }

    /// The expected range is that of the curvature while the spread is small. The second-order form exceeds the root mean
    /// square of the range by 6 % at the most, where the spread across is the distance: 1.5 / √2.
    #[test]
    fn a_range_is_not_expected_much_longer_than_its_root_mean_square(
        de in -50.0..50.0f64, dn in -50.0..50.0f64, a in 0.01..60.0f64, b in 0.01..60.0f64, rho in -0.9..0.9f64,
    ) {
        prop_assume!(de.hypot(dn) > 1e-6);
        let p = [a * a, rho * a * b, b * b];
        let e = expected([de, dn], p);
        let mean = e.distance_m + 0.5 * e.curvature_m;
        prop_assert!(mean >= e.distance_m);
        prop_assert!(mean <= 1.5 / 2.0f64.sqrt() * (de * de + dn * dn + a * a + b * b).sqrt() + 1e-9);
        let across = a * a + b * b - along(e.direction, p);
        prop_assert!((e.curvature_m - across / e.distance_m.max(across.sqrt())).abs() < 1e-9 * across);
    }

    /// The likelihood of `mpf`, the kernel of `team` and the model see one range alike, near and far.
    #[test]
    fn ranges_of_mpf_and_team_agree(
        e in -80.0..80.0f64, n in -80.0..80.0f64, a in 0.1..40.0f64, b in 0.1..40.0f64, rho in -0.9..0.9f64,
        range_m in 0.0..300.0f64,
    ) {
        let p = [a * a, rho * a * b, b * b];
        let belief = RangeBelief { mean_m: [e, n], covariance_m2: p, range_m, sigma_m: 1.5 };
        let (innovation, variance) = belief.innovation(0.0, 0.0);
        let model = expected([-e, -n], p);
        prop_assert_eq!(innovation, model.innovation(range_m));
        let (seen, seen_variance) = kernel_range([e, n], p, range_m, 1.5);
        prop_assert!((seen - innovation).abs() < 1e-9 * (1.0 + range_m + a + b));
        prop_assert!((seen_variance - variance).abs() < 1e-9 * variance);
    }

    #[test]
    fn a_sounding_weighs_as_the_model_says(
        innovation in -5.0..5.0f64, p in 1e-4..4.0f64, sigma in 0.01..1.0f64, map in 0.0..1.0f64,
        shared in 1.0..50.0f64, student: bool,
    ) {
        let dof = if student { 4.0 } else { f64::INFINITY };
        let model = OffsetModel { sigma_m: sigma, shared, dof };
        let (l, step, after) = model.update(innovation, p, map);
        let noise = sigma * sigma + map * map;
        let squared = innovation * innovation;
        let expected = if student {
            -2.5 * (1.0 + squared / (4.0 * (p + noise))).ln() - 0.5 * (p + noise).ln()
        } else {
            -0.5 * squared / (p + noise) - 0.5 * (p + noise).ln()
        };
        prop_assert!((l * shared - expected).abs() < 1e-9 * (1.0 + expected.abs()));
        prop_assert_eq!(l, log_likelihood(squared, p + noise, dof) / shared);
        let r = shared * noise * inflation(squared, p + shared * noise, dof);
        prop_assert!((step - p / (p + r) * innovation).abs() < 1e-12);
        prop_assert!((after - p * r / (p + r)).abs() < 1e-9 * p);
        prop_assert!(inflation(squared, p + shared * noise, dof) >= 1.0);
    }

    /// Five points of a plane give back the plane; of a quadratic surface, its mean over the spread.
    #[test]
    fn five_points_see_a_plane_and_the_mean_of_a_bowl(
        ge in -1.0..1.0f64, gn in -1.0..1.0f64, bend in -0.01..0.01f64, a in 0.1..20.0f64, b in 0.1..20.0f64,
        rho in -0.9..0.9f64,
    ) {
        let p = [a * a, rho * a * b, b * b];
        let factor = position_factor(p);
        let [l11, l21, l22] = factor.map(|l| OUTER * l);
        let depth = |e: f64, n: f64| 20.0 + ge * e + gn * n + bend * (e * e + n * n);
        let h = [depth(0.0, 0.0), depth(l11, l21), depth(-l11, -l21), depth(0.0, l22), depth(0.0, -l22)];
        let seen = plane(h, factor);
        prop_assert!((seen.gradient[0] - ge).abs() < 1e-6 && (seen.gradient[1] - gn).abs() < 1e-6);
        prop_assert!((seen.mean_m - 20.0 - bend * (a * a + b * b)).abs() < 1e-6);
        prop_assert!(seen.residual_m2 > -1e-9);
    }

    #[test]
    fn a_fix_is_gated_by_its_squared_distance(
        e in -40.0..40.0f64, n in -40.0..40.0f64, a in 0.1..20.0f64, b in 0.1..20.0f64, rho in -0.9..0.9f64,
    ) {
        let p = [a * a, rho * a * b, b * b];
        let inverse = nalgebra::Matrix2::new(p[0], p[1], p[1], p[2]).try_inverse().unwrap();
        let off = nalgebra::Vector2::new(e, n);
        let square = (off.transpose() * inverse * off)[0];
        prop_assume!((square - fix::GATE).abs() > 1e-6);
        prop_assert_eq!(fix::contradicts([e, n], p), Some(square > fix::GATE));
    }

    /// Without late arrivals the mixture is the Gaussian; the derivatives are those of ln Z.
    #[test]
    fn late_arrivals_are_differentiated_correctly(
        nu in -60.0..120.0f64, sigma in 0.5..25.0f64, share in 0.0..0.5f64, mean_m in 2.0..80.0f64,
    ) {
        let s = sigma * sigma;
        let late = |share| LateArrivals { share, mean_m, floor_per_m: 1e-6 };
        let at = |x: f64| late(share).likelihood(x, s);
        let h = 1e-3 * sigma;
        let here = at(nu);
        let slope = (at(nu + h).log_z - at(nu - h).log_z) / (2.0 * h);
        prop_assert!((here.slope - slope).abs() < 1e-4 * (1.0 / sigma + slope.abs()), "{} {slope}", here.slope);
        let curvature = (at(nu + h).slope - at(nu - h).slope) / (2.0 * h);
        prop_assert!((here.curvature - curvature).abs() < 1e-4 / s + 1e-3 * curvature.abs());
        prop_assert!((0.0..=1.0).contains(&here.late_share));
        // The variance of a state that is the range itself stays one.
        prop_assert!(s + s * s * here.curvature > 0.0);
        let gaussian = LateArrivals { share: 0.0, mean_m, floor_per_m: 0.0 }.likelihood(nu, s);
        if nu * nu / s < 60.0 {
            prop_assert!((gaussian.log_z + 0.5 * (nu * nu / s + s.ln())).abs() < 1e-9);
            prop_assert!((gaussian.slope + nu / s).abs() < 1e-9 * (1.0 + (nu / s).abs()));
            prop_assert!((gaussian.curvature + 1.0 / s).abs() < 1e-6 / s);
        }
    }
}

/// One range of `team`'s kernel to a block at `place`, from the origin: innovation and its variance.
fn kernel_range(place: [f64; 2], [ee, en, nn]: [f64; 3], range_m: f64, sigma_m: f64) -> (f64, f64) {
    let mut mean = vec![0.0; BLOCK];
    mean[..2].copy_from_slice(&place);
    let mut before = vec![0.0; packed_len(BLOCK)];
    before[packed(0, 0)] = ee;
    before[packed(1, 0)] = en;
    before[packed(1, 1)] = nn;
    let mut after = before.clone();
    let zero = [0.0];
    let at = [[zero.as_slice(), zero.as_slice()]; 2];
    let updates = BlockUpdates {
        base: 0,
        layout: BlockLayout::default(),
        ops: &[Op::RangeToOwn {
            own: 0,
            clock_sign: 1.0,
            range: RangeOp { range_m, variance_m2: sigma_m * sigma_m },
        }],
        terrain: None,
        own: Own { at },
        current: None,
        late: None,
    };
    let mut joints = Joints {
        dim: BLOCK,
        mean: &mut mean,
        before: &before,
        order: &[0],
        after: &mut after,
        scratch: &mut Vec::new(),
    };
    let (mut l, mut nu, mut s) = ([0.0], [0.0], [0.0]);
    run(&updates, &mut joints, &mut l, &mut [&mut nu, &mut s]);
    (nu[0], s[0])
}

#[test]
fn a_range_inside_a_wide_cloud_is_expected_at_ten_metres_and_not_at_forty() {
    // 4 m apart on average, 18 m of spread: the curvature over the distance would expect 4 + 40 m.
    let p = [324.0, 0.0, 324.0];
    let e = expected([4.0, 0.0], p);
    let mean = e.distance_m + 0.5 * e.curvature_m;
    assert!((mean - 13.0).abs() < 1e-9, "{mean}");
    let over_distance = 4.0 + 0.5 * 324.0 / 4.0;
    // The mean of a Rice distribution with these parameters, by a sum over a grid of the plane.
    let (mut sum, mut weight) = (0.0, 0.0);
    for i in -300..300 {
        for j in -300..300 {
            let (x, y) = (0.3 * f64::from(i), 0.3 * f64::from(j));
            let w = (-(x * x + y * y) / (2.0 * 324.0)).exp();
            sum += w * (x + 4.0).hypot(y);
            weight += w;
        }
    }
    let exact: f64 = sum / weight;
    assert!((mean - exact).abs() < (over_distance - exact).abs(), "{mean}, {exact}, {over_distance}");
}

#[test]
fn soundings_share_an_error_over_twice_its_length() {
    assert_eq!(sharing_error(10.0, None), 1.0);
    assert_eq!(sharing_error(10.0, Some(2.0)), 10.0);
    assert_eq!(sharing_error(0.0, Some(2.0)), 1.0);
    assert_eq!(sharing_error(10.0, Some(0.0)), 1e6);
}

#[test]
fn who_has_no_chart_takes_the_mean_likelihood_of_those_who_have_one() {
    let weights = [0.25, 0.25, 0.5];
    let neutral = neutral_log_likelihood(&[0.5f64.ln(), 0.1f64.ln(), f64::NAN], &weights).unwrap();
    assert!((neutral.exp() - 0.3).abs() < 1e-12);
    assert!(neutral_log_likelihood(&[0.0, f64::NAN, f64::NAN], &[0.19, 0.41, 0.4]).is_none());
    assert!(neutral_log_likelihood(&[f64::NEG_INFINITY; 3], &weights).is_none());
}

#[test]
fn a_cloud_contradicts_a_range_only_beyond_its_own_spread() {
    let of = |nu: [f64; 2]| CloudInnovation::of(nu.into_iter().map(|x| (0.5, x, 1.0)));
    assert!(of([7.0, 7.0]).contradicts(6.0, None));
    assert!(!of([-3.0, 17.0]).contradicts(6.0, None), "half of the cloud is close");
    assert!(!of([7.0, 7.0]).contradicts(f64::INFINITY, None));
    let late = LateArrivals { share: 0.05, mean_m: 20.0, floor_per_m: 1e-6 };
    assert!(!of([300.0, 300.0]).contradicts(6.0, Some(&late)));
    assert!(of([320.0, 320.0]).contradicts(6.0, Some(&late)));
    assert!(of([-320.0, -320.0]).contradicts(6.0, Some(&late)));
}
