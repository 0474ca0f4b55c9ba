//! The core on a vehicle's computer: sensor events in, packets out, an estimate with its covariance.

use std::sync::Arc;

use uwcoop_core::chart::{Chart, SigmaMap};
use uwcoop_core::error::Error;
use uwcoop_core::event::{Event, Payload};
use uwcoop_core::navigator::Estimate;
use uwcoop_core::navigator::packaged::{Options, make_navigator};
use uwcoop_core::navigator::settings::Context;

const SECOND_NS: i64 = 1_000_000_000;

/// The seabed of this example; on a vehicle, the chart is read from a file.
fn water_depth_m(east_m: f64, north_m: f64) -> f64 {
    20.0 + 3.0 * (east_m / 31.0).sin() + 2.0 * (north_m / 23.0).cos()
}

/// Four minutes at 1.5 m/s to the east, in a current of 0.2 m/s to the north that the vehicle does not measure.
pub fn dive() -> Result<(Estimate, usize), Error> {
    let depths = (0..120 * 120)
        .map(|node| water_depth_m(f64::from(node % 120) * 5.0, f64::from(node / 120) * 5.0) as f32);
    let chart = Chart::new(depths.collect(), 120, 120, 0.0, 0.0, 5.0, SigmaMap::Uniform(0.1), 10.0)?;
    let context = Context { vehicle: 0, vehicles: 2, sound_speed_mps: 1500.0, seed: 1, ranging: &[] };
    let mut navigator = make_navigator("team", &context, &Options::new(), Some(Arc::new(chart)))?;
    let mut sent_bytes = 0;
    let event = |t_s: i64, payload: Payload| Event { t_ns: t_s * SECOND_NS, vehicle: 0, payload };
    navigator
        .handle(&event(0, Payload::Fix { position_m: [50.0, 300.0], covariance_m2: [9.0, 0.0, 9.0] }))?;
    for t_s in 0..240 {
        let [east_m, north_m] = [50.0 + 1.5 * t_s as f64, 300.0 + 0.2 * t_s as f64];
        navigator.handle(&event(t_s, Payload::Motion { velocity_mps: [1.5, 0.0] }))?;
        let sounding = Payload::WaterDepth { water_depth_m: water_depth_m(east_m, north_m), sigma_m: 0.1 };
        navigator.handle(&event(t_s, sounding))?;
        if t_s % 10 == 5
            && let Some(packet) = navigator.transmit(t_s * SECOND_NS, 32)?
        {
            sent_bytes += packet.len(); // here the packet goes to the modem
        }
    }
    Ok((navigator.estimate(240 * SECOND_NS), sent_bytes))
}

fn main() -> Result<(), Error> {
    let (Estimate { mean_m: [east_m, north_m], covariance_m2: [ee, _, nn], .. }, sent_bytes) = dive()?;
    println!(
        "east {east_m:.1} m (sigma {:.1} m), north {north_m:.1} m (sigma {:.1} m)",
        ee.sqrt(),
        nn.sqrt()
    );
    println!("true position: 410.0 m, 348.0 m; {sent_bytes} bytes sent");
    Ok(())
}
