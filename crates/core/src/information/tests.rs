//! Properties of the information algebra.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests fail by panicking")]

use nalgebra::{DMatrix, DVector, Matrix2, SMatrix, Vector2};
use proptest::prelude::*;

use super::chain::joint_of;
use super::graph_packet::{GraphPacket, Lag, OriginCorrelation};
use super::replica::{Method, Methods, NODES_MAX, Replica};
use super::*;

const Q: f64 = 1e-4;

/// A ship with GPS: its graph, launches `step_s` apart, and its filter; fixes from a small generator.
struct Ship {
    state: Gaussian<NODE>,
    since: GraphStep,
    chain: Chain,
    seed: u64,
}

impl Ship {
    fn new(seed: u64) -> Self {
        let mean = NodeVector::new(118.0, -58.0, 0.1, 0.0);
        let covariance = NodeMatrix::from_diagonal(&NodeVector::new(9.0, 9.0, 0.25, 0.25));
        Self { state: Gaussian { mean, covariance }, since: GraphStep::identity(), chain: Chain::new(), seed }
    }

    fn draw(&mut self) -> f64 {
        self.seed = self.seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.seed >> 33) as f64 / (1u64 << 31) as f64 - 0.5) * 10.0
    }

    fn second(&mut self) {
        let (f, q) = (process::transition(1.0), process::noise(1.0, Q));
        let z = Vector2::new(118.0 + self.draw(), -58.0 + self.draw());
        let (h, r) = (SMatrix::<f64, 2, 4>::identity(), Matrix2::identity() * 9.0);
        self.state.predict(&f, &q);
        self.state.update(&h, &z, &r).unwrap();
        self.since.predict(&f, &q);
        self.since.update(&h, &z, &r).unwrap();
    }

    fn launch(&mut self, id: u64, step_s: usize) {
        (0..step_s).for_each(|_| self.second());
        self.chain.push(self.since, Node { id, tol_ns: id as i64, filtered: self.state });
        self.since = GraphStep::identity();
    }

    fn packet(&self, origin: u64, lags: usize) -> GraphPacket {
        let node = *self.chain.newest().unwrap();
        let last = self.chain.nodes().len() - 1;
        let joint = |id: u64| self.chain.joint_marginal(self.chain.place(id).unwrap(), last).unwrap();
        let tie = if origin == node.id {
            OriginCorrelation::Begin
        } else {
            OriginCorrelation::Joint(joint(origin))
        };
        let lags = (origin + 1..node.id).rev().take(lags).map(|id| (id, Lag::Joint(joint(id)))).collect();
        GraphPacket { node, origin, tie, lags }
    }
}

fn relative(found: &(DMatrix<f64>, DVector<f64>), expected: &(DMatrix<f64>, DVector<f64>)) -> f64 {
    let matrix = (&found.0 - &expected.0).norm() / expected.0.norm();
    matrix.max((&found.1 - &expected.1).norm() / expected.1.norm())
}

const METHODS: Methods = Methods { joint: true, lags: 1, equation_6: true, loss_max: 1e-4 };

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Whatever is lost, the origin's own packet included, the graph rebuilt is the true one with lost nodes
    /// marginalised out; the origin shifts by acknowledgements that are lost as well.
    #[test]
    fn a_rebuilt_graph_is_the_true_one(
        received in proptest::collection::vec(proptest::bool::weighted(0.7), 24),
        acknowledged in proptest::collection::vec(proptest::bool::weighted(0.5), 24),
        step_s in 8usize..16,
        lags in 0usize..3,
        seed in any::<u64>(),
    ) {
        let (mut ship, mut replica) = (Ship::new(seed), Replica::new(false));
        let (mut origin, mut held) = (0, Vec::new());
        for (id, got) in received.iter().enumerate() {
            let id = id as u64;
            ship.launch(id, step_s);
            let packet = ship.packet(origin, lags);
            if *got {
                let plan = replica.plan(&packet, &METHODS).unwrap().expect("a known origin");
                prop_assert!(plan.method != Method::FilteredError || id - origin > 10, "{:?}", plan.method);
                replica.commit(&plan);
                if plan.method == Method::FilteredError { return Ok(()); }
                if held.is_empty() && id != origin { held.push(origin); }
                held.push(id);
                if acknowledged[id as usize] { origin = id; }
            }
        }
        let Some(first) = replica.chain().nodes().first() else { return Ok(()) };
        let mut truth = ship.chain.clone();
        truth.forget_before(first.id);
        let lost: Vec<u64> =
            truth.nodes().iter().map(|node| node.id).filter(|id| !held.contains(id)).collect();
        for id in lost {
            truth.marginalize(truth.place(id).unwrap()).unwrap();
        }
        let ids = |chain: &Chain| chain.nodes().iter().map(|node| node.id).collect::<Vec<_>>();
        // After the last node that arrived, nothing can be known.
        let last = *ids(replica.chain()).last().unwrap();
        prop_assert_eq!(ids(replica.chain()), ids(&truth).into_iter().filter(|id| *id <= last).collect::<Vec<_>>());
        let off = relative(&replica.chain().information().unwrap(), &truth.information().unwrap());
        prop_assert!(off < 1e-8, "relative difference {off:e}");
    }

    /// Composing steps is marginalising the node between them, as the dense Schur complement has it.
    #[test]
    fn composing_steps_is_schur(seed in any::<u64>(), first in 2usize..20, second in 2usize..20) {
        let mut ship = Ship::new(seed);
        ship.launch(0, 5);
        ship.launch(1, first);
        ship.launch(2, second);
        let (matrix, vector) = ship.chain.information().unwrap();
        let keep = [0, 1, 2, 3, 8, 9, 10, 11];
        let flat: Vec<f64> = matrix.transpose().iter().copied().collect();
        let (stays, told) = dense::marginalize(&flat, vector.as_slice(), &keep).unwrap();
        let joint = ship.chain.joint_marginal(0, 2).unwrap();
        let expected = SMatrix::<f64, 8, 8>::from_row_slice(&stays);
        prop_assert!((joint.matrix - expected).norm() / expected.norm() < 1e-10);
        prop_assert!((joint.vector - DVector::from_vec(told)).norm() / joint.vector.norm() < 1e-10);
    }

    /// A step to its information and back.
    #[test]
    fn a_step_survives_its_information_form(seed in any::<u64>(), length in 3usize..30) {
        let mut ship = Ship::new(seed);
        ship.launch(0, 5);
        ship.launch(1, length);
        let step = ship.chain.between(0, 1).unwrap();
        let earlier = ship.chain.nodes()[0].filtered;
        let back = GraphStep::from_information(&step.information().unwrap(), &earlier).unwrap();
        let moved = back.apply(&earlier).unwrap();
        let expected = ship.chain.nodes()[1].filtered;
        prop_assert!((moved.mean - expected.mean).norm() < 1e-8);
        prop_assert!((moved.covariance - expected.covariance).norm() < 1e-9);
    }
}

