//! What lies between two nodes of a graph, in products alone.

use serde::{Deserialize, Serialize};

use super::{Gaussian, Information, Joint, NODE, NodeMatrix, NodeVector, symmetrized};
use crate::error::Error;
use nalgebra::{SMatrix, SVector};

/// An indefinite smoothing part is refused beyond this share of the information on the earlier node.
const INDEFINITE_SHARE_MAX: f64 = 1e-3;

/// Everything that was predicted and measured between an earlier node x and a later one x′: x′ = Φ x + b + N(0, W),
/// and the likelihood exp(−½ xᵀJx + jᵀx) of x itself.
///
/// Steps compose ([`GraphStep::then`]); no process noise is ever inverted, so W may be singular.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct GraphStep {
    /// Φ.
    pub transition: NodeMatrix,
    /// b.
    pub offset: NodeVector,
    /// W, positive semi-definite.
    pub noise: NodeMatrix,
    /// J, positive semi-definite: information of later measurements on the earlier node.
    pub smoothing_matrix: NodeMatrix,
    /// j.
    pub smoothing_vector: NodeVector,
}

impl Default for GraphStep {
    fn default() -> Self {
        Self::identity()
    }
}

impl GraphStep {
    /// Nothing has happened.
    #[must_use]
    pub fn identity() -> Self {
        Self {
            transition: NodeMatrix::identity(),
            offset: NodeVector::zeros(),
            noise: NodeMatrix::zeros(),
            smoothing_matrix: NodeMatrix::zeros(),
            smoothing_vector: NodeVector::zeros(),
        }
    }

    /// The later node moves by `transition` and spreads by `noise`.
    pub fn predict(&mut self, transition: &NodeMatrix, noise: &NodeMatrix) {
        self.transition = transition * self.transition;
        self.offset = transition * self.offset;
        self.noise = symmetrized(&(transition * self.noise * transition.transpose() + noise));
    }

    /// The later node is measured: z = H x′ + N(0, R). Nothing changes on error.
    ///
    /// # Errors
    /// [`Error::NotPositiveDefinite`] when H W Hᵀ + R is not.
    pub fn update<const M: usize>(
        &mut self,
        observe: &SMatrix<f64, M, NODE>,
        value: &SVector<f64, M>,
        noise: &SMatrix<f64, M, M>,
    ) -> Result<(), Error> {
        let cross = self.noise * observe.transpose();
        let s = symmetrized(&(observe * cross + noise))
            .cholesky()
            .ok_or(Error::NotPositiveDefinite { quantity: "innovation covariance" })?;
        let gain = s.solve(&cross.transpose()).transpose();
        let seen = observe * self.transition;
        let off = value - observe * self.offset;
        self.smoothing_matrix = symmetrized(&(self.smoothing_matrix + seen.transpose() * s.solve(&seen)));
        self.smoothing_vector += seen.transpose() * s.solve(&off);
        let keep = NodeMatrix::identity() - gain * observe;
        self.transition = keep * self.transition;
        self.offset += gain * off;
        self.noise = symmetrized(&(keep * self.noise * keep.transpose() + gain * noise * gain.transpose()));
        Ok(())
    }

    /// This step, then `next`: the node in between is marginalised out.
    ///
    /// # Errors
    /// [`Error::NotPositiveDefinite`] when I + WJ cannot be inverted.
    pub fn then(&self, next: &Self) -> Result<Self, Error> {
        let settle = (NodeMatrix::identity() + self.noise * next.smoothing_matrix)
            .try_inverse()
            .ok_or(Error::NotPositiveDefinite { quantity: "I + WJ between two steps" })?;
        let onward = next.transition * settle;
        let heard = next.smoothing_matrix * settle;
        Ok(Self {
            transition: onward * self.transition,
            offset: onward * (self.offset + self.noise * next.smoothing_vector) + next.offset,
            noise: symmetrized(&(onward * self.noise * next.transition.transpose() + next.noise)),
            smoothing_matrix: symmetrized(
                &(self.smoothing_matrix + self.transition.transpose() * heard * self.transition),
            ),
            smoothing_vector: self.smoothing_vector
                + self.transition.transpose()
                    * settle.transpose()
                    * (next.smoothing_vector - next.smoothing_matrix * self.offset),
        })
    }

