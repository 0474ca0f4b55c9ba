//! The front end against a dense reference, and what each sensor does when it fails.

use super::*;
use crate::event::Payload;

const SECOND: i64 = 1_000_000_000;

pub(super) fn drift() -> Drift {
    Drift {
        sigma_position_m_per_sqrt_s: 0.07,
        sigma_current_mps_per_sqrt_s: 0.01,
        sigma_current0_mps: 0.15,
        sigma_heading_bias0_rad: 0.02,
        sigma_heading_bias_rad_per_sqrt_s: 1e-5,
        sigma_thrust_bias0_mps: 0.1,
        sigma_thrust_bias_mps_per_sqrt_s: 1e-4,
        dvl: DvlErrors::default(),
    }
}

/// The two states as a Gaussian.
struct Pair {
    mean: Plane,
    covariance: Triangle,
}

impl VelocityError for Pair {
    fn moments(&self) -> (Plane, Triangle) {
        (self.mean, self.covariance)
    }

    fn reset(&mut self, mean_mps: Plane, covariance_m2ps2: Triangle, _thrust_sigma_mps: f64) {
        (self.mean, self.covariance) = (mean_mps, covariance_m2ps2);
    }

    fn turn(&mut self, re: f64, im: f64) {
        let [e, n] = self.mean;
        self.mean = [re * e - im * n, im * e + re * n];
        let [ee, en, nn] = self.covariance;
        self.covariance = [
            re * re * ee - 2.0 * re * im * en + im * im * nn,
            re * im * (ee - nn) + (re * re - im * im) * en,
            im * im * ee + 2.0 * re * im * en + re * re * nn,
        ];
    }
}

struct Driven {
    front: FrontEnd,
    pair: Pair,
}

impl Driven {
    fn new() -> Self {
        let prior = drift().sigma_current0_mps.powi(2);
        Self {
            front: FrontEnd::new(&drift()),
            pair: Pair { mean: [0.0; 2], covariance: [prior, 0.0, prior] },
        }
    }

    fn take(&mut self, t_ns: i64, payload: &Payload) -> Taken {
        if let Some(end_ns) = self.front.ends_before(t_ns) {
            self.front.follow(end_ns, &mut self.pair);
        }
        let taken = self.front.take(t_ns, payload);
        self.front.follow(t_ns, &mut self.pair);
        taken
    }

    fn heading(&mut self, t_ns: i64, yaw_rad: f64) -> Taken {
        self.take(t_ns, &Payload::Heading { yaw_rad, sigma_rad: 0.01 })
    }

    fn dvl(&mut self, t_ns: i64, velocity_mps: Plane) -> Taken {
        self.take(t_ns, &Payload::GroundVelocity { velocity_mps, sigma_mps: 0.02 })
    }

    fn command(&mut self, t_ns: i64, velocity_mps: Plane) {
        assert_eq!(self.take(t_ns, &Payload::Motion { velocity_mps }), Taken::Used);
    }
}

fn close(found: Plane, expected: Plane, by: f64) {
    assert!((0..2).all(|a| (found[a] - expected[a]).abs() < by), "{found:?}, not {expected:?}");
}

#[test]
fn a_command_alone_is_the_velocity_and_changes_no_state() {
    let mut driven = Driven::new();
    let before = driven.pair.covariance;
    for (second, velocity) in [[1.0, 0.5], [0.3, -0.2], [0.0, 0.0]].into_iter().enumerate() {
        let t_ns = second as i64 * SECOND;
        driven.command(t_ns, velocity);
        assert_eq!(driven.heading(t_ns, 0.7), Taken::Noted, "nothing to turn");
        assert_eq!(driven.front.velocity_mps(), velocity);
        assert_eq!((driven.pair.mean, driven.pair.covariance), ([0.0; 2], before));
        assert_eq!(driven.front.drift(t_ns, &drift()), drift());
    }
}

/// The error of scale and angle through a turn, against the map of the whole: c = [[u_e, -u_n], [u_n, u_e]] [s, a].
#[test]
fn the_error_of_a_dvl_turns_with_the_vehicle() {
    let mut driven = Driven::new();
    driven.heading(0, 0.0);
    driven.dvl(0, [1.2, 0.1]);
    assert!(driven.front.over_ground());
    let errors = DvlErrors::default();
    let angle = drift().sigma_heading_bias0_rad.hypot(errors.sigma_misalignment_rad);
    for step in 0..40i64 {
        let t_ns = step * SECOND / 2;
        let (yaw, speed) = (0.1 * step as f64, 1.2 + 0.01 * step as f64);
        // The filter without a gyro follows to within its gain.
        for _ in 0..30 {
            driven.heading(t_ns, yaw);
        }
        driven.dvl(t_ns, [speed, 0.1]);
        let [e, n] = driven.front.velocity_mps();
        close([e, n], turned_([speed, 0.1], yaw), 0.02);
        let square = (speed * speed + 0.01) / (1.2 * 1.2 + 0.01);
        let floor = 1e-4 * square;
        let (along, across) = (errors.sigma_scale.powi(2), angle * angle);
        let expected = [
            e * e * along + n * n * across + floor,
            e * n * (along - across),
            n * n * along + e * e * across + floor,
        ];
        for (found, expected) in driven.pair.covariance.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-9, "{:?} at {yaw} rad", driven.pair.covariance);
        }
    }
}

fn turned_([f, l]: Plane, yaw: f64) -> Plane {
    [yaw.cos() * f - yaw.sin() * l, yaw.sin() * f + yaw.cos() * l]
}

