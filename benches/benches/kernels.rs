//! The inner loops and whole steps, ns per particle (criterion's throughput), sizes in the id.
#![allow(missing_docs, reason = "criterion's macros write an undocumented main")]

use std::hint::black_box;
use std::sync::Arc;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use nalgebra::Matrix2;
use uwcoop_benches::{Lap, chart, dmpf_options, drift, mpf_options};
use uwcoop_core::chart::Chart;
use uwcoop_core::error::Error;
use uwcoop_core::kernels::likelihood::{
    RangeBelief, add_range_gaussian, range_eq17, terrain_log_likelihood_fast,
};
use uwcoop_core::kernels::particles::{ParticleStep, gather, prepare_step, propagate, propagate_drawn};
use uwcoop_core::kernels::pattern::{Pattern, pattern_depths};
use uwcoop_core::kernels::weights::{moments, normalise, residual_resample};
use uwcoop_core::navigator::Navigator;
use uwcoop_core::navigator::dmpf::Dmpf;
use uwcoop_core::navigator::mpf::Mpf;
use uwcoop_core::random::{Purpose, Stream, Streams};

/// Steps before a navigator is timed: its window is full and its cloud has settled.
const SETTLE: usize = 100;

fn stream(step: u32) -> Stream {
    Streams::new(1, 0).at(Purpose::Process, step)
}

/// Two columns of normals.
fn normals(n: usize, step: u32) -> [Vec<f64>; 2] {
    let (mut a, mut b) = (vec![0.0; n], vec![0.0; n]);
    stream(step).normal_pairs(0, &mut a, &mut b);
    [a, b]
}

/// A cloud with a standard deviation of 5 m around a point of the chart.
fn cloud(n: usize) -> [Vec<f64>; 2] {
    let [mut e, mut n_] = normals(n, 0);
    e.iter_mut().for_each(|x| *x = 480.3 + 5.0 * *x);
    n_.iter_mut().for_each(|x| *x = 520.7 + 5.0 * *x);
    [e, n_]
}

/// Normalised weights of a cloud that is about to be resampled.
fn weights(n: usize) -> Vec<f64> {
    let [mut logs, _] = normals(n, 7);
    logs.iter_mut().for_each(|x| *x *= 0.8);
    let mut w = vec![0.0; n];
    normalise(&mut logs, &mut w);
    w
}

fn lookups(c: &mut Criterion, chart: &Arc<Chart>) {
    let mut group = c.benchmark_group("lookup/pattern15");
    let grid = chart.grid();
    let mut pattern = Pattern::default();
    pattern.set(&grid, (0..15).map(|k| [-1.3 * f64::from(k), -0.7 * f64::from(k)]));
    for n in [600, 10_000] {
        let [e, n_] = cloud(n);
        group.throughput(Throughput::Elements(n as u64));
        group.bench_function(BenchmarkId::from_parameter(n), |b| {
            b.iter(|| {
                let mut sum = [0.0f32; 16];
                pattern_depths(&grid, &pattern, black_box(&e), &n_, |_, _, _, depths| {
                    sum.iter_mut().zip(depths).for_each(|(s, d)| *s += d);
                });
                sum
            });
        });
    }
    group.finish();
    let mut group = c.benchmark_group("terrain_likelihood/pattern15");
    for n in [600, 10_000] {
        let [e, n_] = cloud(n);
        let mut out = vec![0.0; n];
        group.throughput(Throughput::Elements(n as u64));
        group.bench_function(BenchmarkId::from_parameter(n), |b| {
            b.iter(|| {
                terrain_log_likelihood_fast(&grid, &pattern, black_box(&e), &n_, &[0.1; 14], 0.2, &mut out)
            });
        });
    }
    group.finish();
}

