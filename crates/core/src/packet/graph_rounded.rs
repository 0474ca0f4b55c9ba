//! Pose graphs as packets: rounded forms that never claim more than was sent.
//!
//! | field | step | 64 and 256 bytes | 32 bytes |
//! |---|---|---|---|
//! | whether the node is the origin; the origin's sequence | | 1 + 8 bits | 1 + 8 |
//! | mean position | 0.01 m | 2 × 23 | 2 × 20 |
//! | mean velocity | 0.002 m/s | 2 × 16 | 2 × 12 |
//! | sigmas, rounded up | 1/64 octave | 4 × 10 | 2 × 9 |
//! | correlations | 1/127.5 | 6 × 8 | 1 × 8 |
//! | M: exponent of two, entries | 1/127.5 of it | 7 + 16 × 8 | 6 + 4 × 8 |
//! | how many exact lags | | 4 (256 bytes alone) | 1 |
//! | each: sigmas of A; correlations of A; shift; K | | 4 × 12, 6 × 10, 4 × 12, 16 × 12 | 2 × 7, 6, 4 × 7, 4 × 7 |
//!
//! P̂ = L̂ L̂ᵀ from sigmas and correlations covers the node's P, the rounding of the mean included: sigmas are raised,
//! by as little volume as possible, until P̂ − P is positive semi-definite. M = L̂⁻¹ Φ L̂₀ is how the filtered error at
//! the origin lives on in the node's; its norm is kept at 1 or below. An exact lag is told in the earlier node's own
//! scale L̂₂: A, the covariance that smoothing leaves of it, covered as P is (so smoothing is rounded down); the shift of
//! its mean; and K = L̂⁻¹ Φ L₂'. The isotropic form holds one number for x and y.

use super::field::{FixedField, Rounding, sign_extend};
use super::graph::{GraphForm, read_origin, rounded_lag_ids, write_origin};
use super::{BitReader, BitWriter, PacketError, SigmaField, UnsignedField};
use crate::information::replica::{GraphPacket, Lag, RoundedLag, Tie};
use crate::information::{Gaussian, Node, NodeMatrix, NodeVector, symmetrized};

/// Sigmas are raised by so many codes at most, each, in the search for the least covering volume.
const RAISES: u32 = 2;
/// How far x and y may differ, or be coupled, for the isotropic form, relative.
const ISOTROPIC: f64 = 1e-6;

/// Which numbers share a field.
struct Shape {
    sigmas: &'static [&'static [usize]],
    correlations: &'static [&'static [(usize, usize)]],
    entries: &'static [&'static [(usize, usize)]],
}

