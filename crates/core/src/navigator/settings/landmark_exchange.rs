//! What all alternating landmark navigators share: acoustic channels, frame, the packet of a role exchange.
//!
//! Source, unless said otherwise: Matsuda, Maki, Sato & Sakamaki (2017); its section, table or equation is named.

use std::f64::consts::TAU;

use serde::{Deserialize, Serialize};

use super::{Bound, Bounded};
use crate::error::Error;
use crate::mixture::{Criterion, FitOptions};
use crate::navigator::landmark::PacketOptions;
use crate::navigator::landmark::model::Pose;
use crate::packet::landmark::{ExchangeFormat, ExchangeSize};

/// What chooses the number of clusters of a cloud (section II.D).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ClustersBy {
    /// Bayesian information criterion.
    Bic,
    /// Akaike information criterion.
    Aic,
}

/// Channels, frame and exchange packet.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ExchangeSettings {
    /// σ_r, Table 4.
    pub sigma_range_m: f64,
    /// σ_θ of the direction that the mover measures, Table 4.
    pub sigma_own_bearing_deg: f64,
    /// σ_θ of the direction that the landmark measures, Table 4.
    pub sigma_peer_bearing_deg: f64,
    /// ε: how many measurements of a channel are outliers, in the mixture likelihood.
    pub outlier_share: f64,
    /// Over how many metres an outlier's range may lie.
    pub outlier_width_m: f64,
    /// Over how much of the circle an outlier's direction may lie.
    pub outlier_width_rad: f64,
    /// Easting of the first landmark: the frame, unless the scenario has another.
    pub landmark0_e_m: f64,
    /// Its northing.
    pub landmark0_n_m: f64,
    /// Its yaw.
    pub landmark0_yaw_rad: f64,
    /// Size of the exchange packet: whole ALOC signals of 8 bytes (section III.A).
    pub packet_bytes: usize,
    /// 1: layout of the reference cases; 2: check over sender and launch time, variance of rounding added.
    pub packet_format: u8,
    /// What chooses the number of clusters.
    pub clusters_by: ClustersBy,
    /// Starts of expectation–maximisation by k-means++.
    pub cluster_starts: usize,
    /// Its iterations at most.
    pub cluster_iterations: usize,
    /// A start ends when an iteration adds less to the mean log-likelihood of a particle, nat.
    pub cluster_tolerance: f64,
    /// Added to the whitened covariance of a single cluster.
    pub cluster_ridge_one: f64,
    /// The same for two and more.
    pub cluster_ridge_many: f64,
    /// Particles that the choice of the number of clusters looks at.
    pub cluster_search_points: usize,
}

impl Default for ExchangeSettings {
    fn default() -> Self {
        Self {
            sigma_range_m: 0.66,
            sigma_own_bearing_deg: 6.0,
            sigma_peer_bearing_deg: 1.0,
            outlier_share: 0.05,
            outlier_width_m: 60.0,
            outlier_width_rad: TAU,
            landmark0_e_m: 0.0,
            landmark0_n_m: 0.0,
            landmark0_yaw_rad: 0.0,
            packet_bytes: 32,
            packet_format: 2,
            clusters_by: ClustersBy::Bic,
            cluster_starts: 3,
            cluster_iterations: 60,
            cluster_tolerance: 1e-5,
            cluster_ridge_one: 1e-9,
            cluster_ridge_many: 1e-3,
            cluster_search_points: 1000,
        }
    }
}

/// A count from 1 on.
pub const COUNT: Bound = Bound::between(1.0, 1e6, "1 to 1,000,000");

impl ExchangeSettings {
    /// Bounds of its options.
    pub const BOUNDS: [Bounded; 12] = [
        ("sigma_range_m", Bound::POSITIVE),
        ("sigma_own_bearing_deg", Bound::POSITIVE),
        ("sigma_peer_bearing_deg", Bound::POSITIVE),
        ("outlier_share", Bound::OUTLIER_SHARE),
        ("outlier_width_m", Bound::POSITIVE),
        ("outlier_width_rad", Bound::POSITIVE),
        ("cluster_starts", COUNT),
        ("cluster_iterations", COUNT),
        ("cluster_tolerance", Bound::NON_NEGATIVE),
        ("cluster_ridge_one", Bound::POSITIVE),
        ("cluster_ridge_many", Bound::POSITIVE),
        ("cluster_search_points", COUNT),
    ];
    /// Options of the clusters.
    pub const CLUSTERS: [&'static str; 7] = [
        "clusters_by",
        "cluster_starts",
        "cluster_iterations",
        "cluster_tolerance",
        "cluster_ridge_one",
        "cluster_ridge_many",
        "cluster_search_points",
    ];
    /// Widths of outliers.
    pub const WIDTHS: [&'static str; 2] = ["outlier_width_m", "outlier_width_rad"];

    /// Standard deviations of the channels: m, rad, rad.
    #[must_use]
    pub fn sigma(&self) -> [f64; 3] {
        let (own, peer) = (self.sigma_own_bearing_deg, self.sigma_peer_bearing_deg);
        [self.sigma_range_m, own.to_radians(), peer.to_radians()]
    }

    /// Widths of the outliers' densities: m, rad, rad.
    #[must_use]
    pub fn widths(&self) -> [f64; 3] {
        [self.outlier_width_m, self.outlier_width_rad, self.outlier_width_rad]
    }

    /// Pose of the first landmark.
    #[must_use]
    pub fn first_landmark(&self) -> Pose {
        [self.landmark0_e_m, self.landmark0_n_m, self.landmark0_yaw_rad]
    }

    /// The exchange packet.
    ///
    /// # Errors
    /// [`Error::OutOfBound`] for another size or format.
    pub fn packet(&self) -> Result<PacketOptions, Error> {
        let format = match self.packet_format {
            1 => ExchangeFormat::One,
            2 => ExchangeFormat::Two,
            other => {
                let value = f64::from(other);
                return Err(Error::OutOfBound { quantity: "packet_format", value, bound: "1 or 2" });
            }
        };
        let size = ExchangeSize::from_bytes(self.packet_bytes).map_err(|_| Error::OutOfBound {
            quantity: "packet_bytes",
            value: self.packet_bytes as f64,
            bound: "8, 16, 32, 40, 64 or 128",
        })?;
        Ok(PacketOptions {
            format,
            size,
            criterion: match self.clusters_by {
                ClustersBy::Bic => Criterion::Bic,
                ClustersBy::Aic => Criterion::Aic,
            },
            fit: FitOptions {
                starts: self.cluster_starts,
                iterations: self.cluster_iterations,
                tolerance: self.cluster_tolerance,
                ridge_one: self.cluster_ridge_one,
                ridge_many: self.cluster_ridge_many,
            },
            search_points: self.cluster_search_points,
        })
    }
}
