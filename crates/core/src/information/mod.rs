//! Gaussians in both forms, and pose graphs made of them.
//!
//! * [`process`]: white acceleration of a node [x, y, ẋ, ẏ].
//! * [`Gaussian`] ↔ [`Information`]: N(μ, Σ) and exp(−½ xᵀΛx + ηᵀx), Λ = Σ⁻¹, η = Λμ; prediction, measurement updates,
//!   marginalisation of small fixed blocks.
//! * [`Joint`]: a Gaussian over any number of nodes, in covariance form.
//! * [`GraphStep`], [`Chain`]: one vehicle's pose graph, block-tridiagonal, kept as its factors.
//! * [`reconstruct`]: from joint marginals back to the graph (Walls & Eustice 2012).
//! * [`dense`]: marginalisation of larger systems.

pub mod chain;
pub mod dense;
mod gaussian;
pub mod graph_packet;
mod joint;
pub mod process;
pub mod reconstruct;
pub mod replica;
mod step;
#[cfg(test)]
mod tests;

pub use chain::{Chain, Node};
pub(crate) use gaussian::is_sound;
pub use gaussian::{Gaussian, Information, symmetrized};
pub use joint::{Innovation, Joint, Term};
pub use step::GraphStep;

use nalgebra::{SMatrix, SVector};

/// Entries of a node's state [x, y, ẋ, ẏ]: east, north, m; east, north, m/s.
pub const NODE: usize = 4;
/// The state of a node.
pub type NodeVector = SVector<f64, NODE>;
/// A block of a node's matrices.
pub type NodeMatrix = SMatrix<f64, NODE, NODE>;
