//! A team's pose graph with full covariance: each vehicle's current node, and delayed ones at times of launch.

use serde::{Deserialize, Serialize};

use super::local::{estimate, start};
use super::local_options::LocalOptions;
use super::odometry::{Odometer, OdometryStep, drift};
use super::range::Range;
use super::sensors::{FixGate, Half, Linear, SensorReading, Sensors};
use crate::error::Error;
use crate::event::{Payload, VehicleId, seconds};
use crate::information::{Gaussian, Joint, NODE};
use crate::navigator::{Estimate, LastInnovation, Outcome};
use crate::packet::Header;

/// What a node of the graph is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Node {
    /// Where a vehicle is at its own time.
    Current(VehicleId),
    /// Where it was at a launch, ns.
    Launch(VehicleId, i64),
}

/// What a sensor event did to a node.
#[derive(Debug, Clone, Copy, PartialEq)]
#[allow(clippy::large_enum_variant, reason = "one at a time, on the stack")]
pub enum NodeChange {
    /// Nothing.
    Nothing,
    /// It was measured.
    Linear(Linear),
    /// It moved.
    Moved(OdometryStep),
}

/// State of a vehicle's own sensors and clock.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
struct Member {
    sensors: Sensors,
    odometer: Odometer,
    gate: FixGate,
    now_ns: Option<i64>,
    rejected: u64,
}

impl Member {
    /// The prediction of the node to `t_ns`.
    fn drift(&self, t_ns: i64, options: &LocalOptions) -> OdometryStep {
        let dt_s = seconds(t_ns.saturating_sub(self.now_ns.unwrap_or(t_ns)));
        drift(self.odometer.moves(), dt_s, self.sensors.process_noise_m2_per_s3(options))
    }
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
    /// Of the event that is being handled.
    #[serde(skip)]
    pub innovation: LastInnovation,
}

impl Graph {
    /// Of a team none of which has had a fix.
    #[must_use]
    pub fn new(vehicles: usize, options: LocalOptions) -> Self {
        let members = (0..vehicles).map(|_| Member::default()).collect();
        let innovation = LastInnovation::default();
        Self { options, members, nodes: Vec::new(), joint: Joint::new(), innovation }
    }

    /// Where a node stands in the joint.
    #[must_use]
    pub fn find(&self, node: Node) -> Option<usize> {
        self.nodes.iter().position(|n| *n == node)
    }

