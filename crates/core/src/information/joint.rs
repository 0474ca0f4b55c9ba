//! A Gaussian over any number of nodes, in covariance form.

use nalgebra::{DMatrix, DVector, Matrix2, SMatrix, SVector, Vector2};
use serde::{Deserialize, Serialize};

use super::gaussian::is_sound;
use super::{Gaussian, NODE, NodeMatrix, NodeVector};
use crate::error::Error;
use crate::kernels::math::ln;

/// Blocks of four: node b has rows 4b … 4b + 3.
///
/// ```text
/// mean [ node 0 | node 1 | … ]      covariance [ 00  01  … ]
///                                              [ 10  11  … ]
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Joint {
    mean: DVector<f64>,
    covariance: DMatrix<f64>,
    /// Logarithm of the density of all measurements that were fused, without its constants.
    log_evidence: f64,
}

/// How a measurement of M numbers depends on one node.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Term<const M: usize> {
    /// Which node.
    pub node: usize,
    /// The derivative by its state.
    pub observe: SMatrix<f64, M, NODE>,
}

/// A measurement as a joint sees it, ready to be weighed or fused.
#[derive(Debug, Clone)]
pub struct Innovation<const M: usize> {
    /// Σ Hᵀ.
    cross: DMatrix<f64>,
    /// (H Σ Hᵀ + R)⁻¹.
    weight: SMatrix<f64, M, M>,
    /// Value less prediction.
    pub off: SVector<f64, M>,
    /// H Σ Hᵀ + R.
    pub covariance: SMatrix<f64, M, M>,
    /// Normalised innovation squared, χ² of M degrees of freedom.
    pub squared: f64,
}

impl Default for Joint {
    fn default() -> Self {
        Self { mean: DVector::zeros(0), covariance: DMatrix::zeros(0, 0), log_evidence: 0.0 }
    }
}

impl Joint {
    /// Without any node.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// How many nodes there are.
    #[must_use]
    pub fn nodes(&self) -> usize {
        self.mean.len() / NODE
    }

    /// Mean of all nodes.
    #[must_use]
    pub fn mean(&self) -> &DVector<f64> {
        &self.mean
    }

    /// Covariance of all nodes.
    #[must_use]
    pub fn covariance(&self) -> &DMatrix<f64> {
        &self.covariance
    }

    /// Logarithm of the density of all measurements that were fused, without its constants: what alternatives that were
    /// told the same are compared by.
    #[must_use]
    pub fn log_evidence(&self) -> f64 {
        self.log_evidence
    }

    /// Mean of one node.
    #[must_use]
    pub fn node_mean(&self, node: usize) -> NodeVector {
        self.mean.fixed_rows::<NODE>(node * NODE).into_owned()
    }

    /// Covariance of two nodes.
    #[must_use]
    pub fn block(&self, row: usize, column: usize) -> NodeMatrix {
        self.covariance.fixed_view::<NODE, NODE>(row * NODE, column * NODE).into_owned()
    }

    /// One node alone.
    #[must_use]
    pub fn marginal(&self, node: usize) -> Gaussian<NODE> {
        Gaussian { mean: self.node_mean(node), covariance: self.block(node, node) }
    }

    /// Adds a node that is independent of all others; gives its index.
    pub fn push(&mut self, node: &Gaussian<NODE>) -> usize {
        let n = self.mean.len();
        let mean = std::mem::replace(&mut self.mean, DVector::zeros(0));
        self.mean = mean.resize_vertically(n + NODE, 0.0);
        self.mean.fixed_rows_mut::<NODE>(n).copy_from(&node.mean);
        let covariance = std::mem::replace(&mut self.covariance, DMatrix::zeros(0, 0));
        self.covariance = covariance.resize(n + NODE, n + NODE, 0.0);
        self.covariance.fixed_view_mut::<NODE, NODE>(n, n).copy_from(&node.covariance);
        n / NODE
    }

