//! A team's pose graph with full covariance: each vehicle's current node, and delayed ones at times of launch.

use serde::{Deserialize, Serialize};

use super::local::{FixGate, Half, LocalOptions, Range, Reading, Sensors, estimate, predicted, start};
use crate::event::{Payload, VehicleId};
use crate::information::{Joint, NodeMatrix, NodeVector, process};
use crate::navigator::common::seconds;
use crate::navigator::{Estimate, Outcome};
use crate::packet::Header;

/// What a node of the graph is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Node {
    /// Where a vehicle is at its own time.
    Current(VehicleId),
    /// Where it was at a launch, ns.
    Launch(VehicleId, i64),
}

/// What a vehicle's own events come to.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
struct Member {
    sensors: Sensors,
    gate: FixGate,
    now_ns: Option<i64>,
    rejected: u64,
}

/// The joint Gaussian of all nodes.
///
/// ```text
/// nodes       [ Current(0) | Current(1) | Launch(0, t) | … ]    in the order in which they came
/// joint mean  [ x y ẋ ẏ    | x y ẋ ẏ    | x y ẋ ẏ      | … ]    covariance: full
/// ```
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Graph {
    options: LocalOptions,
    members: Vec<Member>,
    nodes: Vec<Node>,
    joint: Joint,
}

impl Graph {
    /// Of a team none of which has had a fix.
    #[must_use]
    pub fn new(vehicles: usize, options: LocalOptions) -> Self {
        let members = (0..vehicles).map(|_| Member::default()).collect();
        Self { options, members, nodes: Vec::new(), joint: Joint::new() }
    }

    /// Where a node stands in the joint.
    #[must_use]
    pub fn find(&self, node: Node) -> Option<usize> {
        self.nodes.iter().position(|n| *n == node)
    }

    /// How many nodes there are.
    #[must_use]
    pub fn nodes(&self) -> usize {
        self.nodes.len()
    }

    /// Time that a vehicle has advanced to, ns.
    #[must_use]
    pub fn now_ns(&self, vehicle: usize) -> Option<i64> {
        self.members[vehicle].now_ns
    }

    /// Depth of a vehicle as its packets carry it, m.
    #[must_use]
    pub fn carried_depth_m(&self, vehicle: usize) -> f64 {
        Header::carried_depth_m(self.members[vehicle].sensors.depth_m())
    }

    /// Counts a measurement of a vehicle that cannot be used.
    pub fn reject(&mut self, vehicle: usize) {
        self.members[vehicle].rejected += 1;
    }

    /// Moves a vehicle's current node to `t_ns`, never back.
    pub fn advance(&mut self, vehicle: usize, t_ns: i64) {
        let node = self.find(Node::Current(vehicle as VehicleId));
        let member = &mut self.members[vehicle];
        let now_ns = member.now_ns.unwrap_or(t_ns);
        member.now_ns = Some(t_ns.max(now_ns));
        if let (Some(node), true) = (node, t_ns > now_ns) {
            let dt_s = seconds(t_ns.saturating_sub(now_ns));
            let q = member.sensors.process_noise_m2_per_s3(&self.options);
            let none = NodeVector::zeros();
            self.joint.propagate(node, &process::transition(dt_s), &none, &process::noise(dt_s, q));
        }
    }

