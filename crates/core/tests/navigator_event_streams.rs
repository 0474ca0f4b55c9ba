//! Any stream of events: never a panic, never an estimate that is not finite once started.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests fail by panicking")]

mod world;

use std::sync::LazyLock;

use proptest::prelude::*;
use uwcoop_core::event::{Event, Payload};
use uwcoop_core::navigator::{Navigator, Status};
use world::*;

static CHART: LazyLock<std::sync::Arc<uwcoop_core::chart::Chart>> =
    LazyLock::new(|| chart_of(|e, n| if (200.0..210.0).contains(&e) { f64::NAN } else { rich_depth(e, n) }));

/// A number of the order of `scale`, or one that no sensor says.
fn number(scale: f64) -> impl Strategy<Value = f64> {
    prop_oneof![
        12 => -scale..scale,
        4 => 0.0..scale,
        1 => Just(0.0),
        1 => prop_oneof![Just(f64::NAN), Just(f64::INFINITY), Just(f64::NEG_INFINITY)],
        1 => prop_oneof![Just(1e-300), Just(-1e-300), Just(1e6), Just(-1e6)],
    ]
}

/// How a packet is spoilt: position, byte, what to xor it with.
type Damage = Option<(usize, u8)>;

#[derive(Debug, Clone)]
enum Happening {
    Sensor(Payload),
    Packet { sender: u16, age_ms: i64, range_m: f64, from: [f64; 2], sequence: u8, damage: Damage },
    Transmit { capacity: usize },
}

fn payload() -> impl Strategy<Value = Payload> {
    let pair = |s: f64| (number(s), number(s)).prop_map(|(a, b)| [a, b]);
    prop_oneof![
        4 => pair(3.0).prop_map(|velocity_mps| Payload::Motion { velocity_mps }),
        6 => (number(40.0), number(0.3))
            .prop_map(|(water_depth_m, sigma_m)| Payload::WaterDepth { water_depth_m, sigma_m }),
        2 => (number(30.0), number(0.3)).prop_map(|(depth_m, sigma_m)| Payload::Depth { depth_m, sigma_m }),
        2 => (pair(500.0), number(30.0), number(30.0), -1.0..1.0f64).prop_map(|(position_m, ee, nn, rho)| {
            Payload::Fix { position_m, covariance_m2: [ee, rho * (ee.abs() * nn.abs()).sqrt(), nn] }
        }),
        1 => (number(3.0), number(0.3)).prop_map(|(yaw_rad, sigma_rad)| Payload::Heading { yaw_rad, sigma_rad }),
        1 => Just(Payload::Landed),
        1 => (any::<i64>(), 0..4u16).prop_map(|(tol_ns, to)| Payload::Delivered { tol_ns, to }),
    ]
}

fn step() -> impl Strategy<Value = Happening> {
    let damage = prop_oneof![2 => Just(None), 1 => (0..15usize, 1..=255u8).prop_map(Some)];
    prop_oneof![
        6 => payload().prop_map(Happening::Sensor),
        3 => (0..4u16, -500..4000i64, 0.0..600.0f64, [0.0..400.0f64, 0.0..400.0], any::<u8>(), damage).prop_map(
            |(sender, age_ms, range_m, from, sequence, damage)| {
                Happening::Packet { sender, age_ms, range_m, from, sequence, damage }
            }
        ),
        1 => (0..64usize).prop_map(|capacity| Happening::Transmit { capacity }),
    ]
}

/// Time to the step before, ms: mostly ahead, sometimes none, sometimes back, sometimes an hour.
fn gap_ms() -> impl Strategy<Value = i64> {
    prop_oneof![10 => 0..3000i64, 3 => Just(0), 1 => -2000..0i64, 1 => Just(3_600_000)]
}

