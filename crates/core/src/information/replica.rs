//! A client's copy of a server's pose graph, rebuilt from the packets that arrive.

use serde::{Deserialize, Serialize};

use super::reconstruct::{
    exact_delta, filtered, filtered_error_step, filtered_error_transition, health, loss, origin_delta,
    positive_part,
};
use super::{Chain, Gaussian, Information, NODE, Node, NodeMatrix, NodeVector, Step, symmetrized};
use crate::error::Error;

/// Nodes that a server or a client keeps at most: the origin and the newest ones.
pub const NODES_MAX: usize = 64;
/// What rounding leaves of correlations: in float64, and in eight bits.
const EXACT_SHARE: f64 = 1e-6;
const ROUNDED_SHARE: f64 = 0.03;

/// What a packet says of its newest node and the origin.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[allow(clippy::large_enum_variant, reason = "lives on the stack while one packet is read")]
pub enum Tie {
    /// The newest node is the origin: there is nothing before it.
    Begin,
    /// The joint marginal over (newest, origin), exact.
    Joint(Information<8>),
    /// Σ_{newest, origin} times L₀⁻ᵀ, where L₀ L₀ᵀ is what was sent of the origin at its launch. (A sender's, before it
    /// is written: M, in the scale of the newest node as well.)
    Correlation(NodeMatrix),
}

/// What a packet says of its newest node and an earlier one, exactly.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[allow(clippy::large_enum_variant, reason = "lives on the stack while one packet is read")]
pub enum Lag {
    /// Their joint marginal.
    Joint(Information<8>),
    /// The step between them, for who holds the earlier one as it was sent.
    Rounded(RoundedLag),
}

/// A step in the scales of its two nodes: L₂ L₂ᵀ the earlier one's covariance as it was sent, L₃ L₃ᵀ the later one's.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RoundedLag {
    /// A = L₂⁻¹ P₂|₃ L₂⁻ᵀ: what smoothing leaves of the earlier node's covariance.
    pub smoothed: NodeMatrix,
    /// L₂⁻¹ (x̂₂|₃ − x̂₂): how far smoothing moves its mean.
    pub shift: NodeVector,
    /// K = L₃⁻¹ Φ L₂ chol(A).
    pub transition: NodeMatrix,
    /// N = L₃⁻¹ W L₃⁻ᵀ; none: I − K Kᵀ.
    pub noise: Option<NodeMatrix>,
}

impl RoundedLag {
    /// What was learnt of the earlier node, A⁻¹ − I, and what that leaves of its covariance. Rounded up, A may exceed
    /// what was known before: nothing was learnt in those directions.
    #[must_use]
    pub fn kept(&self) -> Option<(NodeMatrix, NodeMatrix)> {
        let inverse = symmetrized(&self.smoothed).try_inverse()?;
        let gained = symmetrized(&(inverse - NodeMatrix::identity())).symmetric_eigen();
        let kept = NodeMatrix::from_diagonal(&gained.eigenvalues.map(|value| value.max(0.0)));
        let told = gained.eigenvectors * kept * gained.eigenvectors.transpose();
        let smoothed = (NodeMatrix::identity() + told).try_inverse()?;
        Some((told, symmetrized(&smoothed)))
    }

    /// N.
    #[must_use]
    pub fn scaled_noise(&self) -> NodeMatrix {
        self.noise.unwrap_or_else(|| NodeMatrix::identity() - self.transition * self.transition.transpose())
    }

