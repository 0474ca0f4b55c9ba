//! A mission of 24 hours: what a navigator holds in memory does not grow, and its belief stays one.
#![allow(unsafe_code, reason = "a global allocator cannot be written without")]
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests fail by panicking")]

mod hostile;
mod registry;
#[allow(clippy::duplicate_mod, reason = "one small sea for several test binaries")]
mod seafloor;
mod world;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use hostile::sound;
use registry::{CAPACITY, Entry, registry};
use uwcoop_core::event::{Event, Payload, VehicleId};
use uwcoop_core::navigator::{Navigator, Outcome};
use world::{SECOND, distance, event, reception, rich_depth};

thread_local! {
    /// Bytes that this thread holds.
    static HELD: Cell<i64> = const { Cell::new(0) };
}

struct Counting;

// SAFETY: everything is handed on to the system's allocator; the counter is a plain cell without destructor.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        HELD.with(|held| held.set(held.get() + layout.size() as i64));
        // SAFETY: the caller's promise, handed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        HELD.with(|held| held.set(held.get() - layout.size() as i64));
        // SAFETY: the caller's promise, handed on.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// From event to event, s.
const STEP_S: i64 = 10;
/// From launch to launch, s: the vehicles take turns.
const SLOT_S: i64 = 60;

/// Where a vehicle is: vehicle 0 stands, the other goes round.
fn place(vehicle: VehicleId, t_ns: i64) -> [f64; 2] {
    let t = t_ns as f64 / SECOND as f64;
    let turn = 0.005 * t;
    if vehicle == 0 { [200.0, 200.0] } else { [200.0 + 100.0 * turn.cos(), 200.0 + 100.0 * turn.sin()] }
}

fn sensed(vehicle: VehicleId, t_ns: i64) -> Vec<Event> {
    let here = place(vehicle, t_ns);
    let (turn, moves) = (0.005 * t_ns as f64 / SECOND as f64, vehicle == 1);
    let (speed, yaw_rad) = if moves { (0.5, (-turn.sin()).atan2(-turn.cos())) } else { (0.0, 0.0) };
    let yaw_rad = if moves { turn.cos().atan2(-turn.sin()) } else { yaw_rad };
    let mut payloads = vec![
        Payload::Depth { depth_m: 3.0, sigma_m: 0.05 },
        Payload::Heading { yaw_rad, sigma_rad: 0.03 },
        Payload::TurnRate { yaw_rate_radps: if moves { 0.005 } else { 0.0 }, sigma_radps: 1e-3 },
        Payload::Motion { velocity_mps: [speed * yaw_rad.cos(), speed * yaw_rad.sin()] },
        Payload::WaterDepth { water_depth_m: rich_depth(here[0], here[1]), sigma_m: 0.05 },
    ];
    if moves {
        payloads.push(Payload::GroundVelocity { velocity_mps: [speed, 0.0], sigma_mps: 0.05 });
    }
    let second = t_ns / SECOND;
    if second == 0 || (vehicle == 0 && second % 600 == 0) {
        payloads.insert(0, Payload::Fix { position_m: here, covariance_m2: [1.0, 0.0, 1.0] });
    }
    if second == 0 {
        payloads.push(Payload::RoleTaken { landmark: vehicle == 0 });
        if vehicle == 0 {
            payloads.push(Payload::Landed);
        }
    }
    if moves && second % 120 == 110 {
        let (de, dn) = (200.0 - here[0], 200.0 - here[1]);
        payloads.push(Payload::AcousticFix {
            peer: 0,
            peer_depth_m: None,
            transmit_ns: t_ns - SECOND / 10,
            range_m: Some(de.hypot(dn)),
            own_bearing_rad: Some(dn.atan2(de) - yaw_rad),
            peer_bearing_rad: Some((-dn).atan2(-de)),
        });
    }
    payloads.into_iter().map(|payload| event(t_ns, vehicle, payload)).collect()
}

/// One step of both vehicles; how many packets were used.
fn step(pair: &mut [Box<dyn Navigator>; 2], second: i64) -> usize {
    let t_ns = second * SECOND;
    for vehicle in 0..2u16 {
        for happened in sensed(vehicle, t_ns) {
            pair[usize::from(vehicle)].handle(&happened).unwrap();
        }
    }
    if second % SLOT_S != SLOT_S / 2 {
        return 0;
    }
    let sender = (second / SLOT_S % 2) as VehicleId;
    let tol_ns = t_ns + SECOND / 10;
    let Ok(Some(bytes)) = pair[usize::from(sender)].transmit(tol_ns, CAPACITY) else { return 0 };
    let range_m = distance(place(0, tol_ns), place(1, tol_ns));
    let heard = reception(tol_ns + SECOND / 2, 1 - sender, sender, tol_ns, range_m, &bytes);
    let outcome = pair[usize::from(1 - sender)].handle(&heard).unwrap();
    if pair[usize::from(sender)].profile().needs_delivery_oracle {
        let delivered = Payload::Delivered { tol_ns, to: 1 - sender };
        pair[usize::from(sender)].handle(&event(tol_ns + SECOND / 2, sender, delivered)).unwrap();
    }
    usize::from(outcome == Outcome::Fused)
}

/// Bytes held after `from_s` and at the end, and the packets used.
fn fly(entry: &Entry, from_s: i64, end_s: i64) -> (i64, i64, usize) {
    let start = HELD.with(Cell::get);
    let mut pair = [entry.make(0), entry.make(1)];
    let (mut early, mut used) = (0, 0);
    for second in (0..=end_s).step_by(STEP_S as usize) {
        used += step(&mut pair, second);
        if second <= from_s {
            early = early.max(HELD.with(Cell::get) - start);
        }
        if second % 3600 == 0 {
            for navigator in &pair {
                let e = navigator.estimate(second * SECOND);
                assert!(sound(&e), "{} at {second} s: {e:?}", entry.name);
            }
        }
    }
    (early, HELD.with(Cell::get) - start, used)
}

#[test]
fn memory_is_flat_over_a_day() {
    let (from_s, end_s) = (2 * 3600, 24 * 3600);
    let mut used = 0;
    for entry in registry() {
        let (early, late, packets) = fly(&entry, from_s, end_s);
        eprintln!("{}: {early} bytes in {from_s} s, {late} at {end_s} s, {packets} packets used", entry.name);
        assert!(late <= early + early / 20 + 4096, "{} grew from {early} to {late} bytes", entry.name);
        used += packets;
    }
    assert!(used > 1000, "packets are exchanged");
}
