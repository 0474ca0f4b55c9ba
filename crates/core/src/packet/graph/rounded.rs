//! Pose graphs as packets: rounded forms that never understate the covariance.
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
//! | each: sigmas of A; correlations of A; shift; K | | 4 × 12, 6 × 10, 4 × 16, 16 × 13 | 2 × 7, 6, 4 × 7, 4 × 7 |
//! | and its noise N: sigmas, correlations | 1/64 octave, 1/511.5 | 4 × 10, 6 × 10 | |
//!
//! P̂ = L̂ L̂ᵀ from sigmas and correlations covers the node's P, the rounding of the mean included: sigmas are
//! raised, by as little volume as possible, until P̂ − P is positive semi-definite. M = L̂⁻¹ Φ L̂₀ is the scaled
//! transition of the filtered error from the origin to the node; its norm is kept at 1 or below. Exact lags are
//! covered by `lag`. The isotropic form holds one number for x and y.

use super::form::GraphForm;
use super::lag::{LagWidths, Later};
use super::origin_field::{decoded_lag_ids, read_origin, write_origin};
use crate::information::graph_packet::{GraphPacket, Lag, OriginCorrelation};
use crate::information::{Gaussian, GraphStep, Node, NodeMatrix, NodeVector, symmetrized};
use crate::packet::covering::{
    Covering, GENERAL, ISOTROPE, Scale, Shape, check_isotropic, read_entries, root_of, write_entries,
};
use crate::packet::field::{FixedField, Rounding};
use crate::packet::{BitReader, BitWriter, PacketError, SigmaField, UnsignedField};

/// How many codes the node's sigmas are raised at most for an exact lag's sake.
const NODE_RAISES: u32 = 3;

/// Widths of one form.
struct Widths {
    shape: &'static Shape,
    position: u32,
    velocity: u32,
    covariance: Scale,
    exponent: u32,
    lag_count: u32,
    lag: LagWidths,
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
            lag: LagWidths {
                shape: &ISOTROPE,
                smoothed: Scale {
                    position: sigma("smoothed sigma of position", "", 7, 30, -4),
                    velocity: sigma("smoothed sigma of velocity", "", 7, 30, -4),
                    correlation: 6,
                },
                shift: fixed(SHIFT, "", 7, 20.0),
                transition: 7,
                largest: 1.0,
                noise: None,
            },
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
            lag: LagWidths {
                shape: &GENERAL,
                smoothed: Scale {
                    position: sigma("smoothed sigma of position", "", 12, 512, -7),
                    velocity: sigma("smoothed sigma of velocity", "", 12, 512, -7),
                    correlation: 10,
                },
                shift: fixed(SHIFT, "", 16, 4096.0),
                transition: 13,
                largest: 2.0,
                noise: Some(Scale {
                    position: sigma("sigma of the step's position", "", 10, 64, -14),
                    velocity: sigma("sigma of the step's velocity", "", 10, 64, -14),
                    correlation: 10,
                }),
            },
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

const MEAN: [&str; 4] = ["mean easting", "mean northing", "mean velocity east", "mean velocity north"];

impl Widths {
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
            check_isotropic(&node.covariance)?;
            // One number stands for both axes: the rounding of the mean is covered at its largest.
            let widest = NodeVector::new(0.005, 0.005, 0.001, 0.001);
            let wanted = node.covariance + NodeMatrix::from_diagonal(&(widest.component_mul(&widest) * 2.0));
            return self.covered(mean, &symmetrized(&wanted));
        }
        self.covered(mean, &wanted)
    }

    /// Exact lags as far as they fit. They are identified by their order: after one that does not fit there are none,
    /// and the receiver uses the filtered-error model.
    fn lags(&self, unrounded: &UnroundedPacket, sent: &Gaussian<4>) -> Result<Vec<(u64, Lag)>, PacketError> {
        let back = inverse_root_of(&sent.covariance)?;
        let later = Later { back: &back, off: back * (unrounded.node.filtered.mean - sent.mean) };
        let mut lags = Vec::with_capacity(unrounded.lags.len());
        for (id, earlier, step) in &unrounded.lags {
            let Some(lag) = self.lag.round(earlier, &later, step)? else { break };
            lags.push((*id, Lag::Rounded(lag)));
        }
        Ok(lags)
    }

    fn covered(&self, mean: NodeVector, wanted: &NodeMatrix) -> Result<(Gaussian<4>, Covering), PacketError> {
        let codes = self.covariance.cover(self.shape, wanted)?;
        let covariance = self.covariance.matrix(self.shape, &codes.sigmas, &codes.correlations);
        Ok((Gaussian { mean, covariance }, codes))
    }
}

