//! Gaussians in both forms, and what pose graphs are made of.
//!
//! * [`process`]: white acceleration of a node [x, y, ẋ, ẏ].
//! * [`Gaussian`] ↔ [`Information`]: N(μ, Σ) and exp(−½ xᵀΛx + ηᵀx), Λ = Σ⁻¹, η = Λμ; measurement updates.
//! * [`Joint`]: a Gaussian over any number of nodes, in covariance form.

mod gaussian;
mod joint;
pub mod process;

pub use gaussian::{Gaussian, Information, symmetrized};
pub use joint::{Innovation, Joint, Term};

use nalgebra::{SMatrix, SVector};

/// Entries of a node's state [x, y, ẋ, ẏ]: east, north, m; east, north, m/s.
pub const NODE: usize = 4;
/// The state of a node.
pub type NodeVector = SVector<f64, NODE>;
/// A block of a node's matrices.
pub type NodeMatrix = SMatrix<f64, NODE, NODE>;
