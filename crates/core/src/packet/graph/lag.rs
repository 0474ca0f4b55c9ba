//! Exact lags in few bits: the relation between a rounded packet's node and an earlier one.
//!
//! All values are in the scales of the two nodes as they were sent, L₂ and L₃: A, the smoothed covariance of the
//! earlier node; the shift of its mean; K = L₃⁻¹ Φ L₂ chol(A); and, where there is room, the step's noise N = L₃⁻¹ W
//! L₃⁻ᵀ, which otherwise is I − K Kᵀ. The decoded covariance never understates the exact one: with the earlier
//! covariance increased by [`SLACK`], the decoded joint covariance of both nodes minus the exact one, errors of the
//! rounded means included, is positive definite. With N that is reached by raising N, without it by a search over the
//! neighbouring codes of A and K.

use nalgebra::SMatrix;

use crate::information::graph_packet::RoundedLag;
use crate::information::{Gaussian, GraphStep, NodeMatrix, NodeVector, symmetrized};
use crate::packet::covering::{
    Scale, Shape, check_isotropic, entries_of, entry_codes, push_signed, read_entries, root_of,
};
use crate::packet::field::FixedField;
use crate::packet::{BitReader, BitWriter, PacketError};

/// Share by which the earlier node's covariance may be increased for the bound to hold. Without it no noise bounds
/// the rounding of Φ of a vehicle without smoothing information.
pub const SLACK: f64 = 0.004;
/// How many codes A's sigmas are raised, each, in search of a cover.
const RAISES: u32 = 2;

/// Widths of one lag.
pub(super) struct LagWidths {
    pub(super) shape: &'static Shape,
    pub(super) smoothed: Scale,
    pub(super) shift: FixedField,
    pub(super) transition: u32,
    /// Entries of K stay within it.
    pub(super) largest: f64,
    pub(super) noise: Option<Scale>,
}

/// The exact step in the scales of its nodes, and the errors of the means as they are sent.
struct Exact {
    smoothed: NodeMatrix,
    transition: NodeMatrix,
    noise: NodeMatrix,
    earlier_off: NodeVector,
    later_off: NodeVector,
}

/// The later node as it is sent.
pub(super) struct Later<'a> {
    /// L₃⁻¹.
    pub(super) back: &'a NodeMatrix,
    /// L₃⁻¹ times the difference between its mean and the mean that is sent.
    pub(super) off: NodeVector,
}

impl LagWidths {
    /// How far an earlier mean may have moved, in its own sigmas.
    fn most_shift(&self) -> f64 {
        self.shift.decode((1 << (self.shift.bits - 1)) - 1)
    }

    /// The lag as a receiver will decode it; `None`: no code satisfies the bound.
    ///
    /// # Errors
    /// [`PacketError`] for a step that is none, or whose axes differ in the isotropic form.
    pub(super) fn round(
        &self,
        earlier: &Gaussian<4>,
        later: &Later,
        step: &GraphStep,
    ) -> Result<Option<RoundedLag>, PacketError> {
        let singular = || PacketError::NotPositiveDefinite { field: "smoothed covariance" };
        let root = root_of(&earlier.covariance)?;
        let told = symmetrized(&(root.transpose() * step.smoothing_matrix * root));
        if self.shape.sigmas.len() == 2 {
            check_isotropic(&told)?;
        }
        let smoothed = symmetrized(&(NodeMatrix::identity() + told).try_inverse().ok_or_else(singular)?);
        let shift =
            smoothed * root.transpose() * (step.smoothing_vector - step.smoothing_matrix * earlier.mean);
        if shift.iter().any(|value| value.abs() > self.most_shift()) {
            return Ok(None);
        }
        let mut sent = NodeVector::zeros();
        for (code, value) in sent.iter_mut().zip(shift.iter()) {
            *code = self.shift.decode(self.shift.encode(*value)?);
        }
        let exact = Exact {
            smoothed,
            transition: later.back * step.transition * root,
            noise: symmetrized(&(later.back * step.noise * later.back.transpose())),
            earlier_off: shift - sent,
            later_off: later.off,
        };
        let least = self.smoothed.cover(
            self.shape,
            &symmetrized(&(smoothed + exact.earlier_off * exact.earlier_off.transpose())),
        )?;
        for choice in 0..(RAISES + 1).pow(least.sigmas.len() as u32) {
            let Some(sigmas) = self.smoothed.raised(self.shape, &least.sigmas, choice, RAISES) else {
                continue;
            };
            let smoothed = self.smoothed.matrix(self.shape, &sigmas, &least.correlations);
            let found = match &self.noise {
                Some(scale) => self.with_noise(scale, smoothed, sent, &exact),
                None => self.searched(smoothed, sent, &exact),
            };
            if found.is_some() {
                return Ok(found);
            }
        }
        Ok(None)
    }

    /// K to the nearest codes, and the noise with which the bound holds.
    fn with_noise(
        &self,
        scale: &Scale,
        smoothed: NodeMatrix,
        shift: NodeVector,
        exact: &Exact,
    ) -> Option<RoundedLag> {
        let lag = RoundedLag { smoothed, shift, transition: NodeMatrix::zeros(), noise: None };
        let root = symmetrized(&lag.kept()?.1).cholesky()?.l();
        let codes = entry_codes(self.shape, self.transition, self.largest, &(exact.transition * root));
        let transition = entries_of(self.shape, self.transition, self.largest, &codes);
        let lag = RoundedLag { transition, noise: Some(NodeMatrix::zeros()), ..lag };
        let excess = exact.excess(&lag)?;
        let across = excess.fixed_view::<4, 4>(4, 0).into_owned();
        let earlier = symmetrized(&excess.fixed_view::<4, 4>(0, 0).into_owned()).cholesky()?;
        let lacking = across * earlier.solve(&across.transpose()) - excess.fixed_view::<4, 4>(4, 4);
        let codes = scale.cover(self.shape, &symmetrized(&lacking)).ok()?;
        let noise = scale.matrix(self.shape, &codes.sigmas, &codes.correlations);
        Some(RoundedLag { noise: Some(noise), ..lag })
    }

