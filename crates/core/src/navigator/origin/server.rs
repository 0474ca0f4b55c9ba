//! A vehicle's local-only graph, which it broadcasts. Own odometry and fixes, never a range.

use serde::{Deserialize, Serialize};

use super::local::{Change, Fused, LocalFilter};
use super::local_options::LocalOptions;
use super::odometry;
use crate::error::Error;
use crate::event::{Payload, VehicleId, seconds};
use crate::information::chain::joint_of;
use crate::information::graph_packet::{GraphPacket, Lag, OriginCorrelation};
use crate::information::replica::NODES_MAX;
use crate::information::{Chain, Gaussian, GraphStep, NODE, Node, NodeMatrix, process};
use crate::link::{AckBitmap, LinkError, Sequencer};
use crate::navigator::Outcome;
use crate::packet::graph::rounded::{UnroundedPacket, rounded};
use crate::packet::graph::{GraphForm, lag_ids, rounded_lag_ids};

/// The local filter, its graph of launches, and what the clients hold of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Server {
    /// The local filter.
    pub filter: LocalFilter,
    chain: Chain,
    /// From the newest node to the filter's own at `since_ns`.
    since: GraphStep,
    since_ns: i64,
    /// Counts the packets: a node's id is its packet's counter.
    pub sequencer: Sequencer,
    /// What each client (by vehicle) acknowledged; none for a vehicle that does not use the packets of this one.
    acknowledged: Vec<Option<AckBitmap>>,
    origin: Option<u64>,
    /// Nodes as they were sent, where that is not what they are.
    sent: Vec<(u64, Gaussian<NODE>)>,
}

/// A launch that has not been committed to.
#[derive(Debug, Clone, PartialEq)]
pub struct Launch {
    /// Its node, exact.
    pub node: Node,
    /// From the last node.
    pub step: GraphStep,
    filter: LocalFilter,
}

impl Server {
    /// Refuses a launch before what has been handled.
    ///
    /// # Errors
    /// [`Error::FromThePast`].
    pub fn check_launch(&self, tol_ns: i64) -> Result<(), Error> {
        match self.filter.now_ns.filter(|now_ns| tol_ns < *now_ns) {
            Some(now_ns) => Err(Error::FromThePast { event_ns: tol_ns, now_ns }),
            None => Ok(()),
        }
    }

    /// The graph of a vehicle whose packets the vehicles with `clients` use; bitmaps look back on `acknowledged`.
    ///
    /// # Errors
    /// What [`LocalOptions::validate`] says.
    pub fn new(options: LocalOptions, clients: &[bool], acknowledged: u32) -> Result<Self, Error> {
        let acknowledged = clients
            .iter()
            .map(|client| client.then(|| AckBitmap::new(acknowledged)).transpose())
            .collect::<Result<_, LinkError>>()?;
        Ok(Self {
            filter: LocalFilter::new(options)?,
            chain: Chain::new(),
            since: GraphStep::identity(),
            since_ns: 0,
            sequencer: Sequencer::new(),
            acknowledged,
            origin: None,
            sent: Vec::new(),
        })
    }

    /// The graph.
    #[must_use]
    pub fn chain(&self) -> &Chain {
        &self.chain
    }

    /// Place of the origin in the graph.
    fn origin_place(&self) -> Option<usize> {
        self.origin.and_then(|origin| self.chain.place(origin))
    }

    /// The origin.
    #[must_use]
    pub fn origin(&self) -> Option<&Node> {
        self.origin_place().and_then(|place| self.chain.nodes().get(place))
    }