/// The content of a sender's packet before rounding.
pub struct UnroundedPacket {
    /// The node.
    pub node: Node,
    /// The origin as it was sent, and Φ from it to the node; none: the node is the origin.
    pub origin: Option<(u64, Gaussian<4>, NodeMatrix)>,
    /// Earlier nodes as they were sent, newest first, with the step to this one.
    pub lags: Vec<(u64, Gaussian<4>, GraphStep)>,
}

/// A sender's packet, rounded: exactly what a receiver will decode, M left to be rounded when it is written.
///
/// # Errors
/// [`PacketError`] naming what does not fit, [`PacketError::NotIsotropic`].
pub fn rounded(unrounded: &UnroundedPacket, form: GraphForm) -> Result<GraphPacket, PacketError> {
    let w = widths(form);
    let (mut filtered, codes) = w.round(&unrounded.node.filtered)?;
    let mut lags = w.lags(unrounded, &filtered)?;
    for raise in 1..=NODE_RAISES {
        if lags.len() == unrounded.lags.len() {
            break;
        }
        // If no code bounds an exact lag, the node's own sigmas are raised a little.
        let sigmas: Vec<u32> = codes.sigmas.iter().map(|code| code + raise).collect();
        if w.shape
            .sigmas
            .iter()
            .zip(&sigmas)
            .any(|(group, code)| *code >> w.covariance.field(group[0]).bits > 0)
        {
            break;
        }
        let covariance = w.covariance.matrix(w.shape, &sigmas, &codes.correlations);
        let raised = Gaussian { covariance, ..filtered };
        let found = w.lags(unrounded, &raised)?;
        if found.len() > lags.len() {
            (filtered, lags) = (raised, found);
        }
    }
    let (origin, tie) = match &unrounded.origin {
        None => (unrounded.node.id, OriginCorrelation::Begin),
        Some((origin, known, transition)) => {
            if w.shape.sigmas.len() == 2 {
                check_isotropic(transition)?;
            }
            let back = inverse_root_of(&filtered.covariance)?;
            (*origin, OriginCorrelation::Correlation(back * transition * root_of(&known.covariance)?))
        }
    };
    Ok(GraphPacket { node: Node { filtered, ..unrounded.node }, origin, tie, lags })
}

fn inverse_root_of(covariance: &NodeMatrix) -> Result<NodeMatrix, PacketError> {
    root_of(covariance)?.try_inverse().ok_or(PacketError::NotPositiveDefinite { field: "covariance" })
}

/// Writes a packet that [`rounded`] made; M is rounded here.
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
    if let OriginCorrelation::Correlation(matrix) = &graph.tie {
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
        w.lag.write(writer, lag)?;
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
        return Ok(GraphPacket { node, origin, tie: OriginCorrelation::Begin, lags: Vec::new() });
    }
    let exponent = reader.take("exponent of M", w.exponent)? as u32;
    let entries = read_entries(reader, w.shape, 8, scale_of(exponent))?;
    let tie = OriginCorrelation::Correlation(root_of(&covariance)? * entries);
    let mut lags = Vec::new();
    if w.lag_count > 0 {
        let count = lag_count(w.lag_count).read(reader)?;
        for lag in decoded_lag_ids("exact lags", id, begin, count)? {
            lags.push((lag, Lag::Rounded(w.lag.read(reader)?)));
        }
    }
    Ok(GraphPacket { node, origin, tie, lags })
}