    /// The step, from the two nodes as they were sent: P₂|₃ = L₂AL₂ᵀ, Φ = L₃ K (L₂ chol A)⁻¹, W = L₃ N L₃ᵀ, and what makes
    /// the later mean come out.
    ///
    /// # Errors
    /// [`Error::NotPositiveDefinite`] for matrices that no step has.
    pub fn step(&self, earlier: &Gaussian<NODE>, later: &Gaussian<NODE>) -> Result<Step, Error> {
        let refused = || Error::NotPositiveDefinite { quantity: "rounded step" };
        let root = symmetrized(&earlier.covariance).cholesky().ok_or_else(refused)?.l();
        let back = root.try_inverse().ok_or_else(refused)?;
        let (told, smoothed) = self.kept().ok_or_else(refused)?;
        let smoothed_root = root * smoothed.cholesky().ok_or_else(refused)?.l();
        let later_root = symmetrized(&later.covariance).cholesky().ok_or_else(refused)?.l();
        let transition = later_root * self.transition * smoothed_root.try_inverse().ok_or_else(refused)?;
        let mean = earlier.mean + root * self.shift;
        let told_matrix = symmetrized(&(back.transpose() * told * back));
        // j: (P₂⁻¹ + J)⁻¹ (P₂⁻¹ x̂₂ + j) is the smoothed mean.
        let known = back.transpose() * back;
        let noise = symmetrized(&(later_root * self.scaled_noise() * later_root.transpose()));
        Ok(Step {
            transition,
            offset: later.mean - transition * mean,
            noise: positive_part(&noise, &later.covariance).ok_or_else(refused)?,
            told_matrix,
            told_vector: told_matrix * mean + known * (mean - earlier.mean),
        })
    }
}

/// A server's packet, decoded.
#[derive(Debug, Clone, PartialEq)]
pub struct GraphPacket {
    /// Newest node, with its filtered Gaussian.
    pub node: Node,
    /// The origin's id.
    pub origin: u64,
    /// Newest node and origin.
    pub tie: Tie,
    /// Exact ties with earlier nodes, by id.
    pub lags: Vec<(u64, Lag)>,
}

/// How a step was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Method {
    /// First packet of this server.
    Begun,
    /// The packet holds the exact joint with the client's newest node.
    ExactJoint,
    /// Equation (6).
    Equation6,
    /// The filtered-error model.
    FilteredError,
}

/// Which methods a client may use.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Methods {
    /// Exact joints with the client's newest node.
    pub joint: bool,
    /// With how many of the transmissions before it a packet holds them: an origin among those is one, an older one
    /// belongs to equation (6).
    pub lags: u64,
    /// Equation (6), where healthy.
    pub equation_6: bool,
    /// Largest [`loss`] at which it is.
    pub loss_max: f64,
}

/// A packet as the replica would take it: nothing has changed yet.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// How the step was found.
    pub method: Method,
    /// From the client's newest node to the packet's; for [`Method::Begun`] without meaning.
    pub step: Step,
    /// The packet's node.
    pub node: Node,
    begun: Option<(Node, Step)>,
    origin: u64,
    joint: Option<Information<8>>,
    cross: Option<NodeMatrix>,
    exact: bool,
}

/// What a replica remembers of a node beside the chain.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct Memory {
    /// The joint marginal with an origin, as it was sent.
    joint: Option<(u64, Information<8>)>,
    /// What correlates its filtered error with the anchor's; `None` when not known.
    cross: Option<NodeMatrix>,
    /// Whether the step that leads to it is the server's own, but for rounding.
    exact: bool,
}

/// A server's graph at one client.
///
/// The client holds the server's nodes that it received, those that were lost being marginalised out. Nothing that the
/// client measured ever enters.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Replica {
    chain: Chain,
    memories: Vec<Memory>,
    /// The node that all `cross` refer to.
    anchor: Option<u64>,
    /// Whether correlations are scaled by Cholesky factors (of packets that hold no joint).
    scaled: bool,
}

impl Replica {
    /// An empty replica. `scaled`: packets hold [`Tie::Correlation`] (and never a joint), by Cholesky factors.
    #[must_use]
    pub fn new(scaled: bool) -> Self {
        Self { scaled, ..Self::default() }
    }

    /// The node that the replica takes for the origin of a packet whose origin has these eight bits, if it knows one.
    #[must_use]
    pub fn origin_like(&self, residue: u64) -> Option<u64> {
        let like = |id: &u64| id & 0xFF == residue & 0xFF;
        let mut held = self.chain.nodes().iter().map(|node| node.id);
        self.anchor.filter(like).or_else(|| held.find(like))
    }

    /// The graph.
    #[must_use]
    pub fn chain(&self) -> &Chain {
        &self.chain
    }