#[test]
fn predicting_information_is_predicting_moments() {
    let mut moments = Ship::new(1).state;
    let mut information = moments.information().unwrap();
    // Singular noise: it could not be inverted.
    let (f, mut q) = (process::transition(3.0), process::noise(3.0, Q));
    q.row_mut(1).fill(0.0);
    q.column_mut(1).fill(0.0);
    moments.predict(&f, &q);
    information.predict(&f, &q).unwrap();
    let back = information.gaussian().unwrap();
    assert!((back.mean - moments.mean).norm() < 1e-10);
    assert!((back.covariance - moments.covariance).norm() < 1e-10);
}

#[test]
fn an_unknown_origin_and_old_packets_are_not_joined() {
    let (mut ship, mut replica) = (Ship::new(3), Replica::new(false));
    for id in 0..3 {
        ship.launch(id, 10);
        let plan = replica.plan(&ship.packet(0, 2), &METHODS).unwrap().unwrap();
        replica.commit(&plan);
    }
    let again = ship.packet(0, 2);
    assert_eq!(replica.plan(&again, &METHODS).unwrap(), None);
    (3..6).for_each(|id| ship.launch(id, 10));
    // Node 4 is not held: nothing can be made of a graph that starts there.
    let unknown = ship.packet(4, 0);
    assert_eq!(replica.plan(&unknown, &METHODS).unwrap(), None);
}

#[test]
fn an_indefinite_packet_is_refused() {
    let (mut ship, mut replica) = (Ship::new(4), Replica::new(false));
    ship.launch(0, 10);
    replica.commit(&replica.plan(&ship.packet(0, 0), &METHODS).unwrap().unwrap());
    ship.launch(1, 10);
    let mut packet = ship.packet(0, 0);
    let OriginCorrelation::Joint(joint) = &mut packet.tie else { panic!("the second packet has an origin") };
    joint.matrix[(0, 0)] = -1.0;
    let before = replica.clone();
    assert!(replica.plan(&packet, &METHODS).is_err());
    assert_eq!(replica, before);
}

#[test]
fn memory_is_bounded() {
    let (mut ship, mut replica) = (Ship::new(5), Replica::new(false));
    for id in 0..3 * NODES_MAX as u64 {
        ship.launch(id, 5);
        ship.chain.bound(NODES_MAX).unwrap();
        // No acknowledgement ever gets through: the origin stays.
        let plan = replica.plan(&ship.packet(0, 2), &METHODS).unwrap().unwrap();
        replica.commit(&plan);
        assert!(ship.chain.nodes().len() <= NODES_MAX && replica.chain().nodes().len() <= NODES_MAX);
    }
    assert_eq!(replica.chain().nodes().len(), NODES_MAX);
    assert_eq!(replica.chain().nodes()[0].id, 0, "the origin is kept");
}

#[test]
fn a_joint_in_both_forms_agrees() {
    let mut ship = Ship::new(6);
    ship.launch(0, 10);
    ship.launch(1, 10);
    let step = ship.chain.between(0, 1).unwrap();
    let earlier = ship.chain.nodes()[0].filtered;
    let mut joint = Joint::new();
    joint.push(&earlier);
    joint.push_copy(0);
    step.apply_to(&mut joint, 1).unwrap();
    let expected = joint_of(&earlier, &step).unwrap().gaussian().unwrap();
    let mean = joint.node_mean(1) - expected.mean.fixed_rows::<4>(0);
    assert!(mean.norm() < 1e-9, "{mean}");
    assert!((joint.block(0, 0) - expected.covariance.fixed_view::<4, 4>(4, 4)).norm() < 1e-9);
    assert!((joint.block(1, 0) - expected.covariance.fixed_view::<4, 4>(0, 4)).norm() < 1e-9);
    joint.remove(0);
    assert_eq!(joint.nodes(), 1);
}