fn apply(navigator: &mut dyn Navigator, t_ns: i64, step: &Happening) {
    let event: Event = match step {
        Happening::Sensor(payload) => event(t_ns, 1, payload.clone()),
        Happening::Packet { sender, age_ms, range_m, from, sequence, damage } => {
            let tol_ns = t_ns - age_ms * 1_000_000;
            let mut bytes = packet(*sender, tol_ns, *sequence, *from, 3.0).to_vec();
            if let Some((at, mask)) = damage {
                bytes[*at] ^= mask;
            }
            reception(t_ns, 1, *sender, tol_ns, *range_m, &bytes.into())
        }
        Happening::Transmit { capacity } => {
            let _ = navigator.transmit(t_ns, *capacity);
            return;
        }
    };
    let before = navigator.snapshot().unwrap();
    if navigator.handle(&event).is_err() {
        assert_eq!(navigator.snapshot().unwrap(), before, "refused, and changed");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 150, ..ProptestConfig::default() })]

    #[test]
    fn any_stream_keeps_the_estimate_finite(
        steps in prop::collection::vec((gap_ms(), step()), 1..60),
        particles in 10..80usize,
    ) {
        let mut all: Vec<(&str, Box<dyn Navigator>)> = navigators(1, 3, &CHART);
        all.push(("dmpf of few", Box::new(dmpf(1, 3, dmpf_options(particles), &CHART, 1))));
        all.push(("mpf of few", Box::new(mpf::<4>(1, 3, mpf_options(particles), &CHART, 1))));
        for (name, navigator) in &mut all {
            let mut t_ns = 0;
            for (gap_ms, step) in &steps {
                t_ns += gap_ms * 1_000_000;
                apply(navigator.as_mut(), t_ns, step);
                let estimate = navigator.estimate(t_ns);
                if estimate.status == Status::NotStarted {
                    continue;
                }
                let [ee, en, nn] = estimate.covariance_m2;
                prop_assert!(estimate.mean_m.iter().all(|x| x.is_finite()), "{} {:?}", name, estimate);
                prop_assert!([ee, en, nn].iter().all(|x| x.is_finite()), "{} {:?}", name, estimate);
                prop_assert!(ee >= 0.0 && nn >= 0.0, "{} {:?}", name, estimate);
                if let Some(ess) = estimate.ess {
                    let n = navigator.particles().unwrap().weights.len() as f64;
                    prop_assert!(ess >= 1.0 - 1e-9 && ess <= n * (1.0 + 1e-9), "{} {:?}", name, estimate);
                }
            }
        }
    }

    #[test]
    fn times_and_numbers_at_the_end_of_their_range_do_not_panic(
        times in prop::collection::vec(
            prop_oneof![Just(i64::MIN), Just(-1i64), Just(0i64), Just(SECOND), Just(i64::MAX), any::<i64>()], 1..8
        ),
        tol_ns in prop_oneof![Just(i64::MIN), Just(i64::MAX), Just(0i64), any::<i64>()],
        toa_ns in prop_oneof![Just(i64::MIN), Just(i64::MAX), Just(0i64), any::<i64>()],
        huge in prop_oneof![Just(1e300f64), Just(f64::MAX), Just(-1e200f64)],
    ) {
        for (_, navigator) in &mut navigators(1, 3, &CHART) {
            let bytes: std::sync::Arc<[u8]> = [0u8; 15].into();
            for t_ns in &times {
                let payloads = [
                    Payload::Fix { position_m: [huge, 1.0], covariance_m2: [1.0, 0.0, 1.0] },
                    Payload::Motion { velocity_mps: [1.0, huge] },
                    Payload::WaterDepth { water_depth_m: huge.abs(), sigma_m: 0.1 },
                    Payload::Depth { depth_m: huge, sigma_m: 0.1 },
                    Payload::Reception { sender: 0, tol_ns, toa_ns, bytes: bytes.clone() },
                ];
                for payload in payloads {
                    let _ = navigator.handle(&event(*t_ns, 1, payload));
                    let _ = navigator.estimate(*t_ns);
                    let _ = navigator.transmit(*t_ns, 100);
                }
            }
        }
    }
}
