//! Covariances in few bits: sigmas and correlations that cover what is sent.

use super::field::sign_extend;
use super::{BitReader, BitWriter, PacketError, SigmaField};
use crate::information::{NodeMatrix, NodeVector, symmetrized};

/// Sigmas are raised by so many codes at most, each, in the search for the least covering volume.
const RAISES: u32 = 2;

/// Which numbers share a field.
pub(super) struct Shape {
    pub(super) sigmas: &'static [&'static [usize]],
    pub(super) correlations: &'static [&'static [(usize, usize)]],
    pub(super) entries: &'static [&'static [(usize, usize)]],
}

pub(super) const GENERAL: Shape = Shape {
    sigmas: &[&[0], &[1], &[2], &[3]],
    correlations: &[&[(0, 1)], &[(0, 2)], &[(0, 3)], &[(1, 2)], &[(1, 3)], &[(2, 3)]],
    entries: &[
        &[(0, 0)],
        &[(0, 1)],
        &[(0, 2)],
        &[(0, 3)],
        &[(1, 0)],
        &[(1, 1)],
        &[(1, 2)],
        &[(1, 3)],
        &[(2, 0)],
        &[(2, 1)],
        &[(2, 2)],
        &[(2, 3)],
        &[(3, 0)],
        &[(3, 1)],
        &[(3, 2)],
        &[(3, 3)],
    ],
};
pub(super) const ISOTROPE: Shape = Shape {
    sigmas: &[&[0, 1], &[2, 3]],
    correlations: &[&[(0, 2), (1, 3)]],
    entries: &[&[(0, 0), (1, 1)], &[(0, 2), (1, 3)], &[(2, 0), (3, 1)], &[(2, 2), (3, 3)]],
};

/// How a covariance is coded.
pub(super) struct Scale {
    pub(super) position: SigmaField,
    pub(super) velocity: SigmaField,
    pub(super) correlation: u32,
}

/// A covariance's codes and what they decode to.
pub(super) struct Covering {
    pub(super) sigmas: Vec<u32>,
    pub(super) correlations: Vec<i64>,
}

impl Scale {
    pub(super) fn field(&self, entry: usize) -> &SigmaField {
        if entry < 2 { &self.position } else { &self.velocity }
    }

    fn last_correlation(&self) -> f64 {
        f64::from((1u32 << (self.correlation - 1)) - 1)
    }

    /// Steps of a correlation: half a step short of 1 at the last code.
    fn correlation_steps(&self) -> f64 {
        self.last_correlation() + 0.5
    }

    pub(super) fn matrix(&self, shape: &Shape, sigmas: &[u32], correlations: &[i64]) -> NodeMatrix {
        let mut scale = NodeVector::zeros();
        for (group, code) in shape.sigmas.iter().zip(sigmas) {
            group.iter().for_each(|entry| scale[*entry] = self.field(*entry).decode(*code));
        }
        let mut matrix = NodeMatrix::from_diagonal(&scale.map(|sigma| sigma * sigma));
        for (group, code) in shape.correlations.iter().zip(correlations) {
            for (r, c) in *group {
                let value = *code as f64 / self.correlation_steps() * scale[*r] * scale[*c];
                matrix[(*r, *c)] = value;
                matrix[(*c, *r)] = value;
            }
        }
        matrix
    }

    /// The codes of least volume whose covariance is at least `wanted`.
    pub(super) fn cover(&self, shape: &Shape, wanted: &NodeMatrix) -> Result<Covering, PacketError> {
        let least = shape
            .sigmas
            .iter()
            .map(|group| self.field(group[0]).encode(wanted[(group[0], group[0])].max(0.0).sqrt()))
            .collect::<Result<Vec<_>, _>>()?;
        let mut correlations: Vec<i64> = shape
            .correlations
            .iter()
            .map(|group| {
                let (r, c) = group[0];
                let scale = (wanted[(r, r)] * wanted[(c, c)]).sqrt();
                let steps = if scale > 0.0 { wanted[(r, c)] / scale * self.correlation_steps() } else { 0.0 };
                steps.round().clamp(-self.last_correlation(), self.last_correlation()) as i64
            })
            .collect();
        loop {
            if let Some(found) = self.least_volume(shape, wanted, &least, &correlations) {
                return Ok(found);
            }
            // Correlations nearer to 1 than their steps resolve: take them back and let the sigmas rise.
            if correlations.iter().all(|code| *code == 0) {
                return Err(PacketError::NotPositiveDefinite { field: "covariance that sigmas can cover" });
            }
            correlations.iter_mut().for_each(|code| *code -= code.signum());
        }
    }

