//! Alternating landmark (Matsuda, Maki, Sato & Sakamaki 2017): two hovering vehicles take turns at standing still,
//! and any number of others follow the landmark.
//!
//! * [`model`]: the method's equations as pure functions.
//! * [`paper`]: `landmark-paper`, particles over mover and landmark, the monitor and the reconstruction.
//! * [`robust`]: `landmark` and `landmark-ekf`, one Gaussian over mover, landmark and biases; also dead reckoning from
//!   DVL and gyro, which is the same without positionings.

pub mod bias_model_average;
mod broadcast_belief;
pub mod consensus;
mod fixes;
mod handover;
pub mod joint;
mod joint_exchange;
pub mod jump_hypotheses;
pub mod model;
pub mod odometry;
pub mod options;
pub mod paper;
pub mod paper_cloud;
mod paper_exchange;
mod paper_options;
mod paper_positioning;
pub mod particles;
mod pose_algebra;
pub mod robust;
pub mod role_exchange;
mod stationary_gyro;

pub use bias_model_average::BiasModelAverage;
pub use options::{LandmarkOptions, PacketOptions};
pub use paper::LandmarkPaper;
pub use paper_options::PaperOptions;
pub use robust::Landmark;
