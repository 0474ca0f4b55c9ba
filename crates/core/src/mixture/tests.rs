//! Mixtures find what points were drawn from, also across ±π and under clones.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests fail by panicking")]

use super::*;
use crate::random::{Purpose, Streams};
use nalgebra::{Matrix2, Vector2};

fn two_clusters(n: usize) -> (Vec<Vector2<f64>>, Vec<f64>) {
    let (mut a, mut b) = (vec![0.0; n], vec![0.0; n]);
    Streams::new(3, 0).at(Purpose::Initial, 0).normal_pairs(0, &mut a, &mut b);
    let points = (0..n)
        .map(|i| {
            let centre = if i % 4 == 0 { Vector2::new(40.0, 10.0) } else { Vector2::new(0.0, 0.0) };
            centre + Vector2::new(2.0 * a[i], a[i] + b[i])
        })
        .collect();
    (points, vec![1.0 / n as f64; n])
}

#[test]
fn two_clusters_are_found() {
    let (points, weights) = two_clusters(4000);
    let mixture = fit(&points, &weights, 2, 30).expect("points are finite");
    let [near, far] = [&mixture[0], &mixture[1]].map(|m| *m);
    let (near, far) = if near.mean.x < far.mean.x { (near, far) } else { (far, near) };
    assert!((near.weight - 0.75).abs() < 0.01 && (far.weight - 0.25).abs() < 0.01);
    assert!(near.mean.norm() < 0.2 && (far.mean - Vector2::new(40.0, 10.0)).norm() < 0.3);
    assert!((near.covariance - Matrix2::new(4.0, 2.0, 2.0, 2.0)).norm() < 0.5);
}

#[test]
fn a_mixture_keeps_the_moments_of_its_points() {
    let (points, weights) = two_clusters(500);
    let (mean, covariance) = moments(&points, &weights);
    for modes in 1..=4 {
        let mixture = fit(&points, &weights, modes, 12).expect("points are finite");
        let total: Vector2<f64> = mixture.iter().map(|m| m.mean * m.weight).sum();
        assert!((total - mean).norm() < 1e-6);
        let spread: Matrix2<f64> = mixture
            .iter()
            .map(|m| (m.covariance + (m.mean - mean) * (m.mean - mean).transpose()) * m.weight)
            .sum();
        assert!((spread - covariance).norm() < RIDGE * 2.0, "{spread} {covariance}");
    }
}

#[test]
fn points_that_say_nothing_are_no_mixture() {
    assert!(fit::<2>(&[], &[], 2, 5).is_none());
    assert!(fit(&[Vector2::new(f64::NAN, 0.0)], &[1.0], 1, 5).is_none());
    let one = fit(&[Vector2::new(3.0, 4.0); 5], &[0.2; 5], 2, 5).expect("a point is a mode");
    assert!(one.iter().all(|m| m.mean.iter().all(|v| v.is_finite())));
}

const OPTIONS: FitOptions =
    FitOptions { starts: 3, iterations: 100, tolerance: 1e-7, ridge_one: 1e-9, ridge_many: 1e-3 };

/// The two clusters with a yaw of their own each, the second one across ±π.
fn with_yaw(n: usize) -> (Vec<nalgebra::Vector3<f64>>, Vec<f64>) {
    let (points, weights) = two_clusters(n);
    let (mut a, mut b) = (vec![0.0; n], vec![0.0; n]);
    Streams::new(4, 0).at(Purpose::Initial, 1).normal_pairs(0, &mut a, &mut b);
    let yaw = |i: usize| {
        if i.is_multiple_of(4) { crate::measurement::angle::wrap(3.1 + 0.1 * a[i]) } else { 0.5 + 0.1 * b[i] }
    };
    (points.iter().enumerate().map(|(i, p)| nalgebra::Vector3::new(p.x, p.y, yaw(i))).collect(), weights)
}

#[test]
fn modes_across_the_cut_of_a_circle_are_found_and_counted() {
    let (points, weights) = with_yaw(2000);
    let stream = Streams::new(1, 0).at(Purpose::Belief, 0);
    for criterion in [Criterion::Bic, Criterion::Aic] {
        let best =
            select(&points, &weights, [false, false, true], 4, criterion, &OPTIONS, 4000, &stream).unwrap();
        assert!(best.modes.len() >= 2, "{}", best.modes.len());
        if criterion == Criterion::Bic {
            assert_eq!(best.modes.len(), 2);
        }
        assert!((best.modes[0].weight - 0.75).abs() < 0.02);
        let turned = (best.modes[1].mean[2] - 3.1).sin().abs();
        assert!(criterion == Criterion::Aic || turned < 0.03, "{}", best.modes[1].mean);
    }
    let limited =
        select(&points, &weights, [false, false, true], 1, Criterion::Bic, &OPTIONS, 4000, &stream).unwrap();
    assert_eq!(limited.modes.len(), 1);
    let total: f64 = limited.modes[0].covariance[(0, 0)];
    assert!((total - 304.0).abs() < 15.0, "one mode spans both clusters: {total}");
}

#[test]
fn clones_are_counted_once() {
    let (points, _) = with_yaw(40);
    let cloned: Vec<_> = points.iter().cycle().take(4000).copied().collect();
    let (kept, shares) = distinct(&cloned, &vec![1.0 / 4000.0; 4000]);
    assert_eq!(kept.len(), 40);
    assert!(shares.iter().all(|s| (s - 0.025).abs() < 1e-12));
    let stream = Streams::new(1, 0).at(Purpose::Belief, 0);
    let fitted = fit_best(&kept, &shares, [false, false, true], 1, &OPTIONS, &stream).unwrap();
    assert_eq!(fitted.points, 40);
}

#[test]
fn a_coordinate_without_spread_does_not_choose_the_modes() {
    let (mut points, weights) = with_yaw(2000);
    points.iter_mut().for_each(|p| p[2] = 1.25);
    let stream = Streams::new(1, 0).at(Purpose::Belief, 0);
    let best =
        select(&points, &weights, [false, false, true], 4, Criterion::Bic, &OPTIONS, 500, &stream).unwrap();
    assert_eq!(best.modes.len(), 2);
    assert!((best.modes[0].mean[2] - 1.25).abs() < 1e-9 && best.modes[0].covariance[(2, 2)] < 1e-12);
}

#[test]
fn samples_meet_their_shares() {
    let mode = |weight| Mode { weight, mean: Vector2::zeros(), covariance: Matrix2::identity() };
    assert_eq!(sample_counts(&[mode(0.6015625), mode(0.3984375)], 500), [301, 199]);
    assert_eq!(sample_counts(&[mode(0.5), mode(0.5)], 1).iter().sum::<usize>(), 1);
}