    /// K near the value that keeps Φ or, where rounding increased A much, near the value that keeps the
    /// cross-covariance.
    fn searched(&self, smoothed: NodeMatrix, shift: NodeVector, exact: &Exact) -> Option<RoundedLag> {
        let lag = RoundedLag { smoothed, shift, transition: NodeMatrix::zeros(), noise: None };
        let root = symmetrized(&lag.kept()?.1).cholesky()?.l();
        let back = root.try_inverse()?;
        let keeping = [exact.transition * root, exact.transition * exact.smoothed * back.transpose()];
        keeping.iter().find_map(|wanted| self.neighbour(wanted, &lag, exact))
    }

    /// Among the neighbouring codes of K that satisfy the bound, the one with the smallest covariance.
    fn neighbour(&self, wanted: &NodeMatrix, lag: &RoundedLag, exact: &Exact) -> Option<RoundedLag> {
        let nearest = entry_codes(self.shape, self.transition, self.largest, wanted);
        let mut best: Option<(f64, RoundedLag)> = None;
        for choice in 0..3i64.pow(nearest.len() as u32) {
            let mut left = choice;
            let mut codes = nearest.clone();
            for code in &mut codes {
                *code += left % 3 - 1;
                left /= 3;
            }
            let transition = entries_of(self.shape, self.transition, self.largest, &codes);
            let volume = (NodeMatrix::identity() - transition * transition.transpose()).determinant();
            if best.as_ref().is_some_and(|(least, _)| volume >= *least) {
                continue;
            }
            let lag = RoundedLag { transition, ..*lag };
            if exact.excess(&lag).is_some_and(|excess| excess.cholesky().is_some()) {
                best = Some((volume, lag));
            }
        }
        best.map(|(_, lag)| lag)
    }

    /// Writes a lag that [`LagWidths::round`] made: codes again, bit for bit.
    pub(super) fn write(&self, writer: &mut BitWriter, lag: &RoundedLag) -> Result<(), PacketError> {
        self.smoothed.write(writer, self.shape, &self.smoothed.codes_of(self.shape, &lag.smoothed))?;
        lag.shift.iter().try_for_each(|value| self.shift.write(writer, *value))?;
        for code in entry_codes(self.shape, self.transition, self.largest, &lag.transition) {
            push_signed(writer, code, self.transition)?;
        }
        match (&self.noise, &lag.noise) {
            (Some(scale), Some(noise)) => scale.write(writer, self.shape, &scale.codes_of(self.shape, noise)),
            (None, None) => Ok(()),
            _ => Err(PacketError::InvalidCode { field: "noise of an exact lag", code: 0 }),
        }
    }

    pub(super) fn read(&self, reader: &mut BitReader) -> Result<RoundedLag, PacketError> {
        let smoothed = self.smoothed.read(reader, self.shape)?;
        let mut shift = NodeVector::zeros();
        for entry in 0..4 {
            shift[entry] = self.shift.read(reader)?;
        }
        let transition = read_entries(reader, self.shape, self.transition, self.largest)?;
        let noise = self.noise.as_ref().map(|scale| scale.read(reader, self.shape)).transpose()?;
        Ok(RoundedLag { smoothed, shift, transition, noise })
    }
}

impl Exact {
    /// The decoded joint covariance of (earlier, later), the earlier one increased by [`SLACK`], minus the exact one.
    fn excess(&self, lag: &RoundedLag) -> Option<SMatrix<f64, 8, 8>> {
        let (_, smoothed) = lag.kept()?;
        let transition = lag.transition * smoothed.cholesky()?.l().try_inverse()?;
        let claimed = joint(&(smoothed * (1.0 + SLACK)), &transition, &lag.scaled_noise());
        let mut exact = joint(&self.smoothed, &self.transition, &self.noise);
        let mut off = SMatrix::<f64, 8, 1>::zeros();
        off.fixed_rows_mut::<4>(0).copy_from(&self.earlier_off);
        off.fixed_rows_mut::<4>(4).copy_from(&self.later_off);
        exact += off * off.transpose();
        let excess = claimed - exact;
        Some((excess + excess.transpose()) * 0.5)
    }
}

/// Covariance of (x, Φx + w).
pub(super) fn joint(earlier: &NodeMatrix, transition: &NodeMatrix, noise: &NodeMatrix) -> SMatrix<f64, 8, 8> {
    let across = transition * earlier;
    let mut matrix = SMatrix::<f64, 8, 8>::zeros();
    matrix.fixed_view_mut::<4, 4>(0, 0).copy_from(earlier);
    matrix.fixed_view_mut::<4, 4>(4, 0).copy_from(&across);
    matrix.fixed_view_mut::<4, 4>(0, 4).copy_from(&across.transpose());
    matrix.fixed_view_mut::<4, 4>(4, 4).copy_from(&(across * transition.transpose() + noise));
    matrix
}