    /// Refuses the first odometry of a vehicle whose heading is not known.
    ///
    /// # Errors
    /// [`Error::OutOfBound`].
    pub fn check_heading(&self, vehicle: usize, payload: &Payload) -> Result<(), Error> {
        self.members.get(vehicle).map_or(Ok(()), |member| member.odometer.check_heading(payload))
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

    /// Depth of a vehicle as it knows it, m.
    #[must_use]
    pub fn depth_m(&self, vehicle: usize) -> f64 {
        self.members[vehicle].sensors.depth_m()
    }

    /// Depth of a vehicle as its packets carry it, m.
    #[must_use]
    pub fn carried_depth_m(&self, vehicle: usize) -> f64 {
        Header::carried_depth_m(self.depth_m(vehicle))
    }

    /// A vehicle's current node alone.
    #[must_use]
    pub fn current(&self, vehicle: usize) -> Option<Gaussian<NODE>> {
        self.find(Node::Current(vehicle as VehicleId)).map(|node| self.joint.marginal(node))
    }

    /// Puts a node in the place of the current one of a graph's only vehicle.
    pub fn set_alone(&mut self, node: &Gaussian<NODE>) {
        self.joint = Joint::new();
        self.joint.push(node);
        self.nodes = vec![Node::Current(0)];
    }

    /// Counts a measurement of a vehicle that cannot be used.
    pub fn reject(&mut self, vehicle: usize) {
        self.members[vehicle].rejected += 1;
    }

    /// The prediction of a vehicle's node to `t_ns`.
    #[must_use]
    pub fn drift(&self, vehicle: usize, t_ns: i64) -> OdometryStep {
        self.members[vehicle].drift(t_ns, &self.options)
    }

    /// Moves a vehicle's current node to `t_ns`, never back.
    pub fn advance(&mut self, vehicle: usize, t_ns: i64) {
        let node = self.find(Node::Current(vehicle as VehicleId));
        let member = &mut self.members[vehicle];
        if let (Some(node), Some(now_ns)) = (node, member.now_ns)
            && t_ns > now_ns
        {
            let OdometryStep { transition, offset, noise } = member.drift(t_ns, &self.options);
            self.joint.propagate(node, &transition, &offset, &noise);
        }
        member.now_ns = Some(member.now_ns.map_or(t_ns, |now_ns| now_ns.max(t_ns)));
    }

    /// Advances a vehicle to its checked sensor event and fuses it.
    pub fn sense(&mut self, vehicle: usize, t_ns: i64, payload: &Payload) -> Outcome {
        self.sense_with_change(vehicle, t_ns, payload).0
    }

    /// As [`Graph::sense`], and what it did to the node.
    pub fn sense_with_change(
        &mut self,
        vehicle: usize,
        t_ns: i64,
        payload: &Payload,
    ) -> (Outcome, NodeChange) {
        let nothing = (Outcome::Noted, NodeChange::Nothing);
        // Headings come at tens of hertz and are only kept: nothing has to move for them.
        if matches!(payload, Payload::Heading { .. } | Payload::Depth { .. }) {
            let member = &mut self.members[vehicle];
            member.sensors.read(t_ns, payload);
            member.odometer.read(payload, None);
            return nothing;
        }
        self.advance(vehicle, t_ns);
        if matches!(payload, Payload::Odometry { .. }) {
            return self
                .step(vehicle, t_ns, payload)
                .map_or(nothing, |step| (Outcome::Fused, NodeChange::Moved(step)));
        }
        match self.members[vehicle].sensors.read(t_ns, payload) {
            SensorReading::Nothing => nothing,
            SensorReading::Refused => {
                self.reject(vehicle);
                (Outcome::Gated, NodeChange::Nothing)
            }
            // The node of a vehicle with odometry has no velocity to be measured.
            SensorReading::Linear(linear)
                if linear.half == Half::Velocity && self.members[vehicle].odometer.moves() =>
            {
                nothing
            }
            SensorReading::Linear(linear) => self.measure(vehicle, &linear),
        }
    }

    fn measure(&mut self, vehicle: usize, linear: &Linear) -> (Outcome, NodeChange) {
        let Some(node) = self.find(Node::Current(vehicle as VehicleId)) else {
            if linear.half == Half::Velocity {
                return (Outcome::Noted, NodeChange::Nothing);
            }
            self.joint.push(&start(linear, &self.options));
            self.nodes.push(Node::Current(vehicle as VehicleId));
            return (Outcome::Fused, NodeChange::Nothing);
        };
        let innovation = self.joint.pair_innovation(node, linear.first(), &linear.value, &linear.noise);
        match innovation {
            Some(innovation)
                if self.members[vehicle].gate.admits(linear.half, innovation.squared, &self.options)
                    && self.joint.fuse(&innovation).is_ok() =>
            {
                (Outcome::Fused, NodeChange::Linear(*linear))
            }
            _ => {
                self.reject(vehicle);
                (Outcome::Gated, NodeChange::Nothing)
            }
        }
    }

    /// Moves a vehicle by its odometry. The first odometry event replaces the velocity in the node.
    fn step(&mut self, vehicle: usize, t_ns: i64, payload: &Payload) -> Option<OdometryStep> {
        let node = self.find(Node::Current(vehicle as VehicleId));
        let member = &mut self.members[vehicle];
        let odometer = member.odometer;
        let fresh = if odometer.moves() {
            OdometryStep::rest()
        } else {
            OdometryStep::begin(odometer.sigma_heading_rad(), self.options.sigma_odometry_scale)
        };
        let mean = node.map(|node| fresh.transition * self.joint.node_mean(node));
        let mut step = fresh.then(&member.odometer.read(payload, mean.as_ref())?);
        step.noise[(2, 2)] += member.odometer.gyro_rad2(t_ns, self.options.sigma_gyro_bias_radps);
        self.joint.propagate(node?, &step.transition, &step.offset, &step.noise);
        Some(step)
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
        let late_s = self.late_s(receiver, toa_ns);
        let outcome = match (range, self.find(Node::Current(receiver as VehicleId))) {
            (Some(range), Some(node)) => {
                self.shift(receiver, node, -late_s);
                let outcome = range.fuse_seen(
                    &mut self.joint,
                    sender,
                    node,
                    self.options.gate_sigmas,
                    &mut self.innovation,
                );
                self.shift(receiver, node, late_s);
                outcome
            }
            _ => Outcome::Rejected,
        };
        if outcome != Outcome::Fused {
            self.reject(receiver);
        }
        outcome
    }

    /// How long ago a vehicle was where it was at `toa_ns`, s.
    #[must_use]
    pub fn late_s(&self, vehicle: usize, toa_ns: i64) -> f64 {
        seconds(self.members[vehicle].now_ns.unwrap_or(toa_ns).saturating_sub(toa_ns))
    }

    /// Moves a node along its velocity, without noise.
    fn shift(&mut self, vehicle: usize, node: usize, dt_s: f64) {
        if dt_s != 0.0 {
            let OdometryStep { transition, offset, noise } = self.coast(vehicle, dt_s);
            self.joint.propagate(node, &transition, &offset, &noise);
        }
    }

    /// The prediction of a vehicle's node without acceleration.
    #[must_use]
    pub fn coast(&self, vehicle: usize, dt_s: f64) -> OdometryStep {
        drift(self.members[vehicle].odometer.moves(), dt_s, 0.0)
    }

    /// The slant range between launch and arrival, reduced by both depths.
    #[must_use]
    pub fn measured(
        &self,
        receiver: usize,
        (tol_ns, toa_ns): (i64, i64),
        sender_depth_m: f64,
        sound_speed_mps: f64,
    ) -> Option<Range> {
        let own_depth_m = self.depth_m(receiver);
        let step_m = Header::coarse_depth_step_m(sender_depth_m);
        let options = &self.options;
        Range::measured(tol_ns, toa_ns, sound_speed_mps, own_depth_m, sender_depth_m, step_m, options)
            .ok()
            .flatten()
    }

    /// The belief about one vehicle, predicted to `t_ns`.
    #[must_use]
    pub fn estimate(&self, vehicle: usize, t_ns: i64) -> Estimate {
        let node = self.current(vehicle).map(|node| self.drift(vehicle, t_ns).applied(&node));
        estimate(node.as_ref(), t_ns, self.members[vehicle].rejected)
    }
}