    /// Advances to a checked sensor event and fuses it.
    ///
    /// # Errors
    /// [`Error::NotPositiveDefinite`] for a measurement that cannot be weighed; nothing has changed then.
    pub fn sense(&mut self, t_ns: i64, payload: &Payload) -> Result<(Outcome, Option<Fused>), Error> {
        if matches!(payload, Payload::Heading { .. } | Payload::Depth { .. }) {
            return Ok((self.filter.sense(t_ns, payload), None));
        }
        let mut filter = self.filter.clone();
        let (outcome, fused) = filter.sense_with_change(t_ns, payload);
        if let Some(Fused { q_m2_per_s3, change, step }) = fused
            && !self.chain.nodes().is_empty()
        {
            let mut since = self.since_at(t_ns, q_m2_per_s3);
            match change {
                Change::Start(linear) | Change::Sensed(linear) => {
                    since.update(&linear.observe(), &linear.value, &linear.noise)?;
                }
                Change::Moved(_) => {
                    let step = step.unwrap_or_else(odometry::OdometryStep::rest);
                    since.predict(&step.transition, &step.noise);
                    since.offset += step.offset;
                }
            }
            (self.since, self.since_ns) = (since, t_ns);
        }
        self.filter = filter;
        Ok((outcome, fused))
    }

    /// From the newest node to `t_ns`.
    fn since_at(&self, t_ns: i64, q_m2_per_s3: f64) -> GraphStep {
        let dt_s = seconds(t_ns.saturating_sub(self.since_ns));
        let mut since = self.since;
        if self.filter.odometer.moves() {
            return since;
        }
        since.predict(&process::transition(dt_s), &process::noise(dt_s, q_m2_per_s3));
        since
    }

    /// A launch at `tol_ns`; `None` before the first fix.
    #[must_use]
    pub fn prepare(&self, tol_ns: i64) -> Option<Launch> {
        let mut filter = self.filter.clone();
        let q = filter.sensors.process_noise_m2_per_s3(filter.options());
        filter.advance(tol_ns);
        let mut step = self.since_at(tol_ns, q);
        if let Some(node) = filter.node.as_mut().filter(|_| filter.odometer.moves()) {
            node.covariance += odometry::unrest();
            step.noise += odometry::unrest();
        }
        let node = Node { id: self.sequencer.peek(), tol_ns, filtered: filter.node? };
        Some(Launch { node, step, filter })
    }

    /// From an older node (by place) to the launch.
    fn step_to(&self, launch: &Launch, place: usize) -> Result<GraphStep, Error> {
        self.chain.between(place, self.chain.nodes().len() - 1)?.then(&launch.step)
    }

    /// What an exact packet says: the joint marginal with the origin and with the last `lags` launches.
    ///
    /// # Errors
    /// [`Error::NotPositiveDefinite`] for a graph that two launches at one instant left singular.
    pub fn exact_packet(&self, launch: &Launch, lags: usize) -> Result<GraphPacket, Error> {
        let id = launch.node.id;
        let Some(place) = self.origin_place() else {
            return Ok(GraphPacket {
                node: launch.node,
                origin: id,
                tie: OriginCorrelation::Begin,
                lags: Vec::new(),
            });
        };
        let origin = self.chain.nodes()[place].id;
        let joint =
            |place: usize| joint_of(&self.chain.nodes()[place].filtered, &self.step_to(launch, place)?);
        let mut exact = Vec::with_capacity(lags);
        for lag in lag_ids(id, origin).take(lags) {
            let Some(place) = self.chain.place(lag) else { break };
            exact.push((lag, Lag::Joint(joint(place)?)));
        }
        Ok(GraphPacket {
            node: launch.node,
            origin,
            tie: OriginCorrelation::Joint(joint(place)?),
            lags: exact,
        })
    }

    /// What a rounded packet says; `lags` launches exactly, where the form has room.
    ///
    /// # Errors
    /// What rounding says of values that do not fit.
    pub fn rounded_packet(
        &self,
        launch: &Launch,
        form: GraphForm,
        lags: usize,
    ) -> Result<GraphPacket, Error> {
        let mut exact = UnroundedPacket { node: launch.node, origin: None, lags: Vec::new() };
        if let (Some(origin), Some(transition)) = (self.origin(), self.error_transition(launch)?) {
            exact.origin = Some((origin.id, self.sent_of(origin), transition));
            for id in rounded_lag_ids(launch.node.id, origin.id).take(lags) {
                let Some(place) = self.chain.place(id) else { break };
                let node = &self.chain.nodes()[place];
                exact.lags.push((id, self.sent_of(node), self.step_to(launch, place)?));
            }
        }
        loop {
            match rounded(&exact, form) {
                Ok(packet) => return Ok(packet),
                // An exact lag that does not fit its fields is left out: clients then use the filtered-error model.
                Err(_) if exact.lags.pop().is_some() => {}
                Err(error) => return Err(error.into()),
            }
        }
    }

