//! A Gaussian of fixed size in its two forms.

use nalgebra::{SMatrix, SVector};
use serde::{Deserialize, Serialize};

use crate::error::Error;

/// N(mean, covariance).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Gaussian<const D: usize> {
    /// μ.
    pub mean: SVector<f64, D>,
    /// Σ, symmetric.
    pub covariance: SMatrix<f64, D, D>,
}

/// exp(−½ xᵀΛx + ηᵀx): a Gaussian, or a factor that alone fixes not every direction.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Information<const D: usize> {
    /// Λ, symmetric.
    pub matrix: SMatrix<f64, D, D>,
    /// η.
    pub vector: SVector<f64, D>,
}

/// (M + Mᵀ)/2: what rounding took from symmetry.
#[must_use]
pub fn symmetrized<const D: usize>(matrix: &SMatrix<f64, D, D>) -> SMatrix<f64, D, D> {
    (matrix + matrix.transpose()) * 0.5
}

/// Rounding may take a correlation this much above one.
const CORRELATION_ROUNDING: f64 = 1e-10;

/// Whether a mean is finite and every pair of a covariance's leading `size` entries is one of a Gaussian: no variance
/// below zero, correlations of at most one. Where sums of numbers of very different size have lost their digits, one of
/// these fails. What is known exactly has a variance and covariances of zero.
pub(crate) fn is_sound<'a>(
    mut mean: impl Iterator<Item = &'a f64>,
    size: usize,
    entry: impl Fn(usize, usize) -> f64,
) -> bool {
    mean.all(|x| x.is_finite())
        && (0..size).all(|row| {
            let variance = entry(row, row);
            variance.is_finite()
                && variance >= 0.0
                && (0..row).all(|column| {
                    let covariance = entry(row, column);
                    covariance * covariance <= variance * entry(column, column) * (1.0 + CORRELATION_ROUNDING)
                })
        })
}

impl<const D: usize> Gaussian<D> {
    /// Its information form.
    ///
    /// # Errors
    /// [`Error::NotPositiveDefinite`] for a covariance that is not.
    pub fn information(&self) -> Result<Information<D>, Error> {
        let cholesky = symmetrized(&self.covariance)
            .cholesky()
            .ok_or(Error::NotPositiveDefinite { quantity: "covariance" })?;
        Ok(Information { matrix: symmetrized(&cholesky.inverse()), vector: cholesky.solve(&self.mean) })
    }

    /// Moved by `transition`, then spread by `noise`.
    pub fn predict(&mut self, transition: &SMatrix<f64, D, D>, noise: &SMatrix<f64, D, D>) {
        self.mean = transition * self.mean;
        self.covariance = symmetrized(&(transition * self.covariance * transition.transpose() + noise));
    }

    /// Normalised innovation squared (χ² of M degrees of freedom) of the measurement z = H x + N(0, R); `None` when
    /// H Σ Hᵀ + R is not positive definite.
    #[must_use]
    pub fn innovation_squared<const M: usize>(
        &self,
        observe: &SMatrix<f64, M, D>,
        value: &SVector<f64, M>,
        noise: &SMatrix<f64, M, M>,
    ) -> Option<f64> {
        let s = symmetrized(&(observe * self.covariance * observe.transpose() + noise)).cholesky()?;
        let off = value - observe * self.mean;
        Some(off.dot(&s.solve(&off)))
    }

    /// Conditions on the linear measurement z = H x + N(0, R), in Joseph's form: a sum of squares, which rounding
    /// cannot take below zero. Nothing changes on error.
    ///
    /// # Errors
    /// [`Error::NotPositiveDefinite`] when H Σ Hᵀ + R is not.
    pub fn update<const M: usize>(
        &mut self,
        observe: &SMatrix<f64, M, D>,
        value: &SVector<f64, M>,
        noise: &SMatrix<f64, M, M>,
    ) -> Result<(), Error> {
        let cross = self.covariance * observe.transpose();
        let s = symmetrized(&(observe * cross + noise))
            .cholesky()
            .ok_or(Error::NotPositiveDefinite { quantity: "innovation covariance" })?;
        let gain = s.solve(&cross.transpose()).transpose();
        let mean = self.mean + gain * (value - observe * self.mean);
        let keep = SMatrix::<f64, D, D>::identity() - gain * observe;
        let covariance =
            symmetrized(&(keep * self.covariance * keep.transpose() + gain * noise * gain.transpose()));
        let updated = Self { mean, covariance };
        if !updated.is_sound() {
            return Err(Error::NotPositiveDefinite { quantity: "updated covariance" });
        }
        *self = updated;
        Ok(())
    }

