//! A client's copy of a server's pose graph, rebuilt from the packets that arrive.

use serde::{Deserialize, Serialize};

use super::graph_packet::{GraphPacket, Lag, OriginCorrelation};
use super::reconstruct::{
    exact_delta, filtered, filtered_error_step, filtered_error_transition, health, loss, origin_delta,
};
use super::{Chain, Gaussian, GraphStep, Information, NODE, Node, NodeMatrix, symmetrized};
use crate::error::Error;

/// Nodes that a server or a client keeps at most: the origin and the newest ones.
pub const NODES_MAX: usize = 64;
/// What rounding leaves of correlations: in float64, and in eight bits.
const EXACT_SHARE: f64 = 1e-6;
const ROUNDED_SHARE: f64 = 0.03;

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
pub struct JoinPlan {
    /// How the step was found.
    pub method: Method,
    /// From the client's newest node to the packet's; for [`Method::Begun`] without meaning.
    pub step: GraphStep,
    /// The packet's node.
    pub node: Node,
    begun: Option<(Node, GraphStep)>,
    origin: u64,
    joint: Option<Information<8>>,
    cross: Option<NodeMatrix>,
    exact: bool,
}

/// What a replica remembers of a node beside the chain.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct NodeRecord {
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
    records: Vec<NodeRecord>,
    /// The node that all `cross` refer to.
    anchor: Option<u64>,
    /// Whether correlations are scaled by Cholesky factors (of packets that hold no joint).
    scaled: bool,
}

impl Replica {
    /// An empty replica. `scaled`: packets hold [`OriginCorrelation::Correlation`] (and never a joint), by Cholesky factors.
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
    pub fn plan(&self, packet: &GraphPacket, methods: &Methods) -> Result<Option<JoinPlan>, Error> {
        let Some(newest) = self.chain.newest() else { return self.begin(packet).map(Some) };
        if packet.node.id <= newest.id {
            return Ok(None);
        }
        let (joint, cross) = self.tied(packet)?;
        let plan = |method, step, exact| JoinPlan {
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
                .and_then(|solved| GraphStep::from_information(&solved.delta, &newest.filtered));
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
    pub fn commit(&mut self, plan: &JoinPlan) {
        if let Some((origin, step)) = plan.begun {
            self.anchor = Some(plan.origin);
            self.chain.begin(origin);
            if origin.id != plan.node.id {
                self.records.push(NodeRecord { joint: None, cross: None, exact: true });
                self.chain.push(step, plan.node);
            }
        } else {
            self.re_anchor(plan.origin);
            self.chain.push(plan.step, plan.node);
        }
        let joint = plan.joint.map(|joint| (plan.origin, joint));
        self.records.push(NodeRecord { joint, cross: plan.cross, exact: plan.exact });
        self.prune(plan.origin);
    }

    /// Nodes before the origin are not asked for again; beyond [`NODES_MAX`] the oldest but the origin go.
    fn prune(&mut self, origin: u64) {
        if self.chain.place(origin).is_some() {
            self.chain.forget_before(origin);
        }
        let gone = self.records.len() - self.chain.nodes().len();
        self.records.drain(..gone);
        while self.chain.nodes().len() > NODES_MAX {
            if self.chain.marginalize(1).is_err() {
                // Without its oldest node a graph is smaller and as right.
                let second = self.chain.nodes()[1].id;
                self.chain.forget_before(second);
                self.records.remove(0);
                continue;
            }
            let merged = self.records.remove(1);
            if let Some(next) = self.records.get_mut(1) {
                next.exact &= merged.exact;
            }
        }
    }

    /// The first packet of a server: its newest node, and the origin before it where the packet holds their joint.
    fn begin(&self, packet: &GraphPacket) -> Result<JoinPlan, Error> {
        let mut plan = JoinPlan {
            method: Method::Begun,
            step: GraphStep::identity(),
            node: packet.node,
            begun: Some((packet.node, GraphStep::identity())),
            origin: packet.origin,
            joint: None,
            cross: None,
            exact: true,
        };
        match packet.tie {
            OriginCorrelation::Begin => plan.cross = self.own_cross(&packet.node),
            OriginCorrelation::Correlation(cross) => plan.cross = Some(cross),
            OriginCorrelation::Joint(joint) => {
                let moments = joint.gaussian()?;
                let marginal = Gaussian {
                    mean: moments.mean.fixed_rows::<NODE>(4).into_owned(),
                    covariance: symmetrized(&moments.covariance.fixed_view::<NODE, NODE>(4, 4).into_owned()),
                };
                let step = GraphStep::from_information(&exact_delta(&joint, &marginal)?, &marginal)?;
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
            OriginCorrelation::Begin => Ok((None, None)),
            OriginCorrelation::Joint(joint) => Ok((Some(joint), Some(filtered(&joint)?.1))),
            OriginCorrelation::Correlation(cross) => Ok((None, Some(cross))),
        }
    }

    /// Where the packet holds the exact joint with the newest node, as a lag or as the origin.
    fn exact_step(
        &self,
        packet: &GraphPacket,
        joint: Option<&Information<8>>,
        methods: &Methods,
    ) -> Result<Option<GraphStep>, Error> {
        let Some(newest) = self.chain.newest() else { return Ok(None) };
        let of_joint = |joint: &Information<8>| {
            GraphStep::from_information(&exact_delta(joint, &newest.filtered)?, &newest.filtered)
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
        let record = self.records.last()?;
        if let Some((its_origin, joint)) = record.joint
            && its_origin == origin
        {
            return Some(joint);
        }
        let place = self.chain.place(origin)?;
        let last = self.records.len() - 1;
        if place == last || !self.records[place + 1..].iter().all(|record| record.exact) {
            return None;
        }
        self.chain.joint_marginal(place, last).ok()
    }

    /// The newest node's correlation with `origin`, in the scale that packets with this origin use.
    fn cross_of_newest(&self, origin: u64) -> Option<NodeMatrix> {
        let last = self.records.len().checked_sub(1)?;
        if self.anchor == Some(origin) {
            return self.records[last].cross;
        }
        self.crosses_by(self.chain.place(origin)?).last().copied().flatten()
    }

    /// Correlations of all nodes with the one at `place`, as [`Replica::anchor`] would have them there.
    fn crosses_by(&self, place: usize) -> Vec<Option<NodeMatrix>> {
        let node = &self.chain.nodes()[place];
        let (own, anchored) = (self.own_cross(node), self.records[place].cross);
        (0..self.records.len())
            .map(|k| {
                if k == place {
                    return own;
                }
                let cross = self.records[k].cross.filter(|_| k > place)?;
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
        for (record, cross) in self.records.iter_mut().zip(crosses) {
            record.cross = cross;
        }
        self.anchor = Some(origin);
    }
}