    /// The codes of a matrix that codes decode to.
    pub(super) fn codes_of(&self, shape: &Shape, matrix: &NodeMatrix) -> Covering {
        let sigmas = shape.sigmas.iter().map(|group| {
            let field = self.field(group[0]);
            let octaves = 0.5 * matrix[(group[0], group[0])].log2() - f64::from(field.lowest_log2);
            (octaves * f64::from(field.steps_per_octave)).round().max(0.0) as u32
        });
        let correlations = shape.correlations.iter().map(|group| {
            let (r, c) = group[0];
            let scale = (matrix[(r, r)] * matrix[(c, c)]).sqrt();
            (matrix[(r, c)] / scale * self.correlation_steps()).round() as i64
        });
        Covering { sigmas: sigmas.collect(), correlations: correlations.collect() }
    }

    /// Sigma codes raised by the digits of `choice` to the base `most` + 1; `None` where one leaves its field.
    pub(super) fn raised(&self, shape: &Shape, least: &[u32], choice: u32, most: u32) -> Option<Vec<u32>> {
        let mut left = choice;
        let mut sigmas = least.to_vec();
        for (group, code) in shape.sigmas.iter().zip(&mut sigmas) {
            *code += left % (most + 1);
            left /= most + 1;
            if *code >= 1 << self.field(group[0]).bits {
                return None;
            }
        }
        Some(sigmas)
    }

    fn least_volume(
        &self,
        shape: &Shape,
        wanted: &NodeMatrix,
        least: &[u32],
        correlations: &[i64],
    ) -> Option<Covering> {
        let count = least.len();
        let mut best: Option<(f64, Covering)> = None;
        for choice in 0..(RAISES + 1).pow(count as u32) {
            let Some(sigmas) = self.raised(shape, least, choice, RAISES) else {
                return best.map(|(_, found)| found);
            };
            let matrix = self.matrix(shape, &sigmas, correlations);
            let Some(cholesky) = matrix.cholesky() else { continue };
            let volume = cholesky.determinant();
            if best.as_ref().is_some_and(|(smallest, _)| volume >= *smallest) || !covers(&matrix, wanted) {
                continue;
            }
            let correlations = correlations.to_vec();
            best = Some((volume, Covering { sigmas, correlations }));
        }
        best.map(|(_, found)| found)
    }

    pub(super) fn write(
        &self,
        writer: &mut BitWriter,
        shape: &Shape,
        codes: &Covering,
    ) -> Result<(), PacketError> {
        for (group, code) in shape.sigmas.iter().zip(&codes.sigmas) {
            let field = self.field(group[0]);
            writer.push(field.name, u64::from(*code), field.bits)?;
        }
        codes.correlations.iter().try_for_each(|code| push_signed(writer, *code, self.correlation))
    }

    pub(super) fn read(&self, reader: &mut BitReader, shape: &Shape) -> Result<NodeMatrix, PacketError> {
        let mut sigmas = Vec::with_capacity(4);
        for group in shape.sigmas {
            let field = self.field(group[0]);
            sigmas.push(reader.take(field.name, field.bits)? as u32);
        }
        let correlations = shape
            .correlations
            .iter()
            .map(|_| take_signed(reader, self.correlation))
            .collect::<Result<Vec<_>, _>>()?;
        let matrix = self.matrix(shape, &sigmas, &correlations);
        if matrix.cholesky().is_none() {
            return Err(PacketError::NotPositiveDefinite { field: "covariance" });
        }
        Ok(matrix)
    }
}

const SIGNED: &str = "signed entry";

