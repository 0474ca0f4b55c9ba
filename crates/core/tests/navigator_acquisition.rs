//! Starts that are hardly known: searched for, said so, found, and the ordinary case left as it is.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests fail by panicking")]

mod world;

use uwcoop_core::navigator::mpf::{Mpf, MpfOptions};
use uwcoop_core::navigator::team::Team;
use uwcoop_core::navigator::{Navigator, Outcome, Status};
use world::fleet::team_options;
use world::*;

/// Around in a square of 120 m, 1.5 m/s.
fn square(t: f64) -> [f64; 2] {
    let (side, along) = ((t / 80.0) as i64 % 4, 1.5 * (t % 80.0));
    match side {
        0 => [140.0 + along, 140.0],
        1 => [260.0, 140.0 + along],
        2 => [260.0 - along, 260.0],
        _ => [140.0, 260.0 - along],
    }
}

fn vehicle() -> Vehicle<impl Fn(f64) -> [f64; 2]> {
    let mut vehicle = Vehicle::new(0, square);
    vehicle.sounding_errors_m = world_noise(4, 900, 400).iter().map(|z| 0.05 * z).collect();
    vehicle.tide_m = 0.4;
    vehicle.current_mps = [0.08, -0.05];
    vehicle
}

fn options() -> MpfOptions {
    MpfOptions { range: None, ..mpf_options(600) }
}

/// A fix whose disc of `radius_m` holds the start somewhere off its middle.
fn wide_fix(radius_m: f64) -> uwcoop_core::event::Event {
    let [east, north] = square(0.0);
    fix(0, 0, [east + 0.4 * radius_m, north - 0.3 * radius_m], radius_m * radius_m / 4.0)
}

/// Statuses and errors of the seconds `from..to`.
fn sail(navigator: &mut dyn Navigator, from: i64, to: i64) -> Vec<(Status, f64, f64)> {
    let vehicle = vehicle();
    (from..to)
        .map(|second| {
            for event in vehicle.second(second, rich_depth) {
                navigator.handle(&event).unwrap();
            }
            let estimate = navigator.estimate(second * SECOND);
            let [ee, _, nn] = estimate.covariance_m2;
            let error = distance(estimate.mean_m, vehicle.position_m(second * SECOND));
            (estimate.status, error, (ee + nn).sqrt())
        })
        .collect()
}

#[test]
fn a_wide_start_is_searched_for_and_found_honestly() {
    let chart = rich();
    for (seed, radius_m) in [(1, 60.0), (2, 100.0), (3, 150.0), (4, 1e4)] {
        let mut navigator: Mpf<2> = mpf(0, 1, options(), &chart, seed);
        assert_eq!(navigator.handle(&wide_fix(radius_m)).unwrap(), Outcome::Fused);
        let (status, _, sigma_m) = sail(&mut navigator, 0, 1)[0];
        assert_eq!(status, Status::Acquiring, "{radius_m} m");
        assert!(sigma_m > 20.0, "{radius_m} m: {sigma_m} m after one sounding");
        let seconds = sail(&mut navigator, 1, 300);
        for (second, (_, error, sigma_m)) in seconds.iter().enumerate() {
            assert!(
                *error < 6.0 * sigma_m + 1.0,
                "{radius_m} m, {second} s: {error} m off, sigma {sigma_m} m"
            );
        }
        let (status, error, sigma_m) = seconds[298];
        assert_eq!(status, Status::Navigating, "{radius_m} m");
        assert!(error < 6.0 && sigma_m < 6.0, "{radius_m} m: {error} m off, sigma {sigma_m} m");
    }
}

#[test]
fn without_any_fix_the_whole_chart_is_searched() {
    let mut options = options();
    options.terrain.start_anywhere = true;
    let mut navigator: Mpf<4> = mpf(0, 1, options, &rich(), 7);
    let seconds = sail(&mut navigator, 0, 300);
    assert_eq!(seconds[0].0, Status::Acquiring);
    let (status, error, _) = seconds[299];
    assert!(status == Status::Navigating && error < 6.0, "{status:?}, {error} m off");
    // Not asked for, nothing begins.
    let mut navigator: Mpf<4> = mpf(0, 1, self::options(), &rich(), 7);
    assert_eq!(sail(&mut navigator, 0, 5)[4].0, Status::NotStarted);
}

#[test]
fn a_start_that_is_known_is_as_if_there_were_no_acquisition() {
    let chart = rich();
    let tracks = [(20.0, 20_000), (1e9, 10)].map(|(sigma_m, particles)| {
        let mut options = options();
        options.terrain.acquisition_sigma_m = sigma_m;
        options.terrain.acquisition_particles = particles;
        let mut navigator: Mpf<2> = mpf(0, 1, options, &chart, 1);
        navigator.handle(&wide_fix(10.0)).unwrap();
        sail(&mut navigator, 0, 120)
    });
    assert!(tracks[0].iter().all(|(status, ..)| *status == Status::Navigating));
    assert_eq!(tracks[0], tracks[1]);
}

