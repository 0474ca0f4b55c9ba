//! The decoded part of a packet on its sender's pose graph.

use serde::{Deserialize, Serialize};

use super::reconstruct::positive_part;
use super::{Gaussian, GraphStep, Information, NODE, Node, NodeMatrix, NodeVector, symmetrized};
use crate::error::Error;

/// The relation between a packet's newest node and the origin.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[allow(clippy::large_enum_variant, reason = "lives on the stack while one packet is read")]
pub enum OriginCorrelation {
    /// The newest node is the origin: there is nothing before it.
    Begin,
    /// The joint marginal over (newest, origin), exact.
    Joint(Information<8>),
    /// Σ_{newest, origin} times L₀⁻ᵀ, where L₀ L₀ᵀ is what was sent of the origin at its launch. (A sender's, before it
    /// is written: M, in the scale of the newest node as well.)
    Correlation(NodeMatrix),
}

/// The exact relation between a packet's newest node and an earlier one.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[allow(clippy::large_enum_variant, reason = "lives on the stack while one packet is read")]
pub enum Lag {
    /// Their joint marginal.
    Joint(Information<8>),
    /// The step between them, for a receiver that holds the earlier one as it was sent.
    Rounded(RoundedLag),
}

/// A step in the scales of its two nodes: L₂ L₂ᵀ the earlier one's covariance as it was sent, L₃ L₃ᵀ the later one's.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RoundedLag {
    /// A = L₂⁻¹ P₂|₃ L₂⁻ᵀ: the smoothed covariance of the earlier node.
    pub smoothed: NodeMatrix,
    /// L₂⁻¹ (x̂₂|₃ − x̂₂): how far smoothing moves its mean.
    pub shift: NodeVector,
    /// K = L₃⁻¹ Φ L₂ chol(A).
    pub transition: NodeMatrix,
    /// N = L₃⁻¹ W L₃⁻ᵀ; none: I − K Kᵀ.
    pub noise: Option<NodeMatrix>,
}

impl RoundedLag {
    /// The information gained on the earlier node, A⁻¹ − I, and the covariance that remains. Rounded up, A may exceed
    /// I: the gain is zero in those directions.
    #[must_use]
    pub fn kept(&self) -> Option<(NodeMatrix, NodeMatrix)> {
        let inverse = symmetrized(&self.smoothed).try_inverse()?;
        let gained = symmetrized(&(inverse - NodeMatrix::identity())).symmetric_eigen();
        let kept = NodeMatrix::from_diagonal(&gained.eigenvalues.map(|value| value.max(0.0)));
        let told = gained.eigenvectors * kept * gained.eigenvectors.transpose();
        let smoothed = (NodeMatrix::identity() + told).try_inverse()?;
        Some((told, symmetrized(&smoothed)))
    }

    /// N.
    #[must_use]
    pub fn scaled_noise(&self) -> NodeMatrix {
        self.noise.unwrap_or_else(|| NodeMatrix::identity() - self.transition * self.transition.transpose())
    }

    /// The step, from the two nodes as they were sent: P₂|₃ = L₂AL₂ᵀ, Φ = L₃ K (L₂ chol A)⁻¹, W = L₃ N L₃ᵀ, and what makes
    /// the later mean come out.
    ///
    /// # Errors
    /// [`Error::NotPositiveDefinite`] for matrices that no step has.
    pub fn step(&self, earlier: &Gaussian<NODE>, later: &Gaussian<NODE>) -> Result<GraphStep, Error> {
        let refused = || Error::NotPositiveDefinite { quantity: "rounded step" };
        let root = symmetrized(&earlier.covariance).cholesky().ok_or_else(refused)?.l();
        let back = root.try_inverse().ok_or_else(refused)?;
        let (told, smoothed) = self.kept().ok_or_else(refused)?;
        let smoothed_root = root * smoothed.cholesky().ok_or_else(refused)?.l();
        let later_root = symmetrized(&later.covariance).cholesky().ok_or_else(refused)?.l();
        let transition = later_root * self.transition * smoothed_root.try_inverse().ok_or_else(refused)?;
        let mean = earlier.mean + root * self.shift;
        let smoothing_matrix = symmetrized(&(back.transpose() * told * back));
        // j: (P₂⁻¹ + J)⁻¹ (P₂⁻¹ x̂₂ + j) is the smoothed mean.
        let known = back.transpose() * back;
        let noise = symmetrized(&(later_root * self.scaled_noise() * later_root.transpose()));
        Ok(GraphStep {
            transition,
            offset: later.mean - transition * mean,
            noise: positive_part(&noise, &later.covariance).ok_or_else(refused)?,
            smoothing_matrix,
            smoothing_vector: smoothing_matrix * mean + known * (mean - earlier.mean),
        })
    }
}

/// A server's packet, decoded.
#[derive(Debug, Clone, PartialEq)]
pub struct GraphPacket {
    /// Newest node, with its filtered Gaussian.
    pub node: Node,
    /// The origin's id.
    pub origin: u64,
    /// Newest node and origin.
    pub tie: OriginCorrelation,
    /// Exact ties with earlier nodes, by id.
    pub lags: Vec<(u64, Lag)>,
}