    /// What to do with a packet; `None` when it cannot be joined to what is held (an unknown origin, an old packet).
    ///
    /// # Errors
    /// A packet whose matrices are none that a graph can have.
    pub fn plan(&self, packet: &GraphPacket, methods: &Methods) -> Result<Option<Plan>, Error> {
        let Some(newest) = self.chain.newest() else { return self.begin(packet).map(Some) };
        if packet.node.id <= newest.id {
            return Ok(None);
        }
        let (joint, cross) = self.tied(packet)?;
        let plan = |method, step, exact| Plan {
            method,
            step,
            node: packet.node,
            begun: None,
            origin: packet.origin,
            joint,
            cross,
            exact,
        };
        if methods.joint
            && let Some(step) = self.exact_step(packet, joint.as_ref(), methods)?
        {
            return Ok(Some(plan(Method::ExactJoint, step, true)));
        }
        if methods.equation_6
            && let Some(packet_joint) = &joint
            && let Some(known) = self.joint_with(packet.origin)
            && loss(health(&known, packet_joint)) <= methods.loss_max
        {
            // What D hides from its own indicator shows here; the filtered-error model is still there then.
            let solved = origin_delta(&known, packet_joint)
                .and_then(|solved| Step::from_information(&solved.delta, &newest.filtered));
            if let Ok(step) = solved {
                return Ok(Some(plan(Method::Equation6, step, true)));
            }
        }
        let (Some(later), Some(earlier)) = (cross, self.cross_of_newest(packet.origin)) else {
            return Ok(None);
        };
        let Ok(transition) = filtered_error_transition(&newest.filtered, &earlier, &later, self.left_share())
        else {
            return Ok(None);
        };
        let step = filtered_error_step(&newest.filtered, &packet.node.filtered, &transition)?;
        Ok(Some(plan(Method::FilteredError, step, false)))
    }

    /// Takes a plan that [`Replica::plan`] made of this very replica.
    pub fn commit(&mut self, plan: &Plan) {
        if let Some((origin, step)) = plan.begun {
            self.anchor = Some(plan.origin);
            self.chain.begin(origin);
            if origin.id != plan.node.id {
                self.memories.push(Memory { joint: None, cross: None, exact: true });
                self.chain.push(step, plan.node);
            }
        } else {
            self.re_anchor(plan.origin);
            self.chain.push(plan.step, plan.node);
        }
        let joint = plan.joint.map(|joint| (plan.origin, joint));
        self.memories.push(Memory { joint, cross: plan.cross, exact: plan.exact });
        self.prune(plan.origin);
    }

    /// Nodes before the origin are not asked for again; beyond [`NODES_MAX`] the oldest but the origin go.
    fn prune(&mut self, origin: u64) {
        if self.chain.place(origin).is_some() {
            self.chain.forget_before(origin);
        }
        let gone = self.memories.len() - self.chain.nodes().len();
        self.memories.drain(..gone);
        while self.chain.nodes().len() > NODES_MAX {
            if self.chain.marginalize(1).is_err() {
                // Without its oldest node a graph is smaller and as right.
                let second = self.chain.nodes()[1].id;
                self.chain.forget_before(second);
                self.memories.remove(0);
                continue;
            }
            let merged = self.memories.remove(1);
            if let Some(next) = self.memories.get_mut(1) {
                next.exact &= merged.exact;
            }
        }
    }

    /// The first packet of a server: its newest node, and the origin before it where the packet holds their joint.
    fn begin(&self, packet: &GraphPacket) -> Result<Plan, Error> {
        let mut plan = Plan {
            method: Method::Begun,
            step: Step::identity(),
            node: packet.node,
            begun: Some((packet.node, Step::identity())),
            origin: packet.origin,
            joint: None,
            cross: None,
            exact: true,
        };
        match packet.tie {
            Tie::Begin => plan.cross = self.own_cross(&packet.node),
            Tie::Correlation(cross) => plan.cross = Some(cross),
            Tie::Joint(joint) => {
                let moments = joint.gaussian()?;
                let marginal = Gaussian {
                    mean: moments.mean.fixed_rows::<NODE>(4).into_owned(),
                    covariance: symmetrized(&moments.covariance.fixed_view::<NODE, NODE>(4, 4).into_owned()),
                };
                let step = Step::from_information(&exact_delta(&joint, &marginal)?, &marginal)?;
                let origin = Node { id: packet.origin, tol_ns: i64::MIN, filtered: marginal };
                plan.begun = Some((origin, step));
                plan.joint = Some(joint);
                plan.cross = Some(filtered(&joint)?.1);
            }
        }
        Ok(plan)
    }

