//! Alternating landmark (Matsuda, Maki, Sato & Sakamaki 2017): two hovering vehicles take turns at standing still, and
//! any number of others follow the one that stands.
//!
//! * [`model`]: the method's equations as pure functions.
//! * [`paper`]: `landmark-paper`, particles over mover and landmark, the monitor and the reconstruction.
//! * [`robust`]: `landmark` and `landmark-ekf`, one Gaussian over mover, landmark and biases; also dead reckoning from
//!   DVL and gyro, which is the same without positionings.

pub mod averaged;
pub mod consensus;
mod fixes;
mod handover;
pub mod joint;
pub mod jump;
pub mod link;
pub mod model;
pub mod odometry;
pub mod options;
pub mod paper;
pub mod paper_cloud;
mod rest;
pub mod robust;
pub mod scatter;

pub use averaged::Averaged;
pub use options::{LandmarkOptions, PacketOptions};
pub use paper::{LandmarkPaper, PaperOptions};
pub use robust::Landmark;
