//! Exact lags in few bits: what a rounded packet says of its node and an earlier one.
//!
//! Everything is told in the scales of the two nodes as they were sent, L₂ and L₃: A, what smoothing leaves of the earlier
//! node's covariance; the shift of its mean; K = L₃⁻¹ Φ L₂ chol(A); and, where there is room, the step's noise
//! N = L₃⁻¹ W L₃⁻ᵀ, which else is I − K Kᵀ. What a receiver makes of it is at least as uncertain as what is known: with the
//! earlier covariance taken [`SLACK`] larger, the decoded joint covariance of both nodes less the exact one, errors of
//! the rounded means included, is positive definite. With N that is reached by raising N, without it by a search over
//! the neighbouring codes of A and K.

use nalgebra::SMatrix;

use super::covering::{Scale, Shape, entries_of, entry_codes, push_signed, read_entries};
use super::field::FixedField;
use super::graph_rounded::{isotropic, root_of};
use super::{BitReader, BitWriter, PacketError};
use crate::information::replica::RoundedLag;
use crate::information::{Gaussian, NodeMatrix, NodeVector, Step, symmetrized};

/// Share by which the earlier node's covariance may be taken larger for the cover to hold. Rounding Φ of a vehicle that
/// learns nothing of where it was is covered by no noise at all without it.
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
    /// L₃⁻¹ times what its mean is, less what is sent of it.
    pub(super) off: NodeVector,
}

impl LagWidths {
    /// How far an earlier mean may have moved, in its own sigmas.
    fn most_shift(&self) -> f64 {
        self.shift.decode((1 << (self.shift.bits - 1)) - 1)
    }

    /// The lag as a receiver will decode it; `None`: its codes hold none that is honest.
    ///
    /// # Errors
    /// [`PacketError`] for a step that is none, or whose axes differ in the isotropic form.
    pub(super) fn round(
        &self,
        earlier: &Gaussian<4>,
        later: &Later,
        step: &Step,
    ) -> Result<Option<RoundedLag>, PacketError> {
        let singular = || PacketError::NotPositiveDefinite { field: "smoothed covariance" };
        let root = root_of(&earlier.covariance)?;
        let told = symmetrized(&(root.transpose() * step.told_matrix * root));
        if self.shape.sigmas.len() == 2 {
            isotropic(&told)?;
        }
        let smoothed = symmetrized(&(NodeMatrix::identity() + told).try_inverse().ok_or_else(singular)?);
        let shift = smoothed * root.transpose() * (step.told_vector - step.told_matrix * earlier.mean);
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

    /// K to the nearest codes, and the noise that makes it honest.
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

    /// K near what keeps Φ or, where rounding made A far larger than it is, near what keeps the covariance of the two.
    fn searched(&self, smoothed: NodeMatrix, shift: NodeVector, exact: &Exact) -> Option<RoundedLag> {
        let lag = RoundedLag { smoothed, shift, transition: NodeMatrix::zeros(), noise: None };
        let root = symmetrized(&lag.kept()?.1).cholesky()?.l();
        let back = root.try_inverse()?;
        let keeping = [exact.transition * root, exact.transition * exact.smoothed * back.transpose()];
        keeping.iter().find_map(|wanted| self.neighbour(wanted, &lag, exact))
    }

    /// Of the honest ones among neighbouring codes of K the one that leaves the least uncertain.
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
    /// The joint covariance of (earlier, later) that a lag decodes to, the earlier one [`SLACK`] larger, less what it is.
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
fn joint(earlier: &NodeMatrix, transition: &NodeMatrix, noise: &NodeMatrix) -> SMatrix<f64, 8, 8> {
    let across = transition * earlier;
    let mut matrix = SMatrix::<f64, 8, 8>::zeros();
    matrix.fixed_view_mut::<4, 4>(0, 0).copy_from(earlier);
    matrix.fixed_view_mut::<4, 4>(4, 0).copy_from(&across);
    matrix.fixed_view_mut::<4, 4>(0, 4).copy_from(&across.transpose());
    matrix.fixed_view_mut::<4, 4>(4, 4).copy_from(&(across * transition.transpose() + noise));
    matrix
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::panic, reason = "tests fail by panicking")]

    use nalgebra::{SMatrix, SVector};
    use proptest::prelude::*;

    use super::*;
    use crate::information::replica::Lag;
    use crate::information::{Node, process};
    use crate::packet::graph::{GraphForm, GraphLink, GraphMessage};
    use crate::packet::graph_rounded::{Told, rounded};

    const DT_S: f64 = 0.5;

    /// A vehicle with fixes of `sigma_fix` each second (0: none), and a DVL of sigmas along and across (0: none).
    fn moved(
        state: &mut Gaussian<4>,
        seconds: u32,
        sigma_fix: f64,
        dvl: (f64, f64),
        q: f64,
        z: &[f64],
    ) -> Step {
        let mut step = Step::identity();
        let position = SMatrix::<f64, 2, 4>::identity();
        let mut velocity = SMatrix::<f64, 2, 4>::zeros();
        (velocity[(0, 2)], velocity[(1, 3)]) = (1.0, 1.0);
        for k in 0..2 * seconds as usize {
            let (f, noise) = (process::transition(DT_S), process::noise(DT_S, q));
            state.predict(&f, &noise);
            step.predict(&f, &noise);
            // In turns, so that nobody sails off the fields.
            let draw = |i: usize| z[(k / 2 + i) % z.len()] * if k % 4 < 2 { 1.0 } else { -1.0 };
            let mut fuse = |h: &SMatrix<f64, 2, 4>, sigmas: (f64, f64)| {
                let z = h * state.mean + SVector::<f64, 2>::new(draw(0) * sigmas.0, draw(1) * sigmas.1);
                let r = SMatrix::<f64, 2, 2>::new(sigmas.0.powi(2), 0.0, 0.0, sigmas.1.powi(2));
                state.update(h, &z, &r).unwrap();
                step.update(h, &z, &r).unwrap();
            };
            if sigma_fix > 0.0 && k % 2 == 1 {
                fuse(&position, (sigma_fix, sigma_fix));
            }
            if dvl.0 > 0.0 {
                fuse(&velocity, dvl);
            }
        }
        step
    }

