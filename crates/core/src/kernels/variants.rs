//! Every variant of every loop gives the same bits.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests fail by panicking")]

use nalgebra::Matrix2;

use super::likelihood::{
    OffsetModel, RangeBelief, SoundingColumns, add_range_gaussian, range_eq17, sounding_update,
    terrain_log_likelihood_fast,
};
use super::lookup::{Grid, paired};
use super::particles::{ParticleStep, liu_west, prepare_step, propagate, propagate_drawn, roughen_drawn};
use super::pattern::{Pattern, bounds};
use super::philox::{StreamKey, normal_pairs, sorted_uniforms, uniforms};
use super::weights::{known_share, moments, normalise, residual_copies};
use super::{ALLOWED, Level, level};

/// Output of every kernel for `n` particles, as bits.
fn everything(n: usize) -> Vec<(&'static str, Vec<u64>)> {
    let bits = |x: &[f64]| x.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
    let stream = |step: u32| StreamKey { seed: [3, 0], step, who: 1 };
    let normals = |step: u32| {
        let (mut a, mut b) = (vec![0.0; n], vec![0.0; n]);
        normal_pairs(&stream(step), 0, &mut a, &mut b);
        [a, b]
    };
    let mut all = Vec::new();
    let [a, b] = normals(1);
    all.push(("normals", bits(&[a.clone(), b.clone()].concat())));
    let mut u = vec![0.0; n];
    uniforms(&stream(2), 0, &mut u);
    all.push(("uniforms", bits(&u)));
    let mut sorted = vec![0.0; n];
    sorted_uniforms(&stream(7), 1, &mut sorted);
    all.push(("sorted uniforms", bits(&sorted)));

    let [mut east, mut north] = normals(2).map(|c| c.iter().map(|x| 60.0 + 5.0 * x).collect::<Vec<_>>());
    let mut p = Matrix2::new(0.09, 0.01, 0.01, 0.08);
    let step: ParticleStep<2> =
        prepare_step(&mut p, [1.2, -0.7], 1.0, [0.0025, 0.0, 0.0025], &Matrix2::identity());
    let mut linear = normals(3);
    propagate(&step, &mut east, &mut north, &mut linear, &a, &b);
    all.push((
        "propagate",
        bits(&[east.clone(), north.clone(), linear[0].clone(), linear[1].clone()].concat()),
    ));
    if let Some((low, high)) = bounds(&east, &north) {
        all.push(("bounds", bits(&[low, high].concat())));
    }

    propagate_drawn(&step, &stream(8), &mut east, &mut north, &mut linear);
    let ancestors: Vec<u32> = (0..n as u32).map(|i| i / 3 * 2 + i % 3 / 2).collect();
    roughen_drawn(&mut east, &mut north, &ancestors, 0.5, &stream(9));
    all.push((
        "drawn within the loop",
        bits(&[east.clone(), north.clone(), linear[0].clone(), linear[1].clone()].concat()),
    ));

    let mut logs: Vec<f64> = normals(4)[0].iter().map(|x| 30.0 * x).collect();
    if n > 2 {
        (logs[1], logs[2]) = (f64::NAN, f64::NEG_INFINITY);
    }
    let mut w = vec![0.0; n];
    let (top, share) = known_share(&logs, &u);
    let (total, squares) = normalise(&mut logs, &mut w).unwrap();
    all.push(("weights", bits(&[logs.clone(), w.clone(), vec![top, share, total, squares]].concat())));
    let (mut cdf, mut counts) = (vec![0.0; n], vec![0; n]);
    let left = residual_copies(&w, &mut cdf, &mut counts);
    cdf.extend(counts.iter().chain(&[left as u32]).map(|c| f64::from(*c)));
    all.push(("residual copies", bits(&cdf)));
    let (mean, covariance) = moments(&w, &east, &north);
    all.push(("moments", bits(&[&mean[..], &covariance[..]].concat())));

    let belief =
        RangeBelief { mean_m: [9.0, 30.0], covariance_m2: [4.0, 1.0, 9.0], range_m: 61.0, sigma_m: 1.0 };
    let (mut gaussian, mut eq17) = (vec![0.0; n], vec![0.0; n]);
    add_range_gaussian(&belief, 0.25, &east, &north, &mut gaussian);
    range_eq17(61.0, &a, &b, &u, &east, &north, &mut eq17);
    all.push(("ranges", bits(&[gaussian, eq17].concat())));

    let values: Vec<f32> = (0..120 * 120)
        .map(|i| 15.0 + (0.013 * i as f32).sin() + 2.0 * (0.1 * (i / 120) as f32).cos())
        .collect();
    let values = paired(&values, 120);
    let grid = Grid { values: &values, rows: 120, cols: 120, east0_m: 0.0, north0_m: 0.0, cell_m: 1.0 };
    let mut pattern = Pattern::default();
    pattern.set(&grid, (0..9).map(|k| [-1.3 * f64::from(k), 0.7 * f64::from(k)]));
    let mut terrain = vec![0.0; n];
    assert!(terrain_log_likelihood_fast(&grid, &pattern, &east, &north, &[0.1; 8], 0.2, &mut terrain));
    all.push(("terrain", bits(&terrain)));

    for dof in [4.0, f64::INFINITY] {
        let depth_m: Vec<f64> = a.iter().map(|x| if *x > 1.5 { f64::NAN } else { 15.0 + x }).collect();
        let mut out = [(); 5].map(|()| vec![0.0; n]);
        let [l, correction, variance, innovation, spread] = &mut out;
        let mut columns = SoundingColumns {
            depth_m: &depth_m,
            sigma_map_m: &u,
            offset_m: &b,
            offset_variance_m2: &u,
            log_likelihood: l,
            correction_m: correction,
            variance_m2: variance,
            innovation_m: innovation,
            innovation_variance_m2: spread,
        };
        sounding_update(&OffsetModel { sigma_m: 0.05, shared: 3.0, dof }, 15.3, 1e-4, &mut columns);
        all.push(("sounding", bits(&out.concat())));
    }

    let [mut x0, mut x1] = normals(6);
    let [z0, z1] = normals(7);
    liu_west(&mut [&mut x0, &mut x1], 0.3, &[&z0, &z1]);
    all.push(("liu_west", bits(&[x0, x1].concat())));
    all
}

#[test]
fn variants_agree_bit_for_bit() {
    for n in [1, 7, 8, 16, 37, 613] {
        ALLOWED.set(Level::Baseline);
        assert_eq!(level(), Level::Baseline);
        let baseline = everything(n);
        for allowed in [Level::Avx2, Level::Avx512] {
            ALLOWED.set(allowed);
            for ((name, expected), (_, found)) in baseline.iter().zip(everything(n)) {
                assert_eq!(*expected, found, "{name} of {n} particles, {:?}", level());
            }
        }
    }
}
