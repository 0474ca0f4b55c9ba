//! From joint marginals back to the pose graph: Walls & Eustice (2012), section 4, as corrected.
//!
//! Notation: the client holds the graph up to t₂, the server sends t₃, both with the origin t₀. Joint marginals are
//! information on (later, origin).

use nalgebra::{SMatrix, SVector};

use super::chain::Blocks;
use super::{Gaussian, GraphStep, Information, NODE, NodeMatrix, NodeVector, symmetrized};
use crate::error::Error;

/// What equation (6) solves for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reconstruction {
    /// Delta information on (t₃, t₂), as the DEIF would have sent it.
    pub delta: Information<8>,
    /// Ω: information on t₂ in (A.4), with the new data.
    pub omega: NodeMatrix,
    /// ν: the vector that goes with it.
    pub nu: NodeVector,
}

/// How much of the least direction of D = Λᶜ₀₀ − Λˢ₀₀ survives rounding: its least eigenvalue, whitened by Λᶜ₀₀.
/// Equation (6) loses about 2.2e-16 over this; at or below zero nothing is left.
#[must_use]
pub fn health(client: &Information<8>, server: &Information<8>) -> f64 {
    let (known, sent) = (Blocks::from(client).earlier, Blocks::from(server).earlier);
    let Some(root) = symmetrized(&known).cholesky() else { return f64::NAN };
    let Some(back) = root.l().try_inverse() else { return f64::NAN };
    symmetrized(&(back * (known - sent) * back.transpose())).symmetric_eigenvalues().min()
}

/// The share of the least direction of D that rounding takes in float64; infinite when nothing is left.
#[must_use]
pub fn loss(health: f64) -> f64 {
    if health > 0.0 { f64::EPSILON / health } else { f64::INFINITY }
}

/// Equation (6), corrected, with one inverse: C = Λᶜ₂₀, D = Λᶜ₀₀ − Λˢ₀₀, d = ηᶜ₀ − ηˢ₀, X = Λˢ₃₀;
/// Ω = C D⁻¹ Cᵀ, β = −X D⁻¹ Cᵀ, ν = C D⁻¹ d, Λ₃₃ = Λˢ₃₃ + X D⁻¹ Xᵀ, η₃ = ηˢ₃ − X D⁻¹ d.
///
/// # Errors
/// [`Error::NotPositiveDefinite`] when D is not: rounding hides the correlation.
pub fn origin_delta(client: &Information<8>, server: &Information<8>) -> Result<Reconstruction, Error> {
    let (client, server) = (Blocks::from(client), Blocks::from(server));
    let (c, x) = (client.across, server.across);
    let root = symmetrized(&(client.earlier - server.earlier))
        .cholesky()
        .ok_or(Error::NotPositiveDefinite { quantity: "what the packet took from the origin" })?;
    let d = client.earlier_vector - server.earlier_vector;
    let (solved_c, solved_x, solved_d) =
        (root.solve(&c.transpose()), root.solve(&x.transpose()), root.solve(&d));
    let omega = symmetrized(&(c * solved_c));
    let nu = c * solved_d;
    let beta = -x * solved_c;
    let later = symmetrized(&(server.later + x * solved_x));
    let later_eta = server.later_vector - x * solved_d;
    let mut matrix = SMatrix::<f64, 8, 8>::zeros();
    matrix.fixed_view_mut::<4, 4>(0, 0).copy_from(&later);
    matrix.fixed_view_mut::<4, 4>(0, 4).copy_from(&beta);
    matrix.fixed_view_mut::<4, 4>(4, 0).copy_from(&beta.transpose());
    matrix.fixed_view_mut::<4, 4>(4, 4).copy_from(&(omega - client.later));
    let mut vector = SVector::<f64, 8>::zeros();
    vector.fixed_rows_mut::<4>(0).copy_from(&later_eta);
    vector.fixed_rows_mut::<4>(4).copy_from(&(nu - client.later_vector));
    Ok(Reconstruction { delta: Information { matrix, vector }, omega, nu })
}

/// When t₂ *is* the packet's origin (or its other node): packet − diag(0, what the client knows of t₂).
///
/// # Errors
/// [`Error::NotPositiveDefinite`] for a client's marginal that is not.
pub fn exact_delta(packet: &Information<8>, known: &Gaussian<NODE>) -> Result<Information<8>, Error> {
    let prior = known.information()?;
    let mut delta = *packet;
    let mut block = delta.matrix.fixed_view_mut::<4, 4>(4, 4);
    block -= prior.matrix;
    let mut rows = delta.vector.fixed_rows_mut::<4>(4);
    rows -= prior.vector;
    Ok(delta)
}

/// Where a joint marginal puts its later node: the marginal, and the covariance of later and origin.
///
/// # Errors
/// [`Error::NotPositiveDefinite`] for a joint that is not.
pub fn filtered(joint: &Information<8>) -> Result<(Gaussian<NODE>, NodeMatrix), Error> {
    let moments = joint.gaussian()?;
    let Blocks { later, across, .. } = Blocks::from(joint);
    let root = symmetrized(&later)
        .cholesky()
        .ok_or(Error::NotPositiveDefinite { quantity: "information of the later node" })?;
    // As a product: taken from the inverse of the whole, a weak correlation would be rounded away.
    let origin = moments.covariance.fixed_view::<4, 4>(4, 4).into_owned();
    let cross = -root.solve(&across) * origin;
    let marginal = Gaussian {
        mean: moments.mean.fixed_rows::<4>(0).into_owned(),
        covariance: moments.covariance.fixed_view::<4, 4>(0, 0).into_owned(),
    };
    Ok((marginal, cross))
}