    /// The step as a factor on (later, earlier):
    ///
    /// ```text
    /// | W⁻¹      −W⁻¹Φ        |   | W⁻¹b        |
    /// | −ΦᵀW⁻¹   ΦᵀW⁻¹Φ + J   | , | j − ΦᵀW⁻¹b  |
    /// ```
    ///
    /// This is the delta information of the DEIF (1).
    ///
    /// # Errors
    /// [`Error::NotPositiveDefinite`] for a singular W.
    pub fn information(&self) -> Result<Information<8>, Error> {
        let weight = symmetrized(
            &self
                .noise
                .cholesky()
                .ok_or(Error::NotPositiveDefinite { quantity: "noise of a step" })?
                .inverse(),
        );
        let across = -weight * self.transition;
        let mut matrix = SMatrix::<f64, 8, 8>::zeros();
        matrix.fixed_view_mut::<4, 4>(0, 0).copy_from(&weight);
        matrix.fixed_view_mut::<4, 4>(0, 4).copy_from(&across);
        matrix.fixed_view_mut::<4, 4>(4, 0).copy_from(&across.transpose());
        let earlier = symmetrized(&(self.smoothing_matrix - self.transition.transpose() * across));
        matrix.fixed_view_mut::<4, 4>(4, 4).copy_from(&earlier);
        let mut vector = SVector::<f64, 8>::zeros();
        vector.fixed_rows_mut::<4>(0).copy_from(&(weight * self.offset));
        vector.fixed_rows_mut::<4>(4).copy_from(&(self.smoothing_vector + across.transpose() * self.offset));
        Ok(Information { matrix, vector })
    }

    /// The step that a delta information on (later, earlier) describes. `earlier` is what was known of the earlier node
    /// without it: rounding may have left J slightly indefinite against that, and its negative part is then dropped.
    ///
    /// # Errors
    /// [`Error::NotPositiveDefinite`] for a delta that is none.
    pub fn from_information(delta: &Information<8>, earlier: &Gaussian<NODE>) -> Result<Self, Error> {
        let refused = || Error::NotPositiveDefinite { quantity: "delta information" };
        let weight = symmetrized(&delta.matrix.fixed_view::<4, 4>(0, 0).into_owned());
        let across = delta.matrix.fixed_view::<4, 4>(0, 4).into_owned();
        let cholesky = weight.cholesky().ok_or_else(refused)?;
        let later = delta.vector.fixed_rows::<4>(0).into_owned();
        let transition = -cholesky.solve(&across);
        let offset = cholesky.solve(&later);
        let smoothing_matrix = symmetrized(
            &(delta.matrix.fixed_view::<4, 4>(4, 4).into_owned() + across.transpose() * transition),
        );
        let smoothing_vector = delta.vector.fixed_rows::<4>(4) - across.transpose() * offset;
        let mut step = Self {
            transition,
            offset,
            noise: symmetrized(&cholesky.inverse()),
            smoothing_matrix,
            smoothing_vector,
        };
        step.drop_indefinite(earlier)?;
        Ok(step)
    }

    /// Takes away what is negative in J, measured against the covariance of the earlier node, if it is little; the mean
    /// that goes with it stays that of `earlier` in those directions.
    fn drop_indefinite(&mut self, earlier: &Gaussian<NODE>) -> Result<(), Error> {
        let refused = || Error::NotPositiveDefinite { quantity: "what a step tells of its earlier node" };
        let root = symmetrized(&earlier.covariance).cholesky().ok_or_else(refused)?.l();
        let whitened = symmetrized(&(root.transpose() * self.smoothing_matrix * root)).symmetric_eigen();
        let least = whitened.eigenvalues.min();
        if least >= 0.0 {
            return Ok(());
        }
        if least.is_nan() || least < -INDEFINITE_SHARE_MAX {
            return Err(refused());
        }
        let tells = root.transpose() * (self.smoothing_vector - self.smoothing_matrix * earlier.mean);
        let back = root.try_inverse().ok_or_else(refused)?;
        let kept = whitened.eigenvalues.map(|value| value.max(0.0));
        let whitened_matrix =
            whitened.eigenvectors * NodeMatrix::from_diagonal(&kept) * whitened.eigenvectors.transpose();
        let along = whitened.eigenvectors.transpose() * tells;
        let positive = NodeVector::from_fn(|k, _| if kept[k] > 0.0 { along[k] } else { 0.0 });
        self.smoothing_matrix = symmetrized(&(back.transpose() * whitened_matrix * back));
        self.smoothing_vector =
            back.transpose() * (whitened.eigenvectors * positive) + self.smoothing_matrix * earlier.mean;
        Ok(())
    }

    /// Moves a node alone, and what is known of it.
    ///
    /// # Errors
    /// [`Error::NotPositiveDefinite`] when what the step tells cannot be weighed.
    pub fn apply(&self, node: &Gaussian<NODE>) -> Result<Gaussian<NODE>, Error> {
        let mut joint = Joint::new();
        joint.push(node);
        self.apply_to(&mut joint, 0)?;
        Ok(joint.marginal(0))
    }

    /// Moves a node of a joint: what the step tells of the earlier node, then the motion.
    ///
    /// # Errors
    /// As [`GraphStep::apply`]; nothing has changed then.
    pub fn apply_to(&self, joint: &mut Joint, node: usize) -> Result<(), Error> {
        if self.smoothing_matrix.iter().any(|value| *value != 0.0) {
            joint.inform(node, &self.smoothing_matrix, &self.smoothing_vector)?;
        }
        joint.propagate(node, &self.transition, &self.offset, &self.noise);
        Ok(())
    }
}