pub(super) fn push_signed(writer: &mut BitWriter, code: i64, bits: u32) -> Result<(), PacketError> {
    writer.push(SIGNED, code as u64 & (u64::MAX >> (64 - bits)), bits)
}

pub(super) fn take_signed(reader: &mut BitReader, bits: u32) -> Result<i64, PacketError> {
    Ok(sign_extend(reader.take(SIGNED, bits)?, bits))
}

fn covers(matrix: &NodeMatrix, wanted: &NodeMatrix) -> bool {
    symmetrized(&(matrix - wanted)).symmetric_eigenvalues().min() >= 0.0
}

/// Codes of a matrix' entries, to whole multiples of `scale / (last + ½)`.
pub(super) fn entry_codes(shape: &Shape, bits: u32, scale: f64, matrix: &NodeMatrix) -> Vec<i64> {
    let last = f64::from((1u32 << (bits - 1)) - 1);
    let code = |value: f64| (value / scale * (last + 0.5)).round().clamp(-last, last) as i64;
    shape.entries.iter().map(|group| code(matrix[group[0]])).collect()
}

/// What codes of entries decode to.
pub(super) fn entries_of(shape: &Shape, bits: u32, scale: f64, codes: &[i64]) -> NodeMatrix {
    let last = f64::from((1u32 << (bits - 1)) - 1);
    let mut matrix = NodeMatrix::zeros();
    for (group, code) in shape.entries.iter().zip(codes) {
        let value = *code as f64 / (last + 0.5) * scale;
        group.iter().for_each(|at| matrix[*at] = value);
    }
    matrix
}

/// Entries of a matrix of norm at most 1, taken down until it is one when rounded.
pub(super) fn write_entries(
    writer: &mut BitWriter,
    shape: &Shape,
    bits: u32,
    scale: f64,
    matrix: &NodeMatrix,
) -> Result<(), PacketError> {
    let last = f64::from((1u32 << (bits - 1)) - 1);
    let mut factor = 1.0;
    let mut codes = entry_codes(shape, bits, scale, matrix);
    while entries_of(shape, bits, scale, &codes).singular_values().max() > 1.0 && factor > 0.5 {
        factor -= 0.5 / last;
        codes = entry_codes(shape, bits, scale, &(matrix * factor));
    }
    codes.iter().try_for_each(|code| push_signed(writer, *code, bits))
}

pub(super) fn read_entries(
    reader: &mut BitReader,
    shape: &Shape,
    bits: u32,
    scale: f64,
) -> Result<NodeMatrix, PacketError> {
    let codes = shape.entries.iter().map(|_| take_signed(reader, bits));
    Ok(entries_of(shape, bits, scale, &codes.collect::<Result<Vec<_>, _>>()?))
}

/// How far x and y may differ, or be coupled, for the isotropic form, relative.
const ISOTROPIC: f64 = 1e-6;

/// Refuses what one number for x and y cannot say.
pub(super) fn check_isotropic(matrix: &NodeMatrix) -> Result<(), PacketError> {
    let scale = |r: usize, c: usize| {
        let diagonal =
            |k: usize| (0..4).map(|j| matrix[(k, j)].abs().max(matrix[(j, k)].abs())).fold(0.0, f64::max);
        ISOTROPIC * diagonal(r).max(diagonal(c)).max(f64::MIN_POSITIVE)
    };
    for (r, c) in [(0, 0), (0, 2), (2, 0), (2, 2)] {
        let apart = (matrix[(r, c)] - matrix[(r + 1, c + 1)]).abs();
        let coupled = matrix[(r, c + 1)].abs().max(matrix[(r + 1, c)].abs());
        if apart.max(coupled) > scale(r, c) {
            return Err(PacketError::NotIsotropic { apart: apart.max(coupled) });
        }
    }
    Ok(())
}

/// The Cholesky factor L of a covariance L Lᵀ.
pub(super) fn root_of(covariance: &NodeMatrix) -> Result<NodeMatrix, PacketError> {
    let cholesky = symmetrized(covariance).cholesky();
    Ok(cholesky.ok_or(PacketError::NotPositiveDefinite { field: "covariance" })?.l())
}