const GENERAL: Shape = Shape {
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
const ISOTROPE: Shape = Shape {
    sigmas: &[&[0, 1], &[2, 3]],
    correlations: &[&[(0, 2), (1, 3)]],
    entries: &[&[(0, 0), (1, 1)], &[(0, 2), (1, 3)], &[(2, 0), (3, 1)], &[(2, 2), (3, 3)]],
};

/// Widths of one form.
struct Widths {
    shape: &'static Shape,
    position: u32,
    velocity: u32,
    covariance: Scale,
    exponent: u32,
    lag_count: u32,
    lag: Scale,
    shift: FixedField,
    transition: u32,
}

/// How a covariance is coded.
struct Scale {
    position: SigmaField,
    velocity: SigmaField,
    correlation: u32,
}

const fn sigma(
    name: &'static str,
    unit: &'static str,
    bits: u32,
    steps: u32,
    lowest_log2: i32,
) -> SigmaField {
    SigmaField { name, unit, bits, steps_per_octave: steps, lowest_log2 }
}

const SHIFT: &str = "shift of the earlier mean";

const fn widths(form: GraphForm) -> Widths {
    match form {
        GraphForm::Frame32 => Widths {
            shape: &ISOTROPE,
            position: 20,
            velocity: 12,
            covariance: Scale {
                position: sigma("sigma of position", "m", 9, 64, -3),
                velocity: sigma("sigma of velocity", "m/s", 9, 64, -7),
                correlation: 8,
            },
            exponent: 6,
            lag_count: 1,
            lag: Scale {
                position: sigma("smoothed sigma of position", "", 7, 30, -4),
                velocity: sigma("smoothed sigma of velocity", "", 7, 30, -4),
                correlation: 6,
            },
            shift: fixed(SHIFT, "", 7, 20.0),
            transition: 7,
        },
        _ => Widths {
            shape: &GENERAL,
            position: 23,
            velocity: 16,
            covariance: Scale {
                position: sigma("sigma of position", "m", 10, 64, -8),
                velocity: sigma("sigma of velocity", "m/s", 10, 64, -12),
                correlation: 8,
            },
            exponent: 7,
            lag_count: if matches!(form, GraphForm::Frame256) { 4 } else { 0 },
            lag: Scale {
                position: sigma("smoothed sigma of position", "", 12, 512, -7),
                velocity: sigma("smoothed sigma of velocity", "", 12, 512, -7),
                correlation: 10,
            },
            shift: fixed(SHIFT, "", 12, 256.0),
            transition: 12,
        },
    }
}

const fn fixed(name: &'static str, unit: &'static str, bits: u32, steps_per_unit: f64) -> FixedField {
    FixedField { name, unit, bits, steps_per_unit, signed: true, rounding: Rounding::Nearest }
}

/// How many exact lags a packet of this form holds, by the frame.
#[must_use]
pub fn rounded_lags(form: GraphForm) -> usize {
    match form {
        GraphForm::Frame32 => 1,
        GraphForm::Frame256 => 3,
        GraphForm::F64 | GraphForm::Frame64 => 0,
    }
}

/// Bits of a node in a rounded packet: mean, sigmas, correlations, and M where it is not the origin.
#[must_use]
pub fn node_bits(form: GraphForm, begin: bool) -> u32 {
    let w = widths(form);
    let mean = 2 * (w.position + w.velocity);
    let sigmas: u32 = w.shape.sigmas.iter().map(|group| w.covariance.field(group[0]).bits).sum();
    let correlations = w.shape.correlations.len() as u32 * w.covariance.correlation;
    let tie = if begin { 0 } else { w.exponent + 8 * w.shape.entries.len() as u32 };
    mean + sigmas + correlations + tie
}

/// A covariance's codes and what they decode to.
struct Covering {
    sigmas: Vec<u32>,
    correlations: Vec<i64>,
    root: NodeMatrix,
}

impl Scale {
    fn field(&self, entry: usize) -> &SigmaField {
        if entry < 2 { &self.position } else { &self.velocity }
    }

    fn last_correlation(&self) -> f64 {
        f64::from((1u32 << (self.correlation - 1)) - 1)
    }

    /// Steps of a correlation: half a step short of 1 at the last code.
    fn correlation_steps(&self) -> f64 {
        self.last_correlation() + 0.5
    }

    fn matrix(&self, shape: &Shape, sigmas: &[u32], correlations: &[i64]) -> NodeMatrix {
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
    fn cover(&self, shape: &Shape, wanted: &NodeMatrix) -> Result<Covering, PacketError> {
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
    fn codes_of(&self, shape: &Shape, matrix: &NodeMatrix) -> Covering {
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
        Covering { sigmas: sigmas.collect(), correlations: correlations.collect(), root: NodeMatrix::zeros() }
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
            let mut left = choice;
            let mut sigmas = least.to_vec();
            for (group, code) in shape.sigmas.iter().zip(&mut sigmas) {
                *code += left % (RAISES + 1);
                left /= RAISES + 1;
                if *code >= 1 << self.field(group[0]).bits {
                    return best.map(|(_, found)| found);
                }
            }
            let matrix = self.matrix(shape, &sigmas, correlations);
            let Some(cholesky) = matrix.cholesky() else { continue };
            let volume = cholesky.determinant();
            if best.as_ref().is_some_and(|(smallest, _)| volume >= *smallest) || !covers(&matrix, wanted) {
                continue;
            }
            let correlations = correlations.to_vec();
            best = Some((volume, Covering { sigmas, correlations, root: cholesky.l() }));
        }
        best.map(|(_, found)| found)
    }

    fn write(&self, writer: &mut BitWriter, shape: &Shape, codes: &Covering) -> Result<(), PacketError> {
        for (group, code) in shape.sigmas.iter().zip(&codes.sigmas) {
            let field = self.field(group[0]);
            writer.push(field.name, u64::from(*code), field.bits)?;
        }
        codes.correlations.iter().try_for_each(|code| push_signed(writer, *code, self.correlation))
    }

    fn read(&self, reader: &mut BitReader, shape: &Shape) -> Result<NodeMatrix, PacketError> {
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

fn push_signed(writer: &mut BitWriter, code: i64, bits: u32) -> Result<(), PacketError> {
    writer.push(SIGNED, code as u64 & (u64::MAX >> (64 - bits)), bits)
}

fn take_signed(reader: &mut BitReader, bits: u32) -> Result<i64, PacketError> {
    Ok(sign_extend(reader.take(SIGNED, bits)?, bits))
}

fn covers(matrix: &NodeMatrix, wanted: &NodeMatrix) -> bool {
    symmetrized(&(matrix - wanted)).symmetric_eigenvalues().min() >= 0.0
}

/// Entries of norm at most 1, to whole multiples of `scale / (last + ½)`.
fn write_entries(
    writer: &mut BitWriter,
    shape: &Shape,
    bits: u32,
    scale: f64,
    matrix: &NodeMatrix,
) -> Result<NodeMatrix, PacketError> {
    let last = f64::from((1u32 << (bits - 1)) - 1);
    let code = |value: f64| (value / scale * (last + 0.5)).round().clamp(-last, last);
    let decoded = |factor: f64| {
        let mut rounded = NodeMatrix::zeros();
        for group in shape.entries {
            let value = code(matrix[group[0]] * factor) / (last + 0.5) * scale;
            group.iter().for_each(|at| rounded[*at] = value);
        }
        rounded
    };
    let mut factor = 1.0;
    let mut rounded = decoded(factor);
    while rounded.singular_values().max() > 1.0 && factor > 0.5 {
        factor -= 0.5 / last;
        rounded = decoded(factor);
    }
    for group in shape.entries {
        push_signed(writer, code(matrix[group[0]] * factor) as i64, bits)?;
    }
    Ok(rounded)
}

fn read_entries(
    reader: &mut BitReader,
    shape: &Shape,
    bits: u32,
    scale: f64,
) -> Result<NodeMatrix, PacketError> {
    let last = f64::from((1u32 << (bits - 1)) - 1);
    let mut matrix = NodeMatrix::zeros();
    for group in shape.entries {
        let value = take_signed(reader, bits)? as f64 / (last + 0.5) * scale;
        group.iter().for_each(|at| matrix[*at] = value);
    }
    Ok(matrix)
}

const MEAN: [&str; 4] = ["mean easting", "mean northing", "mean velocity east", "mean velocity north"];

impl Widths {
    /// How far an earlier mean may have moved, in its own sigmas.
    fn most_shift(&self) -> f64 {
        self.shift.decode((1 << (self.shift.bits - 1)) - 1)
    }

    fn mean(&self, entry: usize) -> FixedField {
        if entry < 2 {
            fixed(MEAN[entry], "m", self.position, 100.0)
        } else {
            fixed(MEAN[entry], "m/s", self.velocity, 500.0)
        }
    }

    /// The node as it will be read: mean to whole steps, covariance covering it.
    fn round(&self, node: &Gaussian<4>) -> Result<(Gaussian<4>, Covering), PacketError> {
        let mut mean = NodeVector::zeros();
        for entry in 0..4 {
            let field = self.mean(entry);
            mean[entry] = field.decode(field.encode(node.mean[entry])?);
        }
        let off = node.mean - mean;
        let wanted = symmetrized(&(node.covariance + off * off.transpose()));
        if self.shape.sigmas.len() == 2 {
            isotropic(&node.covariance)?;
            // One number stands for both axes: the rounding of the mean is covered at its largest.
            let widest = NodeVector::new(0.005, 0.005, 0.001, 0.001);
            let wanted = node.covariance + NodeMatrix::from_diagonal(&(widest.component_mul(&widest) * 2.0));
            return self.covered(mean, &symmetrized(&wanted));
        }
        self.covered(mean, &wanted)
    }

    fn covered(&self, mean: NodeVector, wanted: &NodeMatrix) -> Result<(Gaussian<4>, Covering), PacketError> {
        let codes = self.covariance.cover(self.shape, wanted)?;
        let covariance = self.covariance.matrix(self.shape, &codes.sigmas, &codes.correlations);
        Ok((Gaussian { mean, covariance }, codes))
    }
}

/// Refuses what one number for x and y cannot say.
fn isotropic(matrix: &NodeMatrix) -> Result<(), PacketError> {
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

/// What a sender knows of a launch, before rounding.
pub struct Told {
    /// The node.
    pub node: Node,
    /// The origin as it was sent, and Φ from it to the node; none: the node is the origin.
    pub origin: Option<(u64, Gaussian<4>, NodeMatrix)>,
    /// Earlier nodes as they were sent, newest first, with the step to this one.
    pub lags: Vec<(u64, Gaussian<4>, crate::information::Step)>,
}

/// A sender's packet, rounded: exactly what a receiver will decode.
///
/// # Errors
/// [`PacketError`] naming what does not fit, [`PacketError::NotIsotropic`].
pub fn rounded(told: &Told, form: GraphForm) -> Result<GraphPacket, PacketError> {
    let w = widths(form);
    let (filtered, codes) = w.round(&told.node.filtered)?;
    let back = codes.root.try_inverse().ok_or(PacketError::NotPositiveDefinite { field: "covariance" })?;
    let mut lags = Vec::with_capacity(told.lags.len());
    let (origin, tie) = match &told.origin {
        None => (told.node.id, Tie::Begin),
        Some((origin, known, transition)) => {
            let root = root_of(&known.covariance)?;
            if w.shape.sigmas.len() == 2 {
                isotropic(transition)?;
            }
            (*origin, Tie::Correlation(back * transition * root))
        }
    };
    for (id, earlier, step) in &told.lags {
        let lag = round_lag(&w, earlier, &back, step)?;
        // Lags are told by their place: after one whose mean moved too far for its field there are none, and the
        // receiver has the filtered-error model.
        if lag.shift.iter().any(|value| value.abs() > w.most_shift()) {
            break;
        }
        lags.push((*id, Lag::Rounded(lag)));
    }
    Ok(GraphPacket { node: Node { filtered, ..told.node }, origin, tie, lags })
}

fn root_of(covariance: &NodeMatrix) -> Result<NodeMatrix, PacketError> {
    let cholesky = symmetrized(covariance).cholesky();
    Ok(cholesky.ok_or(PacketError::NotPositiveDefinite { field: "covariance" })?.l())
}

fn round_lag(
    w: &Widths,
    earlier: &Gaussian<4>,
    back: &NodeMatrix,
    step: &crate::information::Step,
) -> Result<RoundedLag, PacketError> {
    let singular = || PacketError::NotPositiveDefinite { field: "smoothed covariance" };
    let root = root_of(&earlier.covariance)?;
    let told = symmetrized(&(root.transpose() * step.told_matrix * root));
    if w.shape.sigmas.len() == 2 {
        isotropic(&told)?;
    }
    let exact = symmetrized(&(NodeMatrix::identity() + told).try_inverse().ok_or_else(singular)?);
    // In the earlier node's own scale: how far its mean moved.
    let shift = exact * root.transpose() * (step.told_vector - step.told_matrix * earlier.mean);
    let codes = w.lag.cover(w.shape, &exact)?;
    let smoothed = w.lag.matrix(w.shape, &codes.sigmas, &codes.correlations);
    Ok(RoundedLag { smoothed, shift, transition: back * step.transition * root * root_of(&smoothed)? })
}

/// Writes a packet that [`rounded`] made; M, K and shifts are rounded here.
pub(super) fn write_rounded(
    writer: &mut BitWriter,
    form: GraphForm,
    graph: &GraphPacket,
) -> Result<(), PacketError> {
    let w = widths(form);
    let begin = write_origin(writer, graph)?;
    for entry in 0..4 {
        w.mean(entry).write(writer, graph.node.filtered.mean[entry])?;
    }
    let codes = w.covariance.codes_of(w.shape, &graph.node.filtered.covariance);
    w.covariance.write(writer, w.shape, &codes)?;
    if let Tie::Correlation(matrix) = &graph.tie {
        let exponent = exponent_of(matrix, w.exponent);
        writer.push("exponent of M", u64::from(exponent), w.exponent)?;
        write_entries(writer, w.shape, 8, scale_of(exponent), matrix)?;
    }
    if begin || w.lag_count == 0 {
        return Ok(());
    }
    lag_count(w.lag_count).write(writer, graph.lags.len() as u64)?;
    for (_, lag) in &graph.lags {
        let Lag::Rounded(lag) = lag else {
            return Err(PacketError::InvalidCode { field: "lag of a rounded packet", code: 0 });
        };
        let codes = w.lag.codes_of(w.shape, &lag.smoothed);
        w.lag.write(writer, w.shape, &codes)?;
        let most = w.most_shift();
        for value in lag.shift.iter() {
            if value.abs() > most {
                return Err(PacketError::OutOfRange {
                    field: SHIFT,
                    unit: "sigma",
                    value: *value,
                    minimum: -most,
                    maximum: most,
                });
            }
            w.shift.write(writer, *value)?;
        }
        write_entries(writer, w.shape, w.transition, 1.0, &lag.transition)?;
    }
    Ok(())
}

const fn lag_count(bits: u32) -> UnsignedField {
    UnsignedField { name: "exact lags", bits }
}

/// The least power of two, as 2^−exponent, that M's entries stay within.
fn exponent_of(matrix: &NodeMatrix, bits: u32) -> u32 {
    let most = (1u32 << bits) - 1;
    let largest = matrix.amax();
    (0..most).rev().find(|exponent| largest <= scale_of(*exponent)).unwrap_or(0)
}

fn scale_of(exponent: u32) -> f64 {
    (-f64::from(exponent)).exp2()
}

pub(super) fn read_rounded(
    reader: &mut BitReader,
    form: GraphForm,
    id: u64,
    tol_ns: i64,
) -> Result<GraphPacket, PacketError> {
    let w = widths(form);
    let (begin, origin) = read_origin(reader, id)?;
    let mut mean = NodeVector::zeros();
    for entry in 0..4 {
        mean[entry] = w.mean(entry).read(reader)?;
    }
    let covariance = w.covariance.read(reader, w.shape)?;
    let node = Node { id, tol_ns, filtered: Gaussian { mean, covariance } };
    if begin {
        return Ok(GraphPacket { node, origin, tie: Tie::Begin, lags: Vec::new() });
    }
    let exponent = reader.take("exponent of M", w.exponent)? as u32;
    let entries = read_entries(reader, w.shape, 8, scale_of(exponent))?;
    let tie = Tie::Correlation(root_of(&covariance)? * entries);
    let mut lags = Vec::new();
    if w.lag_count > 0 {
        let count = lag_count(w.lag_count).read(reader)?;
        for lag in rounded_lag_ids(id, origin).take(count as usize) {
            lags.push((lag, Lag::Rounded(read_lag(reader, &w)?)));
        }
        if lags.len() as u64 != count {
            return Err(PacketError::InvalidCode { field: "exact lags", code: count });
        }
    }
    Ok(GraphPacket { node, origin, tie, lags })
}

fn read_lag(reader: &mut BitReader, w: &Widths) -> Result<RoundedLag, PacketError> {
    let smoothed = w.lag.read(reader, w.shape)?;
    let mut shift = NodeVector::zeros();
    for entry in 0..4 {
        shift[entry] = w.shift.read(reader)?;
    }
    Ok(RoundedLag { smoothed, shift, transition: read_entries(reader, w.shape, w.transition, 1.0)? })
}