    /// Whether it is finite, every variance is above zero, and none is below what its covariances ask for.
    #[must_use]
    pub fn is_sound(&self) -> bool {
        is_sound(self.mean.iter(), D, |row, column| self.covariance[(row, column)])
            && self.covariance.diagonal().iter().all(|variance| *variance > 0.0)
    }
}

impl<const D: usize> Information<D> {
    /// No information at all.
    #[must_use]
    pub fn none() -> Self {
        Self { matrix: SMatrix::zeros(), vector: SVector::zeros() }
    }

    /// Its moment form.
    ///
    /// # Errors
    /// [`Error::NotPositiveDefinite`] for a factor that leaves a direction open, or is indefinite.
    pub fn gaussian(&self) -> Result<Gaussian<D>, Error> {
        let cholesky = symmetrized(&self.matrix)
            .cholesky()
            .ok_or(Error::NotPositiveDefinite { quantity: "information matrix" })?;
        Ok(Gaussian { covariance: symmetrized(&cholesky.inverse()), mean: cholesky.solve(&self.vector) })
    }

    /// Adds the linear measurement z = H x + N(0, W⁻¹), W its information.
    pub fn update<const M: usize>(
        &mut self,
        observe: &SMatrix<f64, M, D>,
        value: &SVector<f64, M>,
        weight: &SMatrix<f64, M, M>,
    ) {
        let weighted = observe.transpose() * weight;
        self.matrix = symmetrized(&(self.matrix + weighted * observe));
        self.vector += weighted * value;
    }

    /// Moves by `transition`, spreads by `noise`, without inverting the noise (it may be singular):
    /// M = F⁻ᵀΛF⁻¹, Λ ← M − M(I + QM)⁻¹QM, η ← (I − M(I + QM)⁻¹Q)F⁻ᵀη.
    ///
    /// # Errors
    /// [`Error::NotPositiveDefinite`] for a transition that cannot be inverted, or an indefinite Λ. Nothing has changed
    /// then.
    pub fn predict(
        &mut self,
        transition: &SMatrix<f64, D, D>,
        noise: &SMatrix<f64, D, D>,
    ) -> Result<(), Error> {
        let back =
            transition.try_inverse().ok_or(Error::NotPositiveDefinite { quantity: "state transition" })?;
        let moved = symmetrized(&(back.transpose() * self.matrix * back));
        let vector = back.transpose() * self.vector;
        let spread = (SMatrix::<f64, D, D>::identity() + noise * moved)
            .try_inverse()
            .ok_or(Error::NotPositiveDefinite { quantity: "I + QM" })?
            * noise;
        self.matrix = symmetrized(&(moved - moved * spread * moved));
        self.vector = vector - moved * (spread * vector);
        Ok(())
    }
}

impl Information<8> {
    /// Marginalises the second node of (first, second) out: the Schur complement of one block.
    ///
    /// # Errors
    /// [`Error::NotPositiveDefinite`] when that block is not.
    pub fn marginal(&self) -> Result<Information<4>, Error> {
        let own = symmetrized(&self.matrix.fixed_view::<4, 4>(4, 4).into_owned());
        let across = self.matrix.fixed_view::<4, 4>(0, 4);
        let root = own
            .cholesky()
            .ok_or(Error::NotPositiveDefinite { quantity: "information that is marginalised out" })?;
        let matrix = self.matrix.fixed_view::<4, 4>(0, 0) - across * root.solve(&across.transpose());
        let vector = self.vector.fixed_rows::<4>(0)
            - across * root.solve(&self.vector.fixed_rows::<4>(4).into_owned());
        Ok(Information { matrix: symmetrized(&matrix), vector })
    }
}