    /// Adds a copy of a node, fully correlated with it (a delayed state); gives its index.
    pub fn push_copy(&mut self, node: usize) -> usize {
        let added = self.push(&self.marginal(node));
        let (n, from) = (added * NODE, node * NODE);
        for row in 0..n {
            for k in 0..NODE {
                let value = self.covariance[(row, from + k)];
                self.covariance[(row, n + k)] = value;
                self.covariance[(n + k, row)] = value;
            }
        }
        added
    }

    /// Marginalises a node out; those after it move up.
    pub fn remove(&mut self, node: usize) {
        let mean = std::mem::replace(&mut self.mean, DVector::zeros(0));
        self.mean = mean.remove_rows(node * NODE, NODE);
        let covariance = std::mem::replace(&mut self.covariance, DMatrix::zeros(0, 0));
        self.covariance = covariance.remove_rows(node * NODE, NODE).remove_columns(node * NODE, NODE);
    }

    /// Moves one node on: x ← F x + offset + N(0, noise). Cross-covariances follow.
    pub fn propagate(
        &mut self,
        node: usize,
        transition: &NodeMatrix,
        offset: &NodeVector,
        noise: &NodeMatrix,
    ) {
        let (n, at) = (self.mean.len(), node * NODE);
        let mean = transition * self.node_mean(node) + offset;
        self.mean.fixed_rows_mut::<NODE>(at).copy_from(&mean);
        let own = self.block(node, node);
        for row in (0..n).filter(|row| !(at..at + NODE).contains(row)) {
            let old = SVector::<f64, NODE>::from_fn(|k, _| self.covariance[(row, at + k)]);
            let new = transition * old;
            for k in 0..NODE {
                self.covariance[(row, at + k)] = new[k];
                self.covariance[(at + k, row)] = new[k];
            }
        }
        let own = super::symmetrized(&(transition * own * transition.transpose() + noise));
        self.covariance.fixed_view_mut::<NODE, NODE>(at, at).copy_from(&own);
    }

    /// Moves one node by another: x ← x + M y. Cross-covariances follow.
    pub fn couple(&mut self, node: usize, by: usize, matrix: &NodeMatrix) {
        let moved = self.node_mean(node) + matrix * self.node_mean(by);
        self.mean.fixed_rows_mut::<NODE>(node * NODE).copy_from(&moved);
        let rows = matrix * self.covariance.fixed_rows::<NODE>(by * NODE);
        let mut into = self.covariance.fixed_rows_mut::<NODE>(node * NODE);
        into += rows;
        let columns = self.covariance.fixed_columns::<NODE>(by * NODE) * matrix.transpose();
        let mut into = self.covariance.fixed_columns_mut::<NODE>(node * NODE);
        into += columns;
        let own = super::symmetrized(&self.block(node, node));
        self.covariance.fixed_view_mut::<NODE, NODE>(node * NODE, node * NODE).copy_from(&own);
    }

    /// What a measurement with derivative H (a sum of terms), predicted value `predicted` and noise R tells; `None`
    /// when H Σ Hᵀ + R is not positive definite.
    #[must_use]
    pub fn innovation<const M: usize>(
        &self,
        terms: &[Term<M>],
        value: &SVector<f64, M>,
        predicted: &SVector<f64, M>,
        noise: &SMatrix<f64, M, M>,
    ) -> Option<Innovation<M>> {
        let n = self.mean.len();
        let mut cross = DMatrix::zeros(n, M);
        for term in terms {
            cross += self.covariance.fixed_columns::<NODE>(term.node * NODE) * term.observe.transpose();
        }
        let mut s = *noise;
        for term in terms {
            s += term.observe * cross.fixed_view::<NODE, M>(term.node * NODE, 0);
        }
        let covariance = super::symmetrized(&s);
        let weight = super::symmetrized(&covariance.cholesky()?.inverse());
        let off = value - predicted;
        let squared = off.dot(&(weight * off));
        squared.is_finite().then_some(Innovation { cross, weight, off, covariance, squared })
    }