    /// The joint covariance of (earlier, later) that a step from N(x₂, P₂) gives.
    fn joint_from(prior: &NodeMatrix, step: &Step) -> SMatrix<f64, 8, 8> {
        let smoothed = (prior.try_inverse().unwrap() + step.told_matrix).try_inverse().unwrap();
        joint(&symmetrized(&smoothed), &step.transition, &step.noise)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(96))]

        /// What a receiver decodes of an exact lag is never surer than what the sender knows, whatever sails.
        #[test]
        fn an_exact_lag_never_claims_more_than_is_known(
            gps in any::<bool>(),
            sigma in 0.3f64..10.0,
            along in 0.02f64..0.3,
            across in 1.0f64..4.0,
            seconds in 4u32..60,
            before in 0u32..200,
            q in 1e-5f64..1e-3,
            z in proptest::collection::vec(-1.5f64..1.5, 7),
        ) {
            let (form, fix, dvl) = if gps {
                (GraphForm::Frame32, sigma, (0.0, 0.0))
            } else {
                (GraphForm::Frame256, 0.0, (along, along * across))
            };
            let start = SVector::<f64, 4>::new(sigma * sigma, sigma * sigma, 1.0, 1.0);
            let mut state = Gaussian { mean: NodeVector::new(310.0, -92.0, 0.3, -0.2), covariance: NodeMatrix::from_diagonal(&start) };
            moved(&mut state, before, fix, dvl, q, &z);
            let first = Node { id: 0, tol_ns: 0, filtered: state };
            let sent = rounded(&Told { node: first, origin: None, lags: Vec::new() }, form).unwrap().node.filtered;
            let step = moved(&mut state, seconds, fix, dvl, q, &z);
            let told = Told {
                node: Node { id: 1, tol_ns: 1, filtered: state },
                origin: Some((0, sent, step.transition)),
                lags: vec![(0, sent, step)],
            };
            let graph = rounded(&told, form).unwrap();
            let link = GraphLink { form, sender: 0, tol_ns: 1, bitmaps: 0 };
            let message = GraphMessage { sequence: 1, depth_m: 0.0, bitmaps: Vec::new(), graph: Some(graph.clone()) };
            let bytes = message.encode(&link).unwrap();
            let frame = if gps { 32 } else { 256 };
            prop_assert!(bytes.len() <= frame);
            let decoded = GraphMessage::decode(&bytes, &link, None, None, u64::from).unwrap().graph.unwrap();
            prop_assert_eq!(&decoded.lags, &graph.lags);
            // Where no code is honest, no lag is sent.
            let Some((_, Lag::Rounded(lag))) = decoded.lags.first() else { return Ok(()) };
            let found = lag.step(&sent, &decoded.node.filtered).unwrap();
            let exact = joint_from(&sent.covariance, &step);
            let mut claimed = joint_from(&sent.covariance, &found);
            let earlier = claimed.fixed_view::<4, 4>(0, 0) * (1.0 + SLACK);
            claimed = joint(&earlier, &found.transition, &found.noise);
            let back = exact.cholesky().unwrap().l().try_inverse().unwrap();
            let excess = back * (claimed - exact) * back.transpose();
            let least = ((excess + excess.transpose()) * 0.5).symmetric_eigenvalues().min();
            prop_assert!(least > -1e-7, "least excess {least:e}");
        }
    }

    /// Codes are nearly always found: a packet without its lag costs a receiver more.
    #[test]
    fn a_ship_with_gps_tells_its_lag() {
        let z = [0.3, -1.1, 0.8, -0.2, 1.3, -0.7, 0.1];
        let start = SVector::<f64, 4>::new(9.0, 9.0, 1.0, 1.0);
        let mut state = Gaussian { mean: NodeVector::zeros(), covariance: NodeMatrix::from_diagonal(&start) };
        let (mut told, mut sent): (usize, Option<Gaussian<4>>) = (0, None);
        for id in 0..40 {
            let step = moved(&mut state, 8 + id % 20, 3.0, (0.0, 0.0), 1e-4, &z);
            let node = Node { id: u64::from(id), tol_ns: 0, filtered: state };
            let origin = sent.map(|sent| (u64::from(id) - 1, sent, step.transition));
            let lags = sent.map(|sent| (u64::from(id) - 1, sent, step)).into_iter().collect();
            let graph = rounded(&Told { node, origin, lags }, GraphForm::Frame32).unwrap();
            told += graph.lags.len();
            sent = Some(graph.node.filtered);
        }
        assert!(told >= 37, "{told} of 39");
    }
}
