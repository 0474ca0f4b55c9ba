//! The pose graph of one vehicle: nodes at its launches, a step between neighbours.

use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

use super::{Gaussian, GraphStep, Information, NODE, NodeMatrix, NodeVector};
use crate::error::Error;

/// A node: the state at one launch.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Node {
    /// The packet counter of the launch.
    pub id: u64,
    /// The launch, ns.
    pub tol_ns: i64,
    /// What was known of it then: by everything before the launch and nothing after.
    pub filtered: Gaussian<NODE>,
}

/// A chain of nodes, oldest first. Its information matrix (newest first) is block-tridiagonal:
///
/// ```text
/// | Λ_nn      Λ_n,n−1                |
/// | Λ_n−1,n   Λ_n−1,n−1   …          |     each step adds to two neighbours, the oldest node's prior to itself
/// |           …           …   Λ_01   |
/// |                     Λ_10  Λ_00   |
/// ```
///
/// It is kept as its factors: a node's filtered Gaussian and the [`GraphStep`]s, so that nothing is inverted until somebody
/// asks. Marginalising an inner node is composing its two steps; marginalising the oldest is forgetting it.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Chain {
    nodes: Vec<Node>,
    /// `steps[i]` leads from node i to node i + 1.
    steps: Vec<GraphStep>,
}

impl Chain {
    /// Without any node.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// The nodes, oldest first.
    #[must_use]
    pub fn nodes(&self) -> &[Node] {
        &self.nodes
    }

    /// The newest node.
    #[must_use]
    pub fn newest(&self) -> Option<&Node> {
        self.nodes.last()
    }

    /// Place of the node with this id.
    #[must_use]
    pub fn place(&self, id: u64) -> Option<usize> {
        self.nodes.binary_search_by_key(&id, |node| node.id).ok()
    }

    /// Adds the first node.
    pub fn begin(&mut self, node: Node) {
        self.nodes.clear();
        self.steps.clear();
        self.nodes.push(node);
    }

    /// Augments by a node, with the step that leads to it from the newest one. Into an empty chain it begins.
    pub fn push(&mut self, step: GraphStep, node: Node) {
        if !self.nodes.is_empty() {
            self.steps.push(step);
        }
        self.nodes.push(node);
    }

    /// The step from node `from` to the later node `to` (places): everything between is marginalised out.
    ///
    /// # Errors
    /// What [`GraphStep::then`] says; [`Error::OutOfBound`] for places that are not in order.
    pub fn between(&self, from: usize, to: usize) -> Result<GraphStep, Error> {
        let steps = self.steps.get(from..to).ok_or(Error::OutOfBound {
            quantity: "place in a chain",
            value: from as f64,
            bound: "the later node's place",
        })?;
        let Some((first, rest)) = steps.split_first() else { return Ok(GraphStep::identity()) };
        rest.iter().try_fold(*first, |all, next| all.then(next))
    }

    /// The joint marginal over (later, earlier), as of the later launch: an origin-state packet (4).
    ///
    /// # Errors
    /// What the step between them says.
    pub fn joint_marginal(&self, earlier: usize, later: usize) -> Result<Information<8>, Error> {
        let step = self.between(earlier, later)?;
        joint_of(&self.nodes[earlier].filtered, &step)
    }

    /// Marginalises the node at `place` out.
    ///
    /// # Errors
    /// What [`GraphStep::then`] says; nothing has changed then.
    pub fn marginalize(&mut self, place: usize) -> Result<(), Error> {
        if place >= self.nodes.len() {
            return Ok(());
        }
        if place > 0 && place < self.steps.len() {
            let merged = self.steps[place - 1].then(&self.steps[place])?;
            self.steps[place - 1] = merged;
            self.steps.remove(place);
        } else if place == 0 && !self.steps.is_empty() {
            self.steps.remove(0);
        } else {
            self.steps.pop();
        }
        self.nodes.remove(place);
        Ok(())
    }

    /// Marginalises all nodes older than the one with this id.
    pub fn forget_before(&mut self, id: u64) {
        let keep = self.nodes.partition_point(|node| node.id < id);
        if keep < self.nodes.len() {
            self.nodes.drain(..keep);
            self.steps.drain(..keep);
        }
    }

    /// Bounds the chain to `most` nodes (at least 2): the oldest stays, its successors are marginalised out.
    ///
    /// # Errors
    /// What [`GraphStep::then`] says.
    pub fn bound(&mut self, most: usize) -> Result<(), Error> {
        while self.nodes.len() > most.max(2) {
            self.marginalize(1)?;
        }
        Ok(())
    }

    /// Λ and η of all nodes, newest first.
    ///
    /// # Errors
    /// [`Error::NotPositiveDefinite`] for a singular prior or step.
    pub fn information(&self) -> Result<(DMatrix<f64>, DVector<f64>), Error> {
        let n = self.nodes.len();
        let mut matrix = DMatrix::zeros(n * NODE, n * NODE);
        let mut vector = DVector::zeros(n * NODE);
        let Some(oldest) = self.nodes.first() else { return Ok((matrix, vector)) };
        let prior = oldest.filtered.information()?;
        let last = (n - 1) * NODE;
        matrix.fixed_view_mut::<NODE, NODE>(last, last).copy_from(&prior.matrix);
        vector.fixed_rows_mut::<NODE>(last).copy_from(&prior.vector);
        for (k, step) in self.steps.iter().enumerate() {
            let delta = step.information()?;
            let at = (n - 2 - k) * NODE;
            let mut block = matrix.fixed_view_mut::<8, 8>(at, at);
            block += delta.matrix;
            let mut rows = vector.fixed_rows_mut::<8>(at);
            rows += delta.vector;
        }
        Ok((matrix, vector))
    }
}

/// The joint of an earlier node with this marginal (before the step's data) and the node that a step leads to, as
/// information on (later, earlier).
///
/// # Errors
/// [`Error::NotPositiveDefinite`] for a singular prior or step.
pub fn joint_of(earlier: &Gaussian<NODE>, step: &GraphStep) -> Result<Information<8>, Error> {
    let prior = earlier.information()?;
    let mut joint = step.information()?;
    let mut block = joint.matrix.fixed_view_mut::<NODE, NODE>(NODE, NODE);
    block += prior.matrix;
    let mut rows = joint.vector.fixed_rows_mut::<NODE>(NODE);
    rows += prior.vector;
    Ok(joint)
}

/// Blocks of information on (later, earlier).
#[derive(Debug, Clone, Copy)]
pub struct Blocks {
    /// Later, later.
    pub later: NodeMatrix,
    /// Later, earlier.
    pub across: NodeMatrix,
    /// Earlier, earlier.
    pub earlier: NodeMatrix,
    /// Vector of the later.
    pub later_vector: NodeVector,
    /// Vector of the earlier.
    pub earlier_vector: NodeVector,
}

impl From<&Information<8>> for Blocks {
    fn from(joint: &Information<8>) -> Self {
        Self {
            later: joint.matrix.fixed_view::<4, 4>(0, 0).into_owned(),
            across: joint.matrix.fixed_view::<4, 4>(0, 4).into_owned(),
            earlier: joint.matrix.fixed_view::<4, 4>(4, 4).into_owned(),
            later_vector: joint.vector.fixed_rows::<4>(0).into_owned(),
            earlier_vector: joint.vector.fixed_rows::<4>(4).into_owned(),
        }
    }
}