/// Bottom lock, then none for a minute, then again: the current that was learnt stands in.
#[test]
fn a_dropout_goes_on_with_the_command_and_the_current_that_was_learnt() {
    let mut driven = Driven::new();
    let (command, current) = ([1.0, 0.0], [0.1, -0.2]);
    let over = [command[0] + current[0], command[1] + current[1]];
    for second in 0..60 {
        let t_ns = second * SECOND;
        driven.command(t_ns, command);
        driven.heading(t_ns, 0.0);
        driven.dvl(t_ns, over);
        close(driven.front.velocity_mps(), over, 1e-9);
    }
    let locked = driven.pair.covariance;
    assert!(driven.front.ends_before(61 * SECOND).is_none());
    for second in 60..120 {
        let t_ns = second * SECOND;
        driven.command(t_ns, command);
        driven.heading(t_ns, 0.0);
        assert_eq!(driven.front.over_ground(), second < 62, "held for 3 s after 59 s");
    }
    close(driven.front.velocity_mps(), over, 0.01);
    let free = driven.pair.covariance;
    assert!(free[0] > locked[0] && free[0] < 0.15 * 0.15, "{locked:?} {free:?}");
    assert_eq!(driven.front.drift(100 * SECOND, &drift()), drift());
    driven.command(120 * SECOND, [0.0, 1.0]);
    close(driven.front.velocity_mps(), [0.1, 0.8], 0.01);
    driven.dvl(120 * SECOND, [0.1, 0.8]);
    assert!(driven.front.over_ground());
    close(driven.front.velocity_mps(), [0.1, 0.8], 1e-9);
    assert!(driven.front.drift(120 * SECOND, &drift()).sigma_current_mps_per_sqrt_s < 0.002);
}

#[test]
fn a_water_lock_is_better_than_a_command_and_a_velocity_is_held_where_there_is_neither() {
    let mut driven = Driven::new();
    driven.heading(0, 1.0);
    driven.dvl(0, [0.8, 0.0]);
    let before = driven.pair.covariance;
    assert_eq!(driven.heading(4 * SECOND, 1.0), Taken::Noted);
    close(driven.front.velocity_mps(), turned_([0.8, 0.0], 1.0), 1e-9);
    assert!(
        driven.pair.covariance[0] > before[0] + 0.01,
        "held, and not trusted: {:?}",
        driven.pair.covariance
    );
    driven.command(5 * SECOND, [0.5, 0.0]);
    close(driven.front.velocity_mps(), [0.5, 0.0], 0.2);
    driven.heading(5 * SECOND, 1.0);
    driven.take(5 * SECOND, &Payload::WaterVelocity { velocity_mps: [0.7, 0.0], sigma_mps: 0.02 });
    let locked = driven.front.velocity_mps();
    driven.command(6 * SECOND, [0.5, 0.3]);
    assert_eq!(driven.front.velocity_mps(), locked);
    driven.command(9 * SECOND, [0.5, 0.3]);
    assert_ne!(driven.front.velocity_mps(), locked, "the water lock is too old");
}

#[test]
fn readings_that_contradict_are_gated_until_they_insist() {
    let mut driven = Driven::new();
    driven.heading(0, 0.0);
    assert_eq!(driven.dvl(0, [1.0, 0.0]), Taken::Used);
    assert_eq!(driven.dvl(SECOND, [-5.0, 0.0]), Taken::Gated);
    close(driven.front.velocity_mps(), [1.0, 0.0], 1e-9);
    assert_eq!(driven.dvl(SECOND, [-32.768, -32.768]), Taken::Gated, "no bottom lock");
    assert_eq!(driven.dvl(2 * SECOND, [-5.0, 0.0]), Taken::Gated);
    assert_eq!(driven.dvl(2 * SECOND + 1, [-5.0, 0.0]), Taken::Used);
}

/// Odometry is integrated to the last digit at its own times: [forward, left] in the frame of each start.
#[test]
fn odometry_is_dead_reckoned_exactly() {
    let mut driven = Driven::new();
    let (mut place, mut expected, mut yaw) = ([0.0; 2], [0.0; 2], 0.3);
    driven.heading(0, yaw);
    for step in 0..100i64 {
        let t_ns = step * SECOND;
        let velocity = driven.front.velocity_mps();
        if step > 0 {
            // What a navigator does with the velocity in force.
            driven.front.moved(velocity);
            place = [place[0] + velocity[0], place[1] + velocity[1]];
        }
        let moved = [0.9 + 0.3 * (0.2 * step as f64).sin(), 0.05];
        let change = 0.08 * (0.1 * step as f64).cos();
        let payload = Payload::Odometry {
            displacement_m: moved,
            yaw_change_rad: change,
            covariance: [1e-4, 0.0, 0.0, 1e-4, 0.0, 1e-8],
        };
        let taken = driven.take(t_ns, &payload);
        if step == 0 {
            assert_eq!(taken, Taken::Noted, "since nothing");
            continue;
        }
        let here = turned_(moved, yaw);
        expected = [expected[0] + here[0], expected[1] + here[1]];
        yaw += change;
        if let Taken::Shifted(by) = taken {
            place = [place[0] + by[0], place[1] + by[1]];
            close(place, expected, 1e-9);
        } else {
            assert_eq!((step, taken), (1, Taken::Used));
            // Nothing was known of the first interval while it lasted.
            expected = [0.0; 2];
        }
    }
}