    /// Whether every node is finite with a covariance that is one. Nodes may be copies of each other, so correlations
    /// between them are not looked at.
    #[must_use]
    pub fn is_sound(&self) -> bool {
        (0..self.nodes()).all(|node| {
            let at = node * NODE;
            let mean = self.mean.iter().skip(at).take(NODE);
            is_sound(mean, NODE, |row, column| self.covariance[(at + row, at + column)])
        })
    }

    /// Fuses what [`Joint::innovation`] of this very joint gave.
    ///
    /// # Errors
    /// [`Error::NotPositiveDefinite`] where the numbers differ so much in size that what is left is no Gaussian; nothing
    /// has changed then.
    pub fn fuse<const M: usize>(&mut self, innovation: &Innovation<M>) -> Result<(), Error> {
        let before = self.clone();
        self.condition(innovation);
        if self.is_sound() {
            self.log_evidence -= 0.5 * innovation.squared + half_log_determinant(&innovation.covariance);
            return Ok(());
        }
        *self = before;
        Err(Error::NotPositiveDefinite { quantity: "covariance of nodes after a measurement" })
    }

    fn condition<const M: usize>(&mut self, innovation: &Innovation<M>) {
        let Innovation { cross, weight, off, .. } = innovation;
        let gain = cross * weight;
        self.mean += &gain * off;
        let n = self.mean.len();
        // Both triangles get the same number, so the covariance stays symmetric to the bit.
        for row in 0..n {
            for column in 0..=row {
                let mut value = self.covariance[(row, column)];
                for k in 0..M {
                    value -=
                        0.5 * (gain[(row, k)] * cross[(column, k)] + gain[(column, k)] * cross[(row, k)]);
                }
                self.covariance[(row, column)] = value;
                self.covariance[(column, row)] = value;
            }
        }
    }

    /// A linear measurement of two entries of one node: its position (`first` 0) or its velocity (`first` 2).
    #[must_use]
    pub fn pair_innovation(
        &self,
        node: usize,
        first: usize,
        value: &Vector2<f64>,
        noise: &Matrix2<f64>,
    ) -> Option<Innovation<2>> {
        let observe = SMatrix::<f64, 2, NODE>::from_fn(|r, c| f64::from(u8::from(c == first + r)));
        let predicted = self.node_mean(node).fixed_rows::<2>(first).into_owned();
        self.innovation(&[Term { node, observe }], value, &predicted, noise)
    }

    /// Fuses the factor exp(−½ xᵀΛx + ηᵀx) on one node, Λ positive semi-definite: Σ ← Σ − Σ_b (I + ΛΣ_bb)⁻¹ Λ Σ_bᵀ.
    ///
    /// # Errors
    /// [`Error::NotPositiveDefinite`] when I + ΛΣ cannot be inverted, or what is left is no Gaussian; nothing has changed
    /// then.
    pub fn inform(&mut self, node: usize, matrix: &NodeMatrix, vector: &NodeVector) -> Result<(), Error> {
        let own = self.block(node, node);
        let solve = (NodeMatrix::identity() + matrix * own)
            .try_inverse()
            .ok_or(Error::NotPositiveDefinite { quantity: "I + ΛΣ of a factor" })?;
        let before = self.clone();
        let column = self.covariance.fixed_columns::<NODE>(node * NODE).into_owned();
        let tells = vector - matrix * self.node_mean(node);
        self.mean += &column * (solve * tells);
        let weight = super::symmetrized(&(solve * matrix));
        let reduced = &self.covariance - &column * weight * column.transpose();
        self.covariance = (&reduced + reduced.transpose()) * 0.5;
        if self.is_sound() {
            return Ok(());
        }
        *self = before;
        Err(Error::NotPositiveDefinite { quantity: "covariance of nodes after a factor" })
    }
}

/// ½ ln det of a covariance; 0 for one that is none.
fn half_log_determinant<const M: usize>(covariance: &SMatrix<f64, M, M>) -> f64 {
    covariance.cholesky().map_or(0.0, |lower| lower.l_dirty().diagonal().iter().map(|entry| ln(*entry)).sum())
}
