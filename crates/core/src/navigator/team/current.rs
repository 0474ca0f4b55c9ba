//! The water current as vehicles share it: what a particle's own drift says of a teammate's.

use serde::{Deserialize, Serialize};

use crate::event::VehicleId;

/// The way that the current took each particle, and where that stood at each teammate's last packet.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct CommonCurrent {
    /// Since the start, [east, north], m.
    way: [Vec<f64>; 2],
    elapsed_s: f64,
    at: Vec<Option<([Vec<f64>; 2], f64)>>,
}

impl CommonCurrent {
    /// Nothing yet.
    #[must_use]
    pub fn new(particles: usize, vehicles: usize) -> Self {
        Self { way: std::array::from_fn(|_| vec![0.0; particles]), elapsed_s: 0.0, at: vec![None; vehicles] }
    }

    /// Time passes; the first two linear states are the current.
    pub fn advance(&mut self, linear: &[Vec<f64>], dt_s: f64) {
        for (way, current) in self.way.iter_mut().zip(linear) {
            way.iter_mut().zip(current).for_each(|(w, c)| *w += dt_s * c);
        }
        self.elapsed_s += dt_s;
    }

    /// All columns follow their particle.
    pub fn gather(&mut self, ancestors: &[u32], column: &mut Vec<f64>) {
        let kept = self.at.iter_mut().flatten().flat_map(|(way, _)| way);
        for way in self.way.iter_mut().chain(kept) {
            for (new, a) in column.iter_mut().zip(ancestors) {
                *new = way[*a as usize];
            }
            std::mem::swap(way, column);
        }
    }

    /// Mean current of each particle since the last packet of `vehicle`, up to `ago_s` before now; that instant is kept
    /// for its next packet.
    pub fn since(&mut self, vehicle: VehicleId, linear: &[Vec<f64>], ago_s: f64, mean: &mut [Vec<f64>; 2]) {
        let particles = self.way[0].len();
        let Some(slot) = self.at.get_mut(usize::from(vehicle)) else { return };
        let then_s = self.elapsed_s - ago_s;
        let (kept, kept_s) = slot.get_or_insert_with(|| (std::array::from_fn(|_| vec![0.0; particles]), 0.0));
        let span_s = then_s - *kept_s;
        for axis in 0..2 {
            mean[axis].resize(particles, 0.0);
            let columns = self.way[axis].iter().zip(&linear[axis]).zip(&mut kept[axis]);
            for ((out, _), ((way, current), kept)) in mean[axis].iter_mut().zip(0..particles).zip(columns) {
                let then = way - ago_s * current;
                *out = if span_s > 0.5 { (then - *kept) / span_s } else { *current };
                *kept = then;
            }
        }
        *kept_s = then_s;
    }
}
