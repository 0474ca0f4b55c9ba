//! Three vehicles of kind `team` that talk in turns, for tests.

use std::sync::Arc;

use uwcoop_core::chart::Chart;
use uwcoop_core::event::Event;
use uwcoop_core::navigator::clock::ClockOptions;
use uwcoop_core::navigator::team::{Team, TeamOptions};
use uwcoop_core::navigator::{Navigator, Outcome};

use super::*;

pub const SLOT_S: i64 = 3;
pub const CAPACITY: usize = 4096;

/// `team` as packaged for a perfect chart.
pub fn team_options(vehicles: usize, particles: usize) -> TeamOptions {
    TeamOptions {
        terrain: mpf_options(particles).terrain,
        drifts: vec![drift(); vehicles],
        use_ranges: true,
        sigma_range_m: 1.0,
        range_gate_sigmas: 6.0,
        clock: ClockOptions::default(),
        referee_nat: 10.0,
        frame_bytes: 32,
        tag_bytes: 4,
        packet_f64: false,
        packet_spacing_m: 0.0,
        group_size: 4,
        least_ess_share: 0.02,
        current_difference: 1.0,
        offset_difference_m: f64::INFINITY,
        fill_reach_m: 60.0,
    }
}

pub fn team_of(own: u16, options: TeamOptions, chart: Option<Arc<Chart>>) -> Team<2> {
    Team::new(own, options.drifts.len(), options, chart, SOUND_SPEED_MPS, 5).unwrap()
}

/// Where vehicle `v` is.
pub fn track(v: u16, t: f64) -> [f64; 2] {
    let phase = 2.1 * f64::from(v);
    [200.0 + 110.0 * (0.008 * t + phase).cos(), 200.0 + 110.0 * (0.008 * t + phase).sin()]
}

/// One thing that the fleet does: an event, or a launch.
#[derive(Clone)]
pub enum Act {
    Event(Event),
    Launch { vehicle: u16, tol_ns: i64 },
}

/// Everything that happens to the navigators in `seconds`, but for what they say.
pub fn acts(vehicles: u16, seconds: i64) -> Vec<Act> {
    acts_over(vehicles, seconds, rich_depth)
}

/// The same over another seabed.
pub fn acts_over(vehicles: u16, seconds: i64, depth: fn(f64, f64) -> f64) -> Vec<Act> {
    let mut all = Vec::new();
    for v in 0..vehicles {
        all.push(Act::Event(fix(0, v, track(v, 0.0), 4.0)));
    }
    let errors: Vec<Vec<f64>> = (0..vehicles)
        .map(|v| world_noise(3, v, seconds as usize + 1).iter().map(|x| 0.05 * x).collect())
        .collect();
    for second in 0..=seconds {
        for v in 0..vehicles {
            let mut vehicle = Vehicle::new(v, |t| track(v, t));
            vehicle.sounding_errors_m = errors[usize::from(v)].clone();
            all.extend(vehicle.second(second, depth).into_iter().map(Act::Event));
        }
        if second % SLOT_S == 0 && second > 0 {
            let vehicle = (second / SLOT_S % i64::from(vehicles)) as u16;
            all.push(Act::Launch { vehicle, tol_ns: second * SECOND });
        }
    }
    all
}

/// Receptions of a packet half a second after its arrival.
pub fn receptions(sender: u16, vehicles: u16, tol_ns: i64, bytes: &Arc<[u8]>) -> Vec<Event> {
    let at = |v: u16, t_ns: i64| track(v, t_ns as f64 / SECOND as f64);
    (0..vehicles)
        .filter(|r| *r != sender)
        .map(|r| {
            let range_m = distance(at(sender, tol_ns), at(r, tol_ns));
            reception(tol_ns + SECOND / 2 + SECOND / 4, r, sender, tol_ns, range_m, bytes)
        })
        .collect()
}

/// Plays acts; `hears(sender, receiver, tol)` says who hears whom. Returns outcomes of receptions.
pub fn play(
    fleet: &mut [Box<dyn Navigator>],
    acts: &[Act],
    mut hears: impl FnMut(u16, u16, i64) -> bool,
) -> Vec<Outcome> {
    let vehicles = fleet.len() as u16;
    let mut outcomes = Vec::new();
    for act in acts {
        match act {
            Act::Event(event) => {
                fleet[usize::from(event.vehicle)].handle(event).unwrap();
            }
            Act::Launch { vehicle, tol_ns } => {
                let Some(bytes) = fleet[usize::from(*vehicle)].transmit(*tol_ns, CAPACITY).unwrap() else {
                    continue;
                };
                for event in receptions(*vehicle, vehicles, *tol_ns, &bytes) {
                    if hears(*vehicle, event.vehicle, *tol_ns) {
                        outcomes.push(fleet[usize::from(event.vehicle)].handle(&event).unwrap());
                    }
                }
            }
        }
    }
    outcomes
}