    /// What clients hold of a node.
    fn sent_of(&self, node: &Node) -> Gaussian<NODE> {
        self.sent.iter().find(|(id, _)| *id == node.id).map_or(node.filtered, |(_, sent)| *sent)
    }

    /// Φ(launch, origin): the transition of the filtered error from the origin to the launch.
    ///
    /// # Errors
    /// What composing steps says.
    pub fn error_transition(&self, launch: &Launch) -> Result<Option<NodeMatrix>, Error> {
        let Some(place) = self.origin_place() else { return Ok(None) };
        let step = self.step_to(launch, place)?;
        let prior = self.chain.nodes()[place].filtered.covariance;
        let settle = (NodeMatrix::identity() + prior * step.smoothing_matrix)
            .try_inverse()
            .ok_or(Error::NotPositiveDefinite { quantity: "I + PJ of the origin" })?;
        Ok(Some(step.transition * settle))
    }

    /// From the launch before to this one, where that is still in the graph.
    ///
    /// # Errors
    /// What composing steps says.
    pub fn step_from(&self, launch: &Launch, id: u64) -> Result<Option<GraphStep>, Error> {
        self.chain.place(id).map(|place| self.step_to(launch, place)).transpose()
    }

    /// Takes a launch whose packet was built: a new node.
    ///
    /// # Errors
    /// [`Error::Link`] when the counter is exhausted, or what composing steps says; nothing has changed then.
    ///
    /// `sent`: what clients hold of the node, where that is not what it is.
    pub fn launch(&mut self, launch: &Launch, sent: Option<Gaussian<NODE>>) -> Result<(), Error> {
        let mut chain = self.chain.clone();
        chain.push(launch.step, launch.node);
        chain.bound(NODES_MAX)?;
        self.sequencer.take()?;
        self.chain = chain;
        self.filter = launch.filter.clone();
        (self.since, self.since_ns) = (GraphStep::identity(), launch.node.tol_ns);
        self.origin.get_or_insert(launch.node.id);
        self.sent.extend(sent.map(|sent| (launch.node.id, sent)));
        let chain = &self.chain;
        self.sent.retain(|(id, _)| chain.place(*id).is_some());
        Ok(())
    }

    /// A client's acknowledgement: the origin moves on to the newest node that all clients hold.
    pub fn acknowledge(&mut self, client: VehicleId, bitmap: &AckBitmap) {
        if let Some(Some(known)) = self.acknowledged.get_mut(usize::from(client)) {
            known.merge(bitmap);
        }
        let held = |id: u64| self.acknowledged.iter().flatten().all(|known| known.is_received(id));
        let newest = self.chain.nodes().iter().rev().map(|node| node.id).find(|id| held(*id));
        if let Some(id) = newest
            && self.origin.is_some_and(|origin| id > origin)
        {
            self.origin = Some(id);
            self.chain.forget_before(id);
        }
    }

    /// Drops all nodes before this one: no reader of the graph needs them again.
    pub fn forget_before(&mut self, id: u64) {
        self.origin = Some(id);
        self.chain.forget_before(id);
    }

    /// Largest correlation of a position now with the same at the origin, for pictures.
    #[must_use]
    pub fn origin_correlation(&self, now_ns: i64) -> f64 {
        let correlation = || {
            let launch = self.prepare(now_ns)?;
            let origin: Gaussian<NODE> = self.origin()?.filtered;
            let step = self.step_to(&launch, self.origin_place()?).ok()?;
            let settle =
                (NodeMatrix::identity() + origin.covariance * step.smoothing_matrix).try_inverse()?;
            let smoothed = settle * origin.covariance;
            let cross = step.transition * smoothed;
            let own = launch.node.filtered.covariance;
            let of = |k: usize| cross[(k, k)] / (own[(k, k)] * smoothed[(k, k)]).sqrt();
            let [east, north] = [of(0), of(1)];
            Some(if north.abs() > east.abs() { north } else { east })
        };
        correlation().unwrap_or(f64::NAN)
    }
}