/// The filtered-error model: the errors of filtered estimates follow e₃ = G e₂ + w, so
/// x₃ = G x₂ + x̂₃ − G x̂₂ + N(0, W) with G = Φ₃ Φ₂⁻¹ and W = P₃ − G P₂ Gᵀ. Products only, at any age of the origin;
/// what was learnt of x₂ after t₂ is not passed on.
///
/// `transition` is G.
///
/// # Errors
/// [`Error::NotPositiveDefinite`] when G would shrink P₂ to more than P₃.
pub fn filtered_error_step(
    earlier: &Gaussian<NODE>,
    later: &Gaussian<NODE>,
    transition: &NodeMatrix,
) -> Result<GraphStep, Error> {
    let refused = || Error::NotPositiveDefinite { quantity: "noise of the filtered-error model" };
    let noise_of = |transition: &NodeMatrix| {
        symmetrized(&(later.covariance - transition * earlier.covariance * transition.transpose()))
    };
    let mut transition = *transition;
    let mut noise = noise_of(&transition);
    if noise.cholesky().is_none() {
        transition = contracted(earlier, later, &transition).ok_or_else(refused)?;
        noise = noise_of(&transition);
    }
    let positive = positive_part(&noise, &later.covariance).ok_or_else(refused)?;
    Ok(GraphStep {
        transition,
        offset: later.mean - transition * earlier.mean,
        noise: positive,
        smoothing_matrix: NodeMatrix::zeros(),
        smoothing_vector: NodeVector::zeros(),
    })
}

/// G from the correlations of two filtered errors with the same origin's: Σ₃₀ Σ₂₀⁻¹ = Φ₃ Φ₂⁻¹.
///
/// Directions of x₂ in which nothing of the origin is left (the velocity of a vehicle with a DVL, after seconds) cannot be
/// solved for, and tell nothing of x₃ either: singular values below `left_share` of the largest are left out.
///
/// # Errors
/// [`Error::NotPositiveDefinite`] when nothing of the origin is left in the earlier one at all.
pub fn filtered_error_transition(
    earlier: &Gaussian<NODE>,
    earlier_cross: &NodeMatrix,
    later_cross: &NodeMatrix,
    left_share: f64,
) -> Result<NodeMatrix, Error> {
    let refused = || Error::NotPositiveDefinite { quantity: "correlation with the origin" };
    // Both shrink together as the origin ages; scaled, they stay away from the smallest numbers.
    let scale = earlier_cross.amax();
    if !(scale > 0.0 && scale.is_finite()) {
        return Err(refused());
    }
    let root = symmetrized(&earlier.covariance).cholesky().ok_or_else(refused)?.l();
    let back = root.try_inverse().ok_or_else(refused)?;
    let inverse = (back * (earlier_cross / scale))
        .svd(true, true)
        .pseudo_inverse(left_share * (back * (earlier_cross / scale)).norm())
        .map_err(|_| refused())?;
    let transition = (later_cross / scale) * inverse * back;
    if transition.iter().all(|value| value.is_finite()) { Ok(transition) } else { Err(refused()) }
}

/// G with the singular values of L₃⁻¹ G L₂ taken down to 1: two errors correlate no more than fully. `None` when they are
/// far above it, which no rounding explains.
fn contracted(
    earlier: &Gaussian<NODE>,
    later: &Gaussian<NODE>,
    transition: &NodeMatrix,
) -> Option<NodeMatrix> {
    const FAR: f64 = 2.0;
    let from = symmetrized(&earlier.covariance).cholesky()?.l();
    let to = symmetrized(&later.covariance).cholesky()?.l();
    let back = to.try_inverse()?;
    let mut svd = (back * transition * from).svd(true, true);
    if svd.singular_values.max() > FAR {
        return None;
    }
    svd.singular_values.apply(|value| *value = value.min(1.0));
    let contracted = to * svd.recompose().ok()? * from.try_inverse()?;
    contracted.iter().all(|value| value.is_finite()).then_some(contracted)
}

/// A symmetric matrix without its negative part, if that is little against `scale` (rounded packets may
/// correlate a little too much); `None` if it is more.
pub(super) fn positive_part(matrix: &NodeMatrix, scale: &NodeMatrix) -> Option<NodeMatrix> {
    const ROUNDING: f64 = 0.05;
    let root = symmetrized(scale).cholesky()?.l();
    let back = root.try_inverse()?;
    let whitened = symmetrized(&(back * matrix * back.transpose())).symmetric_eigen();
    let least = whitened.eigenvalues.min();
    if least >= 0.0 {
        return Some(*matrix);
    }
    if least.is_nan() || least < -ROUNDING {
        return None;
    }
    let kept = NodeMatrix::from_diagonal(&whitened.eigenvalues.map(|value| value.max(0.0)));
    let vectors = root * whitened.eigenvectors;
    Some(symmetrized(&(vectors * kept * vectors.transpose())))
}