#[test]
fn a_search_goes_on_from_its_snapshot_bit_for_bit() {
    let chart = rich();
    let mut first: Mpf<2> = mpf(0, 1, options(), &chart, 1);
    first.handle(&wide_fix(150.0)).unwrap();
    sail(&mut first, 0, 8);
    assert!(first.terrain().acquiring());
    let mut second: Mpf<2> = mpf(0, 1, options(), &chart, 99);
    second.restore(&first.snapshot().unwrap()).unwrap();
    assert_eq!(sail(&mut first, 8, 120), sail(&mut second, 8, 120));
    assert_eq!(first.snapshot().unwrap(), second.snapshot().unwrap());
}

#[test]
fn a_fix_that_says_where_the_vehicle_is_ends_the_search() {
    let mut navigator: Mpf<2> = mpf(0, 1, options(), &rich(), 1);
    navigator.handle(&wide_fix(150.0)).unwrap();
    sail(&mut navigator, 0, 5);
    assert!(navigator.terrain().acquiring());
    let here = fix(4 * SECOND, 0, square(4.0), 9.0);
    assert_eq!(navigator.handle(&here).unwrap(), Outcome::Fused);
    let estimate = navigator.estimate(4 * SECOND);
    assert_eq!(estimate.status, Status::Navigating);
    assert!(estimate.covariance_m2[0] < 12.0, "{estimate:?}");
}

#[test]
fn a_cloud_that_grew_without_a_chart_is_searched_for_and_never_sure_of_a_wrong_place() {
    // Without a chart in the west, where the vehicle stays for long.
    let holed = |e: f64, n: f64| if e < 200.0 { f64::NAN } else { rich_depth(e, n) };
    let track = |t: f64| {
        let away = 600.0;
        if t < 40.0 {
            [260.0 - 1.5 * t, 300.0]
        } else if t < 40.0 + away {
            let (s, c) = ((t - 40.0) / 50.0).sin_cos();
            [125.0 + 75.0 * c, 300.0 - 75.0 * s]
        } else {
            let back = t - 40.0 - away;
            let ([e, n], reach) = ([125.0 + 75.0 * 12f64.cos(), 300.0 - 75.0 * 12f64.sin()], 1.5 * back);
            [e + reach.min(200.0), n - (reach - 200.0).max(0.0)]
        }
    };
    let mut vehicle = Vehicle::new(0, track);
    vehicle.sounding_errors_m = world_noise(4, 900, 900).iter().map(|z| 0.05 * z).collect();
    let mut options = options();
    // A current that wanders three times as much: the cloud has grown to 100 m and more.
    options.terrain.drift.sigma_current_mps_per_sqrt_s = 0.03;
    let mut navigator: Mpf<2> = mpf(0, 1, options, &chart_of(holed), 2);
    navigator.handle(&fix(0, 0, track(0.0), 25.0)).unwrap();
    let (mut searched, mut widest_m) = (0, 0.0f64);
    for second in 0..900 {
        for event in vehicle.second(second, rich_depth) {
            navigator.handle(&event).unwrap();
        }
        let estimate = navigator.estimate(second * SECOND);
        let [ee, _, nn] = estimate.covariance_m2;
        let (error, sigma_m) = (distance(estimate.mean_m, track(second as f64)), (ee + nn).sqrt());
        assert!(error < 6.0 * sigma_m + 1.0, "{second} s: {error} m off, sigma {sigma_m} m");
        widest_m = widest_m.max(sigma_m);
        searched += i32::from(estimate.status == Status::Acquiring);
    }
    assert!(widest_m > 60.0 && searched > 10, "{widest_m} m, searched for {searched} s");
}

#[test]
fn a_team_member_is_silent_until_it_is_found() {
    let mut navigator: Team<2> = world::fleet::team_of(0, team_options(2, 600), Some(rich()));
    navigator.handle(&wide_fix(150.0)).unwrap();
    sail(&mut navigator, 0, 3);
    assert!(navigator.terrain().acquiring());
    assert!(
        navigator.transmit(3 * SECOND, 32).unwrap().is_none(),
        "it told of a start that it does not know"
    );
    sail(&mut navigator, 3, 200);
    assert!(!navigator.terrain().acquiring());
    assert!(navigator.transmit(200 * SECOND, 32).unwrap().is_some());
}

#[test]
fn options_outside_their_bounds_are_refused() {
    for (sigma_m, particles) in [(0.0, 20_000), (f64::NAN, 20_000), (20.0, 9), (20.0, 20_000_000)] {
        let mut options = options();
        options.terrain.acquisition_sigma_m = sigma_m;
        options.terrain.acquisition_particles = particles;
        let refused = Mpf::<2>::new(0, 1, options, Some(rich()), SOUND_SPEED_MPS, 1).err().unwrap();
        assert!(refused.to_string().contains("acquisition_"), "{refused}");
    }
}
