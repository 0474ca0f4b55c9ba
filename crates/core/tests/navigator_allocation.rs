//! In steady state the particle navigators allocate nothing: a counting allocator is the witness.
#![allow(unsafe_code, reason = "a global allocator cannot be written without")]
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests fail by panicking")]

mod world;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::sync::Arc;

use uwcoop_core::chart::Chart;
use uwcoop_core::event::Event;
use uwcoop_core::navigator::{Navigator, Outcome};
use world::*;

thread_local! {
    /// Allocations of this thread; the harness' other threads are none of ours.
    static COUNT: Cell<u64> = const { Cell::new(0) };
}

struct Counting;

// SAFETY: everything is handed on to the system's allocator; the counter is a plain cell without destructor.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        COUNT.with(|c| c.set(c.get() + 1));
        // SAFETY: the caller's promise, handed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the caller's promise, handed on.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        COUNT.with(|c| c.set(c.get() + 1));
        // SAFETY: the caller's promise, handed on.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

fn allocations(work: impl FnOnce()) -> u64 {
    let before = COUNT.with(Cell::get);
    work();
    COUNT.with(Cell::get) - before
}

#[test]
fn the_counter_counts() {
    assert_eq!(allocations(|| drop(std::hint::black_box(Box::new(1)))), 1);
    assert_eq!(allocations(|| ()), 0);
}

/// Seconds that a navigator has to find its memory.
const WARM_UP: i64 = 20;

/// Seconds 0 to 120 of a vehicle that crosses a hole, leaves the chart and comes back, with a reception every 2 s.
fn mission() -> Vec<Event> {
    let vehicle = Vehicle::new(0, |t| {
        let east = if t < 60.0 { 320.0 + 1.5 * t } else { 410.0 - 1.5 * (t - 60.0) };
        [east, 100.0 + 0.8 * t]
    });
    let mut events = vec![fix(0, 0, vehicle.position_m(0), 25.0)];
    for second in 0..=120 {
        events.extend(vehicle.second(second, rich_depth));
        if second % 2 == 1 {
            let (t_ns, tol_ns) = (second * SECOND, (second - 1) * SECOND);
            let from = [vehicle.position_m(tol_ns)[0] - 100.0, 80.0];
            let bytes = packet(1, tol_ns, (second / 2) as u8, from, 3.0);
            let range_m = distance(from, vehicle.position_m(tol_ns));
            events.push(reception(t_ns, 0, 1, tol_ns, range_m, &bytes));
        }
        if second % 10 == 9 {
            events.push(fix(second * SECOND, 0, vehicle.position_m(second * SECOND), 100.0));
        }
    }
    events
}

fn holed() -> Arc<Chart> {
    chart_of(|e, n| if (340.0..350.0).contains(&e) { f64::NAN } else { rich_depth(e, n) })
}

#[test]
fn a_steady_state_step_allocates_nothing() {
    let (chart, events) = (holed(), mission());
    let mut eq17 = mpf_options(200);
    eq17.range = range(EQ17, f64::INFINITY);
    let mut gaussian = dmpf_options(200);
    gaussian.range = range(GAUSSIAN, 6.0);
    let navigators: Vec<(&str, Box<dyn Navigator>)> = vec![
        ("dmpf, eq 17", Box::new(dmpf(0, 2, dmpf_options(200), &chart, 5))),
        ("dmpf, gaussian", Box::new(dmpf(0, 2, gaussian, &chart, 5))),
        ("mpf<2>, gaussian", Box::new(mpf::<2>(0, 2, mpf_options(200), &chart, 5))),
        ("mpf<2>, eq 17", Box::new(mpf::<2>(0, 2, eq17, &chart, 5))),
        ("mpf<4>, gaussian", Box::new(mpf::<4>(0, 2, mpf_options(200), &chart, 5))),
    ];
    for (name, mut navigator) in navigators {
        let (mut gated, mut fused) = (0, 0);
        for event in &events {
            let mut outcome = Outcome::Noted;
            let count = allocations(|| outcome = navigator.handle(event).unwrap());
            if event.t_ns > WARM_UP * SECOND {
                assert_eq!(count, 0, "{name}: {outcome:?} {event:?}");
            }
            gated += u32::from(outcome == Outcome::Gated);
            fused += u32::from(outcome == Outcome::Fused);
            let t_ns = event.t_ns + SECOND / 2;
            assert_eq!(
                allocations(|| _ = std::hint::black_box(navigator.estimate(t_ns))),
                0,
                "{name}: estimate"
            );
        }
        assert!(gated > 5 && fused > 250, "{name}: the mission has both, {gated} gated and {fused} fused");
    }
}

#[test]
fn a_team_in_steady_state_allocates_nothing_but_its_packets() {
    use fleet::*;

    let chart = holed();
    let mut options = team_options(3, 200);
    options.current_difference = 0.3;
    let mut team: Vec<_> = (0..3).map(|v| team_of(v, options.clone(), Some(chart.clone()))).collect();
    let mut heard = 0;
    for act in acts(3, 120) {
        match act {
            Act::Event(event) => {
                let navigator = &mut team[usize::from(event.vehicle)];
                let count = allocations(|| _ = navigator.handle(&event).unwrap());
                assert!(count == 0 || event.t_ns <= WARM_UP * SECOND, "{event:?}");
            }
            Act::Launch { vehicle, tol_ns } => {
                let bytes = team[usize::from(vehicle)].transmit(tol_ns, CAPACITY).unwrap().unwrap();
                for event in receptions(vehicle, 3, tol_ns, &bytes) {
                    let navigator = &mut team[usize::from(event.vehicle)];
                    let mut outcome = Outcome::Noted;
                    let count = allocations(|| outcome = navigator.handle(&event).unwrap());
                    assert!(count == 0 || event.t_ns <= 2 * WARM_UP * SECOND, "{outcome:?} {event:?}");
                    heard += u32::from(outcome == Outcome::Fused && event.t_ns > 2 * WARM_UP * SECOND);
                }
            }
        }
    }
    assert!(heard > 30, "{heard} packets in steady state");
}
