//! Exact lags through a whole packet.
#![allow(clippy::unwrap_used, clippy::panic, reason = "tests fail by panicking")]

use nalgebra::{SMatrix, SVector};
use proptest::prelude::*;

use super::lag::{SLACK, joint};
use super::rounded::{UnroundedPacket, rounded};
use super::{GraphForm, GraphLink, GraphMessage};
use crate::information::graph_packet::Lag;
use crate::information::{Gaussian, GraphStep, Node, NodeMatrix, NodeVector, process, symmetrized};

const DT_S: f64 = 0.5;

/// A vehicle with fixes of `sigma_fix` each second (0: none), and a DVL of sigmas along and across (0: none).
fn moved(
    state: &mut Gaussian<4>,
    seconds: u32,
    sigma_fix: f64,
    dvl: (f64, f64),
    q: f64,
    z: &[f64],
) -> GraphStep {
    let mut step = GraphStep::identity();
    let position = SMatrix::<f64, 2, 4>::identity();
    let mut velocity = SMatrix::<f64, 2, 4>::zeros();
    (velocity[(0, 2)], velocity[(1, 3)]) = (1.0, 1.0);
    for k in 0..2 * seconds as usize {
        let (f, noise) = (process::transition(DT_S), process::noise(DT_S, q));
        state.predict(&f, &noise);
        step.predict(&f, &noise);
        // In turns, so that nobody sails off the fields.
        let draw = |i: usize| z[(k / 2 + i) % z.len()] * if k % 4 < 2 { 1.0 } else { -1.0 };
        let mut fuse = |h: &SMatrix<f64, 2, 4>, sigmas: (f64, f64)| {
            let z = h * state.mean + SVector::<f64, 2>::new(draw(0) * sigmas.0, draw(1) * sigmas.1);
            let r = SMatrix::<f64, 2, 2>::new(sigmas.0.powi(2), 0.0, 0.0, sigmas.1.powi(2));
            state.update(h, &z, &r).unwrap();
            step.update(h, &z, &r).unwrap();
        };
        if sigma_fix > 0.0 && k % 2 == 1 {
            fuse(&position, (sigma_fix, sigma_fix));
        }
        if dvl.0 > 0.0 {
            fuse(&velocity, dvl);
        }
    }
    step
}

/// The joint covariance of (earlier, later) that a step from N(x₂, P₂) gives.
fn joint_from(prior: &NodeMatrix, step: &GraphStep) -> SMatrix<f64, 8, 8> {
    let smoothed = (prior.try_inverse().unwrap() + step.smoothing_matrix).try_inverse().unwrap();
    joint(&symmetrized(&smoothed), &step.transition, &step.noise)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    /// What a receiver decodes of an exact lag is never surer than what the sender knows, whatever sails.
    #[test]
    fn an_exact_lag_never_claims_more_than_is_known(
        gps in any::<bool>(),
        sigma in 0.3f64..10.0,
        along in 0.02f64..0.3,
        across in 1.0f64..4.0,
        seconds in 4u32..60,
        before in 0u32..200,
        q in 1e-5f64..1e-3,
        z in proptest::collection::vec(-1.5f64..1.5, 7),
    ) {
        let (form, fix, dvl) = if gps {
            (GraphForm::Frame32, sigma, (0.0, 0.0))
        } else {
            (GraphForm::Frame256, 0.0, (along, along * across))
        };
        let start = SVector::<f64, 4>::new(sigma * sigma, sigma * sigma, 1.0, 1.0);
        let mut state = Gaussian { mean: NodeVector::new(310.0, -92.0, 0.3, -0.2), covariance: NodeMatrix::from_diagonal(&start) };
        moved(&mut state, before, fix, dvl, q, &z);
        let first = Node { id: 0, tol_ns: 0, filtered: state };
        let sent = rounded(&UnroundedPacket { node: first, origin: None, lags: Vec::new() }, form).unwrap().node.filtered;
        let step = moved(&mut state, seconds, fix, dvl, q, &z);
        let unrounded = UnroundedPacket {
            node: Node { id: 1, tol_ns: 1, filtered: state },
            origin: Some((0, sent, step.transition)),
            lags: vec![(0, sent, step)],
        };
        let graph = rounded(&unrounded, form).unwrap();
        let link = GraphLink { form, sender: 0, tol_ns: 1, bitmaps: 0 };
        let message = GraphMessage { sequence: 1, depth_m: 0.0, bitmaps: Vec::new(), graph: Some(graph.clone()) };
        let bytes = message.encode(&link).unwrap();
        let frame = if gps { 32 } else { 256 };
        prop_assert!(bytes.len() <= frame);
        let decoded = GraphMessage::decode(&bytes, &link, None, None, u64::from).unwrap().graph.unwrap();
        prop_assert_eq!(&decoded.lags, &graph.lags);
        // Where no code is honest, no lag is sent.
        let Some((_, Lag::Rounded(lag))) = decoded.lags.first() else { return Ok(()) };
        let found = lag.step(&sent, &decoded.node.filtered).unwrap();
        let exact = joint_from(&sent.covariance, &step);
        let mut claimed = joint_from(&sent.covariance, &found);
        let earlier = claimed.fixed_view::<4, 4>(0, 0) * (1.0 + SLACK);
        claimed = joint(&earlier, &found.transition, &found.noise);
        let back = exact.cholesky().unwrap().l().try_inverse().unwrap();
        let excess = back * (claimed - exact) * back.transpose();
        let least = ((excess + excess.transpose()) * 0.5).symmetric_eigenvalues().min();
        prop_assert!(least > -1e-7, "least excess {least:e}");
    }
}

/// Codes are nearly always found: a packet without its lag costs a receiver more.
#[test]
fn a_ship_with_gps_tells_its_lag() {
    let z = [0.3, -1.1, 0.8, -0.2, 1.3, -0.7, 0.1];
    let start = SVector::<f64, 4>::new(9.0, 9.0, 1.0, 1.0);
    let mut state = Gaussian { mean: NodeVector::zeros(), covariance: NodeMatrix::from_diagonal(&start) };
    let (mut lag_count, mut sent): (usize, Option<Gaussian<4>>) = (0, None);
    for id in 0..40 {
        let step = moved(&mut state, 8 + id % 20, 3.0, (0.0, 0.0), 1e-4, &z);
        let node = Node { id: u64::from(id), tol_ns: 0, filtered: state };
        let origin = sent.map(|sent| (u64::from(id) - 1, sent, step.transition));
        let lags = sent.map(|sent| (u64::from(id) - 1, sent, step)).into_iter().collect();
        let graph = rounded(&UnroundedPacket { node, origin, lags }, GraphForm::Frame32).unwrap();
        lag_count += graph.lags.len();
        sent = Some(graph.node.filtered);
    }
    assert!(lag_count >= 37, "{lag_count} of 39");
}