fn particles(c: &mut Criterion) {
    for n in [600, 10_000] {
        let elements = Throughput::Elements(n as u64);
        let [mut e, mut n_] = cloud(n);
        let [a, b_] = normals(n, 3);
        let mut linear = normals(n, 4);
        let mut p = Matrix2::identity() * 0.09;
        let drift = drift();
        let step: ParticleStep<2> =
            prepare_step(&mut p, [1.5, 0.0], 1.0, drift.position_walk(1.0), &drift.walk(1.0));
        let mut group = c.benchmark_group("propagate");
        group.throughput(elements.clone());
        group.bench_function(BenchmarkId::from_parameter(n), |b| {
            b.iter(|| propagate(black_box(&step), &mut e, &mut n_, &mut linear, &a, &b_));
        });
        group.finish();

        let mut group = c.benchmark_group("propagate_drawn");
        group.throughput(elements.clone());
        group.bench_function(BenchmarkId::from_parameter(n), |b| {
            b.iter(|| propagate_drawn(black_box(&step), stream(2).key(), &mut e, &mut n_, &mut linear));
        });
        group.finish();

        let mut group = c.benchmark_group("normals");
        let (mut x, mut y) = (vec![0.0; n], vec![0.0; n]);
        group.throughput(Throughput::Elements(2 * n as u64));
        group.bench_function(BenchmarkId::from_parameter(n), |b| {
            b.iter(|| stream(black_box(9)).normal_pairs(0, &mut x, &mut y));
        });
        group.finish();

        let mut group = c.benchmark_group("weights");
        let [logs, _] = normals(n, 5);
        let (mut work, mut w) = (logs.clone(), vec![0.0; n]);
        group.throughput(elements.clone());
        group.bench_function(BenchmarkId::from_parameter(n), |b| {
            b.iter(|| {
                work.copy_from_slice(&logs);
                normalise(black_box(&mut work), &mut w)
            });
        });
        group.finish();

        let mut group = c.benchmark_group("residual_resample");
        let w = weights(n);
        let mut u = vec![0.0; n];
        stream(6).uniforms(0, &mut u);
        let (mut cdf, mut counts, mut ancestors) = (vec![0.0; n], vec![0; n], vec![0; n]);
        group.throughput(elements.clone());
        group.bench_function(BenchmarkId::new("index", n), |b| {
            b.iter(|| residual_resample(black_box(&w), &u, &mut cdf, &mut counts, &mut ancestors));
        });
        let (mut column, mut scratch) = (u.clone(), u.clone());
        group.bench_function(BenchmarkId::new("gather", n), |b| {
            b.iter(|| gather(black_box(&mut column), &mut scratch, &ancestors));
        });
        group.finish();

        let mut group = c.benchmark_group("moments");
        group.throughput(elements);
        let [e, n_] = cloud(n);
        group.bench_function(BenchmarkId::from_parameter(n), |b| b.iter(|| moments(black_box(&w), &e, &n_)));
        group.finish();
    }
}

fn ranges(c: &mut Criterion) {
    let n = 600;
    let [e, n_] = cloud(n);
    let [se, sn] = normals(n, 8);
    let weight = vec![1.0; n];
    let mut out = vec![0.0; n];
    let belief =
        RangeBelief { mean_m: [200.0, 300.0], covariance_m2: [4.0, 1.0, 9.0], range_m: 350.0, sigma_m: 1.0 };
    let mut group = c.benchmark_group("range_gaussian");
    group.throughput(Throughput::Elements(n as u64));
    group.bench_function(BenchmarkId::from_parameter(n), |b| {
        b.iter(|| {
            out.fill(0.0);
            add_range_gaussian(black_box(&belief), 0.05, &e, &n_, &mut out);
        });
    });
    group.finish();
    let mut group = c.benchmark_group("range_eq17");
    group.throughput(Throughput::Elements((n * n) as u64));
    group.bench_function(BenchmarkId::from_parameter("600x600"), |b| {
        b.iter(|| range_eq17(black_box(350.0), &se, &sn, &weight, &e, &n_, &mut out));
    });
    group.finish();
}

/// One second of a mission: depth, sounding, command, and the estimate that a record takes.
fn step(navigator: &mut dyn Navigator, lap: &mut Lap) -> Result<f64, Error> {
    let mut t_ns = 0;
    for event in &lap.next_events() {
        navigator.handle(event)?;
        t_ns = event.t_ns;
    }
    Ok(navigator.estimate(t_ns).mean_m[0])
}

fn whole_step(c: &mut Criterion, name: &str, chart: &Arc<Chart>, n: usize, navigator: &mut dyn Navigator) {
    let mut lap = Lap::new(chart.clone());
    let mut run = || {
        let started = navigator.handle(&lap.fix());
        started.and_then(|_| (0..SETTLE).try_for_each(|_| step(navigator, &mut lap).map(|_| ())))
    };
    if let Err(error) = run() {
        eprintln!("{name}/{n} was not timed: {error}");
        return;
    }
    let mut group = c.benchmark_group(name);
    group.throughput(Throughput::Elements(n as u64));
    group.bench_function(BenchmarkId::from_parameter(n), |b| b.iter(|| step(navigator, &mut lap)));
    group.finish();
}

fn steps(c: &mut Criterion, chart: &Arc<Chart>) -> Result<(), Error> {
    for n in [600, 10_000, 100_000] {
        let mut navigator = Dmpf::new(0, 3, dmpf_options(n), Some(chart.clone()), 1500.0, 1)?;
        whole_step(c, "dmpf_step", chart, n, &mut navigator);
    }
    let mut navigator = Mpf::<2>::new(0, 3, mpf_options(600), Some(chart.clone()), 1500.0, 1)?;
    whole_step(c, "mpf_step", chart, 600, &mut navigator);
    Ok(())
}

fn all(c: &mut Criterion) {
    match chart() {
        Ok(chart) => {
            lookups(c, &chart);
            particles(c);
            ranges(c);
            if let Err(error) = steps(c, &chart) {
                eprintln!("steps were not timed: {error}");
            }
        }
        Err(error) => eprintln!("no chart, so nothing was timed: {error}"),
    }
}

criterion_group!(benches, all);
criterion_main!(benches);