    /// Advances a vehicle to its checked sensor event and fuses it.
    pub fn sense(&mut self, vehicle: usize, t_ns: i64, payload: &Payload) -> Outcome {
        // Headings come at tens of hertz and are only kept: nothing has to move for them.
        let reading = match payload {
            Payload::Heading { .. } | Payload::Depth { .. } => {
                let member = &mut self.members[vehicle];
                member.sensors.read(t_ns, payload);
                return Outcome::Noted;
            }
            _ => {
                self.advance(vehicle, t_ns);
                self.members[vehicle].sensors.read(t_ns, payload)
            }
        };
        let linear = match reading {
            Reading::Nothing => return Outcome::Noted,
            Reading::Refused => {
                self.reject(vehicle);
                return Outcome::Gated;
            }
            Reading::Linear(linear) => linear,
        };
        let Some(node) = self.find(Node::Current(vehicle as VehicleId)) else {
            if linear.half == Half::Velocity {
                return Outcome::Noted;
            }
            self.joint.push(&start(&linear, &self.options));
            self.nodes.push(Node::Current(vehicle as VehicleId));
            return Outcome::Fused;
        };
        let innovation = self.joint.pair_innovation(node, linear.first(), &linear.value, &linear.noise);
        match innovation {
            Some(innovation)
                if self.members[vehicle].gate.admits(linear.half, innovation.squared, &self.options) =>
            {
                self.joint.fuse(&innovation);
                Outcome::Fused
            }
            _ => {
                self.reject(vehicle);
                Outcome::Gated
            }
        }
    }

    /// Keeps a vehicle's node at `tol_ns` in place of that of its previous launch; false before its first fix.
    pub fn launch(&mut self, vehicle: usize, tol_ns: i64) -> bool {
        self.advance(vehicle, tol_ns);
        let id = vehicle as VehicleId;
        let old = self.nodes.iter().position(|n| matches!(n, Node::Launch(v, _) if *v == id));
        if let Some(old) = old {
            self.joint.remove(old);
            self.nodes.remove(old);
        }
        let Some(current) = self.find(Node::Current(id)) else { return false };
        self.joint.push_copy(current);
        self.nodes.push(Node::Launch(id, tol_ns));
        true
    }

    /// Fuses the range from `sender`'s node at launch to the receiver at arrival; counted when it cannot be.
    ///
    /// Where decoding took a while, the receiver has moved on: it is taken back along its velocity and forward again.
    pub fn range(&mut self, sender: usize, receiver: usize, range: Option<Range>, toa_ns: i64) -> Outcome {
        self.advance(receiver, toa_ns);
        let late_s = seconds(self.members[receiver].now_ns.unwrap_or(toa_ns).saturating_sub(toa_ns));
        let outcome = match (range, self.find(Node::Current(receiver as VehicleId))) {
            (Some(range), Some(node)) => {
                self.shift(node, -late_s);
                let outcome = range.fuse(&mut self.joint, sender, node, self.options.gate_sigmas);
                self.shift(node, late_s);
                outcome
            }
            _ => Outcome::Rejected,
        };
        if outcome != Outcome::Fused {
            self.reject(receiver);
        }
        outcome
    }

    /// Moves a node along its velocity, without noise.
    fn shift(&mut self, node: usize, dt_s: f64) {
        if dt_s != 0.0 {
            let (none, quiet) = (NodeVector::zeros(), NodeMatrix::zeros());
            self.joint.propagate(node, &process::transition(dt_s), &none, &quiet);
        }
    }

    /// The slant range between launch and arrival, reduced by both depths.
    #[must_use]
    pub fn measured(
        &self,
        (sender, receiver): (usize, usize),
        (tol_ns, toa_ns): (i64, i64),
        sender_depth_m: f64,
        sound_speed_mps: f64,
    ) -> Option<Range> {
        debug_assert_ne!(sender, receiver);
        let own_depth_m = self.members[receiver].sensors.depth_m();
        let sigma_m = self.options.sigma_range_m;
        Range::measured(tol_ns, toa_ns, sound_speed_mps, own_depth_m, sender_depth_m, sigma_m).ok().flatten()
    }

    /// The belief about one vehicle, predicted to `t_ns`.
    #[must_use]
    pub fn estimate(&self, vehicle: usize, t_ns: i64) -> Estimate {
        let member = &self.members[vehicle];
        let node = self.find(Node::Current(vehicle as VehicleId)).map(|node| {
            let q = member.sensors.process_noise_m2_per_s3(&self.options);
            let dt_s = seconds(t_ns.saturating_sub(member.now_ns.unwrap_or(t_ns)));
            predicted(&self.joint.marginal(node), dt_s, q)
        });
        estimate(node.as_ref(), t_ns, member.rejected)
    }
}