    /// The packet's joint with its origin, and the correlation of the filtered errors.
    fn tied(&self, packet: &GraphPacket) -> Result<(Option<Information<8>>, Option<NodeMatrix>), Error> {
        match packet.tie {
            Tie::Begin => Ok((None, None)),
            Tie::Joint(joint) => Ok((Some(joint), Some(filtered(&joint)?.1))),
            Tie::Correlation(cross) => Ok((None, Some(cross))),
        }
    }

    /// Where the packet holds the exact joint with the newest node, as a lag or as the origin.
    fn exact_step(
        &self,
        packet: &GraphPacket,
        joint: Option<&Information<8>>,
        methods: &Methods,
    ) -> Result<Option<Step>, Error> {
        let Some(newest) = self.chain.newest() else { return Ok(None) };
        let of_joint = |joint: &Information<8>| {
            Step::from_information(&exact_delta(joint, &newest.filtered)?, &newest.filtered)
        };
        match packet.lags.iter().find(|(id, _)| *id == newest.id) {
            Some((_, Lag::Joint(joint))) => return of_joint(joint).map(Some),
            Some((_, Lag::Rounded(lag))) => {
                return lag.step(&newest.filtered, &packet.node.filtered).map(Some);
            }
            None => {}
        }
        match joint {
            // An origin among the last transmissions is not told twice; an older one is where equation (6) is 0/0.
            Some(joint)
                if packet.origin == newest.id
                    && (methods.equation_6 || packet.node.id - newest.id <= methods.lags) =>
            {
                of_joint(joint).map(Some)
            }
            _ => Ok(None),
        }
    }

    /// Λᶜ over (newest, origin): the newest packet itself if it had this origin, else from the graph if that is exact.
    fn joint_with(&self, origin: u64) -> Option<Information<8>> {
        let memory = self.memories.last()?;
        if let Some((its_origin, joint)) = memory.joint
            && its_origin == origin
        {
            return Some(joint);
        }
        let place = self.chain.place(origin)?;
        let last = self.memories.len() - 1;
        if place == last || !self.memories[place + 1..].iter().all(|memory| memory.exact) {
            return None;
        }
        self.chain.joint_marginal(place, last).ok()
    }

    /// The newest node's correlation with `origin`, in the scale that packets with this origin use.
    fn cross_of_newest(&self, origin: u64) -> Option<NodeMatrix> {
        let last = self.memories.len().checked_sub(1)?;
        if self.anchor == Some(origin) {
            return self.memories[last].cross;
        }
        self.crosses_by(self.chain.place(origin)?).last().copied().flatten()
    }

    /// Correlations of all nodes with the one at `place`, as [`Replica::anchor`] would have them there.
    fn crosses_by(&self, place: usize) -> Vec<Option<NodeMatrix>> {
        let node = &self.chain.nodes()[place];
        let (own, anchored) = (self.own_cross(node), self.memories[place].cross);
        (0..self.memories.len())
            .map(|k| {
                if k == place {
                    return own;
                }
                let cross = self.memories[k].cross.filter(|_| k > place)?;
                let transition =
                    filtered_error_transition(&node.filtered, &anchored?, &cross, self.left_share()).ok()?;
                Some(transition * own?)
            })
            .collect()
    }

    /// Below this share of the largest, a direction's correlation with the origin is rounding.
    fn left_share(&self) -> f64 {
        if self.scaled { ROUNDED_SHARE } else { EXACT_SHARE }
    }

    /// What a node's correlation with itself is: its covariance, or the factor of it.
    fn own_cross(&self, node: &Node) -> Option<NodeMatrix> {
        let covariance = node.filtered.covariance;
        if self.scaled { Some(covariance.cholesky()?.l()) } else { Some(covariance) }
    }

    fn re_anchor(&mut self, origin: u64) {
        if self.anchor == Some(origin) {
            return;
        }
        let Some(place) = self.chain.place(origin) else { return };
        let crosses = self.crosses_by(place);
        for (memory, cross) in self.memories.iter_mut().zip(crosses) {
            memory.cross = cross;
        }
        self.anchor = Some(origin);
    }
}
