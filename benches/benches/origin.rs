//! Pose graphs: what a client spends on one packet, and one pose marginalised out. CPU time of one thread.

use std::hint::black_box;
use std::sync::Arc;

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use nalgebra::{SMatrix, SVector};
use uwcoop_core::event::{Event, Payload};
use uwcoop_core::information::Information;
use uwcoop_core::information::replica::Methods;
use uwcoop_core::navigator::Navigator;
use uwcoop_core::navigator::origin::lasting::LastingOptions;
use uwcoop_core::navigator::origin::local_options::LocalOptions;
use uwcoop_core::navigator::origin::mdeif::{Mdeif, MdeifOptions};
use uwcoop_core::packet::graph::GraphForm;

const SECOND: i64 = 1_000_000_000;

fn mdeif(own: u16, form: GraphForm) -> Option<Mdeif> {
    let local = LocalOptions {
        process_noise_m2_per_s3: 1e-4,
        process_noise_dvl_m2_per_s3: 1e-2,
        sigma_velocity0_mps: 1.0,
        sigma_range_m: 1.0,
        gate_sigmas: 6.0,
        ..LocalOptions::default()
    };
    let methods = Methods { joint: true, lags: 2, equation_6: true, loss_max: 1e-4 };
    let options = MdeifOptions { local, form, exact_lags: 2, methods, lasting: LastingOptions::NONE };
    Mdeif::new(own, &[false, true], options, 1500.0).ok()
}

fn fix(t_ns: i64, vehicle: u16, east_m: f64) -> Event {
    let payload = Payload::Fix { position_m: [east_m, 0.0], covariance_m2: [9.0, 0.0, 9.0] };
    Event { t_ns, vehicle, payload }
}

fn reception(tol_ns: i64, bytes: &Arc<[u8]>) -> Event {
    let toa_ns = tol_ns + SECOND / 5;
    let payload = Payload::Reception { sender: 0, tol_ns, toa_ns, bytes: bytes.clone() };
    Event { t_ns: toa_ns, vehicle: 1, payload }
}

/// A client that has heard some packets, as a snapshot, and the next packet.
fn client(form: GraphForm) -> Option<(Vec<u8>, Event)> {
    let (mut ship, mut auv) = (mdeif(0, form)?, mdeif(1, form)?);
    auv.handle(&fix(0, 1, 0.0)).ok()?;
    let mut last = None;
    for t in 0..120 {
        ship.handle(&fix(t * SECOND, 0, 300.0 + (t % 5) as f64)).ok()?;
        if t % 15 == 14 {
            let bytes = ship.transmit(t * SECOND, usize::MAX).ok()??;
            let event = reception(t * SECOND, &bytes);
            if t < 110 {
                auv.handle(&event).ok()?;
            }
            last = Some(event);
        }
    }
    Some((auv.snapshot().ok()?, last?))
}

fn packets(c: &mut Criterion) {
    let mut group = c.benchmark_group("client_update");
    let forms = [
        ("f64", GraphForm::F64),
        ("32", GraphForm::Frame32),
        ("64", GraphForm::Frame64),
        ("256", GraphForm::Frame256),
    ];
    for (name, form) in forms {
        let Some((snapshot, event)) = client(form) else { continue };
        let fresh = || {
            let mut auv = mdeif(1, form);
            if let Some(auv) = &mut auv {
                let _ = auv.restore(&snapshot);
            }
            auv
        };
        // A bench of rejections would be fast and worthless.
        assert_eq!(
            fresh().and_then(|mut auv| auv.handle(&event).ok()),
            Some(uwcoop_core::navigator::Outcome::Fused)
        );
        group.bench_function(name, |b| {
            b.iter_batched(
                fresh,
                |mut auv| {
                    let outcome = auv.as_mut().map(|auv| auv.handle(black_box(&event)));
                    (outcome, auv)
                },
                BatchSize::SmallInput,
            );
        });
    }
    group.finish();
}

fn schur(c: &mut Criterion) {
    let matrix = SMatrix::<f64, 8, 8>::from_fn(|r, k| if r == k { 9.0 } else { 1.0 / (1 + r + k) as f64 });
    let joint = Information { matrix, vector: SVector::<f64, 8>::repeat(1.0) };
    c.bench_function("schur_one_pose", |b| b.iter(|| black_box(&joint).marginal()));
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(60);
    targets = packets, schur
}
criterion_main!(benches);
